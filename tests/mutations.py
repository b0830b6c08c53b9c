"""Mutants for `mutants`: small changes of meaning, drawn from the numerical packages and edp/lib.

Those of the driver are made by cosmic-ray, those of the FreeFEM library by `TEXTS`.
"""

import random
import re
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("qp", "feti", "contact", "effects", "march", "results", "energy_norm", "validity",
            "estimates", "lib")
# operators of cosmic-ray: those whose mutants are no mere TypeErrors
BINARY = {"Add": ("Sub",), "Sub": ("Add",), "Mul": ("Div",), "Div": ("Mul",), "Pow": ("Mul",),
          "FloorDiv": ("Mul",), "Mod": ("Mul",), "BitAnd": ("BitOr",), "BitOr": ("BitAnd",)}
COMPARED = {"Eq": ("NotEq",), "NotEq": ("Eq",), "Lt": ("LtE", "GtE"), "LtE": ("Lt", "Gt"),
            "Gt": ("GtE", "LtE"), "GtE": ("Gt", "Lt")}
OPERATORS = (*(f"ReplaceBinaryOperator_{a}_{b}" for a, others in BINARY.items() for b in others),
             *(f"ReplaceComparisonOperator_{a}_{b}" for a, others in COMPARED.items()
               for b in others), "ReplaceUnaryOperator_Delete_USub",
             "ReplaceUnaryOperator_Delete_Not", "ReplaceUnaryOperator_Delete_Invert", "AddNot",
             "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr",
             "ReplaceOrWithAnd", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak",
             "NumberReplacer", "ZeroIterationForLoop")
# of the FreeFEM library: pattern and what it becomes
TEXTS = (
    (r"(?<![\w.])(?!0\.(?!\d))\d+\.\d*(?![\w.])", lambda m: f"({m[0]} * 1.01)"),  # a factor
    (r"(?<=[\w)\]]) - (?=[\w(\[])", lambda m: " + "),
    (r"(?<=[\w)\]]) \+ (?=[\w(\[])", lambda m: " - "),
    (r"(?<=[=(,] )-(?=[\w(])|(?<=[=(])-(?=[\w(])", lambda m: ""),
    (r"(?<=; )\w+ < [\w.]+(?=;)", lambda m: f"{m[0]} - 1"),  # the last element
    (r"\blabel\b(?! *[=(])", lambda m: "(label + 1)"),
    (r"\bmax\(", lambda m: "min("), (r"\bmin\(", lambda m: "max("),
    (r" > ", lambda m: " < "), (r" && ", lambda m: " || "),
)


@dataclass(frozen=True)
class Mutant:
    """A file (relative to the tree) and its changed text; the line that changes."""

    file: str
    text: str
    line: int
    before: str
    after: str

    @property
    def package(self) -> str:
        """One of `PACKAGES`."""
        return package(self.file)


def package(file: str) -> str:
    """The one of `PACKAGES` that a file is of, by its path in the tree."""
    return "lib" if file.startswith("edp") else file.split("/")[1]


def mutant(file: str, text: str, changed: str) -> Mutant:
    """The mutant that makes `changed` of `text`; lines of more than one are joined."""
    before, after = text.splitlines(), changed.splitlines()
    start = next(k for k, pair in enumerate(zip(before, after)) if pair[0] != pair[1])
    stop = next(k for k, pair in enumerate(zip(before[::-1], after[::-1])) if pair[0] != pair[1])
    return Mutant(file, changed, start + 1, *(" ".join(
        line.strip() for line in lines[start : max(len(lines) - stop, start + 1)])
        for lines in (before, after)))


def of_python(path: Path, rng: random.Random) -> list:
    """Functions without arguments that make the mutants of a module, five of an operator at most.
    """
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    text, file, made = path.read_text(), str(path.relative_to(ROOT)), []
    nodes, lines = list(ast_nodes(get_ast(text))), text.splitlines()
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        starts = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        places = [k for k, (line, _) in enumerate(starts) if not _idle(lines[line - 1])]
        for place in rng.sample(places, min(len(places), 5)):
            made.append(lambda operator=operator, place=place: mutant(
                file, text, mutate_code(text, operator, place)))
    return made


def _idle(line: str) -> bool:
    """Whether a change there is none of meaning: hints of types, decorators, messages."""
    return bool(re.match(r"\s*(def |class |@|\w+: |\"|raise )|.* -> |.*\bf\"", line))


def of_freefem(path: Path) -> list:
    """As `of_python`, of an include; comments and lines with messages stay."""
    text, file, made = path.read_text(), str(path.relative_to(ROOT)), []
    lines = text.split("\n")
    for number, line in enumerate(lines):
        code = line.split("//")[0]
        for pattern, become in TEXTS if '"' not in code else ():
            for match in re.finditer(pattern, code):
                new = line[:match.start()] + become(match) + line[match.end():]
                new = "\n".join([*lines[:number], new, *lines[number + 1:]])
                made.append(lambda new=new: mutant(file, text, new))
    return made


def files(module: str) -> dict[str, list[Path]]:
    """Files to mutate by package; `module` is a package, a file of one, or empty for all."""
    every = {name: sorted((ROOT / "driver" / name).glob("*.py")) for name in PACKAGES[:-1]}
    every["lib"] = sorted((ROOT / "edp" / "lib").rglob("*.idp"))
    if module in ("", *every):  # a package rather than a file of the same name
        return every if module == "" else {module: every[module]}
    chosen = {name: [path for path in paths
                     if path.match(module) or path.stem == module.removesuffix(".py")]
              for name, paths in every.items()}
    chosen = {name: paths for name, paths in chosen.items() if paths}
    if not chosen:
        sys.exit(f"MODULE={module} is none of {', '.join(every)}, nor a file of them")
    return chosen


def drawn(module: str, count: int, seed: int) -> list[Mutant]:
    """`count` mutants, packages in turn."""
    rng, decks = random.Random(seed), []
    for paths in files(module).values():
        deck = [one for path in paths
                for one in (of_freefem(path) if path.suffix == ".idp" else of_python(path, rng))]
        rng.shuffle(deck)
        decks.append(deck)
    chosen = []
    while len(chosen) < count and any(decks):
        chosen += [one for one in (deck.pop()() for deck in decks if deck)
                   if _compiles(one) and not _alike(one)]
    return chosen[:count]


def _alike(one: Mutant) -> bool:
    """Whether numpy cannot tell them apart: any negative number in `reshape` stands for the rest.
    """
    return re.sub(r"(reshape\(.*)- ?2\b", r"\1-1", one.after) == one.before


def _compiles(one: Mutant) -> bool:
    """Whether Python can read it: what it cannot would be noticed by nobody's merit."""
    try:
        return one.package == "lib" or bool(compile(one.text, one.file, "exec"))
    except SyntaxError:
        return False
