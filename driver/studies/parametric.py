"""The SPMD part of a study: the values of one parameter, solved on one export."""

import dataclasses
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..contact.nodes import contact_table, merge_parts
from ..effects import Effects
from ..errors import DriverError, InputError, NotConverged, agree
from ..feti.compliance import ContactCompliance
from ..files import write_json
from ..march.problem import assemble
from ..options import Settings
from ..runs import launch
from ..runs.request import Request
from ..scene.compared import asked_elsewhere
from ..scene.manifest import Manifest, read_manifest
from ..scene.study_value import Value, read_value
from ..timing import Laps
from . import outcomes as outcomes_files
from . import value_chains, value_run
from .load_values import LoadValues, unvaried

LARGEST = 2000  # contact rows beyond which the condensation takes longer than a hundred runs save


def run(directory: Path, request: Request, comm) -> tuple[int, str]:
    """Solve all values on the ranks of `comm` and write the files; exit status and reason.

    Raises DriverError.
    """
    lap = Laps(request.seconds)
    seconds = lap.seconds
    manifest, settings = read_manifest(directory / "export"), Settings(**request.settings)
    if not manifest.contact_labels:
        raise InputError(
            "a study needs a scene with contact: without it the response is linear in its loads")
    if settings.linearization != "initial":
        raise InputError("a study keeps one geometry of contact: leave LINEARIZATION out")
    if "jump" in settings.cycles:
        raise InputError("a study goes through all cycles: make single runs with CYCLES=\"jump\"")
    values = _values(directory, request, manifest, comm)
    problem, loads = _problem(directory / "export", request.study,
                              [value for _, value in values], comm, lap)
    structure, operator = problem.structure, problem.operator
    values = [(loads.history(k, own, problem.manifest), value)
              for k, (own, value) in enumerate(values)]
    lap("setup")
    prescribed = value_run.Prescribed.of(problem, settings)
    condensed = _condenses(structure)
    if condensed:
        try:
            operator = ContactCompliance(operator)
        except NotConverged:  # on all ranks
            condensed = False
    lap("condense")
    problem = dataclasses.replace(problem, operator=operator)
    apart = condensed or problem.operator.comm.size < comm.size
    outcomes = _outcomes(problem, settings, values, request, (apart, prescribed), comm)
    lap("solve")
    failed = [k for k, outcome in enumerate(outcomes) if outcome.status]
    status = max((outcome.status for outcome in outcomes), default=0)
    name, reason = request.study.upper(), ""
    if failed:
        reason = (f"{len(failed)} of {len(outcomes)} values did not converge, the first "
                  f"{name}={request.values[failed[0]]}: {outcomes[failed[0]].reason}")
    if comm.rank == 0:
        outcomes_files.write(directory, request, structure.contact.declared, outcomes)
        lap("output")
        seconds["total"] = sum(seconds.values())
        products = sum(outcome.row["dual_multiplications"] for outcome in outcomes)
        parameters = {n: v for n, v in manifest.parameters.items() if n != request.study}
        warnings = asked_elsewhere(Path(request.script), manifest)
        warnings += _grouped(name, request.values, outcomes)
        summary = {"scene": request.scene, "study": request.study, "values": len(outcomes),
                   "converged": not failed, "reason": reason,
                   "contact_rows": len(structure.at_contact.row),
                   "condensed": condensed, "warnings": warnings,
                   "counts": {"dual_multiplications": products}, "seconds": seconds,
                   "ranks": comm.size, "units": manifest.units,
                   "parameters": {**parameters, **dataclasses.asdict(settings)}}
        write_json(directory / "summary.json", summary)
    return status, reason


def _problem(export: Path, name: str, values: list[Value], comm, lap) -> tuple:
    """The Problem of all `values` of a parameter, and its LoadValues; collective over `comm`.

    Ranks share the body, or have each the whole of it: where it is not condensed, and too small to
    pay for more than one, it takes values one after the other sooner than in common.
    """
    def on(ranks, lap=lambda stage: None):
        loads = LoadValues(name, values, ranks)
        return assemble(export, ranks, lap, loads.widen), loads

    problem, loads = on(comm, lap)
    structure, small = problem.structure, launch.paid_by(problem.manifest) == 1
    alone = small and structure.contact.following is None and not _condenses(structure)
    if alone and comm.size > 1:
        problem, loads = on(MPI.COMM_SELF)
    return problem, loads


def _condenses(structure) -> bool:
    """Whether a body is condensed to its contact boundary: as far as that pays and can be done."""
    return (len(structure.at_contact.row) <= LARGEST and not structure.rigid_modes
            and structure.contact.following is None)


def _values(directory: Path, request: Request, base: Manifest, comm) -> list:
    """Manifest and Value of every value; collective. Raises InputError as `_check_same`."""
    values, error = [], None
    try:
        for k in range(len(request.values)):
            folder = directory / "values" / str(k)
            value = read_manifest(folder)
            _check_same(request.study, base, value)
            values.append((value, read_value(folder, value)))
    except InputError as refused:
        error = refused
    agree(comm, error)
    return values


def _outcomes(problem, settings, values: list, request: Request,
              how: tuple[bool, value_run.Prescribed], comm) -> list[value_run.Outcome]:
    """All values in their order, solved on all ranks or, if `apart`, in chains on one rank each.

    `values` holds manifest and Value of each, `how` whether `apart`, and what supports prescribe.
    In a chain (value_chains.py) a value starts near the one before. Collective over `comm`. Raises
    DriverError.
    """
    apart, prescribed = how
    structure, solved, error, near = problem.structure, {}, None, None
    count = len(request.values)
    chain = value_chains.length(count)
    mine = [k for k in range(count) if not apart or k // chain % comm.size == comm.rank]
    try:
        for done, k in enumerate(mine, 1):
            manifest, value = values[k]
            effects, whole = Effects(manifest), structure.contact
            if whole.following is not None:
                operator = problem.operator
                _follow(request.study, effects, operator, value, manifest.contact_pairs)
            else:
                contact = _contact_of(request.study, effects, whole, value.contact, value.gid,
                                      manifest.contact_pairs)
                operator = problem.operator.with_contact(contact)
            near = near if k % chain else None
            own = dataclasses.replace(problem, manifest=manifest, operator=operator)
            solved[k], near = value_run.solve(own, settings, near, prescribed)
            _progress(request, comm, k, done, len(mine))
    except DriverError as refused:
        error = refused
    agree(comm, error)
    everyone = {k: outcome for part in comm.allgather(solved) for k, outcome in part.items()}
    return [everyone[k] for k in range(count)]


def _progress(request: Request, comm, k: int, done: int, total: int) -> None:
    """A line about value k, which is number `done` of the rank's `total`, a few times in all."""
    if comm.rank == 0 and not request.quiet and done % max(1, total // 5) == 0:
        share = "" if total == len(request.values) else ", as other ranks do"
        print(f"{request.scene}: {request.study} = {request.values[k]}, {done} of "
              f"{total}{share}", flush=True)


def _check_same(name: str, base, value) -> None:
    """Refuse a value whose manifest differs in what stiffness, loads and rows come from."""
    if list(base.rooms) != list(value.rooms):
        raise unvaried(name, "it changes the scene's effects")
    for part in ("subdomains", "nodes", "patterns", "contact_labels", "material", "plane"):
        if getattr(base, part) != getattr(value, part):
            raise unvaried(name, f"it changes the scene's {part.replace('_', ' ')}")


def _contact_of(name: str, effects, whole, data, gid: np.ndarray, pairs: list):
    """The contact boundary with the columns of one value, read as `data` at the nodes `gid`.

    Nodes, weights and normals of all values are those of the first (study.idp): that later ones
    keep them is what freefem.export_study sees to.
    """
    boundary = whole.declared
    if whole.periods is not None:
        gid = whole.periods.having_conditions(gid, boundary.gid)
    table = contact_table(data, list(data.columns), gid, np.zeros((len(gid), 2)))
    read = merge_parts(table, list(data.columns), pairs, normals=effects.obstacle_normals)
    place = _places(boundary, read)
    rigid = ~boundary.paired  # between two bodies weight, normal and gap follow from both sides
    if not ((place >= 0).all()
            and np.allclose(read.weight[place][rigid], boundary.length[rigid], rtol=1e-9)
            and np.allclose(read.normal[place][rigid], boundary.normal[rigid], atol=1e-9)):
        raise unvaried(name, "it moves or turns the contact boundary")
    columns = {column: values[place] for column, values in read.columns.items()}
    gap = effects.distance(columns, len(place))
    # the geometry's part of a pair's gap stays
    more = np.where(rigid, 0.0, gap - effects.distance(boundary.columns, len(place)))
    if boundary.axisymmetric and len(np.unique(more[~rigid])) > 1:  # rows there are means of nodes
        raise unvaried(name, "it changes pairGap of a body of revolution, and unlike from place to "
                             "place")
    value = dataclasses.replace(boundary, columns=columns, gap=gap)
    motion = effects.motion(value, gap)
    joint = np.flatnonzero(boundary.coupled & rigid)  # beside an axis: rows of several nodes
    if len(joint):
        distance = effects.distance(read.columns, len(read.gid))
        gap[joint] = _of_rows(boundary, read, distance)[joint]
        if motion is not None:
            for now, distance in zip(motion.gap, effects.motion(read, distance).gap):
                now[joint] = _of_rows(boundary, read, distance)[joint]
    gap = np.where(rigid, gap, boundary.gap + more)
    if motion is not None:
        motion.gap = np.where(rigid, motion.gap, boundary.gap + more)
        gap = motion.gap[0]
    return whole.renewed(columns, gap, motion)


def _follow(name: str, effects, operator, value, pairs: list) -> None:
    """Let contact of the operator follow the motion of one value, from the start on."""
    start = operator.structure.contact.start
    old = start.following
    table = contact_table(value.contact, list(value.contact.columns), value.gid,
                          np.zeros((len(value.gid), 2)))
    read = merge_parts(table, list(value.contact.columns), pairs, effects.one_node_a_vertex,
                       normals=effects.obstacle_normals)
    if not (np.array_equal(read.gid, old.nodes.gid)
            and np.allclose(read.weight, old.nodes.weight, rtol=1e-9)):
        raise unvaried(name, "it moves the contact boundary")
    nodes = dataclasses.replace(old.nodes, columns=read.columns)
    gap = effects.distance(read.columns, len(read.gid))
    motion = effects.motion(nodes, gap)
    following = effects.following(nodes, motion)
    first = following.first(dataclasses.replace(old.found, nodes=nodes), gap, old.sides)
    following.joints = old.joints
    following.settle(start)  # rows and corners
    following.settle(following.about(first.about.u, 0.0))
    operator.renew(following.start)
    operator.products = 0


def _of_rows(boundary, read, distance: np.ndarray) -> np.ndarray:
    """(n_c,) sums of the terms of the boundary's rows with the `distance` (n,) of nodes `read`."""
    known = dict(zip(read.gid.tolist(), distance))
    each = boundary.term_value * [known[gid] for gid in boundary.term_gid.tolist()]
    return np.bincount(boundary.term_node, each, minlength=len(boundary.gid))


def _places(boundary, read) -> np.ndarray:
    """(n_c,) places among the nodes `read` of those of the boundary, -1 where there is none.

    Of two nodes at a corner that which faces the same way.
    """
    vertices = {}
    for place, key in enumerate(zip(read.gid.tolist(), read.family.tolist())):
        vertices.setdefault(key, []).append(place)
    places = np.full(len(boundary.gid), -1)
    for node, key in enumerate(zip(boundary.gid.tolist(), boundary.family.tolist())):
        places[node] = max(vertices.get(key, [-1]),
                           key=lambda place: read.normal[place] @ boundary.normal[node])
    return places


def _grouped(name: str, values: list, outcomes: list[value_run.Outcome]) -> list[str]:
    """The warnings of all values of a parameter, each once, with the values that have it."""
    having = {}
    for value, outcome in zip(values, outcomes):
        for line in outcome.warnings:
            having.setdefault(line, []).append(str(value))
    return [f"{name}={','.join(own)}: {line}" for line, own in having.items()]
