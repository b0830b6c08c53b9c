"""What the driver reads out of a scene's text before FreeFEM runs it, and what it finds after.

FreeFEM takes a misspelt declaration for one that nobody asks for, and a condition on a boundary
that is not there for none: here both are refused.
"""

import hashlib
import os
import re
from pathlib import Path

from .. import environment, units
from ..errors import InputError
from ..text import near
from . import choices, grammar, rooms
from .grammar import declared_names
from .library import Library, library, named_files
from .manifest import Manifest

OWN_FILES = ("scene.idp", "export.idp", "gmsh.idp")  # includes of a scene that declare nothing
OPERATORS = {"and": "&&", "or": "||"}
# whole numbers alone: what multiplies or divides them before makes another quotient
WHOLE_QUOTIENT = r"(?<![\w.^*/)\]\s])\s*\b(\d+)\s*/\s*(\d+)(?![\w.])"
DECLARATION = r"^(?!macro)(?:func )?\w+(?:\[[^\]]*\])? ([^;\n]*)"  # global: type, declarators
UNITS = r"\bunits\s*\("


def text_digest(scene: Path) -> str:
    """Digest of the scene's script, of the library and of every file that either names in quotes,
    but for those that it writes.
    """
    own = library()
    digest, known = hashlib.sha256(own.digest.encode()), set()
    remaining = [scene, *_existing(scene.parent, sorted(own.files))]
    while remaining:
        path = remaining.pop()
        if path in known:
            continue
        known.add(path)
        content = path.read_bytes()
        name_and_size = f"{path.name} {len(content)} "
        digest.update(name_and_size.encode("utf-8", "surrogateescape") + content)
        if path.suffix in (".edp", ".idp"):
            named = named_files(content.decode("utf-8", "replace"))
            remaining += _existing(scene.parent, named)
    return digest.hexdigest()


def _existing(folder: Path, names: list[str]) -> list[Path]:
    """Those of the names that files in a folder have."""
    paths = (os.path.join(folder, name) for name in names if len(os.path.basename(name)) < 256)
    return [Path(path) for path in paths if os.path.isfile(path)]


# ---- names that a scene declares -------------------------------------------------------------

def check_names(scene: Path) -> None:
    """Refuse macros that nothing reads, and macros and functions with names of the library's own.

    FreeFEM would put such a macro into the library's text, and call such a function from there, and
    replace a variable by the library's macro of its name. That a variable of the library has this
    name FreeFEM says itself, see `taken_name`. Raises InputError.
    """
    files = grammar.sources(scene)
    code = "\n".join(line for source in files for line in source.code)
    if 'include "export.idp"' not in code:
        return
    known, code = library(), grammar.without_texts(code)
    hidden = {"evaluating", *known.macros} - rooms.vocabulary()
    own = {macro.name: macro for source in files for macro in grammar.definitions(source)}
    for source in files:
        for line, name in grammar.declared(source):
            if name in hidden:
                raise InputError(own_name(source.path, line, name))
            if reason := _variable_fault(name, own, code):
                raise InputError(f"{source.path.name} line {line}: {reason}")
        for macro in grammar.definitions(source):
            if reason := _macro_fault(macro.name, code, known):
                raise InputError(f"{source.path.name} line {macro.line}: {reason}")
        for number, line in enumerate(source.lines, 1):
            formula = re.match(r"\s*func\s+(\w+)\s*=", line)
            if reason := _variable_fault(formula[1], own, code) if formula else "":
                raise InputError(f"{source.path.name} line {number}: {reason}")
            function = re.match(r"\s*func\s+\w+\s+(\w+)", line)
            if function and re.search(rf"^func \w+ {function[1]}\(", known.text, re.MULTILINE):
                raise InputError(own_name(source.path, number, function[1]))


def _variable_fault(name: str, macros: dict, code: str) -> str:
    """Why a scene with these macros may not give a variable or function this name, or ""."""
    if name in macros:
        return (f"'{name}' is also a macro, in line {macros[name].line}, which stands for it from "
                f"there on; choose another name, such as {name}Value")
    macro = next((macro for macro in rooms.all_macros() if name in macro.names), None)
    declares = macro is not None and macro.arguments is not None  # and is no number, as slipRange
    if declares and len(re.findall(rf"\b{name}\b", code)) == 1:
        return (f"nothing reads '{name}': what a scene declares is given by macros: "
                f"macro {name}({macro.arguments}) ... //")
    return ""


def _macro_fault(name: str, code: str, known: Library) -> str:
    """Why a scene with this code may not define a macro; empty if it may."""
    if f"{name}1" in rooms.vocabulary():
        return f"{name} needs a number: {name}1 ... {name}9"
    if name in rooms.vocabulary():
        return ""
    numbered = re.fullmatch(r"(\w*?[A-Za-z])\d+", name)
    if numbered and f"{numbered[1]}1" in rooms.vocabulary():
        return f"{name}: its number is one from 1 to 9"
    if known.uses(name):
        return f"the name '{name}' is the library's own; choose another"
    if len(re.findall(rf"\b{name}\b", code)) == 1:
        return f"nothing reads the macro {name}{hint(name)}"
    return ""


def check_gmsh_numbers(scene: Path) -> None:
    """Refuse numbers given to gmsh that none of the scene's .geo files reads. Raises InputError.

    gmsh takes them without a word. Files that are put together from others are not judged.
    """
    files = grammar.sources(scene)
    code = "\n".join(line for source in files for line in source.code)
    named = re.findall(r"\bgmshBody\(([^,]*),", code)
    paths = [scene.parent / name.strip().strip('"') for name in named]
    if not paths or not all(path.suffix == ".geo" and path.is_file() for path in paths):
        return
    text = "\n".join(path.read_text(errors="replace") for path in paths)
    if re.search(r"\b(Include|Merge)\b", text):
        return
    text = re.sub(r"//[^\n]*", "", text)
    for source in files:
        for number, line in enumerate(source.code, 1):
            for name in re.findall(r'\bgmshNumber\(\s*"(\w+)"', line):
                if not _is_word(name, text):
                    known = re.findall(r"(\w+)\s*=\s*\{", text)
                    raise InputError(f"{source.path.name} line {number}: no .geo file of the scene "
                                     f"reads the number {name}{near(name, known)}")


def check_parameters(scene: Path, given) -> None:
    """Refuse parameters `given` that the scene cannot read, before FreeFEM meshes it.

    What it leaves unread all the same FreeFEM tells, as where names are made as it reads the scene.
    Raises InputError.
    """
    code, known = "\n".join(_code(scene)), {name.lower() for name in grammar.readable(scene)}
    if re.search(grammar.READS + r'(?!\s*"[^"]*"\s*[,)])', code):
        return
    size = next((word for call, word in (("rectangle", "cells"), ("meshSize", "h"))
                 if re.search(rf"\b{call}\s*\(", code)), "remesh")
    reads = [name.upper() for name in (*grammar.parameters(scene).values(), "subdomains", "steps",
                                       "element", size)]
    for name in given:
        if name.lower() not in known:
            raise InputError(f"{scene.name}: unknown parameter {name.upper()}; this scene reads "
                             f"{', '.join(reads)}{near(name.upper(), reads)}")


def check_sizes(scene: Path) -> None:
    """Refuse an element size, from meshSize, that nothing in the scene reads. Raises InputError.

    H= would be taken and change nothing, and the errors' coarser meshes would be the run's own.
    """
    code = grammar.without_texts(re.sub(r"//[^\n]*", "", "\n".join(_code(scene))))
    for name in re.findall(r"(\w+)\s*=\s*meshSize\s*\(", code):
        if len(re.findall(rf"\b{name}\b", code)) == 1:
            where = grammar.place(scene, rf"\b{name}\s*=\s*meshSize\b")
            raise InputError(f"{where}: nothing reads {name}, the element size from meshSize(...), "
                             f"so that H= would change nothing: let the mesh depend on {name}, or "
                             "leave meshSize out: REMESH=0.5 then makes elements half as long")


def check_statements(scene: Path) -> None:
    """Refuse terms that FreeFEM takes without effect or for others. Raises InputError.

    Loads with unknown displacements, conditions on no boundary or of no displacement, powers
    spelt as in Python, choices within choices, and divisions of whole numbers, whose remainder
    FreeFEM drops.
    """
    for source in grammar.sources(scene):
        for number, line in enumerate(source.lines, 1):
            if reason := _statement_fault(grammar.without_texts(line)):
                raise InputError(f"{source.path.name} line {number}: {reason}")
    for macro, choice in choices.losing(grammar.sources(scene)):
        raise InputError(
            f"{macro.path.name} line {macro.line}: of ({choice}) in {macro.name} FreeFEM loses the "
            "second value, as it depends on the place, and neither the condition nor the first "
            "value does: turn it round, with the opposite condition, as in (A >= 1. ? x : 0.) for "
            "(A < 1. ? 0. : x)")
    for macro in (macro for source in grammar.sources(scene)
                  for macro in grammar.definitions(source)):
        unknown = re.search(r"\bu[12]\b", grammar.without_texts(macro.content))
        if re.fullmatch(r"(load|bodyForce)\d", macro.name) and unknown:
            raise InputError(
                f"{macro.path.name} line {macro.line}: {macro.name} contains {unknown[0]}, the "
                "unknown displacement: a load is given and such a term (a spring, a Robin "
                "condition) would be left out; write loads with v1 and v2 alone, and springs by "
                "macro foundation() label // or pointSpring")


def _statement_fault(code: str) -> str:
    """Why a line does not mean what it seems to; empty if it does."""
    if re.search(r"\bon\(\s*u[12]\s*=", code):
        return "on(...) names no boundary: its label comes first, as in on(4, u1 = 0.)"
    if alone := re.search(r"\bon\(([\w\s,+-]*)\)", code):
        return (f"{alone[0]} holds no displacement: name components and values, as in "
                "on(4, u1 = 0., u2 = 0.)")
    if listed := re.search(r"\b(traction|pressure)\s*\(\s*\[", code):
        return (f"{listed[1]} takes one label: add one for each, as in {listed[1]}(2, ...) + "
                f"{listed[1]}(3, ...)")
    if python := re.search(r"[\w)\].]\s+(and|or)\s+[\w(!]", code):
        return f"'{python[1]}' is no operator of FreeFEM: it writes {OPERATORS[python[1]]}"
    if choices.chooses_twice(code):
        return ("FreeFEM takes one ? : in an expression: put the other one in parentheses, as in "
                "(t < 1. ? t : (t < 2. ? 1. : 2.))")
    if "**" in code:
        return "** is no operator of FreeFEM: powers are x^2"
    content = re.sub(r"^\s*macro\s+\w+\s*(\([^()]*\))?", "", code)
    for whole in re.finditer(WHOLE_QUOTIENT, content):
        over, under = int(whole[1]), int(whole[2])
        if under and over % under and not re.match(r"\s*int\b", code):
            return (f"{whole[1]}/{whole[2]} divides whole numbers, which in FreeFEM is "
                    f"{over // under}: write {whole[1]}./{whole[2]}")
    return ""


def check_units(scene: Path, manifest: Manifest) -> None:
    """Refuse names of units that can be none: numbers, a stress for a length. Raises InputError."""
    if reason := units.fault(**manifest.units):
        raise InputError(f'{grammar.place(scene, UNITS)}: units: {reason}; such as '
                         'units("mm", "MPa")')


def taken_name(scene: Path, name: str) -> str:
    """Why FreeFEM refuses a variable `name` that a scene and the library both declare."""
    for source in grammar.sources(scene):
        for number, line in enumerate(source.code, 1):
            if _is_word(name, line):
                return own_name(source.path, number, name)
    return f"{scene.name}: the name '{name}' is the library's own; choose another"


def own_name(scene: Path, line: int, name: str) -> str:
    """Reason to refuse a name that the library uses itself."""
    return f"{scene.name} line {line}: the name '{name}' is the library's own; choose another"


def declared_by_library(name: str) -> bool:
    """Whether the library has a global variable, or a function, with this name."""
    return any(name in declared_names(declarators)
               for declarators in re.findall(DECLARATION, library().code, re.MULTILINE))


def _is_word(name: str, text: str) -> bool:
    return re.search(rf"\b{name}\b", text) is not None


def hint(name: str, words=()) -> str:
    """The declaration, or one of other `words`, that a misspelt one may mean."""
    return near(name, {*rooms.vocabulary(), *words})


def check_regions(scene: Path, manifest: Manifest) -> None:
    """Refuse a material or a load that asks for the region where all meshes are region 0.

    That is the number that FreeFEM gives every mesh it builds: bodies meant to be of steel would be
    of rubber. Raises InputError.
    """
    if any(manifest.regions):
        return
    macros, asking = _definitions("\n".join(_code(scene)))[0], {"region"}
    for _ in macros:  # a macro may call one that asks
        asking |= {name for name, body in macros if asking & set(re.findall(r"\w+", body))}
    for name in sorted(asking & rooms.vocabulary()):
        place = next((f"{source.path.name} line {macro.line}" for source in grammar.sources(scene)
                      for macro in grammar.definitions(source) if macro.name == name), scene.name)
        raise InputError(
            f"{place}: {name} asks for the region, but all of the mesh is region 0, as "
            "FreeFEM makes it; give meshes regions by square(..., region = 1), "
            "Th = change(Th, fregion = 1) or physical surfaces of gmsh")


# ---- what a parameter changes ----------------------------------------------------------------

def changed_by(scene: Path, name: str) -> set[str]:
    """Declarations of a scene that its parameter `name` reaches through variables and macros.

    Statements that do more than give variables a value count as changed themselves, by their text:
    what cannot be followed is refused. Raises InputError where the scene has no such parameter.
    """
    if name == "steps":
        return set()
    macros, statements = _definitions("\n".join(_code(scene)))
    asks = re.compile(rf'\b(?:physical|whole|choice)\(\s*"{re.escape(name)}"')
    reached, changed = set(), set()  # names of variables and macros; texts of statements

    def is_touched(text: str) -> bool:
        words = set(re.findall(r"\w+", grammar.without_texts(text)))
        return bool(asks.search(text) or reached & words)

    size = -1
    while size < len(reached) + len(changed):
        size = len(reached) + len(changed)
        for statement in filter(is_touched, statements):
            if re.match(r"(?:(?:real|int|bool|string) )?\w+ ?=[^=]", statement):
                reached |= set(re.findall(r"(\w+) ?=(?!=)", statement))
            else:
                changed.add(f"'{statement}'")
        reached |= {macro for macro, body in macros if is_touched(body)}
    if not reached | changed:
        number = re.search(r'\bphysical\s*\(\s*"(\w+)', "\n".join(_code(scene)))
        own = number[1].upper() if number else "NAME"
        raise InputError(f"{scene.name} reads no parameter {name.upper()} that a study could vary: "
                         f"values are given to one that it reads, as {own}=a,b,c or "
                         f"{own}=first:last:count")
    return changed | (reached & rooms.vocabulary())


def _code(scene: Path) -> list[str]:
    """Lines of a scene and of what it includes, but for the library's own files: InputError."""
    grammar.sources(scene)  # no file includes itself

    def lines(path: Path, within: tuple) -> list[str]:
        found = []
        for line in grammar.without_blocks(grammar.read(path)).splitlines():
            include = re.match(grammar.INCLUDE, line)
            if not include:
                found.append(line)
            elif include[1] not in OWN_FILES:
                places = [folder / include[1] for folder in (scene.parent, environment.LIBRARY)]
                found += [more for place in places if place.is_file() and place not in within
                          for more in lines(place, (*within, place))]
        return found

    return lines(scene, (scene,))


def _definitions(text: str) -> tuple[list[tuple[str, str]], list[str]]:
    """Macros of a script, each with its arguments and content, and its statements."""
    macro = re.compile(r"\bmacro\s+(\w+)(.*?)//[^\n]*", re.DOTALL)
    macros = [(definition[1], definition[2]) for definition in macro.finditer(text)]
    rest = re.sub(r"//[^\n]*", "", macro.sub("", text))
    statements = []
    for statement in re.split(r"[;{}]", rest):
        statements += [" ".join(part.split()) for part in _variables(statement) if part.strip()]
    return macros, statements


def _variables(statement: str) -> list[str]:
    """A statement; one that declares several variables, `real a = 1, b = 2`, as one for each."""
    kind = re.match(r"\s*(real|int|bool|string)\s+(?=\w+\s*=)", statement)
    if not kind:
        return [statement]
    parts, depth = [""], 0
    for letter in statement[kind.end():]:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [f"{kind[1]} {part}" for part in parts]
