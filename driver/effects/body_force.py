"""Forces per volume."""

from . import LoadEffect


class Room(LoadEffect):
    """Patterns given on triangles."""

    heading = "body_force"
    summary = {"body_force": True}
