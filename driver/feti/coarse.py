"""The coarse problem S_cc of FETI-DP: assembled, factorized and solved on every rank.

Bodies that no support holds make S_cc singular, with the orthonormal rigid motions Q (at the
corners) as its kernel; springs of small stiffness 1/rho hold them (see free_motions.py),

    S_rho^-1 = P S_cc^+ P + rho Q Q',   P = I - Q Q'.

S_cc^+ comes from a matrix in which as many dofs are pinned as there are motions: where the motions
are independent at the pinned dofs, as QR with pivoting chooses them, only u = 0 has no energy. That
there are no other motions follows from the choice of corners (corners.py).
"""

import numpy as np
from petsc4py import PETSc
from scipy.linalg import qr
from scipy.sparse import coo_matrix, diags

from ..errors import NoSolution
from .cholesky import SINGULAR
from .factorization import factorized, petsc_matrix
from .gathering import Gathering, joined
from .reduction import LocalClass
from .structure import Substructure, partition


class CoarseProblem:
    """S_rho^-1 between the stacked corner dofs of the ranks' subdomains; collective over `comm`.

    Corner dofs are stacked class by class as `LocalClass.corners` says; `numbers` are their numbers
    in the coarse problem. `factor_entries` is the number of entries of the factor, `foreign` that
    of corner dofs on other ranks. `rho` (modes,) are the springs' compliances, zero until they are
    set. Raises NoSolution if S_cc is singular but for them.
    """

    def __init__(self, structure: Substructure, classes: list[LocalClass], comm):
        self.comm, self.dofs = comm, structure.coarse_dofs
        self.motions, self.rho = structure.rigid_corners, np.zeros(structure.rigid_corners.shape[1])
        # corner forces travel in the order of subdomains, so that every rank adds them up alike
        order, corners = [s for c in classes for s in c.members], structure.corner_global
        first = np.cumsum([0, *(len(number) for number in corners)])
        self._order = joined([np.arange(first[s], first[s + 1]) for s in order], int)
        self.numbers = joined([corners[s] for s in order], int)
        self._all_numbers = np.concatenate(comm.allgather(joined(corners, int)))
        self.foreign = len(self._all_numbers) - len(self.numbers)
        self._all_forces = Gathering(comm, len(self.numbers))
        self.factor_entries, self._latest = 0, None
        if self.dofs:
            self._factorize(_assembled(structure, classes, comm))

    def _factorize(self, S) -> None:
        """Factorize S_cc (CSR), pinned where bodies are free. Raises NoSolution if singular."""
        matrix = petsc_matrix(self._pinned(S))
        mumps = factorized(matrix, "mumps")
        checked = mumps.getFactorMatrix()
        negative, _, _ = checked.getInertia()
        if negative or checked.getMumpsInfog(28):
            raise NoSolution(f"the coarse problem's {SINGULAR}")
        self.factor_entries = checked.getMumpsInfog(29)
        # MUMPS vouches for the matrix; CHOLMOD's triangular solves are several times faster
        self._factor = factorized(matrix, "cholmod")
        self._right, self._solution = (PETSc.Vec().createSeq(self.dofs) for _ in range(2))

    def _pinned(self, S):
        """S_cc with as many dofs pinned as there are free rigid motions.

        Where these are all that corners can do, S_cc is nothing but rounding, of any sign.
        """
        modes = self.motions.shape[1]
        if not modes:
            return S
        stiffness = np.abs(S.diagonal()).mean() or 1.0
        self._pins = np.sort(qr(self.motions.T, pivoting=True)[2][:modes])
        free = np.ones(self.dofs)
        free[self._pins] = 0.0
        return (diags(free) @ S @ diags(free) + diags(stiffness * (1.0 - free))).tocsr()

    def solve(self, local: np.ndarray) -> np.ndarray:
        """Displacements of the stacked corner dofs under stacked local corner forces (added up)."""
        if not self.dofs:
            return np.zeros_like(local)
        forces = np.empty_like(local)
        forces[self._order] = local
        total = np.bincount(self._all_numbers, self._all_forces(forces), minlength=self.dofs)
        return self._on_springs(total)[self.numbers]

    def _on_springs(self, forces: np.ndarray) -> np.ndarray:
        """S_rho^-1 times assembled corner forces (dofs,)."""
        if not self.motions.shape[1]:
            return self._with_pins(forces)
        Q = self.motions
        motion = Q.T @ forces
        right = forces - Q @ motion
        right[self._pins] = 0.0
        u = self._with_pins(right)
        return u + Q @ (self.rho * motion - Q.T @ u)

    def _with_pins(self, forces: np.ndarray) -> np.ndarray:
        """Solution (dofs,) with the factorized matrix; overwritten by the next."""
        self._right.array[:] = forces
        self._factor.apply(self._right, self._solution)
        return self._solution.array

    def inverse(self, dofs: np.ndarray) -> np.ndarray:
        """Rows and columns `dofs` (k,) of S_rho^-1, (k, k); the ranks share the columns.

        Those of the latest dofs are kept.
        """
        if self._latest is None or not np.array_equal(self._latest[0], dofs):
            self._latest = dofs, self._inverse(dofs)
        return self._latest[1]

    def _inverse(self, dofs: np.ndarray) -> np.ndarray:
        """The same anew."""
        mine = dofs[slice(*partition(len(dofs), self.comm))]
        columns, force = np.empty((len(mine), len(dofs))), np.zeros(self.dofs)
        for k, dof in enumerate(mine):
            force[dof] = 1.0
            columns[k] = self._on_springs(force)[dofs]
            force[dof] = 0.0
        inverse = np.concatenate(self.comm.allgather(columns))
        return (inverse + inverse.T) / 2

    def whole(self, local: np.ndarray) -> np.ndarray:
        """(dofs,) values at all coarse dofs, on every rank, from those at stacked corner dofs."""
        everywhere = np.empty(self.dofs)
        for numbers, values in self.comm.allgather((self.numbers, local)):
            everywhere[numbers] = values
        return everywhere


def _assembled(structure: Substructure, classes: list[LocalClass], comm):
    """S_cc (n, n) as CSR on every rank, entries in the order of subdomains: all add up alike."""
    numbers, n = structure.corner_global, structure.coarse_dofs
    first = np.cumsum([0, *np.array([len(number) for number in numbers], int) ** 2])
    (rows, columns), values = np.empty((2, first[-1]), int), np.empty(first[-1])
    for c in classes:
        k = len(c.corner)
        place = first[c.members][:, None] + np.arange(k * k)
        number = np.array([numbers[s] for s in c.members])
        rows[place], columns[place] = np.repeat(number, k, axis=1), np.tile(number, k)
        values[place] = c.S.ravel()
    rows, columns, values = map(np.concatenate, zip(*comm.allgather((rows, columns, values))))
    return coo_matrix((values, (rows, columns)), shape=(n, n)).tocsr()
