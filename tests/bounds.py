"""What tests of the bound share: estimators that keep their parts, errors between nested meshes."""

import dataclasses

import numpy as np
from scipy.spatial import cKDTree

from driver import environment
from driver.energy_norm import element_stress, recovery
from driver.energy_norm.bound import EquilibratedBound
from driver.energy_norm.energy import EnergyEstimator

SCENES = environment.ROOT / "edp"


class Recorded(EquilibratedBound):
    """Keeps what went into the bound."""

    def _equilibrated(self, base, force, applied):
        self.base, self.force, self.applied = base, force, applied
        self.deviation, *rest = super()._equilibrated(base, force, applied)
        return self.deviation, *rest

    def _admissible(self, torn, contact):
        self.contact = contact
        return super()._admissible(torn, contact)

    def _lifted(self, admissible, pairs):
        self.pairs = pairs
        lift, *rest = super()._lifted(admissible, pairs)
        torn = self.body.vertex
        self.kinematic, self.lifted = (admissible + lift)[torn], lift[torn]
        return lift, *rest

    @property
    def stress(self):
        """(n_t, 3 parts, 3 nodes, 3) the statically admissible stress."""
        inner = element_stress.reference_modes(
            self.heavy)[:, : len(self.deviation)] @ self.deviation
        turned = np.einsum("ijt,njt->tni", self.deviations.map, inner.reshape(9, 3, -1))
        return turned.reshape(-1, 3, 3, 3) + self.base[:, None, None]


class Recording(EnergyEstimator):
    """Whose bound keeps what went into it."""

    bound_of = Recorded


def with_gap(problem, coarse):
    """The problem with the gaps between bodies of a contact boundary on the same polygons, linear
    between its nodes.
    """
    fine = problem.structure.contact
    value = fine.gap.copy()
    for label in np.unique(fine.label[fine.paired]):
        one, two = fine.label == label, coarse.label == label
        value[one] = np.interp(fine.arc[one], coarse.arc[two], coarse.gap[two])
    operator = problem.operator.with_contact(dataclasses.replace(fine, gap=value))
    return dataclasses.replace(problem, structure=operator.structure, operator=operator)


def reported(estimator):
    """Torn displacements as the run reports them, not made admissible."""
    step = estimator.last[1]
    return estimator.gather.displacements(
        estimator.operator.displacements(step.multipliers, step.weights))


def true_error(coarse, fine, field=None):
    """Energy norm of the difference of the displacements of two estimators on nested meshes.

    `field`: of the coarse one, by default those made admissible.
    """
    one, two = coarse.body, fine.body
    field = coarse.kinematic if field is None else field
    apart = two.strain(fine.kinematic) - one.strain(field)[around(
        one.mesh, two.mesh.corner.mean(axis=1))]
    return np.sqrt(np.einsum("ti,tij,tj,t->", apart, two.elasticity, apart, two.mesh.area))


def around(mesh, places):
    """Triangle around each place: bodies may touch and cross by the sag of their edges, so by the
    deepest inside.
    """
    _, near = cKDTree(mesh.corner.mean(axis=1)).query(places, k=min(20, len(mesh.area)))

    def cross(a, b):
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    seen = mesh.corner[near] - places[:, None, None]
    depth = np.min([cross(seen[:, :, k], seen[:, :, (k + 1) % 3]) for k in range(3)],
                   axis=0) / mesh.area[near]
    assert depth.max(axis=1).min() > 0
    return near[np.arange(len(near)), depth.argmax(axis=1)]


def stir(step, solver):
    """Contact forces that are far from a solution, but in the cone; a little disorder of the glue.
    """
    rows, random = solver.rows, np.random.default_rng(3)
    x = step.multipliers
    x[rows.normal] *= random.uniform(0.7, 1.3, len(rows.normal))
    bound = rows.friction_bound(x)
    x[rows.tangential] = np.clip(random.uniform(-1.2, 1.2, len(bound)), -1, 1) * bound
    x[rows.gluing] *= random.uniform(0.98, 1.02, len(rows.gluing))


def expected_total(estimator):
    """The bound without a friction part, by the energy of the difference of the two stresses."""
    body, contact = estimator.body, estimator.contact
    kinematic = np.einsum("tij,tj->ti", body.elasticity, body.strain(estimator.kinematic))
    apart = estimator.stress - kinematic[:, None, None]
    square = sum(recovery.energy(body.mesh.area / 3, body.compliance, apart[:, k]).sum()
                 for k in range(3))
    return np.sqrt(square) / 2 + np.sqrt(square / 4 + contact.duality_gap())


def slip_away(step, solver):
    """No friction forces at all, as if the tangential rows had been lost."""
    step.multipliers[solver.rows.tangential] = 0.0
