"""Progress of the runs that errors are estimated from: a bar on a terminal, else lines; and of
FreeFEM, where it takes long.
"""

import sys
import time
from pathlib import Path

from ..scene.manifest import announced

LONG = 10.0  # seconds of FreeFEM's after which a line says what it does; then twice as many, ...
SELDOM = 5.0  # seconds without a line, so that short estimates have none


class Watch:
    """What is said while companions of a run are solved, one after the other."""

    def __init__(self, label: str, quiet: bool):
        """`label` of the run; `quiet`: nothing is said."""
        self.label, self.quiet, self.bar = label, quiet, None
        self.about, self.companion, self.total, self.done = "", 0, 0, 0
        self.start = self.spoken = time.perf_counter()

    def stage(self, name: str, names: list[str]) -> None:
        """Begin one of the stages of the estimates, `names`."""
        self.about = f"{names.index(name) + 1}/{len(names)}, {name}"

    def begin(self, total: int) -> None:
        """Begin a companion of `total` steps."""
        self.companion, self.total, self.done = self.companion + 1, total, 0
        self.start = time.perf_counter()
        if not self.quiet and sys.stderr.isatty():
            from tqdm import tqdm

            self.bar = tqdm(total=total, desc=self.words, unit="step", file=sys.stderr,
                            leave=False)

    def update(self) -> None:
        """A step of the companion is done."""
        now, self.done = time.perf_counter(), self.done + 1
        if self.bar is not None:
            self.bar.update()
        elif not self.quiet and now - self.spoken >= SELDOM:
            left = (now - self.start) * max(self.total - self.done, 0) / self.done
            self.spoken = now
            print(f"{self.words}, step {self.done}/{self.total}, {left:.0f} s left of it",
                  flush=True)

    def end(self) -> None:
        """The companion has ended."""
        if self.bar is not None:
            self.bar.close()
            self.bar = None

    @property
    def words(self) -> str:
        """Stage and companion that are at work."""
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
