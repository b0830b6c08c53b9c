"""Random scenes: one a seed, solved or refused rightly; what goes wrong is noticed."""

import os
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from driver import environment
from driver.errors import DriverError
from driver.files import read_rows
from driver.hard import (bounded, deformations, generator, inverted, judgement, laws, programs,
                         random, refusal, sensitivity, states, suite)
from driver.qp import complementarity
from driver.qp.coulomb import CoulombProblem
from driver.hard.motions import unresisted
from driver.hard.shapes import block, disc, lattice, split, with_hole, with_slit
from driver.hard.slip_limits import SlipLimits

SEED = 3007  # the scenes of the default tests begin here
RANKED = (3011,)  # of them those that also run on two ranks, which takes a second each


# ------------------------------------------------------------------------------ what is drawn

def test_a_seed_draws_one_scene():
    assert generator.draw(5).text == generator.draw(5).text
    assert len({generator.draw(seed).text.partition("\n")[2] for seed in range(30)}) == 30


def test_scenes_cover_what_they_shall():
    """Among a few hundred scenes every outline, law, support, gap, history and element occurs."""
    declared = [generator.draw(seed).declared for seed in range(400)]
    seen = {key: {each.get(key) for each in declared} for key in declared[0]}
    assert len(seen["outline"]) >= 15 and len(seen["labels"]) >= 12
    assert seen["element"] == {"P1", "P2", "P2-mixed"}
    assert len(seen["law"]) == 7 and len(seen["gap"]) == 8
    assert {"static", *generator.HISTORIES} == seen["history"]
    assert seen["jump"] >= {"none", "1e+06", "0.001"} and "none" in seen["support"]
    for rare in ("spoilt", "sides", "sliding", "cycles", "obstacles", "slit", "springs",
                 "revolution", "bystander"):
        assert sum(rare in each for each in declared) > 0, rare


@pytest.mark.parametrize("shape", [
    split(block(0.0, 0.0, 2.0, 1.0), 1, 0.4),
    split(split(lattice(block(0.0, 0.0, 2.0, 1.0), (6, 3), 2.0), 1, 0.4), 2, 0.5),
    with_hole(block(0.0, 0.0, 2.0, 1.0), 1.0, 0.5, 0.2, 91, 2), disc(0.0, 0.0, 1.0)],
    ids=lambda shape: shape.name)
def test_outlines_close(shape):
    """Sides follow one another around the body and around its hole; the area is that inside."""
    for outline in ([side for side in shape.sides if not side.hole],
                    [side for side in shape.sides if side.hole]):
        for side, following in zip(outline, outline[1:] + outline[:1]):
            assert side.end == following.start
    assert len({side.label for side in shape.sides}) == len(shape.sides)
    green = 0.0
    for side in shape.sides:
        curve = side.places.T
        assert np.allclose(curve[:, [0, -1]].T, [side.start, side.end], atol=1e-14)
        green += 0.5 * np.sum(curve[0][:-1] * curve[1][1:] - curve[0][1:] * curve[1][:-1])
    assert np.isclose(green, shape.area, rtol=1e-3)  # chords of arcs


def test_a_slit_has_two_tips_and_bodies_of_revolution_keep_off_the_axis():
    """Lips run clockwise from tip to tip, in the middle of their body; sections are as they were.
    """
    body = block(-1.0, 0.0, 2.0, 1.0)
    upper, lower = with_slit(body, (0.0, 0.5), 0.6, 0.5, 0.02, 81).labelled(81, 82)
    assert (upper.start, upper.end) == (lower.end, lower.start)
    for side, sign in ((upper, 1.0), (lower, -1.0)):
        np.testing.assert_allclose(side.places[[0, -1]], [side.start, side.end], atol=1e-14)
        middle = side.places[len(side.places) // 2] - [0.0, 0.5]
        np.testing.assert_allclose(middle, sign * 0.02 * np.array([-np.sin(0.5), np.cos(0.5)]),
                                   atol=1e-14)
    moved = body.shifted(3.0)
    assert moved.area == body.area and min(x for side in moved.sides for x, _ in side.places) == 2.0


# ------------------------------------------------------------------------------ scenes, judged

@pytest.mark.parametrize("seed", [
    pytest.param(seed, marks=[pytest.mark.slow] * (seed % 2 == 0))  # half by default
    for seed in range(SEED, SEED + random.FAST)])
@pytest.mark.some(1)
def test_fast(seed, tmp_path, monkeypatch):
    if seed not in RANKED:
        monkeypatch.setattr(random, "ranks_agree", lambda *_: "")
    row = random.judge(seed, tmp_path)
    assert row.status in ("solved", "refused"), row.why


@pytest.mark.parametrize("seed", [
    102032, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (
        28, 20000237, 30000103, 50000139, 50000251, 60000133, 60000197, 60000323, 60000445))])
@pytest.mark.slow
def test_stiff_parts_among_soft_ones(seed, tmp_path, monkeypatch):
    """Jumps of stiffness of 1e6 under contact: forces whose ways are a rounding of the soft part's,
    so that residuals at which products end are not enough for cuts to agree.
    """
    monkeypatch.setattr(random, "ranks_agree", lambda *_: "")
    row = random.judge(seed, tmp_path)
    assert row.status == "solved", row.why


@pytest.mark.slow
@pytest.mark.parametrize("seed", [70013, 70076, 70105, 70132, 81006, 81054, 82003,
                                  82013, 84007])
def test_cuts_agree_at_corners(seed, tmp_path):
    """Vertices that rest in their corners, states that hold them alike, bodies in a corner; bits
    of bodies without support."""
    assert random.judge(seed, tmp_path).status == "solved"


@pytest.mark.slow  # two hundred scenes of several runs each
def test_many(tmp_path):
    suite.run_suite({"family": "random", "seed": "5000", "count": "200", "out": str(tmp_path)})
    rows = read_rows(tmp_path / "report.csv")
    assert sum(row["status"] == "solved" for row in rows) >= 0.7 * len(rows)


BLOCK = """
include "scene.idp"
real F = physical("friction", 0.3), push = physical("push", 0.2);
subdomains("4");
body = square(6, 3, [2*x, y]);
quasistatic(1.);
macro young() 1. //
macro poisson() 0.3 //
{support}
macro load1() traction(3, push*1e-3, -1e-3) //
macro amplitude1(t) t //
macro contact() 1 //
macro gap() 1e-4 //
macro friction() F //
include "export.idp"
"""


@pytest.fixture
def problem(tmp_path):
    """problem(support, NAME=value): the scene above, its Problem and its path."""
    def make(support="", **parameters):
        path = tmp_path / "block.edp"
        path.write_text(BLOCK.format(support=support))
        given = {"steps": "2", **parameters}
        return judgement.Problem.of(path, given), path, given
    return make


def _scene(given) -> generator.RandomScene:
    return generator.RandomScene(0, "", {}, ({"subdomains": "1"}, {"subdomains": "3"}), given)


CLAMPED = "macro support() on(4, u1 = 0., u2 = 0.) //"


def test_laws_notice_what_is_wrong(problem, tmp_path):
    """Forces off by a thousandth, a slip that is turned around, pressure where it is open."""
    right, path, given = problem(CLAMPED)
    outcome = random.run(_scene(given), path, tmp_path, {"subdomains": "3"})
    assert outcome.status == 0, outcome.message
    assert right.worst(outcome)[1] <= judgement.LAWS
    spoilt = {"sigma_n": 1.001, "sigma_t": 0.99, "u_t": 1.001, "bound": 1.001,
              "weight": 1.001, "gap": 1.001}
    for column, factor in spoilt.items():
        contact = {**outcome.contact, column: factor * outcome.contact[column]}
        assert right.worst(replace(outcome, contact=contact))[1] > judgement.LAWS, column
    other = {**outcome.contact, "sigma_n": outcome.contact["sigma_n"] * (1 + 1e-3)}
    assert np.isclose(laws.disagreement(right.body, outcome.contact, other), 1e-3, rtol=1e-6)


def test_residuals_explain_what_they_do(problem, tmp_path):
    """Forces of a push 5e-4 larger, which lifts the far end by 1.3e-3 of the deformation where the
    contact forces do not follow: by residuals of twice a thousandth, not by those of one.

    Nor is anything by the residuals of a run explained that is wrong by a thousandth.
    """
    right, path, given = problem(CLAMPED)
    push = 0.2 + 1e-4
    one, other = (random.run(_scene(words), path, tmp_path / name, {"subdomains": "3"})
                  for name, words in (("one", given), ("other", {**given, "push": str(push)})))
    tables = one.contact, other.contact
    assert laws.disagreement(right.body, *tables) > 1e-6
    assert sensitivity.explained(right.body, right.manifest, *tables, 2e-3)
    assert not sensitivity.explained(right.body, right.manifest, *tables, 1e-3)
    wrong = {**one.contact, "sigma_n": one.contact["sigma_n"] * (1 + 1e-3)}
    assert right.sensitive([one, one])
    assert not right.sensitive([one, replace(one, contact=wrong)])


def test_motions_that_soft_springs_resist():
    """Chains of springs, one of them 1e12 as stiff: an end on 1e-9 of its own chain is held, no
    spring at all is not, and stiff neighbours make no difference. Nor does what rounding leaves of
    the coupling to the direction in which supports hold all.
    """
    chain = np.diag([1.0, 2.0, 1.0]) - np.eye(3, k=1) - np.eye(3, k=-1)
    K = np.kron(np.zeros((9, 9)), np.eye(2))
    along, across = K[::2, ::2], K[1::2, 1::2]
    along[:3, :3], along[3:6, 3:6], along[6:, 6:] = 1e12 * chain, chain, chain / 3
    along[3, 3] += 1e-9
    across += 3 * along
    K[13, 12] = K[12, 13] = 1e-17
    motions = np.kron(np.eye(3), np.kron(np.ones((3, 1)), [[1.0], [0.0]]))
    free = motions @ unresisted(csr_matrix(K), motions)
    assert free.shape == (18, 2)
    np.testing.assert_array_equal(free[6:12], 0.0)
    assert unresisted(csr_matrix(K), motions[:, :0]).shape == (0, 0)


def test_rounding_excuses_no_more_than_itself(problem, tmp_path):
    """One rounding of the stiffness is worth nothing in a block, and nine digits where one half of
    it is 1e9 times as stiff and hangs on the other.
    """
    right, path, given = problem(CLAMPED)
    outcome = random.run(_scene(given), path, tmp_path, {"subdomains": "1"})
    contact = laws.Reported.of(right.body, outcome.contact)
    largest = np.abs(contact.u_n).max()
    assert laws.rounding(right.body, right.manifest, outcome.contact).max() <= 1e-11 * largest
    # of a sum of as many products as rows of the factor have entries
    K, root = right.body.K, np.sqrt(right.body.K.diagonal())
    factor = right.body._factor.L
    moved = np.abs((right.body.rounded(1).K - K).tocoo().data).max() / (root.max()**2 * 2.2e-16)
    assert 0.7 < moved / np.sqrt(factor.nnz / factor.shape[0]) < 1.4  # the sum itself is rounded
    path.write_text(path.read_text().replace("young() 1. ", "young() (x > 1 ? 1e9 : 1.) "))
    stiff = judgement.Problem.of(path, given)
    assert laws.rounding(stiff.body, stiff.manifest, outcome.contact).max() >= 1e-9 * largest


COLUMN = """
include "scene.idp"
subdomains("2");
body = square(2, 4, [x, 4*y]);
quasistatic(1.);
macro young() (y > 2 ? 1e6 : 1.) //
macro poisson() 0. //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -1e-3) //
macro amplitude1(t) t //
macro contact() 2 //
macro gap() 1e-12 //
include "export.idp"
"""


def test_stiff_material_has_a_scale_of_its_own(tmp_path):
    """A column, 2 of E = 1 below 2 of E = 1e6, pressed by 1e-3: it moves by 1e-3 y up to 2e-3.

    By 1.5e-3 at the mean, so that its foot is as much beyond its rigid motion. The stiff half
    shortens by 2e-9, of which half is beyond; the stress of the soft one makes 1e-6 of 1.5e-3. The
    node at the border is a stiff one. By 1 %: the diagonals of the mesh turn the motion a little.
    """
    path = tmp_path / "column.edp"
    path.write_text(COLUMN)
    body = judgement.Problem.of(path, {"steps": "1"}).body
    scale, _ = deformations.of_nodes(body, body.solve(np.ones(1))[None])
    soft = body.xy[:, 1] < 1.5
    assert (soft.sum(), (~soft).sum()) == (1, 3)
    assert np.allclose(scale, np.where(soft, 1.5e-3, 1.5e-9), rtol=1e-2)


def test_forces_that_are_nothing_may_move_a_body_that_hangs_loose(problem):
    """A body so soft that half of a millionth of its forces moves it beyond the tolerance: that is
    explained, ten millionths are not.
    """
    right, *_ = problem(CLAMPED)
    body, force = _Softer(right.body, 1e4), np.zeros(2 * len(right.body.gid))
    deformation, largest = 1e-3, 1e-4
    force[3] = 0.5 * laws.RESTS * largest
    moved = np.array([body.solve(np.zeros(1), body.B.T @ force)]) @ body.B.T
    assert np.abs(moved).max() > laws.RESTS * deformation

    def left(factor):
        explained = laws._moved_by_little(body, body.B @ right.body.motions, factor * moved,
                                          np.full(len(force), deformation), largest)
        return np.abs(factor * moved - explained).max() / np.abs(factor * moved).max()

    assert left(1) <= 1e-2 and left(20) >= 0.5


class _Softer:
    """A body all of whose displacements are `factor` times as large."""

    def __init__(self, body, factor):
        self.body, self.factor, self.B, self.loads = body, factor, body.B, body.loads

    def solve(self, weights, forces):
        return self.factor * self.body.solve(weights, forces)


@pytest.mark.parametrize("argument, least, most", [
    ("slip", [0.06, 0.06, 0.09], [0.3, 0.09, 0.09]),  # what is still to come
    ("displacement", [0.06] * 3, [0.3] * 3)])  # any of it again
def test_slip_that_was_weakens_friction_that_comes(argument, least, most):
    """The law falls from 1 to 0.2 and rises to 0.3 in the end: none, half and all of the way."""
    body = SimpleNamespace(gid=np.arange(3), columns={"friction": np.full(3, 0.3)},
                           weight=np.ones(3), free=np.arange(6))
    law = {"argument": argument, "range": 1.0, "values": [1.0, 0.2, 0.3]}
    manifest, slipped = SimpleNamespace(rooms={"slip_law": law}), np.array([0.0, 0.5, 1.0])
    for bound, largest in ((least, np.minimum), (most, np.maximum)):
        given, _ = refusal.largest_friction(body, manifest, slipped, largest)
        np.testing.assert_allclose(given, bound, rtol=1e-12)


PAIR = """
include "scene.idp"
int[int] sides = [11, 12, 13, 14];
addBody(square(3, 3, [x, y]))
addBody(square(3, 4, [1 + x, {low} + y], label = sides))
macro young() 1. //
macro poisson() 0.3 //
macro load1() traction(4, 1e-3, -1e-3) + traction(13, 0., -1e-3) //
macro support() on(12, u1 = 0.) //
macro contact() 1, 11 //
macro contactPair() 14, 2 //
macro tresca() 1e-4 //
include "export.idp"
"""


@pytest.mark.parametrize("low, shares", [(0.0, True), (1e-4, True), (0.1, False)])
def test_bodies_that_share_forces(low, shares, tmp_path):
    """Two blocks side by side on one floor do, but for a thousandth; on floors of their own not."""
    path = tmp_path / "pair.edp"
    path.write_text(PAIR.format(low=low))
    assert judgement.shares_forces(judgement.Problem.of(path, {}).body) == shares


@pytest.mark.parametrize("rooms, doubtful", [({}, False), ({"slip_law": {}}, True)])
def test_near_solutions_are_one_unless_friction_falls_with_slip(rooms, doubtful, monkeypatch):
    """Forces that differ where displacements do not: two nodes may stick in turn where it does."""
    monkeypatch.setattr(laws, "distance", lambda *_: 1e-6)
    monkeypatch.setattr(judgement, "shares_forces", lambda _: False)
    monkeypatch.setattr(judgement.Problem, "contraction", np.inf)
    run = SimpleNamespace(contact={}, summary={"uniqueness": {"verdict": "not examined"}})
    problem = judgement.Problem(SimpleNamespace(rooms=rooms), None)
    assert problem.not_unique([run, run]).startswith("uniqueness is not proved") == doubtful


def test_small_friction_is_proved_unique(problem):
    """The bound scales with F; a body that friction alone holds has none."""
    held, *_ = problem(CLAMPED, friction="0.02")
    assert 0 < held.contraction < 1
    more, *_ = problem(CLAMPED, friction="0.2")
    assert np.isclose(more.contraction, 10 * held.contraction, rtol=1e-9)
    free, *_ = problem()
    assert free.contraction == np.inf


@pytest.mark.parametrize("push, holds", [("0.29", True), ("0.31", False)])
def test_refusals_are_confirmed(problem, push, holds):
    """A block that is pushed slides away from F = 0.3 times its pressure on."""
    free, *_ = problem(push=push)
    weights, start = free.manifest.factors[-1], np.zeros(len(free.body.gid))
    share = refusal.unbalanced(free.body, free.manifest, weights)
    assert (share <= refusal.SLACK) == holds
    shown, why = refusal.no_state(free.body, free.manifest, weights, start)
    assert shown != holds and ("has a solution" in why) == holds


@pytest.mark.slow
@pytest.mark.parametrize("modes", [0, 1, 3])
@pytest.mark.some(1)
def test_states_are_searched_as_if_all_were_tried(modes):
    """Three nodes with friction up to F = 4, held or not: the same verdict on 30 random problems.

    Of those of bodies without support a part has no solution.
    """
    rng, n, none = np.random.default_rng(modes), 3, 0
    for _ in range(30):
        root = rng.standard_normal((2 * n, 2 * n))
        C, F = root @ root.T + 0.1 * np.eye(2 * n), rng.uniform(0.0, 4.0, n)
        moved, work = rng.standard_normal((2 * n, modes)), rng.standard_normal(modes)
        load = rng.standard_normal(2 * n)
        # by all states, each one linear system
        expected = bool(complementarity.all_solutions(CoulombProblem(
            C, load, F, np.arange(n), motions=moved, balance=work)))
        # forces on the body are minus the multipliers
        room = np.where(np.arange(2 * n) < n, -load, -load)
        step = states.States(np.hstack([C, moved]), room[:n], room[n:], F, F, np.zeros(n),
                             moved.T, work, np.zeros(n, bool), np.zeros((n, n), bool))
        assert step.search(500) == expected
        # the program may miss a solution beyond its limits, and of these problems none is
        assert programs.none_within(step, 500) == (not expected)
        none += not expected
    assert (none > 0) == (modes > 0)


@pytest.mark.slow
@pytest.mark.parametrize("modes, solved", [(1, 30), (3, 8)])
@pytest.mark.some(1)
def test_limits_of_forces_exclude_no_states(modes, solved):
    """Three bilateral nodes, F up to 0.8, and in the second case a motion that normals do not feel,
    which is what leaves some without a solution: the same verdict with limits of normal forces.
    """
    rng, n, verdicts = np.random.default_rng(modes), 3, []
    for _ in range(30):
        root = rng.standard_normal((2 * n, 2 * n))
        C, F = root @ root.T + 0.1 * np.eye(2 * n), rng.uniform(0.0, 0.8, n)
        moved, work = rng.standard_normal((2 * n, modes)), rng.standard_normal(modes)
        if modes == 3:
            moved[:n, 2] = 0.0
        room, start = rng.standard_normal((2, n))
        step = states.States(np.hstack([C, moved]), room, start, F, F, np.zeros(n), moved.T, work,
                             np.ones(n, bool), np.zeros((n, n), bool))
        _, limited = bounded.unbalanced_by_friction(step)
        if limited.reach is None:
            continue
        verdicts.append(limited.search(2000))
        assert verdicts[-1] == step.search(2000)
    assert len(verdicts) > 15 and sum(verdicts) >= solved * len(verdicts) / 30


@pytest.mark.parametrize("travelled", [True, False])
@pytest.mark.parametrize("push, solved", [(1.1, True), (1.15, True), (1.3, False), (1.9, False)])
@pytest.mark.some(4)
def test_friction_is_that_of_the_slip_it_comes_with(push, solved, travelled):
    """A rigid body on two feet, each pressed by 1, whose friction rises with slip from 0.2 to 1 at
    0.5 and falls to 0.2 at 1; one foot is ahead of the other by half of that way.

    Together they resist by 0.2 + 1.6 s + 1 - 1.6 s = 1.2 at most, each alone by 1.
    """
    law = SlipLimits(np.linspace(0.0, 1.0, 3), np.array([0.2, 1.0, 0.2]), np.ones(2), np.ones(2),
                     np.array([0.0, 0.5]), travelled)
    turned = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    none, without = np.zeros(2), np.array([[-np.inf], [np.inf]]) * np.ones(2)
    step = states.States(np.hstack([1e-3 * np.eye(4), turned]), none, none, none + 0.2, none + 1.0,
                         none, turned.T, np.array([2.0, 0.0, push]), np.zeros(2, bool),
                         np.zeros((2, 2), bool), law=law, slips=without)
    assert step.search(500) == solved
    assert replace(step, law=None).search(500)  # any friction between the least and the largest


def test_friction_within_limits_of_slip():
    """Values at the ends and at the points of the table between them, of |slip| either way."""
    law = SlipLimits(np.linspace(0.0, 1.0, 3), np.array([0.2, 1.0, 0.2]), np.full(3, 2.0),
                     np.full(3, 0.5), np.array([0.0, 0.25, 1.0]), True)
    least, most = law.within(np.array([-0.5, 0.2, -np.inf]), np.array([0.3, 2.0, np.inf]))
    # |slip| in 0 ... 0.25, 0.35 ... 1.25, 1 and more
    assert np.allclose(least, [0.4, 0.4, 0.4]) and np.allclose(most, [1.2, 2.0, 0.4])
    assert np.allclose(law.at(np.array([0.3, -0.5, 0.0])), [2 * 0.44, 2.0, 0.4])


def test_a_corner_rests_only_where_it_is_closed():
    """A vertex pushed against a wall by 1 and held from it by F = 0: its friction is free between
    two closed conditions, not beside an open one.
    """
    C = np.array([[1.0, 0.0, 0.0, -1.0], [0.0, 1.0, 1.0, 0.0],
                  [0.0, 1.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 1.0]])  # n, t of one: -t, n of the other

    def search(room, friction):
        none = np.zeros(2)
        step = states.States(C, np.array(room), none, none + friction, none + friction, none,
                             np.zeros((0, 4)), np.zeros(0), np.zeros(2, bool),
                             np.array([[False, True], [True, False]]))
        assert programs.none_within(step, 500) != step.search(500)
        return step.search(500)

    assert search([-1.0, -1.0], 0.3) and search([-1.0, 5.0], 0.0)


@pytest.mark.parametrize("moves, rests", [(0.0, True), (1.0, False)])
def test_a_corner_between_bodies_holds_only_what_normals_hold(moves, rests):
    """A vertex on a floor beside a wall: fixed, it rests; the side of a body that moves along the
    vertex slides past it, with the friction of its slip.
    """
    rows = np.array([[0.0, -1, 0, 0], [1, 0, -moves, 0], [1, 0, 0, 0], [0, 1, 0, -moves]])
    # u of the vertex, u of the wall
    body = SimpleNamespace(B=rows, gid=np.array([4, 4]), columns={})
    assert laws.resting(body)[1, 0] == rests  # the wall's friction
    assert laws.corners(body)[1, 0]
    for c, both in (([3.0, 0.0], True), ([3.0, 2.0], False)):  # rough sides give way
        body.columns = {"normal_compliance": np.array(c)}
        assert laws.corners(body)[1, 0] == both


def test_rough_surfaces_yield_by_their_law():
    """p = c z^m, and of contact that pulls, where m is 1, likewise; smooth ones do not."""
    body = SimpleNamespace(gid=np.arange(4), columns={
        "normal_compliance": np.array([8.0, 8.0, 8.0, 0.0]),
        "compliance_exponent": np.array([1.0, 1.0, 3.0, 1.0])}, weight=np.array([0.5, 1, 2, 1]))
    sigma_n = np.array([-4.0, 2.0, -64.0, -5.0])
    np.testing.assert_allclose(laws.closures(body, sigma_n[None]), [[0.5, -0.25, 2.0, 0.0]])
    step = 1e-6
    more = laws.closures(body, (sigma_n - step)[None]) - laws.closures(body, (sigma_n + step)[None])
    np.testing.assert_allclose(sensitivity._slopes(body, sigma_n),
                               more[0] / (2 * step * body.weight), rtol=1e-6)


def test_nothing_is_printed_by_libraries(capfd):
    """What C or the system writes while silenced does not come out, what follows does."""
    with environment.silenced():
        os.write(1, b"phase 2")
    os.write(1, b"end")
    assert capfd.readouterr().out == "end"


def test_a_wrong_refusal_is_noticed(problem):
    """Of a scene that has a solution no refusal is confirmed."""
    held, *_ = problem(CLAMPED)
    outcome = random.Outcome(3, "step 1: no equilibrium", 0.0, None)
    status, why = held.refusal([outcome, outcome])
    assert status == "FAILED" and "has a solution" in why


@pytest.mark.parametrize("apart, unique, shown, status, said", [
    (0.0, "", True, "FAILED", "cuts refuse different steps"),
    (1.0, "", True, "FAILED", "cuts refuse different steps"),
    (1.0, "not unique", False, "FAILED", "step 4 is open"),
    (1.0, "not unique", True, "refused", "of different solutions: not unique")])
def test_cuts_may_refuse_different_steps_of_different_solutions(monkeypatch, apart, unique, shown,
                                                                status, said):
    """Where they went apart before, as they may, and each refusal is confirmed by its own history.
    """
    runs = [random.Outcome(3, f"step {step}: no equilibrium", 0.0, None,
                           contact={"sigma_n": np.full((step, 2), value)})
            for step, value in ((4, 1.0), (3, 2.0))]
    told = []

    def distance(_body, one, other):
        told.append((one["sigma_n"].tolist(), other["sigma_n"].tolist()))
        return apart

    monkeypatch.setattr(judgement.laws, "distance", distance)
    monkeypatch.setattr(judgement.Problem, "not_unique", lambda self, runs: unique)
    monkeypatch.setattr(judgement.Problem, "_none_in", lambda self, outcome, step: (
        shown or step == 3, f"step {step} is {'none' if shown or step == 3 else 'open'}"))
    result, why = judgement.Problem(None, None).refusal(runs)
    assert result == status and said in why
    assert told == [([[1.0, 1.0]] * 2, [[2.0, 2.0]] * 2)]  # two steps before the third


@pytest.mark.slow
@pytest.mark.parametrize("change, why", [
    ({}, ""), ({"KKT": 1e-30}, "KKT residual"), ({"AGREEMENT": 1e-30}, "cuts differ"),
    ({"LAWS": -1.0}, "SUBDOMAINS=3: "), ({"ranks_agree": lambda *_: "other bits"}, "NP=2: other"),
], ids=lambda value: value if isinstance(value, str) and value else "")
def test_each_demand_counts(change, why, monkeypatch, tmp_path):
    """A scene without friction, which has one solution, fails for each thing asked of its runs."""
    text = BLOCK.format(support=CLAMPED).replace("macro friction() F", "// ")
    cuts = tuple({"subdomains": number} for number in "135")
    scene = generator.RandomScene(0, text, {}, cuts, {"steps": "2"})
    monkeypatch.setattr(random, "draw", lambda seed: scene)
    # residuals explain differences as small as those here; see test_residuals_explain_what_they_do
    monkeypatch.setattr(sensitivity, "explained", lambda *_: False)
    for name, value in {"ranks_agree": lambda *_: "", **change}.items():
        monkeypatch.setattr(judgement if name == "LAWS" else random, name, value)
    row = random.judge(0, tmp_path)
    assert row.status == ("FAILED" if why else "solved"), row.why
    assert why in row.why


@pytest.mark.slow
def test_other_bits_of_two_ranks_are_noticed(problem, tmp_path):
    _, path, given = problem(CLAMPED)
    scene = _scene(given)
    alone = random.run(scene, path, tmp_path, scene.cuts[1])
    assert random.ranks_agree(scene, path, tmp_path, alone) == ""
    table = alone.directory / "contact.csv"
    table.write_text(table.read_text().replace("slip", "slid"))
    assert "other bits" in random.ranks_agree(scene, path, tmp_path, alone)


# ------------------------------------------------------------------------------ what goes wrong

def test_a_crash_is_a_row(monkeypatch, tmp_path):
    """A traceback fails the scene, which is kept with the command that repeats it."""
    def crash(*_):
        raise ZeroDivisionError("of the test")

    monkeypatch.setattr("driver.runs.run.execute", crash)
    row = random.judge(SEED, tmp_path)
    assert row.status == "FAILED" and "ZeroDivisionError: of the test" in row.why
    assert f"FAMILY=random SEED={SEED} COUNT=1" in row.repeat
    kept = tmp_path / random.KEPT / f"random-{SEED}.edp"
    assert kept.read_text() == generator.draw(SEED).text and kept.name in row.repeat


def test_a_status_of_its_own_is_noticed(monkeypatch, tmp_path):
    """Cuts that end differently fail a scene."""
    statuses = iter((0, 4, 0))

    def end(scene, path, folder, cut, ranks=1):
        return random.Outcome(next(statuses), "of the test", 0.0, folder)

    monkeypatch.setattr(random, "run", end)
    row = random.judge(SEED, tmp_path)
    assert row.status == "FAILED" and "exit 4 of the test" in row.why


@pytest.mark.parametrize("height", [0.05, 0.3])
@pytest.mark.parametrize("turned", [0.0, 2.5])
def test_arcs_turn_flat_triangles_over(height, turned):
    """On a chord of 45 degrees the hole's arc is r (1 - cos 22.5) high, into the body. Of a
    triangle with its tip above the middle det F is 1 - 2 rise / height at its other vertices.
    """
    half, rise = np.pi / 8, 1 - np.cos(np.pi / 8)
    text = (f"border a4(t={turned + half}, {turned - half}) {{ x = -3.0 + 1.0*cos(t); "
            "y = 1.5e+00 + 1.0*sin(t); label = 91; }\n")
    arcs = inverted.circles(text)
    assert arcs == pytest.approx(np.array([[turned + half, turned - half, -3.0, 1.5, 1.0]]))
    angle, far = np.array([turned + half, turned - half, turned]), [1, 1, 1 - rise + height]
    xy = [-3.0, 1.5] + np.array(far)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    sub = SimpleNamespace(node_gid=np.arange(3), triangles=np.arange(3)[None], xy=xy)
    assert inverted.least_jacobian([sub], arcs) == pytest.approx(1 - 2 * rise / height)
    beside = SimpleNamespace(node_gid=np.array([0, 1, 3]), triangles=np.arange(3)[None],
                             xy=np.vstack([xy[:2], [[-3.0, 1.5]]]))
    assert inverted.least_jacobian([sub, beside], arcs) == 1.0  # a side inside the body


@pytest.mark.parametrize("cells, status", [(8, "refused"), (40, "FAILED")])
def test_a_mesh_is_too_coarse_for_arcs_by_their_own_argument(cells, status, monkeypatch, tmp_path):
    """A round hole of 8 sides turns a triangle over, one of 40 does not, whatever a run says."""
    scene = generator.draw(150000182)
    text = scene.text.replace("a4(8)", f"a4({cells})")

    def refuse(scene, path, folder, cut, ranks=1):
        return random.Outcome(2, "sides turn a triangle inside out, at (1, 2)", 0.0, folder)

    monkeypatch.setattr(random, "draw", lambda seed: replace(scene, text=text))
    monkeypatch.setattr(random, "run", refuse)
    assert random.judge(scene.seed, tmp_path).status == status


def test_a_run_that_takes_too_long_is_noticed(monkeypatch, tmp_path):
    monkeypatch.setattr(random, "LIMIT", 1e-5)
    row = random.judge(SEED, tmp_path)
    assert row.status == "FAILED" and "not finished" in row.why


@pytest.mark.slow
def test_a_process_that_dies_is_a_row(monkeypatch, tmp_path):
    """The others go on."""
    def submit(pool, task, folder):
        if task[1] == SEED + 1:
            return pool.submit(os._exit, 1)
        return pool.submit(random.died, task[1], folder)

    monkeypatch.setattr(suite, "_submitted", submit)
    with pytest.raises(DriverError, match="3 hard cases failed"):
        suite.run_suite({"family": "random", "seed": str(SEED), "count": "3", "jobs": "1",
                         "out": str(tmp_path)})
    rows = read_rows(tmp_path / "report.csv")
    assert [row["seed"] for row in rows] == [str(SEED + k) for k in range(3)]
    assert all(row["why"] == "the process died" for row in rows)
    assert (tmp_path / "random.png").stat().st_size > 0


def test_an_interrupted_suite_leaves_its_rows(monkeypatch, tmp_path):
    """Those judged so far are in report.csv, and the message says with which seed it goes on."""
    def judged(tasks, folder, jobs):
        for _, seed in tasks[:2]:
            yield random.died(seed, folder)
        raise KeyboardInterrupt

    monkeypatch.setattr(suite, "_judged", judged)
    with pytest.raises(KeyboardInterrupt) as stop:
        suite.run_suite({"family": "random", "seed": str(SEED), "count": "5", "jobs": "1",
                         "out": str(tmp_path)})
    assert [row["seed"] for row in read_rows(tmp_path / "report.csv")] == [str(SEED), str(SEED + 1)]
    assert "2 of 5 rows" in stop.value.args[0] and f"SEED={SEED + 2} COUNT=3" in stop.value.args[0]


@pytest.mark.slow
@pytest.mark.parametrize("after", [3.0, 6.0])
def test_an_interrupt_of_the_command_alone_ends_its_processes(after, tmp_path):
    """Signalled is the first process only, as a scheduler does; no other works in the directory."""
    command = [sys.executable, "-m", "driver", "hard", "FAMILY=random", f"SEED={SEED}", "COUNT=8",
               "JOBS=2", f"OUT={tmp_path / 'hard'}"]
    with subprocess.Popen(command, cwd=environment.ROOT, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as child:
        time.sleep(after)
        child.terminate()
        _, errors = child.communicate(timeout=60)
    assert child.returncode == 130 and "Traceback" not in errors
    working = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True)
    assert str(tmp_path) not in working.stdout and not (tmp_path / "hard" / "runs").exists()


def test_forces_on_other_bodies_count_by_their_rounding():
    """A node that may move and one of another body, under forces of three and of a million: two of
    its last bits are no violation of balance, a millionth of it is one.
    """
    body = SimpleNamespace(motions=np.array([[0.0], [2.0], [0.0], [0.0]]))
    assert laws.sizes(body, np.array([3.0, 0.0, 0.0, 0.0])) == pytest.approx([6.0], rel=1e-8)
    alone = laws.sizes(body, np.array([0.0, 0.0, 1e6, 0.0]))
    assert 2e6 * np.finfo(float).eps < judgement.LAWS * alone < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [
    110062, 120033, 28,  # carried without force
    120025,  # motions that fill the coarse problem
    120178, 120179, 120117, 200077,  # free bodies: balance across, starts that went astray
    120001, 110063, 300034,  # friction that changes with slip, F up to 1000
    400243, 200332,  # corners in which friction holds a vertex
    620009,  # a motion with rounding across it
    910062,  # bodies that nothing presses any more
    800025, 800365, 920089, 940038,  # stiff parts on soft ones: rounding taken for too large
    102032, 120003, 200063,  # jumps of 1e6: only rounding is left
    102052,  # squeezed all round under given friction
    120224,  # forces that two conditions at one place hand on to one another
    200083, 200092,  # loads at their zeros, cohesion along a wall
    5000583, 5000635, 5000664,  # friction of the own slip, stiff nodes beside soft ones, condensed
    20000237,  # a pivot that ends with the artificial variable at zero
    20000444, 20000572,  # stiff parts, whose residuals products round off
    20000486, 20000546,  # a corner whose state was wrong, very soft springs
    150000115,  # middles of quadratic sides that move far, no scale
    150000121,  # a slit whose lips hide the loads
    100000786,  # forces that have faded
    490000150,  # friction that displacements change holds a disc where it slides to
    510000190,  # forces of 1e-18 of the others on a body that nothing presses
    520000138])  # a stack that moves as a whole: the last digits of its way
def test_scenes_that_failed_once(seed, tmp_path):
    assert random.judge(seed, tmp_path).status == "solved"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [60000240, 80000568])
def test_a_free_body_on_two_sides_is_refused_alike(seed, tmp_path):
    """It turns without end, in states of its corner that each cut tries in its own order."""
    row = random.judge(seed, tmp_path)
    assert row.status == "refused", row.why
