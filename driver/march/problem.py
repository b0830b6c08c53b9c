"""An export made ready for time stepping: read, torn, reduced; solvers of its load history."""

import dataclasses
from pathlib import Path

import numpy as np

from ..arguments import EVERY
from ..effects import Effects
from ..errors import InputError
from ..feti.operator import DualOperator
from ..feti.structure import Substructure, partition
from ..options import Settings
from ..scene.loader import read_subdomains
from ..scene.manifest import Manifest, read_manifest
from .ahead import Ahead
from .quasistatic import QuasistaticSolver
from .tearing import build


@dataclasses.dataclass
class Problem:
    """A scene at one mesh size: what it declared, its substructures and their dual operator."""

    manifest: Manifest
    structure: Substructure
    operator: DualOperator

    @property
    def effects(self) -> Effects:
        """The declared effects, with nothing carried yet."""
        return Effects(self.manifest)

    def solver(self, settings: Settings, samples=None, plan=None) -> QuasistaticSolver:
        """Solver that steps through the exported times with indices `samples`, by default all.

        A history that is repeated is repeated at these times; `plan`, if given, says how many of
        its cycles were skipped after each. Raises InputError for CYCLES= without cycles.
        """
        m, effects = self.manifest, self.effects
        samples = np.arange(m.steps + 1) if samples is None else samples
        times = np.linspace(0, m.t_end, m.steps + 1)
        kind = QuasistaticSolver
        if self.structure.contact.following is not None:
            from .following import FollowingSolver as kind  # here: few scenes need it
        return kind(self.operator, effects, m.factors[samples], times[samples], settings,
                    _cycles(effects.repeats, samples, settings, plan))


def _cycles(repeats: tuple[int, int] | None, samples: np.ndarray, settings: Settings, plan):
    """The Cycles of a history that is repeated from a step on, so often; None for any other."""
    if repeats is None:
        if settings.cycles != EVERY:
            raise InputError(f"CYCLES={settings.cycles}: the scene declares no cycles; add  "
                             "macro cycles() number //")
        return None
    from .cycles import Cycles

    begin, count = repeats
    return Cycles(int(np.searchsorted(samples, begin)), count, settings.cycles, plan)


def assemble(directory: Path, comm, lap=lambda stage: None, widen=None,
             ahead: Ahead | None = None) -> Problem:
    """The problem of an export; collective. `lap` is called when reading is done.

    `widen`, if given, returns what it takes, manifest and subdomains, with more load patterns;
    `ahead`, if given, has done a part of the work.
    """
    ahead = ahead or Ahead(directory, comm)
    manifest = read_manifest(directory)
    first, last = partition(manifest.subdomains, comm)
    subdomains = read_subdomains(manifest, first, last, comm, ahead.export)
    interiors = ahead.claim(subdomains)
    if widen:
        manifest, subdomains = widen(manifest, subdomains)
    lap("read")
    structure = build(manifest, subdomains, first, comm)
    return Problem(manifest, structure, DualOperator(structure, comm, interiors))
