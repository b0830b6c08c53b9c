"""Stretches and forces of second order in the rotations, triangle by triangle; see second_order.py.
"""

import numpy as np

from ..scene import elements
from .soundness import NEARLY_INCOMPRESSIBLE

TURNS = 1e-10  # rotation times size of a rigid motion that turns a body


def rolling(structure) -> np.ndarray:
    """(bodies,) whether contact alone keeps a body from turning: as it rolls other points are in
    contact.
    """
    bodies = structure.travel.bodies
    turns = np.zeros(len(bodies.size), dtype=bool)
    for mode in structure.rigid_modes:
        turns[bodies.number[mode.members[0]]] |= abs(mode.rotation) * bodies.size.max() > TURNS
    return turns


def rolls(structure) -> bool:
    """Whether any of the bodies is `rolling`."""
    return bool(rolling(structure).any())


class Triangles:
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

    def turning_part(self, stress: np.ndarray) -> np.ndarray:
        """Stresses that do work on rotations: in nearly incompressible materials less the pressure
        in them that acts in all directions of the plane.

        As in rubber that fills a groove: that does work on changes of volume alone, if its loads
        turn with the surface as a fluid's do. Biot's strain, which knows lengths only, would have
        it do work on rotations: much where it is as large as the shear modulus.
        """
        xx, yy, xy = stress[:3]
        around = np.maximum(-(xx + yy) / 2 - np.hypot((xx - yy) / 2, xy), 0.0)
        around = np.where(self.law[0, 1] > NEARLY_INCOMPRESSIBLE * self.law[2, 2], around, 0.0)
        return np.array([xx + around, yy + around, *stress[2:]])

    def work(self, stress: np.ndarray, strain: np.ndarray) -> float:
        """Twice an energy, of strains that may lack the hoop's."""
        return float((self.share * sum(map(np.multiply, stress, strain))).sum())

    def uneven_forces(self, size: float, part: np.ndarray) -> np.ndarray:
        """(dofs,) of forces per volume that vary over a length `size` and have no symmetry, times
        `part` (n_t, m).
        """
        x, y = np.moveaxis(self.sub.xy[self.sub.elements[:, :3]].mean(axis=1), -1, 0)
        nodal = (self.share * part) @ self.shape
        per = np.stack([np.cos(1.3 * x / size + 0.4) + 0.3, 1.0 + np.sin(2.1 * y / size + 0.7)])
        count, node = len(self.sub.xy), self.sub.elements.ravel()
        return np.column_stack([np.bincount(node, (nodal * of[:, None]).ravel(), count)
                                for of in per]).ravel()

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


def stretch(d: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Q of gradients, a strain."""
    (exx, eyy, exy, turn), (fxx, fyy, fxy, other) = _parts(d), _parts(g)
    both, across = turn * other, turn * fxy + other * exy
    return np.array([both + across, both - across, turn * (fyy - fxx) + other * (eyy - exx)])


def turning(stress: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(2, 2, n_t, m) whose product with a gradient is that of stresses with its Q with d."""
    (xx, yy, xy), (exx, eyy, exy, turn) = stress[:3], _parts(d)
    skew = (exy * (xx - yy) - xy * (exx - eyy)) / 2
    return np.array([[-turn * xy, turn * xx + skew], [-turn * yy - skew, turn * xy]])


def _parts(d: np.ndarray) -> tuple[np.ndarray, ...]:
    """Strains xx, yy, xy and angle, counterclockwise, of gradients."""
    return d[0, 0], d[1, 1], (d[0, 1] + d[1, 0]) / 2, (d[0, 1] - d[1, 0]) / 2
