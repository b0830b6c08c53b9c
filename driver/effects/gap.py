"""Distance to the rigid obstacle along the contact normal, positive, zero or negative."""

from . import Effect


class Room(Effect):
    """A nodal column; the contact boundary adds the distance between bodies to it. Its ledger entry is contact's."""
