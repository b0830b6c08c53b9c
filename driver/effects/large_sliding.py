"""Sliding of any length: contact follows the boundaries as they move (contact/following.py)."""

import numpy as np

from ..errors import InputError
from . import ESTIMATE, Effect, RunFacts, entry

EVEN = 1e-9  # part of the body's size by which nodes may be off the plane of their obstacle


class Room(Effect):
    """Gaps, normals and facing parts of every step are those of its displaced boundaries.

    `reach` bounds how far places move; `curve` (s, 8), in `box`, are segments of the obstacle where
    it is given by a function: both ends, and the directions to the body there.
    """

    summary = {"large_sliding": True}
    estimates, why = ESTIMATE, "the bound uses the contact conditions of one geometry only"

    def __init__(self, name: str, manifest):
        super().__init__(name, manifest)
        try:
            self.reach, curve = float(self.data["reach"]), self.data.get("curve")
            sound = 0 < self.reach < np.inf
            if curve is not None:
                self.curve = np.array(curve, float)
                self.box = np.array(self.data["box"], float)
                sound = (sound and self.curve.ndim == 2 and self.curve.shape[1] == 8
                         and self.box.shape == (4,) and np.isfinite(self.curve).all()
                         and np.isfinite(self.box).all())
            else:
                self.curve = None
        except (TypeError, ValueError, KeyError):
            sound = False
        if not sound:
            raise InputError("large_sliding must have a positive reach and finite curves; run the "
                             "scene again")

    @property
    def one_node_a_vertex(self) -> bool:
        """An obstacle that is a curve has one nearest point."""
        return self.curve is not None

    def following(self, nodes, motion):
        """The Following of the contact nodes. Raises InputError for an obstacle without shape."""
        from ..contact import curve, following

        if self.curve is not None:
            surface = following.Outline(curve.through(self.curve), self.box)
        else:
            surface = following.Plane(nodes.normal, self._offsets(nodes))
        return following.Following(nodes, motion, surface, self.reach)

    def _offsets(self, nodes) -> np.ndarray:
        """(n,) offsets of the planes that the nodes of a label meet with one normal."""
        gap = nodes.columns.get("gap", np.zeros(len(nodes.gid)))
        offset = (nodes.normal * nodes.xy).sum(axis=1) + gap
        size = np.ptp(nodes.xy, axis=0).max(initial=0.0)
        rigid = nodes.family == 0
        for label in np.unique(nodes.label[rigid]):
            here = np.flatnonzero(rigid & (nodes.label == label))
            first = here[0]
            turned = np.abs(nodes.normal[here] - nodes.normal[first]).max()
            if turned > EVEN or np.ptp(offset[here]) > EVEN * size:
                raise InputError(
                    f"largeSliding: label {label} is not straight or its gap not the same all "
                    "along, so the shape of its obstacle beside the label is unknown: give it by  "
                    "macro obstacle(x, y) phi //")
        return offset

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node touched: what is open does not know how geometry changes."""
        return {"large_sliding": entry(*facts.touched())}
