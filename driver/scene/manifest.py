"""Stage 2: the manifest of an export, in which a scene says what it declared.

It is refused where it was changed since FreeFEM wrote it, and where its words and numbers do not fit together.
"""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from . import elements
from . import seal as seals
from ..errors import InputError

OPTIONAL = ("slip_law", "initial_state", "contact_pairs")  # parts of the manifest that only some scenes have


@dataclass
class Manifest:
    """What the scene declared: sizes, effects, patterns, histories, parameters, units."""

    directory: Path
    subdomains: int
    blocks: int
    nodes: int  # of the untorn bodies
    interface_label: int
    element: str
    plane: str
    material: str
    units: dict
    effects: dict
    steps: int
    t_end: float
    bodies: int
    contact_labels: list
    labels: list
    patterns: list
    amplitudes: dict
    parameters: dict
    contact_pairs: list = field(default_factory=list)  # [label with contact nodes, label of the other body]
    initial_state: bool = False  # whether contact nodes carry a displacement at time 0
    slip_law: dict | None = None  # argument, range, values: factor of the friction coefficient
    seal: seals.Seal | None = field(repr=False, default=None)
    raw: dict = field(repr=False, default_factory=dict)

    @property
    def quasistatic(self) -> bool:
        return self.effects["time"] == "quasistatic"

    @property
    def rooms(self) -> dict:
        e, found = self.effects, {}
        if e["contact"] != "none": found["pair" if self.contact_pairs else "contact"] = {}
        if e["contact"] == "bilateral": found["bilateral"] = {}
        if e["friction"].startswith("coulomb"): found["friction"] = {}
        if e["friction"] == "tresca": found["tresca"] = {}
        if self.slip_law: found["slip_law"] = self.slip_law
        if self.initial_state: found["initial_state"] = {}
        if e.get("initial"): found["preload"] = {}
        for p in self.patterns: found[{"point": "point_load", "thermal": "thermal_strain"}.get(p["kind"], p["kind"])] = {}
        if self.quasistatic: found["history"] = {}
        return found

    @property
    def factors(self) -> np.ndarray:
        """(steps + 1, patterns) factor of every load pattern at the start and after every time step."""
        found = [self.amplitudes[str(pattern["amplitude"])] for pattern in self.patterns]
        return np.array(found).reshape(len(found), self.steps + 1).T


def read_manifest(directory: Path, scene: str | None = None) -> Manifest:
    """Read and check ``manifest.json``; `scene`, if given, is the digest that the scene's text has now.

    Raises InputError when it is missing, spoiled, of another text, not JSON, incomplete or not finite.
    """
    path = Path(directory) / "manifest.json"
    if not path.exists():
        raise InputError(f"{path} is missing: the FreeFEM stage did not finish; run the scene again")
    seal = seals.read(path.parent, scene)
    content = seals.check(seal, path)
    try:
        raw = json.loads(content[:])
    except (ValueError, RecursionError) as problem:
        raise InputError(f"{path} is not readable ({problem}); run the scene again") from None
    names = [name for name in Manifest.__dataclass_fields__ if name not in ("directory", "raw", "seal")]
    missing = [name for name in names if not isinstance(raw, dict) or name not in raw and name not in OPTIONAL]
    if missing:
        raise InputError(f"{path} lacks {', '.join(missing)}; run the scene again")
    manifest = Manifest(directory=Path(directory), raw=raw, seal=seal,
                        **{name: raw[name] for name in names if name in raw})
    try:
        _check_manifest(manifest)
    except InputError as problem:
        raise InputError(f"{path}: {problem}; run the scene again") from None
    return manifest


KINDS = {"subdomains": int, "blocks": int, "nodes": int, "interface_label": int, "element": str, "plane": str,
         "material": str, "units": dict, "effects": dict, "steps": int, "t_end": (int, float), "contact_labels": list,
         "labels": list, "bodies": int, "contact_pairs": list,
         "patterns": list, "amplitudes": dict, "parameters": dict, "initial_state": bool, "slip_law": (dict, type(None))}
# words that mean something to the stages that follow; any other would silently count as "not declared"
WORDS = {"element": tuple(elements.NODES), "plane": ("strain", "stress"), "material": ("isotropic", "general")}
EFFECTS = {"contact": ("none", "unilateral", "bilateral"), "time": ("static", "quasistatic"),
           "friction": ("none", "tresca", "coulomb", "coulomb-slip-dependent"), "initial": ("preload",)}
PATTERNS = ("traction", "body_force", "point", "thermal", "displacement")


def _is(value, kind) -> bool:
    """isinstance, but True is no number."""
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def _finite(values) -> bool:
    """A list of finite numbers?"""
    return isinstance(values, list) and all(_is(v, (int, float)) and abs(v) < math.inf for v in values)


def _check_manifest(manifest: Manifest) -> None:
    for name, kind in KINDS.items():
        if not _is(getattr(manifest, name), kind):
            raise InputError(f"{name} is not of the right type")
    if min(manifest.subdomains, manifest.blocks, manifest.nodes, manifest.steps, manifest.bodies) <= 0:
        raise InputError("subdomains, blocks, nodes, steps and bodies must be positive whole numbers")
    blocks = len(manifest.seal.files.keys() - {"manifest.json", seals.SHARED})
    if manifest.blocks != blocks:
        raise InputError(f"{manifest.blocks} blocks are declared, {blocks} were sealed")
    if not 0 < manifest.t_end < math.inf:
        raise InputError("t_end must be a positive number")
    if not all(_is(label, int) for label in [*manifest.labels, *manifest.contact_labels]):
        raise InputError("a label is no whole number")
    for pair in manifest.contact_pairs:
        if not (isinstance(pair, list) and len(pair) == 2 and pair[0] in manifest.contact_labels
                and pair[1] in manifest.labels):
            raise InputError(f"contact_pairs has {pair!r} where two labels of the mesh belong")
    found = {name: getattr(manifest, name) for name in WORDS} | manifest.effects
    for name, words in (WORDS | EFFECTS).items():
        if name in found and found[name] not in words or name not in (*found, "initial"):
            raise InputError(f"{name} must be one of {', '.join(words)}, not {found.get(name)!r}")
    _check_histories(manifest)
    if manifest.slip_law is not None:
        _check_slip_law(manifest.slip_law)


def _check_histories(manifest: Manifest) -> None:
    for number, history in manifest.amplitudes.items():
        if not _finite(history):
            raise InputError(f"amplitude {number} is not finite at every step")
        if len(history) != manifest.steps + 1:
            raise InputError(f"amplitude {number} has {len(history)} values for {manifest.steps} steps")
    for pattern in manifest.patterns:
        if not isinstance(pattern, dict) or not {"kind", "amplitude"} <= set(pattern):
            raise InputError("a load pattern lacks its kind or amplitude")
        if pattern["kind"] not in PATTERNS:
            raise InputError(f"{pattern['kind']!r} is no kind of load pattern")
        if str(pattern["amplitude"]) not in manifest.amplitudes:
            raise InputError(f"amplitude {pattern['amplitude']} is used but not given")


def _check_slip_law(law: dict) -> None:
    sound = set(law) == {"argument", "range", "values"} and law["argument"] in ("slip", "displacement")
    if not (sound and _finite([law["range"]]) and law["range"] > 0 and _finite(law["values"]) and len(law["values"]) > 1):
        raise InputError("slip_law must have argument, a positive range and finite values")
