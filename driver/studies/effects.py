"""Study: what each declared effect of a scene changes and what it costs.

    python3 -m driver effects SCENE=bracket [SUBDOMAINS=] [STEPS=] [NP=] [OUT=results/effects] [...]

The scene runs as declared and with each effect left out in turn. A variant is the scene's own text
without the macros that declare the effect; it runs in a process of its own, so that its memory is
its own. Leaves ``<scene>.csv``, ``<scene>-tractions.csv`` and a picture.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from .. import environment, files
from ..errors import InputError, error_of
from ..runs.run import RESULTS
from ..scene import freefem
from ..text import aligned, change, words

FRICTION = r"friction|tresca|slipFactor|displacementFactor|slipRange"
# left out one after the other: name and the macros that declare it; no macro of a scene may be in
# the way
EFFECTS = {
    "friction": FRICTION,
    "slip dependence": "slipFactor|displacementFactor|slipRange",
    "contact": f"contact|contactPair|contactNormal|gap|pairGap|obstacle|bilateral|{FRICTION}",
    "gap": "gap|pairGap",
    "obstacle": "obstacle",
    "lift-off": "bilateral",
    "body force": r"bodyForce\d",
    "point loads": r"pointLoad\d",
    "thermal strain": r"thermal\w*",
    "initial state": "initialX|initialY",
}
NAMES = {"lift-off": "adhesion (bilateral)"}
# forces and displacements: left out one by one where there are several
LOADS = r"(load|displacement)(\d)"
# an include that holds one of these is part of the scene
DECLARATIONS = {"young", "poisson", "support", "contact", "gap", "friction", "tresca", "load1",
                "displacement1", "quasistatic"}

# at the end of the run
RESPONSE = ("peak_normal", "peak_tangential", "resultant_n", "resultant_t", "contact_length",
            "largest_slip", "dissipated", "max_displacement")
COST = ("primal_dofs", "dual_gluing", "dual_normal", "dual_tangential", "coarse_dofs", "steps",
        "fixed_point_iterations", "dual_multiplications", "dual_multiplications_setup")
STAGES = ("export", "read", "setup", "solve", "output", "total")
COLUMNS = ("without", "status", "reason", *RESPONSE, *(f"{name}_change" for name in RESPONSE),
           *COST, *(f"seconds_{name}" for name in STAGES), "memory_mib")
TRACTIONS = ("variant", "boundary", "step", "arc", "weight",
             "sigma_n", "sigma_t", "length_unit", "stress_unit")

# strings and comments first, so that nothing inside them is taken for a declaration; a macro ends
# at its //
TOKEN = re.compile(
    r'\binclude\s*"(?P<include>[^"\n]*)"|(?P<string>"[^"\n]*")|/\*.*?\*/'
    r"|\bmacro\s+(?P<macro>\w+).*?(?://[^\n]*|\Z)|\bNewMacro\s+(?P<new>\w+).*?\bEndMacro\b"
    r"|\bquasistatic\s*\((?P<end>(?:[^()]|\((?:[^()]|\([^()]*\))*\))*)\)|//[^\n]*", re.S)


# ---- the scene's text ----------------------------------------------------------------------------

def declared(text: str) -> list[str]:
    """Names of the macros that a scene's text defines, in order, and ``quasistatic`` if it calls
    that."""
    return [match["macro"] or match["new"] or "quasistatic" for match in TOKEN.finditer(text)
            if match["macro"] or match["new"] or match["end"] is not None]


def without(text: str, macros: str) -> str:
    """The text without the definitions of macros whose whole name matches the pattern `macros`."""
    def keep(match):
        name = match["macro"] or match["new"]
        return "" if name and re.fullmatch(macros, name) else match[0]

    return TOKEN.sub(keep, text)


def static(text: str) -> str:
    """The text with ``quasistatic(T)`` replaced by its end time.

    That is one step under the final amplitudes.
    """
    def replace(match):
        return match[0] if match["end"] is None else f"timeEnd = {match['end']}"

    return TOKEN.sub(replace, text)


def constant(text: str, number: str) -> str:
    """The text with amplitude `number` at its final value in every step."""
    def replace(match):
        if match["macro"] != f"amplitude{number}":
            return match[0]
        renamed = re.sub(rf"\bamplitude{number}\b", f"amplitudeUntil{number}", match[0], count=1)
        return f"{renamed}\nmacro amplitude{number}(t) amplitudeUntil{number}((timeEnd)) //"

    return TOKEN.sub(replace, text)


def self_contained(scene: Path) -> str:
    """The scene's text that works in any folder.

    Includes that hold declarations are put in place, paths of the scene's files made absolute.
    """
    def resolve(match):
        if match["include"]:
            for folder in (scene.parent, environment.LIBRARY):
                path = folder / match["include"]
                if path.is_file() and path.name not in ("scene.idp", "export.idp"):
                    inner = self_contained(path)
                    if folder == scene.parent or set(declared(inner)) & DECLARATIONS:
                        return inner
            return match[0]
        if match["string"] and (scene.parent / match["string"][1:-1]).is_file():
            return f'"{(scene.parent / match["string"][1:-1]).resolve()}"'
        return match[0]

    return TOKEN.sub(resolve, scene.read_text())


def variants(text: str) -> dict[str, str]:
    """Name of every declared effect and the scene's text without it."""
    names = declared(text)

    def matching(pattern: str) -> list[str]:
        return [name for name in names if re.fullmatch(pattern, name)]

    texts = {NAMES.get(effect, effect): without(text, pattern)
             for effect, pattern in EFFECTS.items() if matching(pattern.split("|" + FRICTION)[0])}
    loads = matching(LOADS)
    if len(loads + matching(r"(bodyForce|pointLoad)\d")) > 1:
        for name in loads:
            texts[re.sub(r"(\d)", r" \1", name)] = without(text, name)
    if "quasistatic" in names:
        texts["time"] = static(text)
        amplitudes = matching(r"amplitude\d")
        for name in amplitudes if len(amplitudes) > 1 else ():
            texts[f"history of {name[-1]}"] = constant(text, name[-1])
    return texts


# ---- runs ----------------------------------------------------------------------------------------

@dataclass
class Variant:
    """A finished, or failed, run: a row of the table and the contact tractions at its end."""

    name: str  # the effect that is left out, "" for the scene as declared
    status: int
    reason: str = ""
    row: dict = field(default_factory=dict)
    tractions: list = field(default_factory=list)  # rows of TRACTIONS

    @property
    def label(self) -> str:
        """Name of the row."""
        return f"without {self.name}" if self.name else "as declared"


def run_variant(name: str, text: str, scene: Path, pairs: dict[str, str], folder: Path) -> Variant:
    """Run a scene's text with the options `pairs` in a process of its own."""
    place = folder / re.sub(r"\W+", "-", name or "declared")
    place.mkdir()
    (place / scene.name).write_text(text)
    options = {**pairs, "scene": place / scene.name, "out": place / "out", "figures": "no",
               "fields": "no", "quiet": "yes", "errors": "no"}
    if name == "time":
        options.pop("steps", None)
    words = [f"{key.upper()}={value}" for key, value in options.items()]
    env = {**os.environ, "PYTHONPATH": environment.python_path()}
    done = subprocess.run([sys.executable, "-m", "driver", "run", *words], env=env,
                          stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        reason = lines[-1].removeprefix("error: ").split("; what was found is kept in")[0]
        return Variant(name, done.returncode, reason)
    return read_variant(name, place / "out")


def read_variant(name: str, out: Path) -> Variant:
    """Row and contact tractions of a finished run."""
    summary, history = json.loads((out / "summary.json").read_text()
                                  ), files.read_table(out / "history.csv")
    row, tractions = dict.fromkeys(RESPONSE, 0.0), []
    row |= {key: abs(float(history[key][-1]))
            for key in ("resultant_n", "resultant_t", "contact_length", "dissipated",
                        "max_displacement")}
    contact = files.read_table(out / "contact.csv")
    if contact:
        slip = abs(contact["slip"]).reshape(summary["steps"], -1).sum(axis=0)
        end = {key: column[contact["step"] == summary["steps"]] for key, column in contact.items()}
        row |= {"largest_slip": float(slip.max()), "peak_normal": float(abs(end["sigma_n"]).max()),
                "peak_tangential": float(abs(end["sigma_t"]).max())}
        end.setdefault("boundary", 0 * end["node"])
        units = summary["units"]["length"], summary["units"]["stress"]
        tractions = [(name, *values, *units)
                     for values in zip(*(end[key].tolist() for key in TRACTIONS[1:-2]))]
    row |= {key: value for part in (summary["sizes"], summary["counts"], summary)
            for key, value in part.items() if key in COST}
    row |= {f"seconds_{stage}": summary["seconds"][stage] for stage in STAGES}
    return Variant(name, 0, "", row | {"memory_mib": summary["memory_mib"]}, tractions)


def compare(variants: list[Variant]) -> None:
    """Add to every row its changes relative to the scene as declared, the first of `variants`."""
    full = variants[0].row
    for row in (variant.row for variant in variants if variant.row):
        for name in RESPONSE:
            # what friction leaves at a frictionless contact is rounding: nothing, compared with the
            # pressures
            scale = {"resultant_t": "resultant_n", "peak_tangential": "peak_normal"}.get(name, name)
            size = abs(full[name])
            some = size > 1e-9 * abs(full[scale])
            row[f"{name}_change"] = (row[name] - full[name]) / size if some else None


def run_effects(pairs: dict[str, str]) -> list[Path]:
    """Run all variants, write the table and draw it; returns the files.

    Raises InputError for options that the study sets itself and for a scene that does not run as
    declared (DriverError of the run's exit status).
    """
    from ..figures.effects import draw

    if "scene" not in pairs:
        raise InputError(
            "make effects SCENE=<name or path to an .edp>; 'make run' lists the scenes")
    for name in ("figures", "fields", "quiet", "errors"):
        if name in pairs:
            raise InputError(f"the study sets {name.upper()} itself")
    scene = freefem.find_scene(pairs["scene"])
    out = Path(pairs.get("out", RESULTS / "effects"))
    out.mkdir(parents=True, exist_ok=True)
    text = self_contained(scene)
    done = []
    with tempfile.TemporaryDirectory(prefix=f".{scene.stem}.", dir=out) as folder:
        for name, changed in {"": text, **variants(text)}.items():
            done.append(run_variant(name, changed, scene, pairs, Path(folder)))
            print(f"{done[-1].label}: {done[-1].reason or 'done'}", flush=True)
            if done[0].status:
                raise error_of(done[0].status if done[0].status in (2, 3, 4) else 2, done[0].reason)
    compare(done)
    rows = [{**v.row, "without": v.name, "status": v.status, "reason": v.reason} for v in done]
    table = files.write_table(out / f"{scene.stem}.csv", rows, COLUMNS)
    tractions = files.write_rows(out / f"{scene.stem}-tractions.csv", TRACTIONS,
                                 [row for variant in done for row in variant.tractions])
    print(describe(done))
    return [table, tractions, *draw(table)]


# ---- table ---------------------------------------------------------------------------------------

def describe(variants: list[Variant]) -> str:
    """Both tables as text: changes relative to the scene as declared, and costs."""
    solved = [variant for variant in variants if variant.row]
    changes = [["", *(words(name) for name in RESPONSE)]]
    for variant in solved:
        changes.append([variant.label, *(change(variant.row[f"{name}_change"]) if variant.name
                                         else f"{variant.row[name]:.4g}" for name in RESPONSE)])
    costs = [["", "primal dofs", "multipliers", "coarse dofs", "products",
              *(f"{stage} s" for stage in STAGES), "MiB"]]
    for variant in solved:
        row = variant.row
        costs.append([variant.label, row["primal_dofs"],
                      row["dual_gluing"] + row["dual_normal"] + row["dual_tangential"],
                      row["coarse_dofs"], row["dual_multiplications"],
                      *(f"{row[f'seconds_{stage}']:.3f}" for stage in STAGES),
                      f"{row['memory_mib']:.0f}"])
    lines = ["", "changes at the end of the run", aligned(changes)]
    lines += [f"{variant.label}: {variant.reason}" for variant in variants if not variant.row]
    return "\n".join([*lines, "", "costs", aligned(costs)])
