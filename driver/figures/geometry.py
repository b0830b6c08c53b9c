"""The scene as a picture: bodies and materials, supports, loads, obstacles, labels, subdomains."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..vectors import turned_left
from .labels import label_numbers, within
from .layout import map_axes, run_header, shrink_to_body
from .obstacle import draw_obstacles, hatch, where_it_goes
from .outline import outer, outward_edges, place_inside, sample
from .reading import Run
from .scales import Scale, length_scale, stress_scale
from .style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED, SKY, literal

TINTS = ["#F1F1EC", "#DDE8F0", "#F3E6D8", "#E4EEDD", "#EFE1EC", "#E3E3E3"]  # of bodies, materials
LINES = {"free": INK, "support": BLUE, "load": RED, "contact": GREEN, "pair": GREEN,
         "springs": SKY, "joined": ORANGE}
ARROW, SHORTEST = 0.16, 0.2  # longest arrow over the body's size, shortest one over the longest
FAINT = 1e-6  # part of the largest body force that is none
ALIKE = 0.05  # part of the largest way on a label by which others may differ to be one arrow
MOST_NAMES = 12  # of labels in the legend
RARE = 0.03  # share of the triangles from which on a material has a tint of its own


def geometry(figure: Figure, run: Run) -> None:
    """Body, parts of its boundary, loads at amplitude one, obstacles and subdomains."""
    mesh, boundary, role = run.first, run.boundary, run.boundary["role"]
    axes, scale = map_axes(figure, run, mesh.xy)
    xy, size = mesh.xy * scale.factor, np.ptp(mesh.xy, axis=0).max() * scale.factor
    edges = tuple(part * f for part, f in zip(outward_edges(boundary),
                                              (scale.factor, scale.factor, 1)))
    handles = _bodies(axes, run, xy)
    axes.add_collection(LineCollection(xy[mesh.rim()[0]], colors="0.62", linewidths=0.35,
                                       rasterized=True))
    roles = np.where(_moved(boundary) & (role == "support"), "moved", role)
    for name, colour in LINES.items():
        own = roles == name
        lines = np.stack([edges[0][own], edges[1][own]], axis=1)
        axes.add_collection(LineCollection(lines, colors=colour, capstyle="round", zorder=2.5,
                                           linewidths=1 if name == "free" else 2.2))
    traction = np.column_stack([boundary["traction_x"], boundary["traction_y"]])
    handles += _boundary_handles(role, traction.any(axis=1))
    _springs(axes, boundary, edges, size)
    handles += _supports(axes, boundary, edges, size)
    # without the little more the obstacle would hide the contact boundary where the gap is zero
    near = where_it_goes(run, np.array([mesh.xy.min(axis=0), mesh.xy.max(axis=0)]))
    draw_obstacles(axes, run, 0.0, size, scale.factor, scale.factor * near, 0.016 * size)
    _load_arrows(axes, edges, traction, boundary["label"], size)
    handles += _at_points(axes, run, edges, scale.factor, size) + _weight(axes, run, xy, size)
    label_numbers(axes, {**boundary, "role": roles}, edges, size, LINES | {"moved": PURPLE})
    if run.summary["sizes"]["subdomains"] > 1:
        handles.append(Line2D([], [], color="0.62", lw=0.6, label="subdomains"))
    handles += _label_names(run, boundary["label"], roles)
    axes.autoscale_view()
    run_header(figure, run, "Geometry, boundary conditions and subdomains", handles,
               _note(run, boundary, traction))
    shrink_to_body(figure, axes)


def _bodies(axes, run: Run, xy: np.ndarray) -> list:
    """Bodies in pale colours, or regions or materials where these differ; legend entries."""
    mesh = run.first
    kind, words = _materials(run)
    handles = [Patch(facecolor=TINTS[k % len(TINTS)], edgecolor="0.5", lw=0.4, label=text)
               for k, text in enumerate(words)][:6]
    axes.tripcolor(*xy.T, mesh.triangles, facecolors=(kind % len(TINTS)).astype(float),
                   cmap=ListedColormap(TINTS), vmin=0, vmax=len(TINTS) - 1, rasterized=True,
                   antialiased=False)
    return handles


def _materials(run: Run) -> tuple[np.ndarray, list[str]]:
    """(m,) number of every triangle's tint and what the tints stand for: materials with names;
    regions and their shear moduli; shear moduli that do not follow regions, in ranges where there
    are too many; bodies.
    """
    mesh = run.first
    if bodies := run.summary.get("materials"):
        kind, words = _named(run, bodies)
        return kind[mesh.body], words
    regions, of_region = np.unique(mesh.region, return_inverse=True)
    words = [f"region {name:g}" for name in regions]
    if mesh.shear_modulus is None:
        return (of_region, words) if len(regions) > 1 else (mesh.body, [])
    modulus = mesh.shear_modulus
    digits = np.array([float(f"{value:.3g}") for value in modulus])
    values, kind = np.unique(digits, return_inverse=True)
    if len(regions) > 1 and all(np.ptp(digits[of_region == k]) == 0 for k in range(len(regions))):
        first = [digits[of_region == k][0] for k in range(len(regions))]
        return of_region, [f"{name}, {_modulus(run, value)}" for name, value in zip(words, first)]
    share = np.bincount(kind) / len(kind)
    often = np.sort(np.argsort(-share, kind="stable")[:len(TINTS)])
    often = often[share[often] > RARE]
    if share[often].sum() > 0.5:  # triangles across an interface have means of both materials
        nearest = np.abs(np.log(values[kind][:, None] / values[often])).argmin(axis=1)
        return nearest, [_modulus(run, value) for value in values[often]]
    scale = stress_scale(run, modulus)
    bounds = scale.factor * np.geomspace(values[0], values[-1], len(TINTS) + 1)
    filled, kind = np.unique(np.digitize(modulus * scale.factor, bounds[1:-1]),
                             return_inverse=True)
    return kind, [f"$G$ = {bounds[k]:.3g} to {bounds[k + 1]:.3g} {scale.label}" for k in filled]


def _named(run: Run, bodies: list[dict]) -> tuple[np.ndarray, list[str]]:
    """(bodies,) tints and what they stand for: names with Young's moduli, where names are more than
    tints those of one material together.
    """
    of = [(row["name"], row["young"], row["poisson"]) for row in bodies]
    keys = of if len(set(of)) <= len(TINTS) else [values for _, *values in of]
    names: dict[tuple, list[str]] = {}
    for (name, *_), key in zip(of, map(tuple, keys)):
        if name not in names.setdefault(key, []):
            names[key].append(name)
    words = [f"{literal(one)}{f' and {len(more)} more' * bool(more)}, "
             f"$E$ = {_said(key[-2], stress_scale(run, key[-2]))}"
             for key, (one, *more) in names.items()]
    return np.array([[*names].index(tuple(key)) for key in keys]), words


def _modulus(run: Run, value: float) -> str:
    """A shear modulus with the unit that suits it."""
    return f"$G$ = {_said(value, stress_scale(run, value))}"


def _boundary_handles(role: np.ndarray, loaded: np.ndarray) -> list:
    """Legend entries for the parts of the boundary that occur, and for arrows elsewhere."""
    names = {"load": r"$\Gamma_p$ traction",
             "contact": r"$\Gamma_c$ contact, rigid obstacle (drawn a little apart)",
             "pair": r"$\Gamma_c$ contact of bodies", "springs": "elastic foundation",
             "joined": "tied or periodic", "free": "free"}
    handles = [Line2D([], [], color=LINES[n], lw=1 if n == "free" else 2.2, label=text)
               for n, text in names.items() if (role == n).any()]
    if (loaded & (role != "load")).any() and not (role == "load").any():
        handles.append(Line2D([], [], color=RED, marker=r"$\downarrow$", ls="none", ms=7,
                              label="traction"))
    return handles


def _label_names(run: Run, label: np.ndarray, roles: np.ndarray) -> list:
    """Legend entries for the labels of the edges (e,) that a gmsh file names, in the colours of
    their `roles` (e,): the number, as it stands in the picture, and the name.
    """
    names, handles = run.summary.get("label_names") or {}, []
    for number in np.unique(label):
        if name := names.get(f"{number:g}"):
            role = next((str(r) for r in roles[label == number] if r != "free"), "free")
            colour = (LINES | {"moved": PURPLE})[role]
            handles.append(Line2D([], [], color=colour, ls="none", marker=f"${number:g}$", mew=0.2,
                                  ms=4.0 + 2.0 * len(f"{number:g}"), label=literal(name)))
    return handles if len(handles) <= MOST_NAMES else []


def _moved(boundary: dict) -> np.ndarray:
    """(e,) whether supports move the edges."""
    return np.any([boundary["moved_x"], boundary["moved_y"]], axis=0)


def _supports(axes, boundary: dict, edges: tuple, size: float) -> list:
    """Hatches where both components are held, circles for rollers; violet where they move."""
    start, end, normal = edges
    held = np.column_stack([boundary["fixed_x"], boundary["fixed_y"]]) > 0
    moved = _moved(boundary)
    kinds = {"both": held.all(axis=1), "one": held.any(axis=1) & ~held.all(axis=1)}
    handles = []
    for moves, colour in ((False, BLUE), (True, PURPLE)):
        for kind, here in kinds.items():
            own = here & (moved == moves)
            if not own.any():
                continue
            lines = np.stack([start[own], end[own]], axis=1)
            axes.add_collection(LineCollection(lines, colors=colour, capstyle="round",
                                               linewidths=2.2, zorder=2.6))
            if kind == "both":
                hatch(axes, start[own], end[own], normal[own], size, colour)
                text = r"$\Gamma_u$ moved" if moves else r"$\Gamma_u$ support"
                handles.append(Line2D([], [], color=colour, lw=2.2, label=text))
                continue
            points, edge = sample(start[own], end[own], 0.05 * size)
            axes.plot(*(points + 0.015 * size * normal[own][edge]).T, "o", ms=3.4, mew=0.8,
                      mfc="white", mec=colour, zorder=2.7)
            text = r"$\Gamma_u$ moved in one direction" if moves else r"$\Gamma_u$ roller"
            handles.append(Line2D([], [], color=colour, lw=2.2, marker="o", ms=3.4, mfc="white",
                                  label=text))
    if moved.any():
        _motion_arrows(axes, boundary, edges, moved, size)
    return handles


def _springs(axes, boundary: dict, edges: tuple, size: float) -> None:
    """Zigzags outside of what an elastic foundation holds."""
    start, end, normal = edges
    own = np.flatnonzero(boundary["role"] == "springs")
    if not len(own):
        return
    points, edge = sample(start[own], end[own], 0.06 * size)
    _zigzags(axes, points, normal[own[edge]], size)


def _zigzags(axes, points: np.ndarray, out: np.ndarray, size: float) -> None:
    """Springs that go from points (n, 2) in the directions `out` (n, 2)."""
    off = np.array([0, 0.2, 0.3, 0.45, 0.55, 0.7, 0.8, 1])[:, None] * 0.05 * size
    aside = np.array([0, 0, 1, -1, 1, -1, 0, 0])[:, None] * 0.012 * size
    lines = points[:, None] + off * out[:, None] + aside * turned_left(out)[:, None]
    axes.add_collection(LineCollection(lines, colors=LINES["springs"], linewidths=0.8, zorder=2.4))


def _at_points(axes, run: Run, edges: tuple, factor: float, size: float) -> list:
    """Arrows of the loads at points, springs that lead away from the bodies; legend entries."""
    given = {name: [point for point in run.summary.get("points", []) if point["effect"] == name]
             for name in ("point_load", "springs")}
    handles = []
    if loads := given["point_load"]:
        places, force = (np.array([load[key] for load in loads]) for key in ("place", "value"))
        arrows = ARROW * size * force / np.linalg.norm(force, axis=1).max()
        places = factor * places
        inside = [within(place - 0.1 * arrow, *edges[:2]) for place, arrow in zip(places, arrows)]
        _quiver(axes, places - np.where(np.array(inside)[:, None], 0, arrows), arrows, RED)
        handles.append(Line2D([], [], color=RED, marker=r"$\downarrow$", ls="none", ms=7,
                              label="point load"))
    ends = [(factor * np.array(spring["place"]), axis) for spring in given["springs"]
            for axis, stiffness in zip(np.eye(2), spring["value"]) if stiffness]
    if ends:
        places, out = np.array(ends).swapaxes(0, 1)
        away = (out * (places - edges[0].mean(axis=0))).sum(axis=1) < 0
        _zigzags(axes, places, np.where(away[:, None], -out, out), size)
        handles.append(Line2D([], [], color=LINES["springs"], lw=0.8, label="spring"))
    return handles


def _motion_arrows(axes, boundary: dict, edges: tuple, moved: np.ndarray, size: float) -> None:
    """An arrow in the middle of every label that moves, in its direction, all of one length.

    Where a label turns or stretches some along it, each as long as its place moves.
    """
    start, end, normal = edges
    for name in np.unique(boundary["label"][moved]):
        own = np.flatnonzero(moved & (boundary["label"] == name))
        motion = np.column_stack([boundary[c][own] for c in ("moved_x", "moved_y")])
        largest = np.linalg.norm(motion, axis=1).max()
        if np.ptp(motion, axis=0).max() > ALIKE * largest:
            points, edge = sample(start[own], end[own], 0.12 * size)
            arrows = 0.08 * size * motion[edge] / largest
            _quiver(axes, points + 0.05 * size * normal[own[edge]] - arrows / 2, arrows, PURPLE)
            continue
        points, edge = sample(start[own], end[own], np.inf)
        arrow = 0.12 * size * motion[edge[0]] / largest
        outside = normal[own[edge[0]]]
        base = points[0] + 0.05 * size * outside
        if arrow @ outside < 0:
            base = base - arrow
        _quiver(axes, base[None], arrow[None], PURPLE)


def _load_arrows(axes, edges: tuple, traction: np.ndarray, label: np.ndarray,
                 size: float) -> None:
    """Tractions as arrows that end on the body when they push and start on it when they pull.

    Arrows along the boundary stand one behind the other, never on each other.
    """
    start, end, normal = edges
    force = np.linalg.norm(traction, axis=1)
    longest = force.max(initial=0)
    for name in np.unique(label[force > 0]):
        own = np.flatnonzero((label == name) & (force > 0))
        length = ARROW * size * max(force[own].max() / longest, SHORTEST)
        arrows = length * traction[own] / force[own].max()
        along = np.abs((turned_left(normal[own]) * arrows).sum(axis=1)).max()
        points, edge = sample(start[own], end[own], max(0.075 * size, 1.25 * along))
        out, arrows = normal[own[edge]], arrows[edge]
        across = (out * arrows).sum(axis=1)[:, None]
        points = points + 0.012 * size * out
        tails = np.where(across < -0.2 * length, points - arrows, points)
        tails = np.where(np.abs(across) <= 0.2 * length, points - arrows / 2, tails)
        _quiver(axes, tails, arrows, RED)


def _quiver(axes, tails: np.ndarray, arrows: np.ndarray, colour: str) -> None:
    axes.quiver(*tails.T, *arrows.T, angles="xy", scale_units="xy", scale=1, color=colour,
                units="inches", width=0.014, headwidth=4.5, headlength=6, headaxislength=5.5,
                zorder=3)
    axes.update_datalim(np.concatenate([tails, tails + arrows]))


def _weight(axes, run: Run, xy: np.ndarray, size: float) -> list:
    """An arrow in every body that body forces act on, in their direction at amplitude one."""
    bodies = np.unique(run.first.body)
    force = np.sum([load["bodies"] for load in run.summary.get("loads", [])
                    if load["effect"] == "body_force"] or [np.zeros((len(bodies), 2))], axis=0)
    length = np.linalg.norm(force, axis=1)
    pulled = np.flatnonzero(length > FAINT * length.max())
    if not len(pulled):
        return []
    arrows = 0.1 * size * force[pulled] / length[pulled, None]
    rim = xy[run.first.rim()[0][outer(run.first, run.boundary)]].mean(axis=1)
    middles = np.array([place_inside(xy[run.first.triangles[run.first.body == bodies[k]]], rim)
                        for k in pulled])
    _quiver(axes, middles - arrows / 2, arrows, GREY)
    return [Line2D([], [], color=GREY, marker=r"$\downarrow$", ls="none", ms=7,
                   label="body force")]


def _note(run: Run, boundary: dict, traction: np.ndarray) -> str:
    """Length of the longest arrow, and the largest prescribed displacement."""
    words = []
    if longest := np.linalg.norm(traction, axis=1).max(initial=0):
        stress = stress_scale(run, longest)
        words.append(rf"longest arrow {_said(longest, stress)} at $\varphi = 1$")
    moved = np.hypot(boundary["moved_x"], boundary["moved_y"]).max(initial=0)
    if moved:
        length = length_scale(run, moved)
        words.append(f"moved by up to {_said(moved, length)}")
    return ", ".join(words)


def _said(value: float, scale: Scale) -> str:
    """A value with its unit, if it has one."""
    times = "·" if scale.label.startswith("$10") else " "
    return f"{value * scale.factor:.3g}{times}{scale.label}".removesuffix(" –")
