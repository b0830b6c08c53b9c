"""Displacements, slips and tractions of contact nodes, at nodes made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.states import SLIP
from driver.contact.states import ContactField as C
from driver.effects import wear
from driver.effects.slip_law import Way
from driver.results.contact_state import MOVED, SLID, WORN, ContactState
from driver.results.held_nodes import HeldNodes, friction_of_held, held_along


def nodes(rng, n=3) -> SimpleNamespace:
    """Contact nodes that each meet the mean of two places of another body."""
    angle = rng.uniform(0, 2 * np.pi, n)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    return SimpleNamespace(
        gid=np.arange(n), weight=rng.uniform(1, 2, n), normal=normal, axisymmetric=False,
        xy=np.column_stack([np.arange(n), 0 * np.arange(n)]),
        tangent=np.column_stack([-normal[:, 1], normal[:, 0]]), following=None,
        normal_row=np.arange(n), tangential_row=np.arange(n),
        columns={"wear": rng.uniform(1, 2, n)},
        term_node=np.repeat(np.arange(n), 3), term_value=np.tile([1.0, -0.5, -0.5], n),
        way=lambda before, now: 0.3 * (now - before) * np.ones(n))


def made(rng, worn=False) -> ContactState:
    """The state of such nodes in a scene with two patterns of travel."""
    b = nodes(rng)
    n, k = len(b.gid), 3 * len(b.gid)
    of = object.__new__(ContactState)
    of.boundary, of.frictional = b, True
    of.operator = SimpleNamespace(comm=MPI.COMM_SELF,
                                  structure=SimpleNamespace(contact=SimpleNamespace(gid=b.gid)))
    of.rows = SimpleNamespace(normal=np.arange(n), normal_node=np.arange(n),
                              tangential=np.arange(n, 2 * n), tangential_node=np.arange(n))
    of.solver = SimpleNamespace(initial=rng.random(n), initial_weights=np.array([0.5, 0.0]),
                                cycles=None, effects=SimpleNamespace(rooms={}))
    of._travel, of._term, of._nodal = rng.random((2, n, 2)), np.arange(k), lambda moved: moved
    of._value, of._travelled = np.tile(b.term_value, (2, 1)).T, {}
    of._weights, of._time, of._before = None, 0.0, None
    of.worn, of._wear = (np.zeros(n), wear.Room.__new__(wear.Room)) if worn else (None, None)
    if worn:
        of._wear.prepare(b)
    of.constrained = np.zeros((n, 2), bool)
    of.prescribed = lambda: np.outer([2.0, 0.0], of.solver.initial)  # at time 0 they are there
    of.held_nodes = HeldNodes(b, of.solver.effects, of.solver.initial)
    of.law = SimpleNamespace(friction_bound=lambda force: 0.4 * np.abs(force))
    return of


def step(time, multipliers, weights, **more) -> SimpleNamespace:
    n = len(multipliers) // 2
    return SimpleNamespace(**{"index": 1, "time": time, "multipliers": multipliers,
                              "weights": weights, "cycle": False, "skips": 0, "grown": (),
                              "friction_bound": np.full(n, 9.0), "status": np.arange(n), **more})


def test_slips_add_up_to_the_way_over_the_obstacle():
    """Deformation and travel of the body, less the way of what it slides on; from where it was at
    the start. Tractions are forces over lengths, compression negative.
    """
    rng = np.random.default_rng(5)
    of = made(rng, worn=True)
    b, slid, worn = of.boundary, 0.0, 0.0
    for time in (0.5, 1.0, 2.0):
        moved, weights, forces = rng.random((9, 2)), rng.random(2), rng.uniform(-1, 1, 6)
        found = of.evaluate(step(time, forces, weights), moved)
        jump = moved[::3] - (moved[1::3] + moved[2::3]) / 2
        whole = jump + np.einsum("k,kni->ni", weights, of._travel)
        np.testing.assert_allclose(found[C.U_N], (whole * b.normal).sum(axis=1), rtol=1e-12)
        np.testing.assert_allclose(found[C.U_T], (whole * b.tangent).sum(axis=1), rtol=1e-12)
        np.testing.assert_allclose(found[C.SIGMA_N] * b.weight, -forces[:3], rtol=1e-12)
        np.testing.assert_allclose(found[C.SIGMA_T] * b.weight, -forces[3:], rtol=1e-12)
        np.testing.assert_allclose(found[C.BOUND] * b.weight, 9.0, rtol=1e-12)
        slid = slid + found[C.SLIP]
        worn = worn + (b.columns["wear"] * np.abs(found[C.SLIP])
                       * np.maximum(-found[C.SIGMA_N], 0.0))
        np.testing.assert_allclose(found["wear"], worn, rtol=1e-12)
    np.testing.assert_allclose(slid, found[C.U_T] - of.solver.initial - 0.3 * 2.0, rtol=1e-12)


def test_a_node_without_a_tangential_row_has_a_bound_and_no_wear():
    """A support holds it along the boundary: friction bound by its pressure. It slides as its
    support has it, which takes the friction, whether it presses or pulls; held in one direction of
    a slanted boundary it moves, and has none.
    """
    for constrained, pressing in (([True, True], 1), ([True, True], -1), ([True, False], 1)):
        of = made(np.random.default_rng(6), worn=True)
        b = of.boundary
        b.tangential_row[1], of.constrained[1] = -1, constrained
        of.rows.tangential, of.rows.tangential_node = np.array([3, 5]), np.array([0, 2])
        found = of.evaluate(step(1.0, np.array([1.0, 2.0 * pressing, 3.0, 4.0, 5.0, 6.0]),
                                 np.zeros(2), friction_bound=np.full(2, 9.0)), np.zeros((9, 2)))
        np.testing.assert_allclose(found[C.BOUND] * b.weight, [9, 0.4 * 2, 9])
        assert found["wear"][1] == 0.0 and (found["wear"][[0, 2]] > 0).all()
        force = -0.4 * 2 * np.sign(found[C.SLIP][1]) if all(constrained) else 0.0
        assert found[C.SIGMA_T][1] * b.weight[1] == pytest.approx(force)
        np.testing.assert_allclose(found["held"], [0.0, -force, 0.0])
        assert found[C.STATUS][1] == (SLIP if all(constrained) else 1)


def test_a_node_that_a_support_holds_along_the_normal_has_no_bound():
    """It has no row: what the law gives without pressure is no traction that acts on it."""
    of = made(np.random.default_rng(5))
    of.boundary.normal[1], of.boundary.tangent[1] = [1.0, 0.0], [0.0, 1.0]
    of.constrained[1] = [True, False]
    of.boundary.normal_row[1] = of.boundary.tangential_row[1] = -1
    of.rows.normal, of.rows.normal_node = np.array([0, 1]), np.array([0, 2])
    of.rows.tangential, of.rows.tangential_node = np.array([2, 3]), np.array([0, 2])
    of.law = SimpleNamespace(friction_bound=lambda force: 0.7 + 0.4 * np.abs(force))
    ended = step(1.0, np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(2))
    found = of.evaluate(ended, np.zeros((9, 2)))
    assert (found[C.BOUND] > 0).tolist() == [True, False, True] and found[C.SIGMA_T][1] == 0


def test_held_nodes_obey_laws_of_their_way():
    """The coefficient at a held node falls with the way that it has slid, or depends on where it
    is: relative to what it meets, which moves by 0.3 in a unit of time.
    """
    of = made(np.random.default_rng(7))
    b = of.boundary
    b.tangential_row[1], of.constrained[1] = -1, True
    of.rows.tangential, of.rows.tangential_node = np.array([3, 5]), np.array([0, 2])
    of.solver.initial, of.solver.initial_weights = np.zeros(3), np.zeros(2)
    places = []
    b.at = lambda time: SimpleNamespace(gap=np.zeros(3))

    def factor(u_t, slid):
        places.append((u_t[1], slid[1]))
        return 1.0 - slid

    law = SimpleNamespace(factor_at=factor, of_others=Way)
    of.held_nodes = HeldNodes(b, SimpleNamespace(rooms={"slip_law": law}), np.full(3, 0.25))
    for time, way in ((1.0, 0.3), (2.0, 0.6)):
        found = of.evaluate(step(time, np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), np.zeros(2),
                                 friction_bound=np.full(2, 9.0)), np.zeros((9, 2)))
        assert found[C.BOUND][1] * b.weight[1] == pytest.approx(0.4 * 2 * (1 - way))
        assert places[-1] == pytest.approx((0.25 - way, way))


def test_at_held_nodes_too_a_slip_law_leaves_cohesion_as_it_is():
    """It is a factor of the coefficient: 0.4 of the pressing force, half of it after 0.5."""
    law = SimpleNamespace(factor_at=lambda u_t, slid: 1.0 - slid, of_others=Way)
    b = nodes(np.random.default_rng(7))
    b.at = lambda time: SimpleNamespace(gap=np.zeros(3))
    of = HeldNodes(b, SimpleNamespace(rooms={"slip_law": law}), np.zeros(3))
    bound = of.add(SimpleNamespace(friction_bound=lambda force: 0.4 * np.abs(force) + 3.0),
                   np.ones(3, bool), np.full(3, 10.0), np.full(3, 0.5), 1.0)
    np.testing.assert_allclose(bound, 3.0 + 0.5 * 4.0)


def test_friction_of_held_nodes_stays_where_they_stop():
    """Against the slip, up to the bound; what nothing holds has its own."""
    held, bound = np.array([True, True, True, False]), np.array([2.0, 2.0, 0.5, 2.0])
    found = friction_of_held(held, bound, np.array([0.1, -0.1, 0.0, 0.1]), np.ones(4), 1.0)
    np.testing.assert_array_equal(found, [2.0, -2.0, 0.5, 0.0])
    # all stick, and slips are the rounding of displacements
    found = friction_of_held(held, bound, 1e-17 * np.array([1.0, -1.0, 0.0, 3.0]), np.zeros(4), 1.0)
    np.testing.assert_array_equal(found, 0.0)


def test_no_friction_comes_of_a_tangent_that_rounding_has_tilted():
    """At the end of a round boundary on a line of symmetry: it moves along the normal alone."""
    of = made(np.random.default_rng(8))
    b = of.boundary
    b.tangential_row[1], of.constrained[1] = -1, [True, False]
    b.tangent[1], b.normal[1] = [1.0, 2e-7], [-2e-7, 1.0]
    b.way = lambda before, now: np.zeros(3)
    of.solver.initial, of._travel[:] = np.zeros(3), 0.0
    of.rows.tangential, of.rows.tangential_node = np.array([3, 5]), np.array([0, 2])
    moved = np.array([[0.0, 1.0], [0.0, 0.5], [0.0, 0.25]] * 3)
    found = of.evaluate(step(1.0, np.ones(6), np.zeros(2), friction_bound=np.ones(2)), moved)
    assert found[C.SIGMA_T][1] == found[C.SLIP][1] == 0.0 and found[C.U_N][1] == 0.625
    assert found[C.STATUS][1] == 1


def test_nodes_on_an_axis_are_held_by_no_support():
    b = nodes(np.random.default_rng(1))
    b.tangential_row[:], b.axisymmetric = -1, True
    assert held_along(b, np.ones((3, 2), bool)).tolist() == [False, True, True]


@pytest.mark.parametrize("skips", [0, 3])
def test_what_has_grown_in_a_cycle_grows_as_much_in_each_that_is_jumped_over(skips):
    """What has not grown stays; the next cycle begins from there."""
    of = object.__new__(ContactState)
    of._begun = {MOVED: np.array([1.0, 2.0]), WORN: np.array([0.5, 0.5]), SLID: np.zeros(2)}
    of._elastic, of.worn = np.array([1.5, 1.0]), np.array([0.75, 0.5])
    of.held_nodes = SimpleNamespace(way=SimpleNamespace(slid=np.array([0.0, 0.25])))
    of._cycle_ends(SimpleNamespace(skips=skips, grown=(WORN, SLID, "of no node")))
    np.testing.assert_allclose(of.held_nodes.way.slid, [0.0, 0.25 + 0.25 * skips])
    np.testing.assert_allclose(of._elastic, [1.5, 1.0])
    np.testing.assert_allclose(of.worn, [0.75 + 0.25 * skips, 0.5])
    of._begun[SLID] = of.held_nodes.way.slid - 1.0
    before = of.held_nodes.way.slid
    of._cycle_ends(SimpleNamespace(skips=skips, grown=()))  # the march does not see held nodes
    np.testing.assert_allclose(of.held_nodes.way.slid, before + skips)
    assert of._begun[WORN] is of.worn and of._begun[MOVED] is of._elastic
    of._cycle_ends(SimpleNamespace(skips=skips, grown=(MOVED,)))
    np.testing.assert_allclose(of._elastic, [1.5, 1.0])
