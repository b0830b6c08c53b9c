"""Bound of the error in the energy norm: equilibrium of its stress, effectivity, parts, and what
breaks it.
"""

import dataclasses
import json

import meshio
import numpy as np
import pytest
from scipy.spatial import cKDTree

from driver import environment
from driver.estimates import budget, element_stress, equilibration, recovery
from driver.estimates.bound import COULOMB, EARLIER, EquilibratedBound, coupling
from driver.estimates.edge_mesh import full_tensor
from driver.estimates.edge_remainder import Fan, remainder_constant
from driver.contact import mortar
from driver.estimates.energy import EnergyEstimator
from driver.estimates.torn_body import Gather, gather_body
from driver.results.contact_state import ContactState
from driver.scene.elements import hat_gradients
from test_scenes_zones import strain as exact_zones

SCENES = environment.ROOT / "edp"


class Recorded(EquilibratedBound):
    """Keeps what went into the bound."""

    def _equilibrated(self, base, force, applied):
        self.base, self.force, self.applied = base, force, applied
        self.deviation, *rest = super()._equilibrated(base, force, applied)
        return self.deviation, *rest

    def _admissible(self, torn, contact):
        self.contact = contact
        return super()._admissible(torn, contact)

    def _lifted(self, admissible, pairs):
        self.pairs = pairs
        lift, *rest = super()._lifted(admissible, pairs)
        torn = self.body.vertex
        self.kinematic, self.lifted = (admissible + lift)[torn], lift[torn]
        return lift, *rest

    @property
    def stress(self):
        """(n_t, 3 parts, 3 nodes, 3) the statically admissible stress."""
        inner = element_stress.reference_modes(
            self.heavy)[:, : len(self.deviation)] @ self.deviation
        turned = np.einsum("ijt,njt->tni", self.deviations.map, inner.reshape(9, 3, -1))
        return turned.reshape(-1, 3, 3, 3) + self.base[:, None, None]


class Recording(EnergyEstimator):
    """Whose bound keeps what went into it."""

    bound_of = Recorded


def with_gap(problem, coarse):
    """The problem with the gaps between bodies of a contact boundary on the same polygons, linear
    between its nodes.
    """
    fine = problem.structure.contact
    value = fine.gap.copy()
    for label in np.unique(fine.label[fine.paired]):
        one, two = fine.label == label, coarse.label == label
        value[one] = np.interp(fine.arc[one], coarse.arc[two], coarse.gap[two])
    operator = problem.operator.with_contact(dataclasses.replace(fine, gap=value))
    return dataclasses.replace(problem, structure=operator.structure, operator=operator)


@pytest.fixture(scope="module")
def estimated(built, steps_of):
    """estimated(scene, settings, change, kind, gap, **parameters): problem, bound and estimate of
    the last step.

    `change`, if given, gets the last step and may spoil it before it is estimated; `gap`, if given,
    is the contact boundary of a coarser mesh, whose gaps between bodies shall be those of this one
    too, linear between its nodes.
    """
    made = {}

    def make(scene="model", settings=(), kind="equilibrated", change=None, gap=None, **parameters):
        key = (str(scene), tuple(settings), kind, change, id(gap),
               tuple(sorted(parameters.items())))
        if key not in made:
            problem = built(scene, **parameters)
            if gap is not None:
                problem = with_gap(problem, gap)
            solver, steps = steps_of(problem, **dict(settings))
            contact = ContactState(problem.operator, solver)
            estimator = Recording(problem.operator, problem.manifest, contact, kind)
            for step in steps:
                if change and step is steps[-1]:
                    change(step, solver)
                fields = problem.operator.displacements(step.multipliers, step.weights)
                estimator.consider(step, contact.evaluate(step, fields), step.index)
            estimate = dict((s.index, found) for s, found in estimator.estimates())[len(steps)]
            bound = estimator.bound or estimator
            bound.last = estimator.last
            made[key] = problem, bound, estimate
        return made[key]

    return make


# ---- equilibrium ---------------------------------------------------------------------------------

def tractions(estimator, side):
    """(n_t, 2 ends, 2) forces per parameter of the stress on side k to k + 1, from inside."""
    across = estimator.body.mesh.outward[:, side]
    full = full_tensor(estimator.stress[:, (side + 2) % 3, :2])
    return np.einsum("tnij,tj->tni", full, across)


def check_equilibrium(estimator):
    """Body force, tractions between parts, between triangles and on the boundary, to rounding of
    the largest.
    """
    mesh, stress = estimator.body.mesh, estimator.stress
    scale = np.abs(stress).max() * mesh.length.max()
    # sums of some hundred products; inverses of triangles of condition below 1e3
    slack = 1e-11 * scale
    middle = mesh.corner.mean(axis=1)
    for j in range(3):  # between the parts on both sides of the line from corner j to the middle
        line = middle - mesh.corner[:, j]
        across = np.column_stack([line[:, 1], -line[:, 0]])
        for left, right in ((1, 0), (2, 2)):
            jump = stress[:, (j + 1) % 3, left] - stress[:, (j + 2) % 3, right]
            assert np.abs(np.einsum("tij,tj->ti", full_tensor(jump), across)).max() <= slack
    force = np.zeros((len(stress), 3, 2))
    for part in range(3):
        corner = np.stack([mesh.corner[:, (part + 1) % 3], mesh.corner[:, (part + 2) % 3], middle],
                          axis=1)
        gradient = hat_gradients(corner) * (mesh.area / 3)[:, None, None]
        total = -np.einsum("tnij,tnj->ti", full_tensor(stress[:, part]), gradient)
        for k in range(3):
            force[:, k] += (1 / 9 if k == part else 4 / 9) * total
    assert np.abs(force - (0 if estimator.force is None else estimator.force)).max() <= slack
    found = np.zeros((2 * len(mesh.edges), 2))
    for k in range(3):
        end = tractions(estimator, k)
        moments = np.stack([2 * end[:, 0] + end[:, 1], end[:, 0] + 2 * end[:, 1]], axis=1) / 6
        np.add.at(found, mesh.first[:, k], moments[:, 0])
        np.add.at(found, mesh.last[:, (k + 1) % 3], moments[:, 1])
    inside = ~np.repeat(mesh.boundary, 2)
    assert np.abs(found[inside]).max() <= slack  # what one triangle takes the other gives
    given = estimator.body.given
    assert np.abs((found - estimator.applied)[given]).max() <= slack
    return found


EQUILIBRATED = [("model", dict(cells=4, steps=2, loading="nonmonotone")),
                ("cantilever", dict(cells=3, subdomains="5")),
                ("patch", dict(cells=2, angle=30, subdomains="7")),
                ("thermal", dict(cells=2, steps=2)),
                ("bracket", dict(h=8, steps=2)), ("pressfit", dict(h=6)),
                ("tutorial", dict(h=4, steps=3)),
                ("zones", dict(cells=4, steps=1)), ("hertz-bodies", dict(h=0.016)),
                ("mindlin-bodies", dict(h=0.15, steps=1))]


@pytest.mark.parametrize("scene, parameters", EQUILIBRATED)
def test_the_stress_is_in_equilibrium(estimated, scene, parameters):
    _, estimator, _ = estimated(scene, **parameters)
    found = check_equilibrium(estimator)
    assert np.abs(found[np.repeat(estimator.body.mesh.boundary, 2)]).max() > 0


@pytest.mark.parametrize("scene, parameters", EQUILIBRATED)
def test_contact_tractions_are_in_the_cone(estimated, scene, parameters):
    """At both ends, so everywhere, of each contact edge; by as much as the normals of its ends
    differ it may fail.
    """
    _, estimator, _ = estimated(scene, **parameters)
    c = estimator.contact
    moments = c.moments
    value = np.stack([4 * moments[:, 0] - 2 * moments[:, 1],
                      4 * moments[:, 1] - 2 * moments[:, 0]], axis=1)
    value /= c.length[:, None, None]
    normal = np.einsum("nei,nei->ne", value, c.normal[c.node])
    tangential = np.einsum("nei,nei->ne", value, c.tangent[c.node])
    bend = np.abs(c.normal[c.node[:, 0]] - c.normal[c.node[:, 1]]).max(initial=0)
    slack = (1e-12 + bend**2) * np.abs(value).max(initial=0)
    assert (normal <= slack).all()
    assert (np.abs(tangential) <= c.bound[c.node] + slack).all()


# ---- effectivity ---------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def split(tmp_path_factory):
    """split(scene, n): a scene whose mesh is that of `scene` with every side cut into n."""
    folder = tmp_path_factory.mktemp("split")

    def make(scene, n):
        def here(path):
            return path.read_text().replace("../meshes", str(environment.ROOT / "meshes"))

        text = here(SCENES / f"{scene}.edp")
        mesh = f"for (int k = 0; k < bodyCount; ++k) bodies[k] = trunc(bodies[k], 1, split = {n});"
        if "addBody" not in text and "addDiscs" not in text:
            mesh = f"body = trunc(body, 1, split = {n});"
        path = folder / f"{scene}-{n}.edp"
        path.write_text(text.replace('include "export.idp"', f'{mesh}\ninclude "export.idp"'))
        (folder / "two-discs.idp").write_text(here(SCENES / "lib" / "two-discs.idp"))
        return path

    return make


def reported(estimator):
    """Torn displacements as the run reports them, not made admissible."""
    step = estimator.last[1]
    return estimator.gather.displacements(
        estimator.operator.displacements(step.multipliers, step.weights))


def true_error(coarse, fine, field=None):
    """Energy norm of the difference of the displacements of two estimators on nested meshes.

    `field`: of the coarse one, by default those made admissible.
    """
    one, two = coarse.body, fine.body
    field = coarse.kinematic if field is None else field
    apart = two.strain(fine.kinematic) - one.strain(field)[around(
        one.mesh, two.mesh.corner.mean(axis=1))]
    return np.sqrt(np.einsum("ti,tij,tj,t->", apart, two.elasticity, apart, two.mesh.area))


def around(mesh, places):
    """Triangle around each place: bodies may touch and cross by the sag of their edges, so by the
    deepest inside.
    """
    _, near = cKDTree(mesh.corner.mean(axis=1)).query(places, k=min(20, len(mesh.area)))

    def cross(a, b):
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    seen = mesh.corner[near] - places[:, None, None]
    depth = np.min([cross(seen[:, :, k], seen[:, :, (k + 1) % 3]) for k in range(3)],
                   axis=0) / mesh.area[near]
    assert depth.max(axis=1).min() > 0
    return near[np.arange(len(near)), depth.argmax(axis=1)]


NESTED = [("model", dict(cells=4, steps=2, loading="nonmonotone"), 32),
          ("model-tresca", dict(cells=4, steps=1), 32),
          ("hertz", dict(h=0.006), 4), ("punch", dict(h=0.15, steps=2), 4),
          ("pressfit", dict(h=6), 4),
          ("bracket", dict(h=12, steps=2), 4), ("wedge", dict(steps=1), 4),
          ("hertz-bodies", dict(h=0.016), 4),
          ("joint", dict(h=1.6, steps=5), 4), ("mindlin-bodies", dict(h=0.3, steps=3), 3)]


@pytest.mark.parametrize("scene, parameters, finer", NESTED)
def test_effectivity_against_a_nested_mesh(estimated, split, scene, parameters, finer):
    """The overkill error is too small by the error of the fine mesh itself: the bound must exceed
    it, and not by far.
    """
    if "cells" in parameters:
        coarse, fine = estimated(scene,
                                 **parameters), estimated(scene, **{**parameters, "cells": finer})
    else:
        coarse = estimated(split(scene, 1), **parameters)
        same = coarse[0].structure.contact if coarse[0].structure.contact.paired.any() else None
        fine = estimated(split(scene, finer), gap=same, **parameters)
    # of what the run reports and of what the bound is made with
    own, error = true_error(coarse[1], fine[1], reported(coarse[1])), true_error(coarse[1], fine[1])
    bound = coarse[2].total - coarse[2].correction
    assert error <= bound <= 2 * error and own <= coarse[2].total <= 2.5 * own
    # the correction is the distance between the two
    assert own <= error + 1.01 * coarse[2].correction
    assert fine[2].total < coarse[2].total


# ---- between two bodies --------------------------------------------------------------------------

BETWEEN = [("hertz-bodies", dict(h=0.016)), ("mindlin-bodies", dict(h=0.15, steps=1)),
           ("wedge", dict(steps=1)),
           ("stack", dict(h=0.25, steps=2))]


@pytest.mark.parametrize("scene, parameters", BETWEEN)
def test_both_sides_of_a_pair_feel_the_same_tractions(estimated, scene, parameters):
    """Edge moments on the other side against a rule of many points, which needs no part of it to be
    linear.
    """
    _, estimator, found = estimated(scene, **parameters)
    for pair in estimator.pairs:
        p, n, total = pair.parts, 200, np.zeros((len(pair.second.vertex), 2))
        ds = np.linalg.norm(np.diff(pair.first.corner[p.edge, :2], axis=1)[:, 0],
                            axis=1) * np.diff(p.at, axis=1)[:, 0]
        for s in (np.arange(n) + 0.5) / n:
            force = pair.first.at(pair.traction, p.edge,
                                  p.at @ [[1 - s], [s]])[:, 0] * ds[:, None] / n
            place = p.facing @ [1 - s, s]
            for k, share in ((0, 1 - place), (1, place)):
                np.add.at(total, pair.second.side.edges[p.other, k], -share[:, None] * force)
        ends, moments = pair.moments()
        mine = len(pair.first.side.edges)
        given = np.zeros_like(total)
        np.add.at(given, np.searchsorted(pair.second.vertex, ends[mine:]), moments[mine:])
        # 1/n^2, and parts of 1e-6 of an edge
        assert np.abs(given - total).max() <= 1e-4 * np.abs(total).max()
        first = np.add.reduce(moments[:mine], axis=(0, 1))
        np.testing.assert_allclose(first, -given.sum(axis=0), rtol=0,
                                   atol=1e-9 * np.abs(first).max())
    # where contact alone holds a body, t* and the multipliers differ by a torque, which the
    # solver's part has
    assert found.solver < 0.01 * found.mesh


@pytest.mark.parametrize("scene, parameters", BETWEEN)
def test_corrected_displacements_do_not_penetrate(estimated, scene, parameters):
    """Anywhere, between the ends of the parts too, and the open places stay where they are."""
    _, estimator, _ = estimated(scene, **parameters)
    body, torn = estimator.body, estimator.body.untorn(estimator.kinematic - estimator.lifted)
    for pair in estimator.pairs:
        lift = pair.lift(torn, body.stiffness, body.constrained, body.elasticity)
        p, worst, before = pair.parts, [], []
        for s in np.linspace(0, 1, 21):
            def inside(ends):
                return (1 - s) * ends[:, 0] + s * ends[:, 1]

            normal = inside(pair.first.at(pair.normal, p.edge, p.at))
            for found, jump in ((worst, lift.jump), (before, pair._jump(torn))):
                found.append((inside(jump) * normal).sum(axis=1)
                             - inside(pair.first.at(pair.gap, p.edge, p.at)))
        size = np.abs(torn).max()
        # what moving on leaves of the excess, rounding
        assert np.max(worst) <= 1e-6 * np.max(before) + 1e-13 * size
        assert np.max(before) > 1e-7 * size


def test_the_bound_between_bodies_holds_far_from_the_solution(estimated, tmp_path):
    """As for a rigid obstacle, with tractions and slip that the mortar knows nothing of: every term
    is needed.
    """
    text = (SCENES / "patch-bodies.edp").read_text()
    split_mesh = ('for (int k = 0; k < bodyCount; ++k) '
                  'bodies[k] = trunc(bodies[k], 1, split = physical("finer", 1.));')
    for old, new in (("macro friction() 1. //", "macro tresca() 0.1 //"),
                     ("pressure(3, p)", "traction(3, 0.3*x, -x)"),
                     ('include "export.idp"', f'{split_mesh}\ninclude "export.idp"')):
        assert old in text
        text = text.replace(old, new)
    scene = tmp_path / "tresca-bodies.edp"
    scene.write_text(text)
    fine = estimated(scene, h=0.25, finer=8)[1]
    sound = estimated(scene, h=0.25)
    for change in (stir, slip_away):
        _, estimator, found = estimated(scene, h=0.25, change=change)
        error = true_error(estimator, fine)
        assert true_error(sound[1], fine) < error <= found.total
        # what corrects the displacements is far from zero here, and counts on its own
        assert found.total - found.correction <= 2 * error


def test_fields_on_a_fan_against_many_points():
    """Moments, remainder and energy of piecewise linear fields that leave a part of their sides
    out.
    """
    rng = np.random.default_rng(2)
    triangle = rng.standard_normal((2, 3, 2))
    triangle[np.linalg.det(triangle[:, 1:] - triangle[:, :1]) < 0] *= [-1, 1]
    owner, at = np.array([1, 0, 1, 0]), np.array([[0.5, 0.7], [0.0, 0.3], [0.7, 1.0], [0.3, 1.0]])
    fan = Fan.of(triangle, owner, at)
    assert fan.owner.tolist() == [0, 0, 1, 1, 1] and fan.piece.tolist() == [1, 3, -1, 0, 2]
    values = rng.standard_normal((4, 2, 2))
    density, n = fan.given(values), 20000
    s = (np.arange(n) + 0.5) / n
    for k in range(2):
        side = np.linalg.norm(triangle[k, 1] - triangle[k, 0])
        field = np.zeros((n, 2))
        for piece in np.flatnonzero(owner == k):
            x = (s - at[piece, 0]) / np.ptp(at[piece])
            (start, end), x = values[piece], x[:, None]
            field += np.where((x >= 0) & (x < 1), (1 - x) * start + x * end, 0)
        hats = np.column_stack([1 - s, s])
        np.testing.assert_allclose(fan.moments(density)[k], hats.T @ field * side / n, atol=1e-3)
        rest = field - hats @ np.linalg.lstsq(hats, field, rcond=None)[0]
        assert fan.remainder(density)[k] == pytest.approx((rest**2).sum() * side / n, rel=1e-3)
    # displacements that join: zero at the sides' ends, b at 0.3, the same from 0.5 on as at 0.5, c
    # at 0.7
    b, c, d = rng.standard_normal((3, 2))
    # C e : e = 2 e11^2 + 2 e22^2 + (2 e12)^2
    none, C = np.zeros(2), np.tile(np.diag([2.0, 2.0, 1.0]), (2, 1, 1))
    joined = fan.joined(np.array([[d, c], [none, b], [c, none], [b, none]]))
    np.testing.assert_allclose(joined[2], [none, d])
    wanted = np.zeros(2)
    for k, ends, places in ((0, [none, b, none], [0, 0.3, 1]),
                            (1, [none, d, c, none], [0, 0.5, 0.7, 1])):
        for i in range(len(places) - 1):
            points = [triangle[k, 0] + x * (triangle[k, 1] - triangle[k, 0])
                      for x in places[i : i + 2]] + [triangle[k, 2]]
            (xx, xy), (yx, yy) = np.linalg.solve(np.diff(points, axis=0),
                                                 np.diff([*ends[i : i + 2], none], axis=0))
            wanted[k] += 0.5 * np.linalg.det(np.diff(points, axis=0)) * (
                2 * xx**2 + 2 * yy**2 + (xy + yx) ** 2)
    np.testing.assert_allclose(fan.bump_energy(joined, C), wanted, rtol=1e-12)


@pytest.mark.parametrize("scene, parameters", BETWEEN[:2])
def test_the_total_between_bodies_is_that_of_its_terms(estimated, scene, parameters):
    """The duality gap by a rule of many points, the rest by the difference of the two stresses."""
    _, estimator, found = estimated(scene, **parameters)
    body, (pair,) = estimator.body, estimator.pairs
    u = body.untorn(estimator.kinematic - estimator.lifted)
    lift = pair.lift(u, body.stiffness, body.constrained, body.elasticity)
    np.testing.assert_allclose(lift.vertex[body.vertex], estimator.lifted,
                               atol=1e-12 * np.abs(u).max())
    p, n, normal_work, tangential_work = pair.parts, 400, 0.0, 0.0
    for s in (np.arange(n) + 0.5) / n:
        def inside(ends):
            return (1 - s) * ends[:, 0] + s * ends[:, 1]

        normal, traction, jump, before, bound = (inside(ends) for ends in (
            *(pair.first.at(v, p.edge, p.at) for v in (pair.normal, pair.traction)), lift.jump,
            *(pair.first.at(v, p.edge, p.at) for v in (pair.before, pair.bound))))
        size = np.linalg.norm(normal, axis=1)
        normal /= size[:, None]
        tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
        ds = pair.first.side.length[p.edge] * np.ptp(p.at, axis=1) / n
        gap = inside(pair.first.at(pair.gap, p.edge, p.at)) / size
        normal_work += ds @ ((traction * normal).sum(axis=1) * ((jump * normal).sum(axis=1) - gap))
        slip = (jump * tangent).sum(axis=1) - before
        tangential_work += ds @ (bound * np.abs(slip) + (traction * tangent).sum(axis=1) * slip)
    assert normal_work > 0 and (tangential_work > 0 or not pair.frictional)
    work = normal_work + (tangential_work if pair.frictional else 0.0)
    assert lift.gap == pytest.approx(work, rel=1e-3)
    remainder = pair.remainder(body.compliance)
    assert (lift.bumps[pair.first.triangle] > 0).sum() > 2
    assert lift.bumps.sum() == pytest.approx(lift.bumps[pair.first.triangle].sum())
    assert (remainder[pair.second.triangle] > 0).sum() > 2
    kinematic = np.einsum("tij,tj->ti", body.elasticity, body.strain(estimator.kinematic))
    apart = estimator.stress - kinematic[:, None, None]
    square = sum(recovery.energy(body.mesh.area / 3, body.compliance, apart[:, k])
                 for k in range(3))
    square = ((np.sqrt(square) + lift.bumps + remainder) ** 2).sum()
    assert found.total - found.correction == pytest.approx(
        np.sqrt(square) / 2 + np.sqrt(square / 4 + lift.gap), rel=1e-4)


def test_remainders_of_tractions_have_a_stress(rng=np.random.default_rng(5)):
    """Its energy is at least that of the displacements, which a mesh of the triangle approaches
    from below.
    """
    C = np.array([[1.35, 0.58, 0], [0.58, 1.35, 0], [0, 0, 0.38]])  # nu = 0.3, E = 1, plane strain
    triangle = np.array([[0.0, 0.0], [1.0, 0.2], [0.3, 0.9]])
    constant = remainder_constant(triangle[None], np.linalg.inv(C)[None])[0]
    n = 24
    grid = [(i, j) for j in range(n + 1) for i in range(n + 1 - j)]
    number = {ij: k for k, ij in enumerate(grid)}
    up = [[(i, j), (i + 1, j), (i, j + 1)] for i, j in grid if i + j < n]
    down = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in grid if i + j < n - 1]
    cells = np.array([[number[c] for c in t] for t in up + down])
    xy = triangle[0] + np.array(grid) / n @ (triangle[1:] - triangle[0])
    gradient = hat_gradients(xy[cells])
    area = 0.5 / n**2 * np.linalg.det(triangle[1:] - triangle[0])
    K = np.zeros((2 * len(grid),) * 2)
    for t, g in zip(cells, gradient):
        B = np.zeros((3, 6))
        B[0, 0::2], B[1, 1::2], B[2, 0::2], B[2, 1::2] = g[:, 0], g[:, 1], g[:, 1], g[:, 0]
        dof = np.column_stack([2 * t, 2 * t + 1]).ravel()
        K[np.ix_(dof, dof)] += area * B.T @ C @ B
    compliance = np.linalg.pinv(K, hermitian=True, rcond=1e-10)
    side, base = np.linalg.norm(triangle[1]), np.array([number[i, 0] for i in range(n + 1)])
    s, side = (np.arange(64 * n) + 0.5) / (64 * n), np.linalg.norm(triangle[1])
    base = np.array([number[i, 0] for i in range(n + 1)])

    def normalized(r):
        """r (places, 2) without its linear part, int |r|^2 = 1, and its forces on the mesh."""
        r = r - np.vander(s, 2) @ np.linalg.lstsq(np.vander(s, 2), r, rcond=None)[0]
        f, ds = np.zeros(2 * len(grid)), side / len(s)
        r /= np.sqrt(ds * (r**2).sum())
        for share, at in ((1 - n * s % 1, base[(n * s).astype(int)]),
                          (n * s % 1, base[(n * s).astype(int) + 1])):
            for c in (0, 1):
                np.add.at(f, 2 * at + c, share * r[:, c] * ds)
        return f

    for _ in range(4):  # jumps anywhere, and smooth ones
        for r in ((s[:, None] < rng.uniform(0.1, 0.9)) * rng.standard_normal(2),
                  np.sin(6 * s[:, None] + rng.uniform(0, 6, 2))):
            f = normalized(r)
            assert f @ compliance @ f <= constant
    halves = [normalized(shape[:, None] * axis) for axis in np.eye(2)
              # orthogonal to each other
              for shape in (np.abs(s - 0.5), np.where(s < 0.5, 0.5 - 3 * s, 2.5 - 3 * s))]
    largest = np.linalg.eigvalsh(np.array(halves) @ compliance @ np.array(halves).T)[-1]
    assert 2 * largest <= constant <= 2 * 4 * largest, constant / largest


def test_effectivity_where_normals_turn(estimated, split, exported, read, steps_of, monkeypatch):
    """The pin's contact spans 50 degrees: the reference must have the bound's problem, normals and
    gaps linear along the coarse edges; those of its own facets would move the constraint by down
    h/2R = 0.03, a third of the indentation."""
    _, estimator, found = estimated(split("pin", 1), h=1)
    (pair,) = estimator.pairs
    start, end = pair.first.side.xy[pair.first.side.edges].swapaxes(0, 1)

    def along(values, xy):
        """Nodal values of the coarse side at places xy on its edges."""
        t = end - start
        s = np.clip(((xy[:, None] - start) * t).sum(axis=2) / (t**2).sum(axis=1), 0, 1)
        away = np.linalg.norm(xy[:, None] - start - s[..., None] * t, axis=2)
        edge = away.argmin(axis=1)
        assert away.min(axis=1).max() < 1e-9 * np.abs(start).max()
        s = s[np.arange(len(xy)), edge]
        return pair.first.at(values, edge, s[:, None])[:, 0]

    def normals(side):
        turned = along(pair.normal, side.xy)
        return turned / np.linalg.norm(turned, axis=1)[:, None]

    own = mortar.Side.nodal_normals
    monkeypatch.setattr(mortar.Side, "nodal_normals", normals)
    problem = read(exported(split("pin", 4), h=1))
    monkeypatch.setattr(mortar.Side, "nodal_normals", own)
    fine = problem.structure.contact
    problem.operator = problem.operator.with_contact(
        dataclasses.replace(fine, gap=along(pair.gap, fine.xy)))
    problem.structure = problem.operator.structure
    solver, steps = steps_of(problem)
    (step,) = steps
    gather = Gather(problem.operator)
    reference = Recorded(gather, problem.operator, problem.manifest,
                         ContactState(problem.operator, solver),
                         gather_body(gather))
    reference.kinematic = gather.displacements(
        problem.operator.displacements(step.multipliers, step.weights))
    error = true_error(estimator, reference)
    # on curves the jump is closed inside edges: the correction is as large as the bow of an edge
    assert error <= found.total and found.total - found.correction <= 1.5 * error


def exact_cantilever(x, y):
    """Strains e11, e22, 2 e12 of the displacement that edp/cantilever.edp gives."""
    w, k, a = 0.01, 1.3, 0.02
    e = w * k * np.cos(k * x) * np.cos(k * y)
    return np.stack([e, e, -2 * w * k * np.sin(k * x) * np.sin(k * y) + 2 * a * x], axis=-1)


def exact_ring(x, y, b=20.0, c=35.0, interference=0.05, nu=0.3):
    """Lame: u_r = A r + B/r with u_r(b) = interference, sigma_r(c) = 0 in plane strain."""
    slope = (1 - 2 * nu) / c**2  # A / B
    B = interference / (slope * b + 1 / b)
    A, r = slope * B, np.hypot(x, y)
    radial, hoop, cos, sin = A - B / r**2, A + B / r**2, x / r, y / r
    return np.stack([radial * cos**2 + hoop * sin**2, radial * sin**2 + hoop * cos**2,
                     2 * (radial - hoop) * cos * sin], axis=-1)


@pytest.mark.parametrize("scene, exact, parameters", [
    ("cantilever", exact_cantilever, dict(cells=3)),
    ("cantilever", exact_cantilever, dict(cells=9, subdomains="5")),
    ("pressfit", exact_ring, dict(h=3)), ("pressfit", exact_ring, dict(h=1.5)),
    ("zones", exact_zones, dict(cells=8, steps=1)),
    ("zones", exact_zones, dict(cells=16, steps=1, subdomains="6"))])
def test_effectivity_against_a_closed_form(estimated, scene, exact, parameters):
    """Elasticity, Lame's ring (whose polygon it does not see: that errs by h^2 against an error of
    order h), and contact that sticks, slips and opens."""
    _, estimator, found = estimated(scene, **parameters)
    body = estimator.body
    corner = body.mesh.corner
    # edge midpoints: exact for squares
    points = np.einsum("qn,tni->tqi", (np.ones((3, 3)) - np.eye(3)) / 2, corner)
    apart = exact(*points.transpose(2, 0, 1)) - body.strain(estimator.kinematic)[:, None]
    error = np.sqrt(np.einsum("tqi,tij,tqj,t->", apart, body.elasticity, apart, body.mesh.area / 3))
    assert 0.99 * error <= found.total <= 1.5 * error, found.total / error


def test_effectivity_of_recovery_is_near_one_where_the_solution_is_smooth(estimated):
    one, two = (estimated("cantilever", kind=kind, cells=9, subdomains="5")[2]
                for kind in ("equilibrated", "recovery"))
    assert two.total == pytest.approx(one.total, rel=0.1)


@pytest.mark.parametrize("scene, parameters", [("patch", dict(cells=3)),
                                               ("patch", dict(cells=2, angle=30, subdomains="7")),
                                               ("patch-bodies", dict()),
                                               ("patch-bodies", dict(ratio=0.6, tilt=-12)),
                                               ("bar", dict(cells=2, steps=4)),
                                               ("thermal", dict(cells=2, steps=2))])
def test_nothing_is_estimated_where_the_solution_is_exact(estimated, scene, parameters):
    _, _, found = estimated(scene, settings=(("rtol", 1e-12),), **parameters)
    # the square root of rounding in the energies
    assert found.total <= 1e-7 * found.norm or found.norm < 1e-12


# ---- parts ---------------------------------------------------------------------------------------

def test_parts_answer_to_their_own_knob(estimated):
    base = dict(cells=4, steps=2, loading="nonmonotone")
    loose = (("rtol", 1e-3), ("primal_rtol", 1.0), ("friction_rtol", 1e-10), ("inner_rtol", 1e-9))
    tight = (("rtol", 1e-9), *loose[1:])
    one, two = estimated(settings=loose, **base)[2], estimated(settings=tight, **base)[2]
    assert one.solver > 1e3 * two.solver and one.mesh == pytest.approx(two.mesh, rel=0.02)
    finer = estimated(settings=tight, **{**base, "cells": 8})[2]
    assert finer.mesh < 0.75 * two.mesh and max(finer.solver, two.solver) < 1e-4 * finer.mesh
    early = (("rtol", 1e-9), ("friction_rtol", 0.3), ("inner_rtol", 1e-9))
    one, two = (estimated(settings=s, **base, friction=0.8)[2] for s in (early, tight))
    assert one.friction > 1e3 * max(two.friction, one.solver)
    assert one.mesh == pytest.approx(two.mesh, rel=0.02)


@pytest.mark.parametrize("name, change", [
    ("uneven", ("macro young() E //", "macro young() (E*(1 + x*x + 2*y)) //")),
    ("warmed",
     ('include "export.idp"', 'macro thermal1() (1e-4*x*y*(1 + y)) //\ninclude "export.idp"'))])
def test_what_varies_inside_triangles_leaves_vertices_in_balance(variant, estimated, name, change):
    """Elasticity and thermal stress are the means that the assembled forces have seen: the solver's
    part is the solver's.
    """
    scene = variant(name, change)
    loose, tight = (estimated(scene, settings=(("rtol", tol), ("primal_rtol", 1.0)), cells=3,
                              steps=1)[2]
                    for tol in (1e-5, 1e-9))
    assert tight.solver < 1e-2 * loose.solver and tight.solver < 1e-5 * tight.mesh


def test_the_friction_part_is_the_way_to_the_fixed_point(estimated):
    """Displacements of an early and of the last iterate: their distance is the friction part, to a
    factor of two.
    """
    base = dict(cells=4, steps=2, loading="nonmonotone", friction=0.8)
    early, last = (estimated(settings=(("rtol", 1e-9), ("friction_rtol", tolerance),
                                       ("inner_rtol", 1e-9)), **base)
                   for tolerance in (0.3, 1e-10))
    assert 0.5 < true_error(early[1], last[1]) / early[2].friction < 2
    problem, estimator, found = early
    step = estimator.last[1]
    onward = np.sqrt(step.moved @ problem.operator.apply(step.moved)) / (1 - step.contraction)
    # of a sum 1e4 times as large
    rest = found.total - found.correction - expected_total(estimator)
    assert rest == pytest.approx(onward, rel=1e-3)


def stir(step, solver):
    """Contact forces that are far from a solution, but in the cone; a little disorder of the glue.
    """
    rows, random = solver.rows, np.random.default_rng(3)
    x = step.multipliers
    x[rows.normal] *= random.uniform(0.7, 1.3, len(rows.normal))
    bound = rows.friction_bound(x)
    x[rows.tangential] = np.clip(random.uniform(-1.2, 1.2, len(bound)), -1, 1) * bound
    x[rows.gluing] *= random.uniform(0.98, 1.02, len(rows.gluing))


def test_the_bound_holds_far_from_the_solution(estimated):
    """With a given friction bound any admissible pair is bounded: this needs every term of the
    duality gap.
    """
    fine = estimated("model-tresca", cells=32, steps=1)[1]
    _, estimator, found = estimated("model-tresca", cells=4, steps=1, change=stir)
    error = true_error(estimator, fine)
    undisturbed = true_error(estimated("model-tresca", cells=4, steps=1)[1], fine)
    assert error > 1.2 * undisturbed
    assert error <= found.total <= found.mesh + found.solver + found.correction
    assert found.solver > 0.5 * found.mesh


def test_the_total_is_that_of_its_stress_and_displacements(estimated):
    """The estimate adds up squares and products of small differences; here the two stresses are
    subtracted.
    """
    _, estimator, found = estimated("model-tresca", cells=4, steps=1, change=stir)
    # vertices are out of balance by rounding
    body = estimator.body
    apart = body.norm(body.stress(estimator.kinematic - reported(estimator)))
    assert apart > 0.1 * found.total
    assert found.total == pytest.approx(expected_total(estimator) + apart, rel=1e-6)


def expected_total(estimator):
    """The bound without a friction part, by the energy of the difference of the two stresses."""
    body, contact = estimator.body, estimator.contact
    kinematic = np.einsum("tij,tj->ti", body.elasticity, body.strain(estimator.kinematic))
    apart = estimator.stress - kinematic[:, None, None]
    square = sum(recovery.energy(body.mesh.area / 3, body.compliance, apart[:, k]).sum()
                 for k in range(3))
    return np.sqrt(square) / 2 + np.sqrt(square / 4 + contact.duality_gap())


def test_the_duality_gap_is_the_integral_over_the_contact_boundary(estimated):
    """By a rule of many points; slip changes its sign inside edges, where the rule is good to
    1/n^2.
    """
    _, estimator, _ = estimated("model-tresca", cells=4, steps=1, change=stir)
    c, n = estimator.contact, 2000
    assert (np.diff(np.sign(c.slip[c.node]), axis=1) != 0).any() and c.distance.max() > 0
    at = (np.arange(n) + 0.5) / n

    def along(value):
        return (1 - at) * value[c.node[:, :1]] + at * value[c.node[:, 1:]]

    pressure, shear, bound, distance, slip = map(along,
                                                 (c.pressure, c.shear, c.bound, c.distance, c.slip))
    parts = [(c.length @ term.mean(axis=1))
             for term in (pressure * distance, bound * np.abs(slip) + shear * slip)]
    assert min(parts) > 1e-3 * max(parts)
    assert c.duality_gap() == pytest.approx(sum(parts), rel=1e-5)


def slip_away(step, solver):
    """No friction forces at all, as if the tangential rows had been lost."""
    step.multipliers[solver.rows.tangential] = 0.0


def test_lost_friction_shows_in_the_duality_gap(estimated):
    """The displacements are those of equilibrium without friction: only the contact term can tell.
    """
    fine = estimated("model-tresca", cells=32, steps=1)[1]
    _, estimator, found = estimated("model-tresca", cells=4, steps=1, change=slip_away)
    assert found.total >= true_error(estimator, fine)
    assert estimator.contact.duality_gap() > 0.2 * found.mesh**2
    assert found.solver > 0.3 * found.mesh


# ---- what breaks it ------------------------------------------------------------------------------

def test_a_wrong_sign_is_noticed(estimated, monkeypatch):
    """Contact tractions of the wrong sign leave vertices out of balance, which the solver's part
    shows.
    """
    sound = estimated(cells=4, steps=1)[2]
    plain = EquilibratedBound._applied

    def turned(self, weights, contact, pairs):
        contact.moments = -contact.moments
        return plain(self, weights, contact, pairs)

    monkeypatch.setattr(EquilibratedBound, "_applied", turned)
    broken = estimated(cells=4, steps=1, settings=(("max_fixed_point", 99),))[2]
    assert broken.solver > sound.mesh > 1e3 * sound.solver


def test_unbalanced_vertices_are_reported_and_spread(estimated):
    """An extra force on one vertex is the solver's: the stress stays in equilibrium on every
    triangle.
    """
    _, estimator, _ = estimated(cells=4, steps=1)
    body = estimator.body
    load = equilibration.prolongation(body.mesh, estimator.base, None)
    load[0] += [[3.0, 0.0], [0.0, 5.0], [0.0, 0.0]]
    target = equilibration.averaged_moments(body.mesh, estimator.base)
    moments, imbalance = equilibration.edge_moments(body.mesh, body.chains, load, target,
                                                    estimator.applied, body.given)
    inner = ~body.constrained[body.mesh.triangles[0]].any(axis=1)
    vertex = body.mesh.triangles.ravel()[body.chains.order[0]]
    for k in range(2):
        if inner[k]:
            at = np.flatnonzero(vertex == body.mesh.triangles[0, k])[0]
            around = body.mesh.triangles == body.mesh.triangles[0, k]
            left = (moments[body.mesh.first] - moments[body.mesh.last] - load)[around]
            np.testing.assert_allclose(left,
                                       np.tile(imbalance[at] / around.sum(), (around.sum(), 1)),
                                       atol=1e-9 * np.abs(load).max())
            np.testing.assert_allclose(imbalance[at], -np.array([[3.0, 0.0], [0.0, 5.0]])[k],
                                       atol=1e-6 * np.abs(load).max())


def test_a_reaction_in_a_single_point_has_no_estimate(estimated):
    _, estimator, _ = estimated(cells=4, steps=1)
    vertex = estimator.body.mesh.triangles.ravel()[estimator.body.chains.order[0]]
    imbalance = np.zeros((len(vertex), 2))
    free = np.flatnonzero(~estimator.body.constrained[vertex].any(axis=1))[0]
    imbalance[free] = 1.0
    size, reason = estimator._unbalanced(imbalance, 10.0)
    assert not reason and size > 0
    imbalance[free], imbalance[np.flatnonzero(
        estimator.body.constrained[vertex].all(axis=1))[0]] = 0.0, 1.0
    assert "single point" in estimator._unbalanced(imbalance, 10.0)[1]


def test_point_loads_have_no_estimate(variant, estimated):
    pushed = variant("pushed-point", (
        'include "export.idp"', 'macro pointLoad1() [2., 1., 0., -1e5] //\ninclude "export.idp"'))
    assert "point loads" in estimated(pushed, cells=2, steps=1)[2].reason


# ---- runs ----------------------------------------------------------------------------------------

def test_the_summary_and_the_field_agree(solved):
    run = solved("model", loading="nonmonotone", cells=3, steps=4, fields="yes", errors="energy")
    found = run.summary["errors"]["energy"]
    assert found["kind"] == "equilibrated" and found["step"] == 4
    assert found["total"] <= sum(found[name] for name in ("mesh", "solver", "friction",
                                                          "correction"))
    assert found["relative"] == pytest.approx(found["total"] / found["norm"])
    # phi_2 is largest at t = 0.625
    assert found["largest"]["step"] == 2 and found["largest"]["norm"] > found["norm"]
    for entry in (found, found["largest"]):
        mesh = meshio.read(run.directory / f"fields/error_{entry['step']:04d}.vtu")
        field = mesh.cell_data["error_indicator"][0]
        # the field leaves out what contact adds between nodes
        assert np.linalg.norm(field) == pytest.approx(entry["mesh"], rel=1e-2)
    assert not (run.directory / "fields/error_0003.vtu").exists()
    assert (run.directory / "error.pvd").read_text().count("<DataSet") == 2
    assert (run.directory / "fields.pvd").read_text().count("<DataSet") == 5


def test_what_the_friction_bound_adds_is_the_sum_of_all_rounds():
    """total (q + q^2 + ...): each round of successive approximations errs q times the last."""
    for rate in (0.0, 0.1, 0.5, 0.9):
        rounds = sum(0.3 * rate**k for k in range(1, 500))
        assert coupling(0.3, rate) == pytest.approx(rounds, abs=1e-12)
    assert coupling(0.3, np.nan) == 0.0  # no change of the bound was seen
    assert np.isfinite(coupling(0.3, 1.2))


def test_what_coulombs_law_and_time_add_is_named_beside_the_bound(solved):
    """Only where there are such: not with a given friction bound, nor in a single step."""
    run = solved("model", loading="nonmonotone", cells=4, steps=8, errors="yes")
    found = run.summary["errors"]["energy"]
    assert 0 < found["coupling"] < found["total"]
    work = run.summary["errors"]["quantities"]["dissipated_energy"]["time"]
    assert found["time"] ** 2 / 2 == pytest.approx(work)
    assert {EARLIER, COULOMB} < set(found["excluded"])
    words = budget.describe_energy(found)
    assert "Coulomb's law about" in words[1] and EARLIER in words[2]
    given = solved("model-tresca", cells=3, steps=1, errors="energy").summary["errors"]["energy"]
    assert given["coupling"] == 0 and not {EARLIER, COULOMB} & set(given["excluded"])


def test_any_number_of_ranks_gives_the_same_estimate(solved):
    one, two = (solved("model", loading="nonmonotone", cells=3, steps=2, fields="yes",
                       errors="energy", np=n)
                for n in (1, 2))
    assert json.dumps(one.summary["errors"]) == json.dumps(two.summary["errors"])
    fields = [meshio.read(run.directory / "fields/error_0002.vtu").cell_data["error_indicator"][0]
              for run in (one, two)]
    assert np.array_equal(*fields)
    one, two = (solved("stack", subdomains="5", steps=1, errors="energy", np=n) for n in (1, 3))
    assert one.summary["errors"]["energy"]["total"] > 0
    assert json.dumps(one.summary["errors"]) == json.dumps(two.summary["errors"])


def test_kinds(solved):
    run = solved("model", cells=3, steps=1, errors="energy",
                 estimator="recovery").summary["errors"]["energy"]
    assert run["kind"] == "recovery" and run["total"] == run["mesh"] > 0
    assert run["solver"] == run["friction"] == 0
    assert solved("model", cells=3, steps=1, errors="energy",
                  estimator="none").summary["errors"]["energy"] == {"kind": "none"}
    assert solved("model", cells=3, steps=1, estimator="exact").status == 2


def test_an_unloaded_end_is_left_to_the_largest_step(solved):
    """The bar's load goes back to nothing: there rounding would be compared with rounding."""
    found = solved("bar", cells=2, steps=4, errors="energy").summary["errors"]["energy"]
    assert found["step"] == 2 and "largest" not in found
