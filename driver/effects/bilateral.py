"""Contact that pulls as well: u_n = gap at every node."""

from . import Effect


class Room(Effect):
    """Normal multipliers have no bound; friction is bounded by F |lambda_n|."""

    bilateral = True
    summary = {"contact": "bilateral"}
