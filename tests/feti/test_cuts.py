"""Cuts that nobody would wish for: corners, local matrices and the coarse problem stay regular.

Bodies are cut triangle by triangle: into single triangles, separate pieces, rings, islands, chains
and parts that touch in a vertex.
"""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import Problem
from mpi4py import MPI
from scipy.linalg import subspace_angles
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from small_scenes import LEFT, TOP, Body, Scene, grown, rectangle
from test_operator import check_compliance

from driver.errors import InputError
from driver.feti import coarse
from driver.feti.corners import _farthest_points, _spread, corner_vertices
from driver.feti.dirichlet import DirichletPreconditioner
from driver.feti.operator import DualOperator
from driver.feti.rigid_parts import LeastDeformation
from driver.feti.skeleton import Skeleton
from driver.march.tearing import build

NOBODY = 77  # a label that no edge has


# ------------------------------------------------------------------------------ bodies and cuts

def block(rng):
    """A distorted block, 2 x 1, with the labels of its sides."""
    xy, triangles, outline = rectangle(9, 5)
    return _distorted(rng, xy, outline), triangles, outline


def plate(rng):
    """A distorted plate with a hole in the middle, another in a corner and one label all round."""
    xy, triangles, _ = rectangle(10, 6)
    x, y = xy[triangles].mean(axis=1).T
    hole = (abs(x - 1) < 0.4) & (abs(y - 0.5) < 1 / 6) | (abs(x - 0.3) < 0.1) & (y > 4 / 6)
    triangles = triangles[~hole]
    kept, triangles = np.unique(triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    outline = _rim(triangles)
    return _distorted(rng, xy[kept], outline), triangles, outline


def _rim(triangles):
    """(n, 3) the boundary of a mesh, with the label TOP all round."""
    once, count = np.unique(sides(triangles)[0], axis=0, return_counts=True)
    return np.column_stack([once[count == 1], np.full((count == 1).sum(), TOP)])


def _distorted(rng, xy, outline):
    """Places of vertices, those inside moved by a tenth of a cell."""
    inside = np.ones(len(xy), bool)
    inside[outline[:, :2]] = False
    xy[inside] += rng.uniform(-0.02, 0.02, (inside.sum(), 2))
    return xy


def sides(triangles):
    """(3 n, 2) sides, smaller vertex first, and the triangle of each."""
    ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return ends, np.repeat(np.arange(len(triangles)), 3)


def _ring_around_halves(c):
    """A ring of cells around two triangles in the middle, all its corners on its inner side."""
    x, y = np.abs(c - [1, 0.5]).T
    core, ring = (x < 0.12) & (y < 0.11), (x < 0.34) & (y < 0.31)
    return np.where(core, np.cumsum(core), np.where(ring, 8, 9))


def _mixed(rng, xy, triangles):
    """Pieces that have grown, every fifth triangle dealt to another one."""
    part = grown(triangles, 7, rng)
    return np.where(rng.random(len(part)) < 0.2, rng.permutation(part), part)


CUTS = {
    "single triangles": lambda rng, c, t: np.arange(len(c)),
    "dealt to 2": lambda rng, c, t: rng.integers(2, size=len(c)),
    "dealt to 5": lambda rng, c, t: rng.integers(5, size=len(c)),
    "dealt to 40": lambda rng, c, t: rng.integers(40, size=len(c)),
    "chess board": lambda rng, c, t: np.floor(4 * c).sum(axis=1) % 2,
    "fine chess board": lambda rng, c, t: np.floor(c * [4.5, 5]).sum(axis=1) % 2,
    "stripes of two": lambda rng, c, t: np.floor(5 * c[:, 0]) % 2,
    "island": lambda rng, c, t: np.linalg.norm(c - [1.4, 0.4], axis=1) < 0.25,
    "rings": lambda rng, c, t: np.floor(5 * np.linalg.norm(c - [0.9, 0.45], axis=1)),
    "half rings": lambda rng, c, t: (np.floor(5 * np.linalg.norm(c - [0.9, 0.1], axis=1))
                                     + 20 * (c[:, 0] > 0.9)),
    "ring around halves": lambda rng, c, t: _ring_around_halves(c),
    "chains": lambda rng, c, t: np.floor(10 * c[:, 1]),
    "one triangle out": lambda rng, c, t: np.arange(len(c)) == rng.integers(len(c)),
    "one at the rim out": lambda rng, c, t: np.arange(len(c)) == c[:, 0].argmax(),
    "grown": lambda rng, c, t: grown(t, 9, rng),
    "grown, then mixed": _mixed,
    "whole": lambda rng, c, t: np.zeros(len(c)),
}


def scene(shape, cut, seed, support=LEFT) -> Scene:
    """A body in a cut, held at the label `support`; what it presses with does not matter here."""
    rng = np.random.default_rng(seed)
    xy, triangles, outline = shape(rng)
    part = CUTS[cut](rng, xy[triangles].mean(axis=1), triangles)
    part = np.unique(part, return_inverse=True)[1]
    angle = rng.uniform(0, 2 * np.pi) * rng.integers(2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    body = Body(xy @ turn.T, triangles, outline, part, np.ones(len(part)), 0.3)
    return Scene(body, [{TOP: (0.0, -1.0)}], np.array([[0.0], [1.0]]), support=support,
                 contact=int(outline[0, 2]))


def torn(given: Scene) -> Problem:
    """Subdomains, structure and dual operator of a scene."""
    manifest, subdomains = given.manifest(), given.subdomains()
    structure = build(manifest, subdomains, 0, MPI.COMM_SELF)
    return Problem(manifest, subdomains, structure, DualOperator(structure, MPI.COMM_SELF))


every_cut = pytest.mark.parametrize("cut", CUTS)
every_shape = pytest.mark.parametrize("shape", [block, plate])
seeds = pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow)
                                              for k in range(1, 6))])


def components(triangles) -> np.ndarray:
    """(n,) the part of the mesh, connected by edges, that every triangle belongs to."""
    ends, triangle = sides(triangles)
    name = np.unique(ends, axis=0, return_inverse=True)[1]
    count = len(triangles)
    links = coo_matrix((np.ones(len(name)), (triangle, count + name)),
                       shape=(count + name.max() + 1,) * 2)
    return connected_components(links, directed=False)[1][:count]


# ------------------------------------------------------------------------------ corners

@every_cut
@every_shape
@seeds
@pytest.mark.some(12)
def test_components_have_corners_far_apart(cut, shape, seed):
    """Every part connected by edges has two, and any two neighbours have two in common."""
    given = scene(shape, cut, seed)
    subdomains, body = given.subdomains(), given.body
    skeleton = Skeleton(given.manifest(), subdomains, MPI.COMM_SELF)
    corners = corner_vertices(skeleton)
    owner = np.empty(len(body.triangles), int)
    for s in range(len(subdomains)):
        mine = np.flatnonzero(body.part == s)
        owner[mine] = 1000 * s + components(body.triangles[mine])
    ends, triangle = sides(body.triangles)
    held = {}
    for name in np.unique(owner):
        vertices = np.unique(body.triangles[owner == name])
        held[name] = np.intersect1d(vertices, corners)
        assert len(held[name]) >= 2
        size, extent = (np.linalg.norm(np.ptp(body.xy[v], axis=0)) for v in (vertices, held[name]))
        assert extent >= 0.25 * size
    edge = np.unique(ends, axis=0, return_inverse=True)[1]
    order = np.argsort(edge, kind="stable")
    inner = edge[order][1:] == edge[order][:-1]
    across = owner[triangle[order]]
    for one, two in zip(across[:-1][inner], across[1:][inner]):
        assert one == two or len(np.intersect1d(held[one], held[two])) >= 2


@pytest.mark.parametrize("sides, fits", [(1, False), (2, True), (3, False)])
def test_an_edge_of_an_interface_has_two_sides(sides, fits):
    """Triangles that share an edge of the label of interfaces; the other edges are outer ones."""
    skeleton = object.__new__(Skeleton)
    skeleton.comm, skeleton.interface_label = MPI.COMM_SELF, 99
    edges = np.array([[sub, *ends] for sub in range(sides)
                      for ends in ((0, 1, 99), (1, 2 + sub, 7), (2 + sub, 0, 7))])
    skeleton.edges, skeleton.own_edges = edges, np.ones(len(edges), bool)
    skeleton.shared = (edges[:, 3] == 99) & (sides > 1)
    skeleton.edge_id = np.where(edges[:, 3] == 99, 0, 1 + np.arange(len(edges)))
    skeleton.edge_count = np.bincount(skeleton.edge_id)
    skeleton.xy = np.zeros((1, 2))
    skeleton.over_subdomains = lambda extreme, xy: xy
    if fits:
        skeleton.check_conformity()
    else:
        with pytest.raises(InputError, match="an edge has no match on the other side"):
            skeleton.check_conformity()


@pytest.mark.parametrize("move", [0.0, 100.0, -100.0])
@pytest.mark.parametrize("known", [[], [2], [5, 6]])
def test_components_with_near_corners_get_the_farthest_vertices(move, known):
    """Three triangles, each a subdomain, wherever they are: the ends of the longest side, or the
    vertex that is farthest from the corner there is.
    """
    place = np.array([[0.0, 0.0], [4.0, 0.0], [2.0, 3.0]])
    places = np.vstack([place + [0.0, move], 2 * place + [move, 0.0], place + [9.0, -move]])
    gids = np.arange(9)
    edges = np.array([[sub, 3 * sub + i, 3 * sub + (i + 1) % 3]
                      for sub in range(3) for i in range(3)])
    skeleton = SimpleNamespace(gids=gids, place=places, component=np.zeros(9, int), edges=edges,
                               own_edges=np.ones(9, bool))
    added = _spread(skeleton, np.array(known, int))
    expected = {(): {0, 1, 3, 4, 6, 7}, (2,): {2, 0, 3, 4, 6, 7},
                (5, 6): {0, 1, 5, 3, 6, 7}}[tuple(known)]
    assert set(added.tolist()) == expected


def interface(place, pairs):
    """Skeleton of subdomains that meet along chains of edges: (one, other, vertices) each."""
    rows = np.array([(sub, a, b, other) for one, two, chain in pairs
                     for sub, other in ((one, two), (two, one)) for a, b in zip(chain, chain[1:])])
    return SimpleNamespace(gids=np.arange(len(place)), place=np.array(place, float), total=4,
                           edges=rows[:, :3], neighbour=rows[:, 3],
                           own_edges=np.ones(len(rows), bool))


LINE = [[0.0, 0.0], [1.0, 0.1], [2.0, 0.0], [4.0, 0.3], [5.0, 0.0], [5.0, 2.0]]


@pytest.mark.parametrize("pairs, corners, added", [
    ([(0, 1, [0, 1, 2, 3])], [], {0, 3}), ([(1, 0, [0, 1, 2, 3])], [1, 3], {0, 1}),
    ([(0, 1, [0, 1, 2, 3])], [0, 3], set()), ([(0, 1, [0, 1, 2, 3])], [0], {0, 3}),
    # pieces of other pairs stay apart, and so do those that a corner divides
    ([(0, 1, [0, 1, 2]), (0, 2, [2, 3, 4])], [2], {0, 2, 4}),
    ([(0, 1, [0, 1, 2]), (0, 1, [3, 4, 5])], [0, 2], {4, 5}),
    # one that returns to its corner hangs on it
    ([(0, 1, [0, 2, 5, 0])], [0], {0, 5})])
def test_pieces_of_interfaces_have_two_corners(pairs, corners, added):
    """The vertices that are farthest from one another, or from the corner that there is."""
    found = _farthest_points(interface(LINE, pairs), np.array(corners, int))
    assert set(found.tolist()) == added


def outline(polygons, labels=None):
    """Skeleton of one subdomain with these outlines."""
    edges, place = [], []
    for k, polygon in enumerate(polygons):
        n, first = len(polygon), len(place)
        edges += [(0, first + i, first + (i + 1) % n, labels[k] if labels else 1) for i in range(n)]
        place += list(polygon)
    skeleton = object.__new__(Skeleton)
    skeleton.comm, skeleton.edges, skeleton.place = MPI.COMM_SELF, np.array(edges), np.array(place)
    skeleton.gids, skeleton.own_edges = np.arange(len(place)), slice(0, len(edges))
    skeleton.shared = np.zeros(len(edges), bool)
    return skeleton


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize("other, crosses", [
    (SQUARE + [1.0, 0.0], False), (SQUARE + [1.0, 0.3], False),  # side by side
    (0.5 * SQUARE + [0.25, 0.25], False),  # a hole
    (SQUARE + [3.0, 0.0], False), (SQUARE + [0.9, 0.4], True), (SQUARE + [1.0 - 1e-6, 0.3], True),
    (0.2 * SQUARE + [0.9, 0.5], True)])
@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_outlines_that_cross_are_refused_where_they_do(other, crosses, turn):
    """Not where they touch, whichever way they lie; nor of the labels of pairs. At the middle of an
    edge that crosses another one.
    """
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    crossing = outline([SQUARE @ spin.T, other @ spin.T], [1, 2])
    if not crosses:
        crossing.check_overlap(np.zeros(0, int))
        return
    with pytest.raises(InputError, match="outlines cross near ") as said:
        crossing.check_overlap(np.zeros(0, int))
    place = np.array(re.search(r"\((.*), (.*)\)", str(said.value)).groups(), float)
    middles = [(edge + np.roll(edge, -1, axis=0)) / 2 for edge in (SQUARE @ spin.T, other @ spin.T)]
    # four digits and more are said
    assert np.abs(np.concatenate(middles) - place).max(axis=1).min() < 1e-5
    crossing.check_overlap(np.array([2]))
    bow = outline([SQUARE[[0, 2, 1, 3]]])
    with pytest.raises(InputError, match=r"near \(0.5, 0.5\)"):
        bow.check_overlap(np.zeros(0, int))


@every_cut
@every_shape
@seeds
@pytest.mark.some(2)
def test_local_matrices_are_positive_definite(cut, shape, seed):
    """K_rr without any support, with a condition number that the number of triangles bounds.

    Worst is a chain of n triangles held at its ends, a beam whose compliance grows with n^4; the
    elements' own condition number is below 100 here. A rigid motion or a hinge would give 1/eps.
    """
    problem = torn(scene(shape, cut, seed, support=NOBODY))
    for c in problem.operator.classes:
        if len(c.torn):
            values = np.linalg.eigvalsh(c.K.toarray()[np.ix_(c.torn, c.torn)])
            longest = np.bincount(components(problem.subdomains[c.members[0]].triangles)).max()
            assert values[0] * min(100 * longest**4, 1e6) > values[-1]


@every_cut
@every_shape
@seeds
@pytest.mark.parametrize("support", [LEFT, NOBODY])
@pytest.mark.some(2)
def test_kernel_of_the_coarse_problem_are_the_free_motions(cut, shape, seed, support):
    """No more and no less; pinning as many dofs leaves a regular matrix."""
    problem = torn(scene(shape, cut, seed, support))
    operator, motions = problem.operator, problem.structure.rigid_corners
    S = coarse._assembled(problem.structure, operator.classes, MPI.COMM_SELF).toarray()
    supported = any(len(fixed) for fixed in problem.structure.fixed)
    free = 0 if supported else 3
    assert motions.shape == (len(S), free)
    values = np.linalg.eigvalsh(S)
    # S_cc inherits the rounding of K_rr^-1; motions of chains are as soft as those of beams
    assert np.abs(values[:free]).max(initial=0) < 1e-9 * values[-1]
    assert values[free] > 1e-6 * values[-1]
    if free:
        kernel = np.linalg.eigh(S)[1][:, :free]
        assert subspace_angles(kernel, motions).max() < 1e-6
        pinned = operator.coarse._pinned(csr_matrix(S)).toarray()
        assert np.linalg.eigvalsh(pinned)[0] > 1e-7 * values[-1]


@every_cut
@every_shape
@seeds
@pytest.mark.some(2)
def test_condensed_operator_does_not_know_the_cut(cut, shape, seed):
    """Contact rows see the compliance of the assembled body, whatever it was cut into."""
    given = scene(shape, cut, seed)
    if shape is plate:  # one label all round: hold it at a contact-free part of it
        given = _held_at_a_hole(given)
    check_compliance(torn(given))


def _held_at_a_hole(given: Scene) -> Scene:
    """The same with the label NOBODY, now a support, at the edges of the middle hole."""
    outline = given.body.outline.copy()
    centre = given.body.xy[outline[:, :2]].mean(axis=1)
    near = np.linalg.norm(centre - given.body.xy[outline[:, :2]].mean(axis=(0, 1)), axis=1)
    outline[near < np.sort(near)[6], 2] = NOBODY
    given.body.outline, given.support = outline, NOBODY
    return given


@every_cut
@every_shape
@seeds
@pytest.mark.some(4)
def test_springs_and_preconditioner_need_no_stiff_corners(cut, shape, seed):
    """Bodies without support: springs of a contact row's size, a preconditioner on any face."""
    problem = torn(scene(shape, cut, seed, support=NOBODY))
    operator = problem.operator
    # ten over the stiffness of a row, which is E = 1 or less where two corners hold the whole body;
    # a corner without stiffness would give 1/eps
    rho = operator.rho / problem.structure.coarse_dofs
    assert len(rho) == 3 and np.all((rho > 1) & (rho < 1e4))
    precondition = DirichletPreconditioner(operator)
    columns = np.column_stack([precondition(e, np.ones(len(e), bool))
                               for e in np.eye(problem.structure.dual_dofs)])
    values = np.linalg.eigvalsh((columns + columns.T) / 2)
    assert np.abs(columns - columns.T).max() < 1e-9 * values[-1]
    assert values[0] > 1e-9 * values[-1]


def test_parts_that_hinge_on_a_vertex_are_refused():
    """Two squares that share a corner, in one subdomain or in two: a mechanism, said where."""
    xy, triangles, _ = rectangle(4, 2)
    x, y = xy[triangles].mean(axis=1).T
    triangles = triangles[(x < 1) == (y < 0.5)]
    for part in (np.zeros(len(triangles), int), (xy[triangles].mean(axis=1)[:, 0] > 1) * 1):
        body = Body(xy, triangles, _rim(triangles), part, np.ones(len(part)), 0.3)
        given = Scene(body, [{}], np.zeros((2, 1)), contact=TOP)
        with pytest.raises(InputError, match=r"only the vertex at \(1, 0.5\), on which they hinge"):
            build(given.manifest(), given.subdomains(), 0, MPI.COMM_SELF)


HUNG = """include "scene.idp"
units("m", "Pa");
subdomains("1");
border arc(t=pi, 2*pi) { x = cos(t); y = 1. + sin(t); label = 1; }
border top(t=0, 1) { x = 1. - 2.*t; y = 1.; label = 11; }
body = buildmesh(arc(10) + top(6));
macro young() 1. //
macro poisson() 0.2 //
macro support() on(11, u1 = 0.) //
macro load1() traction(11, 0., -1e-4) //
macro contact() 1 //
include "export.idp"
"""


def test_a_coarse_problem_that_motions_fill_is_regular(built, tmp_path):
    """Both corners on the roller, free to move up and to turn about it: S_cc is nothing but
    rounding, and so is what a corner force that these motions do not feel leaves.
    """
    path = tmp_path / "hung.edp"
    path.write_text(HUNG)
    op = built(scene=path).operator
    assert op.coarse.dofs == op.modes == 2
    assert np.abs(op.coarse.solve(np.ones(2))).max() <= 10 * op.rho.max()


@pytest.mark.parametrize("cut", ["3", "5"])
def test_a_shared_coarse_problem_is_the_whole_one(built, tmp_path, monkeypatch, cut):
    """Bodies on springs as well: solutions, and the inverse at corners of pieces with contact."""
    path = tmp_path / "hung.edp"
    path.write_text(HUNG.replace('subdomains("1")', f'subdomains("{cut}")'))
    problem = built(scene=path)
    op, structure = problem.operator, problem.structure
    assert op.modes == 2
    monkeypatch.setattr(coarse, "LARGE", 0)
    shared = coarse.CoarseProblem(structure, op.classes, MPI.COMM_SELF)
    shared.rho = op.coarse.rho
    forces = np.random.default_rng(1).standard_normal(len(op.coarse.numbers))
    expected = op.coarse.solve(forces)
    np.testing.assert_allclose(shared.solve(forces), expected, atol=1e-9 * np.abs(expected).max())
    near = [s for s, rows in enumerate(structure.rows)
            if structure.at_contact.has(rows.row).any()]
    corners = np.unique(np.concatenate([structure.corner_global[s] for s in near]))
    inverse = op.coarse.inverse(corners)
    np.testing.assert_allclose(shared.inverse(corners), inverse, atol=1e-9 * np.abs(inverse).max())


def test_rigid_motions_of_corners_are_no_deformation(built, tmp_path):
    """Shifts and turns that supports leave have none; others at most what they deform by."""
    path = tmp_path / "hung.edp"
    path.write_text(HUNG.replace('subdomains("1")', 'subdomains("5")').replace(
        "macro support() on(11, u1 = 0.) //\n", ""))
    problem = built(scene=path)
    op, structure = problem.operator, problem.structure
    least = LeastDeformation(structure, op.classes, MPI.COMM_SELF)
    order = [s for c in op.classes for s in c.members]
    dofs = [structure.corner_dofs[s] for s in order]
    xy = np.concatenate([structure.subdomains[s].xy[d // 2] for s, d in zip(order, dofs)])
    up = np.concatenate(dofs) % 2 == 1
    for ax, ay, turn in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3, -2.0, 1.5)):
        u = np.where(up, ay + turn * xy[:, 0], ax - turn * xy[:, 1])
        assert least(u) <= 1e-13 * np.abs(u).max()
    stretched = np.where(up, 0.0, xy[:, 0])
    assert 0.1 < least(stretched) <= np.ptp(xy[:, 0])
    sheared = np.where(up, xy[:, 0], xy[:, 1])  # no turn in the mean
    assert least(sheared) > 0.1


@pytest.mark.parametrize("cut, ranks", [("32x16", 8),
                                        pytest.param("16x8", 2, marks=pytest.mark.slow)])
def test_ranks_repeat_less_than_a_tenth_of_their_work(built, cut, ranks):
    """With 64 subdomains each: the coarse problem, unless they share it."""
    operator = DualOperator(built(subdomains=cut, cells=10).structure, MPI.COMM_SELF)
    repeated = 0 if operator.coarse._shared else operator.coarse.work
    own = (operator.load()["work"] - repeated) / ranks
    assert repeated <= 0.1 * (own + repeated)
