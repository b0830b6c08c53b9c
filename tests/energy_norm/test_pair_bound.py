"""The bound between two bodies: equal tractions, no penetration, every term, turning normals."""

import dataclasses

import numpy as np
import pytest

from bounds import SCENES, Recorded, slip_away, stir, true_error
from driver.contact.side import Side
from driver.energy_norm import recovery
from driver.energy_norm.edge_remainder import Fan, remainder_constant
from driver.energy_norm.torn_body import Gather, gather_body
from driver.results.contact_state import ContactState
from driver.scene.elements import hat_gradients


BETWEEN = [("hertz-bodies", dict(h=0.016)), ("mindlin-bodies", dict(h=0.15, steps=1)),
           ("wedge", dict(steps=1)),
           ("stack", dict(h=0.25, steps=2))]


@pytest.mark.parametrize("scene, parameters", BETWEEN)
@pytest.mark.some(2)
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


@pytest.mark.slow
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


# a block in a notch that turns by 46 degrees and that it does not fill: beyond the end of one flank
# its normals meet the other one askew
CORNER = """include "scene.idp"
real finer = physical("finer", 1.), g = 0.1, s = -0.4;
border b0(t=0, 1) { x = g + t; y = g + s*t; label = 11; }
border b1(t=0, 1) { x = g + 1.; y = g + s + (1 - s)*t; label = 3; }
border b2(t=0, 1) { x = g + 1 - (1 - s)*t; y = g + 1.; label = 4; }
border b3(t=0, 1) { x = g + s*(1 - t); y = g + 1 - t; label = 11; }
border c0(t=0, 1) { x = -1 + 2*t; y = -1.; label = 1; }
border c1(t=0, 1) { x = 1.; y = -1 + (1 + s)*t; label = 5; }
border c2(t=0, 1) { x = 1 - t; y = s*(1 - t); label = 21; }
border c3(t=0, 1) { x = s*t; y = t; label = 21; }
border c4(t=0, 1) { x = s - (1 + s)*t; y = 1.; label = 5; }
border c5(t=0, 1) { x = -1.; y = 1 - 2*t; label = 1; }
addBody(buildmesh(b0(5) + b1(5) + b2(5) + b3(5)))
addBody(buildmesh(c0(6) + c1(3) + c2(3) + c3(3) + c4(3) + c5(6)))
for (int k = 0; k < bodyCount; ++k) bodies[k] = trunc(bodies[k], 1, split = finer);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro contactPair() FIRST //
macro tresca() 0.1 //
macro load1() traction(3, -1.5*(1 - y), -0.2) + traction(4, -0.4 - 0.3*x, -2.*(1 + x)) //
include "export.idp"
"""


@pytest.mark.parametrize("first", ["11, 21", "21, 11"])
@pytest.mark.some(1)
def test_the_bound_where_a_pair_turns_a_corner(estimated, tmp_path, first):
    """Whichever side has the nodes: flanks face what is parallel to them, the corner's one
    displacement penetrates neither, and the bound is above the error of forces that are far from a
    solution.
    """
    scene = tmp_path / "corner.edp"
    scene.write_text(CORNER.replace("FIRST", first))
    fine = estimated(scene, finer=4)[1]
    _, estimator, found = estimated(scene, change=stir)
    body, (pair,) = estimator.body, estimator.pairs
    p = pair.parts
    one, other = pair.first.side.edge_normal[p.edge], pair.second.side.edge_normal[p.other]
    assert len(pair.first.twins) == 1
    np.testing.assert_allclose(one, -other, atol=1e-12)
    u = body.untorn(estimator.kinematic - estimator.lifted)
    moved = u + pair.lift(u, body.stiffness, body.constrained, body.elasticity).vertex
    inside = []
    for field in (u, moved):
        jump = (pair._jump(field) * pair._frame[0]).sum(axis=2)
        inside.append((jump - pair.first.at(pair.gap, p.edge, p.at))[(p.at == 0) | (p.at == 1)])
    assert inside[0].max() > 0.1 * np.abs(u).max()  # the forces have the sides penetrate
    assert inside[1].max() <= 1e-13 * np.abs(u).max()
    error = true_error(estimator, fine)
    assert error <= found.total and found.total - found.correction <= 2 * error


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


@pytest.mark.slow  # a fine mesh for reference
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

    own = Side.nodal_normals
    monkeypatch.setattr(Side, "nodal_normals", normals)
    problem = read(exported(split("pin", 4), h=1))
    monkeypatch.setattr(Side, "nodal_normals", own)
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


def test_a_joined_field_is_continuous_and_zero_at_the_ends_of_sides():
    """Where pieces leave parts of sides uncovered it falls from their ends to nothing; a side whose
    end a piece reaches keeps its values, and has no part in those of another one.
    """
    triangle = np.tile([[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]], (3, 1, 1))
    at = np.array([[0.0, 1.0], [0.3, 0.6], [0.6, 0.8], [0.0, 0.5]])
    values = np.arange(1.0, 17.0).reshape(4, 2, 2)
    fan = Fan.of(triangle, np.array([2, 0, 0, 1]), at)
    field = fan.joined(values)
    sides = {}
    for owner, (start, stop), piece, (left, right) in zip(fan.owner, fan.at, fan.piece, field):
        sides.setdefault(int(owner), []).append((start, stop, left.tolist(), right.tolist()))
        if piece >= 0:
            np.testing.assert_array_equal([left, right], values[piece])
    assert [part[:2] for part in sides[0]] == [(0, 0.3), (0.3, 0.6), (0.6, 0.8), (0.8, 1)]
    for owner, parts in sides.items():
        covered = {0: (1, 3), 1: (0, 1), 2: (0, 1)}[owner]
        assert parts[0][0] == 0 and parts[-1][1] == 1
        assert covered[0] == 0 or parts[0][2:] == ([0, 0], parts[1][2])
        assert covered[1] == len(parts) or parts[-1][2:] == (parts[-2][3], [0, 0])
