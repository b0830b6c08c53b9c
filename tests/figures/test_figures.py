"""Figures drawn from a made-up run directory: what is drawn, what it says, and that nothing
overlaps."""

import csv
import dataclasses
import json
import math
import warnings
from pathlib import Path
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from matplotlib.transforms import Bbox
from PIL import Image, ImageColor

from driver import figures
from driver.errors import InputError
from driver.figures import (animation, body, contact, convergence, crossing, geometry, history,
                            labels, layout, obstacle, outline, reading, redraw, scales, style,
                            theory)

ALL = ["geometry", "loading", "deformed", "contact_normal", "contact_tangential", "contact_status",
       "history", "convergence"]


# ------------------------------------------------------------------------- a made-up run directory

def write_table(path: Path, names: str, rows) -> None:
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([names.split(","), *rows])


def torn_block(subdomains=(4, 2), cells=5):
    """Points and triangles of (0,2)x(0,1), repeated along the subdomains' interfaces, and subdomain
    numbers."""
    points, triangles, owner = [], [], []
    i, j = (k.ravel() for k in np.meshgrid(range(cells), range(cells), indexing="ij"))
    corner = i * (cells + 1) + j
    right, up = corner + cells + 1, corner + 1
    local = np.concatenate([np.column_stack([corner, right, right + 1]),
                           np.column_stack([corner, right + 1, up])])
    grid = np.stack(np.meshgrid(*[np.arange(cells + 1) / cells]
                    * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    for number, (a, b) in enumerate(np.ndindex(*subdomains)):
        triangles.append(local + len(points) * len(grid))
        points.append((grid + [a, b]) / subdomains * [2, 1])
        owner.append(np.full(len(local), number))
    return np.concatenate(points), np.concatenate(triangles), np.concatenate(owner)


def write_fields(directory: Path, times, subdomains, cells) -> None:
    xy, triangles, owner = torn_block(subdomains, cells)
    (directory / "fields").mkdir()
    entries = []
    for step, t in enumerate(times):
        x, y = xy.T
        u = 1e-3 * t * np.column_stack([0.35 * x - 0.1 * x * y,
                                       0.25 * np.maximum(x - 1.4, 0) ** 1.5 - 0.3 * y])
        mises = 1e8 * t * (0.8 + 0.3 * np.sin(3 * x) * y + 0.12 / (0.02 + np.hypot(x, y - 1))
                           + 0.1 / (0.02 + np.hypot(x, y)))
        stress = np.column_stack([mises, 0 * x, 0 * x, 0 * x])  # of which it is von Mises's
        name = f"fields/step_{step:04d}.vtu"
        meshio.Mesh(np.column_stack([x, y, 0 * x]), [("triangle", triangles)],
                    point_data={"displacement": np.column_stack([u, 0 * x]), "stress": stress},
                    cell_data={"subdomain": [owner], "body": [0 * owner],
                               "region": [0 * owner]}).write(directory / name)
        entries.append(f'<DataSet timestep="{t}" group="" part="0" file="{name}"/>')
    text = '<VTKFile type="Collection" version="0.1"><Collection>' + \
        "".join(entries) + "</Collection></VTKFile>"
    (directory / "fields.pvd").write_text(text)


def write_boundary(directory: Path, n: int, roles: dict) -> None:
    """Edges of the block, n per unit of length, those of bottom and top against the body's
    orientation."""
    rows = []
    corners = {1: ((0, 0), (2, 0)), 2: ((2, 0), (2, 1)), 3: ((2, 1), (0, 1)), 4: ((0, 1), (0, 0))}
    for label, ends in corners.items():
        a, b = np.array(ends, dtype=float)
        line = np.linspace(a, b, int(n * np.linalg.norm(b - a)) + 1)
        pull = (0, 0)
        if roles[label] == "load":
            pull = {3: (0.0, -1e8), 2: (3e7, 5e7)}.get(label, pull)
        held = int(roles[label] == "support")
        rows += [(*p, *q, label, roles[label], *pull, held, held, 0, 0)
                 for p, q in zip(line, line[1:])]
    write_table(directory / "boundary.csv", "x0,y0,x1,y1,label,role,traction_x,traction_y,"
                "fixed_x,fixed_y,moved_x,moved_y", rows)


def contact_rows(times, nodes: int, friction: bool, labels: int):
    """A pressure that ends where the body lifts, a stick zone between two slip zones, both moving
    in time."""
    arc = np.linspace(0, 2, nodes + 1)[1:]
    weight = np.full(nodes, 2 / nodes)
    weight[-1] /= 2
    before = np.zeros(nodes)
    for step, t in enumerate(times[1:], 1):
        end = 1.75 - 0.35 * t
        sigma_n = -1.1e8 * t * np.sqrt(np.clip(1 - (arc / end) ** 2,
                                       0, None)) * (1 + 0.6 * np.exp(-9 * arc))
        u_n = -2.5e-4 * t * np.clip(arc - end, 0, None) ** 1.5
        u_t = 3e-4 * t**1.3 * arc / 2
        bound = 0.3 * np.abs(sigma_n) * friction
        sticks = (arc > 0.25) & (arc < 0.25 + 0.5 * t)
        sigma_t = -bound * np.where(sticks, np.cos(np.pi * (arc - 0.25) / t)
                                    ** 2 * 0.8 + 0.2, 1) * friction
        status = np.where(arc >= end, "open", np.where(sticks, "stick", "slip"))
        for label in range(1, labels + 1):
            for k in range(nodes):
                yield (step, t, k + 1, label, arc[k], 0, arc[k], weight[k], 0, -1, 0, u_n[k],
                       u_t[k], u_t[k] - before[k], sigma_n[k], sigma_t[k], bound[k], status[k])
        before = u_t


def convergence_rows(steps: int, products: int):
    """Residuals that fall in every fixed-point iteration and start lower from one to the next."""
    rng = np.random.default_rng(len("mprgp"))
    product = 0
    for step in range(1, steps + 1):
        for iteration in range(1, 7):
            start = 0.1 * 10.0 ** -iteration
            length = products // iteration
            for k in range(length + 1):
                kind = "start" if k == 0 else rng.choice(
                    ["cg", "expansion", "proportioning"], p=[0.75, 0.2, 0.05])
                product += 2 if kind == "expansion" else 1
                residual = start * math.exp(-6 * k / length + rng.normal() / 3)
                yield product, step, iteration, kind, residual


def make_run(directory: Path, *, nodes=21, steps=20, friction="coulomb", contact="unilateral",
             time="quasistatic",
             labels=1, converged=True, units=("m", "Pa"), scene="model", subdomains=(4, 2), cells=5,
             products=24):
    """Write a run directory as the driver does; returns it."""
    directory.mkdir(parents=True, exist_ok=True)
    steps = steps if time == "quasistatic" else 1
    times = np.arange(steps + 1) / steps
    touching = contact != "none"
    (directory / "summary.json").write_text(json.dumps({
        "scene": scene, "variant": "nonmonotone", "converged": converged,
        "units": {"length": units[0], "stress": units[1]},
        "effects": {"contact": contact, "friction": friction, "time": time, "bodies": 1},
        "t_end": 1, "amplitudes": {"1": (5 * times - 4 * times**2).tolist(), "2": times.tolist()},
        "sizes": {"subdomains": math.prod(subdomains)}, "seconds": {}}))
    rows = [(s, t, -4 * t**2 + 5 * t, t, 6 * (s > 0), 250, -1.2e8 * t * touching, 2e7 * t * (1 - t),
             0, 0, 0, 1e-3, 1.5, 1e4 * t)
            for s, t in enumerate(times)]
    write_table(directory / "history.csv",
                "step,time,amplitude_1,amplitude_2,fixed_point_iterations,"
                "dual_multiplications,resultant_n,resultant_t,nodes_open,nodes_stick,nodes_slip,"
                "max_displacement,contact_length,dissipated", rows)
    if touching:
        write_table(directory / "contact.csv",
                    "step,time,node,boundary,x,y,arc,weight,normal_x,normal_y,gap,u_n,"
                    "u_t,slip,sigma_n,sigma_t,bound,status",
                    contact_rows(times, nodes, friction != "none", labels))
    write_table(directory / "convergence.csv", "product,step,iteration,kind,residual",
                convergence_rows(steps, products))
    write_boundary(directory, cells * subdomains[1],
                   {1: "contact" if touching else "free", 2: "load", 3: "load", 4: "support"})
    write_fields(directory, times, subdomains, cells)
    return directory


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The run that most tests look at; nobody writes into it but draw_run."""
    return make_run(tmp_path_factory.mktemp("runs") / "model")


@pytest.fixture(scope="module")
def run(plain):
    return figures.read_run(plain)


@pytest.fixture(scope="module")
def drawn(run):
    """All its figures, drawn once, so that their ticks stand where they do in the picture; the
    tests only look at them.
    """
    found = {name: figures.compose(name, run) for name in ALL}
    for figure in found.values():
        figure.draw_without_rendering()
    return found


# ---------------------------------------------------------------------------------------- helpers

def words(figure) -> str:
    """Title, legend, labels and texts of a figure in one string."""
    found = [t.get_text() for t in figure.texts]
    found += [t.get_text() for legend in figure.legends for t in legend.get_texts()]
    for axes in figure.axes:
        found += [axes.get_xlabel(), axes.get_ylabel(), axes.get_title()]
    return "\n".join(found)


def legend_words(figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def boxes(figure) -> dict:
    """Bounding boxes in pixels of everything written outside the axes, and of the axes
    themselves."""
    figure.draw_without_rendering()  # which places the names of axes
    renderer = figure.canvas.get_renderer()
    found = {"title": figure.texts[0], "identity": figure.texts[1],
             **dict(enumerate(figure.legends))}
    found = {name: artist.get_window_extent(renderer) for name, artist in found.items()}
    for number, axes in enumerate(figure.axes):
        found[f"axes {number}"] = axes.get_window_extent(renderer)
        for side, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
            ticks = [t.label1 for t in axis.get_major_ticks()
                     if t.label1.get_visible() and t.label1.get_text()]
            low, high = sorted(axis.get_view_interval())
            ticks = [t for t, where in zip(ticks, axis.get_majorticklocs()) if low <= where <= high]
            for k, tick in enumerate(ticks):
                found[f"{side} tick {k} of {number}"] = tick.get_window_extent(renderer)
            if axis.label.get_text():
                found[f"{side} label of {number}"] = axis.label.get_window_extent(renderer)
        if axes.get_title():
            found[f"title of {number}"] = axes.title.get_window_extent(renderer)
    return found


def overlaps(figure) -> list[tuple[str, str]]:
    """Pairs of boxes that share more than a pixel."""
    items = [(name, box) for name, box in boxes(figure).items() if box.width > 0 and box.height > 0]
    return [(a, b) for k, (a, p) in enumerate(items) for b, q in items[k + 1:]
            if min(p.x1, q.x1) - max(p.x0, q.x0) > 1 and min(p.y1, q.y1) - max(p.y0, q.y0) > 1]


def outside(figure) -> list[str]:
    """Names of boxes that reach beyond the paper."""
    page = figure.bbox
    return [name for name, b in boxes(figure).items()
            if min(b.x0, b.y0) < -1 or b.x1 > page.x1 + 1 or b.y1 > page.y1 + 1]


# ------------------------------------------------------------------------------------------ tests

@pytest.mark.slow
def test_every_figure_is_written_whole(plain):
    paths = figures.draw_run(plain)
    assert [p.name for p in paths] == [f"{n}.{kind}" for n in ALL for kind in ("png", "pdf")]
    assert all(p.read_bytes()[:4] == (b"\x89PNG" if p.suffix == ".png" else b"%PDF") for p in paths)
    assert sorted(p.name for p in (plain / "figures").iterdir()) == sorted(p.name for p in paths)


@pytest.mark.slow  # every figure twice
def test_drawing_again_gives_the_same_files(tmp_path):
    directory = make_run(tmp_path, time="static", friction="none", products=6)
    paths = figures.draw_run(directory)
    first = [p.read_bytes() for p in paths]
    assert figures.draw_run(directory) == paths
    assert [p.read_bytes() for p in paths] == first


@pytest.mark.parametrize("change, absent", [
    ({"friction": "none"}, {"contact_tangential"}),
    ({"contact": "none", "friction": "none"}, {"contact_normal",
     "contact_tangential", "contact_status", "history"}),
    ({"time": "static"}, {"loading", "contact_status", "history"}),
])
@pytest.mark.some(1)
def test_what_the_scene_does_not_declare_is_not_drawn(tmp_path, change, absent):
    run = figures.read_run(make_run(tmp_path / "run", steps=3, **change))
    assert list(figures.wanted(run)) == [n for n in ALL if n not in absent]
    for name in figures.wanted(run):
        figures.compose(name, run)


def test_figures_of_an_earlier_run_do_not_stay(tmp_path):
    directory = make_run(tmp_path, time="static", contact="none", friction="none", products=6)
    for name in ("boundary.csv", "fields.pvd"):
        (directory / name).unlink()
    (directory / "figures").mkdir()
    for name in ("contact_tangential.png", "geometry.pdf", "notes.txt"):
        (directory / "figures" / name).write_bytes(b"old")
    figures.draw_run(directory)
    left = sorted(p.name for p in (directory / "figures").iterdir())
    assert left == ["convergence.pdf", "convergence.png", "notes.txt"]


def test_optional_files_may_be_missing(tmp_path):
    directory = make_run(tmp_path, steps=2, products=6)
    for name in ("convergence.csv", "boundary.csv", "fields.pvd"):
        (directory / name).unlink()
    assert list(figures.wanted(figures.read_run(directory))) == ["loading", "contact_normal",
                                                                 "contact_tangential",
                                                                 "contact_status", "history"]


@pytest.mark.parametrize("name, size, words", [
    ("fields/step_0002.vtu", None, "is missing"), ("fields/step_0000.vtu", 0, "is damaged"),
    ("fields/step_0002.vtu", 3000, "is damaged"), ("fields.pvd", 100, "is damaged"),
    ("history.csv", 200, "is cut off"), ("contact.csv", 3000, "is cut off"),
    ("boundary.csv", 0, "is cut off")])
def test_files_that_are_gone_or_cut_off_are_named(tmp_path, name, size, words):
    """As a copy that broke off leaves them: in one line, no defect of the suite."""
    directory = make_run(tmp_path, steps=2, products=6)
    path = directory / name
    if size is None:
        path.unlink()
    else:
        path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(InputError, match=f"{name} .*{words}.*: run the scene again"):
        figures.draw_run(directory)


def test_a_directory_without_a_run_is_refused(tmp_path):
    with pytest.raises(InputError, match="summary.json"):
        figures.draw_run(tmp_path)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.some(4)
def test_nothing_overlaps_or_leaves_the_page(drawn, name):
    figure = drawn[name]
    assert figure.get_figwidth() == pytest.approx(16 / 2.54)
    assert outside(figure) == []
    assert overlaps(figure) == []


@pytest.mark.parametrize("labels, missing", [
    (2, ""), (6, ""), (7, "not shown, as they carry least: 7 (see contact.csv)"),
    (13, "not shown, as they carry least: 7, 8, 9, 10, 11 and 2 more (see contact.csv)")])
@pytest.mark.some(1)
def test_several_contact_boundaries_have_a_panel_each(tmp_path, labels, missing):
    run = figures.read_run(make_run(tmp_path, steps=3, labels=labels, products=6))
    for name, stacked in (("contact_normal", 2), ("contact_tangential", 2), ("contact_status", 1)):
        figure = figures.compose(name, run)
        assert len(figure.axes) == stacked * min(labels, 6)
        assert overlaps(figure) == [] and outside(figure) == []
        assert r"$\Gamma_c$, label 2" in words(figure)
        assert missing in words(figure) and ("not shown" in words(figure)) == bool(missing)


def test_contact_boundaries_that_carry_most_are_those_shown():
    """The last one alone presses at the end, the fourth before; the others, open, make room."""
    labels, nodes = np.arange(1, 10), 3
    step, label, _ = (k.ravel() for k in np.meshgrid([1, 2], labels, range(nodes), indexing="ij"))
    presses = (label == 9) & (step == 2) | (label == 4) & (step == 1)
    contact_table = {"step": step, "boundary": label, "arc": np.tile(np.arange(nodes), 18),
                     "weight": np.ones(54), "sigma_n": np.where(presses, -1.0, 0.0)}
    at_end = reading.contact_boundaries(reading.select(contact_table, step == 2))
    shown, note = layout.fitting(at_end, contact_table)
    assert [name for name, _ in shown] == [1, 2, 3, 4, 5, 9]
    assert note == "not shown, as they carry least: 6, 7, 8 (see contact.csv)"


def test_geometry_names_the_parts_and_draws_the_loads_to_scale(drawn):
    figure = drawn["geometry"]
    text = "\n".join(legend_words(figure))
    assert all(part in text for part in (r"$\Gamma_u$", r"$\Gamma_p$", r"$\Gamma_c$", "subdomains"))
    assert "longest arrow 100 MPa" in words(figure)
    right, top = (c for c in figure.axes[0].collections if hasattr(c, "U"))
    assert np.allclose(right.V / right.U, 5 / 3) and np.all(top.U == 0) and np.all(top.V < 0)
    assert np.allclose(np.hypot(right.U, right.V) / np.abs(top.V[0]), math.hypot(0.3, 0.5))
    assert np.all(top.Y + top.V >= 1), "pushing arrows end on the body"
    assert np.all(right.X >= 2), "pulling arrows start on the body"


def test_boundary_edges_point_outward(run):
    start, end, normal = outline.outward_edges(run.boundary)
    for label, expected in {1: (0, -1), 2: (1, 0), 3: (0, 1), 4: (-1, 0)}.items():
        assert np.allclose(normal[run.boundary["label"] == label], expected)
    follows = (np.abs(end[:, None] - start[None]).max(axis=2) < 1e-9).sum(axis=1)
    assert np.all(follows == 1), "directed edges close the outline"
    (chain,) = outline.chains(start, end)
    assert np.allclose(start[chain[1:]], end[chain[:-1]]) and len(chain) == len(start)


def test_edges_of_bodies_that_touch_keep_their_sides():
    """Halves of quadratic sides, others on the other body: the nearest side is another one."""
    up, down = np.linspace(0, 3, 5), np.linspace(3, 0, 8)
    ends = [(np.column_stack([0 * y, y])[:-1], np.column_stack([0 * y, y])[1:]) for y in (up, down)]
    start, end = (np.concatenate(part) for part in zip(*ends))
    table = {"x0": start[:, 0], "y0": start[:, 1], "x1": end[:, 0], "y1": end[:, 1]}
    _, _, normal = outline.outward_edges(table)
    assert np.allclose(normal[:4], (1, 0)) and np.allclose(normal[4:], (-1, 0))


def circle(radius: float, angles):
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def test_marks_are_spread_evenly_over_unequal_edges():
    ends = circle(1, -np.pi + np.pi * np.linspace(0, 1, 40) ** 2)
    points, edges = outline.sample(ends[:-1], ends[1:], 0.1)
    assert len(points) == len(edges) == 31  # pi / 0.1
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    # chords of 0.1 and edges of 0.16 at most: 1 - x^2/24 > 0.99
    assert np.allclose(gaps, np.pi / 31, rtol=0.01)


@pytest.mark.slow
def test_pictures_show_the_time_of_the_quantities(tmp_path):
    """Where contact is lost at the end, that is the time of its largest resultant."""
    directory = make_run(tmp_path / "run", steps=4, products=6)
    summary = json.loads((directory / "summary.json").read_text())
    (directory / "summary.json").write_text(json.dumps(summary | {"quantities_time": 0.5}))
    run = figures.read_run(directory)
    assert run.last.time == 0.5
    for name in ("deformed", "contact_normal", "contact_tangential"):
        assert "at $t = 0.5$" in words(figures.compose(name, run))


def test_foundation_under_a_round_body_is_as_flat_as_its_gap_says():
    angle = np.linspace(-0.7, -0.3, 9) * np.pi
    ends, size = circle(1, angle), 2.0
    contact = {"x": ends[:, 0], "y": ends[:, 1], "normal_x": ends[:, 0], "normal_y": ends[:, 1],
               "gap": -1 / np.sin(angle) - 1,  # along the normal, down to y = -1
               "arc": 1 + angle}
    axes = Figure().add_subplot()
    obstacle.draw_obstacle(axes, contact, size, 1.0, 0.016 * size)
    line, marks = (np.array(c.get_segments()) for c in axes.collections)
    # the rest by which the foundation is set off is taken along the normal
    assert np.allclose(line[:, 0, 1], -1 + 0.016 * size * np.sin(angle[:-1]))
    assert np.all(marks[:, 1, 1] < marks[:, 0, 1] - 0.02 * size)


@pytest.mark.parametrize("wall", [0.0, 3.0])
def test_a_round_obstacle_seen_along_the_bodys_normals_has_no_sides(wall):
    """A circle of radius one over a plane, by the first-order distances of an obstacle that moves:
    a parabola, drawn up to where it is steep. Steps of an obstacle between level parts are drawn.
    """
    x = np.linspace(-3, 3, 121)
    away = np.hypot(x, 1.0)
    gap = (away - 1) * away if not wall else np.where(np.abs(x) < 1, 0.0, wall)
    contact = {"x": x, "y": 0 * x, "normal_x": 0 * x, "normal_y": 0 * x + 1, "gap": gap, "arc": x}
    axes = Figure().add_subplot()
    obstacle.draw_obstacle(axes, contact, 100.0, 1.0)
    line = np.array(axes.collections[0].get_segments())
    if wall:
        assert (line[:, :, 0].min(), line[:, :, 0].max()) == (-3, 3)
    else:
        assert 1.0 < line[:, :, 0].max() < 1.3 and line[:, :, 1].max() < 1.1


@pytest.mark.parametrize("bent, longer", [(0.0, 0.6), (0.1, 0.0)])
def test_a_flat_foundation_goes_on_as_far_as_the_body_slides(bent, longer):
    """By the displacement as it is drawn; nothing is known of how a curved one goes on."""
    x = np.linspace(0, 1, 5)
    contact = {"x": x, "y": 0 * x, "normal_x": bent * x, "normal_y": -np.sqrt(1 - (bent * x)**2),
               "gap": 0 * x, "arc": x, "u_t": 0.1 * x}
    axes = Figure().add_subplot()
    obstacle.draw_obstacle(axes, contact, 1.0, 2.0, times=3.0)
    line = np.array(axes.collections[0].get_segments())[:, :, 0]
    assert (line.min(), line.max()) == pytest.approx((-longer, 2.0 + longer))


def test_a_ramp_beside_a_round_body_goes_on_as_well():
    """Its points lie on a line though the gaps differ."""
    x = np.linspace(0, 1, 5)
    contact = {"x": x, "y": x**2 / 9, "normal_x": 0 * x, "normal_y": 0 * x - 1, "gap": x**2 / 9,
               "arc": x, "u_t": 0.1 + 0 * x}
    axes = Figure().add_subplot()
    obstacle.draw_obstacle(axes, contact, 1.0, 1.0, times=1.0)
    line = np.array(axes.collections[0].get_segments())[:, :, 0]
    assert (line.min(), line.max()) == pytest.approx((-0.1, 1.1))


def test_the_corner_of_a_groove_is_drawn():
    """A disc of radius one over the floor y = -1 and beside the wall x = 1.2, each of which is met
    by half of its nodes: no bevel from the last place on the one to the first on the other.
    """
    angle = np.linspace(-0.5, 0.0, 10) * np.pi
    (x, y), below = np.array([np.cos(angle), np.sin(angle)]), angle < -0.25 * np.pi
    contact = {"x": x, "y": y, "normal_x": 1.0 * ~below, "normal_y": -1.0 * below,
               "gap": np.where(below, 1 + y, 1.2 - x), "arc": angle}
    axes = Figure().add_subplot()
    obstacle.draw_obstacle(axes, contact, 2.0, 1.0)
    line, marks = (np.array(c.get_segments()) for c in axes.collections)
    off = np.minimum(np.abs(line[..., 1] + 1), np.abs(line[..., 0] - 1.2))
    assert off.max() < 1e-12 and (np.abs(line - [1.2, -1.0]).max(axis=2) < 1e-12).sum() == 2
    assert ((marks[:, 1, 1] < -1) | (marks[:, 1, 0] > 1.2)).all()


@pytest.mark.parametrize("far, planes", [(0.0, 0), (3.0, 1)])
def test_planes_stand_in_for_an_obstacle_that_is_not_in_the_picture(far, planes):
    """Two nodes that have gone `far` along a floor at y = 0, in a picture 1 wide."""
    zero = np.zeros(2)
    rows = {"x": np.array([0.0, 0.1]), "y": zero, "normal_x": zero, "normal_y": zero - 1,
            "gap": zero}
    axes = Figure().add_subplot()
    obstacle.draw_planes(axes, rows, np.array([[far, 0.0], [far + 0.1, 0.0]]), 1.0, 1.0)
    assert len(axes.collections) == 2 * planes
    if planes:
        line, marks = (np.array(drawn.get_segments()) for drawn in axes.collections)
        assert line[0].min() == 0 == line[:, :, 1].max() and (marks[:, 1, 1] < 0).all()


def test_rim_of_the_torn_mesh_is_the_boundary_of_every_subdomain(run):
    edges, _ = run.first.rim()
    length = np.linalg.norm(np.diff(run.first.xy[edges], axis=1), axis=2).sum()
    assert length == pytest.approx(8 * 4 * 0.5)


def test_loading_has_a_curve_for_every_amplitude_from_time_zero(drawn):
    figure = drawn["loading"]
    assert legend_words(figure) == [r"$\varphi_{1}(t)$", r"$\varphi_{2}(t)$"]
    for line in figure.axes[0].lines:
        assert len(line.get_xdata()) == 21 and line.get_xdata()[0] == 0
        assert line.get_marker() != "None"


def test_loading_shows_where_obstacles_go(run):
    """Shifts in one panel, angles in one of their own; without loads these alone, and without
    either there is no such figure.
    """
    moved = {"3": {"shift_x": [0.0, 2e-3, 5e-3], "angle": [0.0, 0.1, 0.2]},
             "4": {"distance": [1e-3, 0.0, 0.0]}}
    def own(**entries):
        return dataclasses.replace(run, summary={**run.summary, **entries})

    figure = figures.compose("loading", own(obstacle_motion=moved))
    assert [len(axes.lines) for axes in figure.axes] == [2, 2, 1]
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "amplitude [–]", "obstacle [mm]", "obstacle turned\nby [rad]"]
    assert legend_words(figure)[2:] == ["shift in $x$, label 3", "distance of the nearest node, "
                                        "label 4", "angle, label 3"]
    assert figure.axes[1].lines[0].get_ydata() == pytest.approx([0, 2, 5])
    assert not overlaps(figure) and not outside(figure)
    alone = figures.compose("loading", own(amplitudes={}, obstacle_motion={"3": moved["3"]}))
    assert len(alone.axes) == 2 and legend_words(alone) == ["shift in $x$", "angle"]
    assert "loading" not in figures.wanted(own(amplitudes={}))
    # one obstacle of two moves: which one is said
    one = own(amplitudes={}, obstacle_motion={"3": moved["3"]},
              boundaries=[{"boundary": "3"}, {"boundary": "4"}])
    assert legend_words(figures.compose("loading", one))[0] == "shift in $x$, label 3"


def test_history_may_start_at_step_one_and_have_empty_cells(tmp_path):
    directory = make_run(tmp_path, steps=3, products=6)
    first, _, *rows = (directory / "history.csv").read_text().splitlines()
    (directory / \
     "history.csv").write_text("\n".join([first + ",contraction", *(row + "," for row in rows),
                                                ""]))
    run = figures.read_run(directory)
    assert np.all(np.isnan(run.history["contraction"])) and run.history["step"][0] == 1
    assert len(figures.compose("history", run).axes[-1].patches) == 3


def test_a_history_without_iterations_shows_none(tmp_path):
    """Where Newton's method solves all steps: no empty panel, and no word about them."""
    directory = make_run(tmp_path, steps=3, products=6)
    drawn = figures.compose("history", figures.read_run(directory))
    head, *rows = (directory / "history.csv").read_text().splitlines()
    place = head.split(",").index("fixed_point_iterations")
    rows = [[cell if k != place else "0" for k, cell in enumerate(row.split(","))] for row in rows]
    (directory / "history.csv").write_text("\n".join([head, *map(",".join, rows), ""]))
    condensed = figures.compose("history", figures.read_run(directory))
    assert len(condensed.axes) == len(drawn.axes) - 1
    assert "iterations" in words(drawn) and "iterations" not in words(condensed)


def test_deformed_body_is_magnified_as_in_the_slides(run, drawn):
    figure = drawn["deformed"]
    assert "300×" in words(figure) and "[MPa]" in words(figure) and "$t = 1$" in words(figure)
    largest = run.last.xy + 300 * run.last.displacement
    shown = figure.axes[0].collections[-1]._triangulation
    assert np.allclose([shown.x.max(), shown.y.min()], [largest[:, 0].max(), largest[:, 1].min()])


@pytest.mark.parametrize("raw, chosen",
                         [(1.0, 1), (8.9, 10), (4.4, 5), (230.0, 200), (0.031, 1)])
def test_magnification_is_round(raw, chosen):
    assert scales.round_magnification(raw) == pytest.approx(chosen)
    assert scales.round_magnification(raw, 4.9) == pytest.approx(min(chosen, 3))


def test_other_scenes_choose_their_magnification(tmp_path):
    run = figures.read_run(make_run(tmp_path, scene="edp/hertz.edp", steps=1, products=6))
    largest = np.linalg.norm(run.last.displacement, axis=1).max()
    # neighbours among the round numbers differ by a factor 2 at most, so by sqrt(2) from the wish
    assert 0.08 / math.sqrt(2) <= body.magnification(run) * largest / 2 <= 0.08 * math.sqrt(2)
    assert "scene hertz" in words(figures.compose("deformed", run))


def test_normal_panels(run, drawn):
    figure = drawn["contact_normal"]
    above, below = figure.axes
    assert above.get_ylabel() == r"$\sigma_n$ [MPa]" and below.get_ylabel() == "$u_n$ [µm]"
    assert r"$\Gamma_c$ [m]" in below.get_xlabel()
    assert {"open", "stick", "slip", "gap"} <= set(legend_words(figure))
    stress = above.lines[0].get_ydata()
    assert stress.min() == pytest.approx(
        run.contact["sigma_n"][-21:].min() / 1e6) and stress.max() <= 0


def test_worn_surfaces_are_as_far_as_gap_and_worn_depth(run):
    """Which is what u_n is at most there."""
    worn = run.contact | {"wear": np.full(len(run.contact["gap"]), 1e-3)}
    figure = figures.compose("contact_normal", dataclasses.replace(run, contact=worn))
    assert "gap and worn depth" in legend_words(figure)
    (line,) = [line for line in figure.axes[1].lines if line.get_label() == "gap and worn depth"]
    np.testing.assert_allclose(line.get_ydata(), 1e6 * (run.contact["gap"][-21:] + 1e-3))


def test_tangential_panels(drawn):
    figure = drawn["contact_tangential"]
    above, below = figure.axes
    assert above.get_ylabel() == r"$\sigma_t$ [MPa]" and below.get_ylabel() == "$u_t$ [µm]"
    lower, upper, stress = (line.get_ydata() for line in above.lines[:3])
    assert np.all(lower <= stress + 1e-9) and np.all(stress <= upper + 1e-9)
    assert np.allclose(lower, -upper)


def test_zones_are_the_runs_of_equal_status(run, drawn):
    figure = drawn["contact_normal"]
    last = run.contact["status"][-21:]
    assert len(figure.axes[0].patches) == 1 + np.count_nonzero(last[1:] != last[:-1])
    edges = [p.get_xy()[:, 0] for p in figure.axes[0].patches]
    assert edges[0].min() == pytest.approx(1 / 21) and edges[-1].max() == pytest.approx(2)


def test_status_picture_has_a_cell_for_every_node_and_step(run, drawn):
    figure = drawn["contact_status"]
    (mesh,) = figure.axes[0].collections
    codes = mesh.get_array().reshape(20, 21)
    names = np.array(list(contact.STATUS))
    assert np.array_equal(names[codes.astype(int)].ravel(), run.contact["status"])
    assert figure.axes[0].get_ylim() == (0, 1)


def test_single_closed_nodes_are_seen(run):
    """The last of 21 nodes, whose cell is a hundredth of the arc, is no hairline in either step and
    not beyond the axes; one inside is wide enough.
    """
    table = {name: column[run.contact["step"] == 1] for name, column in run.contact.items()}
    nodes = np.arange(len(table["arc"]))
    table["status"] = np.select([nodes == nodes[-1], nodes == 7], ["stick", "slip"], "open")
    for name in ("length", "weight"):
        table[name] = np.where(nodes == nodes[-1], 0.005, table[name])
    table["arc"] = np.where(nodes == nodes[-1], table["arc"][-2] + 0.01, table["arc"])
    twice = {name: np.concatenate([column, column]) for name, column in table.items()}
    twice |= {"step": np.repeat([1, 2], len(nodes)), "time": np.repeat([0.5, 1.0], len(nodes))}
    figure = figures.compose("contact_status", dataclasses.replace(run, contact=twice))
    axes = figure.axes[0]
    _, drawn_wider = axes.collections
    cells = [path.get_extents() for path in drawn_wider.get_paths()]
    span, low, high = np.ptp(axes.get_xlim()), *axes.get_xlim()
    assert len(cells) == 2 and all(cell.width > 0.01 * span for cell in cells)
    assert all(low <= cell.x0 < cell.x1 <= high + 1e-9 for cell in cells)
    assert "narrow closed zones drawn wider" in words(figure)


def test_closed_nodes_without_friction_are_in_contact(tmp_path):
    run = figures.read_run(make_run(tmp_path, steps=2, friction="none", products=6))
    for name in ("contact_normal", "contact_status"):
        assert legend_words(figures.compose(name, run))[-2:] == ["open", "contact"]


@pytest.mark.slow
def test_not_converged_is_said_in_every_title(tmp_path):
    run = figures.read_run(make_run(tmp_path, steps=2, converged=False, products=6))
    for name in figures.wanted(run):
        assert figures.compose(name, run).texts[0].get_text().endswith("(not converged)")


def test_long_titles_have_several_lines(run):
    """What is said of doubts stays whole, and nothing leaves the page."""
    doubts = {"converged": False, "validity": {"verdict": "questionable"}}
    run = dataclasses.replace(run, summary=run.summary | doubts)

    def draw(figure):
        figure.add_subplot()
        layout.run_header(figure, run, r"Deformed bodies at $t = 0.5 s$, displacements to scale",
                          [], "boundaries 500 and 501 overlap: no contact is declared there; " * 3)

    figure = style.canvas(draw, 10)
    title, identity = (text.get_text().split("\n") for text in figure.texts)
    assert title == [r"Deformed bodies at $t = 0.5 s$, displacements to scale (not converged)",
                     "(questionable: see the warnings)"]
    assert len(identity) > 1
    assert not outside(figure) and not overlaps(figure)


@pytest.mark.slow
def test_thinned_convergence_keeps_starts_and_counts_everything(tmp_path):
    run = figures.read_run(make_run(tmp_path, steps=20, products=600))
    table = run.convergence
    thin, every = convergence.thin_out(table)
    assert len(table["kind"]) > 20000 and every > 1
    assert np.count_nonzero(thin["kind"] == "start") == np.count_nonzero(
        table["kind"] == "start") == 120
    assert len(thin["kind"]) <= convergence.POINTS + 120
    figure = figures.compose("convergence", run)
    total = sum(int(t.split("(")[1].rstrip(")").replace("\u2009", ""))
                for t in legend_words(figure))
    assert total == len(table["kind"]) and f"one iteration in {every} and" in words(figure)


def test_the_step_that_takes_most_products_is_named():
    """Behind ten steps that take none it had no number, and the first of them had one."""
    axes = Figure().add_subplot()
    begin = np.append(3.0 * np.arange(11), [7000.0])
    convergence.mark_steps(axes, {"step": np.append(np.arange(1, 12), [11]), "product": begin})
    [top] = axes.child_axes
    assert [text.get_text() for text in top.get_xticklabels()] == ["11"]
    convergence.mark_steps(axes, {"step": np.arange(1, 12), "product": 30.0 * np.arange(11)})
    numbers = [int(text.get_text()) for text in axes.child_axes[-1].get_xticklabels()]
    assert numbers == list(range(1, 12))  # of steps alike all that have room


def test_a_single_residual_has_an_axis(tmp_path):
    """Of its own decade and both beside it; Matplotlib would warn of one without extent."""
    run = figures.read_run(make_run(tmp_path))
    run.convergence = {name: column[1:2] for name, column in run.convergence.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        axes = figures.compose("convergence", run).axes[0]
    value = run.convergence["residual"][0]
    assert axes.get_ylim() == pytest.approx((0.1 * value, 10 * value))


def test_history_shows_forces_per_thickness_and_iterations(drawn, run):
    figure = drawn["history"]
    small = np.abs(run.history["resultant_t"]).max() < history.FAINT * np.abs(
        run.history["resultant_n"]).max()
    *forces, length, work, iterations = figure.axes
    assert len(forces) == 1 + small
    assert forces[0].get_ylabel() == "contact force\n[MN/m]"
    pressing = forces[0].lines[0].get_ydata()
    np.testing.assert_allclose(pressing, -1e-6 * run.history["resultant_n"])
    assert pressing.max() > 0
    assert length.get_ylabel() == "contact\nlength\n[m]"
    assert work.get_ylabel() == "dissipated\nenergy\n[kJ/m]"
    heights = [axes.get_position().height for axes in figure.axes]
    assert heights[0] > 3 * heights[-1]  # physics first
    assert [p.get_height() for p in iterations.patches] == [6] * 20
    assert "120 iterations of the fixed point" in words(figure)


def test_forces_of_several_boundaries_are_called_sums(run, drawn):
    assert legend_words(drawn["history"]) == ["normal resultant", "tangential resultant"]
    several = run.summary | {"boundaries": [{"boundary": 1}, {"boundary": 3}]}
    figure = figures.compose("history", dataclasses.replace(run, summary=several))
    assert legend_words(figure) == [f"{force}, sum over 2 boundaries" for force in (
        "normal resultant", "tangential resultant")]


@pytest.mark.slow  # two figures
def test_forces_of_unlike_size_have_panels_of_their_own(run):
    """A small tangential force is seen: its curve fills half of its panel or more."""
    table = {**run.history, "resultant_t": 0.01 * run.history["resultant_n"]}
    figure = figures.compose("history", dataclasses.replace(run, history=table))
    pressing, tangential = figure.axes[:2]
    assert np.ptp(tangential.lines[0].get_ydata()) > 0.5 * np.ptp(tangential.get_ylim())
    assert len(pressing.lines) == len(tangential.lines) == 2  # the curve, and zero
    table["resultant_t"] = 0.5 * run.history["resultant_n"]
    together = figures.compose("history", dataclasses.replace(run, history=table))
    assert len(together.axes) == len(figure.axes) - 1


@pytest.mark.parametrize("share", [1e-15, 2e-8])
def test_forces_and_work_that_are_rounding_are_zero(run, share):
    """A tangential force of 1e-15 of the other, or of what tolerances leave where it cancels by
    symmetry, and its work: no panel that looks like a signal.
    """
    noise = np.sin(7.0 * run.history["time"])
    peak = np.abs(run.history["resultant_n"]).max()
    table = {**run.history, "resultant_t": share * peak * noise, "dissipated": 1e-17 * peak * noise}
    pressing, _, work, _ = figures.compose("history", dataclasses.replace(run, history=table)).axes
    both = [line.get_ydata() for line in pressing.lines[:2]]
    assert np.abs(both[1]).max() < 1e-7 * np.abs(both[0]).max() and pressing.get_ylim()[1] > 1
    assert not work.lines[0].get_ydata().any() and "10^" not in work.get_ylabel()


def test_stresses_that_are_rounding_have_no_axis_of_their_own(run):
    """Nodes that meet nothing, in a body under stress: zero within 1e-9 of that."""
    table = {**run.contact, "sigma_n": -1e-17 * run.contact["arc"]}
    figure = figures.compose("contact_normal", dataclasses.replace(run, contact=table))
    low, high = figure.axes[0].get_ylim()
    values = figure.axes[0].lines[0].get_ydata()
    assert np.ptp(values) < 1e-9 * (high - low)


def test_curves_that_are_zero_have_whole_numbers_on_their_axis(run):
    """Not the rounding of what is drawn behind them."""
    columns = {name: 0 * run.contact[name] for name in ("sigma_n", "u_n", "gap")}
    resting = dataclasses.replace(run, contact={**run.contact, **columns}, last=None)
    figure = figures.compose("contact_normal", resting)
    assert all(axes.get_ylim() == (-1, 1) for axes in figure.axes[:2])


@pytest.mark.parametrize("high", [1.0, 0.08, 0.015])
def test_flat_bodies_are_as_wide_as_the_page(high):
    """Names of axes, which are higher than a flat body, do not make it narrow."""
    def draw(figure):
        axes = figure.add_subplot()
        axes.set_aspect("equal")
        axes.plot([0, 1, 1, 0, 0], [0, 0, high, high, 0])
        axes.set(xlabel="x [mm]", ylabel="y [mm]")
        style.header(figure, "a body", "scene test", [])
        layout.shrink_to_body(figure, axes)

    figure = style.canvas(draw, 30)
    place = figure.axes[0].get_position()
    assert place.width > 0.7  # beside numbers and the name of the axis
    assert place.height * figure.get_figheight() == pytest.approx(
        high * place.width * figure.get_figwidth(), rel=0.1)
    assert figure.get_figheight() < high * figure.get_figwidth() + 1.5  # inches


@pytest.mark.parametrize("unit, peak, label, shown", [
    ("Pa", 1.1e8, "MPa", 110), ("Pa", 1e3, "kPa", 1), ("MPa", 2e3, "GPa", 2),
    ("m", 3e-4, "µm", 300),
    ("mm", 120.0, "mm", 120), ("mm", 3e-3, "µm", 3), ("N/m", 2e6, "MN/m", 2),
    ("1", 0.5, "–", 0.5),
    ("psi", 3e5, r"$10^{3}$ psi", 300), ("Pa", 0.0, "Pa", 0), ("MPa", 0.9999, "MPa", 0.9999)])
def test_scales(unit, peak, label, shown):
    scale = scales.scale_for(unit, [peak, -peak / 2])
    assert scale.label == label and scale.factor * peak == pytest.approx(shown)


def test_resultants_of_mixed_units_are_forces_per_length(tmp_path):
    run = figures.read_run(make_run(tmp_path, steps=2, units=("mm", "MPa"), products=6))
    assert scales.force_scale(run, [5.0]) == (pytest.approx(1.0), "N/mm")  # MPa mm = N/mm
    run.summary["units"] = {"length": "1", "stress": "1"}
    assert scales.force_scale(run, [5.0]) == (1.0, "–")


def test_force_over_displacement_of_probes_that_feel_a_force(tmp_path):
    """Along x, where the label moves between steps, not along y, where it is only pressed in; a
    point without force has no curve.
    """
    directory = make_run(tmp_path, steps=4, units=("mm", "MPa"), products=6)
    t = np.arange(1, 5) / 4
    rows = [[k + 1, time, probe, 0, 0, u, -0.5, f, f / 2]
            for k, time in enumerate(t)
            for probe, u, f in (("point1", 0.1 * time, 0.0),
                                ("label3", 0.01 * np.sin(9 * time), 20 * np.cos(9 * time)))]
    write_table(directory / "probes.csv", "step,time,probe,x,y,u_x,u_y,force_x,force_y", rows)
    run = figures.read_run(directory)
    assert "force_displacement" in figures.wanted(run)
    figure = figures.compose("force_displacement", run)
    assert legend_words(figure) == ["label 3, $x$"]
    curve = figure.axes[0].lines[0]
    assert curve.get_xdata() == pytest.approx(10 * np.sin(9 * t))  # micrometres
    assert curve.get_ydata() == pytest.approx(20 * np.cos(9 * t))
    assert figure.axes[0].get_ylabel() == "force on the body [N/mm]"
    assert overlaps(figure) == [] and outside(figure) == []


# ------------------------------------------------------------- geometry and deformation, in detail

def moved_run(tmp_path, changes: dict, **summary):
    """A made-up run whose columns of boundary.csv at label 4 are changed."""
    directory = make_run(tmp_path / "run", steps=2, products=6, scene="own")
    names, *rows = csv.reader((directory / "boundary.csv").read_text().splitlines())
    for row in rows:
        if row[names.index("label")] == "4":
            for name, value in changes.items():
                row[names.index(name)] = value
    write_table(directory / "boundary.csv", ",".join(names), rows)
    text = json.loads((directory / "summary.json").read_text())
    (directory / "summary.json").write_text(json.dumps(text | summary))
    return figures.read_run(directory)


@pytest.mark.parametrize("changes, words_of_legend", [
    ({}, r"$\Gamma_u$ support"), ({"fixed_y": 0}, r"$\Gamma_u$ roller"),
    ({"moved_x": 1e-3}, r"$\Gamma_u$ moved"),
    ({"fixed_x": 0, "moved_y": -1e-3}, r"$\Gamma_u$ moved in one direction")])
@pytest.mark.some(2)
def test_supports_rollers_and_moved_supports_look_different(tmp_path, changes, words_of_legend):
    figure = figures.compose("geometry", moved_run(tmp_path, changes))
    assert words_of_legend in legend_words(figure)
    assert ("moved by up to 1 mm" in words(figure)) == any("moved" in name for name in changes)
    # each in its own colour alone: of another beneath it the ends would be seen
    drawn_blue = [lines for lines in figure.axes[0].collections
                  if isinstance(lines, LineCollection) and len(lines.get_segments())
                  and to_hex(lines.get_colors()[0]) == to_hex(style.BLUE)
                  and lines.get_zorder() < 2.7]
    assert bool(drawn_blue) != any("moved" in name for name in changes)


def test_gaps_that_are_not_magnified_are_told_of(tmp_path):
    """Bodies that close them run into the obstacle in the picture, and nothing is wrong with them.
    """
    run = figures.read_run(make_run(tmp_path / "run", steps=2, products=6))
    mesh, touching = run.last, run.contact["status"] != "open"
    for closed, said in ((touching, True), (~touching, False)):
        run.contact["gap"] = np.where(closed, 1e-3, 0.0)
        # pylint: disable-next=protected-access
        assert bool(body._not_magnified(run, mesh, 300.0)) == said
    run.contact["gap"] = np.where(touching, 1e-3, 0.0)
    for times in (1.0, 3.0):
        assert body._not_magnified(run, mesh, times) == ""  # pylint: disable=protected-access
    assert "gaps not magnified" in words(figures.compose("deformed", run))


def test_a_support_that_turns_has_an_arrow_at_every_place(tmp_path):
    """The mean of its ways is rounding: one arrow in its direction would say that it shifts."""
    run = moved_run(tmp_path, {"moved_x": 1e-3})
    own, edges = run.boundary["label"] == 4, run.boundary
    run.boundary["moved_x"][own] = -1e-3 * ((edges["y0"] + edges["y1"])[own] / 2 - 0.5)
    violet = [c for c in figures.compose("geometry", run).axes[0].collections
              if isinstance(c, Quiver) and c.get_facecolor()[0, 2] > c.get_facecolor()[0, 1]]
    [arrows] = violet
    assert len(arrows.U) > 1 and np.isclose(arrows.U.sum(), 0, atol=1e-9)  # about its middle
    assert (np.sign(arrows.U) == np.sign(0.5 - arrows.Y)).all()


@pytest.mark.parametrize("role, words, zigzags", [
    ("springs", "elastic foundation", 1), ("joined", "tied or periodic", 0)])
def test_foundations_and_joined_boundaries_are_no_free_ones(tmp_path, role, words, zigzags):
    """Springs stand outside of the left side, x = 0, beside each other."""
    run = moved_run(tmp_path, {"role": role, "fixed_x": "0", "fixed_y": "0"})
    figure = figures.compose("geometry", run)
    assert words in legend_words(figure)
    found = [lines for lines in figure.axes[0].collections if isinstance(lines, LineCollection)
             and any(len(line) == 8 for line in lines.get_segments())]
    assert len(found) == zigzags
    for line in (line for lines in found for line in lines.get_segments()):
        assert line[0, 0] == pytest.approx(0.0, abs=1e-9) and (np.diff(line[:, 0]) < 0).all()


def test_labels_loads_and_weight_are_on_the_picture(tmp_path):
    run = moved_run(tmp_path, {"traction_x": 2e7, "traction_y": 0},
                    loads=[{"effect": "body_force", "number": 2, "force": [0.0, -5.0],
                            "bodies": [[0.0, -5.0]]}])
    figure = figures.compose("geometry", run)
    assert {text.get_text() for text in figure.axes[0].texts} == {"1", "2", "3", "4"}
    assert "body force" in legend_words(figure)
    arrows = [c for c in figure.axes[0].collections if hasattr(c, "U")]
    assert len(arrows) == 4  # top, right side, the supported left side, weight
    down = arrows[-1]
    assert np.all(down.U == 0) and np.all(down.V < 0)


def test_loads_and_springs_at_points_are_on_the_picture(tmp_path):
    """A load that pushes ends at its point, one that pulls begins there; springs lead outside."""
    given = [("point_load", [1.0, 1.0], [0.0, -5.0]), ("point_load", [2.0, 0.5], [2.5, 0.0]),
             ("springs", [0.0, 1.0], [3.0, 4.0])]
    points = [{"effect": effect, "number": 1, "place": place, "value": value}
              for effect, place, value in given]
    figure = figures.compose("geometry", moved_run(tmp_path, {}, points=points))
    assert {"point load", "spring"} <= set(legend_words(figure))
    drawn_at = [(c.X + c.U * (c.V < 0), c.Y + c.V * (c.V < 0)) for c in figure.axes[0].collections
                if isinstance(c, Quiver) and len(c.U) == 2]
    assert any(np.allclose(place, [[1.0, 2.0], [1.0, 0.5]]) for place in drawn_at)
    spring = next(c.get_segments() for c in figure.axes[0].collections
                  if isinstance(c, LineCollection) and len(c.get_segments()) == 2
                  and len(c.get_segments()[0]) == 8)
    assert [line[-1].round(6).tolist() for line in spring] == [[-0.1, 1.0], [0.0, 1.1]]


def pierced(run, mesh, middle: list[float], half: list[float]) -> None:
    """Takes a rectangle out of a mesh of a run, the edges of which its outline has."""
    off = np.abs(mesh.xy[mesh.triangles].mean(axis=1) - middle)
    before = {tuple(map(tuple, edge)) for edge in mesh.xy[mesh.rim()[0]].tolist()}
    for name in ("triangles", "body", "region"):
        setattr(mesh, name, getattr(mesh, name)[(off > half).any(axis=1)])
    rim = np.array([edge for edge in mesh.xy[mesh.rim()[0]].tolist()
                    if tuple(map(tuple, edge)) not in before])
    hole = {name: np.repeat(column[:1], len(rim)) for name, column in run.boundary.items()}
    hole |= {f"{axis}{end}": rim[:, end, k] for k, axis in enumerate("xy") for end in (0, 1)}
    run.boundary.update({name: np.append(column, hole[name])
                         for name, column in run.boundary.items()})


def test_the_arrow_of_a_body_force_does_not_stand_in_a_hole(tmp_path):
    """A block of 4x2 subdomains with a hole: the arrow is in what is left, farthest from all sides,
    not from where the body is cut.
    """
    run = figures.read_run(make_run(tmp_path, steps=1, products=6))
    run.summary["loads"] = [{"effect": "body_force", "bodies": [[0.0, -1.0]]}]

    def arrow() -> np.ndarray:
        axes = figures.compose("geometry", run).axes[0]
        own, = (part for part in axes.collections
                if hasattr(part, "U") and np.allclose(part.get_facecolor()[0, :3], 0x77 / 255))
        return np.array([own.X[0] + own.U[0] / 2, own.Y[0] + own.V[0] / 2])

    assert arrow() == pytest.approx([1.0, 0.5])
    pierced(run, run.first, [0.8, 0.5], [0.5, 0.25])
    assert (np.abs(arrow() - [1.65, 0.5]) <= [0.06, 0.16]).all()


@pytest.mark.parametrize("modulus, expected", [
    (lambda x, y: np.where(y < 0.4, 2.0, 80.0), ["$G$ = 2 Pa", "$G$ = 80 Pa"]),
    # a few triangles across the interface have means of both
    (lambda x, y: np.where(y < 0.4, 2.0, np.where(x < 0.02, 50 + y, 80.0)),
     ["$G$ = 2 Pa", "$G$ = 80 Pa"]),
    (lambda x, y: 10 ** (2 * x), ["ranges"]), (None, [])])
@pytest.mark.some(1)
def test_materials_that_no_region_names_have_colours(run, modulus, expected):
    """By the stiffness of the triangles: its values where they are few, ranges where it varies."""
    mesh = run.first
    middle = mesh.xy[mesh.triangles].mean(axis=1).T
    shear = None if modulus is None else modulus(*middle)
    own = dataclasses.replace(run, first=dataclasses.replace(mesh, shear_modulus=shear))
    figure = figures.compose("geometry", own)
    materials = [text for text in legend_words(figure) if text.startswith("$G$")]
    if expected == ["ranges"]:
        assert len(materials) > 3 and all(" to " in text for text in materials)
    else:
        assert materials == expected
    if len(expected) == 2:
        tint = next(values for c in figure.axes[0].collections
                    if (values := c.get_array()) is not None)
        np.testing.assert_array_equal(tint[middle[1] < 0.4], 0)
        assert (tint[(middle[1] > 0.4) & (middle[0] > 0.02)] == 1).all()


def test_materials_have_the_names_that_the_scene_gives_them(run):
    """Of three bodies two are alike: a tint for each material, whatever the regions are."""
    names = ["steel", "rubber", "steel"]
    rows = [{"body": k + 1, "name": name, "young": 210e9 if name == "steel" else 5e6,
             "poisson": 0.3} for k, name in enumerate(names)]
    mesh = dataclasses.replace(run.first, body=np.arange(len(run.first.triangles)) % 3)
    one = dataclasses.replace(run, first=mesh, summary=run.summary | {"materials": rows})
    kind, said = geometry._materials(one)  # pylint: disable=protected-access
    assert said == ["steel, $E$ = 210 GPa", "rubber, $E$ = 5 MPa"]
    assert kind[:3].tolist() == [0, 1, 0]
    assert legend_words(figures.compose("geometry", one))[:2] == said


def test_more_names_than_tints_stand_together_by_material(run):
    """Of seven bodies six are alike but for their names: all seven are in the legend."""
    rows = [{"body": k + 1, "name": f"pipe {k}" if k < 6 else "trough", "poisson": 0.3,
             "young": 1e8 if k < 6 else 1e9} for k in range(7)]
    mesh = dataclasses.replace(run.first, body=np.arange(len(run.first.triangles)) % 7)
    one = dataclasses.replace(run, first=mesh, summary=run.summary | {"materials": rows})
    said = ["pipe 0 and 5 more, $E$ = 100 MPa", "trough, $E$ = 1 GPa"]
    assert legend_words(figures.compose("geometry", one))[:2] == said


def test_names_with_dollars_are_no_formulas(run):
    """Two of them in a material, one in the scene: the first were none, the second the titles'."""
    rows = [{"body": 1, "name": "5$ ^_$ alloy", "young": 1e9, "poisson": 0.3}]
    changed = {"scene": "low$cost.edp", "materials": rows}
    one = dataclasses.replace(run, summary=run.summary | changed)
    assert r"scene low\$cost" in words(figures.compose("geometry", one))
    figure = figures.compose("deformed", one)
    assert figure.axes[0].texts[0].get_text() == r"5\$ ^_\$ alloy"
    assert r"5\$ ^_\$ alloy, $E$ = 1 GPa" in legend_words(figures.compose("geometry", one))


def test_names_of_materials_do_not_stand_on_each_other(run):
    """Of slender bodies side by side, whose names are wider than they are."""
    xy = run.last.xy[run.last.triangles].mean(axis=1)
    number = np.floor(xy[:, 0] / 0.25).astype(int)
    rows = [{"body": k + 1, "name": "cortical bone", "young": 17e9, "poisson": 0.3}
            for k in range(8)]
    one = dataclasses.replace(run, last=dataclasses.replace(run.last, body=number),
                              summary=run.summary | {"materials": rows})
    figure = figures.compose("deformed", one)
    names = [text.get_window_extent() for text in figure.axes[0].texts]
    assert len(names) == 8
    assert not any(a.overlaps(b) for k, a in enumerate(names) for b in names[:k])


def test_the_name_of_a_body_around_another_stands_on_it(run):
    """The middle of a ring is not in it; beside its hole half of the name would be on the core."""
    xy = run.last.xy[run.last.triangles].mean(axis=1)
    core = (np.abs(xy - [1.0, 0.5]) < [0.5, 0.3]).all(axis=1)
    rows = [{"body": k + 1, "name": name, "young": 1e9, "poisson": 0.3}
            for k, name in enumerate(["ring", "core"])]
    one = dataclasses.replace(run, last=dataclasses.replace(run.last, body=core.astype(int)),
                              summary=run.summary | {"materials": rows})
    axes = figures.compose("deformed", one).axes[0]
    names = {text.get_text(): text.get_window_extent() for text in axes.texts}
    around = axes.transData.transform([[0.5, 0.2], [1.5, 0.8]])
    assert not names["ring"].overlaps(Bbox(around)) and names["core"].overlaps(Bbox(around))


@pytest.mark.parametrize("way, end", [(0.0, 2.0), (1.0, 3.0), (50.0, 5.0)])
def test_the_picture_goes_as_far_as_the_body_does(run, way, end):
    """What touches does so `way` farther on along the floor; no more than 1.5 of the size."""
    table = run.contact | {"u_t": 0 * run.contact["u_t"] + way, "u_n": 0 * run.contact["u_n"]}
    box = np.array([[0.0, 0.0], [2.0, 1.0]])
    far = dataclasses.replace(run, contact=table, obstacle={})
    last = run.contact["x"][run.contact["status"] != "open"].max()
    found = obstacle.where_it_goes(far, box)
    assert found.tolist() == [[0.0, 0.0], [pytest.approx(max(2.0, min(last + way, end))), 1.0]]
    assert obstacle.where_it_goes(dataclasses.replace(far, obstacle=None), box) is box


@pytest.mark.parametrize("shift, angle", [((-12.0, 0.0), 0.0), ((1.0, -3.0), 2.0)])
def test_a_bump_that_comes_from_afar_is_in_the_picture_of_the_start(run, shift, angle):
    """What the body touches in the last step, where it was before it shifted and turned."""
    bump = np.array([[1.9, 0.0], [2.0, 0.1], [2.2, 0.0], [3.0, 0.0]])
    turn = np.exp(1j * angle)
    before = ((bump @ [1, 1j]) - (shift @ np.array([1, 1j]))) / turn
    steps = run.contact["step"]
    table = {"step": np.repeat([0.0, steps.max()], 4),
             "x0": np.concatenate([before.real, bump[:, 0]]),
             "y0": np.concatenate([before.imag, bump[:, 1]])}
    rows = {name: values[steps == steps.max()][:1] for name, values in run.contact.items()}
    rows |= {"x": bump[1:2, 0], "y": bump[1:2, 1], "u_n": np.zeros(1), "u_t": np.zeros(1),
             "status": np.array(["stick"])}
    box = np.array([[0.0, 0.0], [20.0, 10.0]])
    found = obstacle.where_it_goes(dataclasses.replace(run, contact=rows, obstacle=table), box)
    place = np.array([before[1].real, before[1].imag])
    np.testing.assert_allclose(found, [np.minimum(box[0], place), np.maximum(box[1], place)],
                               atol=1e-12)


def test_obstacles_whose_pieces_are_as_far_apart_as_they_are_long_stay_apart():
    """Arcs begin anew at the second piece: its distance of 2 is the arc of the first."""
    rows = {"arc": np.array([0.0, 1, 2, 0, 1]), "x": np.array([0.0, 1, 2, 0, 0]),
            "y": np.array([0.0, 0, 0, 0, 1]), "node": np.arange(5)}
    assert [len(piece) for piece in obstacle.pieces(rows)] == [3, 2]


def test_arrows_along_a_boundary_do_not_stand_on_each_other(tmp_path):
    run = moved_run(tmp_path, {"traction_y": -1e8})
    arrows = [c for c in figures.compose("geometry", run).axes[0].collections if hasattr(c, "U")]
    shear = next(c for c in arrows if np.all(np.abs(c.U) < 1e-9) and np.all(c.X < 0))
    ends = np.sort(np.stack([shear.Y, shear.Y + shear.V]), axis=0)
    order = np.argsort(ends[0])
    assert np.all(ends[0][order][1:] > ends[1][order][:-1])


@pytest.mark.parametrize("high, led", [(0.15, {5}), (4.0, set())], ids=["thin", "thick"])
def test_numbers_of_labels_stand_beside_their_boundary(high, led):
    """A bar of length 9 under a wheel, label 5 on a short part of its top with an arrow above it:
    of a thick one all numbers are inside, of a thin one outside, that of the wheel on a line.
    """
    x = np.linspace(-4.5, 4.5, 91)
    corners = np.concatenate([
        np.column_stack([x, 0 * x]), [[4.5, high]], np.column_stack([x[-2::-1], 0 * x[1:] + high])])
    start, end = corners, np.roll(corners, -1, axis=0)
    middle = (start + end) / 2
    label = np.select([middle[:, 1] == 0, middle[:, 0] == 4.5, middle[:, 0] == -4.5,
                       np.abs(middle[:, 0]) < 0.06], [1, 2, 4, 5], 3)
    axes = Figure().add_subplot()
    axes.quiver([0], [high + 1.5], [0], [-1.4], angles="xy", scale_units="xy", scale=1)
    roles = np.where(label == 5, "load", "free")
    labels.label_numbers(axes, {"label": label, "role": roles},
                         (start, end, outline.right_of(start, end)), 9.0,
                         {"load": "red", "free": "black"})
    places = {int(text.get_text()): np.array(text.get_position()) for text in axes.texts}
    assert len(places) == 5 and len(axes.lines) == len(led)
    for name, place in places.items():
        away = labels.distances(place, start, end)
        assert name in led or away.min() == away[label == name].min() > 0.2
        assert (0 < place[1] < high and abs(place[0]) < 4.5) == (high == 4.0)
        assert labels.distances(place, *np.array([[[0, high + 1.5]], [[0, high + 0.1]]])) > 0.2
        assert all(np.linalg.norm(place - other) > 0.4 for k, other in places.items() if k != name)


@pytest.mark.parametrize("right", [7, 101, 10070])
def test_numbers_of_many_digits_stand_beside_their_boundary_too(right):
    """A square that fills the picture: beside its upright side a number is half as wide away."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    figure = Figure(figsize=(6.6, 6.6))
    axes = figure.add_axes([0.0, 0.0, 1.0, 1.0], xlim=(-0.5, 1.5), ylim=(-0.5, 1.5))
    end = np.roll(corners, -1, axis=0)
    labels.label_numbers(axes, {"label": np.array([1, right, 3, 4]), "role": np.full(4, "free")},
                         (corners, end, outline.right_of(corners, end)), 1.0, {"free": "black"})
    text = next(text for text in axes.texts if text.get_text() == str(right))
    reach = text.get_window_extent(FigureCanvasAgg(figure).get_renderer()).transformed(
        axes.transData.inverted())
    assert reach.x1 < 1.0 or reach.x0 > 1.0


def test_the_number_of_a_thin_layer_is_not_in_the_body_above():
    """A layer, its top label 3, from 0 to 20, under a block from 4 to 12."""
    layer = [(0, 0), (20, 0), (20, 0.6), (0, 0.6)]
    block = [(4, 0.6), (12, 0.6), (12, 5), (4, 5)]
    start = np.array(layer + block, float)
    end = np.concatenate([np.roll(layer, -1, axis=0), np.roll(block, -1, axis=0)])
    axes = Figure().add_subplot()
    labels.label_numbers(axes, {"label": np.arange(1, 9), "role": np.full(8, "free")},
                         (start, end, outline.right_of(start, end)), 20.0, {"free": "black"})
    x, y = {text.get_text(): text.get_position() for text in axes.texts}["3"]
    assert y > 0.6 and not 4 <= x <= 12


def test_numbers_of_a_thin_bar_are_not_on_the_marks_of_its_obstacle():
    """Label 4 below a bar from 0 to 20, which has no room inside, and the obstacle under it."""
    start = np.array([(0, 0), (20, 0), (20, 0.6), (0, 0.6)], float)
    end = np.roll(start, -1, axis=0)
    axes = Figure().add_subplot()
    ground = np.array([[[0.0, -0.5], [20.0, -0.5]]])
    obstacle.hatch(axes, ground[:, 0], ground[:, 1], np.array([[0.0, -1.0]]), 20.0, "black")
    labels.label_numbers(axes, {"label": np.array([4, 5, 6, 7]), "role": np.array(
        ["contact", "free", "free", "free"])}, (start, end, outline.right_of(start, end)), 20.0,
        {"free": "black", "contact": "green"})
    place = next(np.array(text.get_position()) for text in axes.texts if text.get_text() == "4")
    marks = np.array(axes.collections[0].get_segments())
    assert labels.distances(place, marks[:, 0], marks[:, 1]).min() > 0.3


def test_magnification_respects_gaps_and_large_displacements(tmp_path):
    """Closed nodes on a gap of 1 mm under a body of 2 m: (s - 1) 1 mm stay below a hundredth of
    the size; displacements of a tenth of the size are to scale.
    """
    run = figures.read_run(make_run(tmp_path, steps=2, scene="own", products=6))
    free = body.magnification(run)
    assert free > 21
    closed = run.contact["status"] != "open"
    run.contact["gap"] = np.where(closed, 1e-3, 1.0)
    run.contact["u_n"] = np.where(closed, 1e-3, 0.0)
    assert body.magnification(run) == 20
    for name in ("gap", "u_n"):  # a press fit would seem to part
        run.contact[name] = np.where(closed, -1e-3, run.contact[name])
    assert body.magnification(run) == 20
    run.last.displacement *= 0.2 / np.linalg.norm(run.last.displacement, axis=1).max()
    assert body.magnification(run) == 1
    assert "displacements to scale" in words(figures.compose("deformed", run))


def test_a_slender_body_is_magnified_until_it_bends_visibly(tmp_path):
    """Bent like a beam 2 x 0.02 its deflection is shown with 8 % of its length, though that is many
    times its height; squeezed as much it would turn inside out, and a strain of 1/4 is shown.
    """
    run = figures.read_run(make_run(tmp_path, steps=1, scene="own", products=6, contact="none"))
    mesh = run.last
    mesh.xy = mesh.xy * [1.0, 0.02]
    x, y = mesh.xy.T
    mesh.displacement = 1e-6 * np.column_stack([-2 * x * y, x**2])
    largest = np.linalg.norm(mesh.displacement, axis=1).max()
    assert 0.08 / math.sqrt(2) <= body.magnification(run) * largest / 2 <= 0.08 * math.sqrt(2)
    mesh.displacement = np.column_stack([0 * x, -1e-4 * y])
    assert body._strain(mesh) == pytest.approx(1e-4)
    assert 0.25 / math.sqrt(2) <= body.magnification(run) * 1e-4 <= 0.25 * math.sqrt(2)


def test_a_small_round_obstacle_has_small_marks():
    """As those of a body four times its size; those of a large or a flat one follow the body."""
    ends = circle(1, np.linspace(0, 2 * np.pi, 33))
    assert obstacle.marks_size(ends[:-1], ends[1:], 100.0) == pytest.approx(8.0)
    assert obstacle.marks_size(ends[:-1], ends[1:], 2.0) == 2.0
    assert obstacle.marks_size(np.zeros((1, 2)), np.array([[1.0, 0.5]]), 100.0) == 100.0


def two_bars(gap: float):
    """A bar 10 x 1 below another one, whose right ends move by 1e-3 towards each other.
    """
    xy, triangles, _ = torn_block((1, 1), 20)
    x, y = (xy * [5.0, 1.0]).T
    both = np.concatenate([np.column_stack([x, y]), np.column_stack([x, y + 1 + gap])])
    way = 1e-5 * np.concatenate([x**2, -x**2])
    mesh = reading.Mesh(1.0, both, np.concatenate([triangles, triangles + len(xy)]),
                        np.column_stack([0 * way, way]), 0 * way, None, None, None, 1)
    rim = mesh.xy[mesh.rim()[0]].reshape(-1, 4)
    boundary = dict(zip(("x0", "y0", "x1", "y1"), rim.T)) | {"role": np.full(len(rim), "free")}
    return SimpleNamespace(boundary=boundary, contact=None, obstacle=None, last=mesh, scene="own",
                           summary={"effects": {}})


@pytest.mark.parametrize("gap, times", [(0.4, 200), (3.0, 1000)])
def test_bodies_that_stay_apart_are_not_drawn_through_each_other(gap, times):
    """No contact is declared: 200 times 1e-3 from both sides are the gap of 0.4."""
    assert body.magnification(two_bars(gap)) == times


def test_a_body_that_slides_in_a_valley_is_not_drawn_into_its_side(tmp_path):
    """The obstacle y = 0.2 (x - 1)^2 under a body of its shape, whose nodes move along the tangents
    there by 1e-3: 100 times that leaves the surface by 0.2 * 0.1^2, a thousandth of the size.
    """
    run = figures.read_run(make_run(tmp_path, steps=1, scene="own", products=6))
    rows, mesh, b = run.contact, run.last, run.boundary
    for x, y in ((rows["x"], rows["y"]), (b["x0"], b["y0"]), (b["x1"], b["y1"]), mesh.xy.T):
        y += 0.2 * (x - 1) ** 2
    slope = 0.4 * (rows["x"] - 1)
    rows["normal_x"], rows["normal_y"] = np.array([slope, 0 * slope - 1]) / np.hypot(1, slope)
    rows.update(gap=0 * slope, u_n=0 * slope, u_t=0 * slope + 1e-3)
    mesh.displacement = 1e-3 * np.column_stack([1 + 0 * mesh.xy[:, 0], 0.4 * (mesh.xy[:, 0] - 1)])
    assert crossing.without_crossing(run, mesh, 300.0, 2.0, 0.0) == 100
    mesh.displacement[:] = [0.0, 1e-3]
    assert crossing.without_crossing(run, mesh, 300.0, 2.0, 0.0) == 300


def round_run(x: float) -> SimpleNamespace:
    """A run whose body meets a circle of radius 1 about (x, 0) that contact follows."""
    ends = circle(1, np.linspace(0, -2 * np.pi, 65)) + [x, 0.0]
    table = dict(zip(("x0", "y0", "x1", "y1"), [*ends[:-1].T, *ends[1:].T]))
    return SimpleNamespace(obstacle={"step": np.zeros(64), **table},
                           history={"step": np.array([1]), "time": np.array([1.0])})


@pytest.mark.parametrize("size, sides", [(10.0, 64), (1.5, 26)], ids=["small", "large"])
def test_a_small_obstacle_is_drawn_whole_with_marks_apart(size, sides):
    """A body up to x = 10 before a circle from 9.5 to 11.5: what is beyond the picture of a small
    one is drawn as well. Drawn a little apart its sides still meet, and so marks are even.
    """
    axes = Figure().add_subplot()
    obstacle.draw_obstacles(axes, round_run(10.5), 0.0, size, 1.0,
                            np.array([[10 - size, -1.0], [10.0, 1.0]]), 0.016 * size)
    lines, marks = (np.array(part.get_segments()) for part in axes.collections)
    assert len(lines) == sides
    np.testing.assert_allclose(np.linalg.norm(lines - [10.5, 0.0], axis=2), 1 - 0.016 * size,
                               atol=3e-3)
    np.testing.assert_allclose(lines[1:, 0], lines[:-1, 1], atol=1e-12)
    between = np.linalg.norm(np.diff(marks[:, 0], axis=0), axis=1)
    assert between.min() > 0.6 * np.linalg.norm(np.diff(marks, axis=1), axis=2).max()


def test_an_obstacle_with_no_vertex_in_the_picture_is_drawn_on_its_curve():
    """A picture of a hundredth of the circle's radius in the middle of one of its 64 sides, of the
    angle h. Cubics through their ends, along the circle's tangents there and as long as the sides,
    are off the circle by h^4 / 192, sides by h^2 / 8.
    """
    h = 2 * np.pi / 64
    middle = circle(1, np.array([h / 2]))[0] + [10.5, 0.0]
    axes = Figure().add_subplot()
    obstacle.draw_obstacles(axes, round_run(10.5), 0.0, 0.01, 1.0,
                            middle + 0.005 * np.array([[-1.0], [1.0]]))
    lines = np.array(axes.collections[0].get_segments())
    assert np.linalg.norm(lines - middle, axis=2).min() < 0.005
    assert np.abs(np.linalg.norm(lines - [10.5, 0.0], axis=2) - 1).max() < h**4 / 100
    # nor is the rest of this side, ten times as long as the picture
    assert np.abs(lines - middle).max() < 0.005 + 0.01 * (obstacle.NEAR + obstacle.FINE)


def test_a_corner_of_an_obstacle_stays_one():
    """A square about the picture: its sides are cut, and stay straight."""
    ends = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    start, end = outline.smoothed(ends[:-1], ends[1:], np.arange(4), 0.1, obstacle.CORNER)
    assert len(start) == 40
    np.testing.assert_allclose(np.abs(start - 0.5).max(axis=1), 0.5, atol=1e-15)
    np.testing.assert_allclose(np.roll(start, -1, axis=0), end, atol=1e-15)


def test_a_run_without_iterations_has_no_picture_of_them(tmp_path):
    """Without multipliers one solution is all: an empty diagram would say nothing."""
    run = figures.read_run(make_run(tmp_path, steps=1, products=6))
    assert "convergence" in figures.wanted(run)
    iterations = run.convergence
    run.convergence = {**iterations, "residual": 0 * iterations["residual"]}
    assert "convergence" not in figures.wanted(run)
    run.convergence = {**iterations, "kind": np.full(len(iterations["kind"]), "start")}
    assert "convergence" not in figures.wanted(run)


@pytest.mark.slow
def test_a_small_contact_has_a_picture_to_scale(tmp_path):
    run = figures.read_run(make_run(tmp_path, steps=2, scene="own", products=6))
    assert body.contact_window(run) is None
    far = np.abs(run.contact["arc"] - 1.0) > 0.1
    run.contact["status"] = np.where(far, "open", run.contact["status"])
    middle, width = body.contact_window(run)
    assert 0.2 < width < 1 and middle == pytest.approx([1.0, 0.0], abs=0.1)
    figure = figures.compose("contact_zoom", run)
    assert np.ptp(figure.axes[0].get_xlim()) == pytest.approx(width, rel=1e-6)
    assert overlaps(figure) == [] and outside(figure) == []
    run.last.displacement[np.abs(run.last.xy - middle).max(axis=1) < 0.1] += 3.0  # it slides far
    axes = figures.compose("contact_zoom", run).axes[0]
    shown = np.mean([axes.get_xlim(), axes.get_ylim()], axis=1)
    np.testing.assert_allclose(shown, middle + 3.0, atol=1e-6)


def test_a_contact_node_is_a_vertex_of_the_body_that_its_normal_leaves():
    """Two triangles, one above the other, with two vertices in the same places."""
    below, above = [[0.0, 0.0], [1.0, 0.0], [0.5, -1.0]], [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]]
    for first, second in ((below, above), (above, below)):
        mesh = SimpleNamespace(xy=np.array(first + second), triangles=np.array([[0, 1, 2],
                                                                               [3, 4, 5]]))
        rows = {"x": np.array([0.0, 1.0]), "y": np.zeros(2), "normal_x": np.zeros(2),
                "normal_y": -np.ones(2)}
        assert body.vertices_of(mesh, rows).tolist() == ([3, 4] if first is below else [0, 1])


def test_hertz_has_its_ellipse(tmp_path):
    """Its force is that of the nodes: 2 P / (pi a) is the peak of an ellipse with P and a."""
    arc = np.linspace(0, 2, 401)
    true = -np.sqrt(np.maximum(0, 1 - ((arc - 1) / 0.5) ** 2))
    rows = {"arc": arc, "weight": np.full(401, 0.005), "sigma_n": true,
            "status": np.where(true < 0, "slip", "open")}
    assert theory.hertz(rows) == pytest.approx(true, abs=0.05)  # half an edge at either end
    assert (theory.hertz(rows) @ rows["weight"]) == pytest.approx(true @ rows["weight"], rel=1e-2)
    run = figures.read_run(make_run(tmp_path, steps=2, scene="edp/hertz.edp", products=6))
    assert "Hertz, same force and length" in legend_words(figures.compose("contact_normal", run))


@pytest.mark.parametrize("crest", [0.0, 0.3, 0.5])
def test_waves_have_the_pressure_of_westergaard(crest):
    """From nodes 1/1000 of a wave apart the same, but for the root at the edge: there the spread
    errs by some (1/1000)^1.5. Wherever the crest is, for a wave length of 3.
    """
    arc, half, mean = np.linspace(0, 3, 1001), 0.2, 7.0
    s = np.pi * (arc / 3 - crest)
    room = np.maximum(0.0, np.sin(np.pi * half) ** 2 - np.sin(s) ** 2)
    true = -2 * mean * np.abs(np.cos(s)) * np.sqrt(room) / np.sin(np.pi * half) ** 2
    weight = np.full(1001, 3e-3)
    weight[[0, -1]] /= 2
    rows = {"arc": arc, "weight": weight, "sigma_n": true}
    assert theory.westergaard(rows) == pytest.approx(true, abs=2e-3 * -true.min())
    assert true @ weight == pytest.approx(-3 * mean, rel=1e-3)


@pytest.mark.parametrize("history, remembered", [
    ([0, 0.2, 0.5], [0.5]), ([0.5, 0.2, -0.1], [0.5, -0.1]), ([0.5, -0.5], [-0.5]),
    ([0.5, -0.2, 0.3, 0.1, 0.3, 0.4], [0.5, -0.2, 0.4]), ([0.5, -0.2, 0.6], [0.6]),
    ([-0.5, 0.2, -0.1, 0.1], [-0.5, 0.2, -0.1, 0.1]), ([-0.5, 0.2, -0.1, 0.3], [-0.5, 0.3]),
])
def test_what_a_shearing_force_leaves_behind(history, remembered):
    """Closed loops are forgotten, and so is all that is smaller than what came after."""
    assert theory.turns(np.array(history, float)) == remembered


def shifted(history: list, arc: np.ndarray, friction: float = 0.3) -> SimpleNamespace:
    """A run under Hertz's pressure of half-width 1 about the arc 0, sheared by parts of F P."""
    pressure, weight = np.sqrt(np.maximum(0, 1 - arc**2)), np.gradient(arc)
    columns = {"step": [], "node": [], "sigma_n": [], "sigma_t": [], "weight": []}
    most = friction * pressure @ weight
    for step, force in enumerate(history, 1):
        for name, values in (("step", 0 * arc + step), ("node", np.arange(len(arc))),
                             ("sigma_n", -pressure), ("weight", weight),
                             ("sigma_t", force * most * pressure / (pressure @ weight))):
            columns[name].append(values)
    rows = {"arc": arc, "weight": weight, "sigma_n": -pressure, "node": np.arange(len(arc)),
            "step": 0 * arc + len(history), "bound": friction * pressure,
            "status": np.where(pressure > 0, "stick", "open")}
    contact = {name: np.concatenate(values) for name, values in columns.items()}
    return SimpleNamespace(contact=contact, rows=rows, most=most)


@pytest.mark.parametrize("history", [[0.3, 0.6], [0.6, 0.1], [0.6, -0.6, 0.2], [0.5, -0.3, 0.4]])
def test_cattaneo_and_mindlin(history):
    """It carries the shearing force, stays below the bound, and is at it at the edges, where the
    last stretch slipped."""
    arc = np.linspace(-1.2, 1.2, 2401)
    run = shifted(history, arc)
    shear = theory.mindlin(run, run.rows)
    # a node at either end of the contact: 1e-3 of its length
    assert shear @ run.rows["weight"] == pytest.approx(history[-1] * run.most, rel=0.01)
    assert (np.abs(shear) <= run.rows["bound"] + 2e-3).all()
    edge = np.flatnonzero(run.rows["sigma_n"] < -0.1)[0]
    direction = np.sign(np.diff([0.0, *history])[-1])
    assert shear[edge] == pytest.approx(direction * run.rows["bound"][edge], rel=0.05)


def test_no_curve_where_all_slides_or_the_pressure_changes():
    arc = np.linspace(-1.2, 1.2, 241)
    run = shifted([0.5, 1.0], arc)
    assert theory.mindlin(run, run.rows) is None
    run = shifted([0.5, 0.6], arc)
    run.contact["sigma_n"][:241] *= 0.9
    assert theory.mindlin(run, run.rows) is None


def test_a_flat_punch_and_a_ring():
    """Both carry the force of the nodes: the punch to the cut-off at its edges."""
    arc = np.linspace(0, 1, 2001)
    weight = np.gradient(arc)
    weight[[0, -1]] /= 2
    rows = {"arc": arc, "weight": weight, "sigma_n": -np.exp(arc)}
    force = rows["sigma_n"] @ rows["weight"]
    assert theory.flat_punch(rows) @ rows["weight"] == pytest.approx(force, rel=0.02)
    assert theory.flat_punch(rows)[0] == pytest.approx(2 * force / np.pi, rel=1e-6)
    assert theory.uniform(rows) == pytest.approx(np.full(2001, force / rows["weight"].sum()))


@pytest.mark.slow
def test_the_animation_has_a_frame_a_step_all_alike(tmp_path):
    """The start and three steps in one box; the last frame is no longer the first."""
    directory = make_run(tmp_path, steps=3, scene="own", products=6)
    path = animation.draw_animation(directory)
    with Image.open(path) as picture:
        assert picture.n_frames == 4
        first = np.asarray(picture.convert("RGB"), int)
        picture.seek(3)
        last = np.asarray(picture.convert("RGB"), int)
    assert first.shape == last.shape and (first != last).any(axis=2).mean() > 0.1
    assert path in redraw.redraw(directory)


@pytest.mark.slow
def test_the_animation_has_room_for_an_obstacle_wherever_it_goes(tmp_path, monkeypatch):
    """A circle rises from below the block to its side: axes are the same in all pictures, which
    had been cut to the size of the first one.
    """
    directory = make_run(tmp_path, steps=2, scene="own", products=6)
    tables = [round_run(2.0).obstacle for _ in range(3)]
    for step, table in enumerate(tables):
        table["step"] = np.full(64, step)
        for y in ("y0", "y1"):
            table[y] = table[y] + step - 1.5
    obstacles = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    run = dataclasses.replace(figures.read_run(directory), obstacle=obstacles)
    monkeypatch.setattr(animation, "read_run", lambda of: run)
    drawn, pictures = animation._frame, []  # pylint: disable=protected-access
    monkeypatch.setattr(animation, "_frame",
                        lambda *given: pictures.append(drawn(*given)) or pictures[-1])
    animation.draw_animation(directory)
    assert len(pictures) == 3 and len({picture.size for picture in pictures}) == 1


def test_frames_of_unlike_heights_stand_on_the_same_ground():
    """One with a heading of another line: nothing below it is cut or moves."""
    pictures = [Image.new("RGB", (8, height), "white") for height in (10, 12)]
    for picture in pictures:
        picture.putpixel((3, picture.height - 1), (0, 0, 0))
    frames = animation._alike(pictures)  # pylint: disable=protected-access
    assert [frame.size for frame in frames] == [(8, 12), (8, 12)]
    assert [np.asarray(frame.convert("RGB"))[11, 3].max() < 9 for frame in frames] == [True, True]


@pytest.mark.slow
def test_long_histories_are_thinned_and_runs_without_fields_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "MOST", 3)
    directory = make_run(tmp_path, steps=5, products=6)
    with Image.open(animation.draw_animation(directory)) as picture:
        assert picture.n_frames == 4  # start, 1, 3 and 5
        picture.seek(3)
        seen = np.asarray(picture.convert("RGB"), int).reshape(-1, 3)
    for status in set(figures.read_run(directory).contact["status"]):
        # few pixels, of the colour of the other figures all the same
        colour = np.array(ImageColor.getrgb(style.STATUS[status]))
        assert (np.abs(seen - colour).max(axis=1) <= 4).any()
    (directory / "fields.pvd").unlink()
    with pytest.raises(InputError, match="FIELDS=yes"):
        animation.draw_animation(directory)


def test_bodies_that_do_overlap_are_named(tmp_path):
    """The pair that overlaps most, as `validity` in summary.json has it."""
    run = figures.read_run(make_run(tmp_path, steps=2, scene="own", products=6))
    assert "overlap" not in words(figures.compose("deformed", run))
    run.summary["validity"] = {"overlaps": [[4, 7, 0.01], [2, 9, 0.03]]}
    assert "boundaries 2 and 9 overlap" in words(figures.compose("deformed", run))


def test_the_manufactured_pressure_of_zones():
    """On the scene's own base of length 2, at nodes a tenth apart, the true one at any load."""
    x = np.linspace(0, 2, 21)
    true = -7.0 * np.maximum(0.0, 1.5 - x)**2
    rows = {"x": x, "sigma_n": true, "weight": np.r_[0.05, np.full(19, 0.1), 0.05]}
    assert theory.parabola(rows) == pytest.approx(true, abs=1e-12)
    assert theory.NORMAL["zones"][1] is theory.parabola


def test_parts_of_a_boundary_that_do_not_meet_are_no_curve():
    """Two ends of a plate with one label: nothing is drawn between them, nodes that share a corner
    stay together.
    """
    rows = {"arc": np.array([0.0, 1.0, 2.0, 2.0, 7.0, 7.5]),
            "length": np.array([0.5, 1.0, 0.5, 0.25, 0.25, 0.25]),
            "x": np.array([0.0, 1.0, 2.0, 2.0, 7.0, 7.5]), "y": np.zeros(6),
            "status": np.array(["open", "slip", "slip", "open", "open", "slip"]),
            "u_n": np.arange(6.0),
            "theory": {"sigma_n": ("exact", np.arange(6.0))}}
    parts = contact.in_parts(rows)
    np.testing.assert_array_equal(parts["u_n"], [0, 1, 2, 3, np.nan, 4, 5])
    np.testing.assert_array_equal(parts["theory"]["sigma_n"][1], parts["u_n"])
    assert parts["status"].tolist()[4:] == ["open", "open", "slip"]
    whole = {name: values[:3] for name, values in rows.items() if name != "theory"} | {"theory": {}}
    assert contact.in_parts(whole)["arc"].tolist() == [0.0, 1.0, 2.0]


def test_parts_of_a_boundary_that_do_not_meet_are_apart():
    """By arcs, where another label lies between them, or by places, where arcs go on."""
    rows = {"arc": np.array([0.0, 1, 2, 2, 3, 9, 10]),
            "length": np.array([0.5, 1, 0.5, 0.5, 1, 0.5, 0.5]),
            "x": np.array([0.0, 1, 2, 7, 8, 14, 15]), "y": np.zeros(7)}
    assert contact.breaks(rows).tolist() == [3, 5]


def test_a_node_beyond_the_end_of_the_other_body_is_no_part_of_its_own():
    """It carries what of its side faces the other body, a seventh here; nodes alone stay so."""
    rows = {"arc": np.array([0.0, 1, 2, 3, 8, 13]), "x": np.array([0.0, 1, 2, 3, 8, 13]),
            "length": np.array([0.5, 1, 0.64, 0.01, 0.5, 0.5]), "y": np.zeros(6)}
    assert contact.breaks(rows).tolist() == [4, 5]


def test_a_closed_outline_that_starts_inside_a_label_is_one_curve(run):
    """A label on a quarter of a circle of 80 nodes, whose arc begins in the middle of it: what has
    arcs near the whole length stands before the start, in every step.
    """
    arc, nodes = np.arange(80) * np.pi / 40, np.r_[0:11, 70:80]
    ends = {"x": np.cos(arc[nodes]), "y": np.sin(arc[nodes]), "arc": arc[nodes],
            "length": np.full(21, np.pi / 40), "weight": np.full(21, np.pi / 40)}
    table = run.contact | {name: np.tile(values, 20) for name, values in ends.items()}
    closed = dataclasses.replace(run, contact=table)
    (_, rows), = contact.final_boundaries(closed)
    assert len(contact.breaks(rows)) == 0
    np.testing.assert_allclose(rows["arc"], (np.arange(21) - 10) * np.pi / 40, atol=2e-4)
    assert np.all(np.diff(np.arctan2(rows["y"], rows["x"])) > 0)
    assert len(figures.compose("contact_status", closed).axes[0].collections) == 1
    half = {name: column[:15] for name, column in rows.items()}
    assert np.array_equal(contact.in_one(half)["arc"], half["arc"])


def test_axes_reach_the_last_contact_nodes():
    """Vertices of quadratic elements have a sixth of a side at ends, middles two thirds."""
    arc = np.linspace(0.0, 1.0, 5)
    quadratic = reading.segment_ends(arc, np.array([1, 4, 2, 4, 1]) / 12)
    linear = reading.segment_ends(arc, np.array([1, 2, 2, 2, 1]) / 8)
    assert quadratic[[0, -1]].tolist() == linear[[0, -1]].tolist() == [0.0, 1.0]


def test_bodies_that_repeat_themselves_are_outlined_as_far_as_the_picture_goes():
    """Bodies of length 4 that a slide has put 6 apart: images at up to three periods of 4 on either
    side, by whole numbers of them, which do not make the picture any wider.
    """
    axes = Figure().subplots()
    rim = np.array([[[0.0, 0.0], [4.0, 0.0]], [[6.0, 1.0], [10.0, 1.0]]])
    entry = body._images(axes, rim, np.array([[4.0, 0.0]]))
    moved = [lines.get_segments()[0][0][0] for lines in axes.collections]
    assert sorted(moved) == [-12.0, -8.0, -4.0, 4.0, 8.0, 12.0]
    assert not np.isfinite(axes.dataLim.get_points()).any() and "repeat" in entry.get_label()
