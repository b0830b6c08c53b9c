"""Values of NAME=VALUE options: how each kind is read, with one line for what is wrong."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError

NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
DIGITS = 18  # of a whole number at most
EVERY = "all"  # cycles that a scene declares
_CYCLES = r"until settled|jump( \d*\.?\d+%)?"
CYCLE_WORDS = re.compile(rf"{EVERY}|{_CYCLES}|[1-9]\d{{0,8}}( ({_CYCLES}))?")


@dataclass(frozen=True)
class Kind:
    """A kind of value: `read`(NAME, text) gives it or raises InputError; help writes it `shown`."""

    shown: str
    read: Callable[[str, str], object]
    choices: tuple[str, ...] = ()


def parse_pairs(words: list[str]) -> dict[str, str]:
    """NAME=VALUE words as a dictionary with lower-case names. Raises InputError for other words."""
    pairs = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name:
            raise InputError(f"{word!r} is not of the form NAME=VALUE")
        if not value:
            raise InputError(f"{word} has no value: it stands behind the = without a space")
        if not word.isprintable():
            raise InputError(f"{word!r} holds characters that cannot be printed")
        if name.lower() in pairs:
            raise InputError(f"{name.upper()} is given twice")
        pairs[name.lower()] = value
    return pairs


# ---- kinds of values -----------------------------------------------------------------------------

def choice(*words: str) -> Kind:
    """One of `words`."""
    def read(name: str, text: str) -> str:
        if text not in words:
            raise InputError(f"{name} must be one of {', '.join(words)}, not '{text}'")
        return text

    return Kind("|".join(words), read, words)


def several(*words: str) -> Kind:
    """A list of some of `words`, each once, in the order given."""
    def read(name: str, text: str) -> list[str]:
        chosen = text.split(",")
        for word in chosen:
            if word not in words:
                raise InputError(f"{name} expects some of {','.join(words)}, not '{word}'")
        return list(dict.fromkeys(chosen))

    return Kind(",".join(words), read, words)


def whole(what: str, least: int, most: int = 10**9) -> Kind:
    """A whole number in plain digits from `least` to `most`; `what` it counts."""
    def read(name: str, text: str) -> int:
        if not re.fullmatch("[0-9]+", text):
            raise InputError(f"{name} expects {what}, not '{text}'")
        if len(text) > DIGITS or not least <= int(text) <= most:
            raise InputError(f"{name} expects {what} from {least} to {most}, not '{text}'")
        return int(text)

    return Kind("n", read)


def _yes(name: str, text: str) -> bool:
    if text not in ("yes", "no"):
        raise InputError(f"{name} must be yes or no, not '{text}'")
    return text == "yes"


def _tolerance(name: str, text: str) -> float:
    if not NUMBER.fullmatch(text):
        raise InputError(f"{name} expects a number, not '{text}'")
    if not 0 < float(text) <= 1:
        raise InputError(f"{name} is relative: it must be positive, at most 1, not '{text}'")
    return float(text)


def _share(name: str, text: str) -> tuple[float, str]:
    number, _, quantity = text.partition(",")
    try:
        value = float(number.removesuffix("%")) / (100 if number.endswith("%") else 1)
    except ValueError:
        value = float("nan")
    if not 0 < value < 1:
        raise InputError(f"{name} expects a relative error such as 1% or 0.01, "
                         f"and if you like a quantity, not '{text}'")
    return value, quantity.strip()


def _names(name: str, text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    if not all(names) or len(set(names)) < len(names):
        raise InputError(f"{name}={text} lacks a name or gives one twice")
    return names


def _cycles(name: str, text: str) -> str:
    if not CYCLE_WORDS.fullmatch(text):
        raise InputError(f"{name} expects a number of cycles, 'until settled', 'jump', or 'jump "
                         f"1%' with the error that a jump may have, not '{text}'")
    return text


YES_NO = Kind("yes|no", _yes, ("yes", "no"))
TOLERANCE = Kind("number", _tolerance)
NAMES = Kind("name,...", _names)  # checked where they are used
CYCLES = Kind("n|until settled|jump 1%", _cycles)  # or with a number before the words
SHARE = Kind("1%[,quantity]", _share)  # relative error and quantity, "" where none is named


def text(shown: str) -> Kind:
    """Any text, which is checked where it is used."""
    return Kind(shown, lambda name, value: value)


def path(shown: str = "directory") -> Kind:
    """A file or directory; ~ is the home directory, which shells leave alone in OUT=~/results."""
    def read(name: str, value: str) -> Path:
        try:
            return Path(value).expanduser()
        except RuntimeError:
            raise InputError(f"{name}={value}: there is no such home directory") from None

    return Kind(shown, read)
