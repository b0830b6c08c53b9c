"""What a contact pair adds to the bound of the energy norm's error.

The problem in the continuum. Each part of the first side that faces one edge of the second
(contact/facing.py; of the displaced sides, if contact is linearized about them) is mapped onto it
affinely, x -> x*. The normal n(x) is linear between the averaged unit normals at the vertices, and
so is the gap g between the contact nodes: as multipliers are dual, the mortar's gaps are those of
this g; that polygons stand for curves is no part of the error. With the jump [v] = v(x) - v(x*),

    [v] . n <= g,   t . n <= 0,   (t . n) ([v] . n - g) = 0,   friction by t and [v],

where the tractions t on the first and -t dx/dx* on the second side are equal and opposite forces.
Slip is counted from the computed mortar jumps of the step before, linear between the contact nodes.
The argument of energy.py holds with [v] for the displacement at the contact boundary: sigma* must
be in equilibrium with t* on one and with -t* dx/dx* on the other side, v must not penetrate
anywhere, not only in the mean over the multipliers' supports. See Weiss, Wohlmuth: A posteriori
error estimator and error control for contact problems (2009), who leave both as terms of higher
order; here they are computed.

Tractions. t* is linear on the first side's edges between the computed nodal values sigma_n n +
sigma_t t, and zero where nothing is faced. On the second side it has kinks where the first has its
vertices, and on both it stops where the other side ends: only its part T that is linear on an edge,
with the same moments, goes into the equilibrated stress. The remainder r has no moments against
linear fields, and a stress in the triangle behind the edge takes it with at most the energy c int
|r|^2 (edge_remainder.py).

Displacements. On the first side v is corrected at its vertices and at the ends of the parts,
linearly in between: onto the other side where it penetrates, and where pressure or sticking makes
that worth its energy. What this adds between two vertices is linear on the triangles that lines
from the apex cut from the one behind. Where normals turn along a part, [v] . n is quadratic there,
and points move away by as much as it exceeds its chord.

On straight sides nothing else is left out. On curved ones t* may leave the cone inside an edge by
the square of the angle between the normals at its ends; like the error of the boundary's geometry
that is not in the bound. Nor are places that supports hold in penetration.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..contact.facing import segments
from ..contact.side import POINT, Side, WEIGHT, before_flanks, split
from ..vectors import turned_left
from .contact_tractions import continued, slid
from .edge_mesh import Mesh
from .edge_remainder import Fan, remainder_constant


@dataclass
class _Boundary:
    """One side of the pair on the untorn mesh; edges have the body on their left."""

    side: Side  # as it lies where contact is linearized
    vertex: np.ndarray  # (n,) untorn vertex of those of the side, at corners one of each flank
    triangle: np.ndarray  # (e,) behind each edge
    corner: np.ndarray  # (e, 3, 2) of that triangle: start and end of the edge, apex
    place: np.ndarray  # which vertices of the side the contact nodes are
    twins: np.ndarray  # (k, 2) vertices of the side that are the two of a corner

    @classmethod
    def of(cls, mesh: Mesh, ends: np.ndarray, about: np.ndarray | None,
           nodes: np.ndarray = np.zeros(0, int),
           facing: np.ndarray = np.zeros((0, 2))) -> "_Boundary":
        """Of boundary edges by vertices (e, 2); `about`: displacements (vertices, 2) or None.

        `nodes`: vertices of contact nodes, which face as `facing` says.
        """
        owner = np.empty(len(mesh.edges), int)
        owner[mesh.first // 2] = np.arange(mesh.first.size).reshape(-1, 3)
        triangle, k = np.divmod(owner[mesh.find(ends)], 3)
        corner = mesh.corner[triangle[:, None], (k[:, None] + [0, 1, 2]) % 3]
        ends = mesh.triangles[triangle[:, None], (k[:, None] + [0, 1]) % 3]
        vertex, known, edges = np.unique(ends, return_index=True, return_inverse=True)
        place = corner[:, :2].reshape(-1, 2)
        outward = -turned_left(corner[:, 1] - corner[:, 0])
        edges, copied, nodes = split(edges.reshape(-1, 2), outward,
                                     np.searchsorted(vertex, nodes), facing)
        twins = np.column_stack([copied, len(vertex) + np.arange(len(copied))])
        vertex, place = np.append(vertex, vertex[copied]), place[np.append(known, known[copied])]
        now = place if about is None else place + about[vertex]
        along = now[edges[:, 1]] - now[edges[:, 0]]
        normal = -turned_left(along) / np.linalg.norm(along, axis=1)[:, None]
        length = np.linalg.norm(corner[:, 1] - corner[:, 0], axis=1)
        return cls(Side(now, edges, normal, length=length), vertex, triangle, corner, nodes, twins)

    def at(self, values: np.ndarray, edge: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Nodal values, linear in between, at places (m, k) of edges (m,): (m, k, ...)."""
        a, b = values[self.side.edges[edge]].swapaxes(0, 1)[:, :, None]
        place = place.reshape(place.shape + (1,) * (values.ndim - 1))
        return (1.0 - place) * a + place * b


@dataclass
class Lift:
    """A pair's correction of displacements: at the vertices (vertices, 2), and in between."""

    vertex: np.ndarray
    bumps: np.ndarray  # (n_t,) energy norm on every triangle
    jump: np.ndarray  # (m, 2, 2) corrected jumps at the ends of the parts
    gap: float  # int -t*_n (gap - [v]_n) + s |slip| + t*_t slip


class PairBound:
    """Tractions t* and admissible displacements of one contact pair in one step; on rank 0."""

    def __init__(self, mesh: Mesh, first: np.ndarray, second: np.ndarray, nodes: dict,
                 able: np.ndarray, frictional: bool, bilateral: bool,
                 about: np.ndarray | None = None, reach: float | None = None):
        """`first`, `second` (e, 2): vertices of the boundary edges of both sides.

        `nodes`: arrays over the pair's contact nodes: vertex, weight, own_normal, own_tangential
        (whether it has such a row), normal, gap, pressure, shear, bound, before (tangential jump at
        the end of the step before). `able` (e, o): which edges are to meet, no farther away than
        `reach`. `about` (vertices, 2): displacements of the linearization, or None.
        """
        self.mesh, self.frictional, self.bilateral = mesh, frictional, bilateral
        facing = nodes.pop("normal")
        self.first = _Boundary.of(mesh, first, about, nodes["vertex"], facing)
        self.second = _Boundary.of(mesh, second, about)
        if len(self.first.twins):
            able = able & before_flanks(self.first.side, self.first.twins,
                                        self.second.side.edge_normal)
        self.parts = segments(self.first.side, self.second.side, able, reach)
        self.normal = self.first.side.nodal_normals()
        self.tangent = turned_left(self.normal)
        n, edges = len(self.first.vertex), self.first.side.edges
        place = self.first.place
        # on all vertices of the side, zero where there is no contact node
        spread = {name: _spread(n, place, values) for name, values in nodes.items()}
        known = _spread(n, place, np.ones(len(place), bool))
        self.weight, self.own_normal = spread["weight"], spread["own_normal"]
        self.own_tangential = spread["own_tangential"]
        self.pressure = continued(edges, spread["pressure"], self.own_normal)
        self.bound = continued(edges, spread["bound"], self.own_normal)
        self.gap = continued(edges, spread["gap"], known)
        self.before = continued(edges, spread["before"], known)
        self.shear = np.zeros(n)
        if frictional:
            shear = continued(edges, spread["shear"], self.own_tangential)
            self.shear = np.clip(shear, -self.bound, self.bound)
        self.traction = -self.pressure[:, None] * self.normal + self.shear[:, None] * self.tangent

    # ---- tractions -------------------------------------------------------------------------------
    @cached_property
    def _loaded(self) -> list:
        """(boundary, fan, density of the tractions on its parts) of both sides."""
        p, first, second = self.parts, self.first, self.second
        density = first.at(self.traction, p.edge, p.at)
        sides = [(first, Fan.of(first.corner, p.edge, p.at), density)]
        back = p.facing[:, 0] > p.facing[:, 1]
        facing = np.where(back[:, None], p.facing[:, ::-1], p.facing)
        across = facing[:, 1] - facing[:, 0]
        shrink = self._length / (second.side.length[p.other] * np.maximum(across, 1e-300))
        density = -np.where(back[:, None, None], density[:, ::-1], density) * shrink[:, None, None]
        seen = np.flatnonzero(across > 0)
        sides.append((second, Fan.of(second.corner, p.other[seen], facing[seen]), density[seen]))
        return [(boundary, fan, fan.given(values)) for boundary, fan, values in sides]

    @cached_property
    def _length(self) -> np.ndarray:
        """(m,) of the parts of the first side."""
        return self.first.side.length[self.parts.edge] * (self.parts.at[:, 1] - self.parts.at[:, 0])

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (e, 2) of both sides' edges and moments (e, 2 ends, 2) of T with their hats."""
        ends = [boundary.vertex[boundary.side.edges] for boundary, _, _ in self._loaded]
        moments = [fan.moments(density) for _, fan, density in self._loaded]
        return np.concatenate(ends), np.concatenate(moments)

    def remainder(self, compliance: np.ndarray) -> np.ndarray:
        """(n_t,) bound of the norm of a stress that takes t* - T; `compliance` (n_t, 3, 3)."""
        bound = np.zeros(len(compliance))
        for boundary, fan, density in self._loaded:
            constant = remainder_constant(boundary.corner, compliance[boundary.triangle])
            np.add.at(bound, boundary.triangle, np.sqrt(constant * fan.remainder(density)))
        return bound

    # ---- displacements ---------------------------------------------------------------------------
    def lift(self, u: np.ndarray, stiffness: np.ndarray, constrained: np.ndarray,
             elasticity: np.ndarray) -> Lift:
        """Make displacements u (vertices, 2) admissible at the pair.

        `stiffness` (vertices, 2) diagonal of the assembled stiffness, `constrained` (vertices, 2)
        components that supports constrain, `elasticity` (n_t, 3, 3).
        """
        vertex = self.first.vertex
        jump = self._jump(u)
        free = ~constrained[vertex].any(axis=1)
        closing = move = self._closing(jump, stiffness[vertex].max(axis=1), ~constrained[vertex],
                                       free)
        for _ in range(3):  # the move times the turn of the normals changes the excess
            move = self._agreed(closing - self._excess(jump + move[self._point], free), free)
        jump += move[self._point]
        change = np.zeros_like(u)
        change[vertex] = move[: len(vertex)]
        p = self.parts
        between = move[self._point] - self.first.at(move[: len(vertex)], p.edge, p.at)
        _, fan, _ = self._loaded[0]
        energy = fan.bump_energy(fan.joined(between), elasticity[self.first.triangle])
        bumps = np.zeros(len(elasticity))
        np.add.at(bumps, self.first.triangle, np.sqrt(energy))
        return Lift(change, bumps, jump, self._duality_gap(jump))

    @cached_property
    def _point(self) -> np.ndarray:
        """(m, 2) points at the ends of the parts: the first side's vertices, then others."""
        p = self.parts
        keys = np.column_stack([np.repeat(p.edge, 2), p.at.ravel()])
        inside = (keys[:, 1] > 0) & (keys[:, 1] < 1)
        number = self.first.side.edges[p.edge[:, None], (p.at == 1).astype(int)].ravel()
        _, number[inside] = np.unique(keys[inside], axis=0, return_inverse=True)
        number[inside] += len(self.first.vertex)
        return number.reshape(-1, 2)

    @cached_property
    def _frame(self) -> tuple[np.ndarray, np.ndarray]:
        """(m, 2, 2) normals and their lengths (m, 2) at the ends of the parts, before scaling."""
        normal = self.first.at(self.normal, self.parts.edge, self.parts.at)
        return normal, np.linalg.norm(normal, axis=2)

    def _jump(self, u: np.ndarray) -> np.ndarray:
        """(m, 2, 2) jumps of displacements (vertices, 2) at the ends of the parts."""
        p = self.parts
        return (self.first.at(u[self.first.vertex], p.edge, p.at)
                - self.second.at(u[self.second.vertex], p.other, p.facing))

    def _closing(self, jump: np.ndarray, stiffness: np.ndarray, loose: np.ndarray,
                 free: np.ndarray) -> np.ndarray:
        """(points, 2) moves that end penetration, and close gap and slip where that is worth it.

        A vertex of the side closes if that costs less energy on its own `stiffness` than it saves,
        a place between two if both do. `loose` (n, 2): components that no support constrains.
        """
        p, n, point = self.parts, len(self.first.vertex), self._point
        normal, size = self._frame
        unit = normal / size[..., None]
        points = point.max(initial=n - 1) + 1
        gap, before = (self.first.at(values, p.edge, p.at) for values in (self.gap, self.before))
        distance, slip = np.full(points, np.inf), np.zeros(points)
        np.minimum.at(distance, point, (gap - (jump * normal).sum(axis=2)) / size)
        np.add.at(slip, point, (jump * turned_left(unit)).sum(axis=2) - before)
        slip /= np.maximum(np.bincount(point.ravel(), minlength=points), 1)
        direction = np.zeros((points, 2))
        direction[point] = unit
        edge = np.zeros(points, int)
        edge[point] = p.edge[:, None]
        ends = self.first.side.edges[edge[n:]]  # of the edges with places between their vertices
        seen = np.isfinite(distance)
        distance = np.where(seen, distance, 0.0)
        pressed = self.own_normal & (self.bilateral
                                     | (stiffness * distance[:n] <= self.pressure * self.weight))
        pressed = np.concatenate([pressed, (pressed | ~self.own_normal)[ends].all(axis=1)]) & seen
        move = np.where(pressed | (distance < 0), distance, 0.0)[:, None] * direction
        component = direction[:n] * loose
        square = (component**2).sum(axis=1)
        share = (move[:n] * direction[:n]).sum(axis=1) / np.maximum(square, 1e-12)
        move[:n] = np.where(square > 1e-12, share, 0.0)[:, None] * component
        lost = (self.bound + self.shear * np.sign(slip[:n])) * self.weight
        stuck = self.own_tangential & free & (stiffness * np.abs(slip[:n]) <= lost)
        between = (stuck | ~self.own_tangential)[ends].all(axis=1)
        stuck = np.concatenate([stuck, between]) & seen
        return move - (self.frictional * stuck * slip)[:, None] * turned_left(direction)

    def _agreed(self, move: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Moves (points, 2) whose vertices at corners have one move that both normals see alike."""
        twins = self.first.twins
        if len(twins):
            normal = self.normal[twins]
            both = np.linalg.solve(normal, (move[twins] * normal).sum(axis=2)[..., None])
            move = move.copy()
            move[twins] = np.where(free[twins].all(axis=1)[:, None, None], both.swapaxes(1, 2), 0.0)
        return move

    def _excess(self, jump: np.ndarray, free: np.ndarray) -> np.ndarray:
        """(points, 2) most by which a jump, quadratic on a part, exceeds its chord there."""
        normal, size = self._frame
        bend = ((jump[:, 1] - jump[:, 0]) * (normal[:, 1] - normal[:, 0])).sum(axis=1)
        more = np.maximum(-bend, 0.0) / 4
        points = self._point.max(initial=len(free) - 1) + 1
        most, direction = np.zeros(points), np.zeros((points, 2))
        np.maximum.at(most, self._point, more[:, None] / size)
        direction[self._point] = normal / size[..., None]
        most[: len(free)] *= free
        return most[:, None] * direction

    def _duality_gap(self, jump: np.ndarray) -> float:
        """The pair's duality gap for jumps (m, 2, 2) of displacements, linear on every part."""
        p, total = self.parts, 0.0
        fields = self.gap, self.before, self.bound, self.traction
        gap, before, bound, traction = (self.first.at(values, p.edge, p.at) for values in fields)
        for point, share in zip(POINT, WEIGHT):
            s = (1.0 + point) / 2
            normal = _between(self._frame[0], s)
            size = np.linalg.norm(normal, axis=1)
            normal = normal / size[:, None]
            force, moved = _between(traction, s), _between(jump, s)
            distance = _between(gap, s) / size - (moved * normal).sum(axis=1)
            distance = np.zeros(len(normal)) if self.bilateral else np.maximum(distance, 0.0)
            total += share * self._length @ (-(force * normal).sum(axis=1) * distance)
            if self.frictional:
                tangent = turned_left(normal)
                slip = (moved * tangent).sum(axis=1) - _between(before, s)
                total += share * self._length @ ((force * tangent).sum(axis=1) * slip)
        if self.frictional:
            unit = self._frame[0] / self._frame[1][..., None]
            slip = (jump * turned_left(unit)).sum(axis=2) - before
            middle = unit.sum(axis=1) / np.linalg.norm(unit.sum(axis=1), axis=1)[:, None]
            middle = (jump.mean(axis=1) * turned_left(middle)).sum(axis=1) - before.mean(axis=1)
            total += slid(self._length, bound, slip, middle - slip.mean(axis=1))
        return float(total)


def _between(ends: np.ndarray, s: float) -> np.ndarray:
    """(m, ...) values at the place s in [0, 1] of fields linear between their ends (m, 2, ...)."""
    return (1.0 - s) * ends[:, 0] + s * ends[:, 1]


def _spread(n: int, here: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n,) values at the places `here`, zero elsewhere."""
    spread = np.zeros(n, np.asarray(values).dtype)
    spread[here] = values
    return spread
