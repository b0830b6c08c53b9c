"""Deviations of admissible stresses from those of the finite elements, of little energy.

The deviation sigma* - sigma_h is a sum of few such stresses: at each corner of the triangle moments
+b and -b on its two sides (the sums at the corner are those of sigma_h), the share of f, and on
each side a tangential traction that is linear and odd about its middle, which loads no triangle and
is at first zero. The energy of the deviation is then lessened over these odd tractions and the free
constants of the vertices. A few conjugate gradients suffice, as both act locally; without the odd
tractions the estimate is half as sharp.
"""

from functools import cached_property

import numpy as np

from .edge_mesh import Mesh, side_moments
from .element_stress import piola, reference_modes
from .equilibration import Chains


class Deviations:
    """Deviations sigma* - sigma_h by coefficients (m, n_t) of `reference_modes`.

    Changes that keep the equilibrium have unknowns with small support: two a vertex, where given
    tractions do not close its chain, the same moment added on all its half-edges, (n_c, 2); one an
    edge without given tractions, its odd tangential traction, (n_e,). They are stacked flat.
    Triangles come last in all arrays: sums over the few coefficients run along contiguous rows.
    """

    def __init__(self, mesh: Mesh, around: Chains, known: np.ndarray, compliance: np.ndarray,
                 body: bool):
        """`known` (half-edges, 2): tractions given; `compliance` (n_t, 3, 3); `body`: force?"""
        self.mesh, self.body, self.map = mesh, body, piola(mesh)
        (a, b), (c, d) = mesh.columns.transpose(1, 2, 0)
        self.inverse = np.array([[d, -b], [-c, a]]) / (2 * mesh.area)
        self.free = self._free(mesh, around, known)
        chain = np.empty(mesh.first.size, int)
        for level in around.order:
            inside = level >= 0
            chain[level[inside]] = np.flatnonzero(inside)
        n, edge = around.order.shape[1], mesh.first // 2
        chain = 2 * chain.reshape(-1, 3)
        unknown = np.stack([chain, chain + 1, 2 * n + edge])  # moment x, moment y, odd traction
        self.unknown = np.ascontiguousarray(unknown.transpose(2, 0, 1))  # [corner, 3, t]
        self.scale = (np.where(mesh.first % 2 == 0, 1.0, -1.0) / mesh.length[edge]).T.copy()
        modes = reference_modes(body).reshape(3, 3, 3, -1)  # [part, node, stress, mode]
        mass = np.einsum("mn,pnsi->pmsi", (np.eye(3) + 1) / 36, modes)
        gram = np.einsum("pmsi,pmrj->ijsr", mass, modes)
        local = np.einsum("rat,trs,sbt,t->abt", self.map, compliance, self.map, mesh.area,
                          optimize=True)
        energies = gram.reshape(-1, 9) @ local.reshape(9, -1)
        self.matrix = energies.reshape(*gram.shape[:2], -1)

    @staticmethod
    def _free(mesh: Mesh, around: Chains, known: np.ndarray) -> np.ndarray:
        end = mesh.last.ravel()[around.order[around.length - 1, np.arange(around.order.shape[1])]]
        head = mesh.first.ravel()[around.order[0]]
        vertex = around.closed[:, None] | ~(known[head] | known[end])
        return np.concatenate([vertex.ravel(), ~known[::2].any(axis=1)])

    def start(self, moments: np.ndarray, stress: np.ndarray,
              force: np.ndarray | None) -> np.ndarray:
        """Coefficients for moments (half-edges, 2), stress (n_t, 3), body moments (n_t, 3, 2)."""
        y = np.zeros(self.matrix.shape[1:])
        corner = moments[self.mesh.first] - side_moments(self.mesh, stress)
        if force is not None:
            corner += 0.5 * force
            y[9:] = self._to_reference(force.transpose(1, 2, 0))
        y[:6] = self._to_reference(corner.transpose(1, 2, 0))
        return y

    def _to_reference(self, vectors: np.ndarray) -> np.ndarray:
        """(6, n_t) vectors (3, 2, n_t) seen from the reference triangle."""
        return np.einsum("abt,kbt->kat", self.inverse, vectors).reshape(6, -1)

    def local(self, x: np.ndarray) -> np.ndarray:
        """Coefficients (9, n_t) of the unknowns x."""
        here = x[self.unknown]  # [corner, (moment x, moment y, edge), t]
        return np.concatenate([self._to_reference(here[:, :2]), here[:, 2] * self.scale])

    def assemble(self, force: np.ndarray) -> np.ndarray:
        """Transpose of `local` on the free unknowns."""
        value = np.empty(self.unknown.shape)
        np.einsum("abt,kat->kbt", self.inverse, force[:6].reshape(3, 2, -1), out=value[:, :2])
        np.multiply(force[6:9], self.scale, out=value[:, 2])
        return self._add(value)

    def _add(self, value: np.ndarray) -> np.ndarray:
        total = np.bincount(self.unknown.ravel(), value.ravel(), minlength=len(self.free))
        return np.where(self.free, total, 0.0)

    @cached_property
    def diagonal(self) -> np.ndarray:
        """Diagonal of the energy in the unknowns, one where they are not free."""
        value = np.empty(self.unknown.shape)
        for k in range(3):
            block = self.matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
            value[k, :2] = np.einsum("act,abt,bct->ct", self.inverse, block, self.inverse)
            value[k, 2] = self.matrix[6 + k, 6 + k] * self.scale[k] ** 2
        return np.where(self.free, self._add(value), 1.0)

    def _strain(self, y: np.ndarray, modes: int | None = None) -> np.ndarray:
        """Half the derivative of the energy by the coefficients of all or the first `modes`."""
        return np.einsum("ijt,jt->it", self.matrix[:modes, :modes], y)

    def energy(self, y: np.ndarray) -> np.ndarray:
        """(n_t,) int s : C^-1 s of deviations y."""
        return np.einsum("it,it->t", y, self._strain(y))

    def mean(self, y: np.ndarray) -> np.ndarray:
        """(n_t, 3) mean stress of deviations y."""
        average = reference_modes(self.body).reshape(9, 3, -1).mean(axis=0)
        return np.einsum("ijt,jt->ti", self.map, average @ y)

    def lessen(self, y: np.ndarray, gain: float = 0.02, iterations: int = 50) -> np.ndarray:
        """y with changes added that lessen its energy and keep the equilibrium.

        Conjugate gradients, diagonally preconditioned, until an iteration gains less than `gain`.
        """
        force = self._strain(y)
        square, residual = float(np.sum(y * force)), -self.assemble(force)
        x, direction, product = np.zeros(len(self.free)), 0.0, 1.0
        for _ in range(iterations):
            scaled = residual / self.diagonal
            previous, product = product, residual @ scaled
            if product == 0.0:
                break
            direction = scaled + product / previous * direction
            applied = self.assemble(self._strain(self.local(direction), 9))
            step = product / (direction @ applied)
            x += step * direction
            residual -= step * applied
            square -= step * product
            if step * product <= gain * square:
                break
        return np.concatenate([y[:9] + self.local(x), y[9:]])
