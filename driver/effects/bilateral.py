"""Contact that pulls as well: u_n = gap, everywhere or on some boundaries."""

import numpy as np

from . import Effect


class Room(Effect):
    """A nodal column: not zero where no node lifts off.

    There normal multipliers have no bound; friction is bounded by F |lambda_n|. A node of which any
    part is bilateral is so as a whole: nothing of a boundary that does not lift off opens.
    """

    summary = {"contact": "bilateral"}

    def pulls(self, contact) -> np.ndarray:
        """(n_c,) whether the node does not lift off."""
        return contact.columns["bilateral"] != 0

    def prepare(self, contact) -> None:
        """Whether both kinds of contact stand side by side, for the summary."""
        if not self.pulls(contact).all():
            self.summary = {"contact": "unilateral and bilateral"}
