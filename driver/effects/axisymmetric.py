"""Bodies of revolution: x is the radius, y the axis."""

from . import ESTIMATE, Effect, RunFacts, entry


class Room(Effect):
    """Hoop strains u_r / r; forces, energies and weights are those of the whole revolution."""

    summary = {"axisymmetric": True}
    estimates = ESTIMATE
    why = "equilibrated stresses, which give a bound, exist for plane problems only"

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Always active: no part of such a body is plane."""
        return {"axisymmetric": entry(True, "strains and integrals are those of a revolution")}
