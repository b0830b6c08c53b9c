"""What is wrong with a mesh file over which FreeFEM's readmesh stumbles, in one line.

FreeFEM says that a file is damaged, gives a number of its mesh generator or is killed, as by a
vertex that no triangle uses. So the file is read once more here: .msh of FreeFEM's own, a list of
numbers, and .mesh, of keywords.
"""

import re
from pathlib import Path

import numpy as np

from . import grammar, run_time

STUMBLES = re.compile("Mesh IO Error|Erreur Lecture|mesh generator|missing vertices|Strange catch|"
                      "Assertion fail")
READ = re.compile(r'\breadmesh\s*\(\s*"([^"]+)"\s*\)')
FROM_GMSH = re.compile(r"call gmshBody +at +line +(\d+)")
SEGMENTATION = (-11, 139)
NEAR = 1e-9  # of the mesh's size: nearer vertices are one for FreeFEM
MOST_PAIRS = 1e8  # of vertices and triangles that are compared
KEYWORDS = {"Vertices": 3, "Edges": 3, "Triangles": 4}  # of a .mesh: numbers in a line


def fault(output: str, status: int, scene: Path, folder: Path) -> str:
    """What is wrong with a file that the scene reads, with its line, where FreeFEM has ended with
    this `output` and `status`; "" where nothing is, or something else has ended it.

    `folder`: where gmshBody leaves the mesh that it loads.
    """
    if not STUMBLES.search(output) and status not in SEGMENTATION:
        return ""
    if called := FROM_GMSH.search(output):
        wrong = judged(folder / "body-0.msh")
        where = run_time.at(scene, int(called[1]), meshed=False)
        return f"{where}: what gmshBody loads {wrong}" if wrong else ""
    for source in grammar.sources(scene):
        for number, line in enumerate(source.code, 1):
            for name in READ.findall(line):
                if wrong := judged(scene.parent / name):
                    return f"{source.path.name} line {number}: {name} {wrong}"
    return ""


def judged(path: Path) -> str:
    """What is wrong with a file, as words that go on after its name; "" if nothing is."""
    if not path.exists():
        return "is not there: paths are relative to the scene"
    if path.is_dir():
        return "is a directory"
    words = path.read_text(errors="replace").split()
    if not words:
        return "is empty"
    if words[0] == "$MeshFormat":
        return (f'is a mesh of gmsh\'s: read it by  gmshBody("{path.name}", h)  after  include '
                '"gmsh.idp"')
    if path.suffix not in (".msh", ".mesh"):
        return ""
    try:
        return _wrong(*(_keywords(words) if path.suffix == ".mesh" else _numbers(words)))
    except _Damaged as problem:
        return str(problem)


class _Damaged(Exception):
    """A file that does not hold what it should."""


def _numbers(words: list[str]) -> tuple:
    """Vertices, triangles and edges of FreeFEM's .msh."""
    counts = _table(words[:3], 3, "counts at its head")[0].astype(int)
    found, begin = [], 3
    for count, width, what in zip(counts, (3, 4, 3), ("vertices", "triangles", "edges")):
        part = words[begin : begin + count * width]
        if count < 0 or len(part) < count * width:
            raise _Damaged(f"ends before the last of its {counts[0]} vertices, {counts[1]} "
                           f"triangles and {counts[2]} edges: it is damaged")
        found.append(_table(part, width, what))
        begin += count * width
    return tuple(found)


def _keywords(words: list[str]) -> tuple:
    """Vertices, triangles and edges of a .mesh."""
    at = {word: k for k, word in enumerate(words) if word in (*KEYWORDS, "Dimension")}
    if "Dimension" in at and words[at["Dimension"] + 1 : at["Dimension"] + 2] != ["2"]:
        raise _Damaged("is a mesh in space, as gmsh writes a .mesh also of a plane: have gmsh "
                       "write a .msh, for gmshBody")
    found = {}
    for name, width in KEYWORDS.items():
        begin = at.get(name, len(words)) + 1
        count = int(_table(words[begin : begin + 1], 1, f"number of {name}").sum())
        part = words[begin + 1 : begin + 1 + count * width]
        if len(part) < count * width:
            raise _Damaged(f"ends before the last of its {count} {name}: it is damaged")
        found[name] = _table(part, width, name.lower())
    return found["Vertices"], found["Triangles"], found["Edges"]


def _table(words: list[str], width: int, what: str) -> np.ndarray:
    """Words (n width,) as numbers (n, width)."""
    try:
        return np.array(words, float).reshape(-1, width)
    except ValueError:
        raise _Damaged(f"has what is no number among its {what}: it is damaged") from None


def _wrong(vertices: np.ndarray, triangles: np.ndarray, edges: np.ndarray) -> str:
    """What is wrong with a mesh of vertices (x, y, label), triangles (a, b, c, region) and edges
    (a, b, label), numbers of vertices from 1; "" if nothing is.
    """
    if not len(vertices) or not len(triangles):
        return "has no triangles"
    xy, corners = vertices[:, :2], triangles[:, :3].astype(int) - 1
    ends = edges[:, :2].astype(int) - 1
    if not np.isfinite(xy).all():
        bad = np.flatnonzero(~np.isfinite(xy).all(axis=1))
        return f"has vertices that are no numbers ({len(bad)}, the first is number {bad[0] + 1})"
    for what, of in (("a triangle", corners), ("an edge", ends)):
        outside = np.flatnonzero(((of < 0) | (of >= len(xy))).any(axis=1))
        if len(outside):
            return (f"has {what}, number {outside[0] + 1}, of vertices that are not there: they "
                    f"are numbered from 1 to {len(xy)}")
    return (_same_places(xy) or _turned(xy, corners) or _repeated(xy, corners, edges)
            or _unused(xy, corners) or _overlaps(xy, corners))


def _first(count: int, xy: np.ndarray) -> str:
    """How many there are and where the first one is."""
    return f"({count}, the first at {_place(xy)})"


def _place(xy: np.ndarray) -> str:
    return f"({xy[0]:g}, {xy[1]:g})"


def _same_places(xy: np.ndarray) -> str:
    """Vertices that are in one place."""
    size = np.ptp(xy, axis=0).max()
    cells = np.rint((xy - xy.min(axis=0)) / (NEAR * size if size > 0 else 1.0))
    _, first, count = np.unique(cells, axis=0, return_index=True, return_counts=True)
    if (count == 1).all():
        return ""
    first = xy[first[count > 1].min()]
    return (f"has places with two vertices {_first((count > 1).sum(), first)}: make them one, or "
            "give what touches there, as at a crack, as bodies of their own, by addBody(...), tied "
            "where they hang together")


def _turned(xy: np.ndarray, corners: np.ndarray) -> str:
    """Triangles that are flat or run clockwise."""
    a, b, c = (xy[corners[:, k]] for k in range(3))
    longest = np.max([((q - p) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    bad = np.flatnonzero(_doubled(a, b, c) <= 1e-8 * longest)
    if not len(bad):
        return ""
    first = xy[corners[bad[0]]].mean(axis=0)
    return (f"has triangles that are flat or run clockwise {_first(len(bad), first)}: list their "
            "vertices counterclockwise")


def _repeated(xy: np.ndarray, corners: np.ndarray, edges: np.ndarray) -> str:
    """Triangles and edges that are there twice, sides of three triangles, edges that are no sides.
    """
    _, first, count = np.unique(np.sort(corners, axis=1), axis=0, return_index=True,
                                return_counts=True)
    if (count > 1).any():
        place = _place(xy[corners[first[count > 1].min()]].mean(axis=0))
        return f"has a triangle twice, at {place}: take one out"
    sides = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1) @ [len(xy), 1]
    known, count = np.unique(sides, return_counts=True)
    if (count > 2).any():
        return (f"has a side of {count.max()} triangles, at {_middle(xy, known[count.argmax()])}: "
                "triangles overlap there")
    ends = np.sort(edges[:, :2].astype(int) - 1, axis=1) @ [len(xy), 1]
    given, count = np.unique(ends, return_counts=True)
    if (count > 1).any():
        twice = given[count.argmax()]
        labels = " and ".join(f"{label:g}" for label in edges[ends == twice, 2])
        return (f"has an edge twice, at {_middle(xy, twice)}, with the labels {labels}: take one "
                "out")
    if len(loose := np.setdiff1d(ends, known)):
        return f"has an edge that is no side of a triangle, at {_middle(xy, loose[0])}: take it out"
    return ""


def _middle(xy: np.ndarray, side: int) -> str:
    """The place of a side, both of whose ends are in one number."""
    return _place(xy[list(divmod(int(side), len(xy)))].mean(axis=0))


def _unused(xy: np.ndarray, corners: np.ndarray) -> str:
    """Vertices without a triangle."""
    bad = np.setdiff1d(np.arange(len(xy)), corners)
    if not len(bad):
        return ""
    return f"has vertices that no triangle uses {_first(len(bad), xy[bad[0]])}: leave such out"


def _overlaps(xy: np.ndarray, corners: np.ndarray) -> str:
    """A vertex inside a triangle that is not its own, or on a side of it."""
    if len(xy) * len(corners) > MOST_PAIRS:
        return ""
    a, b, c = (xy[corners[:, k]] for k in range(3))
    for k, place in enumerate(xy):
        parts = np.stack([_doubled(p, q, place) for p, q in ((a, b), (b, c), (c, a))])
        least = parts.min(axis=0) / parts.sum(axis=0)
        least[(corners == k).any(axis=1)] = -1
        if least.max() > 1e-6:
            return (f"has triangles that overlap, as at {_place(place)}: bodies that touch or "
                    "overlap are given one by one, by addBody(...)")
        if least.max() > -1e-9:
            return (f"has a vertex on a side that is not its triangles', at {_place(place)}: sides "
                    "of neighbours must have the same ends; give meshes that do not match one by "
                    "one, by addBody(...), and tie them")
    return ""


def _doubled(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Twice the areas of triangles p, q, r, negative where these run clockwise."""
    u, v = q - p, r - p
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
