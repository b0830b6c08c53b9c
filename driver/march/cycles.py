"""Cycles of a repeated history: the steps of one after the other, and jumps over many.

What each comes to is judged in cycle_verdict.py. A step is solved until slips are right to
PRIMAL_RTOL of the deformation, so a cycle of n steps knows them to n times as much: what is less
counts as nothing.

Jumps: what a cycle hands on to the next one (displacements of the contact nodes from which slip is
counted, worn depths, accumulated slips, rigid motions) grows by d in the last cycle. Where d
itself changes little from cycle to cycle the state N cycles later is taken for the present one
plus N d. The change of d over the last cycle limits N; the first cycle after the jump grows by d',
and as long as the growth of the cycles between lies between d and d' the jump errs by at most
N |d' - d|, which is the error that is stated. See Cojocaru, Karlsson, Int. J. Fatigue 28 (2006)
1677, for jumps of this kind.
"""

from dataclasses import asdict

import numpy as np
from mpi4py import MPI

from ..feti.gathering import by_node
from .cycle_verdict import (FOLLOWING, MOVED, RIGID, ROUNDED, Choice, Cycle, Past, judged,
                            significant)

SHORTEST = 2  # cycles that are worth a jump


class Cycles:
    """Follows a solver through the cycles of its history. Collective.

    k nodes with a normal row, j with a tangential one.
    """

    def __init__(self, begin: int, count: int, choice: str, plan: list[int] | None = None):
        """`begin`: the step after which a cycle begins, in the solver's history with one cycle.

        `count` cycles unless the option `choice` says otherwise. `plan`, of a companion: what was
        skipped after each cycle of the run.
        """
        self.begin, self.choice, self.given = begin, Choice.of(choice), plan
        self.count = self.choice.count or count
        if plan is not None:
            self.count = len(plan) + sum(plan)
        self.past = Past()

    # ---- the history -----------------------------------------------------------------------------
    def join(self, solver) -> None:
        """The history of `solver`, which has one cycle, gets the second."""
        self.length = len(solver.times) - 1 - self.begin
        own = slice(self.begin + 1, None)
        self.times, self.amplitudes = solver.times[own].copy(), solver.amplitudes[own].copy()
        self.period = float(solver.times[-1] - solver.times[self.begin])
        self.loads = solver.loads[self.begin:]
        self._extend(solver)

    @property
    def total(self) -> int:
        """Steps of the whole history, but for cycles that are known to be skipped."""
        skipped = self.past.plan if self.given is None else self.given
        return self.begin + self.length * (self.count - sum(skipped))

    def _extend(self, solver) -> None:
        """The cycle at hand and the next one, which loads to come are judged by."""
        done = len(self.past.plan)
        wanted = min(done + 2, done + self.count - self.past.number)
        have = (len(solver.times) - 1 - self.begin) // self.length
        for k in range(have, wanted):
            lap = self.past.number + k - done
            solver.times = np.concatenate([solver.times, self.times + lap * self.period])
            solver.amplitudes = np.concatenate([solver.amplitudes, self.amplitudes])
            solver.loads = [*solver.loads, *self.loads]

    def _cut(self, solver, index: int) -> None:
        """Forget what comes after step `index`."""
        solver.times, solver.amplitudes = (values[: index + 1] for values in (
            solver.times, solver.amplitudes))
        solver.loads = solver.loads[:index]

    def place(self, index: int) -> int:
        """The step of the declared history, with its one cycle, that step `index` repeats."""
        return min(index, self.begin + (index - self.begin - 1) % self.length + 1)

    # ---- step by step ----------------------------------------------------------------------------
    def before(self, solver, index: int) -> None:
        """Step `index` comes next."""
        if index == self.begin + 1 and not self.past.start:
            self.past.start = self._carried(solver)
            self._renew(solver)

    def _renew(self, solver) -> None:
        """A cycle begins."""
        self._renew_forces()
        self.past.way = np.zeros(len(solver.rows.tangential))

    def _renew_forces(self) -> None:
        self.past.forces = {"normal": [], "tangential": []}

    def follow(self, solver, step, slip: np.ndarray) -> None:
        """Step `step`, with slips (j,), has ended; judge the cycle that ends with it."""
        if step.index <= self.begin:
            return
        past, rows, bound = self.past, solver.rows, step.friction_bound
        past.forces["normal"].append(step.multipliers[rows.normal])
        past.forces["tangential"].append(step.multipliers[rows.tangential])
        slides = (np.abs(step.multipliers[rows.tangential]) >= bound) & (bound > 0)
        past.way = past.way + np.where(slides, np.abs(slip), 0.0)
        if (step.index - self.begin) % self.length == 0:
            self._end(solver, step)

    def _end(self, solver, step) -> None:
        """A cycle has ended: its row, and what comes next."""
        past = self.past
        past.number += 1
        now = self._carried(solver)
        growth = {name: now[name] - past.start[name] for name in now}
        forces = {name: np.array(values) for name, values in past.forces.items()}
        row = judged(past, step, growth, forces, _largest(solver), self.nothing(solver),
                     ROUNDED * solver.settings.primal_rtol)
        self._warn(solver, row, growth)
        past.rows.append(asdict(row))
        step.cycle = past.number
        step.skips = self._skips(solver, row, growth)
        past.plan.append(step.skips)
        past.start, past.growth = now, growth
        past.before, past.older = forces, past.before
        if self.given is None and self.choice.settles and row.settled:
            self.count = past.number
            self._cut(solver, step.index)
        if step.skips:
            step.grown = tuple(significant(growth, self.nothing(solver), _largest(solver),
                                           row.slip))
            self._jump(solver, step, growth)
            self._cut(solver, step.index)
        self._extend(solver)
        self._renew(solver)

    def warnings(self) -> list[str]:
        """That cycles have not settled where the run was to go on until they had."""
        rows = self.past.rows
        if self.given is not None or not self.choice.settles or rows and rows[-1]["settled"]:
            return []
        return [f"the cycles have not settled after cycle {self.past.number}: CYCLES=\"n until "
                "settled\" allows more"]

    # ---- checkpoints -----------------------------------------------------------------------------
    def kept(self, solver) -> dict | None:
        """What `resume` goes on from, nodal arrays by contact node, on rank 0; collective."""
        past, comm, rows = self.past, solver.operator.comm, solver.rows
        nodal = {f"{part}.{name}": values for part in ("start", "growth")
                 for name, values in getattr(past, part).items() if name not in RIGID}
        if past.way is not None:
            nodal["way"] = past.way
        pressed = {}
        for part in ("older", "before", "forces"):
            for name, values in getattr(past, part).items():
                for k, value in enumerate(values):
                    (pressed if name == "normal" else nodal)[f"{part}.{name}.{k}"] = value
        count = len(solver.operator.structure.contact.gid)
        nodal = by_node(nodal, rows.tangential_node, count, comm)
        pressed = by_node(pressed, rows.normal_node, count, comm)
        rigid = {f"{part}.{name}": values for part in ("start", "growth")
                 for name, values in getattr(past, part).items() if name in RIGID}
        return {"number": past.number, "plan": past.plan, "rows": past.rows, "count": self.count,
                "times": solver.times, "rigid": rigid, "nodal": nodal, "pressed": pressed}

    def resume(self, solver, state: dict) -> None:
        """Go on from what `kept` returned; the same on every rank."""
        past, rows = self.past, solver.rows
        past.number, past.plan, past.rows = state["number"], state["plan"], state["rows"]
        self.count = state["count"]
        have = (len(state["times"]) - 1 - self.begin) // self.length
        first = self.begin + 1
        solver.times = state["times"]
        solver.amplitudes = np.concatenate([solver.amplitudes[:first], *have * [self.amplitudes]])
        solver.loads = [*solver.loads[: self.begin], *have * self.loads]
        values = {**state["rigid"],
                  **{name: array[rows.tangential_node] for name, array in state["nodal"].items()},
                  **{name: array[rows.normal_node] for name, array in state["pressed"].items()}}
        past.way = values.pop("way", None)
        self._renew_forces()
        for name, array in values.items():
            part, name = name.split(".", 1)
            if part in ("start", "growth"):
                getattr(past, part)[name] = array
            else:
                name, _ = name.split(".")
                getattr(past, part).setdefault(name, []).append(array)
        past.before, past.older = ({name: np.array(steps) for name, steps in part.items()}
                                   for part in (past.before, past.older))

    # ---- judgement -------------------------------------------------------------------------------
    def nothing(self, solver) -> float:
        """Slip over a cycle that tolerances leave open."""
        return self.length * solver.settings.primal_rtol * float(
            np.max(solver.scales.largest["displacements"]))

    def _warn(self, solver, row: Cycle, growth: dict) -> None:
        """Where the jump before a cycle with a `growth` errs by more than was foreseen."""
        counted = significant(growth, self.nothing(solver), _largest(solver), row.slip)
        grown = max((_largest(solver)(growth[name]) for name in counted), default=0.0)
        if row.error > 2 * (self.choice.jumps or 1.0) * row.skipped * grown > 0:
            solver.history.warnings.append(
                f"cycle {row.cycle}: the jump over the {row.skipped} cycles before it has an "
                f"estimated error of {row.error:.3g}, beside a growth of up to {grown:.3g} per "
                "cycle: a smaller error, as in CYCLES=\"jump 0.1%\", makes shorter jumps")

    # ---- jumps -----------------------------------------------------------------------------------
    def _skips(self, solver, row: Cycle, growth: dict) -> int:
        """How many cycles to jump over after the one of `row`."""
        past, left = self.past, self.count - self.past.number
        if self.given is not None:
            return self.given[len(past.plan)]
        if self.choice.jumps is None or left <= SHORTEST:
            return 0
        nothing, largest = self.nothing(solver), _largest(solver)
        names = significant(growth, nothing, largest, row.slip)
        if not names:
            return left - 1 if row.settled else 0
        if not past.growth or past.plan[-1]:  # the growth before is that before a jump
            return 0
        room = min(self.choice.jumps * largest(growth[name])
                   / max(largest(growth[name] - past.growth[name]), 1e-300) for name in names)
        skips = int(min(room - 1, left - 1))
        return skips if skips >= SHORTEST else 0

    def _jump(self, solver, step, growth: dict) -> None:
        """The state `step.skips` cycles later."""
        names = [*step.grown, *(FOLLOWING if MOVED in step.grown else ())]
        steps = {name: step.skips * growth[name] for name in names}
        nodes = solver.rows.tangential_node
        for name, values in solver.effects.carried().items():
            if name in steps:
                values[nodes] += steps[name]
        if "elastic" in steps:
            solver.slip.elastic = solver.slip.elastic + steps["elastic"]
            solver.slip.weights = solver.slip.weights + steps["weights"]
            solver.motion = solver.motion + steps["motion"]
            solver.older_motion = solver.older_motion + steps["motion"]
            solver.bodies.placed = solver.bodies.placed + steps["placed"]
        self.past.number += step.skips
        self.past.start = {name: values + steps.get(name, 0.0)
                           for name, values in self.past.start.items()}

    @staticmethod
    def _carried(solver) -> dict[str, np.ndarray]:
        """What a cycle hands on to the next: at the rank's nodes (j,), and rigid motions."""
        nodes, slip = solver.rows.tangential_node, solver.slip
        return {MOVED: slip.u_t, "elastic": slip.elastic.copy(), "weights": slip.weights.copy(),
                "motion": solver.motion.copy(), "placed": solver.bodies.placed.copy(),
                **{name: values[nodes].copy() for name, values in solver.effects.carried().items()
                   if values.dtype != bool}}


def _largest(solver):
    """The largest size of an entry of arrays, on all ranks."""
    def largest(*arrays) -> float:
        own = max((float(np.abs(values).max(initial=0.0)) for values in arrays), default=0.0)
        return solver.operator.comm.allreduce(own, op=MPI.MAX)

    return largest
