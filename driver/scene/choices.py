"""Choices ? : that FreeFEM does not take as they are written."""

import re
from collections.abc import Iterable

from . import grammar
from .grammar import Definition, Source

INNERMOST = re.compile(r"[([{][^][(){}]*[])}]")  # brackets without others in them
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
    while True:
        innermost = INNERMOST.search(code)
        part = innermost[0] if innermost else code
        if any(each.count("?") > 1 for each in re.split(r"[][(){},;]", part)):
            return True
        if not innermost:
            return False
        code = code[:innermost.start()] + code[innermost.end():]


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
    brackets = []  # those looked at, which numbers in control characters stand for

    def written(text: str) -> str:
        while "\0" in text:
            text = re.sub("\0(\\d+)\0", lambda which: brackets[int(which[1])], text)
        return text

    while True:
        innermost = INNERMOST.search(content)
        part = innermost[0][1:-1] if innermost else content
        for each in re.split("[,;]", part):
            if choice := re.fullmatch(r"([^?]*)\?([^?:]*):(.*)", each, re.DOTALL):
                condition, first, second = (set(NAME.findall(written(text)))
                                            for text in choice.groups())
                if condition | first <= fixed and not second <= fixed:
                    return " ".join(written(each).split())
        if not innermost:
            return ""
        content = f"{content[:innermost.start()]}\0{len(brackets)}\0{content[innermost.end():]}"
        brackets.append(innermost[0])
