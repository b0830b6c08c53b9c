"""Contact between two bodies on non-matching meshes: mortar coupling (contact/mortar.py)."""

from ..contact.pair_sides import PairSides
from ..scene.loader import Subdomain
from . import Effect


class Room(Effect):
    """The first label of every pair carries the contact nodes, coupled to the second one."""

    def paired_sides(self, subdomains: list[Subdomain], fixed, comm, moved=None) -> PairSides:
        """The boundaries that meet; see PairSides."""
        return PairSides(self.manifest, subdomains, fixed, comm, moved)
