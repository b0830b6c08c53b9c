"""Progress of a run and of those that its errors are estimated from: a bar on a terminal, else
lines; and of FreeFEM, where it takes long.
"""

import os
import re
import sys
import time
from pathlib import Path

from ..environment import EVERY_STEP
from ..scene.manifest import announced
from .workspace import lock_log

STEP = re.compile(r": step (\d+)/(\d+), ")  # in the line of `Progress.update`

# seconds of FreeFEM's, or of a step, after which a line says what it does; then twice as many, ...
LONG = 10.0
SELDOM = 5.0  # seconds without a line, so that short estimates have none


def _bar(label: str, total: int, **more):
    """A bar of so many steps on a terminal, elsewhere None."""
    if not sys.stderr.isatty():
        return None
    from tqdm import tqdm

    return tqdm(total=total, desc=label, unit="step", file=sys.stderr, **more)


class Progress:
    """Finished steps, residual, remaining time: a bar on a terminal, else lines; a log."""

    def __init__(self, total: int, done: int, label: str, quiet: bool, log: Path | None):
        """`done` steps of `total` are those of an interrupted run."""
        self.total, self.done, self.label, self.quiet, self.bar = total, done, label, quiet, None
        self.verdict = None  # on the last cycle
        self.log = open(log, "a") if log else None
        if self.log:
            lock_log(self.log)
        if not quiet:
            self.bar = _bar(label, total, initial=done)
        self.start = self.begun = time.perf_counter()  # ... of the step at work
        self.due, self.before = LONG, None  # when to report that it goes on; products before it

    def within(self, index: int, products: int, residual: float | None) -> None:
        """Report that step `index` takes long, after so many `products` of all steps."""
        now = time.perf_counter()
        if self.before is None:
            self.before = products
        if now - self.begun < self.due:
            return
        self.due = 2 * (now - self.begun)
        if not self.quiet and self.bar is None:
            left = "" if residual is None else f", residual {residual:.1e}"
            print(f"{self.label}: step {index}/{self.total} has taken {now - self.begun:.0f} s so "
                  f"far, {products - self.before} products{left}", flush=True)

    def update(self, step) -> None:
        """Report one finished step."""
        self.begun, self.due, self.before = time.perf_counter(), LONG, None
        spent, kkt = time.perf_counter() - self.start, f"{max(step.residuals.values()):.1e}"
        iterations, products = step.fixed_point_iterations, step.products
        line = (f"{self.label}: step {step.index}/{self.total}, {iterations} fixed-point "
                f"iterations, {products} products, KKT residual {kkt}")
        self.note(f"{line}, {spent:.2f} s")
        due = (step.index % max(1, self.total // 5) == 0 or step.index == self.total
               or EVERY_STEP in os.environ)
        if self.bar is not None:
            self.bar.set_postfix(fixed_point=iterations, products=products, kkt=kkt)
            self.bar.update()
        elif due and not self.quiet:
            remaining = spent * (self.total - step.index) / (step.index - self.done)
            print(f"{line}, {remaining:.0f} s left", flush=True)

    def judge(self, cycles) -> None:
        """Report the cycle that has ended: on the screen where it says something new."""
        self.total, (last, *_) = cycles.total, cycles.past.rows[::-1]
        state = (f"{'' if last['settled'] else 'not '}settled, {last['kind']}, change "
                 f"{last['change']:.1e}")
        verdict = last["kind"], last["settled"]
        if last["cycle"] == 1 and not last["settled"]:
            state, verdict = "no previous cycle to compare with", ("", False)
        line = f"{self.label}: cycle {last['cycle']}: {state}, slip {last['slip']:.3g}"
        self.note(line)
        if self.bar is None and not self.quiet and verdict != self.verdict:
            print(line, flush=True)
        self.verdict = verdict

    def note(self, line: str) -> None:
        """One line for the log alone."""
        if self.log:
            print(line, file=self.log, flush=True)

    def close(self, outcome: str) -> None:
        """Leave the bar and close the log with how the run ended."""
        self.note(outcome)
        if self.log:
            self.log.close()
        if self.bar is not None:
            self.bar.close()


class Watch:
    """What is said while companions of a run, or runs of a search, are solved one after the other.
    """

    def __init__(self, label: str, quiet: bool, search: bool = False):
        """`label` of the run; `quiet`: nothing is said; `search`: it is one for ACCURACY."""
        self.label, self.quiet, self.search, self.bar = label, quiet, search, None
        self.about, self.companion, self.total, self.done = "", 0, 0, 0
        self.start = self.spoken = time.perf_counter()

    def stage(self, name: str, names: list[str]) -> None:
        """Begin one of the stages of the estimates, `names`."""
        self.about = f"{names.index(name) + 1}/{len(names)}, {name}"

    def begin(self, total: int) -> None:
        """Begin a companion of `total` steps."""
        self.companion, self.total, self.done = self.companion + 1, total, 0
        self.start = time.perf_counter()
        if not self.quiet:
            self.bar = _bar(self.words, total, leave=False)

    def update(self) -> None:
        """A step of the companion is done."""
        now, self.done = time.perf_counter(), self.done + 1
        if self.bar is not None:
            self.bar.update()
        elif not self.quiet and now - self.spoken >= SELDOM:
            left = (now - self.start) * max(self.total - self.done, 0) / self.done
            self.spoken = now
            print(f"{self.words}, step {self.done}/{self.total}, {left:.0f} s remaining",
                  flush=True)

    def end(self) -> None:
        """The companion has ended."""
        if self.bar is not None:
            self.bar.close()
            self.bar = None

    @property
    def words(self) -> str:
        """Stage and companion, or run of a search, that are at work."""
        if self.search:
            return f"{self.label}: ACCURACY, run {self.companion}"
        return f"{self.label}: error estimates {self.about}: companion {self.companion}"


class Waiting:
    """What is said while FreeFEM is at work."""

    def __init__(self, label: str, export: Path, quiet: bool):
        """`label` of the run; `export`: where FreeFEM writes to; `quiet`: nothing is said."""
        self.label, self.export, self.quiet = label, export, quiet
        self.start, self.due = time.perf_counter(), LONG

    def update(self) -> bool:
        """Say how long it has taken if that is due; True: FreeFEM may be at work for longer."""
        spent = time.perf_counter() - self.start
        if not self.quiet and spent >= self.due:
            self.due = 2 * spent
            known, doing = announced(self.export), "meshes"
            if known:
                doing = f"assembles {known.nodes:,} nodes in {known.subdomains:,} subdomains"
            print(f"{self.label}: FreeFEM {doing}, {spent:.0f} s so far", flush=True)
        return True
