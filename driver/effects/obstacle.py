"""A rigid obstacle given by a function phi(x, y), positive outside: phi(x) + grad phi . u >= 0 at the contact nodes."""

from . import Effect


class Room(Effect):
    """FreeFEM makes normal and gap of the function; to the driver they are those of any contact node."""
