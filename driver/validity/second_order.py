"""What rotations that are taken for small leave out, and how bodies answer to it.

Let a gradient d[j, k] = d u_k / d x_j be e + W, its strain and its rotation. To second order bodies
are stretched (Biot's strain, linear in the length of a straight bar) by

    e + Q(d, d) / 2,      Q(d, g) = w_d w_g I + (W_d e_g - e_g W_d + W_g e_d - e_d W_g) / 2,

w_d the angle of W_d, so that a linear solution u with the stress s leaves forces unbalanced:

    second order    r(v) = int C Q(d, d)/2 : e(v) + s : Q(d, grad v)
    third order     int C Q(d, g) : e(v) + s : Q(g, grad v) + C (e(w) + Q(d, d)/2) : Q(d, grad v)

with the answer w to -r and g = grad w. Answers are linear solutions with contact as it is at the
end of the step (march/frozen_state.py): the beginning of Koiter's series for finite rotations. What
stays are loads, normals, Hooke's law, and terms of third order that are smaller by the strain. It
knows what a strain or an angle does not tell: a shallow cone or arch, whose height changes, a beam
whose ends cannot come nearer, a strut near its buckling load all have small strains and rotations,
and forces that are wrong by as much as they have. Where a body bends freely w takes off what
turning lengthens it by, and little is left.
"""

from dataclasses import dataclass

import numpy as np

from ..contact.states import STICK
from ..feti.gathering import largest
from ..march.frozen_state import FrozenState
from . import buckling
from .finite_rotations import Triangles, rolls, stretch, turning
from .standing import standing

LEAST = 0.1  # of the largest force of a boundary: smaller ones count as such
SLIGHT = 0.01  # energy of what strains leave out, over theirs, up to which the third order counts
# as little: where nothing yields to that, forces change by about as much


@dataclass
class Change:
    """What finite rotations change in a step: the largest displacement by a part `displacement` of
    it, zero where contact alone keeps any body from turning, which rolls on;
    of the contact nodes the normal forces by `added` (n_c,), beside forces `size` (n_c,).
    """

    displacement: float
    added: np.ndarray
    size: np.ndarray
    buckling: tuple[float, np.ndarray | float] | None  # as buckling.reached has it; not looked for

    @classmethod
    def of(cls, problem, solver, step, status: np.ndarray, fields: list[np.ndarray],
           strained: np.ndarray | float | None = 0.0) -> "Change":
        """Of a step with the displacements `fields` (dofs,) and the `status` (n_c,) of its contact
        nodes; `strained` as buckling.reached has it of steps before, None: it is not looked for.
        Collective; raises NotConverged where the state of the step holds nothing.
        """
        operator = problem.operator
        count, joined = len(status), len(operator.structure.contact.gid) - len(status)
        whole_status = np.append(status, np.full(joined, STICK))  # nodes of ties follow
        frozen = FrozenState(operator, solver, step, whole_status, coupled=False)
        whole = operator.with_travel(fields, step.weights)
        x, w = answer(frozen, operator.structure, whole)
        more = [u + v for u, v in zip(whole, w)]
        size, changed = largest(operator.comm, np.array([_largest(whole), _largest(more)]))
        (force, friction), (added, _) = (_forces(operator, solver.rows, of, count)
                                         for of in (step.multipliers, x))
        part = 0.0 if rolls(operator.structure) or not size else abs(changed - size) / size
        if strained is None:
            return cls(part, added, np.hypot(force, friction), None)
        stands = standing(operator.structure, operator.comm, status, step.time)
        loads = buckling.reached(frozen, operator.structure, fields, strained, stands)
        return cls(part, added, np.hypot(force, friction), loads)

    def of_nodes(self, here: np.ndarray) -> float:
        """Of the sum of the forces of the contact nodes `here`, relative."""
        size = self.size[here].sum()
        return float(abs(self.added[here].sum()) / size) if size else 0.0

    def parts(self, labels: np.ndarray) -> list[tuple[float, str]]:
        """Relative changes of the displacement and of the boundaries with the `labels` (n_c,) of
        the contact nodes, each with words for what changes.
        """
        found = [(self.displacement, "the largest displacement")]
        names = np.unique(labels)
        most = max((self.size[labels == k].sum() for k in names), default=0.0)
        for k in names:
            part = self.size[labels == k].sum() / (LEAST * most) if most else 0.0
            found.append((self.of_nodes(labels == k) * min(part, 1.0),
                          f"the contact force of boundary {k}"))
        return found


def _largest(fields: list[np.ndarray]) -> float:
    """Of displacements (dofs,)."""
    return max((float(np.hypot(*u.reshape(-1, 2).T).max()) for u in fields), default=0.0)


def _forces(operator, rows, multipliers: np.ndarray, count: int) -> np.ndarray:
    """(2, count) normal and friction forces of the contact nodes, on every rank."""
    force = np.zeros((2, count))
    for of, position, node in zip(force, (rows.normal, rows.tangential),
                                  (rows.normal_node, rows.tangential_node)):
        of[node[node < count]] = multipliers[position[node < count]]
    return operator.comm.allreduce(force)  # of one rank a node: to the last bit for any


def answer(frozen, structure, fields: list[np.ndarray]) -> tuple[np.ndarray, list]:
    """Multipliers (owned,) and displacements (dofs,) of the local subdomains that answer to what
    their displacements `fields` (dofs,) leave out; `frozen`: the FrozenState of the step.
    Collective.
    """
    weights, subs = frozen.step.weights, structure.subdomains
    work = np.zeros((2, structure.total))
    second = []
    for sub, u in zip(subs, fields):
        force, work[:, sub.index] = unbalanced(sub, u, weights)
        second.append(-force)
    multipliers, first = frozen.under(second)
    of_strains, of_stretches = frozen.operator.comm.allreduce(work).sum(axis=1)
    if of_stretches <= SLIGHT * of_strains:
        return multipliers, first
    third = [-of_third_order(sub, u, weights, w) for sub, u, w in zip(subs, fields, first)]
    return frozen.under([a + b for a, b in zip(second, third)])


def unbalanced(sub, u: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, tuple[float, float]]:
    """(dofs,) nodal forces of second order of a subdomain's displacements u (dofs,), with the
    energies of its strains and of what these leave out; `weights` (patterns,).
    """
    of = Triangles(sub)
    d = of.gradient(u)
    stress, more = of.of_run(d, u, weights), stretch(d, d) / 2
    stiffer = of.elastic(more)
    force = of.nodal(stiffer, turning(of.turning_part(stress), d))
    return force, (of.work(stress, of.strain(d, u)), of.work(stiffer, more))


def of_third_order(sub, u: np.ndarray, weights: np.ndarray, w: np.ndarray) -> np.ndarray:
    """(dofs,) nodal forces likewise, with the answer w (dofs,) to those of second order."""
    of = Triangles(sub)
    d, g = of.gradient(u), of.gradient(w)
    more = of.elastic(of.strain(g, w)) + of.elastic(stretch(d, d)) / 2
    stress = of.turning_part(of.of_run(d, u, weights))
    force = turning(stress, g) + turning(more, d)
    return of.nodal(of.elastic(stretch(d, g)), force)
