"""Functions of a scene (func, and those of a finite element space), as its macros are known."""

import re

from . import grammar

# func name = ...; and  func type name(arguments) { ... }
FUNCTION = re.compile(r"\bfunc\s+(?:\w+(?:\s*\[[\w,\s]*\])?\s+)?(\w+)\s*(?:\(([^()]*)\)\s*\{|=)")
SPACE = re.compile(r"\bfespace\s+(\w+)\s*\(")
PLACE = "[x, y]"  # stands for the values of a finite element function


def definitions(source: grammar.Source) -> list[grammar.Definition]:
    """The functions of a file; names that the body of one declares are among its arguments.

    Those without arguments are expressions of the place, or finite element functions.
    """
    code = "\n".join(source.code)
    found = []
    for head in FUNCTION.finditer(code):
        if head[2] is None:
            content, own = code[head.end() : _end(code, head.end(), ";")], None
        else:
            content = code[head.end() : _end(code, head.end(), "}")]
            own = ", ".join([head[2], *_declared(content)])
        found.append(_definition(source, code, head.start(), head[1], own, content))
    for space in SPACE.findall(code):
        for names in re.finditer(rf"(?:^|[;{{}}])\s*{space}\s+([^;]*)", code):
            found += [_definition(source, code, names.start(1), name, None, PLACE)
                      for name in grammar.declared_names(names[1])]
    return found


def without_calls(code: str, functions: list[grammar.Definition]) -> str:
    """Code in which finite element functions at a point that is given, name(a, b), are numbers."""
    for function in functions:
        if function.arguments is None:
            code = re.sub(rf"\b{function.name}(?=\()", "1*", code)
    return code


def _definition(source, code: str, start: int, name: str, own, content: str) -> grammar.Definition:
    return grammar.Definition(source.path, code.count("\n", 0, start) + 1, name, own, content, True)


def _end(code: str, start: int, mark: str) -> int:
    """Where a mark stands outside of the braces that are opened from `start` on."""
    depth = 0
    for place in range(start, len(code)):
        if code[place] == mark and depth == 0:
            return place
        depth += (code[place] == "{") - (code[place] == "}")
    return len(code)


def _declared(body: str) -> list[str]:
    """Names that the body of a function declares."""
    found = (grammar.DECLARATION.match(part.strip()) for part in re.split("[;{}]", body))
    return [name for each in found if each for name in grammar.declared_names(each[1])]
