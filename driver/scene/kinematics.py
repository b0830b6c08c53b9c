"""Strains and stresses of a subdomain from its displacements.

Of bodies of revolution strains have a fourth component, the hoop strain u_r / r.
"""

import numpy as np

from . import elements
from .loader import Subdomain


def strains(sub: Subdomain, u: np.ndarray) -> np.ndarray:
    """(n_t, 3) mean strains e11, e22, 2 e12 of the displacements u (dofs,) over the triangles.

    Of bodies of revolution (n_t, 4); u_r / r is that of the means of u_r and r, which with linear
    elements is its mean over the revolved triangle.
    """
    corner, value = sub.corner, u.reshape(-1, 2)[sub.elements]
    plane = elements.mean_strains(corner, value)
    if not sub.axisymmetric:
        return plane
    hoop = elements.hoop_strains(corner, value[:, :6], elements.CENTER)[:, 0]
    return np.column_stack([plane, hoop])


def linear_strains(sub: Subdomain, u: np.ndarray) -> np.ndarray:
    """(n_t, 3 corners, 3 or 4) strains of quadratic elements as elements.linear_strains has them.

    Of bodies of revolution they are projected with the weight r, as P2-mixed does.
    """
    corner, value = sub.corner, u.reshape(-1, 2)[sub.elements]
    if not sub.axisymmetric:
        return elements.linear_strains(corner, value)
    places = elements.POINTS
    hoop = elements.hoop_strains(corner, value, places)
    strain = np.concatenate([elements.strains(corner, value, places), hoop[..., None]], axis=-1)
    density = elements.radii(corner, places)
    if sub.curved:
        density = density * elements.jacobians(corner, places)
    return elements.projected(density, strain)


def stresses(sub: Subdomain, u: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(n_t, 4) mean stresses s11, s22, s33, s12 of the displacements u (dofs,).

    `weights` (patterns,) are the factors of the load patterns: the stress that thermal strains
    would cause if they were suppressed is subtracted.
    """
    return _stresses(strains(sub, u), sub.elasticity, sub.sigma_zz, mean_thermal(sub), weights)


def mean_thermal(sub: Subdomain) -> dict[int, np.ndarray]:
    """By pattern (n_t, 3 or 4) triangles' means of the stresses of suppressed thermal strains."""
    return {k: part if part.ndim == 2 else part.mean(axis=1) for k, part in sub.thermal.items()}


def corner_stresses(sub: Subdomain, u: np.ndarray, weights: np.ndarray,
                    mean: np.ndarray) -> np.ndarray:
    """(n_t, 3 corners, 4) stresses, linear on quadratic elements, else the `mean` of `stresses`."""
    if sub.corner_elasticity is None:
        return np.repeat(mean[:, None], 3, axis=1)
    zz = None if sub.sigma_zz is None else sub.sigma_zz[:, None]
    return _stresses(linear_strains(sub, u), sub.corner_elasticity, zz, sub.thermal, weights)


def _stresses(strain: np.ndarray, elasticity: np.ndarray, sigma_zz, thermal: dict,
              weights: np.ndarray) -> np.ndarray:
    """(..., 4) stresses of strains (..., 3 or 4)."""
    stress = np.einsum("...ij,...j->...i", elasticity, strain)
    zz = np.zeros(strain.shape[:-1])
    if sigma_zz is not None:
        zz = sigma_zz * (strain[..., 0] + strain[..., 1])
    for pattern, suppressed in thermal.items():
        stress = stress - weights[pattern] * suppressed
        if sigma_zz is not None:  # isotropic: the same in all directions
            zz = zz - weights[pattern] * suppressed[..., 0]
    if stress.shape[-1] == 4:
        zz = stress[..., 3]
    return np.stack([stress[..., 0], stress[..., 1], zz, stress[..., 2]], axis=-1)


def von_mises(stress: np.ndarray) -> np.ndarray:
    """(...) von Mises stress of stresses s11, s22, s33, s12 (..., 4)."""
    xx, yy, zz, xy = np.moveaxis(stress, -1, 0)
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * xy**2)


def strain_and_turn(corner: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n_t,) largest principal strain, by size, and rotation of the triangles' linear parts.

    `value` (n_t, 3, 2) are displacements of the corners (n_t, 3, 2).
    """
    gradient = elements.linear_gradients(corner, value)
    e11, e22 = gradient[:, 0, 0], gradient[:, 1, 1]
    shear = (gradient[:, 0, 1] + gradient[:, 1, 0]) / 2
    strain = np.abs(e11 + e22) / 2 + np.hypot((e11 - e22) / 2, shear)
    return strain, (gradient[:, 0, 1] - gradient[:, 1, 0]) / 2
