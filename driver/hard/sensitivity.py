"""How far contact forces may be off by the residuals with which a run has converged.

In the states that a run ends a step in, contact and friction are one linear system of forces and
rigid motions of the assembled body. The difference of two runs makes its rows, displacements and
forces, differ by what both leave of them: where some rigid motions make every row differ by no more
than the residuals, the runs are the same solution, to the accuracy that was asked for. Where a body
hardly feels forces that stand against one another, or friction is near that from which a step has
several solutions, forces differ by many times the residuals. No difference is excused by the mere
condition of the system: only that which the residuals themselves make. Displacements count by what
material like the node's deforms by, as in the laws.
"""

import numpy as np
from scipy.optimize import linprog

from . import deformations, laws
from ..environment import PLAIN_PROGRAM, silenced
from .oracle import Assembled

SAME = 1e-6  # of the largest force or deformation: on the border of two states
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
    fields = np.array([body.solve(w, body.B.T @ f)
                       for w, f in zip(manifest.factors[1:], first.forces(body))])
    scale = np.tile(deformations.of_nodes(body, fields, manifest.axisymmetric)[0], 2)
    change = (second.forces(body) - first.forces(body)) / force
    before = np.abs(np.vstack([0 * first.u_t[:1], (first.u_t - second.u_t)[:-1]]))
    n = len(body.gid)
    for step, apart in enumerate(change):
        yields = C + np.diag(np.append(_slopes(body, first.sigma_n[step]), np.zeros(n)))
        matrix, moves = _system(body, first, step, yields * force / scale[:, None],
                                turned / scale[:, None])
        error = np.full(len(matrix), residual)
        error[n : 2 * n] += np.where(moves[n:], before[step] / scale[n:], 0.0)
        rows = matrix / error[:, None]
        if np.abs(apart).max() > LARGEST or not _within(rows[:, : 2 * n] @ apart, rows[:, 2 * n :]):
            return False
    return True


def _slopes(body: Assembled, sigma_n: np.ndarray) -> np.ndarray:
    """(n_c,) by how much rough surfaces yield more per normal force: their law is a power of it."""
    power = 1.0 / laws.exponents(body)
    force = sigma_n * body.weight
    return -np.divide(power * laws.closures(body, sigma_n[None])[0], force,
                      out=np.zeros(len(force)), where=force != 0)


def _within(rows: np.ndarray, motions: np.ndarray) -> bool:
    """Whether some motions t make all of rows + motions t at most one in size."""
    count = motions.shape[1]
    if not count:
        return bool(np.abs(rows).max(initial=0.0) <= 1)
    share = np.ones((len(rows), 1))
    with silenced():
        answer = linprog(np.append(np.zeros(count), 1.0),
                         A_ub=np.block([[motions, -share], [-motions, -share]]),
                         b_ub=np.concatenate([-rows, rows]), bounds=[(None, None)] * (count + 1),
                         method="highs", options=PLAIN_PROGRAM)
    return answer.status == 0 and answer.fun <= 1


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
