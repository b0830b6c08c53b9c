"""What a scene's text shows to be wrong before FreeFEM reads it: macros, names, characters.

FreeFEM reports such mistakes where it trips over them, which may be a line of the library, or not
at all. The scene's own includes are looked at as well.
"""

import re
from pathlib import Path
from typing import NamedTuple

from .. import environment, options
from ..errors import InputError
from . import rooms

# flags that mean something to FreeFEM itself, or that `export` sets
RESERVED = ("export", "sizes", "f", "v", "nw", "ns", "ne", "cd", "log", "wait", "nowait", "glut",
            "fglut", "version")
OF_LIBRARY = ("subdomains", "steps", "element", "remesh", "sampling", "coarsening", "counting",
              "counted")  # which it reads itself
# names of FreeFEM that the library uses: with another meaning they would spoil its results
BUILT_IN = frozenset("""
    x y N area hTriangle lenEdge nTonEdge pi P0 P1 P2 P1dc1 P2dc P1edge abs adaptmesh ARGV atan2
    atof atoi boundingbox ceil change cos dist dx dy exec exit floor getline int1d int2d
    intalledges label labels max metisdual min movemesh mpirank mpisize nuTriangle on P2b qf1pE
    qf1pElump qf1pTlump qf2pT readmesh region restrict rint round sin sqrt square trunc""".split())
VOCABULARY = ("traction", "pressure", "addBody")  # macros of scene.idp
MACRO = re.compile(r"[ \t]*macro[ \t]+(\w+)[ \t]*(?:\(([^()]*)\))?(.*)")
AFTER_MACRO = re.compile(r"[ \t]*(?:macro|include|IFMACRO|ENDIFMACRO)\b")
# what these checks would not see, or see no end of
HIDDEN = re.compile(r'\bNewMacro\s+(\w+)|\S.*?\b(?:macro\s+(\w+)|(include)\s*")')
DECLARATION = re.compile(r"(?:real|int|bool|string|complex|mesh|matrix|varf|border|fespace|"
                         r"func\s+\w+)(?:\s*\[[^\]]*\])?\s+([^;]*)")
INCLUDE = r'\s*include\s+"([^"]+)"'
READS = r"\b(?:physical|whole|choice)\s*\("
PARAMETER = re.compile(READS + r'\s*"([^"]*)"')
# strings, which may go on in the next line; of the patterns beside them what the group has stays
TEXT = r'"(?:[^"\\\n]|\\(?:.|\n))*"'
TEXT_OR_COMMENT = re.compile(rf"({TEXT})|//[^\n]*")
BLOCK_COMMENT = re.compile(rf"({TEXT}|//[^\n]*)|/\*.*?\*/", re.DOTALL)
NESTED = re.compile(r"\([^()]*\)|\[[^][]*\]")


class Source(NamedTuple):
    """A file of a scene: its path, and its lines without block comments."""

    path: Path
    lines: list[str]

    @property
    def code(self) -> list[str]:
        """The lines without what follows // outside of strings."""
        return [TEXT_OR_COMMENT.sub(lambda part: part[1] or "", line) for line in self.lines]


class Definition(NamedTuple):
    """A macro of a scene; `arguments` is None if it is defined without parentheses."""

    path: Path
    line: int
    name: str
    arguments: str | None
    content: str
    ended: bool
    goes_on: str = ""  # the operator with which the line after it begins, if it does
    behind: str = ""  # the macro that is defined in the comment behind it, if one is


def read(path: Path) -> str:
    """Text of a scene. Raises InputError if it cannot be read or is none."""
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise InputError(f"the scene {path} cannot be read: {problem.strerror}") from None
    if content.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in content:
        raise InputError(f"{path.name} is no text that FreeFEM reads: save it as plain text "
                         "(UTF-8)")
    if content.startswith(b"\xef\xbb\xbf"):
        raise InputError(f"{path.name} begins with a byte order mark, which FreeFEM does not read: "
                         "save it as UTF-8 without BOM")
    return content.decode("utf-8", "replace")


def sources(scene: Path) -> list[Source]:
    """The scene and what it includes, but for files of the library. Raises InputError."""
    found, remaining = [], [(scene, ())]
    while remaining:
        path, within = remaining.pop(0)
        found.append(Source(path, without_blocks(read(path)).splitlines()))
        for number, line in enumerate(found[-1].lines, 1):
            include = re.match(INCLUDE, line)
            place = include and scene.parent / include[1]
            if place in (path, *within):
                raise InputError(f'{path.name} line {number}: include "{include[1]}" leads back to '
                                 "this file, and FreeFEM would read on without end")
            if (place and place.is_file() and place not in [source.path for source in found]
                    and not (environment.LIBRARY / include[1]).exists()):
                remaining.append((place, (path, *within)))
    return found


def without_blocks(code: str) -> str:
    """FreeFEM code with empty lines in place of /* comments */."""
    return BLOCK_COMMENT.sub(lambda part: part[1] or "\n" * part[0].count("\n"), code)


def without_texts(code: str) -> str:
    """FreeFEM code without comments and the content of strings."""
    return TEXT_OR_COMMENT.sub(
        lambda part: part[1] and '""' + "\n" * part[1].count("\n") or "", code)


def definitions(source: Source) -> list[Definition]:
    """The macros of a file, in order."""
    found, number = [], 0
    while number < len(source.lines):
        start, head = number, MACRO.match(source.lines[number])
        number += 1
        if not head:
            continue
        content, end, rest = head[3].partition("//")
        while not end and number < len(source.lines) and not AFTER_MACRO.match(
                source.lines[number]):
            more, end, rest = source.lines[number].partition("//")
            content += f"\n{more}"
            number += 1
        after = re.match(r"\s*([-+*/])(?![-+*/])", "".join(source.lines[number : number + 1]))
        behind = re.match(r"\s*macro\s+(\w+)\s*\(", rest)
        found.append(Definition(source.path, start + 1, head[1], head[2], content.strip(),
                                bool(end), after[1] if after else "",
                                behind[1] if behind else ""))
    return found


def check(scene: Path) -> None:
    """Refuse what can be seen to be wrong. Raises InputError with the file and its line."""
    files = sources(scene)
    if not any(line.strip() for source in files for line in source.code):
        raise InputError(f"{scene.name} is empty: see edp/tutorial.edp for how to write a scene")
    for source in files:
        _check_characters(source)
        _check_places(source)
    _check_includes(files)
    _check_end(files[0])
    _check_circles(files)
    names = {name for source in files for _, name in declared(source)}
    numbers = {name for source in files for line in source.code for found in re.findall(
        r"\b(?:int|real)\s+([^;]*)", line) for name in declared_names(found)}
    for source in files:
        _check_brackets(source)
        _check_bodies(source)
        for definition in definitions(source):
            if reason := _fault(definition, names, numbers):
                raise InputError(f"{source.path.name} line {definition.line}: {reason}")
        _check_parameters(source)
        for line, name in declared(source):
            if name in VOCABULARY or name in BUILT_IN:
                whose = ("the library's own" if name in VOCABULARY
                         else "FreeFEM's own, with which the library works")
                raise InputError(f"{source.path.name} line {line}: the name '{name}' is {whose}; "
                                 "choose another")


def _check_places(source: Source) -> None:
    """Macros and includes stand at the beginning of a line, where they are looked for."""
    for number, line in enumerate(source.code, 1):
        if hidden := HIDDEN.match(without_texts(line).strip()):
            place = f"{source.path.name} line {number}: "
            if hidden[1]:
                raise InputError(f"{place}write the macro {hidden[1]} as  macro {hidden[1]}() ... "
                                 "//  on a line of its own, not by NewMacro")
            what = f"the macro {hidden[2]}" if hidden[2] else "include"
            raise InputError(f"{place}{what} must begin its line: start a new one before it")


def _check_includes(files: list[Source]) -> None:
    """Every file of the vocabulary once, scene.idp before all else."""
    known = {}
    for source in files:
        before = set(known)
        for number, line in enumerate(source.lines, 1):
            include = re.match(r'\s*include\s+"(scene|export|gmsh)\.idp"', line)
            if include and include[1] == "scene" and (early := known.keys() - before):
                name = min(early, key=known.get)
                raise InputError(f'{source.path.name} line {known[name]}: include "scene.idp" '
                                 f"comes first, then {name}.idp")
            if include and (first := known.setdefault(include[1], number)) != number:
                raise InputError(f"{source.path.name} line {number}: {include[1]}.idp is included "
                                 f"a second time, after line {first}")
    if "export" in known and "scene" not in known:
        raise InputError(f"{files[0].path.name} does not include scene.idp: its first line must be "
                         ' include "scene.idp"')


def _check_end(scene: Source) -> None:
    """Nothing is declared after export.idp, which has read all that the scene declares."""
    lines = [number for number, line in enumerate(scene.lines, 1)
             if re.match(r'\s*include\s+"export\.idp"', line)]
    for macro in definitions(scene):
        if lines and macro.line > lines[0]:
            raise InputError(f"{scene.path.name} line {macro.line}: the macro {macro.name} stands "
                             'after  include "export.idp", which is the last line of a scene')


def _check_brackets(source: Source) -> None:
    """Every bracket of what is no macro has its partner, before the end of the statement."""
    pairs, opened = {")": "(", "]": "[", "}": "{"}, []
    for letter, number, holds in _marks(source):
        if letter in pairs.values():
            opened.append((letter, number, holds))
        elif letter in pairs and (not opened or opened.pop()[0] != pairs[letter]):
            raise InputError(f"{source.path.name} line {number}: a '{letter}' too many, or the "
                             "wrong one")
        elif letter == ";" and opened and opened[-1][0] != "{" and not opened[-1][2]:
            break
    if opened:
        raise InputError(f"{source.path.name} line {opened[-1][1]}: a '{opened[-1][0]}' is not "
                         "closed")


def _marks(source: Source):
    """Brackets and semicolons outside of macros, the line of each, and whether it opens what holds
    semicolons: the head of a loop, or of a border of several pieces, border side(t = 0, 1; piece).
    """
    within = set()
    for macro in definitions(source):
        within |= set(range(macro.line, macro.line + 1 + macro.content.count("\n")))
    code = without_texts("\n".join("" if number in within else line
                                   for number, line in enumerate(source.lines, 1)))
    number, counted = 1, 0
    for mark in re.finditer(r"(\bfor\s*|\bborder\s+\w+\s*)?([][(){};])", code):
        number, counted = number + code.count("\n", counted, mark.start(2)), mark.start(2)
        yield mark[2], number, bool(mark[1])


def _check_characters(source: Source) -> None:
    for number, line in enumerate(source.code, 1):
        if "/*" in without_texts(line):
            raise InputError(f"{source.path.name} line {number}: a comment begins by /* and is not "
                             "closed by */")
        for letter in line:
            if not letter.isascii():
                raise InputError(f"{source.path.name} line {number}: '{letter}' stands outside a "
                                 "comment, where FreeFEM reads plain ASCII only")


def _check_bodies(source: Source) -> None:
    arrays = {name: len(re.findall("[^,]+", items)) for line in source.code
              for name, items in re.findall(r"(\w+)\s*=\s*\[([^][]*)\]", line)}
    for number, line in enumerate(source.code, 1):
        if literal := re.search(r"\blabel\s*=\s*(\[[^\]]*\])", line):
            raise InputError(f"{source.path.name} line {number}: FreeFEM takes labels of a mesh "
                             f"from a variable alone: int[int] sides = {literal[1]}; and  "
                             "label = sides")
        for used in re.findall(r"\bsquare\s*\(.*\blabel\s*=\s*(\w+)", line):
            if used in arrays and arrays[used] != 4:
                raise InputError(f"{source.path.name} line {number}: {used} has {arrays[used]} "
                                 "labels, but a square has four sides: bottom, right, top, left")
        if re.search(r"(\baddBody\s*\(|=)\s*rectangle\s*\(", line):
            raise InputError(f"{source.path.name} line {number}: rectangle(...) declares the only "
                             "body itself and is no mesh; several bodies are given by "
                             "addBody(square(n, m, [x0 + a*x, y0 + b*y]))")


def _fault(definition: Definition, names: set[str], numbers: set[str]) -> str:
    """What is wrong with a macro, "" for nothing; the scene declares `names`, some as `numbers`."""
    name, content = definition.name, definition.content
    if not definition.ended:
        return f"the macro {name} does not end: a macro ends with //"
    if definition.goes_on:
        return (f"the macro {name} ends with // in its line, and the next one begins with "
                f"{definition.goes_on}: comments stand above a macro of several lines, not in it")
    if definition.behind:
        return (f"the macro {definition.behind} stands in a comment, behind the // that ends the "
                f"macro {name}: give it a line of its own, or take it out")
    macro = next((macro for macro in rooms.all_macros() if name in macro.names), None)
    if macro is None or macro.arguments is None:
        return ""
    words = re.findall(r"(?<![\w.])[A-Za-z_]\w*", without_texts(content))
    if "z" in set(words) - names - set(re.findall(r"\w+", definition.arguments or "")):
        return f"z in {name} is FreeFEM's third coordinate, zero all over a plane scene"
    wanted, given = (len(re.findall(r"\w+", words or ""))
                     for words in (macro.arguments, definition.arguments))
    if wanted != given and (given or wanted):
        return (f"{name} has {wanted or 'no'} argument{'' if wanted == 1 else 's'}, not "
                f"{given or 'none'}: macro {name}({macro.arguments}) ... //")
    if not content and not macro.text.startswith("any content"):
        return f"the macro {name} is empty: it expects {macro.text}"
    if re.fullmatch(r"\[[\s,]*\]", content):
        return f"the list of {name} is empty: it expects {re.split('[:;]', macro.text)[0]}"
    if macro.text.startswith("[") and re.fullmatch(r"[-+.,\w\s]+", content) and {*words} <= numbers:
        return f"{name} expects brackets around its numbers: macro {name}() [{content}] //"
    return _unbalanced(name, content)


def _check_circles(files: list[Source]) -> None:
    """Refuse macros that contain themselves, directly or by others. Raises InputError.

    FreeFEM would put the content in without end.
    """
    macros = {macro.name: macro for source in files for macro in definitions(source)}
    reads = {name: {word for word in re.findall(r"[A-Za-z_]\w*", without_texts(macro.content))
                    if word in macros and word not in re.findall(r"\w+", macro.arguments or "")}
             for name, macro in macros.items()}
    for name, macro in macros.items():
        reached, remaining = set(), set(reads[name])
        while remaining:
            word = remaining.pop()
            reached.add(word)
            remaining |= reads[word] - reached
        if name in reached:
            raise InputError(f"{macro.path.name} line {macro.line}: the macro {name} contains "
                             f"itself: give what it is to stand for another name, as in  real "
                             f"{name}Value = ...; macro {name}() {name}Value //")


def _unbalanced(name: str, content: str) -> str:
    """Which bracket of a macro has no partner; empty if all have."""
    pairs, opened = {")": "(", "]": "[", "}": "{"}, []
    for letter in without_texts(content):
        if letter in pairs.values():
            opened.append(letter)
        elif letter in pairs and (not opened or opened.pop() != pairs[letter]):
            return f"a '{letter}' too many, or the wrong one, in the macro {name}"
    return opened and f"a '{opened[-1]}' is not closed in the macro {name}" or ""


def parameters(scene: Path) -> dict[str, str]:
    """Names of the parameters that a scene reads, as it spells them, by their small letters."""
    return {name.lower(): name for source in sources(scene) for line in source.code
            for name in PARAMETER.findall(line)}


def readable(scene: Path) -> list[str]:
    """Names of all parameters that a scene may be given, those of the library among them."""
    return [*parameters(scene).values(), *OF_LIBRARY, "h", "cells"]


def _check_parameters(source: Source) -> None:
    """Names of parameters are those that a user can set on the command line."""
    for number, line in enumerate(source.code, 1):
        for name in PARAMETER.findall(line):
            place = f"{source.path.name} line {number}: "
            if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name):
                raise InputError(f"{place}'{name}' cannot name a parameter: it needs letters, "
                                 "digits and _, as in slip_range")
            if name in RESERVED or name.lower() in (*OF_LIBRARY, *options.OF_RUNS):
                raise InputError(f"{place}a parameter cannot be called {name}: the word has a "
                                 "meaning for the driver or FreeFEM; choose another")


def declared(source: Source) -> list[tuple[int, str]]:
    """Global names that a file declares, each with its line."""
    found, depth = [], 0
    for number, line in enumerate(source.lines, 1):
        code = without_texts(line)
        if depth == 0 and not MACRO.match(line):
            for statement in _without_nested(code).split(";"):
                if declaration := DECLARATION.match(statement.strip()):
                    found += [(number, name) for name in declared_names(declaration[1])]
        depth = max(0, depth + code.count("{") - code.count("}"))
    return found


def _without_nested(code: str) -> str:
    """Code without parentheses and square brackets that it closes, and what they contain."""
    while NESTED.search(code):
        code = NESTED.sub("", code)
    return code


def declared_names(declarators: str) -> list[str]:
    """Names that a declaration gives after its type: a and d of `a = f(b, c), d(1)`."""
    declarators = _without_nested(declarators)
    return re.findall(r"(?:^|,)\s*&?\s*(\w+)", declarators)


# ---- places in the scene -------------------------------------------------------------------------

def places(scene: Path, pattern: str) -> list[str]:
    """File and line of every line of the scene's code that a pattern is in."""
    return [f"{source.path.name} line {number}" for source in sources(scene)
            for number, line in enumerate(source.code, 1) if re.search(pattern, line)]


def place(scene: Path, pattern: str, which: int = 0) -> str:
    """One of these places; the scene's name if there is none."""
    found = places(scene, pattern)
    return found[which] if found else scene.name


def uses(scene: Path, name: str, which: int = 0, default: str | None = None) -> str:
    """A line where a name is used, outside of macros that have an argument of this name."""
    found = places(scene, rf"\b{name}\b")
    own = {f"{source.path.name} line {macro.line + k}" for source in sources(scene)
           for macro in definitions(source) if re.search(rf"\b{name}\b", macro.arguments or "")
           for k in range(1 + macro.content.count("\n"))}
    found = [line for line in found if line not in own] or found
    if not found:
        return scene.name if default is None else default
    return found[min(which, len(found) - 1)]
