"""States of contact nodes, forces on their bounds, and bodies that first come to rest."""

from types import SimpleNamespace

import constants
import numpy as np
import pytest
from mpi4py import MPI

from driver.contact import equilibrium
from driver.contact.equilibrium import rigid_equilibrium, still_balances
from driver.contact.rows import ContactRows
from driver.qp import pivots
from driver.qp.complementarity import _neighbours, lemke
from driver.qp.coulomb import BACKWARD, FORWARD, OPEN, STICK, CoulombProblem


@pytest.mark.parametrize("offset", [None, [0.0, 0.5, 0.25, 0.5]])
def test_forces_come_onto_the_bounds_of_their_states(offset):
    """Open nodes carry nothing, but for what slides without pressure; sliding ones what friction
    takes; those that stick what they have.
    """
    offset = None if offset is None else np.array(offset)
    problem = CoulombProblem(np.eye(8), np.zeros(8), np.full(4, 0.5), np.arange(4), offset=offset)
    # an open node, sliding ones both ways, one that sticks: by forces and movements
    z = np.array([1e-9, 2, 2, 2, 1e-9, 0.9, -0.9, 0.3])
    problem.load = z + np.array([-1.0, 0, 0, 0, 0.01, 1, -1, 0])
    states = problem.states(z)
    assert states.tolist() == [OPEN, FORWARD, BACKWARD, STICK]
    more = np.zeros(4) if offset is None else offset
    np.testing.assert_allclose(problem.on_bounds(z), [
        0, 2, 2, 2, 0, 1 + more[1], -1 - more[2], 0.3], atol=1e-15)
    assert z[0] == 1e-9
    one = CoulombProblem(np.eye(2), np.array([-1.0, 2.0]), np.array([0.5]), np.array([0]),
                         offset=np.array([0.75]))
    assert one.states(np.array([0.0, 0.7])).tolist() == [-FORWARD]
    np.testing.assert_allclose(one.on_bounds(np.array([0.0, 0.7])), [0.0, 0.75])


@pytest.mark.parametrize("unit", [1.0, 1e-7, 1e9])
@pytest.mark.parametrize("stiff", [1.0, 1e6, 1e9])
def test_a_stiff_body_among_soft_ones_keeps_its_digits(stiff, unit):
    """Nodes of a free body `stiff` times as stiff as the others, in the same linear system.

    In any `unit` of length over force. A multiplier may be off by its condition times a rounding,
    that of each body by itself.
    """
    rng = np.random.default_rng(5)
    root = rng.standard_normal((2, 5, 8))
    own, others = root @ root.transpose(0, 2, 1)
    compliance = unit * np.block([[own[:3, :3] / stiff, np.zeros((3, 5))],
                                  [np.zeros((5, 3)), others]])
    motions = np.zeros((8, 2))
    motions[:3] = np.column_stack([np.ones(3), [-1.0, 0.2, 1.0]])
    forces, moved = 1.0 + rng.random(8), unit * np.array([0.3, -0.7])
    problem = CoulombProblem(compliance, compliance @ forces - motions @ moved, np.zeros(0),
                             np.zeros(0, int), motions=motions, balance=motions.T @ forces)
    z = problem.solution_in(np.full(8, STICK))
    # loads are of order one and hold the stiff body's deformation in digits from `stiff` on
    np.testing.assert_allclose(z, np.append(forces, moved), rtol=1e-13 * max(1e2, 10 * stiff))
    assert problem.solves(z)


def test_states_of_forces_alone():
    """Pressing or bilateral nodes touch; what slides is told; open ones may rub by an offset."""
    problem = CoulombProblem(np.eye(6), np.zeros(6), np.full(2, 0.5), np.array([0, 2]),
                             np.array([False, False, True, False]))
    x = np.array([1.0, 0.0, -1.0, 2.0, 0.0, 0.0])
    assert problem.states_of(x, np.array([0.0, -1.0])).tolist() == [STICK, OPEN, BACKWARD, STICK]
    x[0] = 0.0
    assert problem.states_of(x, np.array([1.0, 1.0])).tolist() == [OPEN, OPEN, FORWARD, STICK]
    rubs = CoulombProblem(np.eye(6), np.zeros(6), np.full(2, 0.5), np.array([0, 2]),
                          offset=np.array([0.5, 0.0]))
    assert rubs.states_of(0 * x, np.array([1.0, 1.0])).tolist() == [-FORWARD, OPEN, OPEN, OPEN]


# ------------------------------------------------------------------------------ rest

def foot(friction=None, offset=None, **more) -> SimpleNamespace:
    """Rows of two feet at x = -1 and 1 under a rigid body, gaps 0.1 and 0.3 below them."""
    node = np.arange(2)
    return SimpleNamespace(**{
        "normal": node, "normal_node": node, "gap": np.array([0.1, 0.3]),
        "pulls": np.zeros(2, bool),
        "tangential": 2 + node, "tangential_node": node, "idle": None,
        "coefficient": None if friction is None else np.full(2, friction),
        "offset": None if offset is None else np.full(2, offset), **more})


# displacements of the rows, normals down and tangents along, by a shift down, a turn and a drag
MOTIONS = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])


def rest(rows, work, size=None, motions=MOTIONS):
    work = np.array(work, float)
    size = np.abs(work) if size is None else np.array(size, float)
    return rigid_equilibrium(rows, motions, work, size, MPI.COMM_SELF)


def test_a_body_falls_until_its_feet_bear_it():
    """Where its weight is: on both, down by 0.2 and turned by 0.1; beyond a foot it tips over."""
    np.testing.assert_allclose(rest(foot(0.5), [2.0, 0.5, 0.0]), [0.2, 0.1, 0.0], atol=1e-9)
    assert rest(foot(0.5), [2.0, 2.5, 0.0]) is None
    assert rest(foot(0.5), [-2.0, 0.0, 0.0], [2.0, 1, 1]) is None
    np.testing.assert_allclose(rest(foot(0.5, pulls=np.ones(2, bool)), [-2.0, 0.0, 0.0]),
                               [0.2, 0.1, 0.0], atol=1e-9)


@pytest.mark.parametrize("friction, offset, drag, holds", [
    (0.5, None, 0.9, True), (0.5, None, 1.1, False), (None, 0.6, 1.1, True),
    (None, 0.6, 1.3, False), (0.5, 0.1, 1.1, True), (0.5, 0.1, 1.3, False)])
def test_friction_holds_a_drag_up_to_its_bound(friction, offset, drag, holds):
    """F times the weight of 2, with what needs no pressure at two feet."""
    assert (rest(foot(friction, offset), [2.0, 0.0, drag]) is not None) == holds


def test_loads_that_only_grow_ask_for_no_other_program(monkeypatch):
    """What cannot be balanced neither; another direction or law does, and growth beside what rubs
    without pressure.
    """
    solved, solve = [], equilibrium._solve
    monkeypatch.setattr(equilibrium, "_solve", lambda *law: solved.append(law) or solve(*law))
    latest = equilibrium.Latest()

    def programs(rows, *work):
        """How many are solved for one load after another, whose answers are those of each alone."""
        before = len(solved)
        answers = [rigid_equilibrium(rows, MOTIONS, load, np.abs(load), MPI.COMM_SELF, latest)
                   for load in map(np.array, work)]
        count = len(solved) - before
        for load, answer in zip(work, answers):
            alone = rest(rows, load)
            assert (answer is None) == (alone is None)
            if alone is not None:
                np.testing.assert_allclose(answer, alone, atol=1e-9)
        return count

    down = np.array([2.0, 0.5, 0.3])
    assert programs(foot(0.5), down, 0.1 * down, 3 * down) == 1
    assert programs(foot(0.5), down * [1, 1, -4], 7 * down * [1, 1, -4]) == 1
    assert programs(foot(0.5), down, down * [1, -1, 1], -down) == 3
    assert programs(foot(0.5, gap=np.array([0.2, 0.3])), -down, down) == 2
    assert programs(foot(0.5, 0.1), down, 0.1 * down, 0.1 * down) == 2
    assert programs(foot(0.6, 0.1), 0.1 * down) == 1


def four_feet(friction=0.5, offset=None, pulls=False, idle=None) -> ContactRows:
    """Nodes in a row under a body."""
    node, offset = np.arange(4), None if offset is None else np.full(4, offset)
    return ContactRows(node, node, np.zeros(4), 4 + node, node, node, np.full(4, friction), offset,
                       np.zeros(0, int), np.full(4, pulls), idle=idle)


@pytest.mark.parametrize("rows, work, balances", [
    (four_feet(), [4.0, 0.0, 0.0], True), (four_feet(), [9.0, 2.0, 3.0], True),
    (four_feet(), [4.0, 0.0, 2.1], False),  # friction holds half the weight
    (four_feet(), [4.0, 6.5, 0.0], False),  # beyond the outer feet it tips over
    (four_feet(), [-1.0, 0.0, 0.0], False), (four_feet(pulls=True), [-1.0, 0.0, 0.0], True),
    (four_feet(offset=0.1), [4.0, 0.0, 2.1], True), (four_feet(offset=0.1), [4.0, 0.0, 2.5], False),
    (four_feet(0.0), [4.0, 0.0, 0.1], False), (four_feet(0.0), [4.0, 1.0, 0.0], True),
    (four_feet(offset=9.0, idle=np.arange(8)[::2]), [2.0, 1.0, 17.0], True),
    (four_feet(offset=9.0, idle=np.arange(8)[::2]), [2.0, 1.0, 20.0], False)])
def test_forces_of_the_step_before_show_that_contact_balances_loads(rows, work, balances):
    """Never where the linear program does not; here as often, as all feet bore the weight."""
    place = np.array([-1.5, -0.5, 0.5, 1.5])
    motions = np.zeros((8, 3))
    motions[:4, 0], motions[:4, 1], motions[4:, 2] = 1.0, place, 1.0
    x = np.append(np.ones(4), np.zeros(4))
    if rows.idle is not None:
        x[rows.idle] = 0.0
    work = np.array(work)
    found = still_balances(rows, motions, work, np.abs(work), x, MPI.COMM_SELF)
    assert found == balances
    assert balances == (rest(rows, work, motions=motions) is not None)


def test_motions_that_no_load_or_no_contact_knows():
    assert not rest(foot(0.5), [0.0, 0.0, 0.0]).any()
    nothing = foot(0.5, normal=np.zeros(0, int), normal_node=np.zeros(0, int), gap=np.zeros(0),
                   pulls=np.zeros(0, bool), tangential=np.zeros(0, int),
                   tangential_node=np.zeros(0, int), coefficient=np.zeros(0))
    assert rest(nothing, [1.0, 0.0, 0.0]) is None
    np.testing.assert_array_equal(rest(nothing, [0.0, 0.0, 0.0], [1.0, 0, 0]), 0.0)
    aside = MOTIONS.copy()
    aside[:, 2] = 0.0
    assert rest(foot(0.5), [2.0, 0.0, 0.1], motions=aside) is None  # nothing resists the drag
    np.testing.assert_allclose(rest(foot(0.5), [2.0, 0.0, 0.0], [2.0, 0, 1], aside),
                               [0.2, 0.1, 0.0], atol=1e-9)
    idle = foot(0.5, idle=np.array([1, 3]))
    assert rest(idle, [2.0, 0.0, 0.0], [2.0, 1, 1]) is None  # a single foot at -1
    np.testing.assert_allclose(rest(idle, [2.0, -2.0, 0.0])[0] - rest(idle, [2.0, -2.0, 0.0])[1],
                               0.1, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_pivots_solve_complementarity_whatever_covers(seed):
    """z >= 0, M z + q >= 0, one of them zero, for positive definite M: one solution; none needed
    where q is not negative; a ray where there is none.
    """
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((7, 9))
    M, q, found = root @ root.T, rng.standard_normal(7), []
    for cover in (np.ones(7), rng.uniform(0.05, 5.0, 7), rng.uniform(0.05, 5.0, 7)):
        z = pivots.solution(M, q, cover)
        w = M @ z + q
        assert z.min() >= 0 and w.min() >= -1e-9 and abs(z @ w) < 1e-9
        found.append(z)
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-9)
    assert not pivots.solution(M, np.abs(q), np.ones(7)).any()
    assert pivots.solution(-np.eye(2), np.array([-1.0, -2.0]), np.ones(2)) is None


@pytest.mark.parametrize("pulls, count", [(False, 2 * 3), (True, 2 * 5)])
def test_neighbours_differ_at_one_node(pulls, count):
    """In its state or, where contact pulls, the sign of the force that friction goes by."""
    rng = np.random.default_rng(2)
    root = rng.standard_normal((4, 5))
    problem = CoulombProblem(root @ root.T, np.array([1.0, 0.5, 2.0, 0.1]), np.full(2, 0.3),
                             np.arange(2), pulls)
    x = problem.load if pulls else lemke(problem)
    found = [*_neighbours(problem, x), x]
    away = [np.abs(one - other).max() for k, one in enumerate(found) for other in found[:k]]
    assert len(found) == count + 1
    assert pulls or problem.solves(x) and min(away) > 1e-9


def test_constants_that_are_called_parts_are_between_none_and_all():
    assert not constants.beyond("qp")
