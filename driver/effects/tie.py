"""Ties: boundaries of bodies whose meshes need not match, joined for good (contact/joints.py)."""

from ..contact.joints import Joint
from ..errors import InputError
from . import ESTIMATE, Effect, RunFacts, entry


class Room(Effect):
    """Pairs of labels; the first one of each carries the multipliers, which have no bounds."""

    summary = {"ties": True}
    estimates, why = ESTIMATE, "equilibrated stresses do not extend across ties"
    periodic = False

    def __init__(self, name: str, manifest):
        """Raises InputError for labels that the mesh lacks."""
        super().__init__(name, manifest)
        labels = self.data.get("labels")
        pairs = isinstance(labels, list) and all(
            isinstance(pair, list) and len(pair) == 2 and all(k in manifest.labels for k in pair)
            for pair in labels)
        if not pairs:
            raise InputError(f"the labels of {name} are none of the mesh; run the scene again")

    def joints(self) -> list[Joint]:
        """The joined boundaries."""
        return [Joint(self.name, *pair, self.periodic) for pair in self.data["labels"]]

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active in every step: nothing opens or slides there."""
        active, reason = facts.in_every_step("joins its boundaries in every step")
        return {self.name: entry(active, reason, facts.sizes["dual_joined"])}
