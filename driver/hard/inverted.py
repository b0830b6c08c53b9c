"""Whether the mesh of a random scene is too coarse for its curved sides, by its own arcs.

A generator of outlines cannot know where FreeFEM puts vertices: one triangle of a coarse mesh may
be flatter than the arc over its side is high. Of the straight mesh and the circles of the scene
follow the middles of curved sides and det F of x = X + sum_i 4 l_p l_q d_i, with d_i the way from
the chord's middle opposite vertex i to the circle; of the solver's curves nothing is taken.
"""

import re
import tempfile
from itertools import product
from pathlib import Path

import numpy as np

NUMBER = r"(-?[\d.e+-]+)"
ARC = re.compile(rf"border \w+\(t={NUMBER}, {NUMBER}\) {{ x = {NUMBER} \+ {NUMBER}\*cos\(t\); "
                 rf"y = {NUMBER} \+")
DECLARED = re.compile(r"macro curved\(\) .* //\n")
SAID = "turn a triangle inside out"  # of the message
LEAST = 1e-3  # part of the straight triangle's det F from which a triangle counts as turned over
POINTS = 8  # along a side, at which det F is looked at
NEAR = 1e-6  # part of the radius: a vertex is on the circle


def confirmed(text: str, parameters: dict[str, str]) -> str:
    """The argument for a refusal of the scene because its sides turn a triangle over, or "".

    Exports the scene without its curved sides.
    """
    from mpi4py import MPI

    from ..scene import freefem
    from ..scene.loader import read_subdomains
    from ..scene.manifest import read_manifest

    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "straight.edp"
        script.write_text(DECLARED.sub("", text))
        freefem.export(script, Path(folder) / "mesh", parameters)
        manifest = read_manifest(Path(folder) / "mesh")
        subdomains = read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)
    least = least_jacobian(subdomains, circles(text))
    return f"det F of the scene's own arcs falls to {least:.2g}" if least < LEAST else ""


def circles(text: str) -> np.ndarray:
    """(arcs, 5) first and last angle, centre and radius of the scene's arcs."""
    found = [tuple(map(float, arc)) for arc in ARC.findall(text)]
    return np.array([(a, b, x, y, r) for a, b, x, r, y in found]).reshape(-1, 5)


def least_jacobian(subdomains, arcs: np.ndarray) -> float:
    """Least det F over the triangles of the straight `subdomains` whose outer sides follow arcs."""
    corners = np.concatenate([sub.node_gid[sub.triangles] for sub in subdomains])
    at = np.concatenate([sub.xy[sub.triangles] for sub in subdomains])
    sides = np.sort(corners[:, [[1, 2], [2, 0], [0, 1]]], axis=2)  # opposite the vertices
    _, place, count = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True,
                                return_counts=True)
    outer = (count[place.ravel()] == 1).reshape(-1, 3)
    ways = np.zeros((len(at), 3, 2))
    for k in range(3):
        ways[:, k] = _rise(at[:, (k + 1) % 3], at[:, (k + 2) % 3], arcs)
    ways[~outer] = 0.0
    curved = ways.any(axis=(1, 2))
    return float(_jacobians(at[curved], ways[curved]).min(initial=1.0))


def _rise(a: np.ndarray, b: np.ndarray, arcs: np.ndarray) -> np.ndarray:
    """(n, 2) ways from the middles of the chords a, b (n, 2) to the arc that they span, if any."""
    middle, way = (a + b) / 2, np.zeros(a.shape)
    for first, last, x, y, radius in arcs:
        centre = np.array([x, y])
        off = [np.abs(np.linalg.norm(end - centre, axis=1) - radius) for end in (a, b)]
        out = middle - centre
        size = np.maximum(np.linalg.norm(out, axis=1), 1e-300)
        low, high = min(first, last), max(first, last)
        inside = (np.arctan2(out[:, 1], out[:, 0]) - low) % (2 * np.pi) <= high - low
        on = (np.maximum(*off) <= NEAR * radius) & inside
        way[on] = (out * (radius / size - 1)[:, None])[on]
    return way


def _jacobians(at: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """(triangles, points) det F of triangles with corners `at` (n, 3, 2), `ways` as in _rise."""
    opposite = np.roll(at, -1, axis=1) - np.roll(at, 1, axis=1)
    first, second = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
    twice = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    slope = np.stack([opposite[..., 1], -opposite[..., 0]], axis=2) / twice[:, None, None]
    found = []
    for i, j in product(range(POINTS + 1), repeat=2):
        if i + j > POINTS:
            continue
        share, F = np.array([i, j, POINTS - i - j]) / POINTS, np.tile(np.eye(2), (len(at), 1, 1))
        for k in range(3):
            p, q = (k + 1) % 3, (k + 2) % 3
            grows = 4 * (share[q] * slope[:, p] + share[p] * slope[:, q])
            F = F + ways[:, k, :, None] * grows[:, None, :]
        found.append(np.linalg.det(F))
    return np.array(found).T
