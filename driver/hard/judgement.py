"""What is right about a random scene, by the assembled body: laws, agreement, refusals."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import laws
from .case import Outcome
from .oracle import Assembled


@dataclass
class Problem:
    """Manifest and assembled body of a scene."""

    manifest: object
    body: Assembled

    @classmethod
    def of(cls, script: Path, parameters: dict[str, str]) -> "Problem":
        """Export the scene anew and assemble it."""
        from mpi4py import MPI

        from ..march.tearing import build
        from ..scene import freefem
        from ..scene.loader import read_subdomains
        from ..scene.manifest import read_manifest

        with tempfile.TemporaryDirectory() as folder:
            freefem.export(script, Path(folder), parameters)
            manifest = read_manifest(Path(folder))
            subdomains = read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)
        body = Assembled(manifest, subdomains)
        if manifest.contact_labels:
            body.meet(build(manifest, subdomains, 0, MPI.COMM_SELF).contact)
        return cls(manifest, body)

    def worst(self, outcome: Outcome) -> tuple[str, float]:
        """The law that a run violates most, and by how much."""
        if not outcome.contact:
            return "no contact node", 0.0
        broken = laws.violations(self.body, self.manifest, outcome.contact)
        return max(broken.items(), key=lambda item: item[1])

    def disagreement(self, outcomes: list[Outcome]) -> float:
        """Largest difference of contact forces between any run and the first."""
        if not outcomes[0].contact:
            return 0.0
        return max(laws.disagreement(self.body, outcomes[0].contact, other.contact)
                   for other in outcomes[1:])

    def not_unique(self, outcomes: list[Outcome]) -> str:
        """Why runs may differ, empty if they may not."""
        verdicts = {outcome.summary["uniqueness"]["verdict"] for outcome in outcomes}
        return "not unique" if "not unique" in verdicts else ""


def refusal(problem: Problem, outcomes: list[Outcome]) -> tuple[str, str]:
    """Status of a refused scene and the argument."""
    return "FAILED", f"exit {outcomes[0].status}: {outcomes[0].message}"
