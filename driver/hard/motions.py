"""Which rigid motions of the assembled body springs leave free."""

import numpy as np

FELT = 1e-13  # part of a row's terms that resists a motion: a thousand roundings


def unresisted(stiffness, motions: np.ndarray) -> np.ndarray:
    """(modes, free ones) combinations of rigid `motions` (dofs, modes) that no spring resists.

    Every row of the sparse `stiffness` (dofs, dofs) times a motion is relative to the sum of its
    terms' sizes, of which rounding leaves parts of 1e-16 or a few of them: springs count however
    soft they are beside the stiffest row, that of another body perhaps. Dofs 2 k and 2 k + 1 are of
    one vertex: either moves as far as both, as a row may couple to the other direction by rounding
    alone.
    """
    reach = np.abs(motions).reshape(len(motions) // 2, 2, -1).max(axis=1).repeat(2, axis=0)
    terms = (abs(stiffness) @ reach).max(axis=1, initial=0.0)
    met = terms > 0
    parts = (stiffness @ motions)[met] / terms[met, None]
    _, sizes, basis = np.linalg.svd(np.vstack([parts, np.zeros((motions.shape[1],) * 2)]))
    return basis[sizes <= FELT * np.sqrt(len(parts))].T
