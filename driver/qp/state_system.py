"""The linear system that the law of a CoulombProblem is where nodes are in given states."""

import numpy as np
from scipy.linalg import lapack

from .equations import Equations

SINGULAR = 1e-10  # ratio of the least to the largest pivot of a system that may be singular
NONE = 1e-14  # such a ratio of pivots that are rounding
SUSPECT = 1e-5  # ratio of pivots from which the condition is estimated
AT_A_TIME = 32  # rows of the compliance that are copied at once
CONSISTENT = 1e-6  # relative residual below which a singular system may have solutions


class StateSystem:
    """LU factors of the law in given states, for the multipliers that these leave free.

    Free are lambda_n in contact and lambda_t where a node sticks: their rows do not move. lambda_t
    = slope lambda_n of a sliding node is put in, open nodes are left out. Offsets of sliding nodes
    act as given forces. Motions count as far as the states hold them: beta = turn gamma. `index` is
    the sign of the determinant, that of the whole system of normal and tangential rows as well;
    `dependent` says whether it is singular, `doubtful` whether rounding may hide that it is.
    Rows and unknowns are over `scale`: bodies of any stiffness have diagonals of one and motions
    of one in the same system, and what its pivots say of it does not depend on units.
    """

    def __init__(self, problem, states: np.ndarray, sign: np.ndarray):
        n = problem.n
        self.compliance = problem.compliance
        self.equations = equations = Equations(problem, states, sign)
        self.rows, self.motions = problem.rows, problem.motions
        sliding = np.flatnonzero(equations.slides)
        self.free = np.flatnonzero(equations.still)
        self.sliding, self.node = n + sliding, problem.pair[sliding]
        self.bound, self.slope = equations.bound[sliding], equations.slope[sliding]
        self.turn = problem.held(states) / problem.reach[:, None]
        self.given = None  # forces (n + m,) of offsets and the movement of the free rows by them
        if problem.offset is not None:
            self.given = np.append(np.zeros(n), equations.given)
            self.given_movement = (self.compliance @ self.given)[self.free]
        self.scale = np.sqrt(problem.rigidity[self.free])
        force = self.motions[self.free] @ self.turn
        reach = np.abs(self.scale[:, None] * force).max(axis=0, initial=0.0)
        self.scale = np.append(self.scale, 1.0 / np.where(reach > 0, reach, 1.0))
        self.matrix = self.factor = self._matrix()
        self.pivots, failed = np.empty(0, int), 0
        if len(self.matrix):
            self.factor, self.pivots, failed = lapack.dgetrf(self.matrix)
        pivots = np.abs(np.diag(self.factor))
        least = pivots.min() / pivots.max() if len(pivots) and not failed else float(not failed)
        self.dependent = least <= NONE or least <= SUSPECT and self._rounded
        self.doubtful = self.dependent or least <= SINGULAR
        swaps = np.count_nonzero(self.pivots != np.arange(len(self.pivots)))
        self.index = int(np.prod(np.sign(np.diag(self.factor))) * (-1) ** swaps)

    def _matrix(self) -> np.ndarray:
        """That of the scaled linear system, as LAPACK takes it: column after column."""
        count, size = len(self.free), len(self.free) + self.turn.shape[1]
        columns = np.empty((size, size))  # transposed; C is symmetric
        for start in range(0, count, AT_A_TIME):
            some = self.free[start : start + AT_A_TIME]
            columns[start : start + len(some), :count] = self._between(some)
        place = np.searchsorted(self.free, self.node)
        for start in range(0, len(place), AT_A_TIME):
            some = slice(start, start + AT_A_TIME)
            rubbed = self.slope[some, None] * self._between(self.sliding[some])
            columns[place[some], :count] += rubbed
        force = self.motions @ self.turn
        columns[count:, :count], columns[count:, count:] = -force[self.free].T, 0.0
        force[self.node] += self.slope[:, None] * force[self.sliding]
        columns[:count, count:] = force[self.free]
        columns *= self.scale
        columns *= self.scale[:, None]
        return columns.T

    def _between(self, rows: np.ndarray) -> np.ndarray:
        """(rows, free) compliance; indices that are not checked take a quarter of the time."""
        return np.take(self.compliance[rows], self.free, axis=1, mode="clip")

    @property
    def _rounded(self) -> bool:
        """Whether one over the condition is rounding.

        Pivots do not show it where soft and stiff bodies meet in one place: the last of a stiff
        row, zero but for rounding, has that of soft ones beside it, which is larger.
        """
        return lapack.dgecon(self.factor, lapack.dlange("1", self.matrix))[0] <= np.finfo(float).eps

    def solve(self, load: np.ndarray, balance: np.ndarray) -> np.ndarray | None:
        """z under `load` (n + m,), `balance` (k,), sliding on bounds; None if there is none.

        Of several the one with the least forces: where three bodies meet in one place, conditions
        depend on one another and forces may run round between them.
        """
        if self.dependent:
            family = self.family(load, balance)
            return None if family is None else family[0]
        z = self._whole(self._unknowns(self._right(load, balance)))
        z = z if self.given is None else z + self._offsets
        return z if np.isfinite(z).all() else None

    def correction(self, movement: np.ndarray, balance: np.ndarray) -> np.ndarray | None:
        """Change of z that takes `movement` (n + m,) from the free rows and `balance` (k,) from
        what acts on motions, while sliding nodes follow their bounds; None if singular.
        """
        if self.dependent:
            return None
        right = self.scale * np.append(movement[self.free], self.turn.T @ balance)
        change = self._whole(self._unknowns(right))
        change[self.sliding] = self.slope * change[self.node]
        return change if np.isfinite(change).all() else None

    def _unknowns(self, right: np.ndarray) -> np.ndarray:
        """Of the scaled linear system with this right-hand side."""
        if not len(right):
            return right
        unknowns, _ = lapack.dgetrs(self.factor, self.pivots, right)
        # rows differ in size as stiffness does: else each has the rounding of the largest ones
        # (R. Skeel, Math. Comp. 35 (1980) 817-832)
        more, _ = lapack.dgetrs(self.factor, self.pivots, right - self.matrix @ unknowns)
        return unknowns + more

    def _whole(self, unknowns: np.ndarray) -> np.ndarray:
        """z of the unknowns of the scaled linear system, without offsets."""
        unknowns = self.scale * unknowns
        z = np.zeros(self.rows + self.turn.shape[0])
        z[self.free] = unknowns[: len(self.free)]
        z[self.sliding] = self.bound * np.abs(z[self.node])
        z[self.rows :] = self.turn @ unknowns[len(self.free) :]
        return z

    @property
    def _offsets(self) -> np.ndarray:
        return np.append(self.given, np.zeros(self.turn.shape[0]))

    def _right(self, load: np.ndarray, balance: np.ndarray) -> np.ndarray:
        """Right-hand side of the scaled system under `load` (n + m,) and `balance` (k,)."""
        right = load[self.free]
        if self.given is not None:
            right, balance = right - self.given_movement, balance - self.motions.T @ self.given
        if len(balance):
            right = np.append(right, self.turn.T @ balance)
        return self.scale * right

    def family(self, load: np.ndarray, balance: np.ndarray) -> tuple | None:
        """z and directions (n + m + k, d) that solve a singular system, None if nothing does.

        A regular system has no directions, and no z here. Unilateral contact.
        """
        if not self.doubtful:
            return None
        matrix, right = self.matrix, self._right(load, balance)
        left, sizes, basis = np.linalg.svd(matrix)
        kept = sizes > SINGULAR * sizes[0]
        nearest = basis[kept].T @ ((left.T @ right)[kept] / sizes[kept])
        if np.linalg.norm(matrix @ nearest - right) > CONSISTENT * np.linalg.norm(right):
            return None
        lines = basis[~kept]
        directions = np.column_stack([self._whole(line) for line in lines])
        excess = np.linalg.lstsq(directions[: self.rows], self._whole(nearest)[: self.rows],
                                 rcond=None)[0]
        z = self._whole(nearest - excess @ lines)  # what slides is on its bound to the last bit
        return z if self.given is None else z + self._offsets, directions
