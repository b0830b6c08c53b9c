"""Choices ? : that FreeFEM does not take as they are written."""

import re
from collections.abc import Iterable

from . import grammar
from .grammar import Definition, Source

INNERMOST = re.compile(r"[([{][^][(){}]*[])}]")  # brackets without others in them
SEPARATORS = re.compile(r"[][(){},;]")
NAME = re.compile(r"(?<![\w.])[A-Za-z_]\w*")
NUMBER = re.compile(r"(?<!func )\b(?:real|int|bool|string)\s+(\w[^;]*)")  # declared, or several
PLACE = {"x", "y", "z", "N", "P", "label", "region", "nuTriangle", "nuEdge", "hTriangle", "lenEdge",
         "area"}
MATHEMATICS = {"pi", "true", "false", "abs", "sqrt", "exp", "log", "log10", "pow", "min", "max",
               "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh",
               "floor", "ceil", "rint", "real", "int", "sign"}
EXPRESSION = re.compile(r"\bfunc\s+(\w+)\s*=([^;]*)")  # named, as by a macro
APART = re.compile(r"support|displacement\d")  # their values are not integrated


def chooses_twice(code: str) -> bool:
    """Whether an expression of a line has two ? : that no brackets keep apart.

    Some of these may be closed in another line.
    """
    return any(each.count("?") > 1 for each, _ in _apart(code))


def losing(sources: list[Source]) -> Iterable[tuple[Definition, str]]:
    """Macros, and expressions with a name, with a choice of which FreeFEM (4.9) loses the second
    value, and that choice.

    In integrals and interpolations it works out beforehand what is the same everywhere. Where the
    condition and the first value are, it takes the choice for that as well: a second value that
    depends on the place is not known by then, and comes out as zero, as any number, or with an
    error in its optimization.
    """
    macros = [macro for source in sources
              for macro in [*grammar.definitions(source), *_expressions(source)]]
    numbers = {name for source in sources for line in source.lines
               for given in NUMBER.findall(grammar.without_texts(line))
               for name in grammar.declared_names(given)}
    fixed = (numbers | MATHEMATICS) - PLACE
    while more := {macro.name for macro in macros
                   if _names(macro) <= fixed | _arguments(macro)} - fixed:
        fixed |= more  # macros of such names alone
    for macro in macros:
        choice = _lost(grammar.without_texts(macro.content), fixed | _arguments(macro))
        if choice and not APART.fullmatch(macro.name):
            yield macro, choice


def _expressions(source: Source) -> list[Definition]:
    """Expressions that lines of a file name, func f = sin(x);, as if they were macros."""
    return [Definition(source.path, number, name, None, content.strip(), True)
            for number, line in enumerate(source.lines, 1)
            for name, content in EXPRESSION.findall(grammar.without_texts(line))]


def _names(macro: Definition) -> set[str]:
    return set(NAME.findall(grammar.without_texts(macro.content)))


def _arguments(macro: Definition) -> set[str]:
    """Arguments of a macro but for places: times and slips, the same all over an integral."""
    return set(NAME.findall(macro.arguments or "")) - PLACE


def _lost(content: str, fixed: set[str]) -> str:
    """The first choice whose condition and first value have `fixed` names alone, unlike the second.

    As it is written; empty if there is none.
    """
    for each, brackets in _apart(content):
        if choice := re.fullmatch(r"([^?]*)\?([^?:]*):(.*)", each, re.DOTALL):
            condition, first, second = (set(NAME.findall(_written(text, brackets)))
                                        for text in choice.groups())
            if condition | first <= fixed and not second <= fixed:
                return " ".join(_written(each, brackets).split())
    return ""


def _apart(code: str) -> Iterable[tuple[str, list[str]]]:
    """Expressions that brackets, commas and semicolons keep apart, those in brackets first.

    With the brackets so far, for which their numbers in control characters stand.
    """
    brackets = []
    while innermost := INNERMOST.search(code):
        for each in SEPARATORS.split(innermost[0]):
            yield each, brackets
        code = f"{code[:innermost.start()]}\0{len(brackets)}\0{code[innermost.end():]}"
        brackets.append(innermost[0])
    for each in SEPARATORS.split(code):
        yield each, brackets


def _written(text: str, brackets: list[str]) -> str:
    """An expression with its brackets, as it is written."""
    while "\0" in text:
        text = re.sub("\0(\\d+)\0", lambda which: brackets[int(which[1])], text)
    return text
