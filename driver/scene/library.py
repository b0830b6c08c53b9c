"""The scripts of the library as text, read once in a process and anew when one has changed."""

import functools
import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

from .. import environment
from . import grammar

WRITTEN = re.compile(r'\b(?:save\w+|ofstream\s+\w+)\s*\([^;"]*"([\w./+-]+)"')  # files


@dataclass(frozen=True)
class Library:
    """What is asked of all scripts together."""

    text: str
    macros: frozenset[str]  # names
    files: frozenset[str]  # of `named_files`
    digest: str

    @functools.cached_property
    def code(self) -> str:
        """The text without comments and what stands in quotes."""
        return grammar.without_texts(self.text)

    def uses(self, name: str) -> bool:
        """Whether a name is a word of its code."""
        word = re.compile(rf"\b{name}\b")
        return bool(word.search(self.text) and word.search(self.code))  # most are not in the text


def named_files(text: str) -> list[str]:
    """What a script names in quotes and may be a file, but for those that it writes."""
    written = WRITTEN.findall(text)
    return [name for name in re.findall(r'"([\w./+-]+)"', text) if name not in written]


def library() -> Library:
    """The library as it is now."""
    paths = sorted(os.path.join(folder, name) for folder, _, names in os.walk(environment.LIBRARY)
                   for name in names if name.endswith(".idp"))
    states = map(os.stat, paths)
    return _read(tuple((path, now.st_mtime_ns, now.st_size) for path, now in zip(paths, states)))


@functools.lru_cache(maxsize=1)
def _read(state: tuple) -> Library:
    """Of scripts in a `state`: path, time of the last change and size of each."""
    digest, texts = hashlib.sha256(), []
    for path in (Path(path) for path, *_ in state):
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)} ".encode() + content)
        texts.append(content.decode())
    text = "\n".join(texts)
    return Library(text, frozenset(re.findall(r"^\s*macro (\w+)", text, re.MULTILINE)),
                   frozenset(name for one in texts for name in named_files(one)),
                   digest.hexdigest())
