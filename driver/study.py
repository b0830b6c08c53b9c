"""Parameter studies: one scene for many values of a friction coefficient, a gap, a load history or a step count.

The body is exported, factorized and, where its contact boundary is small enough, condensed once (compliance.py);
every value then costs a few products with a small matrix. FreeFEM evaluates the contact data and histories of
all values in one process that assembles nothing. In the interpreter:

    from driver.study import make_study
    summary, folder = make_study({"scene": "model", "friction": "0.05:1.0:100", "subdomains": "16x8"})

`study.csv` has one row per value (last step and totals), `history.csv` one per value and step, `contact.csv`
one per value and contact node at the last step.
"""

import csv
import dataclasses
import json
import os
import shutil
import time
from pathlib import Path

import numpy as np

from . import freefem
from .errors import DriverError, InputError, agree, error_of
from .files import write_json, write_table
from .timing import Laps

LARGEST = 2000  # contact rows beyond which the condensation takes longer than a hundred runs save
FIELDS = ("u_n", "u_t", "slip", "sigma_n", "sigma_t", "bound")


def make_study(pairs: dict[str, str]) -> tuple[dict, Path]:
    """Run a study as given by NAME=VALUE pairs; returns its summary and directory.

    Exactly one scene parameter holds several values: first:last:count, equally spaced, or a,b,c. Raises
    DriverError; values that did not converge are told at the end and kept in the files, marked so.
    """
    from .run import RESULTS, Run, solve
    from .workspace import Workspace

    name, values = _studied(pairs)
    run = Run.from_pairs({**pairs, name: values[0]})
    if run.adapt:
        raise InputError("a study has one mesh; ADAPT belongs to single runs")
    out = (run.out if "out" in pairs else RESULTS / "study" / f"{run.scene.stem}-{name}").absolute()
    with Workspace(out) as place:
        clock, work = time.perf_counter(), place.path
        freefem.export(run.scene, work / "export", run.parameters, run.ranks)
        base = time.perf_counter()
        freefem.export_study(run.scene, work / "values", run.parameters, name, values)
        request = {"scene": run.scene.stem, "settings": run.settings, "study": name, "values": values, "quiet": run.quiet,
                   "seconds": {"export": base - clock, "values": time.perf_counter() - base}}
        status, reason = solve(work, request, run.ranks)
        if not (work / "summary.json").exists():
            raise error_of(status, reason)
        if run.figures:
            draw_study(work)
        for folder in ("export", "values"):
            shutil.rmtree(work / folder)
        place.publish(out)
    if status:
        raise error_of(status, f"{reason}; the study is kept in {os.path.relpath(out)}")
    return json.loads((out / "summary.json").read_text()), out


def _studied(pairs: dict[str, str]) -> tuple[str, list[str]]:
    """The one parameter with several values, and those."""
    if "scene" not in pairs:
        raise InputError("make study needs SCENE= and one parameter with several values, such as FRICTION=0.05:1.0:100")
    several = [name for name, text in pairs.items() if name not in ("scene", "out") and ("," in text or ":" in text)]
    if len(several) != 1:
        raise InputError("a study needs exactly one parameter with several values: first:last:count or a,b,c"
                         + f" (here {', '.join(map(str.upper, several)) or 'none'})")
    name = several[0]
    values = pairs[name].split(",")
    if ":" in pairs[name]:
        try:
            first, last, count = pairs[name].split(":")
            values = [f"{value:.12g}" for value in np.linspace(float(first), float(last), int(count))]
        except ValueError:
            raise InputError(f"{name.upper()}={pairs[name]} is not of the form first:last:count") from None
    if not values or not all(values) or len(set(values)) < len(values):
        raise InputError(f"{name.upper()}={pairs[name]} lacks a value or gives one twice")
    return name, values


# ---- the SPMD part -------------------------------------------------------------------------------

def run(directory: Path, request: dict, comm) -> tuple[int, str]:
    """Solve all values on the ranks of `comm` and write the files; exit status and reason, as solve.run. Raises DriverError."""
    from .compliance import ContactCompliance
    from .loader import read_contact, read_manifest
    from .options import Settings
    from .problem import assemble

    lap = Laps(request["seconds"])
    seconds = lap.seconds
    problem = assemble(directory / "export", comm, lap)
    manifest, structure, operator = problem.manifest, problem.structure, problem.operator
    if not manifest.contact_labels:
        raise InputError("a study needs a scene with contact: without it the response is linear in its loads")
    lap("setup")
    rows = int(np.count_nonzero(structure.row_kind))
    condensed = rows <= LARGEST and not structure.rigid_modes
    if condensed:
        operator = ContactCompliance(operator)
    lap("condense")
    # condensed, every rank solves values of its own; else all ranks solve each value together
    mine = range(comm.rank, len(request["values"]), comm.size) if condensed else range(len(request["values"]))
    settings, found, error = Settings(**request["settings"]), {}, None
    try:
        for k in mine:
            folder = directory / "values" / str(k)
            value = read_manifest(folder)
            _check_same(request["study"], manifest, value)
            contact = _contact_of(request["study"], structure.contact, read_contact(folder, value))
            found[k] = _solve(dataclasses.replace(problem, manifest=value, operator=operator.with_contact(contact)), settings)
            _progress(request, comm, k)
    except DriverError as problem:
        error = problem
    agree(comm, error)
    lap("solve")
    found = {k: one for part in comm.allgather(found) for k, one in part.items()}
    outcomes = [found[k] for k in range(len(request["values"]))]
    seconds["total"] = sum(seconds.values())
    failed = [k for k, one in enumerate(outcomes) if one.status]
    status = max((one.status for one in outcomes), default=0)
    reason = "" if not failed else (f"{len(failed)} of {len(outcomes)} values did not converge, the first "
                                    f"{request['study'].upper()}={request['values'][failed[0]]}: {outcomes[failed[0]].reason}")
    if comm.rank == 0:
        summary = {"scene": request["scene"], "study": request["study"], "values": len(outcomes), "converged": not failed,
                   "reason": reason, "contact_rows": rows, "condensed": condensed,
                   "counts": {"dual_multiplications": sum(one.row["dual_multiplications"] for one in outcomes),
                              "dual_multiplications_setup": operator.condensation_products if condensed else 0},
                   "seconds": seconds, "ranks": comm.size, "units": manifest.units,
                   "parameters": {**{n: v for n, v in manifest.parameters.items() if n != request["study"]},
                                  **dataclasses.asdict(settings)}}
        _write(directory, request, structure.contact, outcomes, summary)
    return status, reason


def _progress(request: dict, comm, k: int) -> None:
    total = len(request["values"])
    if comm.rank == 0 and not request["quiet"] and (k + 1) % max(1, total // 5) < comm.size:
        print(f"{request['scene']}: {request['study']} = {request['values'][k]}, {k + 1} of {total}", flush=True)


def _check_same(name: str, base, value) -> None:
    """Refuse a value whose manifest differs where the stiffness, loads and rows of the export come from."""
    for part in ("subdomains", "vertices", "effects", "patterns", "contact_labels", "material", "plane"):
        if getattr(base, part) != getattr(value, part):
            raise InputError(f"a study cannot vary {name.upper()}: it changes the scene's {part.replace('_', ' ')}")


def _contact_of(name: str, boundary, pieces: list):
    """The contact boundary with gap, friction and initial displacement of one value."""
    from .contactboundary import add_parts, contact_table

    keys, _, total = add_parts(np.concatenate([contact_table(data, gid, xy) for data, gid, xy in pieces]))
    place = {(label, gid): i for i, (label, gid) in enumerate(keys.astype(np.int64).tolist())}
    at = [place.get(node, -1) for node in zip(boundary.label.tolist(), boundary.gid.tolist())]
    weight = total[at, 0]
    normal = total[at, 1:3] / np.linalg.norm(total[at, 1:3], axis=1)[:, None]
    rigid = ~boundary.paired  # between two bodies weight, normal and gap follow from both sides
    if -1 in at or not (np.allclose(weight[rigid], boundary.weight[rigid], rtol=1e-9)
                        and np.allclose(normal[rigid], boundary.normal[rigid], atol=1e-9)):
        raise InputError(f"a study cannot vary {name.upper()}: it moves or turns the contact boundary")
    gap, friction, initial = (total[at, 3:6] / weight[:, None]).T
    if gap[~rigid].any():
        raise InputError(f"a study cannot vary {name.upper()} in a scene that declares pairGap")
    return dataclasses.replace(boundary, gap=np.where(rigid, gap, boundary.gap), friction=friction, initial=initial)


@dataclasses.dataclass
class Outcome:
    """One value: its row of study.csv, those of history.csv, contact fields (n_c,) and status at the last step."""

    status: int
    reason: str
    row: dict
    history: list[dict]
    fields: dict


def _solve(problem, settings) -> Outcome:
    """March through the steps of one value."""
    operator, solver = problem.operator, problem.solver(settings)
    history, fields, u_t = [], {}, operator.structure.contact.initial
    dissipated = 0.0
    for step in solver.steps():
        fields = _fields(operator, solver.rows, step, u_t)
        u_t = fields["u_t"]
        row = _quantities(operator.structure.contact, fields)
        dissipated += row.pop("work")
        history.append({"step": step.index, "time": step.time, **row, "dissipated": dissipated,
                        "fixed_point_iterations": step.fixed_point_iterations, "dual_multiplications": step.products,
                        "kkt": max(step.residuals.values())})
    counts, ended = solver.history.counts, solver.history
    row = {"converged": "no" if ended.exit_status else "yes", "steps": ended.steps, **(history[-1] if history else {}),
           "fixed_point_iterations": counts["fixed_point_iterations"], "dual_multiplications": counts["dual_multiplications"],
           "kkt": max(ended.residuals.values(), default=0.0)}
    row.pop("step", None), row.pop("time", None)
    return Outcome(ended.exit_status, ended.reason, row, history, fields)


def _fields(operator, rows, step, u_t: np.ndarray) -> dict[str, np.ndarray]:
    """Nodal contact quantities from multipliers and gradient alone: at its rows B u = c - gradient."""
    contact, values = operator.structure.contact, np.zeros((6, len(u_t)))
    values[0, rows.normal_node] = rows.gap - step.gradient[rows.normal]
    values[1, rows.tangential_node] = -step.gradient[rows.tangential]
    values[2, rows.normal_node] = -step.multipliers[rows.normal]
    values[3, rows.tangential_node] = -step.multipliers[rows.tangential]
    values[4, rows.tangential_node] = rows.friction_bound(step.multipliers)
    values[5, rows.normal_node] = step.status
    u_n, slip, force_n, force_t, bound, status = np.sum(operator.comm.allgather(values), axis=0)
    w = contact.weight
    return {"u_n": u_n, "u_t": u_t + slip, "slip": slip, "sigma_n": force_n / w + 0.0, "sigma_t": force_t / w + 0.0,
            "bound": bound / w, "status": status.astype(int)}


def _quantities(contact, fields: dict) -> dict:
    """Resultants and zones of one step; `work` is what friction dissipates in it."""
    from .friction import OPEN, STATUS_NAMES

    w, touching = contact.weight, fields["status"] != OPEN
    nodes = np.bincount(fields["status"], minlength=3)
    return {"resultant_n": float(fields["sigma_n"] @ w), "resultant_t": float(fields["sigma_t"] @ w),
            "peak_pressure": float(-fields["sigma_n"].min(initial=0)), "contact_length": float(w[touching].sum()),
            "largest_slip": float(np.abs(fields["slip"]).max(initial=0)),
            **{f"nodes_{name}": int(nodes[k]) for k, name in enumerate(STATUS_NAMES)},
            "work": float(-(fields["sigma_t"] * fields["slip"]) @ w)}


def _write(directory: Path, request: dict, contact, outcomes: list[Outcome], summary: dict) -> None:
    """study.csv, history.csv, contact.csv and summary.json."""
    from .friction import STATUS_NAMES

    name, values = request["study"], request["values"]
    full = next((one.row for one in outcomes if one.history), outcomes[0].row)
    write_table(directory / "study.csv", [{name: value} | dict.fromkeys(full, "") | one.row for value, one in zip(values, outcomes)])
    steps = [{name: value, **row} for value, one in zip(values, outcomes) for row in one.history]
    if steps:
        write_table(directory / "history.csv", steps)
    rows = []
    for value, one in zip(values, outcomes):
        for i in range(len(contact.gid) if one.fields else 0):
            place = {"node": i, "boundary": int(contact.label[i]), "x": contact.xy[i, 0], "y": contact.xy[i, 1],
                     "arc": contact.arc[i], "weight": contact.weight[i]}
            rows.append({name: value, **place, **{f: one.fields[f][i] for f in FIELDS},
                         "status": STATUS_NAMES[one.fields["status"][i]]})
    if rows:
        write_table(directory / "contact.csv", rows)
    write_json(directory / "summary.json", summary)


def describe(summary: dict, out: Path) -> str:
    """Few lines about a finished study."""
    s, counts = summary["seconds"], summary["counts"]
    how = f"{summary['contact_rows']} contact rows condensed" if summary["condensed"] else "not condensed"
    return (f"{summary['scene']}: {summary['values']} values of {summary['study']}, {how} with "
            f"{counts['dual_multiplications_setup']} products with F, then {counts['dual_multiplications']} products\n"
            f"  {s['total']:.2f} s (FreeFEM {s['export']:.2f}, values {s['values']:.2f}, setup {s['read'] + s['setup']:.2f}, "
            f"condensation {s['condense']:.2f}, solve {s['solve']:.2f}), results in {os.path.relpath(out)}")


def draw_study(directory: Path) -> list[Path]:
    """Resultants, peak pressure, zones and dissipated energy over the values at the last step, from the files."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from .figures import BLUE, GREEN, INCH, ORANGE, STYLE, WIDTH, write

    summary = json.loads((directory / "summary.json").read_text())
    with open(directory / "study.csv", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["converged"] == "yes"]
    if not rows:
        return []
    name = summary["study"]
    try:
        x = [float(row[name]) for row in rows]
    except ValueError:
        x = [row[name] for row in rows]
    y = lambda column: np.array([float(row[column]) for row in rows])
    length, stress = summary["units"]["length"], summary["units"]["stress"]
    marker = "o" if len(rows) <= 20 else ""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 12 * INCH), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        forces, peak, zones, energy = figure.subplots(2, 2, sharex=True).ravel()
        forces.plot(x, -y("resultant_n"), BLUE, marker=marker, label="pressing, $-R_n$")
        forces.plot(x, y("resultant_t"), ORANGE, marker=marker, label="friction, $R_t$")
        forces.set_ylabel(f"contact force [{stress}·{length}]")
        peak.plot(x, y("peak_pressure"), BLUE, marker=marker)
        peak.set_ylabel(f"largest pressure [{stress}]")
        for zone, colour in (("stick", GREEN), ("slip", ORANGE), ("open", BLUE)):
            zones.plot(x, y(f"nodes_{zone}"), colour, marker=marker, label=zone)
        zones.set_ylabel("contact nodes")
        energy.plot(x, y("dissipated"), ORANGE, marker=marker)
        energy.set_ylabel(f"dissipated energy [{stress}·{length}²]")
        for axes in (forces, zones):
            axes.legend(frameon=False)
        for axes in (zones, energy):
            axes.set_xlabel(name.replace("_", " "))
        figure.suptitle(f"{summary['scene']}: {summary['values']} values of {name}, end of the history")
        (directory / "figures").mkdir(exist_ok=True)
        return write(figure, directory / "figures", "study")
