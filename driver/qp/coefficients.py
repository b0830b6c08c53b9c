"""Friction coefficients that depend on the slip of the solution: Newton's method on a few nodes.

Successive approximations F -> law(slip(F)), accelerated or not, need a solution for every F on the
way, which may turn back: bodies that friction alone holds slip until it does. So slip counts in the
derivative. With r the rigidity of a node's row and g = c + law(slip) |lambda_n|

    lambda_n - max(lambda_n + r over, 0) = 0,   lambda_t - P_[-g, g](lambda_t + r slip) = 0,

with equilibrium, are piecewise smooth equations of multipliers and rigid motions; steps of their
generalized derivative are shortened until the residual falls (L. Qi, J. Sun, Math. Program. 58
(1993) 353-367; P. Alart, A. Curnier, CMAME 92 (1991) 353-375).

r is the force that moves a row by one while all others stay, 1 / r not its own compliance: a body
on weak springs moves far more as a whole than it deforms, and with the springs' stiffness for r the
residual would not see what keeps nodes in their states, nor ends of steps the digits of slip.
Movements are changed by those of steps: a product with all forces rounds off more.
"""

from collections.abc import Callable

import numpy as np

from .correction import rigidity
from .coulomb import CoulombProblem

STEPS = 60  # Newton steps at most
HALVINGS = 12  # of a step that does not lessen the residual
NEAR = 1e-7  # part of the largest slip by which the law's derivative is taken
WEAK = 1e-12  # part of the largest singular value below which nothing holds a motion
EXACT = 1e-13  # residual beside the forces at which steps end


class _Equations:
    """Residual and derivative in unknowns of one size: forces over roots of rigidities."""

    def __init__(self, problem: CoulombProblem, law: Callable[[np.ndarray], np.ndarray]):
        self.problem, self.law = problem, law
        self.rigidity = rigidity(problem.compliance)
        self.root = np.sqrt(self.rigidity)
        self.unit = np.append(self.root, 1.0 / (problem.reach * np.sqrt(
            np.median(self.rigidity)) if problem.k else np.zeros(0)))
        self.offset = problem.offsets

    def bound(self, z: np.ndarray, slip: np.ndarray) -> np.ndarray:
        """(m,) friction bounds."""
        return self.offset + self.law(slip) * np.abs(z[self.problem.pair])

    def residual(self, z: np.ndarray, movement: np.ndarray) -> np.ndarray:
        """(n + m + k,) over their units, `movement` (n + m,) that at z."""
        problem, n = self.problem, self.problem.n
        forces = self.rigidity * movement
        normal, rub = z[:n] + forces[:n], z[n : problem.rows] + forces[n:]
        bound = self.bound(z, movement[n:])
        left = np.concatenate([np.where(problem.bilateral, -forces[:n],
                                        z[:n] - np.maximum(normal, 0.0)),
                               z[n : problem.rows] - np.clip(rub, -bound, bound)])
        net = problem.motions.T @ z[: problem.rows] - problem.balance
        return np.append(left / self.root, net * self.unit[problem.rows :])

    def derivative(self, z: np.ndarray, movement: np.ndarray) -> np.ndarray:
        """Of the residual by z over the units, (n + m + k, n + m + k)."""
        problem, n, k = self.problem, self.problem.n, self.problem.k
        rows, pair, r = problem.rows, problem.pair, self.rigidity
        unit, move = np.eye(rows + k)[:rows], np.hstack([-problem.compliance, problem.motions])
        slip = movement[n:]
        normal, rub = z[:n] + r[:n] * movement[:n], z[n:rows] + r[n:] * slip
        ahead = NEAR * max(np.abs(slip).max(initial=0.0), 1e-300)
        ahead = np.where(slip < 0, -ahead, ahead)  # away from the kink where nothing slides
        factor = self.law(slip)
        slope = (self.law(slip + ahead) - factor) / ahead
        bound = self.offset + factor * np.abs(z[pair])
        touching = problem.bilateral | (normal > 0)
        own = np.where(touching[:, None], -r[:n, None] * move[:n], unit[:n])
        grows = ((factor * np.sign(z[pair]))[:, None] * unit[pair]
                 + (slope * np.abs(z[pair]))[:, None] * move[n:])
        sticks = np.abs(rub) < bound
        along = np.where(sticks[:, None], -r[n:, None] * move[n:],
                         unit[n:] - np.sign(rub)[:, None] * grows)
        whole = np.vstack([own, along]) / self.root[:, None]
        net = np.hstack([problem.motions.T, np.zeros((k, k))]) * self.unit[rows:, None]
        return np.vstack([whole, net]) * self.unit


def consistent(problem: CoulombProblem, z: np.ndarray,
               law: Callable[[np.ndarray], np.ndarray]) -> np.ndarray | None:
    """A solution with the coefficients `law` (m,) of its own slip (m,), by steps from `z`.

    What slides in it is exactly on the bound of the coefficients that `law` was asked for last.
    None if steps from there do not come to one.
    """
    equations = _Equations(problem, law)
    move = problem.movement(z)
    left = equations.residual(z, move)
    for _ in range(STEPS):
        if np.linalg.norm(left) <= EXACT * np.linalg.norm(z / equations.unit):
            break  # to rounding
        slope = equations.derivative(z, move)
        step = equations.unit * np.linalg.lstsq(slope, -left, rcond=WEAK)[0]
        for _ in range(HALVINGS):
            moved = problem.moved(move, step)
            near = equations.residual(z + step, moved)
            if np.linalg.norm(near) < np.linalg.norm(left):
                break
            step = 0.5 * step
        else:
            break
        z, move, left = z + step, moved, near
    own = problem.under(problem.load, law(move[problem.n :]))
    return own.on_bounds(z) if own.solves(z) else None
