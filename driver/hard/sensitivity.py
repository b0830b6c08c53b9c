"""How far contact forces may be off by the residuals with which a run has converged.

In the states that a run ends a step in, contact and friction are one linear system of forces and
rigid motions of the assembled body. Its inverse says what errors of its rows, of displacements and
of forces, do to the forces: two runs whose forces differ by no more are the same solution, to the
accuracy that was asked for. Where a body hardly feels forces that stand against one another, or
friction is near that from which a step has several solutions, that is many times the residuals. As
in the residuals of runs a displacement counts by the root of its node's stiffness: where it jumps,
stiff bodies are pressed by little ways.
"""

import numpy as np

from . import laws
from .oracle import Assembled

SAME = 1e-6  # of the largest force or deformation: on the border of two states
SINGULAR = 1e12  # condition from which a linear system says nothing
LARGEST = 1e-2  # a larger difference is none of residuals, however ill-conditioned


def explained(body: Assembled, manifest, one: dict, other: dict, residual: float) -> bool:
    """Whether the forces of two runs differ by what `residual` makes possible in every step.

    In its own step; what the step before has left of difference in displacements comes from there.
    Friction that changes with slip is no linear law, and conditions of one vertex may share forces
    in many ways: there it is False.
    """
    first, second = (laws.Reported.of(body, contact) for contact in (one, other))
    force = np.abs(first.forces(body)).max(initial=0.0)
    if "slip_law" in manifest.rooms or not force > 0:
        return False
    C = np.array([body.B @ body.solve(np.zeros(len(body.loads)), row) for row in body.B]).T
    turned = body.B @ body.motions
    difference = np.abs(first.forces(body) - second.forces(body)) / force
    soft = np.sqrt(np.diag(C) / np.diag(C).max())
    deformation = max(np.abs(C @ f).max() for f in first.forces(body))
    before = np.abs(np.vstack([0 * first.u_t[:1], (first.u_t - second.u_t)[:-1]])) / deformation
    for step, apart in enumerate(difference):
        matrix, moves = _system(body, first, step, C * force / deformation, turned)
        if np.linalg.cond(matrix) > SINGULAR:
            return False
        inverse, n = np.abs(np.linalg.inv(matrix)), len(body.gid)
        error = np.full(len(matrix), residual)
        error[: 2 * n][moves] *= soft[moves]
        error[n : 2 * n] += moves[n:] * before[step]
        if (apart > (inverse @ error)[: 2 * n]).any() or apart.max() > LARGEST:
            return False
    return True


def _system(body: Assembled, reported: laws.Reported, step: int, C: np.ndarray,
            turned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of contact, friction and balance in the states of a step, and (2 n,) which of them are
    displacements.

    `C` (2 n, 2 n) and `turned` (2 n, modes) move the nodes; unknowns are of order one.
    """
    n, modes = len(body.gid), turned.shape[1]
    size = np.abs(turned).max(axis=0, initial=0.0)
    moved = np.hstack([C, turned / np.where(size > 0, size, 1.0)])
    forces = np.eye(2 * n + modes)[: 2 * n]
    normal, tangential, bound = (of[step] for of in (reported.sigma_n, reported.sigma_t,
                                                     reported.bound))
    press = max(np.abs(reported.sigma_n).max(), np.abs(reported.sigma_t).max())
    closed = (normal != 0) & ~laws.supported(body)
    sticks = (np.abs(tangential) < bound - SAME * press) & laws.rubbing(body)
    offset = sum(body.columns.get(name, 0.0) for name in ("cohesion", "tresca"))
    slope = np.where(normal != 0, (bound - offset) / np.where(normal != 0, normal, 1.0), 0.0)
    slides = forces[n:] - (np.sign(tangential) * slope)[:, None] * forces[:n]
    matrix = np.vstack([np.where(closed[:, None], moved[:n], forces[:n]),
                        np.where(sticks[:, None], moved[n:], slides), moved[:, 2 * n :].T @ forces])
    return matrix, np.concatenate([closed, sticks])
