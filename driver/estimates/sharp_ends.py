"""How pressure grows under refinement at the ends of contact, and what order that leaves.

At an end of contact under an edge, beside a clamped corner, or where friction pushes a body into
its support, stresses grow like r^-a with the distance r; elements of size h see h^-a. Their error
in the energy norm is that of the disc about the end which they do not resolve,

    ||d_u||^2 ~ int_0^h r^-2a r dr ~ h^(2 (1 - a)),

and that of a functional, int d_u : C^-1 d_z with the error d_z of its adjoint problem, whose
contact acts at the same ends and whose stresses have the same exponent there, is of this order
too: of the order 1.1 for a = 0.45, whatever the degree of the elements (Grisvard, Elliptic
Problems in Nonsmooth Domains, 1985; Babuska, Suri, SIAM Review 36 (1994) 578-632). Coarse meshes
err by other things that fall faster, and show orders of 2 and more.

So do pressures towards a place of the boundary where materials meet (results/material_corners.py),
which counts as such an end.

At the tip of a closed crack, where contact ends and a tie begins, shear grows like r^-1/2 while
pressure may be uniform: there the order is 1, whatever pressures say.

Slip is no integral. Where it is largest next to such an end it is a displacement within the disc of
size h which the mesh does not resolve, and there displacements are of the order h^(1 - a): half of
what functionals have, as the adjoint problem of a single place gains nothing at that place.

Slip and the work of friction add up over a history. Ends that are sharp under load may be blunt at
its end, where contact is unloaded, with the errors of then: for both the step counts, too, in which
contact carries most.

Adaptive meshes are graded towards such places, which restores the order.
"""

import numpy as np

from ..results.touch import Touch

PRESSES = 1.0  # pressure at an end over the mean one from which it counts
LEAST, MOST = 0.1, 0.9  # exponents: pressures that approach a limit may grow as fast as by less;
# of finite energy are those below 1
TIP = 1.0  # order that the tip of a crack leaves


def growth(fine: np.ndarray, coarse: np.ndarray, ratio: float, least: float = PRESSES) -> float:
    """Largest exponent by which pressure at an end grows from a mesh to that `ratio` times finer.

    `fine`, `coarse`: ends (k, 3) as of Touch; `least`: what presses on the coarse mesh at least.
    """
    found = [0.0]
    for x, y, pressure in fine if len(coarse) else ():
        near = np.hypot(coarse[:, 0] - x, coarse[:, 1] - y).argmin()
        before = coarse[near, 2]
        if pressure > PRESSES and before > least:
            found.append(np.log(pressure / before) / np.log(ratio))
    return float(min(max(found), MOST))


def order(touches: list[Touch], ratios: list[float]) -> float:
    """Order that functionals have at most, from contact on meshes, finest first; inf if unknown."""
    return _order([touch.ends for touch in touches], ratios)


def order_of_history(touches: list[Touch], ratios: list[float]) -> float:
    """The same of what adds up over a history."""
    return min(order(touches, ratios), _order([touch.loaded for touch in touches], ratios))


def _order(ends: list[np.ndarray], ratios: list[float]) -> float:
    """Growth counts that goes on from mesh to mesh: once it may be contact that moves.

    On the coarsest mesh, beside a side as long as the body is thick, an end may press less than the
    mean: it is enough that pressure has grown since.
    """
    exponents = [growth(fine, coarse, r, 0.0 if k else PRESSES)
                 for k, (fine, coarse, r) in enumerate(zip(ends, ends[1:], ratios))]
    least = min(exponents, default=0.0)
    return 2 * (1 - least) if least > LEAST else np.inf


def order_of_way(touch: Touch, most: float) -> float:
    """Order that the largest slip has at most, `most` that of functionals."""
    return most / 2 if touch.way_at_end else most


def of_tips(problem, touch: Touch) -> float:
    """Order that functionals have at most where an end of contact is one of a tie; else inf.

    A tie ends at the place if that is nearer to one of its nodes than the node's part of the tie.
    """
    if not len(touch.ends):
        return np.inf
    contact = problem.structure.contact
    labels = [joint.first for joint in problem.effects.joints if not joint.periodic]
    tied = contact.is_joint & np.isin(contact.label, labels)
    away = np.linalg.norm(touch.ends[:, None, :2] - contact.xy[tied], axis=2)
    return TIP if (away <= contact.weight[tied]).any() else np.inf
