"""Geometry of boundary edges: their direction, the chains they form, points spread along them."""

import math

import numpy as np
from scipy.spatial import cKDTree

from ..vectors import turned_left
from .reading import Mesh


def right_of(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Unit normals (e, 2) on the right of directed edges."""
    along = end - start
    return -turned_left(along) / np.linalg.norm(along, axis=1, keepdims=True)


def shifted(start: np.ndarray, end: np.ndarray, away: float) -> tuple[np.ndarray, np.ndarray]:
    """Directed edges moved by `away` to their right; those that follow one another still meet."""
    out = right_of(start, end)
    first, last = out.copy(), out.copy()
    one, other = _following(start, end)
    both = out[one] + out[other]
    last[one] = first[other] = both / np.maximum(
        np.linalg.norm(both, axis=1, keepdims=True), 1e-9)
    return start + away * first, end + away * last


def _following(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (k,) of the edges that another one follows, and of these others."""
    pairs = []
    for chain in map(np.array, chains(start, end)):
        closed = np.allclose(start[chain[0]], end[chain[-1]], rtol=0, atol=1e-6 * np.ptp(start))
        pairs += zip(chain, np.append(chain[1:], chain[:closed]))
    one, other = np.array(pairs, dtype=int).reshape(-1, 2).T
    return one, other


def smoothed(start: np.ndarray, end: np.ndarray, part: np.ndarray, longest: float,
             corner: float) -> tuple[np.ndarray, np.ndarray]:
    """The edges `part` cut to at most the `longest` length, on a smooth curve through their ends.

    Its tangent at a vertex is that of the circle through it and its neighbours, but where the
    cosine between two edges is below `corner` those of the edges.
    """
    edge = end - start
    length = np.linalg.norm(edge, axis=1, keepdims=True)
    number = math.ceil(length[part].max() / longest)
    if number == 1:
        return start[part], end[part]
    along = edge / length
    first, last = along.copy(), along.copy()
    one, other = _following(start, end)
    smooth = (along[one] * along[other]).sum(axis=1) > corner
    one, other = one[smooth], other[smooth]
    both = along[one] / length[one] + along[other] / length[other]
    last[one] = first[other] = both / np.linalg.norm(both, axis=1, keepdims=True)
    s = np.linspace(0, 1, number + 1)[:, None, None]
    points = (start[part] + s**2 * (3 - 2 * s) * edge[part]
              + s * (1 - s) * length[part] * ((1 - s) * first[part] - s * last[part]))
    points = points.transpose(1, 0, 2)
    return points[:, :-1].reshape(-1, 2), points[:, 1:].reshape(-1, 2)


def outward_edges(boundary: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boundary edges as (start, end, outward normal): in boundary.csv the body is on their left.

    The mesh would not tell whose an edge is where two bodies touch.
    """
    start = np.column_stack([boundary["x0"], boundary["y0"]])
    end = np.column_stack([boundary["x1"], boundary["y1"]])
    return start, end, right_of(start, end)


def outer(mesh: Mesh, boundary: dict) -> np.ndarray:
    """Which edges of mesh.rim() lie on the boundary of a body, not between its subdomains."""
    start, end = (np.column_stack([boundary[x], boundary[y]])
                  for x, y in (("x0", "y0"), ("x1", "y1")))
    # middles of whole sides, and of the halves that a quadratic element's side is drawn as
    middles = np.concatenate([start + part * (end - start) for part in (0.25, 0.5, 0.75)])
    off, nearest = cKDTree(middles).query(mesh.xy[mesh.rim()[0]].mean(axis=1))
    return off < 0.05 * np.tile(np.linalg.norm(end - start, axis=1), 3)[nearest]


def chains(start: np.ndarray, end: np.ndarray) -> list[list[int]]:
    """Edge numbers grouped into connected chains, each in the order of its edges."""
    size = np.ptp(np.concatenate([start, end]), axis=0).max()

    def key(point):
        return tuple(np.rint(point / size * 1e7).astype(np.int64))

    following = {}
    for edge, point in enumerate(start):
        following.setdefault(key(point), []).append(edge)
    reached = {key(point) for point in end}
    heads = [e for e, point in enumerate(start) if key(point) not in reached]
    sequences, used = [], set()
    for edge in heads + list(range(len(start))):  # whatever no head leads to is a closed curve
        chain = []
        while edge is not None and edge not in used:
            used.add(edge)
            chain.append(edge)
            edge = next((e for e in following.get(key(end[edge]), []) if e not in used), None)
        if chain:
            sequences.append(chain)
    return sequences


def sample(start: np.ndarray, end: np.ndarray, spacing: float):
    """Points spread evenly over the chains of some edges, and the edge that each lies on."""
    points, owners = [], []
    for chain in chains(start, end):
        chain = np.array(chain)
        length = np.linalg.norm(end[chain] - start[chain], axis=1)
        ends = np.cumsum(length)
        number = max(1, round(ends[-1] / spacing))
        position = (np.arange(number) + 0.5) * ends[-1] / number
        place = np.searchsorted(ends, position)
        part = 1 - (ends[place] - position) / length[place]
        edge = chain[place]
        points.append(start[edge] + part[:, None] * (end[edge] - start[edge]))
        owners.append(edge)
    return np.concatenate(points), np.concatenate(owners)


def place_inside(corners: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """The middle of a body of triangles (m, 3, 2), or its place farthest from any `rim` (e, 2) if
    that is in a hole or beside the body.
    """
    middle = corners.mean(axis=(0, 1))
    around = np.roll(corners, -1, axis=1) - corners
    off = middle - corners
    side = around[..., 0] * off[..., 1] - around[..., 1] * off[..., 0]
    if ((side >= 0).all(axis=1) | (side <= 0).all(axis=1)).any():
        return middle
    centres = corners.mean(axis=1)
    return centres[cKDTree(rim).query(centres)[0].argmax()]
