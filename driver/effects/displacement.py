"""Prescribed displacements of supports."""

from . import LoadEffect


class Room(LoadEffect):
    """Patterns given on supports."""

    heading = "displacement"
