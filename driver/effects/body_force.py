"""Forces per volume."""

from . import LoadEffect


class Room(LoadEffect):
    """Patterns given on triangles."""

    heading = "body_force"

    def summary(self) -> dict:
        """Whether there are any."""
        return {"body_force": True}
