"""Exports of a scene with parameters changed, some of them made before they are asked for.

Another process makes those while this one solves. FreeFEM works for one of them at a time: scenes
may call programs, gmsh say, that leave files of the same name for every mesh.
"""

import contextlib
import fcntl
import resource
import shutil
import time
from pathlib import Path

from ..errors import DriverError
from ..processes import CORES, Series
from ..scene import freefem


def spelled(value: float | str) -> str:
    """A parameter as on the command line."""
    return value if isinstance(value, str) else f"{value:.17g}"


class Exports:
    """Exports of one scene into directories in `folder`, which `close` removes."""

    def __init__(self, scene: Path, parameters: dict[str, str], without, folder: Path):
        """`parameters` of the command line; `without`: effects treated as undeclared."""
        self.scene, self.parameters, self.without, self.folder = scene, parameters, without, folder
        self._ahead: dict = {}  # by place: the series that makes an export, and its number there

    def ahead(self, *exports: tuple) -> None:
        """Have another core make `exports` one after the other, each with the arguments of `made`.

        Where there is no other core nothing is done.
        """
        if CORES == 1:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        series = Series(lambda number: self._made_ahead(*exports[number]), len(exports))
        self._ahead |= {place: (series, number) for number, (place, *_) in enumerate(exports)}

    def made(self, place: Path, changes: dict, sizes: Path | None = None) -> float:
        """Seconds of the export to `place` with `changes`: of the processor, if it was made ahead.

        `sizes`: stem of a field of element sizes. Raises as scene.freefem.export.
        """
        if place in self._ahead:
            series, number = self._ahead[place]
            seconds = series.wait(number)
            if seconds is not None:
                return seconds
        clock = time.perf_counter()
        with self._turn(asked=True) if self._ahead else contextlib.nullcontext():
            self._make(place, changes, sizes)
        return time.perf_counter() - clock

    def close(self) -> None:
        """End exports that are under way, and remove all."""
        for series in {series for series, _ in self._ahead.values()}:
            series.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _made_ahead(self, place: Path, *what) -> float | None:
        """As `made`, in another process; None if it fails: whoever asks for it meets the reason."""
        before = _of_programs()
        try:
            with self._turn():
                self._make(place, *what)
        except (DriverError, OSError):
            shutil.rmtree(place, ignore_errors=True)
            return None
        return _of_programs() - before

    def _make(self, place: Path, changes: dict, sizes: Path | None = None) -> None:
        words = {name: spelled(value) for name, value in changes.items()}
        freefem.export(self.scene, place, {**self.parameters, **words}, sizes=sizes,
                       without=self.without)

    @contextlib.contextmanager
    def _turn(self, asked: bool = False):
        """A block in which no other export of the scene is made; one that is `asked` for is next.

        Locks end with their process, however that ends.
        """
        with open(self.folder / "turn", "w") as turn, open(self.folder / "asked", "w") as first:
            fcntl.flock(first, fcntl.LOCK_EX)
            if not asked:  # nobody waits: whoever does keeps it until he is through
                fcntl.flock(first, fcntl.LOCK_UN)
            fcntl.flock(turn, fcntl.LOCK_EX)
            yield


def _of_programs() -> float:
    """Processor seconds of the programs that this process has started and that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
