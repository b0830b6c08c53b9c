"""Where magnified displacements would draw bodies through one another or through obstacles.

A point a little inside the outline of a body lies in another one, or in another part of the same
one, if the outlines of all bodies wind around it twice.
"""

import numpy as np
from scipy.spatial import cKDTree

from .obstacle import surfaces
from .outline import outer, right_of
from .reading import Mesh, Run

SLIGHT = 0.002  # of the size: bodies may run so far through each other beside the contact
TRUE = 1e-4  # of the size: what is deeper without being magnified does penetrate
BESIDE = 2.0  # times what is allowed at the contact: how far along an outline it is allowed
BEHIND = 0.1  # of the size: the thickness of obstacles, of which the surface alone is known
NEAREST = 4  # sides of an obstacle, of which one is nearest to a point
MOST = 1000  # points that are tried
STEPS = (1, 2, 3, 5)  # leading digits of magnifications


def without_crossing(run: Run, mesh: Mesh, times: float, size: float, overlap: float) -> float:
    """The largest round magnification up to `times` at which nothing crosses that does not cross
    to scale.

    At the contact bodies may run `overlap` times the `size` through each other.
    """
    if not run.boundary or times <= 1:
        return times
    outline = _Outline(run, mesh, size, overlap)
    truly = outline.crossing(0.0, TRUE * size) | outline.crossing(1.0, TRUE * size)
    while times > 1 and (outline.crossing(times, outline.allowed) & ~truly).any():
        times = _below(times)
    return times


def _below(times: float) -> float:
    """The next round magnification below one, at least 1."""
    power = 10.0 ** np.floor(np.log10(times))
    return float(max(step * power for step in (*STEPS, 0.5, 0.1) if step * power < times))


class _Outline:
    """The outline of all bodies, its points that are tried and how deep each may lie."""

    def __init__(self, run: Run, mesh: Mesh, size: float, overlap: float):
        self.run, self.mesh, self.size = run, mesh, size
        edges, inside = mesh.rim()
        own = outer(mesh, run.boundary)
        self.edges = self._turned(edges[own], inside[own])
        self.tried = np.arange(0, len(self.edges), -(-len(self.edges) // MOST))
        role = run.boundary["role"]
        at = (role == "contact") | (role == "pair")
        contact = np.concatenate([np.column_stack([run.boundary[x][at], run.boundary[y][at]])
                                  for x, y in (("x0", "y0"), ("x1", "y1"))])
        middle = mesh.xy[self.edges[self.tried]].mean(axis=1)
        away = cKDTree(contact).query(middle)[0] if len(contact) else np.full(len(middle), np.inf)
        near = away < BESIDE * overlap * size + np.linalg.norm(
            np.subtract(*mesh.xy[self.edges[self.tried]].transpose(1, 0, 2)), axis=1)
        self.allowed = size * np.where(near, max(overlap, SLIGHT), SLIGHT)

    def _turned(self, edges: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Edges with the body on their left."""
        start, end = self.mesh.xy[edges].transpose(1, 0, 2)
        wrong = ((self.mesh.xy[inside] - start) * right_of(start, end)).sum(axis=1) > 0
        return np.where(wrong[:, None], edges[:, ::-1], edges)

    def crossing(self, times: float, depth) -> np.ndarray:
        """(t,) which points lie deeper in something than `depth` if displacements are magnified."""
        moved = self.mesh.xy + times * self.mesh.displacement
        start, end = moved[self.edges].transpose(1, 0, 2)
        middle = ((start + end) / 2)[self.tried]
        deep = np.broadcast_to(depth, len(middle))
        inward = middle - deep[:, None] * right_of(start, end)[self.tried]
        hit = windings(inward, start, end) > 1
        for first, last, out in surfaces(self.run, self.mesh.time, self.size, times):
            hit |= _behind(middle, first, last, out, deep, BEHIND * self.size)
        return hit


def windings(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n,) how often closed outlines of directed edges go around points (n, 2) to the left."""
    (x0, y0), (x1, y1) = start.T, end.T
    count = np.zeros(len(points), int)
    for k, (x, y) in enumerate(points):
        crossed = np.flatnonzero((y0 > y) != (y1 > y))
        a, b = y0[crossed], y1[crossed]
        at = x0[crossed] + (y - a) / (b - a) * (x1[crossed] - x0[crossed])
        count[k] = np.sign(b - a)[at > x].sum()
    return count


def _behind(points: np.ndarray, start: np.ndarray, end: np.ndarray, out: np.ndarray,
            depth: np.ndarray, most: float) -> np.ndarray:
    """(n,) which points lie deeper than `depth` behind the nearest of some sides, less than `most`,
    and beside it.
    """
    near = cKDTree((start + end) / 2).query(points, k=min(NEAREST, len(start)))[1]
    near = near.reshape(len(points), -1)
    along, off = (end - start)[near], points[:, None] - start[near]
    part = (off * along).sum(axis=2) / np.maximum((along**2).sum(axis=2), 1e-300)
    away = np.linalg.norm(off - np.clip(part, 0, 1)[:, :, None] * along, axis=2)
    rows, best = np.arange(len(points)), away.argmin(axis=1)
    behind = (off * out[near]).sum(axis=2)[rows, best]
    beside = np.abs(part[rows, best] - 0.5) <= 0.5
    return beside & (behind > depth) & (behind < most)
