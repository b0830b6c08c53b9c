"""Numbers at the head of modules that their comments call parts: they are between none and all."""

import importlib
import re

from driver.environment import ROOT

LINE = re.compile(r"^([A-Z_]+) = [-+\d.e ]+  # (.*)", re.MULTILINE)
# what is said of a part: of what it is one, what it is relative to, or that of unit vectors
SAID = re.compile(r"\b(parts? of|relative|shares? of|cosine|sine|determinant|ratio of|probability|"
                  r"this part|over the next|over distance)\b"
                  r"|^of (a|an|the|all|what|tolerances|forces|K's|W'FW)\b")
# counts and factors of which the same words are said
OTHERS = {"FAR", "FORESEEN", "HALVINGS", "JUMP", "NODES", "OF_CHORDS", "OF_TIME", "PEAK",
          "PROMISING", "SECANTS", "SIDES", "SOFTNESS"}


def parts(package: str) -> dict[str, float]:
    """Those of the modules of a package, by file and name."""
    found = {}
    for path in sorted((ROOT / "driver" / package).glob("*.py")):
        named = [name for name, said in LINE.findall(path.read_text())
                 if SAID.search(said) and name not in OTHERS]
        module = importlib.import_module(f"driver.{package}.{path.stem}") if named else None
        found |= {f"{path.stem}.{name}": getattr(module, name) for name in named}
    return found


def beyond(package: str) -> dict[str, float]:
    """Those that are no parts: not above zero or not below one; of FACING, a cosine, not below zero
    or not above -1.
    """
    found = parts(package)
    assert len(found) >= 7, "comments call hardly any constant of the package a part"
    return {name: value for name, value in found.items()
            if not 0 < (-value if name == "facing.FACING" else value) < 1}
