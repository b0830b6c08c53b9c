"""Estimates of the error in the energy norm for a run's last and most energetic steps.

Where contact carries nothing in the last step, quantities belong to that in which it carries most:
that is estimated as well.

Of P1 elements it is the bound of `bound`. Of quadratic ones, where an effect of the scene leaves
no bound (its room says why), or where ESTIMATOR says so, it is the difference between the computed
and a recovered stress: an estimate, low where stresses are singular.
"""

from functools import cached_property

import numpy as np

from ..effects import Effects
from ..march.step import Step
from ..results.quantities import NOTHING as CARRIED  # part of the largest that is none
from ..scene.manifest import Manifest
from . import recovery
from .bound import (COULOMB, EARLIER, EXCLUDED, EquilibratedBound, Estimate,
                    coupling)
from .torn_body import Gather, TornBody, gather_body

QUADRATIC = "equilibrated stresses have the degree that bounds linear elements only"
BOTH = ("where bilateral and unilateral contact meet, tractions between nodes have no single sign")
NOTHING = 1e-6  # relative displacements below this are what tolerances leave


class EnergyEstimator:
    """Estimates for the last step and that with most energy. Collective; rank 0 computes."""

    bound_of = EquilibratedBound

    def __init__(self, operator, manifest: Manifest, contact, kind: str):
        """`contact` is a ContactState; `kind` "equilibrated" (the bound), "recovery" or "none"."""
        self.quadratic = manifest.element != "P1"
        self.operator, self.manifest, self.contact = operator, manifest, contact
        self.why = self._no_bound() if kind == "equilibrated" else ""
        self.kind = "recovery" if self.why else kind
        self.gather = Gather(operator)
        self.bound = None
        self.last = self.largest = self.carrying = None  # (energy, step, contact state)

    def _no_bound(self) -> str:
        """Why smoothed stresses take the place of the bound; empty where they do not."""
        if self.quadratic:
            return QUADRATIC
        return Effects(self.manifest).no_bound() or (BOTH if self._changes_kind() else "")

    def consider(self, step: Step, state: dict, energy: float) -> None:
        """Keep a finished step, its contact state and energy, if its estimate may be wanted."""
        self.last = (energy, step, state)
        if self.largest is None or energy > (1 + 1e-9) * self.largest[0]:
            self.largest = self.last
        if self.carrying is None or self._carried(self.last) > self._carried(self.carrying):
            self.carrying = self.last

    def _carried(self, kept: tuple) -> float:
        """What contact carries in a step that is kept."""
        pressure = np.abs(kept[2].get("sigma_n", np.zeros(0)))
        return float(pressure @ self.contact.boundary.weight) if len(pressure) else 0.0

    def kept(self, index: int) -> Step | None:
        """The step of an index, if it is one of those that are kept."""
        steps = (k[1] for k in (self.last, self.largest, self.carrying) if k is not None)
        return next((step for step in steps if step.index == index), None)

    @cached_property
    def body(self) -> TornBody | None:
        """The torn body on rank 0; collective when it is asked for first."""
        return gather_body(self.gather)

    @property
    def considered(self) -> list[tuple[Step, dict]]:
        """The last step, that with most energy, if another one, and where contact carries nothing
        in the last one that in which it carries most, with their contact states.
        """
        kept = [k for k in (self.last, self.largest) if k is not None]
        kept += [self.carrying] if self._lost else []
        return [(step, state) for _, step, state in {k[1].index: k for k in kept}.values()]

    @property
    def _lost(self) -> bool:
        """Whether contact carries nothing in the last step, and did so before."""
        if self.last is None:
            return False
        most = self._carried(self.carrying)
        return most > 0 and self._carried(self.last) <= CARRIED * most

    def unloaded(self, estimates: list[tuple[Step, Estimate]]) -> Estimate | None:
        """Of the step in which contact carries most, if it carries nothing in the last one and
        the step is in none of the `estimates`; the same on all ranks.
        """
        if not estimates or not self._lost:
            return None
        _, step, state = self.carrying
        if step.index in (other.index for other, _ in estimates):
            return None
        return self.operator.comm.bcast(self._estimate(step, state))

    def estimates(self) -> list[tuple[Step, Estimate]]:
        """Of the last step and that with most energy, if another one; the same on all ranks.

        A last step without load, whose displacements tolerances have left, is left out.
        """
        if self.kind == "none" or self.last is None:
            return []
        wanted = [self.largest]
        loaded = self.last[0] > NOTHING**2 * self.largest[0]
        if loaded and self.last[1].index != self.largest[1].index:
            wanted.insert(0, self.last)
        if self.kind == "equilibrated":
            self.bound = self.bound_of(self.gather, self.operator, self.manifest, self.contact,
                                       self.body)
        return [(step, self.operator.comm.bcast(self._estimate(step, state)))
                for _, step, state in wanted]

    def _estimate(self, step: Step, state: dict) -> Estimate | None:
        """The estimate of one step on rank 0, None elsewhere."""
        if reason := Effects(self.manifest).no_estimate(step.weights):
            return Estimate(step.index, reason=reason)
        self.operator.follow(step)
        displacements = self.operator.deformations(step.multipliers, step.weights)
        if self.bound is not None:
            found = self.bound.estimate(step, state, displacements)
            if found is not None and Effects(self.manifest).pressure_bounds_friction:
                found.coupling = coupling(found.total, step.contraction)
            return found
        if self.manifest.axisymmetric:
            return self._recover_revolved(step, displacements)
        return self._recover(step, displacements)

    def _changes_kind(self) -> bool:
        """Whether a contact edge lies between a bilateral and a unilateral node."""
        b, bilateral = self.contact.boundary, self.contact.law.bilateral
        edges = b.edges[(b.edges < len(bilateral)).all(axis=1)]
        return bool((bilateral[edges[:, 0]] != bilateral[edges[:, 1]]).any() or any(
            len(np.unique(bilateral[b.family == k + 1])) > 1 for k in range(len(b.meeting))))

    def _recover_revolved(self, step: Step, displacements: list[np.ndarray]) -> Estimate | None:
        """As `_recover`, of bodies of revolution: hoop strains vary on linear elements, too."""
        from . import revolution  # here: plane scenes do not need it

        share = revolution.squares(self.gather, self.body, displacements, step.weights,
                                   self.quadratic)
        if share is None:
            return None
        error, norm = share
        return _recovered(step, error, float(np.sqrt(norm.sum())))

    def _recover(self, step: Step, displacements: list[np.ndarray]) -> Estimate | None:
        """Estimate from recovered stresses on rank 0."""
        found = recovery.deviation(self.gather, self.body, displacements, self.quadratic,
                                   step.weights)
        if found is None:
            return None
        share, square = (recovery.energy(self.body.area, self.body.compliance, stress)
                         for stress in found)
        return _recovered(step, share, float(np.sqrt(square.sum())))


def _recovered(step: Step, share: np.ndarray, norm: float) -> Estimate:
    """The estimate by squares `share` (n_t,) of the triangles' errors."""
    size = np.sqrt(share.sum())
    return Estimate(step.index, mesh=size, total=size, norm=norm, indicator=np.sqrt(share))


def excluded(manifest: Manifest) -> list[str]:
    """What the bound of a scene does not bound."""
    effects = Effects(manifest)
    return [*([EARLIER] if effects.frictional and manifest.steps > 1 else []), *EXCLUDED,
            *([COULOMB] if effects.pressure_bounds_friction else [])]


def report(estimates: list[tuple[Step, Estimate]], kind: str, left_out=(), why: str = "",
           carrying: Estimate | None = None) -> dict:
    """Entry for summary.json: of the last step and, as `largest`, of that with most energy.

    `left_out`: what a bound of this scene does not bound; `why` it has none; `carrying`: as of
    `unloaded`.
    """
    if not estimates:
        return {"kind": kind}
    entries = [_entry(e) for _, e in estimates]
    smoothed = ": ".join(filter(None, ("an estimate from smoothed stresses, not a bound", why)))
    named = {"excluded": list(left_out)} if kind == "equilibrated" else {"why": smoothed}
    return {"kind": kind, **entries[0], **({"largest": entries[1]} if len(entries) > 1 else {}),
            **({"carrying": _entry(carrying)} if carrying else {}), **named}


def _entry(e: Estimate) -> dict:
    """An estimate in summary.json."""
    if e.reason:
        return {"step": e.step, "reason": e.reason}
    names = ("mesh", "solver", "friction", "correction", "total", "coupling", "norm")
    return {"step": e.step, **{name: float(getattr(e, name)) for name in names},
            "relative": float(e.total / e.norm) if e.norm > 0 else 0.0}


def of_level(problem, level, kind: str) -> dict:
    """Entry for summary.json of the step to which a finished run's quantities belong; collective.

    `level`: of estimates/levels.py; `kind` as of EnergyEstimator.
    """
    step = level.steps[level.at]
    estimator = EnergyEstimator(problem.operator, problem.manifest, level.record.contact, kind)
    problem.operator.follow(step)
    estimator.consider(step, level.record.state(level.at), 1.0)
    return report(estimator.estimates(), estimator.kind)


def of_time(budget: dict, energy: dict) -> dict:
    """What time steps add in the energy norm, {"time": ...}, by the `budget` of the quantities.

    What dissipated energies of two evolutions differ by is taken for the elastic energy of their
    difference, half the square of its norm: an estimate. Empty where the difference is not known,
    or where friction has taken more than the bodies ever store by `energy`, the entry of the
    summary: on a way that is long beside the deformation its work errs by the force times what the
    steps miss of the way, of which nothing is stored.
    """
    work = budget.get("dissipated_energy", {})
    norm = max(entry.get("norm", 0.0) for entry in (energy, energy.get("largest", {})))
    if work.get("time") is None or 2 * work["value"] > norm**2:
        return {}
    return {"time": float(np.sqrt(2 * work["time"]))}
