"""Unilateral contact with a rigid obstacle: u_n <= gap, sigma_n <= 0, one of them an equality."""

from . import Effect, RunFacts, entry


class Room(Effect):
    """Normal rows at the nodes of the contact labels, their multipliers bounded below by zero."""

    quantities = ("peak_pressure", "normal_resultant", "contact_length")
    summary = {"contact": "unilateral"}

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node touched; the gap, where any node starts off its obstacle."""
        active, reason = facts.touched()
        rows, seconds = facts.sizes["dual_normal"], facts.seconds["contact"]
        entries = {"contact": entry(active, reason, rows, seconds)}
        if facts.gap:
            met = "some node starts away from, or inside, its obstacle" if active else reason
            entries["gap"] = entry(bool(active), met)
        return entries
