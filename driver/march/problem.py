"""An export made ready for time stepping: read, torn, reduced; and solvers of its load history, whole or in part."""

import dataclasses
from pathlib import Path

import numpy as np

from . import quasistatic
from ..contact.tearing import build
from ..feti.operator import DualOperator
from ..feti.structure import Substructure, partition
from ..contact.friction import SlipLaw
from ..scene.loader import read_subdomains
from ..scene.manifest import Manifest, read_manifest
from ..options import Settings


@dataclasses.dataclass
class Problem:
    """A scene at one mesh size: what it declared, its substructures and their dual operator."""

    manifest: Manifest
    structure: Substructure
    operator: DualOperator

    def solver(self, settings: Settings, samples=None) -> quasistatic.QuasistaticSolver:
        """Solver that steps through the exported times with the indices `samples`, by default all of them."""
        m = self.manifest
        samples = np.arange(m.steps + 1) if samples is None else samples
        law = SlipLaw(**m.slip_law) if m.slip_law else None
        times = np.linspace(0, m.t_end, m.steps + 1)
        return quasistatic.QuasistaticSolver(self.operator, m.effects, m.factors[samples], times[samples],
                                             settings, law)


def assemble(directory: Path, comm, lap=lambda stage: None) -> Problem:
    """The problem of the export in `directory`; collective. `lap` is called when reading is done."""
    manifest = read_manifest(directory)
    first, last = partition(manifest.subdomains, comm)
    subdomains = read_subdomains(manifest, first, last, comm)
    lap("read")
    structure = build(manifest, subdomains, first, comm)
    return Problem(manifest, structure, DualOperator(structure, comm))
