"""Records of an export that are read as soon as FreeFEM, still at work, has written them."""

import dataclasses

from ..errors import InputError
from . import record_checks as checks
from . import records
from .loader import Block, Pieces, blocks_of, subdomains_of
from .manifest import Manifest
from .records import GrowingFile, RecordFile
from .subdomain import Subdomain


@dataclasses.dataclass
class GrowingExport:
    """The subdomains start <= s < stop of an export, as far as they are there.

    Nothing is sealed yet: `is_beginning_of` tells whether what was read is what FreeFEM left.
    """

    manifest: Manifest
    start: int
    stop: int

    def __post_init__(self):
        self.subdomains, self.pieces = [], Pieces(self.manifest)
        self.files = {block: GrowingFile(block.path)
                      for block in blocks_of(self.manifest, self.start, self.stop)}
        self.index = {block: block.held[0] for block in self.files}  # of the record that comes next

    def read(self) -> Subdomain | None:
        """The next subdomain, if its record is whole.

        Raises InputError where a record is not sound, or shares a stiffness that is elsewhere.
        """
        for block, file in self.files.items():
            while (index := self.index[block]) < block.wanted[1]:
                head, place = file.head(), checks.Place(file.path, index)
                if head is None:
                    return None
                checks.check_head(head, self.manifest, place)
                if not head.entries:
                    raise InputError(f"{file.path}: the stiffness is in another file")
                layout = records.record_layout(head, self.manifest)
                record = file.record(layout)
                if record is None:
                    return None
                self.index[block] += 1
                if index >= block.wanted[0]:
                    self.subdomains += subdomains_of(record.stack(layout), head, self.manifest,
                                                     self.pieces, place)
                    return self.subdomains[-1]
        return None

    def is_beginning_of(self, manifest: Manifest, blocks: dict[Block, RecordFile]) -> bool:
        """Whether sealed files begin with what was read; they go on after it if they do."""
        found = self.manifest.raw == manifest.raw and blocks.keys() == self.files.keys() and all(
            blocks[block].check_of(file.words) == file.check for block, file in self.files.items())
        for block, file in self.files.items() if found else ():
            blocks[block].position = file.words
        return found
