"""Rooms: the effects that a scene can declare, as the heads of ``edp/lib/effects/*.idp`` say.

Each room is one FreeFEM include. Its head is comment, documentation and metadata in one:

    // friction.idp - local Coulomb friction: |sigma_t| <= F |sigma_n|.
    // declared by: friction() F
    // needs: contact
    // column: friction >= 0
    //
    //   friction()            coefficient F >= 0; may depend on x, y and label
    //
    // Whatever else a reader should know.

The title ends with the first line that ends with a full stop. Then come entries, each as often as
needed:

- ``declared by``: a macro that declares the effect and an example of its content; ``load#()``
  stands for load1 ... load9.
- ``needs``: rooms without which the effect makes no sense (``friction or tresca``: one of them).
- ``brings``: a room that is included as well, as pairs bring contact.
- ``after``: a room that comes earlier if both are declared.
- ``given on``: of a load, what it is given on, a file of ``edp/lib/given``: the room defines the
  macro ``<room>Form(k)``.
- ``column``: numbers at the contact nodes: the room defines ``<room>Column`` or
  ``<room>Evaluate(column)``; ``>= 0`` where negative ones are refused.
- ``columns``: several of them, as many as the room's number ``<room>Columns`` says, which is known
  when FreeFEM has read the room: it defines ``<room>Evaluate(column)``, column the first of them,
  and ``<room>Names(column)``, which writes their names to the manifest.
- ``studied``: macros and numbers that may differ between the values of a parameter study.
- ``before``: ``material`` of a room that changes strains and integrals: it is included before the
  forms that it changes, and its macros take the place of theirs.

and, indented, the macros and numbers of the scene that the room reads. Names of a room's own macros
begin with its name in camel case (`Room.prefix`).
"""

import functools
import re
from pathlib import Path
from typing import NamedTuple

from .. import environment

EFFECTS = environment.LIBRARY / "effects"
# what loads can be given on: moments by boundary edge, forces by triangle, suppressed stress by
# triangle, forces at nodes, values of fixed dofs
LOADS = ("edges", "triangles", "initial_stress", "nodes", "supports")
NUMBERS = range(1, 10)  # of the loads and their amplitudes
ENTRIES = ("declared by", "needs", "brings", "after", "given on", "column", "columns", "studied",
           "before")
SINGLE = ("given on", "column", "before")  # entries that stand once at most


class Macro(NamedTuple):
    """What a scene may define: a macro, or a number if `arguments` is None, and what it means."""

    name: str  # a final # stands for one of NUMBERS
    arguments: str | None
    text: str = ""

    @property
    def names(self) -> list[str]:
        """The name or, where it is numbered, all of them."""
        return [f"{self.name[:-1]}{k}" for k in NUMBERS] if self.numbered else [self.name]

    @property
    def numbered(self) -> bool:
        """Whether the name stands for several."""
        return self.name.endswith("#")


class Room(NamedTuple):
    """The head of a room, entry by entry."""

    name: str
    title: str
    declared_by: dict[str, str]  # examples of contents, by name of the macro; numbered: with #
    needs: tuple[tuple[str, ...], ...] = ()  # one out of each
    brings: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    given_on: str | None = None
    column: str | None = None
    nonnegative: bool = False  # of the column
    columns: tuple[str, ...] = ()
    studied: tuple[str, ...] = ()
    before: str | None = None
    macros: tuple[Macro, ...] = ()
    text: str = ""

    @property
    def prefix(self) -> str:
        """The name as FreeFEM's identifiers take it: slip_law is slipLaw."""
        return camel(self.name)

    @property
    def numbered(self) -> bool:
        """Whether the macros that declare it are numbered."""
        return any(name.endswith("#") for name in self.declared_by)

    @property
    def earlier(self) -> set[str]:
        """Names of the rooms that come before it."""
        return {*self.after, *self.brings, *(name for names in self.needs for name in names)}

    @property
    def example(self) -> str:
        """The line of a scene that declares it."""
        name, content = next(iter(self.declared_by.items()))
        macro = next(macro for macro in self.macros if macro.name == name)
        return f"macro {name.replace('#', '1')}({macro.arguments}) {content} //"


def camel(name: str) -> str:
    """initial_stress is initialStress."""
    first, *others = name.split("_")
    return first + "".join(word.capitalize() for word in others)


def head(path: Path) -> list[str]:
    """Lines of the comment that a FreeFEM file begins with, without its slashes."""
    lines = []
    for line in path.read_text().splitlines():
        if not line.startswith("//"):
            break
        lines.append(line[2:].rstrip())
    return lines


def listed_calls(path: Path) -> list[tuple[str, str]]:
    """Form and meaning of every call that the head of a file of the library lists."""
    calls = []
    for line in head(path):
        if entry := re.fullmatch(r"   (\S.*?)  +(\S.*)", line):
            calls.append((entry[1], " ".join(entry[2].split())))
        elif calls and (more := re.fullmatch(r" {20,}(\S.*)", line)):
            calls[-1] = calls[-1][0], f"{calls[-1][1]} {more[1]}"
    return calls


def take_title(lines: list[str], name: str) -> str:
    """Take the title, up to a line that ends with a full stop, off the head of the file `name`."""
    title = lines.pop(0).strip().removeprefix(f"{name} - ")
    while lines and lines[0] and not title.endswith("."):
        title += " " + lines.pop(0).strip()
    return title


def read_room(path: Path) -> Room:
    """The room in a file. Raises ValueError where its head is not of the form above."""
    lines = head(path)
    title = take_title(lines, path.name)
    entries = {}
    while lines and (entry := re.fullmatch(r" ([a-z ]+): (.+)", lines[0])):
        entries.setdefault(entry[1], []).append(entry[2].strip())
        del lines[0]
    unknown = entries.keys() - set(ENTRIES)
    if unknown or "declared by" not in entries or any(len(entries.get(name, ())) > 1
                                                      for name in SINGLE):
        raise ValueError(f"{path}: its head has "
                         f"{', '.join(sorted(unknown)) or 'a wrong number of entries'}")
    macros, text = read_macros(lines)
    declared_by = {}
    for words in entries["declared by"]:
        name, _, content = re.fullmatch(r"(\w+#?)\(([^)]*)\) ?(.*)", words).groups()
        declared_by[name] = content
    if missing := declared_by.keys() - {macro.name for macro in macros}:
        raise ValueError(f"{path}: its head does not say what {', '.join(sorted(missing))} means")

    def listed(name: str) -> tuple[str, ...]:
        return tuple(word.strip() for words in entries.get(name, ()) for word in words.split(","))

    column, _, bound = entries.get("column", [""])[0].partition(" ")
    return Room(name=path.stem, title=title, declared_by=declared_by,
                needs=tuple(tuple(words.split(" or ")) for words in listed("needs")),
                brings=listed("brings"), after=listed("after"),
                given_on=entries.get("given on", [None])[0], column=column or None,
                nonnegative=bound == ">= 0", columns=listed("columns"), studied=listed("studied"),
                before=entries.get("before", [None])[0], macros=macros, text=text)


def source(room: Room) -> str:
    """Text of the file of a room."""
    return (EFFECTS / f"{room.name}.idp").read_text()


def read_macros(lines: list[str]) -> tuple[tuple[Macro, ...], str]:
    """Macros and numbers listed in lines of a comment, and the rest of its text.

    An entry is indented by three blanks; its meaning, from column 25 on, may go on over further
    lines.
    """
    entries, rest = [], []
    for line in lines:
        entry = re.fullmatch(r"   (\w.*?)(?:  +(\S.*))?", line)
        if entry:
            entries.append((entry[1], [entry[2] or ""]))
        elif entries and line.startswith(" " * 20):
            entries[-1][1].append(line.strip())
        else:
            rest.append(line.strip())
    macros = []
    for names, meaning in entries:
        text = " ".join(filter(None, meaning))
        for name, arguments in re.findall(r"(\w+#?)(\([^)]*\))?", names):
            macros.append(Macro(name, arguments[1:-1] if arguments else None, text))
    return tuple(macros), "\n".join(rest).strip()


@functools.cache
def rooms() -> tuple[Room, ...]:
    """All rooms in the order of inclusion: what a room comes after first, else by name."""
    known = {path.stem: read_room(path) for path in sorted(EFFECTS.glob("*.idp"))}
    ordered = {}
    while len(ordered) < len(known):
        room = next(room for name, room in known.items() if name not in ordered
                    and room.earlier & known.keys() <= ordered.keys())
        ordered[room.name] = room
    return tuple(ordered.values())


@functools.cache
def general_macros() -> tuple[Macro, ...]:
    """What a scene may define besides effects, as the head of export.idp lists it."""
    return read_macros(head(environment.LIBRARY / "export.idp"))[0]


def all_macros() -> list[Macro]:
    """What a scene may define, general or of rooms."""
    return [*general_macros(), *(macro for room in rooms() for macro in room.macros)]


@functools.cache
def vocabulary() -> frozenset[str]:
    """All macros and numbers of a scene that the library reads."""
    return frozenset(name for macro in all_macros() for name in macro.names)


@functools.cache
def studied() -> frozenset[str]:
    """What the values of a parameter study may differ in: no stiffness reads it."""
    names = {name for room in rooms() for name in room.studied}
    return frozenset(names | {f"amplitude{k}" for k in NUMBERS} | of_loads())


@functools.cache
def of_loads() -> frozenset[str]:
    """Macros and numbers that load patterns are made of: all that rooms of loads read."""
    return frozenset(name for room in rooms() if room.given_on for macro in room.macros
                     for name in macro.names)


@functools.cache
def of_contact() -> frozenset[str]:
    """Macros of contact laws, gaps and obstacles: numbers at contact nodes."""
    needing = {"contact"}
    for room in rooms():  # in which what is needed comes first
        if any(needing & set(names) for names in room.needs):
            needing.add(room.name)
    return frozenset(name for room in rooms() if room.name in needing - {"contact"}
                     for macro in room.macros for name in macro.names)
