"""Study: what each declared effect of a scene changes and what it costs.

    python3 -m driver effects SCENE=bracket [SUBDOMAINS=] [STEPS=] [NP=] [OUT=results/effects] [...]

The scene runs as declared and with each effect left out in turn (WITHOUT= of `make run`), each in a
process of its own, so that its memory is its own. Leaves ``<scene>.csv``, ``<scene>-tractions.csv``
and a picture.
"""

import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from .. import files, options
from ..errors import PARTIAL, InputError, error_of
from ..runs import guard
from ..runs.own_process import BARE, run_alone
from ..scene import freefem
from ..scene.manifest import QUASISTATIC, Manifest
from ..scene.rooms import rooms
from ..text import aligned, change, words
from ..units import spelt

DRIVES = ("traction", "displacement")  # left out one by one where there are several loads
FIXED = BARE | {"errors": "no"}
# at the end of the run, with powers of stress and length in their units
RESPONSE = {"peak_normal": (1, 0), "peak_tangential": (1, 0), "resultant_n": (1, 1),
            "resultant_t": (1, 1), "contact_length": (0, 1), "largest_slip": (0, 1),
            "dissipated": (1, 2), "max_displacement": (0, 1)}
MULTIPLIERS = ("dual_gluing", "dual_normal", "dual_tangential", "dual_joined")
COST = ("primal_dofs", *MULTIPLIERS, "coarse_dofs", "steps",
        "fixed_point_iterations", "dual_multiplications", "dual_multiplications_setup")
STAGES = ("export", "read", "setup", "solve", "output", "total")
COLUMNS = ("without", "status", "reason", *RESPONSE, *(f"{name}_change" for name in RESPONSE),
           *COST, *(f"seconds_{name}" for name in STAGES), "memory_mib")
TRACTIONS = ("variant", "boundary", "step", "arc", "weight",
             "sigma_n", "sigma_t", "length_unit", "stress_unit")


def variants(manifest: Manifest) -> dict[str, str]:
    """Name of every declared effect and the word of WITHOUT that leaves it out."""
    names = {words(room): room for room in manifest.rooms
             if room not in (*DRIVES, "pair", "probe", QUASISTATIC)}  # pairs: with contact
    macros = {room.name: next(iter(room.declared_by)).removesuffix("#") for room in rooms()}
    if len(manifest.patterns) > 1:
        for pattern in manifest.patterns:
            macro, number = macros[pattern["kind"]], pattern["amplitude"]
            if pattern["kind"] in DRIVES:
                names[f"{macro} {number}"] = f"{macro}{number}"
    if manifest.quasistatic:
        names["time"] = QUASISTATIC
        if len(manifest.amplitudes) > 1:
            names |= {f"history of {k}": f"amplitude{k}" for k in manifest.amplitudes}
    return names


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


def run_variant(name: str, without: str, scene: Path, pairs: dict[str, str],
                folder: Path) -> Variant:
    """Run the scene with the options `pairs` in a process of its own, an effect left out if any."""
    out = folder / (without or "declared")
    given = {**pairs, **FIXED, "scene": scene, "out": out}
    if without:
        given["without"] = without
    if without == QUASISTATIC:
        given.pop("steps", None)
    status, answer = run_alone(given)
    if status:
        reason = answer.splitlines()[-1].removeprefix("error: ").split(PARTIAL)[0]
        return Variant(name, status, reason)
    return read_variant(name, out)


def read_variant(name: str, out: Path) -> Variant:
    """Row and contact tractions of a finished run."""
    summary = json.loads((out / "summary.json").read_text())
    history = files.read_table(out / "history.csv")
    row, tractions = dict.fromkeys(RESPONSE, 0.0), []
    row |= {key: abs(float(history[key][-1]))
            for key in ("resultant_n", "resultant_t", "contact_length", "dissipated",
                        "max_displacement")}
    contact = files.read_table(out / "contact.csv")
    if contact:
        slip = abs(contact["slip"]) * (contact["status"] != "open")
        slip = slip.reshape(summary["steps"], -1).sum(axis=0)
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
            # tangential values of frictionless contact are rounding, nothing beside the pressures
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

    given = options.read("effects", pairs)
    scene, out = freefem.find_scene(given["scene"]), given["out"]
    out = guard.study_folder(out, "effects")
    done = []
    with tempfile.TemporaryDirectory(prefix=f".{scene.stem}.", dir=out) as folder:
        manifest = freefem.export(scene, Path(folder) / "export", given.parameters)
        left_out = variants(manifest)
        if not left_out:
            raise InputError(f"{scene.name} declares no effect that could be left out: a single "
                             "load on a body, without contact or time")
        for name, without in {"": "", **left_out}.items():
            variant = run_variant(name, without, scene, pairs, Path(folder))
            if variant.status == 2 and without.startswith("amplitude"):
                continue  # the scene does not declare that history
            done.append(variant)
            print(f"{variant.label}: {variant.reason or 'done'}", flush=True)
            if done[0].status:
                status = done[0].status
                raise error_of(status if status in (1, 2, 3, 4) else 2, done[0].reason)
    compare(done)
    rows = [{**v.row, "without": v.name, "status": v.status, "reason": v.reason} for v in done]
    table = files.write_table(out / f"{scene.stem}.csv", rows, COLUMNS)
    tractions = files.write_rows(out / f"{scene.stem}-tractions.csv", TRACTIONS,
                                 [row for variant in done for row in variant.tractions])
    print(describe(done, manifest.units))
    return [table, tractions, *draw(table)]


# ---- table ---------------------------------------------------------------------------------------

def describe(variants: list[Variant], units: dict[str, str]) -> str:
    """Both tables as text: changes relative to the scene as declared, and costs.

    Values of the scene as declared are in its `units`.
    """
    solved = [variant for variant in variants if variant.row]
    changes = [["", *(f"{words(name)} [{spelt(*powers, units)}]"
                      for name, powers in RESPONSE.items())]]
    for variant in solved:
        changes.append([variant.label, *(change(variant.row[f"{name}_change"]) if variant.name
                                         else f"{variant.row[name]:.4g}" for name in RESPONSE)])
    costs = [["", "primal dofs", "multipliers", "coarse dofs", "products",
              *(f"{stage} s" for stage in STAGES), "MiB"]]
    for variant in solved:
        row = variant.row
        costs.append([variant.label, row["primal_dofs"],
                      sum(row[name] for name in MULTIPLIERS), row["coarse_dofs"],
                      row["dual_multiplications"],
                      *(f"{row[f'seconds_{stage}']:.3f}" for stage in STAGES),
                      f"{row['memory_mib']:.0f}"])
    lines = ["", "changes at the end of the run", aligned(changes)]
    lines += [f"{variant.label}: {variant.reason}" for variant in variants if not variant.row]
    return "\n".join([*lines, "", "costs", aligned(costs)])
