"""Curved sides: quadratic elements whose sides follow curved boundaries (isoparametric)."""

from ..errors import InputError
from . import Effect, RunFacts, entry


class Room(Effect):
    """Geometry of quadratic elements: middles of sides on the curve, strains and loads there."""

    summary = {"curved": True}

    def __init__(self, name: str, manifest):
        """Raises InputError for labels that the mesh lacks."""
        super().__init__(name, manifest)
        labels = self.data.get("labels")
        if not isinstance(labels, list) or any(k not in manifest.labels for k in labels):
            raise InputError("the labels of curved are none of the mesh")

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active with quadratic elements."""
        if not self.manifest.curved:
            return {"curved": entry(False, "linear elements have straight sides")}
        return {"curved": entry(True, "sides of quadratic elements follow the boundary")}
