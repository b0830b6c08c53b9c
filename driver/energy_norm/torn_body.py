"""The torn body and its fields, gathered on rank 0 for estimates of the error in energy norm."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..feti.operator import DualOperator
from ..scene.elements import areas
from .edge_mesh import Mesh
from .equilibration import Chains, chains
from .recovery import Patches


class Gather:
    """Concatenates arrays of the subdomains on rank 0; collective, None on the other ranks."""

    def __init__(self, operator: DualOperator):
        self.structure, self.comm = operator.structure, operator.comm
        self.root = operator.comm.rank == 0

    def __call__(self, width: tuple, kind: type, part: Callable) -> np.ndarray | None:
        """Arrays part(s, subdomain), (n, *width), joined in the order of subdomains."""
        own = [part(s, sub) for s, sub in enumerate(self.structure.subdomains)]
        parts = self.comm.gather(np.concatenate([np.empty((0, *width), kind), *own]))
        return np.concatenate(parts) if self.root else None

    def displacements(self, fields: list[np.ndarray]) -> np.ndarray | None:
        """(n, 2) of the nodes of the torn body from those (dofs,) of the rank's subdomains."""
        return self((2,), float, lambda s, sub: fields[s].reshape(-1, 2))

    def thermal(self, weights: np.ndarray, shape: tuple) -> np.ndarray | None:
        """(n_t, *shape) suppressed thermal stresses at load factors `weights` (patterns,)."""
        return self(shape, float, lambda s, sub: sum(
            (weights[k] * t for k, t in sub.thermal.items()),
            np.zeros((len(sub.triangles), *shape))))


@dataclass
class TornBody:
    """The torn body on rank 0; vertices of the untorn body are numbered without gaps."""

    gid: np.ndarray  # (vertices,) exported number of every untorn vertex
    vertex: np.ndarray  # (n_torn,) untorn vertex of every torn one
    torn: np.ndarray  # (n_t, 3) torn vertices of the triangles
    region: np.ndarray  # (n_t,)
    elasticity: np.ndarray  # (n_t, 3, 3)
    compliance: np.ndarray  # (n_t, 3, 3)
    mesh: Mesh
    constrained: np.ndarray  # (vertices, 2) components that supports constrain
    given: np.ndarray  # (half-edges, 2) tractions: of boundary edges without support, by component
    place: np.ndarray  # (n_t, 3, 2) corners or, where sides are curved, (n_t, 6, 2) with middles

    @cached_property
    def area(self) -> np.ndarray:
        """(n_t,) areas of the triangles, with their curved sides."""
        return areas(self.place)

    @cached_property
    def patches(self) -> Patches:
        """By which stresses of quadratic elements are smoothed."""
        return Patches(self.place, self.mesh.triangles, self.region)

    @cached_property
    def chains(self) -> Chains:
        """Of the bound alone, like `stiffness`."""
        return chains(self.mesh)

    @cached_property
    def stiffness(self) -> np.ndarray:
        """(vertices, 2) diagonal entries of the assembled stiffness."""
        gx, gy = self.mesh.gradient.transpose(2, 0, 1)
        columns = self.elasticity.transpose(1, 2, 0)[..., None]
        (xx, _, xz), (_, yy, yz), (_, _, zz) = columns * self.mesh.area[:, None]
        local = (xx * gx**2 + 2 * xz * gx * gy + zz * gy**2,
                 yy * gy**2 + 2 * yz * gx * gy + zz * gx**2)
        corner = self.mesh.triangles.ravel()
        return np.column_stack([np.bincount(corner, value.ravel()) for value in local])

    def strain(self, u: np.ndarray) -> np.ndarray:
        """(n_t, 3) e11, e22, 2 e12 of torn displacements (n_torn, 2)."""
        d = self.mesh.gradient.transpose(0, 2, 1) @ u[self.torn]  # d[t, j, k] = d u_k / d x_j
        return np.column_stack([d[:, 0, 0], d[:, 1, 1], d[:, 1, 0] + d[:, 0, 1]])

    def stress(self, u: np.ndarray) -> np.ndarray:
        """(n_t, 3) elastic stress of torn displacements (n_torn, 2)."""
        return np.einsum("tij,tj->ti", self.elasticity, self.strain(u))

    def untorn(self, u: np.ndarray) -> np.ndarray:
        """(vertices, 2) means of torn displacements over the subdomains that share a vertex."""
        count = np.bincount(self.vertex)
        return np.column_stack([np.bincount(self.vertex, u[:, c]) / count for c in (0, 1)])

    def norm(self, stress: np.ndarray) -> float:
        """Energy norm of constant stresses (n_t, 3)."""
        return float(np.sqrt(self.work(stress, stress).sum()))

    def work(self, stress: np.ndarray, other: np.ndarray) -> np.ndarray:
        """(n_t,) int s : C^-1 r of constant stresses (n_t, 3)."""
        return np.einsum("ti,tij,tj->t", stress, self.compliance, other) * self.mesh.area


def gather_body(gather: Gather) -> TornBody | None:
    """The torn body on rank 0; collective."""
    structure = gather.structure

    def fixed_of(s, sub):
        dofs = structure.fixed[s]
        return np.column_stack([sub.node_gid[sub.dof_node[dofs]], sub.dof_component[dofs]])

    gid = gather((), int, lambda s, sub: sub.node_gid[sub.vertices])
    size = gather((2,), int, lambda s, sub: np.array([[sub.vertices.sum(), len(sub.triangles)]]))
    triangles = gather((3,), int, lambda s, sub: (np.cumsum(sub.vertices) - 1)[sub.triangles])
    corner = place = gather((3, 2), float, lambda s, sub: sub.xy[sub.triangles])
    if gather.comm.allreduce(any(sub.curved for sub in structure.subdomains)):
        place = gather((6, 2), float, lambda s, sub: sub.xy[sub.elements[:, :6]])
    region = gather((), int, lambda s, sub: sub.region)
    size_of_law = (4, 4) if structure.contact.axisymmetric else (3, 3)
    elasticity = gather(size_of_law, float, lambda s, sub: sub.elasticity)
    fixed = gather((2,), int, fixed_of)
    if not gather.root:
        return None
    torn = triangles + np.repeat(np.cumsum(size[:, 0]) - size[:, 0], size[:, 1])[:, None]
    number, vertex = np.unique(gid, return_inverse=True)
    mesh = Mesh.of(vertex[torn], corner)
    constrained = np.zeros((len(number), 2), bool)
    fixed = fixed[np.isin(fixed[:, 0], number)]  # at the vertices
    constrained[np.searchsorted(number, fixed[:, 0]), fixed[:, 1]] = True
    return TornBody(number, vertex, torn, region, elasticity, np.linalg.inv(elasticity), mesh,
                    constrained, _given(structure.outer_edges, mesh, number, constrained), place)


def _given(outer_edges: np.ndarray, mesh: Mesh, number: np.ndarray,
           constrained: np.ndarray) -> np.ndarray:
    """Half-edges and components of given traction: the outline but for constrained labels."""
    ends = np.searchsorted(number, outer_edges[:, :2])
    label, of_label = np.unique(outer_edges[:, 2], return_inverse=True)
    both = constrained[ends].all(axis=1)
    supported = np.column_stack([np.bincount(of_label, ~both[:, c], minlength=len(label)) == 0
                                 for c in (0, 1)])
    given = np.zeros((len(mesh.edges), 2), bool)
    given[mesh.find(ends)] = ~supported[of_label]
    return np.repeat(given, 2, axis=0)
