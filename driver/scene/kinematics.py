"""Strains and stresses of a subdomain from its displacements."""

import numpy as np

from . import elements
from .loader import Subdomain


def strains(sub: Subdomain, u: np.ndarray) -> np.ndarray:
    """(n_t, 3) mean strains e11, e22, 2 e12 of the displacements u (dofs,) over the triangles."""
    return elements.mean_strains(sub.xy[sub.triangles], u.reshape(-1, 2)[sub.elements])


def stresses(sub: Subdomain, u: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(n_t, 4) mean stresses s11, s22, s33, s12 of the displacements u (dofs,).

    `weights` (patterns,) are the factors of the load patterns: the stress that thermal strains
    would cause if they were suppressed is subtracted.
    """
    thermal = {k: part if part.ndim == 2 else part.mean(axis=1)
               for k, part in sub.thermal.items()}
    return _stresses(strains(sub, u), sub.elasticity, sub.sigma_zz, thermal, weights)


def corner_stresses(sub: Subdomain, u: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(n_t, 3 corners, 4) stresses as `stresses`, linear on quadratic elements, else constant."""
    if sub.corner_elasticity is None:
        return np.repeat(stresses(sub, u, weights)[:, None], 3, axis=1)
    strain = elements.linear_strains(sub.xy[sub.triangles], u.reshape(-1, 2)[sub.elements])
    zz = None if sub.sigma_zz is None else sub.sigma_zz[:, None]
    return _stresses(strain, sub.corner_elasticity, zz, sub.thermal, weights)


def _stresses(strain: np.ndarray, elasticity: np.ndarray, sigma_zz, thermal: dict,
              weights: np.ndarray) -> np.ndarray:
    """(..., 4) stresses of strains (..., 3)."""
    plane = np.einsum("...ij,...j->...i", elasticity, strain)
    zz = np.zeros(strain.shape[:-1])
    if sigma_zz is not None:
        zz = sigma_zz * (strain[..., 0] + strain[..., 1])
    for pattern, suppressed in thermal.items():
        plane = plane - weights[pattern] * suppressed
        if sigma_zz is not None:  # isotropic: the same in all directions
            zz = zz - weights[pattern] * suppressed[..., 0]
    return np.stack([plane[..., 0], plane[..., 1], zz, plane[..., 2]], axis=-1)


def von_mises(stress: np.ndarray) -> np.ndarray:
    """(...) von Mises stress of stresses s11, s22, s33, s12 (..., 4)."""
    xx, yy, zz, xy = np.moveaxis(stress, -1, 0)
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * xy**2)
