"""What a run does of reading and reduction while FreeFEM still writes.

A subdomain is read when its record is whole, and its interior eliminated, for which its own record
is enough; corners, rows and classes need all of them. Nothing depends on how far it came: numbers
that were made ahead have the bits of those that are made afterwards.
"""

from pathlib import Path

from ..errors import DriverError
from ..feti.cholesky import Interior
from ..feti.reduction import interior_of
from ..feti.structure import partition
from ..scene.growing import GrowingExport
from ..scene.manifest import announced


class Ahead:
    """The export in `directory`, of which this rank of `comm` takes its subdomains."""

    def __init__(self, directory: Path, comm):
        self.directory, self.comm = directory, comm
        self.export: GrowingExport | None = None
        self.interiors: dict[int, Interior] = {}  # by numbers of subdomains
        self._ends = False  # nothing more can be done ahead

    def advance(self) -> bool:
        """Take the next subdomain; whether there was one.

        What is not sound is left for those who read it all to refuse.
        """
        try:
            return not self._ends and self._take()
        except DriverError:
            self.drop()
            return False

    def drop(self) -> None:
        """Forget what was read: it may take memory that is needed, or may not be sound."""
        self.export, self.interiors, self._ends = None, {}, True

    def _take(self) -> bool:
        if self.export is None:
            manifest = announced(self.directory)
            if manifest is None:
                return False
            self.export = GrowingExport(manifest, *partition(manifest.subdomains, self.comm))
        before = self.export.subdomains[-1:]
        sub = self.export.read()
        if sub is None:
            return False
        # one like the one before is of its class, and will not need a factor of its own
        if not any(sub.values is other.values for other in before):
            self.interiors[sub.index] = interior_of(sub)
        return True
