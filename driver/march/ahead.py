"""What a run does of reading and reduction while FreeFEM still writes.

A subdomain is read when its record is whole, and its interior eliminated, for which its own record
is enough; corners, rows and classes need all of them. Nothing depends on how far it came: numbers
that were made ahead have the bits of those that are made afterwards.
"""

import operator
from pathlib import Path

from ..errors import DriverError, shortage
from ..feti.cholesky import Interior
from ..feti.reduction import interior_of
from ..feti.structure import partition
from ..scene.growing import GrowingExport
from ..scene.manifest import announced
from ..scene.subdomain import Subdomain
from ..timing import Laps, memory_used


class Ahead:
    """The export in `directory`, of which this rank of `comm` takes its subdomains."""

    def __init__(self, directory: Path, comm):
        self.directory, self.comm = directory, comm
        self.idle = memory_used()  # MiB before anything is read
        self.seconds = {"read": 0.0, "setup": 0.0}  # that were spent ahead
        self.export: GrowingExport | None = None
        self.interiors: dict[int, Interior] = {}  # by numbers of subdomains
        self._ends = False  # nothing more can be done ahead

    def advance(self) -> bool:
        """Take the next subdomain; whether there was one.

        What is not sound, cannot be read or has no room is left for those who come after.
        """
        try:
            return not self._ends and self._take()
        except Exception as problem:
            if not (isinstance(problem, (DriverError, OSError)) or shortage(problem)):
                raise
            self._drop()
            return False

    def claim(self, subdomains: list[Subdomain]) -> dict[int, Interior]:
        """By their numbers the interiors of those `subdomains` that were taken ahead, and count.

        Nothing is kept.
        """
        taken = self.export.subdomains if self.export else []
        counts = all(map(operator.is_, taken, subdomains))
        interiors = self.interiors if counts else {}
        self._drop()
        return interiors

    def _drop(self) -> None:
        self.export, self.interiors, self._ends = None, {}, True

    def _take(self) -> bool:
        if self.export is None:
            manifest = announced(self.directory)
            if manifest is None:
                return False
            self.export = GrowingExport(manifest, *partition(manifest.subdomains, self.comm))
        before, lap = self.export.subdomains[-1:], Laps()
        sub = self.export.read()
        lap("read")
        if sub is None:
            return False
        # one like the one before is of its class, and will not need a factor of its own
        if not any(sub.stiffness is other.stiffness for other in before):
            self.interiors[sub.index] = interior_of(sub)
        lap("setup")
        self.seconds = {stage: spent + lap.seconds[stage] for stage, spent in self.seconds.items()}
        return True
