"""Values of NAME=VALUE options: read from their text and checked, with one line for what is wrong."""

import re

from .errors import InputError

NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


def only(options: dict, names, who: str) -> None:
    """Raises InputError for an option that is none of `names`."""
    unknown = sorted(set(options) - set(names))
    if unknown:
        raise InputError(f"{who} has no option {unknown[0].upper()}; it has {', '.join(map(str.upper, names))}")


def choice(options: dict, name: str, allowed, preset: str) -> str:
    """One of the words `allowed`. Raises InputError."""
    value = options.get(name, preset)
    if value not in allowed:
        raise InputError(f"{name.upper()} must be one of {', '.join(allowed)}, not '{value}'")
    return value


def yes(options: dict, name: str, preset: str) -> bool:
    """Whether the option says yes. Raises InputError for other words than yes and no."""
    value = options.get(name, preset)
    if value not in ("yes", "no"):
        raise InputError(f"{name.upper()} must be yes or no, not '{value}'")
    return value == "yes"


def count(name: str, text: str, what: str, least: int, most: int = 10**9) -> int:
    """A whole number in plain digits, from `least` to `most`. Raises InputError."""
    if not re.fullmatch("[0-9]+", text):
        raise InputError(f"{name.upper()} expects {what}, not '{text}'")
    if len(text) > 18 or not least <= int(text) <= most:
        raise InputError(f"{name.upper()} expects {what} from {least} to {most}, not '{text}'")
    return int(text)


def positive(name: str, text: str) -> float:
    """A positive number. Raises InputError."""
    if not NUMBER.fullmatch(text):
        raise InputError(f"{name.upper()} expects a number, not '{text}'")
    if not 0 < float(text) < float("inf"):
        raise InputError(f"{name.upper()} must be positive, not '{text}'")
    return float(text)
