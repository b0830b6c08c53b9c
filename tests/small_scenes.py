"""Small random bodies in contact, made here instead of by FreeFEM: mesh, partition, material,
loads, gaps, friction.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_matrix, tril

from driver.feti.operator import DualOperator
from driver.scene.subdomain import ContactData, Subdomain
from driver.scene.symmetric import Symmetric
from driver.scene.manifest import Manifest
from driver.options import Settings
from driver.march.quasistatic import QuasistaticSolver
from conftest import marched
from driver.march.tearing import build
from driver.effects import Effects

BOTTOM, RIGHT, TOP, LEFT, INTERFACE = 1, 2, 3, 4, 99


@dataclass
class Body:
    """Vertices (n_v, 2), triangles (n_t, 3), labelled outer edges (n_e, 3), subdomain of every
    triangle.
    """

    xy: np.ndarray
    triangles: np.ndarray
    outline: np.ndarray
    part: np.ndarray
    young: np.ndarray  # (n_t,)
    poisson: float


def rectangle(nx: int, ny: int, width=2.0, height=1.0):
    """Vertices, triangles and outer edges (a, b, label) of a grid; the diagonals alternate."""
    x, y = np.meshgrid(np.linspace(0, width, nx + 1), np.linspace(0, height, ny + 1))
    xy = np.column_stack([x.ravel(), y.ravel()])

    def at(i, j):
        return j * (nx + 1) + i

    triangles = []
    for j in range(ny):
        for i in range(nx):
            a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            triangles += [(a, b, c), (a, c, d)] if (i + j) % 2 else [(a, b, d), (b, c, d)]
    outline = [(at(i, 0), at(i + 1, 0), BOTTOM) for i in range(nx)]
    outline += [(at(nx, j), at(nx, j + 1), RIGHT) for j in range(ny)]
    outline += [(at(i + 1, ny), at(i, ny), TOP) for i in range(nx)]
    outline += [(at(0, j + 1), at(0, j), LEFT) for j in range(ny)]
    return xy, np.array(triangles), np.array(outline)


def grown(triangles: np.ndarray, parts: int, rng) -> np.ndarray:
    """A random partition of triangles into at most `parts` connected pieces."""
    edges = {}
    for t, corners in enumerate(triangles.tolist()):
        for a, b in zip(corners, corners[1:] + corners[:1]):
            edges.setdefault((min(a, b), max(a, b)), []).append(t)
    neighbours = [[] for _ in triangles]
    for pair in edges.values():
        if len(pair) == 2:
            neighbours[pair[0]].append(pair[1])
            neighbours[pair[1]].append(pair[0])
    part = np.full(len(triangles), -1)
    seeds = rng.choice(len(triangles), min(parts, len(triangles)), replace=False)
    part[seeds] = np.arange(len(seeds))
    front = list(seeds)
    while front:
        t = front.pop(int(rng.integers(len(front))))
        for other in neighbours[t]:
            if part[other] < 0:
                part[other] = part[t]
                front.append(other)
    return part


def _stiffness(xy, triangles, lam, mu):
    """Coordinate form, sorted, of the P1 stiffness of plane strain, dofs 2 vertex + component."""
    rows, columns, values = [], [], []
    for corners, l, m in zip(triangles, lam, mu):
        p = xy[corners]
        J = np.column_stack([p[1] - p[0], p[2] - p[0]])
        grad = np.vstack([[-1.0, -1.0], np.eye(2)]) @ np.linalg.inv(J)
        B = np.zeros((3, 6))
        B[0, 0::2], B[1, 1::2] = grad[:, 0], grad[:, 1]
        B[2, 0::2], B[2, 1::2] = grad[:, 1], grad[:, 0]
        D = np.array([[l + 2 * m, l, 0], [l, l + 2 * m, 0], [0, 0, m]])
        k = 0.5 * np.linalg.det(J) * B.T @ D @ B
        dof = np.column_stack([2 * corners, 2 * corners + 1]).ravel()
        rows.append(np.repeat(dof, 6))
        columns.append(np.tile(dof, 6))
        values.append(((k + k.T) / 2).ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    K = coo_matrix(entries, 2 * (2 * len(xy),)).tocsr().tocoo()
    return K.row, K.col, K.data


def halved(K) -> Symmetric:
    """A symmetric matrix, dense or sparse, as subdomains keep theirs."""
    lower = tril(K).tocsr().tocoo()
    return Symmetric.of_lower(lower.row, lower.col, lower.data, K.shape[0])


def rooms_of(effects: dict) -> dict:
    """The rooms of a manifest with these effects."""
    by_friction = {"none": [], "tresca": ["tresca"], "coulomb": ["friction"],
                   "coulomb-slip-dependent": ["friction", "slip_law"]}
    names = [*{"none": [], "unilateral": ["contact", "gap"],
               "bilateral": ["contact", "bilateral", "gap"]}[effects["contact"]],
             *by_friction[effects["friction"]]]
    if effects["time"] == "quasistatic":
        names.append("quasistatic")
    if "initial" in effects:
        names.append("preload")
    return {name: {} for name in names}


@dataclass
class Scene:
    """A body with everything that acts on it; `tractions` one dict label -> (2,) force density per
    pattern.
    """

    body: Body
    tractions: list
    amplitudes: np.ndarray  # (steps + 1, patterns)
    support: int = LEFT
    contact: int = BOTTOM
    gap: np.ndarray | float = 0.0  # by vertex
    friction: np.ndarray | float = 0.3
    effects: dict | None = None
    slip_law: dict | None = None  # as in the manifest

    def manifest(self) -> Manifest:
        steps, patterns = len(self.amplitudes) - 1, self.amplitudes.shape[1]
        effects = {"contact": "unilateral", "friction": "coulomb", "time": "quasistatic",
                   **(self.effects or {})}
        return Manifest(
            directory=Path("."), subdomains=int(self.body.part.max()) + 1, blocks=1,
            nodes=len(self.body.xy),
            interface_label=INTERFACE, element="P1", plane="strain", material="isotropic", units={},
            rooms=rooms_of(effects) | ({"slip_law": self.slip_law} if self.slip_law else {})
            | {"traction": {}},
            columns=self._columns(), fields=[], materials=[],
            steps=steps, t_end=1.0, bodies=1, contact_labels=[self.contact],
            labels=[BOTTOM, RIGHT, TOP, LEFT], regions=[0, 0],
            patterns=[{"kind": "traction", "given_on": "edges", "amplitude": k}
                      for k in range(patterns)],
            amplitudes={str(k): self.amplitudes[:, k].tolist() for k in range(patterns)},
            parameters={})

    def _columns(self) -> list[str]:
        effects = self.effects or {}
        names = ["gap", "tresca" if effects.get("friction") == "tresca" else "friction"]
        return names + (["bilateral"] if effects.get("contact") == "bilateral" else [])

    def subdomains(self) -> list[Subdomain]:
        return [self._subdomain(s) for s in range(int(self.body.part.max()) + 1)]

    def _subdomain(self, number: int) -> Subdomain:
        body, mine = self.body, self.body.part == number
        gid = np.unique(body.triangles[mine])
        local = np.full(len(body.xy), -1)
        local[gid] = np.arange(len(gid))
        triangles, xy = local[body.triangles[mine]], body.xy[gid]
        lam = body.young[mine] * body.poisson / ((1 + body.poisson) * (1 - 2 * body.poisson))
        mu = body.young[mine] / (2 * (1 + body.poisson))
        sides = {tuple(sorted(pair)) for t in triangles.tolist() for pair in zip(t, t[1:] + t[:1])}
        outer = [(local[a], local[b], label) for a, b, label in body.outline.tolist()
                 if tuple(sorted((local[a], local[b]))) in sides]
        seen = {tuple(sorted(edge[:2])) for edge in outer}
        once, count = np.unique([sorted(pair) for t in triangles.tolist()
                                 for pair in zip(t, t[1:] + t[:1])], axis=0,
                                return_counts=True)
        inner = [(*pair, INTERFACE) for pair in once[count == 1].tolist()
                 if tuple(pair) not in seen]
        edges = np.array([*outer, *inner], int).reshape(-1, 3)
        loads = np.zeros((len(self.tractions), 2 * len(gid)))
        for load, traction in zip(loads, self.tractions):
            for a, b, label in outer:
                force = 0.5 * np.linalg.norm(xy[b] - xy[a]) * np.asarray(traction.get(label,
                                                                                      (0.0, 0.0)))
                for v in (a, b):
                    load[2 * v : 2 * v + 2] += force
        held = np.unique(body.outline[body.outline[:, 2] == self.support, :2])
        vertices = local[held[np.isin(held, gid)]]
        fixed = np.sort(np.concatenate([2 * vertices, 2 * vertices + 1]))
        elasticity = (lam[:, None, None] * np.array([[1.0, 1, 0], [1, 1, 0], [0, 0, 0]])
                      + mu[:, None, None] * np.diag([2.0, 2, 1]))
        return Subdomain(
            index=number, node_gid=gid, xy=xy, elements=triangles,
            region=np.zeros(len(triangles), int),
            edges=edges[:, :2], edge_label=edges[:, 2], elasticity=elasticity, thermal={},
            sigma_zz=lam,
            stiffness=Symmetric.of_lower(*_stiffness(xy, triangles, lam, mu), 2 * len(gid)),
            loads=loads, edge_loads={}, body_loads={}, fixed=fixed,
            fixed_values=np.zeros((len(self.tractions), len(fixed))),
            contact=self._contact_data(outer, xy, gid))

    def _contact_data(self, outer, xy, gid) -> ContactData | None:
        weight, normal = {}, {}
        for a, b, label in outer:
            if label == self.contact:
                along = xy[b] - xy[a]
                for v in (a, b):
                    weight[v] = weight.get(v, 0.0) + 0.5 * np.linalg.norm(along)
                    normal[v] = normal.get(v, 0.0) + np.array([along[1], -along[0]])
        if not weight:
            return None
        vertex = np.array(sorted(weight))

        def spread(value):
            return np.broadcast_to(value, len(self.body.xy)).astype(float)[gid[vertex]]

        n = np.array([normal[v] / np.linalg.norm(normal[v]) for v in vertex])
        return ContactData(vertex, np.full(len(vertex), self.contact),
                           np.array([weight[v] for v in vertex]), n,
                           dict(zip(self._columns(), map(spread, (self.gap, self.friction, 1.0)))))


@dataclass
class Solved:
    """A scene's solver after its steps; contact arrays are in the order of `structure.contact`."""

    solver: QuasistaticSolver
    steps: list
    structure: object
    subdomains: list
    manifest: Manifest


def solve(scene: Scene, comm=MPI.COMM_SELF, **settings) -> Solved:
    """Run all steps of the scene."""
    manifest, subdomains = scene.manifest(), scene.subdomains()
    structure = build(manifest, subdomains, 0, comm)
    times = np.linspace(0, 1, manifest.steps + 1)
    solver = QuasistaticSolver(DualOperator(structure, comm), Effects(manifest), scene.amplitudes,
                               times,
                               Settings(**settings))
    return Solved(solver, marched(solver), structure, subdomains, manifest)


def random_scene(rng, friction: float, nx=None, ny=None, parts=None, steps=None) -> Scene:
    """A distorted block of 2..12 x 1..5 cells in up to 8 pieces, two load patterns that come and
    go.
    """
    nx = int(rng.integers(2, 13)) if nx is None else nx
    ny = int(rng.integers(1, 6)) if ny is None else ny
    xy, triangles, outline = rectangle(nx, ny, rng.uniform(0.5, 4.0))
    size = np.array([xy[:, 0].max() / nx, 1 / ny])
    inside = np.ones(len(xy), bool)
    inside[outline[:, :2].ravel()] = False
    xy[inside] += rng.uniform(-0.2, 0.2, (inside.sum(), 2)) * size
    xy[:, 1] += 0.1 * rng.random() * np.sin(xy[:, 0])  # a curved bottom, so that normals turn
    angle = rng.choice([0.0, rng.uniform(0, 2 * np.pi)])
    xy = xy @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).T
    part = grown(triangles, int(rng.integers(1, 9)) if parts is None else parts, rng)
    scale = 10.0 ** rng.choice([-9, 0, 0, 9])
    young = scale * np.choose(rng.integers(3), [np.ones(len(triangles)),
                                                10.0 ** rng.uniform(-2, 2, part.max() + 1)[part],
                                                10.0 ** rng.uniform(-1, 1, len(triangles))])
    body = Body(xy, triangles, outline, part, young, rng.choice([0.0, 0.277, 0.45]))
    down = np.array([np.sin(angle), -np.cos(angle)])
    size = 1e-3 * scale * 10.0 ** rng.uniform(-2, 1)
    tractions = [{TOP: size * (down + 0.3 * rng.standard_normal(2))},
                 {RIGHT: size * rng.standard_normal(2), TOP: 0.3 * size * rng.standard_normal(2)}]
    steps = int(rng.integers(1, 5)) if steps is None else steps
    amplitudes = np.vstack([np.zeros(2), rng.uniform(-0.3, 1.0, (steps, 2))])
    if rng.random() < 0.3:
        amplitudes[rng.integers(1, steps + 1)] = 0.0  # the load goes away
    where = rng.random(len(xy))
    gap = np.choose(rng.integers(3), [0.0, 1e-3, -1e-4]) * where * 10.0 ** rng.uniform(-1, 1)
    coefficient = friction * np.choose(rng.integers(3), [np.ones(len(xy)), where, np.round(where)])
    return Scene(body, tractions, amplitudes, gap=gap, friction=coefficient)
