"""The law of contact and friction on a few nodes, written down anew."""

import numpy as np


def assert_obeys(problem, z, bilateral=False):
    """Contact, friction and equilibrium at every node, from the definition of the law."""
    n, rows = problem.n, len(problem.load)
    x, offset = z[:rows], np.zeros(problem.m) if problem.offset is None else problem.offset
    moved = problem.load - problem.compliance @ x + problem.motions @ z[rows:]
    # rounding of dense systems of ten rows: their condition, below 1e4 for nearly all seeds, times
    # eps, with room
    force = 1e-8 * max(np.abs(x).max(), np.abs(problem.load / np.diag(problem.compliance)).max())
    length = force * np.diag(problem.compliance)
    for i in range(n):
        pressure, over = x[i], moved[i]
        if np.broadcast_to(bilateral, n)[i]:
            assert abs(over) <= length[i]
        else:
            assert pressure >= -force and over <= length[i] and (pressure <= force
                                                                 or abs(over) <= length[i])
    for k, i in enumerate(problem.pair):
        bound, shear, slip = offset[k] + problem.coefficient[k] * abs(x[i]), x[n + k], moved[n + k]
        assert abs(shear) <= bound + force
        if abs(shear) < bound - force:
            assert abs(slip) <= length[n + k]  # sticks
        elif bound > force:
            assert slip * np.sign(shear) >= -length[n + k]  # slides the way that friction resists
    if len(z) > rows:
        assert np.abs(problem.motions.T @ x
                      - problem.balance).max() <= 10 * force * np.abs(problem.motions).max() * rows
