"""Numbers with which declarations compare the label or the region at hand, without finding any.

Such a comparison is true nowhere, and what it chooses silently that of all other places.
"""

import re
from pathlib import Path

from ..errors import InputError
from . import grammar, label_names, pitfalls, rooms
from .manifest import Manifest

# in code without blanks; numbers in sums and products are not judged
COMPARED = re.compile(r"(?<![-+*/%.\w)\]])(?:(label|region)([!=])=(-?\d+)(?![-+*/%.\w])|"
                      r"(-?\d+)([!=])=(label|region)(?![-+*/%\w]))")
SPRINGS = frozenset({"foundationNormal", "foundationTangential"})
OF_OBSTACLES = re.compile(r"gap(InTime)?|obstacle\w+")  # no contact between bodies has these


def check(scene: Path, manifest: Manifest) -> None:
    """Refuse declarations that compare the label or the region with a number that is not there.

    The mesh lacks it, or it is only the second label of contact pairs, where contact laws ask.
    Of regions the lowest and the highest number are known. Raises InputError.
    """
    lowest, highest = map(int, manifest.regions)
    regions = str(lowest) if lowest == highest else f"{lowest} to {highest}"
    there = {"label": manifest.labels, "region": range(lowest, highest + 1)}
    words = {"label": f"no boundary of the mesh has, whose labels are "
                      f"{', '.join(map(str, manifest.labels))}",
             "region": f"no part of the mesh has, whose regions are {regions}"}
    macros = pitfalls.macros_of(grammar.sources(scene))
    declaring = pitfalls.declaring(macros, rooms.vocabulary())
    laws = pitfalls.declaring(macros, rooms.of_contact()) if manifest.contact_pairs else ()
    numbers = _named(scene)
    for macro in macros:
        asked = _compared(macro, numbers)
        for name, number, _ in asked:
            if number not in there[name] and macro.name in declaring:
                raise InputError(f"{macro.path.name} line {macro.line}: {macro.name} asks for "
                                 f"{name} {number}, which {words[name]}")
        if macro.name in laws:
            labels = [number for name, number, _ in asked if name == "label"]
            if reason := _second_label(labels, manifest.contact_labels, manifest.contact_pairs):
                raise InputError(f"{macro.path.name} line {macro.line}: {macro.name} asks for "
                                 f"{reason}")


def asked_elsewhere(scene: Path, manifest: Manifest) -> list[str]:
    """A line for every contact law that asks for labels without contact, and for none that has it,
    and likewise for the springs of a foundation.

    It has one value everywhere then. Who asks for one of these as well may have left others out:
    in any of the macros that a law calls, and by a name or an inequality, which is not judged.
    """
    macros = pitfalls.macros_of(grammar.sources(scene))
    numbers = _named(scene)
    declared = frozenset(name for room in rooms.rooms() if room.name in manifest.rooms
                         for macro in room.macros for name in macro.names)
    lines: dict[str, None] = {}
    for law in {macro.name for macro in macros} & declared & (rooms.of_contact() | SPRINGS):
        called = pitfalls.declaring(macros, frozenset([law]))
        parts = [macro for macro in macros if macro.name in called]
        asked = [number for macro in parts for number in _labels(macro, numbers)]
        own, contact = _acting(law, manifest)
        if own and None not in asked and not set(asked) & set(own):
            lines |= {_elsewhere(macro, labels[0], own, contact): None for macro in parts
                      if (labels := _labels(macro, numbers))}
    return sorted(lines)


def _acting(law: str, manifest: Manifest) -> tuple[list[int], str]:
    """The labels on which a law acts, and what there is on them, in words."""
    firsts = [*dict.fromkeys(first for first, _ in manifest.contact_pairs)]
    if law in SPRINGS:
        return manifest.rooms["springs"].get("labels", []), "foundation"
    if law == "pairGap":
        return firsts, "contact of a pair's first side"
    if firsts and OF_OBSTACLES.fullmatch(law):
        return ([label for label in manifest.contact_labels if label not in firsts],
                "contact with an obstacle")
    return manifest.contact_labels, "contact"


def _elsewhere(macro: grammar.Definition, label: int, own: list[int], contact: str) -> str:
    """What a macro that asks for the `label` alone is told; `own` labels have such `contact`."""
    return (f"{macro.path.name} line {macro.line}: {macro.name} asks for label {label}, where "
            f"there is no {contact}, and not for {', '.join(map(str, own))}, where it is: what it "
            f"says of label {label} counts nowhere")


def _labels(macro: grammar.Definition, numbers: dict[str, int]) -> list[int | None]:
    """Labels that a macro asks for, also by names for `numbers`; None for every other comparison
    with the label.
    """
    compared = [entry for entry in _compared(macro, numbers) if entry[0] == "label"]
    named = len(re.findall(r"\blabel\b", grammar.without_texts(macro.content)))
    return [number for _, number, sign in compared if sign == "="] + [None] * (
        named - len(compared))


def _named(scene: Path) -> dict[str, int]:
    """Whole numbers to which the scene gives names."""
    return {name: values[0] for name, values in label_names.of(scene).items() if len(values) == 1}


def _compared(macro: grammar.Definition, numbers: dict[str, int]) -> list[tuple[str, int, str]]:
    """What a macro compares with numbers, also such as have names: label or region, those, and for
    what: = or !. An argument of that name is whatever it is called with.
    """
    code, own = pitfalls.code_of(macro.content), re.findall(r"\w+", macro.arguments or "")
    for name in numbers.keys() - set(own):
        code = re.sub(rf"(?<![.\w]){name}(?![\w.(\[])", str(numbers[name]), code)
    return [(found[1] or found[6], int(found[3] or found[4]), found[2] or found[5]) for found
            in COMPARED.finditer(code) if (found[1] or found[6]) not in own]


def _second_label(asked: list[int], own: list[int], pairs: list) -> str:
    """Of which label that is only a second one a contact law asks in vain; empty without one.

    `own` are those of contact nodes. Who asks for the first label of such a pair as well means it.
    """
    for label in asked:
        firsts = [one for one, two in pairs if two == label]
        if label not in own and firsts and not set(firsts) & set(asked):
            return (f"label {label}, the second of a contactPair, whose nodes are those of the "
                    f"first: write label == {' || label == '.join(map(str, firsts))}")
    return ""
