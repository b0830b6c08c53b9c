"""What happens over time: loads, contact forces, fixed-point iterations."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .layout import run_header
from .reading import Run, select
from .scales import energy_scale, force_scale, length_scale
from .style import BLUE, GREEN, INCH, INK, ORANGE, RED

FAINT = 0.15  # a force less than this part of the other has a panel of its own
NOTHING = 1e-6  # part of the largest force that the solver's tolerances leave open
IDLE = 1e-9  # part of its work that is rounding
MANY = 80  # steps, from which on their markers run together
HEADROOM = 1.1  # height of a panel over its largest value
WORDS = {"shift_x": "shift in $x$", "shift_y": "shift in $y$", "angle": "angle",
         "distance": "distance of the nearest node"}  # of obstacles that move
CURVES = [BLUE, RED, GREEN, ORANGE, INK]


def loading(figure: Figure, run: Run) -> None:
    """Amplitudes of the loads and motions of obstacles over time, with a marker at every step."""
    groups = load_histories(run)
    figure.set_figheight((2.5 + 4 * len(groups)) * INCH)
    panels = np.atleast_1d(figure.subplots(len(groups), sharex=True))
    handles, end, note = [], run.summary["t_end"], ""
    steps = int(run.history["step"].max())
    if cycles := run.summary.get("cycles"):  # the history holds one of them
        end = cycles["start"] + cycles["period"]
        times = "once" if cycles["number"] == 1 else f"{cycles['number']} times"
        note = f"grey: the cycle, gone through {times}"
    for axes, (title, curves) in zip(panels, groups.items()):
        if cycles:
            axes.axvspan(cycles["start"], end, color="0.93", lw=0)
            steps = len(next(iter(curves.values()))) - 1
        for label, values in curves.items():
            number = len(handles)
            times = np.linspace(0, end, len(values))
            handles += axes.plot(times, values, color=CURVES[number % 5], label=label,
                                 **markers(len(times), "osD^v"[number % 5]))
        axes.set(ylabel=title)
        axes.margins(x=0.02)
        axes.autoscale_view()
        axes.grid(color="0.9", lw=0.5)
    panels[-1].set(xlabel="time $t$")
    shown = " (markers)" if steps < MANY else ""
    run_header(figure, run, f"History of loading, {steps} time steps{shown}", handles, note)


def load_histories(run: Run) -> dict[str, dict]:
    """Values at time 0 and after every step, by their label, for every axis that they need."""
    amplitudes = run.summary["amplitudes"]
    motions = run.summary.get("obstacle_motion", {})
    symbol = "" if len(amplitudes) == 1 else r"_{%s}"
    groups = {}
    if amplitudes:
        title = "amplitude [–]" if symbol else r"amplitude $\varphi$ [–]"
        groups[title] = {r"$\varphi" + (symbol and symbol % name) + "(t)$": np.array(values)
                         for name, values in amplitudes.items()}
    lengths = [values for of in motions.values() for name, values in of.items() if name != "angle"]
    scale = length_scale(run, np.concatenate(lengths)) if lengths else None
    several = len(motions) > 1 or len(run.summary.get("boundaries", [])) > 1  # or some stand still
    for label, histories in motions.items():
        for name, values in histories.items():
            turns = name == "angle"
            title = "obstacle turned\nby [rad]" if turns else f"obstacle [{scale.label}]"
            of = f", label {label}" if several else ""
            curve = f"{WORDS[name]}{of}"
            groups.setdefault(title, {})[curve] = np.array(values) * (1 if turns else scale.factor)
    return groups


def history(figure: Figure, run: Run) -> None:
    """Contact forces, contact length, dissipated energy; iterations of the fixed point, if there
    were some, small.

    Normal resultants are positive. A tangential one that is small beside them has its own panel,
    unless it is what tolerances leave: that is drawn as zero.
    """
    table = run.history
    boundaries = len(run.summary.get("boundaries", []))
    summed = f", sum over {boundaries} boundaries" if boundaries > 1 else ""
    forces = [(f"normal resultant{summed}", RED, "o", -table["resultant_n"])]
    if run.friction:
        forces.append((f"tangential resultant{summed}", BLUE, "s", table["resultant_t"]))
    largest = np.array([np.abs(values).max() for *_, values in forces])
    share = largest.min() / (largest.max() or 1.0)
    together = [[force] for force in forces] if NOTHING < share <= FAINT else [forces]
    heights = [3 if len(together) == 1 else 2.5] * len(together) + [2] * (1 + run.friction)
    iterations = int(table["fixed_point_iterations"].sum()) if run.fixed_point else 0
    heights += [0.8] * (iterations > 0)
    figure.set_figheight((3.4 + 1.35 * sum(heights)) * INCH)
    panels = list(figure.subplots(len(heights), sharex=True, height_ratios=heights))
    rest, handles = iter(panels), []
    for group in together:
        handles += _forces(next(rest), run, table["time"], group)
    _over_time(next(rest), table, "contact_length", length_scale, run, "contact\nlength")
    if run.friction:
        rounding = IDLE * largest.max() * table["max_displacement"].max()
        _over_time(next(rest), table, "dissipated", energy_scale, run, "dissipated\nenergy",
                   rounding)
    if iterations:
        _iterations(next(rest), table)
    for axes in panels:
        axes.grid(color="0.9", lw=0.5)
        axes.set_axisbelow(True)
    panels[-1].set_xlabel("time $t$")
    figure.align_ylabels()
    note = f"{iterations} iterations of the fixed point" if iterations else ""
    run_header(figure, run, r"Forces and zones on $\Gamma_c$ over time", handles, note)


def _forces(axes, run: Run, time: np.ndarray, group: list) -> list:
    """Forces over time in one panel; legend entries."""
    scale, lines = force_scale(run, np.concatenate([values for *_, values in group])), []
    for word, colour, marker, values in group:
        lines += axes.plot(time, values * scale.factor, color=colour, label=word,
                           **markers(len(time), marker))
    axes.axhline(0, color="0.45", lw=0.5, zorder=1)
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.set_ylabel(f"contact force\n[{scale.label}]")
    return lines


def _iterations(axes, table: dict) -> None:
    """Iterations of the fixed point in every step, small."""
    solved = select(table, table["step"] > 0)
    width = 0.7 * np.diff(solved["time"], prepend=0.0).min()
    axes.bar(solved["time"], solved["fixed_point_iterations"], width, color="0.7")
    axes.set_ylabel("iterations", fontsize=7, color="0.4")
    axes.tick_params(axis="y", labelsize=7, labelcolor="0.4")
    axes.yaxis.set_major_locator(MaxNLocator(2, integer=True))


def _over_time(axes, table: dict, column: str, scale_of, run: Run, name: str,
               rounding: float = 0.0) -> None:
    """A column of history.csv in a panel of its own; zero where all of it is `rounding`."""
    values = table[column]
    if np.abs(values).max() <= rounding:
        values = 0 * values
    scale = scale_of(run, values)
    axes.plot(table["time"], values * scale.factor, color=INK, **markers(len(table["time"])))
    axes.set_ylabel(f"{name}\n[{scale.label}]")
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.set_ylim(0, HEADROOM * scale.factor * values.max() or None)


def markers(points: int, marker: str = "o") -> dict:
    """Markers at the steps as long as they can be told apart."""
    return {"marker": marker, "ms": 3} if points <= MANY else {"lw": 1.0}


def coordinate(run: Run, name: str) -> str:
    """x or y as the run's pictures call it: r and z of bodies of revolution."""
    return dict(x="r", y="z")[name] if run.summary["effects"].get("axisymmetric") else name


def loops(run: Run) -> list[tuple[str, str, dict]]:
    """(probe, x or y, its rows in time) of probes that feel a force, where they move most."""
    if run.probes is None:
        return []
    found = []
    for name in dict.fromkeys(run.probes["probe"].tolist()):
        rows = select(run.probes, run.probes["probe"] == name)
        axis = max("xy", key=lambda c, rows=rows: np.ptp(rows[f"u_{c}"]))
        if np.any(rows[f"force_{axis}"]) and np.any(rows[f"u_{axis}"]):
            found.append((name, axis, rows))
    return found


def _probe_name(run: Run, name: str) -> str:
    """What a probe is called in a legend."""
    if label := name.removeprefix("label") * name.startswith("label"):
        return f"label {run.label_name(int(label))}"
    return name.replace("point", "point ")


def force_displacement(figure: Figure, run: Run) -> None:
    """Force over displacement of every probe that feels a force, along its largest movement."""
    curves = loops(run)
    figure.set_figheight(9 * INCH)
    axes = figure.add_subplot()
    force = force_scale(run, np.concatenate([rows[f"force_{c}"] for _, c, rows in curves]))
    length = length_scale(run, np.concatenate([rows[f"u_{c}"] for _, c, rows in curves]))
    handles = []
    for number, (name, c, rows) in enumerate(curves):
        u, f = rows[f"u_{c}"] * length.factor, rows[f"force_{c}"] * force.factor
        colour = CURVES[number % len(CURVES)]
        word = _probe_name(run, name)
        handles += axes.plot(u, f, color=colour, label=f"{word}, ${coordinate(run, c)}$",
                             **markers(len(u)))
        axes.plot(u[0], f[0], "o", ms=7, mfc="none", mec=colour, mew=1)
        axes.plot(u[-1], f[-1], "s", ms=6, mfc="none", mec=colour, mew=1)
    axes.axhline(0, color="0.45", lw=0.5, zorder=1)
    axes.axvline(0, color="0.45", lw=0.5, zorder=1)
    axes.set(xlabel=f"displacement [{length.label}]", ylabel=f"force on the body [{force.label}]")
    axes.grid(color="0.9", lw=0.5)
    run_header(figure, run, "Force and displacement", handles,
               "ring: first step, square: last step")
