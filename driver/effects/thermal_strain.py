"""Strain of a free body, an expansion coefficient times a rise of temperature."""

from . import LoadEffect


class Room(LoadEffect):
    """Patterns given by the stress that the strain has if it is suppressed."""

    heading = "thermal"
