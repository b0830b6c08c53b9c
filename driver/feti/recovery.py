"""Displacements and forces of the subdomains under loads and multipliers.

    u_r = K_rr^-1 (f_r - B_r' lambda - K_rc u_c),
    S_cc u_c = f_c - K_cr K_rr^-1 f_r - A' lambda.
"""

import numpy as np

from .coarse import CoarseProblem
from .reduction import LocalClass
from .structure import Substructure


class Recovery:
    """Solutions on the rank's subdomains; fields are lists of their (dofs,) arrays.

    `rows` are stacked, signed local multipliers, `corner` displacements of the stacked corner dofs;
    `weights` are the factors of the load patterns; those of `displacements` go on with the rigid
    motions', where there are any. Collective where corners are solved for.
    """

    def __init__(self, structure: Substructure, classes: list[LocalClass], coarse: CoarseProblem):
        self.structure, self.classes, self.coarse = structure, classes, coarse
        self.loads = [self._pattern_loads(s) for s in range(len(structure.subdomains))]
        self._acts = [load.any() for load in self.loads]
        self._forward = {}  # of subdomain and load pattern: the pass down L, see cholesky.py

    def _pattern_loads(self, s: int) -> np.ndarray:
        """(patterns, dofs) loads with the forces of prescribed displacements moved to the right."""
        sub, fixed = self.structure.subdomains[s], self.structure.fixed[s]
        values = self.structure.fixed_values[s]
        if not values.any():
            return sub.loads
        held = np.zeros_like(sub.loads)
        held[:, fixed] = values
        return sub.loads - np.array([sub.stiffness @ u for u in held])

    def response(self, weights: np.ndarray,
                 forces: list | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Under sum_k weights_k f_k + forces: local B_r u_r with fixed corners, and corner
        displacements.
        """
        moved = self._prescribed(weights)
        right = [self._forces(c, weights, np.zeros(len(moved)), forces) for c in self.classes]
        torn = self._torn_response(right)
        for c, u_r in zip(self.classes, torn):
            moved[c.rows] += (c.B_r @ u_r).T.ravel()
        return moved, self._corner_response(right, torn)

    def _prescribed(self, weights: np.ndarray) -> np.ndarray:
        """Stacked local rows of B on the prescribed displacements, which B_r and B_c leave out."""
        structure = self.structure
        share = np.zeros(self.classes[-1].rows.stop if self.classes else 0)
        for c in self.classes:
            of_members = share[c.rows].reshape(len(c.members), -1)
            for k, s in enumerate(c.members):
                values = weights @ structure.fixed_values[s]
                if values.any():
                    dofs = structure.subdomains[s].dofs
                    of_members[k] = structure.rows[s].fixed_share(structure.fixed[s], values, dofs)
        return share

    def displacements(self, rows: np.ndarray, weights: np.ndarray,
                      forces: list | None) -> list[np.ndarray]:
        """Displacements under sum_k weights_k f_k - B' lambda + forces, a field if there are any.

        To find those of the corners takes one more solution for every subdomain.
        """
        structure, patterns = self.structure, self.structure.patterns
        right = [self._forces(c, weights, rows, forces) for c in self.classes]
        corner = self._corner_response(right, self._torn_response(right))
        corner += (structure.rigid_corners @ weights[patterns:])[self.coarse.numbers]
        fields = [np.empty(0)] * len(structure.subdomains)
        for c, f in zip(self.classes, right):
            for s, u in zip(c.members, np.ascontiguousarray(_class_displacements(c, f, corner).T)):
                if len(structure.fixed[s]):
                    u[structure.fixed[s]] = weights[:patterns] @ structure.fixed_values[s]
                fields[s] = u
        return fields

    def between_corners(self, rows: np.ndarray, weights: np.ndarray,
                        corner: np.ndarray) -> list[np.ndarray]:
        """`displacements` without other forces, for known `corner`: one pass up every factor.

        The pass down is that of the loads, kept, and of multipliers, in the last rows alone.
        """
        fields = [np.empty(0)] * len(self.structure.subdomains)
        for c in self.classes:
            shape = len(c.members), -1
            multipliers, places = rows[c.rows].reshape(shape), corner[c.corners].reshape(shape)
            for part in c.groups():
                u = self._between(c, c.members[part], multipliers[part], weights, places[part])
                for s, field in zip(c.members[part], u):
                    fields[s] = field
        return fields

    def _between(self, c: LocalClass, members: list[int], multipliers: np.ndarray,
                 weights: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """`between_corners` (k, dofs) for k `members` of a class, `multipliers` (k, m) of each and
        displacements `corner` (k, n_c).
        """
        structure, acting = self.structure, np.flatnonzero(weights[: self.structure.patterns])
        # without -0.0, which members at rest would have beside others that are not
        down = 0.0 - c.factor.forward_of_rows((c.B_r.T @ multipliers.T).T)
        for s, own in zip(members, down):
            for k in acting if self._acts[s] else ():
                own += weights[k] * self._down(s, c, k)
        u = np.zeros((len(members), c.K.shape[0]))
        u[:, c.corner] = corner
        if down.any() or corner.any():
            u[:, c.torn] = c.factor.backward(down, corner)
        for s, own in zip(members, u):
            own[structure.fixed[s]] = weights[: structure.patterns] @ structure.fixed_values[s]
        return u

    def _down(self, s: int, c: LocalClass, k: int) -> np.ndarray:
        """The pass of load pattern k down the factor of local subdomain s, of class c.

        As TornFactor.forward gives it for one right-hand side.
        """
        if (s, k) not in self._forward:
            self._forward[s, k] = c.factor.forward(self.loads[s][k][None, c.torn])[0]
        return self._forward[s, k]

    def _forces(self, c: LocalClass, weights: np.ndarray, rows: np.ndarray,
                forces: list | None) -> np.ndarray:
        """Forces (dofs, members) on the subdomains of a class; see `displacements`."""
        f = np.zeros((c.K.shape[0], len(c.members)))
        for k, s in enumerate(c.members):
            if self._acts[s]:
                f[:, k] = weights[: self.structure.patterns] @ self.loads[s]
            if forces is not None:
                f[:, k] += forces[s]
        multipliers = rows[c.rows].reshape(len(c.members), -1).T
        f[c.torn] -= c.B_r.T @ multipliers
        f[c.corner] -= c.B_c.T @ multipliers
        return f

    def _torn_response(self, right: list[np.ndarray]) -> list[np.ndarray]:
        """K_rr^-1 f_r (n_r, members) of the classes under forces (dofs, members)."""
        return [_torn_displacements(c, f[c.torn]) for c, f in zip(self.classes, right)]

    def _corner_response(self, right: list[np.ndarray], torn: list[np.ndarray]) -> np.ndarray:
        """Displacements of stacked corner dofs under forces with `_torn_response` `torn`."""
        force = np.empty(len(self.coarse.numbers))
        for c, f, u_r in zip(self.classes, right, torn):
            force[c.corners] = (f[c.corner] - c.K_rc.T @ u_r).T.ravel()
        return self.coarse.solve(force)

    def forces_on_supports(self, rows: np.ndarray) -> list[np.ndarray]:
        """B' lambda on the fixed dofs of every subdomain: contact forces on its supports."""
        structure = self.structure
        taken = [np.empty(0)] * len(structure.subdomains)
        for c in self.classes:
            for s, forces in zip(c.members, rows[c.rows].reshape(len(c.members), -1)):
                if not len(structure.fixed[s]):
                    continue
                local = structure.rows[s]
                parts = (local.fixed_part * forces[:, None]).ravel()
                dofs = structure.subdomains[s].dofs
                taken[s] = np.bincount(local.dof.ravel(), parts, dofs)[structure.fixed[s]]
        return taken

    def inner_forces(self, fields: list[np.ndarray]) -> list[np.ndarray]:
        """K u for displacements u of every local subdomain, with the stiffness of its class."""
        inner = [np.empty(0)] * len(fields)
        for c in self.classes:
            forces = c.K @ np.column_stack([fields[s] for s in c.members])
            for s, force in zip(c.members, np.ascontiguousarray(forces.T)):
                inner[s] = force
        return inner


def _class_displacements(c: LocalClass, f: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """(dofs, members) displacements of a class under f (dofs, members), given the corners'."""
    u = np.zeros(f.shape)
    u[c.corner] = corner[c.corners].reshape(len(c.members), -1).T
    u[c.torn] = _torn_displacements(c, f[c.torn] - c.K_rc @ u[c.corner])
    return u


def _torn_displacements(c: LocalClass, forces: np.ndarray) -> np.ndarray:
    """K_rr^-1 times `forces` (n_r, members) on a class, without a solution where they are zero."""
    if not forces.any():
        return np.zeros_like(forces)
    return np.column_stack([c.factor.solve(forces[:, part]) for part in c.groups()])
