"""Boundary forces per area, tractions and pressures, each number with an amplitude."""

from . import LoadEffect


class Room(LoadEffect):
    """Patterns given on edges."""
