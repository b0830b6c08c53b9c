"""Curved sides: quadratic elements whose sides follow curved boundaries (isoparametric)."""

from . import Effect, RunFacts, entry


class Room(Effect):
    """Geometry of quadratic elements: middles of sides on the curve, strains and loads there."""

    labelled = True
    summary = {"curved": True}

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active with quadratic elements."""
        if not self.manifest.curved:
            return {"curved": entry(False, "linear elements have straight sides; ELEMENT=P2 has "
                                           "curved ones")}
        return {"curved": entry(True, "sides of quadratic elements follow the boundary")}
