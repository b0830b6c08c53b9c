"""Numbers of a scene as people write them elsewhere, 0,3 or 210 000, and lists that are none."""

import re

POINTLESS = re.compile(r"(?<![\w.,])\d+(?:,\d+|[' ]\d{3}\b)(?![\w,.]*\()")  # 0,3 or 210 000


def pointless(code: str, token: str | None = None) -> str:
    """What to write instead of 0,3 or 210 000; empty where code has no such numbers, or none that
    ends in a `token` that is not understood: 4,1 may be two labels.
    """
    found = [number for number in POINTLESS.findall(code)
             if token is None or re.split("[,' ]", number)[-1] == token]
    return (f"; is {found[-1]} one number? numbers have a decimal point, no commas and no blanks: "
            "0.3, 210000") if found else ""


def too_many(given: str, form: str) -> str:
    """`pointless` of a call of which what follows its parenthesis is `given`, if its numbers with
    commas would be all that it has more than its `form`: 0,2 may be two coordinates.
    """
    inside, more = _inside(given), len(arguments(given)) - len(form.split(","))
    commas = sum("," in number for number in POINTLESS.findall(inside))
    told = ", " in inside and more == commas > 0  # else no blank tells a number from two
    return pointless(inside) if told else ""


def _inside(code: str) -> str:
    """What stands in the parentheses of a call, given what follows the first."""
    depth = 0
    for k, letter in enumerate(code):
        depth += (letter in "([") - (letter in ")]")
        if depth < 0:
            return code[:k]
    return code


def arguments(code: str) -> list[str]:
    """Arguments of a call, given what follows its parenthesis."""
    parts, depth = [""], 0
    for letter in _inside(code):
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]
