"""Relative KKT residuals of a time step at the contact and gluing rows."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from .rows import ContactRows


@dataclass
class Scales:
    """Largest values so far in a run: what residuals are relative to, also without load."""

    d: float = 0.0  # ||d||
    displacement: float = 0.0
    pressure: float = 0.0  # nodal force
    work: np.ndarray | float = 0.0  # (modes,) of absolute forces on every free rigid motion


def kkt_residuals(rows: ContactRows, multipliers: np.ndarray, gradient: np.ndarray,
                  projected: float, scales: Scales, comm) -> dict[str, float]:
    """Relative KKT residuals of one time step, the largest over the contact and gluing rows.

    gluing, penetration: relative to the largest displacement; sign, cone: relative to the largest
    nodal pressure; complementarity: pressure times distance, and friction's lost dissipation g
    |slip| - lambda_t slip, relative to the product of both; stationarity: norm `projected` of the
    projected gradient relative to ||d||. Updates the largest pressure in `scales`. Collective over
    `comm`.
    """
    move = -gradient
    lambda_n, lambda_t = multipliers[rows.normal], multipliers[rows.tangential]
    bound, slip, over = rows.friction_bound(multipliers), move[rows.tangential], move[rows.normal]
    bilateral = rows.bilateral
    local = np.array([
        np.abs(move[rows.gluing]).max(initial=0),
        np.where(bilateral, np.abs(over), over).max(initial=0),
        (-lambda_n[~bilateral]).max(initial=0) + 0.0,  # no -0.0
        (np.abs(lambda_t) - bound).max(initial=0),
        np.abs(lambda_n * over)[~bilateral].max(initial=0),
        (bound * np.abs(slip) - lambda_t * slip).max(initial=0),
        np.abs(lambda_n).max(initial=0),
    ])
    local[np.isnan(local)] = np.inf  # which MPI's maximum may lose
    comm.Allreduce(MPI.IN_PLACE, local, op=MPI.MAX)
    gluing, penetration, sign, cone, gap_work, slip_work, force = local.tolist()
    scales.pressure = max(scales.pressure, force)
    work = scales.pressure * scales.displacement
    return {"stationarity": _ratio(projected, scales.d),
            "gluing": _ratio(gluing, scales.displacement),
            "penetration": _ratio(penetration, scales.displacement),
            "sign": _ratio(sign, scales.pressure), "cone": _ratio(cone, scales.pressure),
            "complementarity": _ratio(max(gap_work, slip_work), work)}


def _ratio(value: float, size: float) -> float:
    """value / size; where `size` is zero 1 for a positive value, else 0."""
    return float(value / size) if size > 0 else float(value > 0)
