"""summary.json, what a run was asked for, what came of it and what it cost.

The entries are the fields of `Summary`, in their order; each carries its unit and meaning, from
which the reference follows. Entries that a run has not (None) are left out.
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
        "displacements of all torn subdomains, constrained ones and repeated corners included")
    dual_dofs: int = entry("multipliers, the sum of the next four")
    dual_gluing: int = entry("multipliers that glue subdomains")
    dual_normal: int = entry("normal contact multipliers")
    dual_tangential: int = entry("tangential contact multipliers")
    dual_joined: int = entry("multipliers of ties and periodic boundaries")
    coarse_dofs: int = entry("unknowns of the coarse problem, those of the corners")
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
    """The entries of summary.json; `parts` of dictionaries are named where these are fixed."""

    scene: str = entry("name of the scene")
    variant: str = entry("its LOADING, if it has any")
    converged: bool = entry("whether every step was solved to the tolerances")
    reason: str = entry("why the run ended early, empty if it did not")
    warnings: list = entry("what to know before the results are used, a sentence each")
    effects: dict = entry("what the scene declares", parts={
        "contact": "none, unilateral, bilateral, or unilateral and bilateral",
        "friction": "none, tresca, coulomb, coulomb and tresca, or coulomb-slip-dependent",
        "time": "static or quasistatic",
        "initial": "preload, where the history starts from a preloaded state",
        "body_force": "whether there is a body force", "bodies": "number of bodies",
        "cycles": "how often the history repeats its cycle, where it does",
        **{name: "true where it is declared" for name in DECLARED}})
    sizes: Sizes = entry("numbers of unknowns")
    steps: int = entry("finished time steps")
    t_end: float = entry("end of the load history", "time")
    counts: dict = entry("work of all steps", parts={
        "fixed_point_iterations": "QPs solved for the fixed point of friction",
        "dual_multiplications": "products with the dual matrix in all time steps",
        "dual_multiplications_setup": "products before it",
        "cg_steps": "CG steps of MPRGP", "expansion_steps": "expansion steps of MPRGP",
        "proportioning_steps": "proportioning steps of MPRGP",
        "contact_block_products": "products with the contact rows' block alone",
        "condensed_steps": "time steps that Newton's method on the contact rows has ended",
        "geometries": "contact geometries in all time steps, where contact follows the motion"})
    residuals: dict = entry(
        "relative residuals of the KKT conditions, worst of all steps; a step has converged with "
        "none above PRIMAL_RTOL, equilibrium none above FRICTION_RTOL", parts={
            "stationarity": "correction of the contact forces by one preconditioned step (where "
                            "gluing rows are eliminated, a step of Newton's method), relative to "
                            "the contact forces; in a step without any, to the largest so far",
            "gluing": "jump between subdomains over the largest deformation delta, the "
                      "displacement of a vertex less the rigid motion of its body, or over a lower "
                      "bound of it by the corners where that is enough; no less than "
                      "1.4e-14/PRIMAL_RTOL of the way of bodies that hardly deform",
            "penetration": "into obstacle or other body, over delta",
            "sign": "pulling normal forces over the largest contact force f of a node",
            "cone": "friction forces above their bound, over f",
            "complementarity": "natural residuals of contact and friction, abs(lambda - "
                               "P(lambda + f/delta move)) / f, P the projection on admissible "
                               "forces, move the penetration or the slip",
            "equilibrium": "forces on bodies that no support holds, over the sum of their sizes",
            "geometry": "where contact follows the motion: distances over delta and contact forces "
                        "over f by which conditions about the solution differ from those used"})
    contraction: float = entry("worst mean ratio of successive changes of a step's fixed point")
    fallbacks: dict = entry("steps that needed another method, by the method's name")
    uniqueness: dict = entry("whether the steps have other solutions", parts={
        "verdict": "unique (proved), not unique, no second solution found or not examined",
        "steps_examined": "number of steps that were examined",
        "steps_not_unique": "numbers of the steps",
        "solutions": "those of the first such step, the one that is followed first: numbers of "
        "nodes that are open, stick and slip, resultants, largest nodal pressure, and the index, a "
        "sign; those of all solutions add up to one"})
    memory_mib: float = entry("largest memory of all ranks together, error estimates "
                              "included", "MiB")
    ranks: int = entry("MPI ranks")
    units: dict = entry("names of the scene's units",
                        parts={"length": "m, mm, ...", "stress": "Pa, MPa, ...",
                               "assumed": "yes, where the scene names none: length and stress are "
                                          "m and Pa then"})
    amplitudes: dict = entry(
        "factors of the loads at the start and after every step, by number of the load; of a "
        "history that is repeated with its cycle once")
    loads: list = entry("resultant of every load at amplitude 1: effect, number of the amplitude, "
                        "force, that on each of the bodies", "stress length")
    points: list = entry("loads and springs at points, but for springs where a foundation is: "
                         "effect, number of the amplitude, place, force at amplitude 1 or "
                         "stiffness in x and y")
    parameters: dict = entry("parameters of the scene and options of the solver")
    versions: dict = entry("of the suite, Python, numpy and PETSc")
    seconds: dict = entry("wall time of the stages", "s", parts={
        "export": "FreeFEM, without what is read and reduced meanwhile",
        "read": "reading its export", "setup": "reduction to the interfaces",
        "solve": "all time steps, those before an interruption included",
        "uniqueness": "search for other solutions of the steps, where there was one",
        "geometry": "renewing contact rows, where contact follows the motion",
        "output": "contact quantities and fields",
        "validity": "checks of the model's assumptions",
        "energy_error": "error in the energy norm", "estimates": "error budget",
        "figures": "figures and animation, but for what is drawn while errors are estimated",
        "start": "programs, packages and ranks starting, and what no other stage counts",
        "total": "the sum: what the user waits for",
        "export_cycles": "FreeFEM in refinement cycles",
        "solve_cycles": "all else in refinement cycles"})
    effects_ledger: dict = entry(
        "for every effect: was it declared, was it active, why, its unknowns and seconds")
    balance: float = entry(
        "resultant of all forces, the largest of the steps, over the sum of their absolute values")
    dissipated: float = entry("work that friction has taken", "stress length^2")
    errors: dict | None = entry("estimated errors", optional=True, parts={
        "energy": "in the energy norm: kind, step, parts, total, norm, relative, largest, "
                  "carrying, excluded",
        "quantities": "budget of every quantity: value, its parts, total, relative",
        "advice": "what would lower the largest part", "notes": "companions that could not be run",
        "adjoint": "quantities with an adjoint problem, the products with the dual matrix that "
                   "all took, the step's error in energy by smoothed stresses (smoothed), or the "
                   "reason why there are none",
        "prices": "of QUANTITY: its error now, and lines with accuracy, settings, predicted "
                  "seconds, seconds_bare (without estimates), memory_mib, and what other kinds of "
                  "meshes would take; or the reason why there are none"})
    materials: list | None = entry("of every body, where the scene gives them body by body: body, "
                                   "name, young, poisson", optional=True)
    cycles: dict | None = entry("of a history that is repeated", optional=True, parts={
        "start": "time at which its cycle begins", "period": "of a cycle",
        "number": "cycles gone through, those jumped over included", "skipped": "of them",
        "settled_after": "cycle from which on all were settled; null if the last is not",
        "error": "by how much all jumps together may err in what grows, a length",
        "last": "row of cycles.csv of the last cycle"})
    quantities: dict | None = entry("quantities of interest", "see below", optional=True)
    quantities_time: float | None = entry("the time they belong to", "time", optional=True)
    obstacle_motion: dict | None = entry(
        "of every label that meets an obstacle which moves: its shift_x, shift_y and angle, as far "
        "as they are not zero, at the start and after every step; where all are, or distances do "
        "not follow from them (gapInTime), the nearest node's distance",
        "length, rad", optional=True)
    periods: list | None = entry("of bodies in pairs that repeat themselves: [x, y] by which",
                                 "length", optional=True)
    boundaries: list | None = entry(
        "rows of boundaries.csv in the last step, where there is contact", "see boundaries.csv",
        optional=True)
    probes: list | None = entry("rows of probes.csv in the last step, where the scene has probes",
                                "see probes.csv", optional=True)
    resumed_after_step: int | None = entry(
        "finished steps of an interrupted run that were taken up", optional=True)
    validity: dict | None = entry("whether the model's assumptions hold", optional=True, parts={
        "largest_strain": "largest principal strain of a triangle",
        "largest_rotation": "largest rotation of a triangle, in rad, less that of a free body",
        "largest_normal_error": "distance of closed nodes from what they meet, at displaced places "
                                "and as used, over the contact length",
        "normal_turn": "angle between the normals there and as used, in rad",
        "largest_swelling": "part of what a body between others is squeezed by that comes of its "
                            "turning alone",
        "largest_slide": "way of closed nodes along another body since the start, over the "
                         "contact length; 0 where contact follows it",
        "overlaps": "[label, label, depth over the body's size] of boundaries without declared "
                    "contact that penetrate",
        "verdict": "ok, questionable or invalid", "reason": "why, where and what to do"})
    accuracy: dict | None = entry("of ACCURACY=", optional=True, parts={
        "quantity": "whose error was asked for", "asked": "relative error asked for",
        "reached": "estimated relative error", "settings": "options that give the same run by hand",
        "levels": "meshes that were tried", "products": "with the dual matrix in all runs"})

    def entries(self) -> dict:
        """As they stand in the file."""
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
                *omissions.far_moves(structure, writer.record.displacements),
                *omissions.far_gaps(structure, problem.effects.rooms),
                *omissions.held_loads(structure, manifest, problem.operator.comm),
                *omissions.support_jumps(structure.support_jumps),
                *omissions.without_wear(writer.record), *omissions.held_inside(writer.record),
                *(writer.probes.warnings if writer.probes else [])]
    if optional.get("validity") and optional["validity"]["verdict"] != "ok":
        doubt = optional["validity"]
        warnings.append(f"results are {doubt['verdict']}: {doubt['reason']}")
    if failure:
        warnings.append(str(failure))
    if manifest.materials:
        optional["materials"] = manifest.materials
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
            optional["boundaries"] = [row for row in writer.boundary_rows if row["step"] == last]
        if writer.probes is not None:
            optional["probes"] = [row for row in writer.probes.rows if row["step"] == last]
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
    """MiB that the ranks have used at most, so far, added up; collective."""
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
