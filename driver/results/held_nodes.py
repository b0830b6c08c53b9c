"""Friction of contact nodes that supports hold along the boundary.

They have no multiplier for it: what holds them prescribes their slip and takes their friction, on
which no deformation depends.
"""

import numpy as np

from ..contact.axis import on_axis
from ..contact.states import OPEN, SLIP

ACROSS = 1e-6  # component of a tangent that is none
SLIDES = 1e-9  # part of the largest slip or displacement that is rounding


def of_axis(b) -> np.ndarray:
    """(n_c,) which nodes of a ContactBoundary `b` are on the axis of a revolution."""
    return b.axisymmetric & on_axis(b.xy[:, 0])


def without_row(b) -> np.ndarray:
    """(n_c,) which nodes of a ContactBoundary `b` have no tangential row, as a support holds them.

    Those on the axis of a revolution do not count, which has no circumference to rub.
    """
    return (b.tangential_row < 0) & ~of_axis(b)


def held_along(b, constrained: np.ndarray) -> np.ndarray:
    """(n_c,) which nodes of a ContactBoundary `b` a support holds wholly along it.

    Of its displacement components `constrained` (n_c, 2) are given. Of a slanted boundary both must
    be.
    """
    return without_row(b) & (constrained | (np.abs(b.tangent) < ACROSS)).all(axis=1)


def untilted(tangent: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(n_c, 2) the tangents, of nodes `held` along the boundary less what rounding has tilted them.

    What they move by along the normal is no slip: all that holds them would be friction.
    """
    return np.where(held[:, None] & (np.abs(tangent) < ACROSS), 0.0, tangent)


def friction_of_held(held: np.ndarray, bound: np.ndarray, slip: np.ndarray, before: np.ndarray,
                     reach: float) -> np.ndarray:
    """(n_c,) tangential forces of the nodes that are `held` along the boundary, zero of others.

    The `bound` (n_c,) against the `slip` (n_c,); where that is zero, but for the rounding of
    displacements up to `reach`, what it was `before`.
    """
    size = max(reach, np.abs(slip).max(initial=0.0))
    moves = np.abs(slip) > SLIDES * size
    return np.where(held, np.where(moves, np.sign(slip) * bound, np.clip(before, -bound, bound)),
                    0.0)


def complete_start(solver, held: np.ndarray, prescribed) -> None:
    """Give `solver.initial` what rows do not know of an equilibrium that the history starts from.

    There `held` nodes (n_c,) are where supports hold them, `prescribed` () -> (patterns, n_c),
    collective.
    """
    if solver.initial_weights.any() and held.any():
        at_start = solver.initial_weights @ prescribed()
        solver.initial[: len(held)][held] = at_start[held]


class HeldNodes:
    """The friction of held nodes in one step after the other; arrays (n_c,) of all nodes."""

    def __init__(self, boundary, effects, initial: np.ndarray):
        """On a ContactBoundary with the declared `effects`, `initial` tangential displacements,
        which may change before the first step.
        """
        self.friction = np.zeros(len(boundary.gid))
        # tangential displacement relative to what is met, and the way slid, for laws of that
        self._relative = initial[: len(boundary.gid)]
        self._slip_law = effects.rooms.get("slip_law")
        self.way = self._slip_law and self._slip_law.of_others(boundary)

    def add(self, law, held: np.ndarray, force: np.ndarray, slip: np.ndarray,
            reach: float) -> np.ndarray:
        """A step with this `slip` under normal `force`; the bounds of nodes without a row.

        `law` is the boundary's now, `held` which nodes are held along it, `reach` the largest
        displacement, whose rounding is no slip. `friction` is that of the step then.
        """
        bound = law.friction_bound(force)
        if self._slip_law is not None:
            self._relative = self._relative + slip
            self.way.add(np.arange(len(slip)), slip, force)
            given = law.friction_bound(np.zeros_like(force))  # cohesion, or a given bound
            factor = self._slip_law.factor_at(self._relative, self.way.slid)
            bound = given + (bound - given) * factor
        self.friction = friction_of_held(held, bound, slip, self.friction, reach)
        return bound

    def states(self, held: np.ndarray, bound: np.ndarray, status: np.ndarray) -> np.ndarray:
        """States (n_c,) where those of `held` nodes follow from their friction."""
        slides = held & (status != OPEN) & (np.abs(self.friction) >= bound)
        return np.where(slides, SLIP, status)
