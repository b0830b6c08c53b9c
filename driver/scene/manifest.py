"""The manifest of an export, in which a scene says what it declared.

It is refused where it was changed since FreeFEM wrote it, and where its words and numbers do not
fit together.
"""

import contextlib
import itertools
import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..errors import InputError
from . import element_kinds
from . import seal as seals
from .declarations import QUASISTATIC
from .rooms import EFFECTS, LOADS

AXISYMMETRIC = "axisymmetric"  # the room of bodies of revolution
CURVED = "curved"  # the room of sides that follow curved boundaries

KINDS = {"subdomains": int, "blocks": int, "nodes": int, "interface_label": int, "element": str,
         "plane": str, "material": str, "units": dict, "rooms": dict, "columns": list,
         "fields": list, "materials": list,
         "steps": int, "t_end": (int, float), "contact_labels": list,
         "labels": list, "regions": list, "bodies": int, "patterns": list, "amplitudes": dict,
         "parameters": dict}
# words that the stages that follow know; any other would silently count as "not declared"
WORDS = {"element": tuple(element_kinds.NODES), "plane": ("strain", "stress"),
         "material": ("isotropic", "general")}
NOTHING = 1e-14  # part of the largest value of a history that is rounding of its argument


@dataclass
class Manifest:
    """What the scene declared: sizes, rooms (effects), patterns, histories, parameters, units.

    `rooms` holds, by name and in the order of inclusion, what every declared effect says of itself;
    `columns` are names of the numbers that contact nodes carry, `fields` of those that all nodes
    do. A pattern has its `kind`, which is the name of its room, what it is `given_on`, and the
    number of its `amplitude`.
    """

    directory: Path
    subdomains: int
    blocks: int
    nodes: int  # of the untorn bodies
    interface_label: int
    element: str
    plane: str
    material: str
    units: dict
    rooms: dict
    columns: list
    fields: list
    steps: int
    t_end: float
    bodies: int
    contact_labels: list
    labels: list
    materials: list  # of every body {body, name, young, poisson}, where given body by body
    regions: list  # the lowest and the highest number of the regions of all meshes
    patterns: list
    amplitudes: dict
    parameters: dict
    between: dict = field(repr=False, default_factory=dict)  # amplitudes, several in a step
    seal: seals.Seal | None = field(repr=False, default=None)
    raw: dict = field(repr=False, default_factory=dict)

    @property
    def quasistatic(self) -> bool:
        """Whether loads have a history in time steps; else there is one step."""
        return QUASISTATIC in self.rooms

    @property
    def axisymmetric(self) -> bool:
        """Whether x is a radius, and all integrals are over the revolution about x = 0."""
        return AXISYMMETRIC in self.rooms

    @property
    def curved(self) -> list:
        """Labels of the boundaries whose sides are curved; linear elements have none."""
        return self.rooms[CURVED]["labels"] if CURVED in self.rooms and self.element != "P1" else []

    @property
    def cycle_start(self) -> int:
        """The step after which the cycle of a repeated history begins; 0 without cycles."""
        return self.rooms.get("cycles", {}).get("start", 0)

    @property
    def notes(self) -> list:
        """What is odd about the scene's meshes: warnings of every run on them."""
        return self.raw.get("notes", [])

    @property
    def label_names(self) -> dict[int, str]:
        """Names that gmsh files give to labels."""
        return {int(label): name for label, name in self.raw.get("label_names", {}).items()}

    @property
    def contact_pairs(self) -> list:
        """Pairs [label with contact nodes, label of the other body]."""
        return self.rooms.get("pair", {}).get("labels", [])

    @property
    def row_labels(self) -> list:
        """Labels where bodies or subdomains meet one another or obstacles: rows act there."""
        pairs = [pair for room in self.rooms.values() for pair in room.get("labels", [])
                 if isinstance(pair, list)]
        return [self.interface_label, *self.contact_labels, *itertools.chain(*pairs)]

    @property
    def factors(self) -> "np.ndarray":
        """(steps + 1, patterns) factor of every load pattern at the start and after every step.

        What is rounding beside the largest of its history, between the steps as well, is zero:
        sin(2 pi t) = -2.4e-16 for t = 1 is no load, and answers to it are rounding alone.
        """
        import numpy as np  # here: this module is read before FreeFEM starts

        histories = [self.amplitudes[str(pattern["amplitude"])] for pattern in self.patterns]
        factors = np.array(histories, float).reshape(len(histories), self.steps + 1).T
        finer = [self.between.get(str(pattern["amplitude"]), ()) for pattern in self.patterns]
        largest = np.maximum(np.abs(factors).max(axis=0, initial=0.0),
                             [np.abs(values).max(initial=0.0) for values in finer])
        return np.where(np.abs(factors) > NOTHING * largest, factors, 0.0)

    def unrolled(self, count: int) -> "Manifest":
        """The same with the cycle of a repeated history `count` times, as one long history."""
        start, steps = self.cycle_start, self.steps
        amplitudes = {number: [*history[: start + 1], *count * history[start + 1:]]
                      for number, history in self.amplitudes.items()}
        rooms = {name: room for name, room in self.rooms.items() if name != "cycles"}
        total = start + count * (steps - start)
        return replace(self, steps=total, t_end=self.t_end * total / steps, between={},
                       amplitudes=amplitudes, rooms=rooms)


def read_manifest(directory: Path, scene: str | None = None) -> Manifest:
    """Read and check ``manifest.json``.

    `scene`, if given, is the digest that the scene's text has now. Raises InputError when it is
    missing, spoiled, of another text, not JSON, incomplete or not finite.
    """
    path = Path(directory) / "manifest.json"
    if not path.exists():
        raise InputError(f"{path} is missing: the FreeFEM stage did not finish; "
                         "run the scene again")
    seal = seals.read(path.parent, scene)
    content = seals.check(seal, path)[:]
    try:
        manifest = _manifest(path, content, seal)
        blocks = len(seal.files.keys() - {path.name, seals.SHARED})
        if manifest.blocks != blocks:
            raise InputError(f"{path}: {manifest.blocks} blocks are declared, {blocks} were sealed")
    except InputError as problem:
        raise InputError(f"{problem}; run the scene again") from None
    return manifest


def announced(directory: Path) -> Manifest | None:
    """The manifest of the export that FreeFEM works at, not sealed yet; None until it is whole."""
    path = Path(directory) / "manifest.json"
    with contextlib.suppress(FileNotFoundError, InputError):
        return _manifest(path, path.read_bytes())
    return None


def _manifest(path: Path, content: bytes, seal: seals.Seal | None = None) -> Manifest:
    """What the file `path` with this `content` says. Raises InputError."""
    try:
        raw = json.loads(content)
    except (ValueError, RecursionError) as problem:
        raise InputError(f"{path} is not readable ({problem})") from None
    missing = [name for name in KINDS if not isinstance(raw, dict) or name not in raw]
    if missing:
        raise InputError(f"{path} lacks {', '.join(missing)}")
    manifest = Manifest(directory=path.parent, raw=raw, seal=seal, between=raw.get("between", {}),
                        **{name: raw[name] for name in KINDS})
    try:
        _check_manifest(manifest)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from None
    return manifest


def _is(value, kind) -> bool:
    """isinstance, but True is no number."""
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def _finite(values) -> bool:
    """Whether it is a list of finite numbers."""
    try:
        return (isinstance(values, list) and set(map(type, values)) <= {int, float}
                and all(map(math.isfinite, values)))
    except OverflowError:  # a whole number beyond what is finite in double precision
        return False


def _check_manifest(manifest: Manifest) -> None:
    for name, kind in KINDS.items():
        if not _is(getattr(manifest, name), kind):
            raise InputError(f"{name} is not of the right type")
    if min(manifest.subdomains, manifest.blocks, manifest.nodes, manifest.steps,
           manifest.bodies) <= 0:
        raise InputError("subdomains, blocks, nodes, steps and bodies must be positive whole "
                         "numbers")
    if not 0 < manifest.t_end < math.inf:
        raise InputError("t_end must be a positive number")
    if not all(_is(label, int) for label in [*manifest.labels, *manifest.regions,
                                             *manifest.contact_labels]):
        raise InputError("a label or a region is no whole number")
    for name, words in WORDS.items():
        if getattr(manifest, name) not in words:
            raise InputError(f"{name} must be one of {', '.join(words)}, "
                             f"not {getattr(manifest, name)!r}")
    _check_rooms(manifest)
    _check_histories(manifest)


def _check_rooms(manifest: Manifest) -> None:
    for name, content in manifest.rooms.items():
        if not (_is_room(name) or name == QUASISTATIC):
            raise InputError(f"{name!r} is no effect: there is no {name}.idp")
        if not isinstance(content, dict):
            raise InputError(f"the entry of {name} is not of the right type")
        labels = content.get("labels", [])
        if not (isinstance(labels, list) and all(
                all(_is(label, int) for label in (of if isinstance(of, list) else [of]))
                for of in labels)):
            raise InputError(f"the labels of {name} are not of the right type")
    for names in (manifest.columns, manifest.fields):
        if not (all(isinstance(name, str) for name in names) and len(set(names)) == len(names)):
            raise InputError("columns and fields must be different names")
    for pair in manifest.contact_pairs:
        if not (isinstance(pair, list) and len(pair) == 2 and pair[0] in manifest.contact_labels
                and pair[1] in manifest.labels):
            raise InputError(f"pair has {pair!r} where two labels of the mesh belong")


def _check_histories(manifest: Manifest) -> None:
    for number, history in manifest.amplitudes.items():
        if not _finite(history):
            raise InputError(f"amplitude {number} is not finite at every step")
        if len(history) != manifest.steps + 1:
            raise InputError(f"amplitude {number} has {len(history)} values for "
                             f"{manifest.steps} steps")
    unsound = "an amplitude between the steps is not finite or of the wrong length"
    if not isinstance(manifest.between, dict):
        raise InputError(unsound)
    for number, history in manifest.between.items():
        if number not in manifest.amplitudes:
            raise InputError(f"amplitude {number} has values between the steps alone")
        if not _finite(history) or len(history) % manifest.steps != 1 % manifest.steps:
            raise InputError(unsound)
    for pattern in manifest.patterns:
        if not isinstance(pattern, dict) or not {"kind", "given_on", "amplitude"} <= set(pattern):
            raise InputError("a load pattern lacks its kind, what it is given on, or amplitude")
        # a list, as what is spoiled may be no key of a dictionary
        if pattern["kind"] not in list(manifest.rooms) or pattern["given_on"] not in LOADS:
            raise InputError(f"{pattern['kind']!r} given on {pattern['given_on']!r} is no kind of "
                             "load pattern")
        if str(pattern["amplitude"]) not in manifest.amplitudes:
            raise InputError(f"amplitude {pattern['amplitude']} is used but not given")


def _is_room(name: str) -> bool:
    return name.isidentifier() and len(name) < 100 and (EFFECTS / f"{name}.idp").is_file()
