"""The steps of a run at the contact nodes, for its quantities of interest."""

import numpy as np

from ..contact.states import ContactField
from ..feti.nodal import NodalFields
from ..feti.operator import DualOperator
from ..march.quasistatic import QuasistaticSolver
from ..march.step import Step
from ..quantity_table import OF_FORCES
from . import dissipation
from .contact_state import WEAR, ContactState, less_wear
from .contact_edges import NODES, chains, contact_length
from .material_corners import material_corners
from .quantities import (REPEATS, farthest_node, largest_pressure, of_moment, peak_nodes,
                         quantities, singular_places)
from .shares import label_shares
from .smooth_ends import smooth_ends
from .touch import Touch, of_arrivals, slid_on_arrival

ROUND = 1e-6  # change of normals along a boundary that is not straight
INSIDE = 1e-2  # of the largest displacement: depth of a clamped place inside what it meets


def is_straight(places: np.ndarray) -> bool:
    """Whether `places` (n, 2) lie on a line; fewer than three do not tell."""
    if len(places) < 3:
        return False
    along, across = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[:2]
    return bool(across <= ROUND * along)


class Record:
    """The steps of a run at the contact nodes, on every rank; collective."""

    def __init__(self, operator: DualOperator, solver: QuasistaticSolver):
        self.operator, self.effects = operator, solver.effects
        self.contact = ContactState(operator, solver)
        self.labels, self.shares = label_shares(operator.structure)
        # (n_c,) which end their boundary where the outline goes on
        self.smooth_end = smooth_ends(operator.structure, {
            name: getattr(self.contact.boundary, name) for name in NODES}, operator.comm)
        self.material_corner = material_corners(operator.structure, operator.comm)
        more = [] if self.contact.worn is None else [WEAR]
        # one array (n_c,) a step, gap besides
        self.states = {name: [] for name in (*ContactField, *more)}
        self.gaps = []
        self.normals = []  # (n_c, 2) a step, where contact follows the motion
        self.displacements = []  # the largest of the body, one number a step
        # (n_k,) a step: how deep clamped nodes, and then those of pairs that supports hold, are
        # inside what they meet
        self.inside = []
        self._nodal = None  # gids and displacements of what these meet
        self.work = []  # of friction, one array (n_c,) a step, in cycles jumped over too
        self.dissipated = 0.0  # all of it
        # how often steps are gone through, where cycles are jumped over, and work of each cycle
        self.repeats, self.cycle_work = [], []
        self.cycles, self.jumped = solver.cycles, 0.0  # time
        b = self.contact.boundary
        self.dissipation = None
        if self.effects.frictional:
            self.dissipation = dissipation.of_run(solver, self.contact.law, b)

    def add(self, step: Step) -> tuple[list[np.ndarray], dict[str, np.ndarray]]:
        """Displacements (dofs,) of the rank's subdomains, less travel, and the contact state."""
        self.operator.follow(step)
        fields = self.operator.deformations(step.multipliers, step.weights, refined=step.refined)
        state = self.contact.evaluate(step, fields)
        boundary = self.contact.boundary
        now = boundary.at(step.time)
        self.gaps.append(now.gap)
        if boundary.following is not None:
            self.normals.append(boundary.normal)
        for name, column in self.states.items():
            column.append(state[name])
        if self.dissipation:
            bare = less_wear(state)
            self.work.append(self.dissipation.add(step.time - self.jumped, bare,
                                                  self.gaps[-1]))
            self.dissipated += float(self.work[-1].sum())
        if self.cycles is not None:
            self._count(step)
        whole = self.operator.with_travel(fields, step.weights)
        squares = np.concatenate([np.zeros(2), *whole]).reshape(-1, 2) ** 2
        largest = float(np.sqrt(squares.sum(axis=1).max()))
        self.displacements.append(max(self.operator.comm.allgather(largest)))
        clamped = now.clamped
        moved = clamped.values @ step.weights[: clamped.values.shape[2]]
        self.inside.append(np.append((moved * clamped.normal).sum(axis=1) - clamped.gap,
                                     self._inside_of_pairs(whole)))
        return fields, state

    def _inside_of_pairs(self, whole: list[np.ndarray]) -> np.ndarray:
        """(m,) how deep the nodes of HeldInPairs, if any, are inside what they meet; `whole`
        (dofs,) displacements of the rank's subdomains. Collective.
        """
        boundary = self.contact.boundary
        held, following = boundary.held, boundary.following
        if held is None:
            return np.zeros(0)
        if self._nodal is None:
            gids = np.unique(held.term_gid) if following is None else following.gids
            self._nodal = gids, NodalFields(self.operator.structure, gids, self.operator.comm)
        gids, nodal = self._nodal
        u = nodal(whole)[np.searchsorted(gids, held.term_gid)]
        along = held.term_value * (held.normal[held.term_node] * u).sum(axis=1)
        return np.bincount(held.term_node, along, len(held.gap)) - held.gap

    def _count(self, step: Step) -> None:
        """The steps of a cycle before a jump are gone through in all the cycles jumped over."""
        self.repeats.append(1.0)
        if step.cycle:
            own = slice(-self.cycles.length, None)
            self.cycle_work.append(float(np.sum(self.work[own])))
            self.dissipated += step.skips * self.cycle_work[-1]
            self.jumped += step.skips * self.cycles.period
            if step.skips:
                self.repeats[own] = [1.0 + step.skips] * self.cycles.length
                self.work[own] = [(1.0 + step.skips) * work for work in self.work[own]]

    @property
    def counted(self) -> dict[str, np.ndarray]:
        """Column REPEATS (steps, n_c) of quantities.py, where cycles are jumped over."""
        if not any(repeats > 1 for repeats in self.repeats):
            return {}
        nodes = len(self.contact.boundary.gid)
        return {REPEATS: np.repeat(np.array(self.repeats)[:, None], nodes, axis=1)}

    def quantities(self) -> tuple[dict[str, float], int]:
        """Quantities of interest, and the index in the record of the step that they belong to."""
        return quantities(self.effects, *self._columns(), self.displacements)

    def beside(self, index: int) -> list[dict[str, float]]:
        """Quantities of one moment in the steps before, with and after an index; zero at the start.
        """
        columns, last = self._columns(), len(self.displacements) - 1
        found = [of_moment(self.effects, *columns, np.array(self.displacements), k)
                 for k in range(max(index - 1, 0), min(index + 1, last) + 1)]
        return found if index else [dict.fromkeys(found[0], 0.0), *found]

    def state(self, index: int) -> dict[str, np.ndarray]:
        """Arrays (n_c,) of every `ContactField` in the step with an index in the record."""
        return {name: column[index] for name, column in self.states.items()}

    def signed_shares(self, name: str, index: int) -> np.ndarray:
        """(n_c,) by which tractions times weights add up to a resultant, up to its sign.

        `name`: normal_resultant or tangential_resultant.
        """
        field = "sigma_n" if name == "normal_resultant" else "sigma_t"
        forces = self.shares @ (self.states[field][index] * self.contact.boundary.weight)
        return np.where(forces < 0, -1.0, 1.0) @ self.shares

    def largest_pressure(self) -> float:
        """That of the last step so far, as of a scene's quantities."""
        nodes = self.nodes()
        return largest_pressure(nodes, chains(nodes), self.states["sigma_n"][-1])

    def contact_length(self) -> float:
        """That of the last step so far, as of a scene's quantities."""
        if not self.effects.contact:
            return 0.0
        nodes, step = self._columns(slice(-1, None))
        return contact_length(nodes, chains(nodes), step, 0)

    def peak_nodes(self, index: int) -> np.ndarray:
        """Nodes of the largest pressure: the one that has it, and its neighbours in contact."""
        return peak_nodes(*self._columns(), index)

    def farthest_node(self, index: int) -> int:
        """Node that has slid farthest in contact until a step."""
        return farthest_node(self._columns()[1], index)

    def touch(self, index: int) -> Touch:
        """How the nodes touch in a step; without contact they do not."""
        if not self.effects.contact:
            return Touch(open={})
        return Touch.of(*self._columns(), index, self._pressing_round(index),
                        self._on_straight_sides(index))

    def arrivals(self) -> float:
        """What the steps leave open of the largest slip, see touch.of_arrivals."""
        return of_arrivals(*self._columns())

    def slid_on_arrival(self) -> float:
        """Part of the farthest way that was made in steps in which the node first touched."""
        return slid_on_arrival(*self._columns())

    def open_work(self) -> float:
        """Of friction's work in a single step, what it leaves open where nodes first touch."""
        return self.dissipation.open if self.dissipation else 0.0

    def _pressing_round(self, index: int) -> int:
        """How many nodes press in a step, if some belong to a boundary whose normal varies."""
        b, presses = self.contact.boundary, self.states["sigma_n"][index] < 0
        turns = [np.ptp(b.normal[b.chain == chain], axis=0).max() > ROUND
                 for chain in np.unique(b.chain[presses])]
        return int(presses.sum()) if any(turns) else 0

    def _on_straight_sides(self, index: int) -> bool:
        """Whether all that press in a step belong to straight boundaries and meet obstacles, be
        these round: no polygon stands for a curve then.
        """
        b, presses = self.contact.boundary, self.states["sigma_n"][index] < 0
        lines = [b.xy[b.chain == chain] for chain in np.unique(b.chain[presses])]
        return not b.paired[presses].any() and all(map(is_straight, lines))

    def singular_places(self) -> tuple[str, ...]:
        """Names of the quantities whose values belong to places where they may be infinite.

        Where contact moves the boundary beside a place that a support holds the displacement jumps,
        and pressure falls from there like the inverse of the distance: forces have no limit.
        Where it holds a place of a pair the other body yields, by less and less, like the inverse
        of the logarithm of the element's size: no mesh is near the limit.
        """
        if not self.effects.contact:
            return self.effects.unlimited
        index = self.quantities()[1]
        of_contact = singular_places(*self._columns(), index)
        if self.held_inside()[index].any():
            of_contact = OF_FORCES
        return (*of_contact, *self.effects.unlimited)

    def held_inside(self) -> np.ndarray:
        """(steps, n_k) whether a support holds nodes without condition inside what they meet."""
        return np.array(self.inside) > INSIDE * np.array(self.displacements)[:, None]

    def nodes(self) -> dict:
        """Columns of the nodes, as quantities.py takes them."""
        b = self.contact.boundary
        driven = np.full(len(b.gid), b.motion is not None and b.following is None) & ~b.paired
        return ({name: getattr(b, name) for name in NODES}
                | {"shares": self.shares, "smooth_end": self.smooth_end, "driven": driven,
                   "material_corner": self.material_corner})

    def _columns(self, which: slice = slice(None)) -> tuple[dict, dict]:
        """Columns of the nodes and of the steps, or some of them, as quantities.py takes them."""
        steps = less_wear({name: np.array(column[which]) for name, column in self.states.items()})
        steps |= {"work": np.array(self.work[which])}
        steps |= {name: column[which] for name, column in self.counted.items()}
        if self.contact.boundary.moves:
            steps["gap"] = np.array(self.gaps[which])
        return self.nodes(), steps
