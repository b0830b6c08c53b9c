"""Mistakes of writing that FreeFEM takes for something else, without a word.

One = in place of two, a < b < c, label == 3 || 4, an integer for a parameter that has decimals,
an option for one of two names that capitals alone tell apart, x in a history, the label inside a
body, a load's integral over a mesh of the scene, a number's over that of a subdomain, no for what
any content declares, an obstacle that calls functions of the place at hand, numbers of triangles,
random ones, labels behind what is prescribed on them: what is declared would have other values
than those that were meant.
"""

import itertools
import re
from pathlib import Path

from ..errors import InputError
from . import functions, grammar, numerals, rooms

# in code without blanks
SET = re.compile(r"(?<![.\w])(label|region|x|y)=(?!=)")
SUPPORT, NAMED = re.compile(r"(?<![.\w])on\("), re.compile(r"\w+=(?!=)")
EQUALS, ORDERS = re.compile(r"[=!]="), re.compile(r"[<>]=?")
CALLS = {"h": "meshSize", "cells": "rectangle"}  # what reads parameters of the library
STREAM = re.compile("<<|>>")
# what has one value, or one list, whatever the place, at which x and y would be left from before
PLACELESS = re.compile(r"amplitude\d|(slip|displacement)Factor|stepTimes|cycles|cycleStart|"
                       r"point(Load\d|Spring)|probePoints")
# what is asked for inside a body, where FreeFEM has some number for what boundaries alone have
INSIDE = re.compile(r"young|poisson|c[1-3][1-3]|(bodyForce|thermal)\d|piece")
OF_BOUNDARIES = re.compile(r"(?<![.\w])(?:label\b(?!\()|N\.[xyz]\b)")
PLACE = re.compile(r"(?<![.\w])(?:(?:x|y|label|region)\b(?!\()|[NP]\.[xy]\b)")
# evaluated beside the place at hand: for slopes, where the obstacle has moved, on a grid
SHAPES = frozenset({"obstacle", "obstacleInTime"})
COORDINATE = re.compile(r"(?<![.\w])(?:P\.)?[xy]\b(?!\()")
# other numbers in each subdomain, or each time that they are asked for; and what cuts the mesh
UNSTEADY = re.compile(r"(?<![.\w])(nuTriangle|nuEdge|rand(?:real|int|res)\d+)\b")
OF_WHOLE = {"piece"}
INTEGRAL = re.compile(r"(?<![.\w])int(?:1d|2d|alledges)(?=\s*\()")  # the same everywhere
OFF = re.compile(r"no|off|false|0+\.?0*", re.IGNORECASE)  # of what any content declares
LOAD = re.compile(r"load\d")
# what traction and pressure are: over a boundary of each subdomain, which are all called Ti
OF_SUBDOMAINS, OVER_PARTS = re.compile(r"int1d\(Ti,(?!qf)"), re.compile(r"int\w+\(Ti\b")
TESTED = {"v1", "v2"}  # the test functions
NUMBER = re.compile(r"[-+]?[\d.]+")
# a value by itself, which no factor makes whole
INTEGER = re.compile(r'\bint\s+(?:[^;()]*,\s*)?(\w+)\s*=\s*physical\s*\(\s*"([^"]*)"\s*,([^()]*)\)'
                     r"\s*[,;]")


def check(scene: Path, parameters: dict[str, str]) -> None:
    """Refuse such declarations, and macros that they call; `parameters` of the command line.

    Raises InputError with the line.
    """
    files = grammar.sources(scene)
    for source in files:
        _check_integers(source, parameters)
    _check_capitals(files, parameters)
    macros = macros_of(files)
    named = declaring(macros, rooms.vocabulary())
    called = [function for source in files for function in functions.definitions(source)]
    bare = [macro._replace(content=functions.without_calls(
        _without_integrals(code_of(macro.content)), called)) for macro in macros + called]
    placeless = declaring(bare, frozenset(filter(PLACELESS.fullmatch, rooms.vocabulary())))
    switches = {macro.name for macro in rooms.all_macros() if macro.text.startswith("any content")}
    loads = declaring(macros, frozenset(filter(LOAD.fullmatch, rooms.vocabulary())))
    inside = declaring(bare, frozenset(filter(INSIDE.fullmatch, rooms.vocabulary())))
    shapes = declaring(bare, SHAPES)
    for macro in macros:
        reason = _mistake(macro.content) if macro.name in named else ""
        if macro.name in switches and OFF.fullmatch(code_of(macro.content)):
            reason = "holds whatever its content, also this one: leave it out if it is not meant"
        if macro.name in named:
            reason = reason or _own_integral(macro, macros, macro.name in loads)
        _refuse(macro, reason)
    reached = declaring(bare, rooms.vocabulary() - OF_WHOLE)
    for own in bare:
        _refuse(own, own.name in reached and _unsteady(own)
                or own.name in placeless and _misplaced(own)
                or own.name in inside and _bounded(own)
                or own.name in shapes and _stays(own))


def _refuse(macro: grammar.Definition, reason: str) -> None:
    if reason:
        raise InputError(f"{macro.path.name} line {macro.line}: {macro.name} {reason}")


def macros_of(files: list[grammar.Source]) -> list[grammar.Definition]:
    """The macros of some files, in order."""
    return [macro for source in files for macro in grammar.definitions(source)]


def code_of(content: str) -> str:
    """The content of a macro without blanks and texts."""
    return "".join(grammar.without_texts(content).split())


def declaring(macros: list, words: frozenset[str]) -> frozenset[str]:
    """Words of declarations, of the macros that they call, and so on."""
    found = words
    for _ in macros:
        found |= {word for macro in macros if macro.name in found
                  for word in re.findall(r"\w+", grammar.without_texts(macro.content))}
    return found


def _check_integers(source: grammar.Source, given: dict[str, str]) -> None:
    """Parameters whose values have decimals, as `given` or by themselves, are no whole numbers."""
    for number, line in enumerate(source.code, 1):
        found = INTEGER.search(line)
        if found and _has_decimals(given.get(found[2].lower(), found[3])):
            raise InputError(f"{source.path.name} line {number}: as an int {found[1]} loses its "
                             f"decimals: write  real {found[1]} = physical(...)  or  "
                             f"int {found[1]} = whole(...)")


def _has_decimals(value: str) -> bool:
    """Whether a value is a number that is not whole; of words and formulas it is not known."""
    try:
        return not float(value).is_integer()
    except ValueError:
        return False


def _check_capitals(files: list[grammar.Source], given: dict[str, str]) -> None:
    """No two parameters that are `given` have names that differ by capitals alone."""
    code = "\n".join(line for source in files for line in source.code)
    known = {name: name for name, call in CALLS.items() if re.search(rf"\b{call}\s*\(", code)}
    for source in files:
        for number, line in enumerate(source.code, 1):
            for name in grammar.PARAMETER.findall(line):
                other = known.setdefault(name.lower(), name)
                if other != name and name.lower() in given:
                    raise InputError(f"{source.path.name} line {number}: the parameters {other} "
                                     f"and {name} differ by capitals alone, and {name.upper()}= "
                                     "would set one of them: give one another name")


def _mistake(content: str) -> str:
    """What is wrong with the content of a macro; empty if it means what it says."""
    code = code_of(content)
    if found := SET.search(code):
        return f"sets {found[1]} by a single =; what compares has two: {found[1]} == ..."
    for found in SUPPORT.finditer(code):
        given = numerals.arguments(code[found.end():])
        behind = itertools.dropwhile(lambda part: not NAMED.match(part), given)
        if late := next((part for part in behind if not NAMED.match(part)), ""):
            return (f"has {late} behind what on(...) prescribes, where FreeFEM takes it for one "
                    "more label: numbers have a decimal point, u1 = 0.5, and labels come first")
    for term in _terms(code):
        sides = [side for side in re.split(r"&&?|\|\|?", term) if not STREAM.search(side)]
        if chained := next(filter(_chained, sides), ""):
            return (f"compares three things at once, which FreeFEM takes one after the other: "
                    f"{chained}; write  a < b && b < c")
        if len(sides) > 1 and (alone := next(filter(NUMBER.fullmatch, sides), "")):
            return (f"has {alone} as a condition, which is the same everywhere: {term}; each side "
                    "compares, as in  label == 3 || label == 4")
    return ""


def _misplaced(macro: grammar.Definition) -> str:
    """What a macro that is the same everywhere asks of the place, arguments of its own apart."""
    asked = _asked(macro, PLACE)
    return asked and (f"asks for {asked}, but is the same at every place: what varies with it "
                      "belongs into the load or the coefficient itself")


def _bounded(macro: grammar.Definition) -> str:
    """What a macro that is asked for inside a body takes of boundaries, arguments apart."""
    asked = _asked(macro, OF_BOUNDARIES)
    return asked and (f"asks for {asked}, which boundaries alone have, and is asked for inside a "
                      "body: parts of one differ by region, or by x and y")


def _asked(macro: grammar.Definition, words: re.Pattern) -> str:
    """The first of `words` in a macro that is not among its arguments; empty without one."""
    own = re.findall(r"\w+", macro.arguments or "")
    return next((word for word in words.findall(macro.content) if word not in own), "")


def _stays(macro: grammar.Definition) -> str:
    """What an obstacle's function asks of the place at hand, arguments of its own apart."""
    asked = _asked(macro, COORDINATE)
    return asked and (f"asks for {asked}, which is not among its arguments, and an obstacle is "
                      "evaluated at other places than the one at hand, for its slope: give what it "
                      "calls x and y as arguments, as in  macro wave(x) (0.1*sin(x)) //")


def _unsteady(macro: grammar.Definition) -> str:
    """What a declaration asks for that has no value of its own."""
    found = UNSTEADY.search(macro.content)
    if not found:
        return ""
    if found[1].startswith("nu"):
        return (f"asks for {found[1]}, which counts in the mesh of every subdomain by itself: tell "
                "parts of a body by x and y or by region")
    return (f"calls {found[1]}, which is another number each time: keep numbers in a function on a "
            "mesh of the scene, as in  fespace V(body, P1); V v = ...;  and ask for  v(x, y)")


def _own_integral(macro: grammar.Definition, macros: list, load: bool) -> str:
    """What is wrong with the integrals of a macro, a load's of the test functions or of numbers.

    Every subdomain assembles loads: an integral over a mesh of the scene counts in each of them,
    one over the sides or the inside of each in some of them alone, and a number that is one over Ti
    is that of its part. What an argument brings is not known here.
    """
    code, own = code_of(macro.content), set(re.findall(r"\w+", macro.arguments or ""))
    for found in INTEGRAL.finditer(code):
        integral = code[found.start() : _end_of_integral(code, found.end())]
        where, _, what = integral.partition(")(")
        words = frozenset(re.findall(r"\w+", what))
        tested = TESTED & declaring(macros, words)
        if load and tested and not OF_SUBDOMAINS.match(where):
            return (f"has the integral {where})(...), which would depend on the subdomains: write "
                    "traction(label, px, py) or pressure(label, p), and forces per volume as  "
                    "macro bodyForce1() [fx, fy] //")
        if OVER_PARTS.match(where) and not (tested or words & own):
            return (f"has the number {where})(...), which every subdomain would take over its own "
                    "part: write its value, or take it over a mesh of the scene, as in  "
                    "real size = int1d(body, 3)(1.);")
    return ""


def _without_integrals(code: str) -> str:
    """Code without integrals: the parentheses of where and of what."""
    while found := INTEGRAL.search(code):
        code = code[: found.start()] + "1" + code[_end_of_integral(code, found.end()) :]
    return code


def _end_of_integral(code: str, start: int) -> int:
    """Where the two parentheses from `start` on end."""
    depth, groups, end = 0, 0, start
    while end < len(code) and (depth or groups < 2):
        depth += (code[end] == "(") - (code[end] == ")")
        groups += code[end] == ")" and not depth
        end += 1
    return end


def _chained(side: str) -> bool:
    """Whether more than two values are compared; < and > bind before == and !=."""
    parts = EQUALS.split(side)
    return len(parts) > 2 or any(len(ORDERS.findall(part)) > 1 for part in parts)


def _terms(code: str) -> list[str]:
    """What stands between ?, :, commas and ends of statements, brackets apart, each of which a
    letter stands for.
    """
    groups = []
    while found := grammar.NESTED.search(code):
        groups.append(found[0][1:-1])
        code = f"{code[: found.start()]}u{code[found.end():]}"
    return [term for group in [*groups, code] for term in re.split(r"[?:,;{}]", group)]
