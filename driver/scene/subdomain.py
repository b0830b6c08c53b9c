"""Data of one torn subdomain, as an export holds it."""

from dataclasses import dataclass, field

import numpy as np

from .symmetric import Symmetric


@dataclass
class ContactData:
    """Contact nodes of one subdomain, one entry per node and contact label.

    All arrays have length n_c. `columns` are those that declared effects give their nodes, means
    over the dual segments. Weights are integrals of the nodes' shape functions over the boundary of
    this subdomain: of an edge its ends get 1/2 each or, with quadratic elements, 1/6 each and its
    middle 4/6.
    """

    node: np.ndarray
    label: np.ndarray
    weight: np.ndarray
    normal: np.ndarray  # (n_c, 2), outward, length 1 on straight parts
    columns: dict[str, np.ndarray] = field(default_factory=dict)

    def column(self, name: str) -> np.ndarray:
        """(n_c,) numbers of a column, zero where no effect has declared it."""
        return self.columns[name] if name in self.columns else np.zeros(len(self.weight))


@dataclass
class Subdomain:
    """One torn subdomain as exported.

    Its n_v nodes are the vertices of the mesh and, with quadratic elements, the middles of the
    edges, straight if not `curved`, and, with P2-mixed, the centroids. Dofs 2 k and 2 k + 1 are the
    displacements of node k. Of `thermal`, `edge_loads` and `body_loads` the keys are the patterns
    that are given as initial stress, on edges and on triangles.
    """

    index: int
    node_gid: np.ndarray  # (n_v,) node numbers in the untorn body
    xy: np.ndarray  # (n_v, 2)
    elements: np.ndarray  # (n_t, 3), (n_t, 6) or (n_t, 7) nodes as in elements.py
    region: np.ndarray  # (n_t,)
    edges: np.ndarray  # (n_e, 2) vertices of the boundary edges
    edge_label: np.ndarray  # (n_e,)
    # (n_t, 3, 3) plane Hooke's law in Voigt form, means over the triangles; of bodies of revolution
    # (n_t, 4, 4), with the hoop's strain and stress last: so in all that follows
    elasticity: np.ndarray
    # (n_t, 3), or (n_t, 3 corners, 3) of quadratic elements: stress of a suppressed strain
    thermal: dict[int, np.ndarray]
    # (n_t,) factor of (e11 + e22) in the out-of-plane stress; None where that is zero, or has a row
    # of its own in Hooke's law
    sigma_zz: np.ndarray | None
    stiffness: Symmetric  # pure Neumann, with that of `springs`
    loads: np.ndarray  # (patterns, dofs)
    edge_loads: dict[int, np.ndarray]  # (n_e, 2, 2) moments [end, component] against the hats
    body_loads: dict[int, np.ndarray]  # (n_t, 3, 2) moments [vertex, component] likewise
    fixed: np.ndarray  # (n_fixed,) Dirichlet dofs
    fixed_values: np.ndarray  # (patterns, n_fixed); zero for patterns that move no support
    contact: ContactData | None = None
    # (n_t, 3 corners, 3, 3) Hooke's law at the corners of quadratic elements
    corner_elasticity: np.ndarray | None = None
    # (n_v,) what declared effects give all nodes
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    # (n_v, 3) stiffness xx, xy, yy of the nodes' springs, also in `stiffness`; None without any
    springs: np.ndarray | None = None
    curved: bool = False  # middles of some sides are off the chord
    cut_alike: bool = False  # a piece of a rectangle whose mesh and stiffness others have, too
    # (n,) nodes, ascending, on the interface, at contact and on boundaries that are joined, and
    # where labels meet: what rows act on, and corners, are mostly among them; none where cut alike
    rim: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    # of patterns on edges the sum of sizes by which nodal forces change with the quadrature
    unseen: dict[int, float] = field(default_factory=dict)

    @property
    def dofs(self) -> int:
        """Number of dofs."""
        return 2 * len(self.xy)

    @property
    def dof_node(self) -> np.ndarray:
        """(dofs,) node of every dof."""
        return np.arange(self.dofs) // 2

    @property
    def dof_component(self) -> np.ndarray:
        """(dofs,) displacement component of every dof."""
        return np.arange(self.dofs) % 2

    @property
    def axisymmetric(self) -> bool:
        """Whether x is a radius, and strains have a hoop's part."""
        return self.elasticity.shape[-1] == 4

    @property
    def triangles(self) -> np.ndarray:
        """(n_t, 3) vertices of the triangles."""
        return self.elements[:, :3]

    @property
    def corner(self) -> np.ndarray:
        """(n_t, 3, 2) vertices of the triangles or, with curved sides, (n_t, 6, 2) with middles."""
        return self.xy[self.elements[:, :6] if self.curved else self.triangles]

    @property
    def vertices(self) -> np.ndarray:
        """(n_v,) whether a node is a vertex of the mesh."""
        is_vertex = np.ones(len(self.xy), bool)
        is_vertex[self.elements[:, 3:]] = False
        return is_vertex

    def middles(self, edges: np.ndarray) -> np.ndarray:
        """(n,) nodes in the middle of edges given by their vertices (n, 2).

        There are none with linear elements.
        """
        if self.elements.shape[1] == 3:
            return np.empty(0, np.int64)
        span = len(self.xy)
        sides = np.sort(self.triangles[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2), axis=1) @ [span, 1]
        keys, first = np.unique(sides, return_index=True)
        side = first[np.searchsorted(keys, np.sort(edges, axis=1) @ [span, 1])]
        return self.elements[:, 3:6].ravel()[side]
