"""summary.json: input, results and cost of a run.

The entries are the fields of `Summary`, in their order; each carries its unit and meaning, from
which the reference is made. Entries that do not apply to a run (None) are left out.
"""

import sys
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

import numpy as np

from ..environment import version
from ..errors import DriverError, agreed_writes
from ..feti.rows import RowKind
from ..feti.structure import Substructure
from ..files import write_json
from ..march.problem import Problem
from ..march.quasistatic import QuasistaticSolver
from ..options import Settings
from ..timing import memory_used
from . import omissions
from .at_points import at_points
from .ledger import ledger
from .writer import Writer

FILE = "summary.json"
ROUNDED = 1e-11  # of shear modulus times displacement, that rounding leaves as forces


def entry(meaning: str, unit: str = "1", parts: dict | None = None, optional: bool = False):
    """A field of a summary; `parts` has the meanings of the entries of a dictionary."""
    metadata = {"meaning": meaning, "unit": unit, "parts": parts or {}}
    return field(default=None, metadata=metadata) if optional else field(metadata=metadata)


@dataclass
class Sizes:
    """Numbers of unknowns and conditions."""

    subdomains: int = entry("subdomains of all bodies")
    primal_dofs: int = entry(
        "displacements of all torn subdomains, including constrained ones and repeated corners")
    dual_dofs: int = entry("all multipliers: the sum of the next four")
    dual_gluing: int = entry("multipliers that glue subdomains")
    dual_normal: int = entry("normal contact multipliers")
    dual_tangential: int = entry("tangential contact multipliers")
    dual_joined: int = entry("multipliers of ties and periodic boundaries")
    coarse_dofs: int = entry("unknowns of the coarse problem: displacements of the corners")
    contact_nodes: int = entry("contact nodes")

    @classmethod
    def of(cls, structure: Substructure) -> "Sizes":
        """Sizes of a torn problem."""
        rows = np.bincount(structure.at_contact.kind, minlength=RowKind.COUNT).tolist()
        rows[RowKind.GLUING] = structure.dual_dofs - sum(rows)
        return cls(structure.total, structure.primal_dofs, structure.dual_dofs, *rows,
                   structure.coarse_dofs, len(structure.contact.declared.gid))


# effects that have no more to say of themselves
DECLARED = ("axisymmetric", "cohesion", "curved", "large_sliding", "normal_compliance",
            "obstacle_motion", "periodic", "springs", "ties", "wear")


@dataclass
class Summary:
    """The entries of summary.json; `parts` names a dictionary's entries where these are fixed."""

    scene: str = entry("name of the scene")
    variant: str = entry("value of LOADING, if the scene has this parameter")
    converged: bool = entry("whether every step was solved to the tolerances")
    reason: str = entry("why the run ended early; empty if it did not")
    warnings: list = entry("warnings to read before the results are used")
    effects: dict = entry("what the scene declares", parts={
        "contact": "none, unilateral, bilateral, or unilateral and bilateral",
        "friction": "none, tresca, coulomb, coulomb and tresca, or coulomb-slip-dependent",
        "time": "static or quasistatic",
        "initial": "preload, if the history starts from a preloaded state",
        "body_force": "whether there is a body force", "bodies": "number of bodies",
        "cycles": "number of cycles, if the history repeats one",
        **{name: "true where it is declared" for name in DECLARED}})
    sizes: Sizes = entry("numbers of unknowns")
    steps: int = entry("finished time steps")
    t_end: float = entry("end of the load history", "time")
    counts: dict = entry("work of all steps", parts={
        "fixed_point_iterations": "QPs solved for the fixed point of friction",
        "dual_multiplications": "products with the dual matrix in all time steps",
        "dual_multiplications_setup": "products with the dual matrix before the first time step",
        "cg_steps": "CG steps of MPRGP", "expansion_steps": "expansion steps of MPRGP",
        "proportioning_steps": "proportioning steps of MPRGP",
        "contact_block_products": "products with the block of the contact rows alone",
        "condensed_steps": "time steps completed by Newton's method on the contact rows",
        "geometries": "contact geometries in all time steps, where contact follows the motion"})
    residuals: dict = entry(
        "relative residuals of the KKT conditions, largest of all steps; a step has converged "
        "when all are at most PRIMAL_RTOL (equilibrium: FRICTION_RTOL)", parts={
            "stationarity": "correction of the contact forces by one preconditioned step (by one "
                            "Newton step where gluing rows are eliminated), relative to the "
                            "contact forces; in a step without contact forces relative to the "
                            "largest so far",
            "gluing": "jump of displacements between subdomains, divided by delta: the largest "
                      "displacement of a vertex minus the rigid motion of its body, or a lower "
                      "bound of it from the corners where that suffices; delta is at least "
                      "1.4e-14/PRIMAL_RTOL of the displacement of bodies that hardly deform",
            "penetration": "penetration into the obstacle or other body, divided by delta",
            "sign": "tensile normal forces, divided by f: the largest contact force of a node",
            "cone": "excess of friction forces over their bound, divided by f",
            "complementarity": "natural residuals of contact and friction, abs(lambda - "
                               "P(lambda + f/delta move)) / f, with P the projection on "
                               "admissible forces and move the penetration or slip",
            "equilibrium": "resultant forces on bodies without support, divided by the sum of "
                           "their magnitudes",
            "geometry": "where contact follows the motion: difference between the contact "
                        "conditions linearized about the solution and those used, in distances "
                        "(divided by delta) and contact forces (divided by f)"})
    contraction: float = entry("largest of the steps' mean ratios of successive fixed-point "
                               "changes")
    fallbacks: dict = entry("number of steps that needed a fallback, by the name of the method")
    uniqueness: dict = entry("whether time steps have other solutions", parts={
        "verdict": "unique (proved), not unique, no second solution found, or not examined",
        "steps_examined": "number of steps examined",
        "steps_not_unique": "numbers of the steps with other solutions",
        "solutions": "solutions of the first such step, starting with the one that the run "
        "follows: numbers of open, sticking and slipping nodes, resultants, largest nodal "
        "pressure, and index (a sign; the indices of all solutions add up to one)"})
    memory_mib: float = entry("peak memory of all ranks together, including error estimates", "MiB")
    ranks: int = entry("MPI ranks")
    units: dict = entry("names of the scene's units",
                        parts={"length": "m, mm, ...", "stress": "Pa, MPa, ...",
                               "assumed": "yes if the scene names no units; m and Pa are then "
                               "assumed"})
    amplitudes: dict = entry(
        "factors of the loads at the start and after every step, by number of the load; a "
        "repeated history is listed with one cycle")
    loads: list = entry("resultant of every load at amplitude 1: effect, number of the amplitude, "
                        "total force, force on each body", "stress length")
    points: list = entry("point loads and springs at points (except on labels with an elastic "
                         "foundation): effect, number of the amplitude, position, and force at "
                         "amplitude 1 or stiffness in x and y")
    parameters: dict = entry("parameters of the scene and options of the solver")
    versions: dict = entry("versions of the suite, Python, numpy and PETSc")
    seconds: dict = entry("wall time of the stages", "s", parts={
        "export": "FreeFEM, without reading and reduction that go on meanwhile",
        "read": "reading the export of FreeFEM", "setup": "reduction to the interfaces",
        "solve": "all time steps, including those before an interruption",
        "uniqueness": "search for other solutions, if there was one",
        "geometry": "update of contact rows, where contact follows the motion",
        "output": "contact quantities and fields",
        "validity": "checks of the model's assumptions",
        "energy_error": "error in the energy norm", "estimates": "error budget",
        "figures": "figures and animation, except those drawn while errors are estimated",
        "start": "start of programs, packages and ranks, and all that no other stage counts",
        "total": "sum of all stages: the time that the user waits",
        "export_cycles": "FreeFEM in refinement cycles",
        "solve_cycles": "everything else in refinement cycles"})
    effects_ledger: dict = entry(
        "for every effect: whether it was declared and active, why, its unknowns and seconds")
    balance: float = entry(
        "resultant of all forces divided by the sum of their magnitudes; largest of the steps")
    dissipated: float = entry("energy dissipated by friction", "stress length^2")
    errors: dict | None = entry("estimated errors", optional=True, parts={
        "energy": "error in the energy norm: kind, step, parts, total, norm, relative, largest, "
                  "carrying, excluded",
        "quantities": "error budget of every quantity: value, parts, total, relative",
        "advice": "how to reduce the largest part", "notes": "companion runs that failed",
        "adjoint": "quantities with an adjoint problem, products with the dual matrix for all "
                   "of them, and the step's error in energy from smoothed stresses (smoothed); "
                   "or the reason why there are none",
        "prices": "price list of QUANTITY: its present error, and lines with accuracy, settings, "
                  "predicted seconds, seconds_bare (without estimates), memory_mib, and the cost "
                  "with other kinds of meshes; or the reason why there are none"})
    materials: list | None = entry("material of every body, if the scene gives one per body: body, "
                                   "name, young, poisson", optional=True)
    label_names: dict | None = entry("names that gmsh files give to labels, by label; the CSV "
                                     "tables have the labels alone", optional=True)
    cycles: dict | None = entry("cycles of a repeated history", optional=True, parts={
        "start": "start time of the cycle", "period": "duration of a cycle",
        "number": "number of cycles, including those jumped over",
        "skipped": "number of cycles jumped over",
        "settled_after": "cycle since which all have been settled; null if the last is not",
        "error": "sum of the errors of all jumps (column error of cycles.csv), a length",
        "last": "row of the last cycle in cycles.csv"})
    quantities: dict | None = entry("quantities of interest", "see below", optional=True)
    quantities_time: float | None = entry("time to which quantities belong", "time", optional=True)
    obstacle_motion: dict | None = entry(
        "for every label that meets a moving obstacle, at the start and after every step: shift_x, "
        "shift_y and angle as far as they are not zero; the distance of the nearest node where all "
        "are zero or distances do not follow from them (gapInTime)",
        "length, rad", optional=True)
    periods: list | None = entry("periods of bodies in pairs with periodic boundaries: [x, y]",
                                 "length", optional=True)
    boundaries: list | None = entry(
        "rows of boundaries.csv in the last step, if there is contact; with the name that a gmsh "
        "file gives the label, if any", "see boundaries.csv", optional=True)
    probes: list | None = entry("rows of probes.csv in the last step, likewise, of probes",
                                "see probes.csv", optional=True)
    resumed_after_step: int | None = entry(
        "number of steps taken over from an interrupted run", optional=True)
    validity: dict | None = entry("whether the model's assumptions hold", optional=True, parts={
        "largest_strain": "largest principal strain of a triangle",
        "largest_rotation": "largest rotation of a triangle, in rad, minus that of a free body",
        "largest_normal_error": "change of the distance of closed nodes from the obstacle or "
                                "other body, from the one used to the one at displaced "
                                "positions, divided by the contact length",
        "normal_turn": "angle between the normal used and that at the displaced position, in rad",
        "largest_swelling": "part of the compression of a body and of the bodies that press it "
                            "that comes from its turning alone",
        "largest_slide": "sliding distance of closed nodes along another body since the start, "
                         "divided by the contact length; 0 where contact follows the motion",
        "second_order": "estimated change of the largest displacement, or of a boundary's contact "
                        "force, by finite rotations, relative; null where not estimated",
        "buckling": "estimated part of the loads at which a body buckles; null with ERRORS=no",
        "overlaps": "[label, label, depth over the body's size] of boundaries without declared "
                    "contact that penetrate",
        "verdict": "ok, questionable or invalid", "reason": "reason, place and remedy"})
    accuracy: dict | None = entry("result of ACCURACY=", optional=True, parts={
        "quantity": "quantity of interest", "asked": "requested relative error",
        "reached": "estimated relative error", "settings": "options that give the same run by hand",
        "levels": "number of meshes tried",
        "products": "products with the dual matrix in all runs"})

    def entries(self) -> dict:
        """The entries as written in the file."""
        return {name: value for name, value in asdict(self).items() if value is not None}


def summarize(request, problem: Problem, solver: QuasistaticSolver,
              failure: DriverError | None, settings: Settings, writer: Writer, memory_mib: float,
              seconds: dict, **optional) -> Summary:
    """The summary of a finished run; collective.

    `request` names the scene, `failure` says why the run did not converge, `memory_mib` is as from
    `largest_memory`, `seconds` of all stages; `optional` entries as in `Summary`.
    """
    manifest, structure, history = problem.manifest, problem.structure, solver.history
    sizes = Sizes.of(structure)
    warnings = [*history.warnings, *history.fallbacks.warnings(), *solver.uniqueness.warnings(),
                *omissions.warnings(structure.contact.start.declared, problem.effects.rooms,
                                    writer.record.displacements, settings, _softest(problem),
                                    manifest.units),
                *omissions.half_declared(structure.contact.start.declared, problem.effects.rooms),
                *omissions.far_moves(structure, writer.record.displacements, solver.amplitudes,
                                     problem.operator.comm),
                *omissions.far_gaps(structure, problem.effects.rooms),
                *omissions.coarse_table(writer.record, problem.effects),
                *omissions.held_loads(structure, manifest, problem.operator.comm),
                *omissions.support_jumps(structure.support_jumps),
                *omissions.without_wear(writer.record), *omissions.without_friction(writer.record),
                *omissions.held_inside(writer.record),
                *(writer.probes.warnings if writer.probes else [])]
    if optional.get("validity") and optional["validity"]["verdict"] != "ok":
        doubt = optional["validity"]
        warnings.append(f"results are {doubt['verdict']}: {doubt['reason']}")
    if failure:
        warnings.append(str(failure))
    if manifest.materials:
        optional["materials"] = manifest.materials
    if manifest.label_names:
        optional["label_names"] = {str(k): name for k, name in manifest.label_names.items()}
    if writer.cycle_rows:
        optional["cycles"] = _cycles(solver.cycles, writer.cycle_rows)
    if structure.contact.declared.motion is not None:
        optional["obstacle_motion"] = _motions(structure.contact.declared)
    if structure.contact.periods is not None and len(structure.contact.periods.ways):
        optional["periods"] = structure.contact.periods.ways.tolist()
    if writer.history_rows:
        optional["quantities"], index = writer.record.quantities()
        optional["quantities_time"] = writer.history_rows[index]["time"]
        last = writer.history_rows[-1]["step"]
        if problem.effects.contact:
            optional["boundaries"] = _of_last(writer.boundary_rows, last, "boundary", manifest)
        if writer.probes is not None:
            optional["probes"] = _of_last(writer.probes.rows, last, "probe", manifest)
    return Summary(
        scene=request.scene, variant=str(manifest.parameters.get("loading", "")),
        converged=failure is None, reason=str(failure or ""), warnings=warnings,
        effects=solver.effects.summary, sizes=sizes, steps=history.steps,
        t_end=manifest.t_end if solver.cycles is None else float(solver.times[-1]),
        counts=history.counts, residuals=history.residuals, contraction=history.contraction,
        fallbacks={name: len(steps) for name, steps in history.fallbacks.steps.items()},
        uniqueness=solver.uniqueness.summary(), memory_mib=memory_mib,
        ranks=writer.operator.comm.size, units=manifest.units, amplitudes=manifest.amplitudes,
        loads=_loads(problem), points=at_points(problem),
        parameters={**manifest.parameters, **asdict(settings)}, versions=_versions(),
        seconds=seconds, effects_ledger=_ledger(problem, sizes, solver, writer),
        balance=_balance(writer, _softest(problem)), dissipated=writer.record.dissipated,
        **optional)


def _of_last(rows: list[dict], step: int, first: str, manifest) -> list[dict]:
    """The rows of a step, with the `name` of the label in their column `first`, if it has one."""
    names = {f"{kind}{label}": {"name": name} for label, name in manifest.label_names.items()
             for kind in ("", "label")}
    return [row | names.get(str(row[first]), {}) for row in rows if row["step"] == step]


def _balance(writer: Writer, softest: float) -> float:
    """Entry `balance`; zero where all forces are rounding, beside what it takes to deform bodies of
    the shear modulus `softest` by their displacements.
    """
    least = ROUNDED * softest * max(writer.record.displacements, default=0.0)
    return writer.balance if writer.largest_forces > least else 0.0


def _softest(problem: Problem) -> float:
    """The smallest shear modulus of the bodies; collective."""
    own = [sub.elasticity[:, 2, 2].min() for sub in problem.structure.subdomains]
    return min(problem.operator.comm.allgather(min(own, default=np.inf)))


def _cycles(cycles, rows: list[dict]) -> dict:
    """Entry `cycles`."""
    number, after = rows[-1]["cycle"], None
    for row in reversed(rows):
        if not row["settled"]:
            break
        after = row["cycle"]
    return {"start": float(cycles.times[-1] - cycles.period), "period": cycles.period,
            "number": number, "skipped": sum(row["skipped"] for row in rows),
            "settled_after": after, "error": sum(row["error"] for row in rows), "last": rows[-1]}


def write(directory: Path, summary: Summary, comm) -> None:
    """Write the file on rank 0; collective. Raises InputError if it cannot be written."""
    with agreed_writes(comm):
        if comm.rank == 0:
            write_json(directory / FILE, summary.entries())


def largest_memory(comm) -> float:
    """Sum of the peak memory of all ranks so far, in MiB; collective."""
    return comm.allreduce(memory_used())


def reference() -> list[dict[str, str]]:
    """A row {entry, unit, meaning} an entry, nested ones with a dot, for the documentation."""
    rows = []
    for item in fields(Summary):
        meanings = {item.name: item.metadata["meaning"]}
        parts = item.metadata["parts"]
        if item.type is Sizes:
            parts = {part.name: part.metadata["meaning"] for part in fields(Sizes)}
        meanings |= {f"{item.name}.{name}": meaning for name, meaning in parts.items()}
        rows += [{"entry": name, "unit": item.metadata["unit"], "meaning": meaning}
                 for name, meaning in meanings.items()]
    return rows


def _loads(problem: Problem) -> list[dict]:
    """Entry `loads`; collective."""
    subs = problem.structure.subdomains
    own = np.zeros((len(subs), problem.structure.patterns, 2))
    for s, sub in enumerate(subs):
        for k, load in enumerate(sub.loads):
            own[s, k] = np.bincount(sub.dof_component, load, minlength=2)
    own = np.concatenate(problem.operator.comm.allgather(own))
    bodies = problem.structure.travel.bodies
    of_body = np.zeros((len(bodies.size), *own.shape[1:]))
    np.add.at(of_body, bodies.number, own)
    return [{"effect": pattern["kind"], "number": pattern["amplitude"],
             "force": of_body[:, k].sum(axis=0).tolist(), "bodies": of_body[:, k].tolist()}
            for k, pattern in enumerate(problem.manifest.patterns)]


def _motions(contact) -> dict:
    """Entry `obstacle_motion`."""
    own = ~contact.paired
    moving = {str(label): contact.motion.histories(np.flatnonzero(own & (contact.label == label)))
              for label in np.unique(contact.label[own]).tolist()}
    return {label: histories for label, histories in moving.items() if histories}


def _ledger(problem: Problem, sizes: Sizes, solver: QuasistaticSolver, writer: Writer) -> dict:
    """Which declared effects mattered and what they cost; collective."""
    structure = problem.structure
    largest = np.zeros(structure.patterns)
    for k in range(len(largest)):
        for sub in structure.subdomains:
            for values in (sub.loads, sub.fixed_values):
                largest[k] = max(largest[k], np.abs(values[k]).max(initial=0))
    largest = np.max(writer.operator.comm.allgather(largest), axis=0)
    return ledger(solver, asdict(sizes), problem.manifest.factors, largest, writer.history_rows)


def _versions() -> dict:
    from petsc4py import PETSc

    return {"suite": version(), "python": sys.version.split()[0], "numpy": np.__version__,
            "petsc": ".".join(map(str, PETSc.Sys.getVersion()))}
