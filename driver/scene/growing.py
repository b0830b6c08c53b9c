"""Stage 2 while stage 1 is at work: records are read as soon as FreeFEM has written them."""

import dataclasses
import zlib

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
        self.index = {block: block.first for block in self.files}  # of the record that comes next

    def read(self) -> Subdomain | None:
        """The next subdomain, if its record is whole.

        Raises InputError where a record is not sound, or shares a stiffness that is elsewhere.
        """
        for block, file in self.files.items():
            while (index := self.index[block]) < block.stop:
                record = file.record(self.manifest)
                if record is None:
                    return None
                self.index[block] += 1
                if index >= block.start:
                    self.subdomains += self._subdomain(*record, checks.Place(file.path, index))
                    return self.subdomains[-1]
        return None

    def _subdomain(self, head: records.Head, record: records.Records,
                   place: checks.Place) -> list[Subdomain]:
        """The only one of a record, in a list."""
        checks.check_head(head, self.manifest, place)
        if not head.entries:
            raise InputError(f"{place.path}: the stiffness is in another file")
        stack = record.stack(records.record_layout(head, self.manifest))
        return subdomains_of(stack, head, self.manifest, self.pieces, place)

    def is_beginning_of(self, blocks: dict[Block, RecordFile]) -> bool:
        """Whether sealed files begin with what was read; they go on after it if they do."""
        found = blocks.keys() == self.files.keys() and all(
            zlib.crc32(blocks[block].words[: file.words]) == file.check
            for block, file in self.files.items())
        for block, file in self.files.items() if found else ():
            blocks[block].position = file.words
        return found
