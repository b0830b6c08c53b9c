"""Recovered stresses of bodies of revolution: what they differ by from the computed ones.

As in recovery.py, with four components s_rr, s_zz, s_rz, s_tt and integrals over the revolution.
Computed stresses are those at the points of quadrature: on linear elements too the hoop strain
u_r / r varies, and what a triangle's mean stress lacks of it is no error.
"""

import numpy as np

from ..scene import elements, kinematics
from . import recovery
from .torn_body import Gather, TornBody


def squares(gather: Gather, body: TornBody | None, displacements: list[np.ndarray],
            weights: np.ndarray, quadratic: bool) -> tuple[np.ndarray, np.ndarray] | None:
    """(n_t,) squares of the triangles' estimated errors and of their energy norms, on rank 0.

    `displacements` (dofs,) of the rank's subdomains, `weights` (patterns,) factors of the loads.
    Collective.
    """
    points = len(elements.WEIGHTS)
    thermal = gather.thermal(weights, (3, 4) if quadratic else (4,))
    elastic = gather((points, 4), float, lambda s, sub: _at_points(sub, displacements[s]))
    smooth = gather((3, 4), float, lambda s, sub: _linear(sub, displacements[s], quadratic))
    if not gather.root:
        return None
    mesh = body.mesh
    if quadratic:
        sigma = elastic - elements.POINTS @ thermal
        nodal = body.patches.smooth(smooth - thermal)
        recovered = elements.shapes(6, elements.POINTS) @ nodal
    else:
        sigma = elastic - thermal[:, None]
        nodal = recovery.averaged_stress(mesh.triangles, body.region, mesh.area,
                                         smooth[:, 0] - thermal)
        recovered = elements.POINTS @ nodal
    ring = 2 * np.pi * elements.radii(body.place, elements.POINTS) * elements.WEIGHTS
    ring = ring * body.area[:, None]
    return tuple(np.einsum("tmi,tij,tmj,tm->t", s, body.compliance, s, ring)
                 for s in (recovered - sigma, elastic))


def _at_points(sub, u: np.ndarray) -> np.ndarray:
    """(n_t, points, 4) elastic stresses of the displacements u (dofs,) at the quadrature points."""
    corner, value = sub.corner, u.reshape(-1, 2)[sub.elements]
    if sub.elements.shape[1] == 7:  # the stress of P2-mixed has the projected strain
        strain = elements.POINTS @ kinematics.linear_strains(sub, u)
    else:
        strain = np.concatenate([
            elements.strains(corner, value, elements.POINTS),
            elements.hoop_strains(corner, value, elements.POINTS)[..., None]], axis=-1)
    law = sub.elasticity[:, None]
    if sub.corner_elasticity is not None:
        law = np.einsum("mc,tcij->tmij", elements.POINTS, sub.corner_elasticity)
    return np.einsum("tmij,tmj->tmi", np.broadcast_to(law, (*strain.shape, 4)), strain)


def _linear(sub, u: np.ndarray, quadratic: bool) -> np.ndarray:
    """(n_t, 3 corners, 4) elastic stresses that are linear, or constant, on the triangles."""
    if not quadratic:
        mean = np.einsum("tij,tj->ti", sub.elasticity, kinematics.strains(sub, u))
        return np.repeat(mean[:, None], 3, axis=1)
    return np.einsum("tcij,tcj->tci", sub.corner_elasticity, kinematics.linear_strains(sub, u))
