"""Effects: what a scene can declare is one module here and one include in edp/lib/effects.

A module is imported only for a scene that declares it. Its class `Room`, an `Effect`, overrides
what the effect adds: to the conditions at the contact nodes, to the start, to what is carried from
step to step, to the quantities, the ledger and the estimates of a run. What it does not override
adds nothing and costs nothing. The FreeFEM part, in which the scene's macros become load patterns,
nodal columns and entries of the manifest, has the same file name.
"""

import functools
import importlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..contact.law import ContactLaw
from ..errors import InputError

# how well the error in the energy norm is known with an effect: what its room may say.
# ESTIMATE: by smoothed stresses
BOUND, ESTIMATE, NONE = "bound", "estimate", "none"
NO_STEP = "no step was kept"  # reason in the ledger


@dataclass(frozen=True)
class RunFacts:
    """What the ledger of a finished run is made from.

    `sizes` the counts of dual rows as in summary.json, `amplitudes` (steps + 1, patterns),
    `largest` (patterns,) the largest nodal value of every load pattern, `nodes` the columns
    nodes_open, nodes_stick, nodes_slip of history.csv (steps,), empty if no step was kept,
    `seconds` the wall time that products for contact, friction and history took, `gap` and
    `initial` whether any contact node starts away from its obstacle, or displaced; `homogeneous`
    whether a solution under twice the load is twice the solution.
    """

    sizes: dict[str, int]
    amplitudes: np.ndarray
    largest: np.ndarray
    nodes: dict[str, np.ndarray]
    seconds: dict[str, float]
    gap: bool
    initial: bool
    homogeneous: bool

    @property
    def steps(self) -> int:
        """Number of steps that were kept."""
        return len(self.nodes["open"])

    def most(self, *states: str) -> int:
        """Largest number of nodes in one of `states` (open, stick, slip) at the end of a step."""
        return int(max(sum(self.nodes[state] for state in states), default=0))

    def touched(self) -> tuple[bool | None, str]:
        """Of an effect that open nodes do not know: whether it was active, and the reason."""
        return self._where("touched", "stick", "slip")

    def slipped(self) -> tuple[bool | None, str]:
        """The same of an effect that only nodes which slide know."""
        return self._where("slipped", "slip")

    def in_every_step(self, reason: str) -> tuple[bool | None, str]:
        """The same of an effect that no state of a node switches off."""
        return (True, reason) if self.steps else (None, NO_STEP)

    def _where(self, did: str, *states: str) -> tuple[bool | None, str]:
        if not self.steps:
            return None, NO_STEP
        count = self.most(*states)
        return bool(count), f"nodes that {did}: {count} at most" if count else f"nothing {did}"


def entry(active: bool | None, reason: str, unknowns: int = 0,
          seconds: float | None = None, declared: bool = True) -> dict:
    """Ledger entry of an effect; `active` is None where no step was kept."""
    return {"declared": declared, "active": active, "reason": reason, "unknowns": int(unknowns),
            "seconds": seconds}


UNDECLARED = entry(False, "not declared", 0, 0.0, declared=False)
# entries of the ledger that are there in every run
COMMON = ("contact", "friction", "gap", "time", "load", "displacement", "body_force")


class Effect:
    """An effect that a scene declares, with the data that its export has of it.

    Arrays of contact nodes have the length n_c of the ContactBoundary.
    """

    frictional = False  # adds tangential rows
    changes_coefficient = False  # the friction coefficient depends on the state
    closes = False  # nodes yield by a law of their force and slip, see march/closure.py
    one_node_a_vertex = False  # contact nodes are made by place, not by direction
    labelled = False  # its data name boundaries of the mesh
    # function that gives (n_c, 2) normals of obstacles for nodal columns and the body's normals
    # (n_c, 2), NaN where these stay; as long as the part of the dual segment that counts along them
    obstacle_normals = None
    # the step at which a part of the history begins that is repeated, and how often it is there
    repeats: tuple[int, int] | None = None
    # quantities of interest that it gives sense to, see results/quantities.py
    quantities: tuple[str, ...] = ()
    # those that it leaves without a limit under refinement, where they belong to its places
    unlimited: tuple[str, ...] = ()
    # entries of `effects` in summary.json that differ from those of a scene without it
    summary: dict[str, str | bool] = {}
    # how well the error in the energy norm is known with it, and why no better
    estimates, why = BOUND, ""

    def __init__(self, name: str, manifest):
        """`name` of the room in `manifest.rooms`. Raises InputError for data that make no sense."""
        self.name, self.manifest, self.data = name, manifest, manifest.rooms[name]
        kinds = [pattern["kind"] for pattern in manifest.patterns]
        self.patterns = [number for number, kind in enumerate(kinds) if kind == name]
        labels = self.data.get("labels") if self.labelled else []
        if not isinstance(labels, list) or any(k not in manifest.labels for k in labels):
            known = ", ".join(map(str, manifest.labels))
            raise InputError(f"the labels of {name} are none of the mesh, which has {known}")

    # ---- what it adds to the problem ------------------------------------------------------------
    def distance(self, columns: dict[str, np.ndarray]) -> np.ndarray | None:
        """(n_c,) distance to what the nodes meet, from the nodal columns of the export."""

    def motion(self, nodes, distance: np.ndarray):
        """The ObstacleMotion of the contact `nodes`, whose distance is `distance` (n,) else."""

    def following(self, nodes, motion):
        """The Following of the contact `nodes` and their ObstacleMotion; contact/following.py."""

    def paired_sides(self, subdomains, fixed, comm, moved=None):
        """Boundaries of two bodies that meet; see contact/pair_sides.py."""

    def joints(self) -> list:
        """Boundaries that it joins for good: Joint of contact/joints.py."""
        return []

    def friction_coefficient(self, contact) -> np.ndarray | None:
        """(n_c,) F of the friction bound F |lambda_n|, by columns, weight, label, xy, normal."""

    def friction_offset(self, contact) -> np.ndarray | None:
        """(n_c,) nodal force of the friction bound that needs no pressure, by the same."""

    def pulls(self, contact) -> np.ndarray | None:
        """(n_c,) whether contact pulls as well: the node does not lift off."""

    def compliance(self, contact) -> np.ndarray | None:
        """(n_c,) by how much a node yields in its normal direction per nodal force."""

    def yields(self, contact) -> np.ndarray | None:
        """(n_c,) whether the node's surface gives way under pressure, by whatever law."""

    def initial_displacement(self, contact) -> np.ndarray | None:
        """(n_c,) tangential displacement at time 0."""

    def before_first_step(self, solver) -> None:
        """Find the state from which the QuasistaticSolver `solver` starts. Raises DriverError."""

    def coefficient_factor(self, nodes, u_t, last) -> np.ndarray:
        """(j,) factor of the coefficient at displacements u_t, `last` those of the step before."""
        raise NotImplementedError

    def largest_factor(self, nodes) -> np.ndarray:
        """(j,) the largest such factor that the step at hand may end with."""
        raise NotImplementedError

    # ---- laws by which nodes yield, where it `closes` (march/closure.py) ------------------------
    def worn(self, nodes: np.ndarray) -> np.ndarray:
        """(k,) by how much the gap of the contact `nodes` (k,) has grown in the steps before."""
        return np.zeros(len(nodes))

    def closure(self, nodes, force, slip) -> np.ndarray:
        """(k,) by how much `nodes` yield under normal forces (k,) and slips (k,) of the step."""
        raise NotImplementedError

    def reach(self, nodes, force, own) -> float:
        """Size of the closures `own` (k,), whose largest over the ranks `tangent` gets."""
        return 0.0

    def tangent(self, nodes, force, own, slip, reach) -> tuple[np.ndarray, np.ndarray]:
        """Slope and offset (k,) of the law about forces or the closures `own` (k,)."""
        raise NotImplementedError

    # ---- what it carries from step to step ------------------------------------------------------
    def prepare(self, contact) -> None:
        """Allocate what is carried; a solver has effects of its own."""

    def about(self, contact) -> None:
        """Take another geometry of contact, where it follows the motion."""

    def carried(self) -> dict[str, np.ndarray]:
        """Arrays (n_c,) by name, no copies: checkpoints fill them, at nodes as of `step_ends`."""
        return {}

    def step_ends(self, nodes: np.ndarray, slip: np.ndarray, force: np.ndarray) -> None:
        """A step ended: `nodes` (j,) with tangential rows slid by `slip` under normal `force`."""

    def no_estimate(self, weights: np.ndarray) -> str:
        """Why the error in the energy norm has no estimate under the pattern factors `weights`."""
        return self.why if self.estimates == NONE else ""

    # ---- what it says after the run -------------------------------------------------------------
    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Entries of the ledger by name: was the effect active, and what did it cost."""
        return {}


class LoadEffect(Effect):
    """An effect whose load patterns multiply an amplitude; `heading` is its entry in the ledger."""

    heading = "load"

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any pattern is not zero at every step."""
        active = any(facts.amplitudes[:, k].any() and facts.largest[k] > 0 for k in self.patterns)
        count = len(self.patterns)
        reason = f"{count} pattern{'s' if count > 1 else ''}" if active else "is zero at every step"
        return {self.heading: entry(active, reason)}


class Effects:
    """The declared effects of a scene, in the order of their declaration."""

    def __init__(self, manifest):
        """Imports the declared rooms. Raises InputError for one that the driver does not have."""
        self.rooms = {name: _room(name, manifest) for name in manifest.rooms}
        self.contact = bool(manifest.contact_labels)
        self.frictional = any(room.frictional for room in self)
        self.coefficient_changes = any(room.changes_coefficient for room in self)
        self.closes = any(room.closes for room in self)
        self.one_node_a_vertex = any(room.one_node_a_vertex for room in self)
        self.obstacle_normals = _first(room.obstacle_normals for room in self)
        self.repeats = next((room.repeats for room in self if room.repeats), None)
        self.quasistatic = manifest.quasistatic
        self.bodies = manifest.bodies

    def __iter__(self) -> Iterator[Effect]:
        return iter(self.rooms.values())

    def __contains__(self, name: str) -> bool:
        return name in self.rooms

    @property
    def summary(self) -> dict:
        """Entry `effects` of summary.json."""
        entries = {"contact": "none", "friction": "none",
                   "time": "quasistatic" if self.quasistatic else "static",
                   "body_force": False, "bodies": self.bodies}
        for room in self:
            entries |= room.summary
        return entries

    @property
    def pressure_bounds_friction(self) -> bool:
        """Whether friction depends on the pressure (Coulomb's law): a step is a fixed point."""
        none = Effect.friction_coefficient
        return any(type(room).friction_coefficient is not none for room in self)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Quantities of interest that the effects give sense to, the largest displacement last."""
        names = dict.fromkeys(name for room in self for name in room.quantities)
        return (*names, "displacement")

    def distance(self, columns: dict[str, np.ndarray], count: int) -> np.ndarray:
        """(count,) distance of the contact nodes to what they meet, zero if none is declared."""
        distance = _sum(room.distance(columns) for room in self)
        return np.zeros(count) if distance is None else distance.copy()

    def motion(self, nodes, distance: np.ndarray):
        """The ObstacleMotion of contact nodes (n,), see Effect; None where no obstacle moves."""
        return _first(room.motion(nodes, distance) for room in self)

    def following(self, nodes, motion):
        """The Following of contact nodes, None where their geometry is that of the start."""
        return _first(room.following(nodes, motion) for room in self)

    def paired_sides(self, subdomains, fixed, comm, moved=None):
        """The PairSides of contact/pair_sides.py, None without pairs; collective."""
        return _first(room.paired_sides(subdomains, fixed, comm, moved) for room in self)

    @property
    def joints(self) -> list:
        """Boundaries joined for good, in the order of their declaration."""
        return [joint for room in self for joint in room.joints()]

    def contact_law(self, contact) -> ContactLaw:
        """Friction coefficients and bounds at the contact nodes."""
        coefficient = _sum(room.friction_coefficient(contact) for room in self)
        pulls = _sum(room.pulls(contact) for room in self)
        pulls = np.zeros(len(contact.weight), bool) if pulls is None else pulls
        if contact.joined:
            pulls = pulls | contact.is_joint
        offset = _sum(room.friction_offset(contact) for room in self)
        if offset is not None and contact.covered is not None:
            offset = offset * contact.covered
        return ContactLaw(coefficient, offset, pulls)

    def initial_displacement(self, contact) -> np.ndarray:
        """(n_c,) tangential displacement at time 0, zero if none is declared."""
        initial = _sum(room.initial_displacement(contact) for room in self)
        return np.zeros(len(contact.gid)) if initial is None else initial

    def compliance(self, contact) -> np.ndarray | None:
        """(n_c,) what the nodes yield per nodal force, None where nothing does."""
        return _sum(room.compliance(contact) for room in self)

    def yields(self, contact) -> np.ndarray:
        """(n_c,) whether the nodes' surfaces give way under pressure."""
        yields = _sum(room.yields(contact) for room in self)
        return np.zeros(len(contact.gid), bool) if yields is None else yields

    def homogeneous(self, contact, initial: np.ndarray) -> bool:
        """Whether twice the load has twice the solution; `initial` (n_c,): u_t at time 0."""
        law = self.contact_law(contact)
        return (law.offset is None and not self.coefficient_changes and not self.closes
                and contact.motion is None and contact.following is None
                and not contact.gap.any() and not initial.any())

    def before_first_step(self, solver) -> None:
        """Let every effect find the state from which `solver` starts. Raises DriverError."""
        for room in self:
            room.before_first_step(solver)

    def coefficient_factor(self, nodes, u_t, last) -> np.ndarray:
        """(j,) factor of the friction coefficients; see Effect."""
        return np.prod([room.coefficient_factor(nodes, u_t, last) for room in self._changing],
                       axis=0)

    def largest_factor(self, nodes) -> np.ndarray:
        """(j,) the largest factor that the step at hand may end with; see Effect."""
        return np.prod([room.largest_factor(nodes) for room in self._changing], axis=0)

    @property
    def unlimited(self) -> tuple[str, ...]:
        """Quantities that may have no limit under refinement."""
        return tuple(name for room in self for name in room.unlimited)

    @property
    def _changing(self) -> list[Effect]:
        """The effects that change friction coefficients."""
        return [room for room in self if room.changes_coefficient]

    def prepare(self, contact) -> None:
        """Allocate what effects carry from step to step."""
        for room in self:
            room.prepare(contact)

    def carried(self) -> dict[str, np.ndarray]:
        """Arrays (n_c,) that effects carry from step to step, by a name that holds the room's."""
        return {f"{room.name}.{name}": values
                for room in self for name, values in room.carried().items()}

    def step_ends(self, nodes: np.ndarray, slip: np.ndarray, force: np.ndarray) -> None:
        """A step ended; see Effect."""
        for room in self:
            room.step_ends(nodes, slip, force)

    def no_bound(self) -> str:
        """Why smoothed stresses estimate the error in the energy norm, which nothing bounds."""
        return next((room.why for room in self if room.estimates == ESTIMATE), "")

    def no_estimate(self, weights: np.ndarray) -> str:
        """Why the error in the energy norm has no estimate under the pattern factors `weights`."""
        return next(filter(None, (room.no_estimate(weights) for room in self)), "")

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Entries {declared, active, reason, unknowns, seconds}, common effects always included."""
        entries = dict.fromkeys(COMMON, UNDECLARED)
        for room in self:
            for name, own in room.ledger(facts).items():
                known = entries.get(name, UNDECLARED)
                entries[name] = own if not known["declared"] or own["active"] else known
        return entries


def _room(name: str, manifest) -> Effect:
    """The effect `name`, imported."""
    try:
        module = importlib.import_module(f"{__name__}.{name}")
    except ModuleNotFoundError as problem:
        if problem.name != f"{__name__}.{name}":
            raise
        raise InputError(f"the scene declares {name}, which driver/effects lacks") from None
    return module.Room(name, manifest)


def _first(parts):
    """The first that is not None, None if there is none."""
    return next((part for part in parts if part is not None), None)


def _sum(parts) -> np.ndarray | None:
    """Sum of the arrays that are not None; None if there is none."""
    given = [part for part in parts if part is not None]
    return functools.reduce(np.add, given) if given else None
