"""Relative KKT residuals of a time step at the contact and gluing rows.

Displacements are relative to delta, the largest deformation (rigid motions of bodies left out) of
material such as the node's (feti/stiff_parts.py), no less than what makes rounding of the bodies'
way as large as residuals may be (march/residuals.py), forces to f, the largest contact force of a
node. Contact and friction are measured by the natural residuals of their complementarity
conditions,

    | l_n - P_[0, inf) (l_n + o) |,   | l_t - P_[-g, g] (l_t + s) |,
    l = lambda / f,   o = (u_n - gap) / delta,   s = slip / delta,   g = bound / f,

that is, with rho = f / delta, lambda - P_K(lambda + rho (B u - c)) relative to f. They vanish just
at solutions (Facchinei, Pang, Finite-Dimensional Variational Inequalities and Complementarity
Problems, Springer 2003, section 1.5), and where a node is on the wrong side of its condition by
little force or by little way they are as little: products such as g |slip| grow with the friction
coefficient where nothing is wrong.
"""

from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI

from .rows import ContactRows

FADED = 1e-6  # part of the largest value of the history below which a step's own is rounding


@dataclass
class Scales:
    """What residuals of a step are relative to: the step's own values, no less than `FADED` times
    the largest so far in the run, which says something of a step without load, too.
    """

    d: float = 0.0  # norm of the displacements that the QP has to overcome
    # (levels,) deformation of what rows of a level of stiffness touch, see feti/stiff_parts.py
    displacements: np.ndarray = field(default_factory=lambda: np.zeros(1))
    force: float = 0.0  # largest contact force of a node
    pressing: float = 0.0  # norm of all contact forces
    work: np.ndarray | float = 0.0  # (modes,) of absolute forces on every free rigid motion
    largest: dict = field(default_factory=dict)  # of these so far, by name

    @property
    def displacement(self) -> float:
        """The largest deformation."""
        return float(self.displacements[0])

    def faded(self, name: str) -> float:
        """The value of this name below which a step's own is rounding beside the steps before."""
        return FADED * self.largest.get(name, 0.0)

    def renew(self, **values) -> None:
        """The step's own values by name; the same again replace them."""
        for name, value in values.items():
            setattr(self, name, np.maximum(value, self.faded(name)))

    def keep(self) -> None:
        """The step is over: its values count for those to come."""
        for name in ("d", "displacements", "force", "pressing", "work"):
            self.largest[name] = np.maximum(self.largest.get(name, 0.0), getattr(self, name))


def kkt_residuals(rows: ContactRows, multipliers: np.ndarray, gradient: np.ndarray,
                  level: np.ndarray, scales: Scales, comm) -> dict[str, float]:
    """Relative KKT residuals of one time step, the largest over the contact and gluing rows.

    gluing, penetration: relative to the deformation; sign, cone: relative to the largest contact
    force; complementarity: the larger of the natural residuals. Where stiffness jumps the
    deformation is that of the row's `level` (owned,): a way that is nothing to soft parts decides
    on the contact of stiff ones. Renews the force in `scales`. Collective over `comm`.
    """
    move = _over(-gradient, scales.displacements[level])
    lambda_n, lambda_t = multipliers[rows.normal], multipliers[rows.tangential]
    force = max(np.abs(lambda_n).max(initial=0), np.abs(lambda_t).max(initial=0))
    force = comm.allreduce(float(force) if np.isfinite(force) else np.inf, op=MPI.MAX)
    scales.renew(force=force)
    bound = rows.friction_bound(multipliers)
    gluing, over, slip = (move[part] for part in (rows.gluing, rows.normal, rows.tangential))
    l_n, l_t, g = (_over(values, scales.force) for values in (lambda_n, lambda_t, bound))
    bilateral = rows.bilateral
    natural = np.where(bilateral, over, l_n - np.maximum(l_n + over, 0))
    rubbing = l_t - np.minimum(np.maximum(l_t + slip, -g), g)
    local = np.array([
        np.abs(gluing).max(initial=0),
        np.where(bilateral, np.abs(over), over).max(initial=0),
        (-l_n[~bilateral]).max(initial=0),
        (np.abs(l_t) - g).max(initial=0),
        max(np.abs(natural).max(initial=0), np.abs(rubbing).max(initial=0))])
    local += 0.0  # no -0.0, which one rank may have and another not
    local[np.isnan(local)] = np.inf  # which MPI's maximum may lose
    comm.Allreduce(MPI.IN_PLACE, local, op=MPI.MAX)
    names = "gluing", "penetration", "sign", "cone", "complementarity"
    return dict(zip(names, local.tolist()))


def _over(values: np.ndarray, size: np.ndarray | float) -> np.ndarray:
    """values / size; where `size` is zero the signs of the values."""
    return np.where(size > 0, values / np.where(size > 0, size, 1.0), np.sign(values))
