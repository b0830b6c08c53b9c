"""The coarse problem S_cc of FETI-DP: assembled, factorized and solved.

On every rank as a whole, or, if it is large, by nested dissection over the ranks (dissection.py).

Bodies that no support holds make S_cc singular, with the orthonormal rigid motions Q (at the
corners) as its kernel; springs of small stiffness 1/rho hold them (see free_motions.py),

    S_rho^-1 = P S_cc^+ P + rho Q Q',   P = I - Q Q'.

S_cc^+ comes from a matrix in which as many dofs are pinned as there are motions: where the motions
are independent at the pinned dofs, as QR with pivoting chooses them, only u = 0 has no energy. That
there are no other motions follows from the choice of corners (corners.py).
"""

import functools

import numpy as np
from petsc4py import PETSc
from scipy.linalg import qr
from scipy.sparse import coo_matrix, csr_matrix, diags

from ..errors import NoSolution
from .cholesky import SINGULAR
from .dissection import Dissection, Elements, grouped, middles
from .factorization import factorized, petsc_matrix
from .gathering import Gathering, gather, joined, lookup
from .reduction import LocalClass
from .structure import Substructure, partition

# coarse dofs from which ranks share a solution. One rank alone is faster without up to 4,000 (a
# product of 512 subdomains takes a twelfth longer); from four ranks on what each would repeat of
# more than these is above a tenth of its work
LARGE = 400


class CoarseProblem:
    """S_rho^-1 between the stacked corner dofs of the ranks' subdomains; collective over `comm`.

    Corner dofs are stacked class by class as `LocalClass.corners` says; `numbers` are their numbers
    in the coarse problem. `work` are the multiplications that a solution takes of this rank,
    `received` is how many numbers it gets for it, in so many `messages`. `rho` (modes,) are the
    springs' compliances, zero until they are set; `pins` are the dofs that are pinned in S_cc^+.
    Raises NoSolution if S_cc is singular but for springs.
    """

    def __init__(self, structure: Substructure, classes: list[LocalClass], comm):
        self.comm, self.dofs = comm, structure.coarse_dofs
        self.motions, self.rho = structure.rigid_corners, np.zeros(structure.rigid_corners.shape[1])
        # corner forces travel in the order of subdomains, so that every rank adds them up alike
        order, corners = [s for c in classes for s in c.members], structure.corner_global
        first = np.cumsum([0, *(len(number) for number in corners)])
        self._order = joined([np.arange(first[s], first[s + 1]) for s in order], int)
        self.numbers = joined([corners[s] for s in order], int)
        modes = self.motions.shape[1]
        self.pins = np.sort(qr(self.motions.T, pivoting=True)[2][:modes]) if modes else []
        self.work = self.received = self.messages = 0
        self._latest = None
        self._shared = None
        if self.dofs > LARGE:
            self._dissect(structure, classes)
        elif self.dofs:
            self._all_numbers = np.concatenate(comm.allgather(joined(corners, int)))
            self.received = len(self._all_numbers) - len(self.numbers)
            self.messages = comm.size - 1
            self._all_forces = Gathering(comm, len(self.numbers))
            self._solve = self._factorized(self._pinned(_assembled(structure, classes, comm)))

    def _factorized(self, S):
        """Solver of S (CSR) that takes and returns (dofs,). Raises NoSolution if S is singular."""
        matrix = petsc_matrix(S)
        mumps = factorized(matrix, "mumps")
        checked = mumps.getFactorMatrix()
        negative, _, _ = checked.getInertia()
        if negative or checked.getMumpsInfog(28):
            raise NoSolution(f"the coarse problem's {SINGULAR}")
        self.work = 2 * checked.getMumpsInfog(29)
        # MUMPS vouches for the matrix; CHOLMOD's triangular solves are several times faster
        factor = factorized(matrix, "cholmod")
        right, solution = (PETSc.Vec().createSeq(S.shape[0]) for _ in range(2))

        def solve(forces: np.ndarray) -> np.ndarray:
            """The solution, overwritten by the next."""
            right.array[:] = forces
            factor.apply(right, solution)
            return solution.array

        return solve

    def _pinned(self, S):
        """S_cc with as many dofs pinned as there are free rigid motions.

        Where these are all that corners can do, S_cc is nothing but rounding, of any sign.
        """
        if not len(self.pins):
            return S
        stiffness = np.abs(S.diagonal()).mean() or 1.0
        free = np.ones(self.dofs)
        free[self.pins] = 0.0
        return (diags(free) @ S @ diags(free) + diags(stiffness * (1.0 - free))).tocsr()

    def _dissect(self, structure: Substructure, classes: list[LocalClass]) -> None:
        """Share the problem between the ranks.

        Rows and columns of its inverse are asked for: of corners of subdomains with contact.
        """
        corners, subs = structure.corner_global, structure.subdomains
        matrices = [None] * len(subs)
        for c in classes:
            for s in c.members:
                matrices[s] = c.S.ravel()
        group, depth = grouped(middles(structure), self.comm)
        asked, pins = np.zeros((2, self.dofs), bool)
        near = sorted({*structure.renewed, *structure.touching})
        asked[gather(self.comm, joined((corners[s] for s in near), int))] = True
        pins[self.pins] = True
        self._numbers, self._count = joined(corners, int), len(subs)
        self._of = np.repeat(np.arange(len(subs)), [len(c) for c in corners])
        elements = Elements(self._numbers, np.array([len(c) for c in corners], np.int64), group,
                            joined(matrices, float))
        self._shared = Dissection(self.comm, elements, depth, asked, pins)
        self.work, self.received = self._shared.work, self._shared.received
        self.messages = self._shared.messages
        if self.motions.shape[1]:
            self._springs()

    def _springs(self) -> None:
        """What rigid motions need of a shared problem: each of its dofs once, and S^-1 Q."""
        count = np.bincount(self._numbers, minlength=self.dofs)
        everywhere = np.empty_like(count)
        self.comm.Allreduce(count, everywhere)
        self._Q = self.motions[self._numbers]
        self._once = self._Q / everywhere[self._numbers][:, None]
        self._held = np.isin(self._numbers, self.pins)
        self._moved = np.column_stack([self._shared.solve(np.where(self._held, 0.0, q))
                                       for q in self._once.T])

    def solve(self, local: np.ndarray) -> np.ndarray:
        """Displacements of the stacked corner dofs under stacked local corner forces (added up)."""
        if not self.dofs:
            return np.zeros_like(local)
        forces = np.empty_like(local)
        forces[self._order] = local
        if self._shared is not None:
            return self._on_shared(forces)[self._order]
        total = np.bincount(self._all_numbers, self._all_forces(forces), minlength=self.dofs)
        return self._on_springs(total)[self.numbers]

    def _on_springs(self, forces: np.ndarray) -> np.ndarray:
        """S_rho^-1 times assembled corner forces (dofs,)."""
        if not self.motions.shape[1]:
            return self._solve(forces)
        Q = self.motions
        motion = Q.T @ forces
        right = forces - Q @ motion
        right[self.pins] = 0.0
        u = self._solve(right)
        return u + Q @ (self.rho * motion - Q.T @ u)

    def _on_shared(self, forces: np.ndarray) -> np.ndarray:
        """The same of a shared problem, in the order of the rank's subdomains (n,)."""
        if not self.motions.shape[1]:
            return self._shared.solve(forces)
        motion = self._total(self._Q * forces[:, None])
        right = np.where(self._held, 0.0, forces - self._once @ motion)
        u = self._shared.solve(right)
        return u + self._Q @ (self.rho * motion - self._total(self._once * u[:, None]))

    def _total(self, values: np.ndarray) -> np.ndarray:
        """(modes,) sums of values (n, modes) of all ranks, subdomain by subdomain."""
        each = np.column_stack([np.bincount(self._of, v, self._count) for v in values.T])
        return gather(self.comm, each).sum(axis=0)

    def inverse(self, dofs: np.ndarray) -> np.ndarray:
        """Rows and columns `dofs` (k,) of S_rho^-1, (k, k); the ranks share the columns.

        Those of the latest dofs are kept. Of a large problem they belong to subdomains with
        contact.
        """
        if self._latest is None or not np.array_equal(self._latest[0], dofs):
            self._latest = dofs, self._inverse(dofs)
        return self._latest[1]

    def _inverse(self, dofs: np.ndarray) -> np.ndarray:
        """The same anew."""
        if self._shared is not None:
            place = np.searchsorted(self._shared.top, dofs)
            inverse = self._shared.inverse[np.ix_(place, place)]
            return inverse + self._by_motions(dofs) if self.motions.shape[1] else inverse
        mine = dofs[slice(*partition(len(dofs), self.comm))]
        columns, force = np.empty((len(mine), len(dofs))), np.zeros(self.dofs)
        for k, dof in enumerate(mine):
            force[dof] = 1.0
            columns[k] = self._on_springs(force)[dofs]
            force[dof] = 0.0
        inverse = np.concatenate(self.comm.allgather(columns))
        return (inverse + inverse.T) / 2

    def compliance(self, dofs: np.ndarray, A: csr_matrix) -> np.ndarray:
        """A S_rho^-1 A' for A (n, k) on the corner dofs `dofs` (k,), (n, n).

        By a solution for every row, which the ranks share, or for every dof, if these are fewer or
        known: then they are kept, see `inverse`.
        """
        known = self._latest is not None and np.array_equal(self._latest[0], dofs)
        if known or self._shared is not None or A.shape[0] >= len(dofs):
            through = A @ (A @ self.inverse(dofs)).T
        else:
            mine = A[slice(*partition(A.shape[0], self.comm))]
            through, force = np.empty((mine.shape[0], A.shape[0])), np.zeros(self.dofs)
            for k, row in enumerate(mine.toarray()):
                force[dofs] = row
                through[k] = A @ self._on_springs(force)[dofs]
            through = np.concatenate(self.comm.allgather(through))
        return (through + through.T) / 2

    def pinned_motions(self) -> tuple[np.ndarray, np.ndarray]:
        """S_cc^+ Q of the stacked corner dofs (n, modes) with pins, and Q' S_cc^+ Q (modes, modes).
        """
        if self._shared is not None:
            return self._moved[self._order], self._energy
        moved = np.zeros_like(self.motions)
        for q, u in zip(self.motions.T, moved.T):
            right = q.copy()
            right[self.pins] = 0.0
            u[:] = self._solve(right)
        return moved[self.numbers], self.motions.T @ moved

    @functools.cached_property
    def _energy(self) -> np.ndarray:
        """Q' S_cc^+ Q (modes, modes) of a shared problem; collective."""
        energy = np.column_stack([self._total(self._once * y[:, None]) for y in self._moved.T])
        return (energy + energy.T) / 2

    def _by_motions(self, dofs: np.ndarray) -> np.ndarray:
        """What S_rho^-1 has at `dofs` (k,) beside the inverse with pins: (k, k)."""
        place, known = lookup(dofs, self._numbers)
        Y, q = np.zeros((len(dofs), self.motions.shape[1])), self.motions[dofs]
        Y[gather(self.comm, place[known])] = gather(self.comm, self._moved[known])
        across = Y @ q.T
        return q @ (self._energy + np.diag(self.rho)) @ q.T - across - across.T

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
