"""Names that stand for labels: numbers that a scene gives a name, and borders.

FreeFEM ignores on(label, ...) of a label that the mesh lacks, and takes the name of a border for
its place in the order of all borders, also where the border gives its sides another label.
"""

import re
from pathlib import Path

from ..errors import InputError
from . import grammar, pitfalls, rooms
from .manifest import Manifest

HELD = re.compile(r"support|displacement\d")
ON = re.compile(r"(?<![.\w])on\(")  # in code without blanks, as those below
# int a = 3, b = 4;  and  int[int] c = [3, 4];
NUMBERS = re.compile(r"(?<!\w)int\s(?P<one>[^;()]*);|(?<!\w)int\s*\[\s*int\s*\]\s*(?P<more>[^;]*);")
GIVEN = re.compile(r"(\w+)\s*=\s*(-?\d+|\[[-\d\s,]*\])\s*(?=[,;]|$)")
BORDER = re.compile(r"\bborder\s+(\w+)\s*\([^)]*\)\s*\{([^{}]*)\}")
OWN_LABEL = re.compile(r"(?<![.\w])label\s*=(?!=)")
DISPLACEMENTS = ("u1", "u2", "v1", "v2")  # and test functions: in a macro these, whatever else is


def constants(code: str) -> dict[str, list[int]]:
    """Whole numbers, or lists of some, that code gives a name and changes nowhere."""
    found = {}
    for statement in NUMBERS.finditer(code):
        for name, value in GIVEN.findall(statement["one"] or statement["more"]):
            numbers = [int(number) for number in re.findall(r"-?\d+", value)]
            changes = re.findall(rf"\b{name}\s*(?:\[[^\]]*\]\s*)?(?:[-+*/]?=(?!=)|\+\+|--)", code)
            if len(changes) == 1:
                found[name] = numbers
    return found


def of(scene: Path) -> dict[str, list[int]]:
    """The constants of a scene and the files that it includes."""
    return constants(_code(grammar.sources(scene)))


def check_borders(scene: Path) -> None:
    """Refuse declarations that name a border in place of the label that it has: InputError."""
    files = grammar.sources(scene)
    macros = pitfalls.macros_of(files)
    declaring = pitfalls.declaring(macros, rooms.vocabulary())
    borders = [name for name, body in BORDER.findall(_code(files))
               if OWN_LABEL.search(body) and name not in DISPLACEMENTS]
    for macro in macros:
        own = re.findall(r"\w+", macro.arguments or "")
        named = [name for name in borders if macro.name in declaring and name not in own
                 and re.search(rf"(?<![.\w]){name}(?![\w.(])", pitfalls.code_of(macro.content))]
        if named:
            raise InputError(f"{macro.path.name} line {macro.line}: {macro.name} names the border "
                             f"{named[0]}, which FreeFEM takes for its place in the order of "
                             "borders, not for the label that it sets: write that label")


def check_fixed(scene: Path, manifest: Manifest) -> None:
    """Refuse on(label, ...) in supports and displacements for a label that the mesh lacks.

    It may be a number, or the name of one. FreeFEM ignores such a condition. One on a line inside a
    body would hold where a cut runs along it, and not elsewhere. Raises InputError.
    """
    macros, known = pitfalls.macros_of(grammar.sources(scene)), of(scene)
    words = frozenset(filter(HELD.fullmatch, rooms.vocabulary()))
    holding = pitfalls.declaring(macros, words)
    macros = [macro for macro in macros if macro.name in holding]
    for macro in macros:
        for name in _on(pitfalls.code_of(macro.content)):
            for place, given, said in _given(macro, name, f"on({name}, ...)", macros):
                _check_labels(place, given, said, known, manifest.labels)


def _check_labels(place: str, name: str, said: str, known: dict[str, list[int]],
                  labels: list[int]) -> None:
    """Refuse a `name` of labels, `said` at a `place`, of which the mesh has one not."""
    for label in _values(name, known):
        if label not in labels:
            raise InputError(
                f"{place}: {said} names "
                f"{'no boundary' if name == str(label) else f'label {label}, no boundary'} "
                f"of the mesh, whose labels are {', '.join(map(str, labels))} (a "
                "line inside a body is none: make two bodies of it by addBody)")


def _given(macro: grammar.Definition, name: str, said: str,
           macros: list) -> list[tuple[str, str, str]]:
    """Places and names of what stands for `name` in a macro, and how it is `said` there: itself, or
    where it is an argument what `macros` that call it give for it.
    """
    own = re.findall(r"\w+", macro.arguments or "")
    if name not in own:
        return [(f"{macro.path.name} line {_line(macro, name)}", name, said)]
    found = []
    for user in macros:
        for call in re.findall(rf"(?<![.\w]){macro.name}\(([^()]*)\)",
                               pitfalls.code_of(user.content)):
            given = call.split(",")
            if len(given) == len(own):
                found += _given(user, given[own.index(name)], f"{macro.name}({call})", macros)
    return found


def _code(files: list[grammar.Source]) -> str:
    return grammar.without_texts("\n".join(line for source in files for line in source.code))


def _on(code: str) -> list[str]:
    """The labels of all on(label, ..., u1 = value) in code without blanks, as they are written."""
    found = []
    for start in ON.finditer(code):
        for part in re.split(r"[,()]", code[start.end() :]):
            if "=" in part or not re.fullmatch(r"-?\w+(\[\d+\])?", part):
                break
            found.append(part)
    return found


def _values(name: str, known: dict[str, list[int]]) -> list[int]:
    """The labels that a number, a name or an entry of a list stands for; none if it is not known.
    """
    if re.fullmatch(r"-?\d+", name):
        return [int(name)]
    head, _, entry = name.partition("[")
    numbers = known.get(head, [])
    if not entry:
        return numbers
    return numbers[int(entry[:-1]) : int(entry[:-1]) + 1]


def _line(macro: grammar.Definition, name: str) -> int:
    """Line of the on(...) with a label, of a macro that may go on over several ones."""
    lines = macro.content.splitlines()
    return macro.line + next((number for number, line in enumerate(lines)
                              if re.search(rf"\bon\b.*{re.escape(name)}", line)), 0)
