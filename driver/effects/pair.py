"""Contact between two bodies on meshes that do not match: mortar coupling with dual multipliers."""

from . import contact


class Room(contact.Room):
    """The first label of every pair carries the contact nodes, the second is met by mortar coupling."""
