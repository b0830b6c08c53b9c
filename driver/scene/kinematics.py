"""Strains and stresses of a subdomain from its displacements."""

import numpy as np

from . import elements
from .loader import Subdomain


def strains(sub: Subdomain, u: np.ndarray) -> np.ndarray:
    """(n_t, 3) mean strains e11, e22, 2 e12 of the displacements u (dofs,) over the triangles."""
    return elements.mean_strains(sub.xy[sub.triangles], u.reshape(-1, 2)[sub.elements])


def stresses(sub: Subdomain, u: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean stresses (n_t, 3) s11, s22, s12 and von Mises stress (n_t,) of displacements u (dofs,).

    `weights` (patterns,) are the factors of the load patterns: the stress that thermal strains
    would cause if they were suppressed is subtracted.
    """
    strain = strains(sub, u)
    s = np.einsum("tij,tj->ti", sub.elasticity, strain)
    zz = 0.0 if sub.sigma_zz is None else sub.sigma_zz * (strain[:, 0] + strain[:, 1])
    for pattern, suppressed in sub.thermal.items():
        suppressed = suppressed if suppressed.ndim == 2 else suppressed.mean(axis=1)
        s -= weights[pattern] * suppressed
        if sub.sigma_zz is not None:  # isotropic: the same in all directions
            zz = zz - weights[pattern] * suppressed[:, 0]
    differences = (s[:, 0] - s[:, 1]) ** 2 + (s[:, 1] - zz) ** 2 + (zz - s[:, 0]) ** 2
    return s, np.sqrt(0.5 * differences + 3 * s[:, 2] ** 2)
