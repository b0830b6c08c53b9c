"""Probes: where a scene asks for displacements and forces; results/probes.py evaluates them."""

import math

import numpy as np

from ..errors import InputError
from . import Effect


class Room(Effect):
    """Labels and points that are probed; nothing of the problem changes."""

    def __init__(self, name: str, manifest):
        """Raises InputError for places that are no pairs of finite numbers, and unknown labels."""
        super().__init__(name, manifest)
        self.labels, places = self.data.get("labels"), self.data.get("points")
        sound = isinstance(self.labels, list) and isinstance(places, list)
        if not sound or len(places) % 2 or any(
                isinstance(value, bool) or not isinstance(value, (int, float))
                or not math.isfinite(value) for value in places):
            raise InputError("the places of probes are no pairs of numbers")
        if unknown := [label for label in self.labels if label not in manifest.labels]:
            raise InputError(f"a probe is declared on label {unknown[0]}, which the mesh lacks")
        self.points = np.array(places, float).reshape(-1, 2)
