"""Unilateral contact with a rigid obstacle: u_n <= gap, sigma_n <= 0, one of them an equality."""

from . import Effect, RunFacts, entry


class Room(Effect):
    """Normal rows at the nodes of the contact labels, their multipliers bounded below by zero."""

    quantities = ("peak_pressure", "normal_resultant", "contact_length")

    def summary(self) -> dict:
        """Contact is unilateral unless another effect says more."""
        return {"contact": "unilateral"}

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node touched; the gap, where any node starts off its obstacle."""
        touched = facts.most("stick", "slip")
        if not facts.steps:
            active, reason = None, "no step was kept"
        else:
            active = touched > 0
            reason = f"{touched} nodes touched at most" if touched else "nothing touched"
        found = {"contact": entry(active, reason, facts.sizes["dual_normal"],
                                  facts.seconds["contact"])}
        if facts.gap:
            found["gap"] = entry(bool(facts.steps) and active,
                                 "some node starts away from, or inside, its obstacle")
        return found
