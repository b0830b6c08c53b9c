"""What the contact nodes of an assembled body deform by: the scale of their displacements.

A way that is nothing to a soft part decides on the contact of a stiff one. So the displacements of
a node count by the deformation of material like its own: of all triangles at least as stiff as its
vertex's, to the power of ten, the largest displacement beyond the rigid motion of their connected
part. Computed on the untorn mesh, by least squares part by part; of the solver nothing is taken.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .oracle import Assembled

ROUNDED = 1e-6  # of an exponent: no rounding decides on which side of a power of ten a ratio is


@dataclass(frozen=True)
class Mesh:
    """Nodes (t, 3 or more) of all triangles, corners first, areas and stiffnesses (t,), places
    (nodes, 2).

    The stiffness of a triangle is the trace of Hooke's law.
    """

    nodes: np.ndarray
    area: np.ndarray
    stiffness: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, body: Assembled) -> "Mesh":
        """That of the body's subdomains, joined."""
        subs, place = body.subdomains, np.zeros((body.K.shape[0] // 2, 2))
        for sub in subs:
            place[sub.node_gid] = sub.xy
        nodes = np.concatenate([sub.node_gid[sub.elements] for sub in subs])
        stiffness = np.concatenate([np.einsum("tii->t", sub.elasticity) for sub in subs])
        a, b, c = place[nodes[:, :3]].transpose(1, 0, 2)
        one, other = b - a, c - a
        area = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / 2
        return cls(nodes, area, stiffness, place)

    def parts(self, chosen: np.ndarray) -> np.ndarray:
        """(chosen triangles,) number of the part, connected by edges, of the `chosen` (t,)."""
        corners = np.sort(self.nodes[chosen, :3], axis=1)
        edges = np.concatenate([corners[:, [0, 1]], corners[:, [0, 2]], corners[:, [1, 2]]])
        edge = np.unique(edges, axis=0, return_inverse=True)[1].ravel()
        count, triangle = len(corners), np.tile(np.arange(len(corners)), 3)
        graph = coo_matrix((np.ones(len(edge)), (triangle, count + edge)),
                           shape=(count + edge.max(initial=-1) + 1,) * 2)
        return connected_components(graph, directed=False)[1][:count]

    def deformation(self, chosen: np.ndarray, fields: np.ndarray, motions: np.ndarray) -> float:
        """Largest displacement of the `chosen` (t,) in `fields` (steps, vertices, 2) beyond the
        nearest rigid motion of their part, by least squares over area.

        Of moving along x and y, turning and swelling those that `motions` (4,) admits.
        """
        corners, largest = self.nodes[chosen, :3], 0.0
        number, area = self.parts(chosen), self.area[chosen]
        for part in np.unique(number):
            own = number == part
            vertex, weight = corners[own].ravel(), np.sqrt(np.repeat(area[own], 3) / 3)
            away = self.place[vertex] - np.average(self.place[vertex], axis=0, weights=weight**2)
            away /= np.abs(away).max()
            one, x, y = np.ones(len(away)), *away.T
            rigid = np.stack([np.stack([one, 0 * one, -y, x], axis=1),
                              np.stack([0 * one, one, x, y], axis=1)], axis=1)[:, :, motions]
            moved = fields[:, vertex].transpose(1, 2, 0)  # (corners, 2, steps)
            columns = rigid.reshape(-1, rigid.shape[2])
            twice = np.repeat(weight, 2)[:, None]
            factors = np.linalg.lstsq(twice * columns, twice * moved.reshape(len(columns), -1),
                                      rcond=None)[0]
            rest = moved - (columns @ factors).reshape(moved.shape)
            largest = max(largest, float(np.linalg.norm(rest, axis=1).max()))
        return largest


def of_nodes(body: Assembled, fields: np.ndarray,
             axisymmetric: bool = False) -> tuple[np.ndarray, float]:
    """Deformation (n_c,) of what contact nodes touch, in displacements `fields` (steps, dofs), and
    that of all bodies.

    No less than the stress of softer material makes of it: a stiff triangle in a soft body hardly
    deforms, but is pressed as its surroundings are. Where bodies meet the softer one counts.
    """
    mesh = Mesh.of(body)
    exponent = np.floor(np.log10(mesh.stiffness / mesh.stiffness.min()) + ROUNDED).astype(int)
    of_vertex = np.zeros(len(mesh.place), int)
    np.maximum.at(of_vertex, mesh.nodes, exponent[:, None])
    node, vertex, value = body.terms
    level = np.full(len(body.gid), exponent.max())
    met = value != 0
    np.minimum.at(level, node[met], of_vertex[vertex[met]])
    heated = any(stress.any() for sub in body.subdomains for stress in sub.thermal.values())
    motions = np.array([not axisymmetric, True, not axisymmetric, heated and not axisymmetric])
    fields, least = fields.reshape(len(fields), -1, 2), 0.0
    known = np.zeros(exponent.max() + 1)
    for e in range(len(known)):
        if e == 0 or (exponent == e).any() or (level == e).any():
            # a body that swells deforms; a stiff part that swells with the rest does not by that
            admitted = motions if e else motions & [True, True, True, False]
            least = max(least, mesh.deformation(exponent >= e, fields, admitted) * 10.0**e)
        known[e] = least / 10.0**e
    return known[level], float(known[0])
