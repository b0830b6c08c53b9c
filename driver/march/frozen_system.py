"""The linear system of a frozen contact state on the contact rows, with gluing rows eliminated.

With the compliance C of the glued body (feti/fronts.py), forces mu of the rows that are not free of
them take given movements off these, at nodes that slide with what friction makes of normal forces:
one dense factorization for all right sides, and a product for each of these. Conjugate gradients
take tens of products each, and the coupling of Coulomb's law as many again some times.
"""

import numpy as np
from scipy.linalg import lapack

from ..errors import NotConverged


class FrozenSystem:
    """Of the rows that are `held` (owned,) with the `ratio` (j,) of friction to normal forces at
    tangential rows, where a run's `condensation` has eliminated its gluing rows. Collective.
    """

    def __init__(self, condensation, held: np.ndarray, ratio: np.ndarray):
        """Raises NotConverged if the compliance cannot be computed or the system is singular."""
        self._condensation = condensation
        self._ratio = condensation.of_tangential(ratio)
        self._held = np.flatnonzero(condensation.gather(held.astype(float)))
        if not len(self._held):  # nothing touches
            return
        followed = self._followed(condensation.compliance())[np.ix_(self._held, self._held)]
        # in place: thousands of rows have matrices of hundreds of MB; of the transpose, as LAPACK
        # stores by columns
        self._factor, self._pivots, failed = lapack.dgetrf(followed.T, overwrite_a=True)
        if failed:
            raise NotConverged("the frozen contact state does not hold the bodies")

    def solution(self, moved: np.ndarray) -> np.ndarray:
        """Multipliers (owned,) that take displacements `moved` (owned,) off the rows that are held
        and the gluing rows, to what the compliance rounds off.
        """
        condensation, zero = self._condensation, np.zeros(len(moved))
        glued, left = condensation.glued(moved, zero, -moved)
        right = self._followed(-condensation.gather(left))[self._held]
        force = np.zeros(condensation.size)
        if len(right):
            force[self._held] = lapack.dgetrs(self._factor, self._pivots, right, trans=1)[0]
        x = condensation.place(force, glued)
        return condensation.glued(moved, x, condensation.operator.apply(x) - moved)[0]

    def _followed(self, moved: np.ndarray) -> np.ndarray:
        """Movements (n + m, ..) of all contact rows along the forces: as adjoint.py has them."""
        condensation, along = self._condensation, moved.copy()
        ratio = self._ratio.reshape(-1, *[1] * (moved.ndim - 1))
        np.add.at(along, condensation.pair, ratio * moved[condensation.n :])
        return along
