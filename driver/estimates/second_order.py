"""What rotations that are taken for small leave out, and how bodies answer to it.

Let a gradient d[j, k] = d u_k / d x_j be e + W, its strain and its rotation. To second order bodies
are stretched (Biot's strain, linear in the length of a straight bar) by

    e + Q(d, d) / 2,      Q(d, g) = w_d w_g I + (W_d e_g - e_g W_d + W_g e_d - e_d W_g) / 2,

w_d the angle of W_d, so that a linear solution u with the stress s leaves forces unbalanced:

    second order    r(v) = int C Q(d, d)/2 : e(v) + s : Q(d, grad v)
    third order     int C Q(d, g) : e(v) + s : Q(g, grad v) + C (e(w) + Q(d, d)/2) : Q(d, grad v)

with the answer w to -r and g = grad w. Answers are linear solutions with contact as it is at the
end of the step (frozen_state.py): the beginning of Koiter's series for finite rotations. What stays
are loads, normals, Hooke's law, and terms of third order that are smaller by the strain. It knows
what a strain or an angle does not tell: a shallow cone or arch, whose height changes, a beam whose
ends cannot come nearer, a strut near its buckling load all have small strains and rotations, and
forces that are wrong by as much as they have. Where a body bends freely w takes off what turning
lengthens it by, and little is left.
"""

from dataclasses import dataclass

import numpy as np

from ..contact.states import STICK
from ..feti.gathering import largest
from ..scene import elements
from .frozen_state import FrozenState

LEAST = 0.1  # of the largest force of a boundary: smaller ones count as such
SLIGHT = 0.01  # energy of what strains leave out, over theirs, up to which the third order counts
# as little: where nothing yields to that, forces change by about as much


@dataclass
class Change:
    """What finite rotations change in a step: the largest displacement by a part `displacement` of
    it; of the contact nodes the normal forces by `added` (n_c,), beside forces `size` (n_c,).
    """

    displacement: float
    added: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, problem, solver, step, status: np.ndarray, fields: list[np.ndarray]) -> "Change":
        """Of a step with the displacements `fields` (dofs,) and the `status` (n_c,) of its contact
        nodes. Collective; raises NotConverged where the state of the step holds nothing.
        """
        operator = problem.operator
        joined = len(operator.structure.contact.gid) - len(status)  # nodes of ties follow
        frozen = FrozenState(operator, solver, step, np.append(status, np.full(joined, STICK)))
        frozen.ratio = np.zeros_like(frozen.ratio)  # friction of sliding nodes stays what it is
        whole = operator.with_travel(fields, step.weights)
        x, w = answer(frozen, operator.structure, whole)
        more = [u + v for u, v in zip(whole, w)]
        size, changed = largest(operator.comm, np.array([_largest(whole), _largest(more)]))
        (force, friction), (added, _) = (_forces(operator, solver.rows, of, len(status))
                                         for of in (step.multipliers, x))
        return cls(abs(changed - size) / size if size else 0.0, added, np.hypot(force, friction))

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
    of = _Triangles(sub)
    d = of.gradient(u)
    stress, more = of.of_run(d, u, weights), _stretch(d, d) / 2
    stretch = of.elastic(more)
    force = of.nodal(stretch, _turning(stress, d))
    return force, (of.work(stress, of.strain(d, u)), of.work(stretch, more))


def of_third_order(sub, u: np.ndarray, weights: np.ndarray, w: np.ndarray) -> np.ndarray:
    """(dofs,) nodal forces likewise, with the answer w (dofs,) to those of second order."""
    of = _Triangles(sub)
    d, g = of.gradient(u), of.gradient(w)
    more = of.elastic(of.strain(g, w)) + of.elastic(_stretch(d, d)) / 2
    turning = _turning(of.of_run(d, u, weights), g) + _turning(more, d)
    return of.nodal(of.elastic(_stretch(d, g)), turning)


class _Triangles:
    """Places of integration in the triangles of a subdomain, and what is measured there.

    Components come first: strains (3, n_t, m) xx, yy, 2 xy, of bodies of revolution 4 with the
    hoop's, stresses likewise, gradients (2, 2, n_t, m).
    """

    def __init__(self, sub):
        self.sub, self.nodes, corner = sub, sub.elements.shape[1], sub.corner
        constant = self.nodes == 3 and not sub.axisymmetric
        self.places = elements.CENTER if constant else elements.POINTS
        self.share = elements.areas(corner)[:, None] * (1.0 if constant else elements.WEIGHTS)
        if sub.curved:
            self.share = elements.jacobians(corner, self.places) * elements.WEIGHTS / 2
        self.shape = elements.shapes(self.nodes, self.places)
        self.slope = np.ascontiguousarray(np.moveaxis(  # (2, n_t, m, nodes)
            elements.shape_gradients(corner, self.nodes, self.places), -1, 0))
        self.law = np.moveaxis(sub.elasticity, 0, -1)[..., None]
        if sub.axisymmetric:
            self.radius = elements.radii(corner, self.places)
            self.share = self.share * 2 * np.pi * self.radius

    def gradient(self, u: np.ndarray) -> np.ndarray:
        """[j, k] d u_k / d x_j of displacements u (dofs,)."""
        value = u.reshape(-1, 2)[self.sub.elements]
        return np.array([[np.einsum("tmn,tn->tm", slope, value[..., k]) for k in (0, 1)]
                         for slope in self.slope])

    def strain(self, d: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Linear strains of displacements u (dofs,) with the gradient d."""
        parts = [d[0, 0], d[1, 1], d[0, 1] + d[1, 0]]
        if self.sub.axisymmetric:
            radial = u.reshape(-1, 2)[self.sub.elements, 0]
            parts.append(radial @ self.shape.T / self.radius)
        return np.array(parts)

    def elastic(self, strain: np.ndarray) -> np.ndarray:
        """Stresses of strains, which have no hoop's where one is missing."""
        if self.nodes == 7:  # pressures of P2-mixed are linear
            linear = elements.projected(self.share / elements.WEIGHTS, np.moveaxis(strain, 0, -1))
            strain = np.moveaxis(self.places @ linear, -1, 0)
        return np.array([sum(row[j] * part for j, part in enumerate(strain)) for row in self.law])

    def of_run(self, d: np.ndarray, u: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Stresses of a run's displacements u (dofs,) with the gradient d."""
        stress = self.elastic(self.strain(d, u))
        for pattern, suppressed in self.sub.thermal.items():
            of_places = suppressed[:, None] if suppressed.ndim == 2 else self.places @ suppressed
            stress -= weights[pattern] * np.moveaxis(of_places, -1, 0)
        return stress

    def work(self, stress: np.ndarray, strain: np.ndarray) -> float:
        """Twice an energy, of strains that may lack the hoop's."""
        return float((self.share * sum(map(np.multiply, stress, strain))).sum())

    def nodal(self, stress: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(dofs,) of stresses, and of `force` (2, 2, n_t, m), whose work is on gradients."""
        xx, yy, xy = stress[:3]
        whole = self.share * (force + np.array([[xx, xy], [xy, yy]]))
        nodal = [sum(np.einsum("tmn,tm->tn", slope, part) for slope, part in zip(self.slope, of))
                 for of in whole.swapaxes(0, 1)]
        if self.sub.axisymmetric:
            nodal[0] = nodal[0] + (self.share * stress[3] / self.radius) @ self.shape
        count, node = len(self.sub.xy), self.sub.elements.ravel()
        return np.column_stack([np.bincount(node, of.ravel(), count) for of in nodal]).ravel()


def _stretch(d: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Q of gradients, a strain."""
    (exx, eyy, exy, turn), (fxx, fyy, fxy, other) = _parts(d), _parts(g)
    both, across = turn * other, turn * fxy + other * exy
    return np.array([both + across, both - across, turn * (fyy - fxx) + other * (eyy - exx)])


def _turning(stress: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(2, 2, n_t, m) whose product with a gradient is that of stresses with its Q with d."""
    (xx, yy, xy), (exx, eyy, exy, turn) = stress[:3], _parts(d)
    skew = (exy * (xx - yy) - xy * (exx - eyy)) / 2
    return np.array([[-turn * xy, turn * xx + skew], [-turn * yy - skew, turn * xy]])


def _parts(d: np.ndarray) -> tuple[np.ndarray, ...]:
    """Strains xx, yy, xy and angle, counterclockwise, of gradients."""
    return d[0, 0], d[1, 1], (d[0, 1] + d[1, 0]) / 2, (d[0, 1] - d[1, 0]) / 2
