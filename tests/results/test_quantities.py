"""Quantities of interest: their definitions on exact fields, what a scene has of them, regular
limits in h.
"""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from test_scenes_hertz import NU, R, hertz

from driver.effects import Effects, contact, friction
from driver.files import read_table
from driver.results import contact_edges as edges, quantities as q, summary, touch
from driver.results.record import Record
from driver.contact.states import OPEN, SLIP, STICK

A, P0 = 0.3, 2.0


def line(x, closed, pressure, opening, **more):
    """Nodes and one step on a straight boundary with ends of its own."""
    side = np.diff(x)
    weight = (np.r_[side, 0] + np.r_[0, side]) / 2
    nodes = {"xy": np.column_stack([x, 0 * x]), "arc": x - x[0], "weight": weight,
             "gap": np.zeros(len(x)),
             "chain": np.ones(len(x), int), "paired": np.zeros(len(x), bool),
             "middle": np.zeros(len(x), bool), "mirrored": np.zeros(len(x), bool)}
    steps = {"u_n": -opening, "slip": 0 * x, "sigma_n": -pressure, "sigma_t": 0 * x,
             "status": np.where(closed, STICK, OPEN), "work": 0 * x}
    return nodes, {name: more.get(name, value)[None]
                   for name, value in steps.items()}


def hertzian(h, shift):
    """Hertz's exact pressure and opening at the nodes of a mesh of size h."""
    x = np.arange(-1, 1, h) + shift * h
    s = np.maximum(np.abs(x) / A, 1.0)
    # beside the contact the gap's slope is sqrt(x^2 - a^2)/R with 1/R = 2 p0/(E' a); here E' = 2
    opening = A * P0 / 2 * (s * np.sqrt(s**2 - 1) - np.arccosh(s))
    return line(x, np.abs(x) < A, P0 * np.sqrt(np.maximum(0, 1 - (x / A) ** 2)), opening)


def values(nodes, steps, friction=""):
    return q.quantities(declared(friction), nodes, steps, np.ones(len(steps["u_n"])))[0]


def declared(friction=""):
    """Effects of a scene with contact and, if it has a name, a friction law."""
    return Effects(SimpleNamespace(rooms=dict.fromkeys(("contact", friction) if friction
                                                       else ("contact",), {}),
                                   patterns=[], contact_labels=[1], quasistatic=True, bodies=1))


def test_what_nodes_leave_open():
    """Half of the edge to a clamped node, beyond the last one in contact; a part of the edge in
    which contact ends, or in which pressure falls to less than half at the boundary's end; slip by
    what it differs from that of the next node in contact, the open one left out.
    """
    x = np.arange(7.0)
    closed = np.array([False, True, True, True, True, True, True])
    slip = np.array([9.0, 1.0, 1.0, 1.0, 1.0, 2.5, 4.0])
    nodes, steps = line(x, closed, 1.0 * closed, 1.0 * ~closed, slip=slip,
                        status=np.where(closed, SLIP, OPEN))
    assert touch.between_nodes(nodes, steps, 0) == {"peak_pressure": 0.0, "slip": 1.5,
                                                    "contact_length": touch.EDGE}
    nodes["weight"][-1] += 0.4  # half of an edge of 0.8 to a clamped node
    assert touch.between_nodes(nodes, steps, 0)["contact_length"] == pytest.approx(0.4)
    nodes, steps = line(x, x >= 0, np.array([1.0, 1, 1, 1, 1, 1, 0.25]), 0 * x)
    found = touch.between_nodes(nodes, steps, 0)["contact_length"]
    assert found == pytest.approx(touch.EDGE * 0.75)
    nodes, steps = line(x, x >= 0, np.array([4.0, 4, 4, 4, 4, 4, 1.0]), 0 * x)  # in another unit
    assert touch.between_nodes(nodes, steps, 0)["contact_length"] == pytest.approx(found)
    nodes["mirrored"][-1] = True  # pressure goes on beyond the plane of symmetry
    assert touch.between_nodes(nodes, steps, 0)["contact_length"] == 0.0


def test_contact_that_has_just_come_to_an_end_by_wear_may_end_before_it():
    """Of the last node, half an edge, what is not worn as the next: pressure does not fall there.
    The length was claimed to 0.003 % and erred by 0.48 %. Not at a node that does not wear because
    a support holds it, which is pressed more than the next.
    """
    x = np.arange(7.0)
    nodes, steps = line(x, x >= 0, np.array([9.0, 1, 1, 1, 1, 1, 0.8]), 0 * x)
    steps["wear"] = np.array([[0.0, 2, 2, 2, 2, 2, 0.5]])
    found = touch.between_nodes(nodes, steps, 0)["contact_length"]
    assert found == pytest.approx(0.5 * (1 - 0.5 / 2))
    steps["wear"][0, -1] = 1.9
    assert touch.between_nodes(nodes, steps, 0)["contact_length"] == 0.0


def test_slip_is_resolved_by_the_nodes_that_slide():
    """Twenty touch; of two that slide one or the next has the largest slip, of twelve some do."""
    x = np.arange(20.0)
    for sliding, share in ((2, 1.0), (12, touch.FEW / 12)):
        slip = np.where(x < sliding, 1.0 + x[::-1], 0.0)
        nodes, steps = line(x, x >= 0, 1 + 0 * x, 0 * x, slip=slip,
                            status=np.where(x < sliding, SLIP, STICK))
        assert touch.between_nodes(nodes, steps, 0)["slip"] == pytest.approx(share)


@pytest.mark.parametrize("last, pressure, share", [
    (18, 2.0, 1.0), (18, 1.2, touch.FEW / 12), (19, 2.0, touch.FEW / 12)])
def test_slip_that_is_largest_at_a_sharp_end_of_contact_is_not_resolved_by_many_nodes(
        last, pressure, share):
    """Under the rounded edge of a punch, which contact leaves between two nodes, slip was claimed
    to 16 % and erred by 35 %: two nodes differ by 24 %. Not where pressure falls slowly, nor at the
    end of a boundary, whose place is known.
    """
    x = np.arange(20.0)
    closed, slides = x <= last, (x <= last) & (x > last - 12)
    pressures = np.where(x == last - 1, pressure, 1.0) * closed
    nodes, steps = line(x, closed, pressures, 1.0 * ~closed, slip=np.where(slides, 1 + x, 0.0),
                        status=np.where(slides, SLIP, np.where(closed, STICK, OPEN)))
    assert touch.between_nodes(nodes, steps, 0)["slip"] == pytest.approx(share)


def test_what_touches_nowhere_is_apart():
    """By the least opening; contact is not."""
    x = np.arange(6.0)
    opening = 1.0 + 0.1 * x
    nodes, steps = line(x, x < 0, 0 * x, opening, status=np.full(6, OPEN))
    assert touch.Touch.of(nodes, steps, 0, 0).apart == pytest.approx(1.0)
    nodes, steps = line(x, x >= 0, 1 + 0 * x, 0 * x)
    assert touch.Touch.of(nodes, steps, 0, 0).apart == np.inf


def test_boundaries_of_which_nothing_touches_are_aside():
    """Beside one of which a node does, whose other nodes are not."""
    x = np.arange(6.0)
    nodes, steps = line(x, x == 0, 1.0 * (x == 0), x)
    nodes["chain"] = np.array([1, 1, 1, 2, 2, 2])
    found = touch.Touch.of(nodes, steps, 0, 0)
    np.testing.assert_allclose(found.aside[:, 0], found.beside[2:, 0])
    assert len(found.aside) == 3


def test_many_nodes_leave_less_open():
    """The place of an edge, and how far slip may be elsewhere, fall with the number of nodes beyond
    FEW; below it they are what they are. Not where contact is closed to the end of the boundary on
    all meshes, though pressure falls there.
    """
    for count in (touch.FEW - 2, touch.FEW, 2 * touch.FEW):
        x = np.arange(count + 1.0)
        closed = x < count
        slip = np.where(closed, x, 0.0)
        slip[count - 1] = count + 3.0
        nodes, steps = line(x, closed, 1.0 * closed, 1.0 * ~closed, slip=slip,
                            status=np.where(closed, SLIP, OPEN))
        found = touch.between_nodes(nodes, steps, 0)
        share = min(1.0, touch.FEW / count)
        assert found["contact_length"] == pytest.approx(touch.EDGE * share)
        assert found["slip"] == pytest.approx(5.0 * share)
        nodes, steps = line(x, x >= 0, np.where(closed, 1.0, 0.25), 0 * x)
        found = touch.between_nodes(nodes, steps, 0)
        assert found["contact_length"] == pytest.approx(touch.EDGE * 0.75)


def test_edges_to_clamped_nodes_count_where_their_end_touches():
    """At either end of the boundary, half of the edge beyond; not where the end is open, whatever
    the node before it does."""
    x = np.arange(12.0)
    for closed, lost in ((x >= 0, 0.3 + 0.2), (x < 11, 0.3), (x > 0, 0.2), ((x > 0) & (x < 11), 0)):
        nodes, steps = line(x, closed, 1.0 * closed, 1.0 * ~closed)
        nodes["weight"][0] += 0.3
        nodes["weight"][-1] += 0.2
        ends = touch.EDGE * touch.FEW / closed.sum() * np.sqrt((~closed).sum())
        found = touch.between_nodes(nodes, steps, 0)["contact_length"]
        assert found == pytest.approx(max(lost, ends))


@pytest.mark.parametrize("end, part", [(0.5, 0.5), (0.3, 1.0)])
def test_contact_may_be_lost_on_all_of_an_edge_to_a_clamped_node_if_pressure_vanishes_there(end,
                                                                                           part):
    """Of 0.8, as pressure falls to the end of it on the line through the last two; else on half."""
    x = np.arange(5.0)
    nodes, steps = line(x, x >= 0, np.array([1.0, 1, 1, 1, end]), 0 * x)
    nodes["weight"][-1] += 0.4
    assert touch.between_nodes(nodes, steps, 0)["contact_length"] == pytest.approx(0.8 * part)


def test_pressure_that_pulls_at_an_end_is_none():
    """Bilateral contact: contact may end anywhere in the last edge, and no farther."""
    x = np.arange(5.0)
    nodes, steps = line(x, x >= 0, np.array([1.0, 1, 1, 1, -3]), 0 * x)
    assert touch.between_nodes(nodes, steps, 0)["contact_length"] == pytest.approx(touch.EDGE)


def test_friction_that_drags_is_summed_by_forces():
    """A long segment with little shear is a large force: 0.9 of all is one way, or is not."""
    x = np.array([0.0, 1.0, 11.0, 12.0])
    for shear, dragged in ((-0.2, True), (-1.0, False)):
        nodes, steps = line(x, x >= 0, 1 + 0 * x, 0 * x, status=np.full(4, SLIP),
                            sigma_t=np.array([shear, 1.0, 1.0, shear]))
        assert touch.Touch.of(nodes, steps, 0, 0).dragged == dragged


def test_contact_that_is_dragged_along():
    """All nodes slide and one way; not where one sticks, nor where they part."""
    x = np.arange(6.0)
    for shear, status, dragged in ((np.ones(6), [SLIP] * 6, True),
                                   (np.ones(6), [SLIP] * 5 + [STICK], False),
                                   (np.array([1, 1, 1, 1, -1, -1]), [SLIP] * 6, False)):
        found = touch.Touch.of(*line(x, x >= 0, 1 + 0 * x, 0 * x, sigma_t=shear,
                                     status=np.array(status)), 0, 0)
        assert found.nodes == 6 and found.dragged == dragged


def test_pressures_at_ends_of_contact_may_be_infinite():
    """Also where the end node's pressure, which exceeds the others, is continued from inside; in a
    plane of symmetry unless the node beside it rubs.
    """
    x, pressure = np.arange(6.0), np.array([1.0, 1, 1, 1, 1.5, 4])
    nodes, steps = line(x, x >= 0, pressure, 0 * x)
    assert q.traction(nodes, pressure, np.arange(6))[-1] == 2.0
    assert q.singular_places(nodes, steps, 0) == ("peak_pressure",)
    nodes["mirrored"][-1] = True
    assert q.singular_places(nodes, steps, 0) == ()
    nodes, steps = line(x, x >= 0, pressure, 0 * x, sigma_t=0.3 * pressure,
                        status=np.array([STICK] * 4 + [SLIP] * 2))
    nodes["mirrored"][-1] = True
    assert q.singular_places(nodes, steps, 0) == ("peak_pressure",)


@pytest.mark.parametrize("pressure, middle, singular", [
    ([0, 1, 1, 2, 0, 0], False, True), ([0, 1, 2, 1, 0, 0], False, False),
    ([0, 0, 1, 2, 1, 0], True, True), ([1, 2, 3, 2, 1, 0], True, False)])
def test_pressures_beside_which_contact_ends_within_a_side_may_be_infinite(pressure, middle,
                                                                           singular):
    """As under a rounding that no node resolves; two nodes of quadratic elements are a side."""
    x, pressure = np.arange(6.0), np.array(pressure, float)
    nodes, steps = line(x, pressure > 0, pressure, 1.0 * (pressure == 0))
    nodes["middle"] = middle & (np.arange(6) % 2 == 1)
    nodes["mirrored"][0] = True
    assert q.singular_places(nodes, steps, 0) == (("peak_pressure",) if singular else ())


def test_tension_at_an_end_of_bilateral_contact_may_be_infinite():
    """A body that is pulled off a bilateral support: the peak is that of the tension."""
    x, tension = np.arange(6.0), np.array([1.0, 1, 1, 1, 1.5, 4])
    nodes, steps = line(x, x >= 0, -tension, 0 * x)
    assert q.singular_places(nodes, steps, 0) == ("peak_pressure",)
    nodes, steps = line(x, x >= 0, -tension[[0, 1, 5, 4, 1, 0]], 0 * x)
    assert q.singular_places(nodes, steps, 0) == ()


@pytest.mark.parametrize("sign", (1, -1))
def test_pressures_that_alternate_leave_their_peak_open(sign):
    """By as much as they are off an even one, in tension too; not at an edge of contact. On sides
    of 1 and 2 half of what a parabola stands out from the line between its neighbours.
    """
    x = np.arange(6.0)
    for pressure, left in (([9, 9.7, 10.3, 9.7, 10.3, 9], 0.3), ([9, 10, 11, 12, 13, 13.5], 0.0),
                           ([0, 10.3, 9.7, 10, 9.7, 9], 0.0)):
        nodes, steps = line(x, np.array(pressure) > 0, sign * np.array(pressure), 0 * x)
        assert touch.between_nodes(nodes, steps, 0)["peak_pressure"] == pytest.approx(left)
    x = np.array([-2.0, -1, 0, 2, 3])
    nodes, steps = line(x, x > -9, sign * (10 - x**2), 0 * x)
    assert touch.between_nodes(nodes, steps, 0)["peak_pressure"] == pytest.approx(1.0)


@pytest.mark.parametrize("curvature, error", [(0.0, 2.0), (0.2, 2.0), (0.2, 0.5), (0.2, 0.0)])
def test_a_node_that_stands_out_alone_leaves_its_own_error_open(curvature, error):
    """On a parabola with one pressure that is too high; without an error half of what the parabola
    stands out.
    """
    x = np.arange(-3.0, 4.0)
    pressure = 30 - curvature * x**2
    pressure[3] += error
    nodes, steps = line(x, x > -9, pressure, 0 * x)
    left = max(error, (curvature + error) / 2)
    assert touch.between_nodes(nodes, steps, 0)["peak_pressure"] == pytest.approx(left)


def test_the_peak_of_bilateral_contact_is_where_it_pulls_or_presses_most():
    x = np.arange(6.0)
    nodes, steps = line(x, x >= 0, np.array([2.0, 1, 1, -5, -1, 0]), 0 * x)
    assert q.peak_nodes(nodes, steps, 0).tolist() == [2, 3, 4]


def test_a_node_of_another_boundary_says_nothing_of_the_largest_slip():
    """The last node of one has slid farthest, the first of the other, the next in number, not.

    Nodes that have slid and touch no more say what they said, those that never touched nothing.
    """
    x = np.arange(6.0)
    slip = np.array([0.0, 1.0, 2.0, 9.0, 0.5, 0.0])
    nodes, steps = line(x, x >= 0, 1.0 + x, 0 * x, slip=slip, status=np.full(6, SLIP))
    nodes["chain"] = np.array([1, 1, 1, 1, 2, 2])
    assert touch.between_nodes(nodes, steps, 0)["slip"] == pytest.approx(7.0)
    steps["slip"] = np.array([[0.0, 1.0, 2.0, 0.4, 9.0, 3.0]])
    assert touch.between_nodes(nodes, steps, 0)["slip"] == pytest.approx(6.0)
    steps["status"][0, 4:] = OPEN, OPEN
    steps["status"] = np.vstack([np.full((1, 6), SLIP), steps["status"]])
    steps["slip"] = np.vstack([steps["slip"], 0 * steps["slip"]])
    steps["sigma_n"] = np.vstack([steps["sigma_n"]] * 2)
    assert touch.between_nodes(nodes, steps, 1)["slip"] == pytest.approx(6.0)
    steps["status"][0, 5] = OPEN
    assert touch.between_nodes(nodes, steps, 1)["slip"] == 0.0


@pytest.mark.parametrize("pressure, bay", [
    ([6, 6, 6, 0.6, 4, 4, 4], 0.9 + 0.85), ([6, 6, 6, 4, 6, 6, 6], 0.0),
    ([6, 6, 6, 3, 4, 4, 4], 0.0),
    ([6, 3.2, 6, 6, 6, 6, 6], 0.0), ([6, 6, 6, -1, 4, 4, 4], 0.0)])
def test_contact_may_be_lost_in_a_dip_of_pressure(pressure, bay):
    """A block over a step in the floor: all meshes closed it, and claimed 0.00 % of the length for
    9.4 %. Not beside ends, where pressure rises, nor where bilateral contact pulls.
    """
    x, pressure = np.arange(7.0), np.array(pressure, float)
    nodes, steps = line(x, x >= 0, pressure, 0 * x)
    level = pressure[0] == pressure[1]  # else there is doubt of the end
    length = touch.between_nodes(nodes, steps, 0)["contact_length"]
    assert not level or length == pytest.approx(bay)
    found = touch.Touch.of(nodes, steps, 0, 0)
    assert found.edges == pytest.approx(bay + 2)  # and the sides at both ends
    steps["status"][0, 3] = OPEN
    assert touch.Touch.of(nodes, steps, 0, 0).edges == pytest.approx(4)


def test_what_an_obstacle_moves_past_open_nodes_says_nothing_of_the_largest_slip():
    """A bed goes 3 farther while one node alone touches it, which itself moves by 0.2: as far as a
    node that touched as well would have slid. Without an obstacle all of it is the node's own,
    also where u_t changes by less as contact follows it round a bend.
    """
    x = np.arange(4.0)
    nodes, first = line(x, x >= 0, 1.0 + 0 * x, 0 * x, slip=1.0 + 0 * x, status=np.full(4, SLIP))
    nodes["driven"] = x >= 0
    steps = {name: np.vstack([column, column]) for name, column in first.items()}
    steps["slip"][1, 1], steps["status"][1, [0, 2, 3]] = 3.0, OPEN
    steps["u_t"] = np.zeros((2, 4))
    steps["u_t"][1, 1] = 0.2
    assert touch.between_nodes(nodes, steps, 1)["slip"] == pytest.approx(0.2)
    still = nodes | {"driven": x < 0}
    assert touch.between_nodes(still, steps, 1)["slip"] == pytest.approx(3.0)
    steps["u_t"] = np.cumsum(steps["slip"], axis=0)
    assert touch.between_nodes(nodes, steps, 1)["slip"] == pytest.approx(3.0)


def test_slip_is_that_of_the_edge_where_contact_once_was():
    """Contact up to 4.4 slides by 1 + x/4, then recedes to 2.4 and slides by a tenth of that: the
    point that has slid farthest lies at 4.4, and no way becomes shorter.
    """
    x = np.arange(8.0)
    move, shrinks = 1 + x / 4, (4.4, 2.4, 2.4)
    found = [line(x, x < end, np.sqrt(np.maximum(end - x, 0)),
                  np.maximum(x - end, 0) ** 1.5, slip=part * move,
                  status=np.where(x < end, SLIP, OPEN)) for end, part in zip(shrinks, (1, 0.1, 0))]
    nodes = found[0][0]
    steps = {name: np.concatenate([each[name] for _, each in found]) for name in found[0][1]}
    ways = q.longest_ways(nodes, np.arange(8), steps)
    assert ways == pytest.approx(3 * [1 + 4.4 / 4], rel=1e-12)


def test_slip_does_not_exceed_a_node_whose_neighbour_was_open_meanwhile():
    """Node 3 slides by 1, then by 3 while node 2 is open, then all but node 0 by 1: nodes 2 and 4
    have gone ways of 2 and 4, and no parabola through 2, 5, 4 says that a point went by more.
    Where node 2 had only stuck it might have.
    """
    x, largest = np.arange(6.0), {}
    for state in (OPEN, STICK):
        slip = np.array([[0, 1, 1, 1, 1, 1], [0, 0, 0, 3, 2, 1], [0, 1, 1, 1, 1, 1.0]])
        status = np.where(slip > 0, SLIP, STICK)
        status[1, 2] = state
        steps = {"slip": slip, "status": status, "gap": 0 * slip, "u_n": 0 * slip,
                 "sigma_n": np.where(status == OPEN, 0.0, -1.0)}
        nodes = line(x, x >= 0, 1 + 0 * x, 0 * x)[0]
        largest[state] = q.longest_ways(nodes, np.arange(6), steps)[-1]
    assert largest[OPEN] == 5.0
    assert largest[STICK] > 5.0


def arriving(pressure, gap=0.1, others=0.0):
    """Node 2 of five touches in the first of three steps, in which it slides by 3, 2 and 1; another
    slides by as much in each.
    """
    x = np.arange(5.0)
    nodes = line(x, x >= 0, 1 + 0 * x, 0 * x)[0]
    nodes["gap"] = np.where(x == 2, gap, 0.0)
    slip = np.zeros((3, 5))
    slip[:, 2], slip[:, 4] = (3, 2, 1), others
    sigma = np.full((3, 5), -1.0)
    sigma[:, 2] = -np.array(pressure)
    return nodes, {"slip": slip, "status": np.where(slip > 0, SLIP, STICK), "gap": 0 * slip,
                   "u_n": 0.1 + 0 * slip, "sigma_n": sigma}


@pytest.mark.parametrize("pressure, more, left", [
    ([1.0, 5.0, 6.0], {}, 2.25),  # it grew by 4 in a step: in contact for a quarter of the first
    ([1.0, 1.5, 2.0], {}, 0.0),  # in all of it
    ([1.0, 5.0, 6.0], {"gap": 0.0}, 0.0),  # in contact from time 0 on
    ([1.0, 5.0, 6.0], {"others": 5 / 3}, 1.0)])  # another has gone 5 in contact
def test_steps_leave_open_what_was_slid_while_contact_began(pressure, more, left):
    assert touch.of_arrivals(*arriving(pressure, **more)) == pytest.approx(left)


@pytest.mark.parametrize("more, part", [
    ({}, 3 / 6), ({"gap": 0.0}, 0.0), ({"others": 2.5}, 0.0)])
def test_part_of_the_farthest_way_that_was_made_in_the_step_of_touching(more, part):
    """None where the node touched from time 0 on, nor of another that has gone farther."""
    assert touch.slid_on_arrival(*arriving([1.0, 1.5, 2.0], **more)) == pytest.approx(part)


def test_a_node_that_turned_on_touching_may_have_slid_as_far_as_in_the_next_step():
    """In contact for half of the first step, whose way is but 0.1 where the next one is 2."""
    nodes, steps = arriving([1.0, 3.0, 5.0])
    steps["slip"][0, 2] = -0.1
    assert touch.of_arrivals(nodes, steps) == pytest.approx(2 - 0.05)


def test_contact_that_is_found_again_leaves_half_of_its_last_step_open():
    nodes, steps = arriving([1.0, 0.0, 1.0], gap=0.0)
    steps["status"][1, 2] = OPEN
    assert touch.of_arrivals(nodes, steps) == pytest.approx(0.5)


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.7])
def test_nodes_tell_by_how_much_they_place_the_ends_of_contact_apart(shift):
    """The first two open nodes place them elsewhere than the next two do, by half of what these err
    or more, and by less on a finer mesh; where one node follows, by a part of the edge.
    """
    doubts = []
    for h in (0.05, 0.025):
        nodes, steps = hertzian(h, shift)
        piece = np.arange(len(nodes["arc"]))
        doubts.append(edges.doubt_of_ends(nodes, piece, steps, 0))
        found = edges.contact_length(nodes, [piece], steps, 0)
        assert abs(found - 2 * A) / 2 < doubts[-1] < 0.2 * h
        assert touch.Touch.of(nodes, steps, 0, 0).doubt == doubts[-1]
        # the other way round, too
        turned = {name: column[:, ::-1] for name, column in steps.items()}
        mirror = nodes | {"arc": nodes["arc"][-1] - nodes["arc"][::-1]}
        assert edges.doubt_of_ends(mirror, piece, turned, 0) == pytest.approx(doubts[-1])
    assert doubts[1] < 0.7 * doubts[0]
    x, closed = np.arange(4.0), np.array([True, True, True, False])
    nodes, steps = line(x, closed, 1.0 * closed, 0.1 * ~closed)
    assert edges.doubt_of_ends(nodes, np.arange(4), steps, 0) == edges.EDGE
    nodes, steps = line(x, x < 0, 0 * x, 1 + x)
    assert edges.doubt_of_ends(nodes, np.arange(4), steps, 0) == 0.0


@pytest.mark.parametrize("shift", np.linspace(0, 0.9, 7))
def test_contact_length_and_peak_lie_between_nodes(shift):
    """On exact nodal values: the opening's 2/3 power bends by r/a, so the edge errs by 3 h (h/a)/10
    at most, not by h.
    """
    for h in (0.04, 0.02, 0.01):
        found = values(*hertzian(h, shift))
        assert abs(found["contact_length"] - 2 * A) < 2 * 0.3 * 3 * h * h / A
        # the parabola through three points of p0 (1 - (x/a)^2/2 - (x/a)^4/8): fourth order
        assert abs(found["peak_pressure"] / P0 - 1) < (h / A) ** 4
        assert found["normal_resultant"] == pytest.approx(np.pi * A * P0 / 2, rel=(h / A) ** 1.5)


@pytest.mark.parametrize("shift", [0.0, 0.35, 0.8])
@pytest.mark.parametrize("ends", [(0,), (3, 9, 10), (5, 6, 30)])
def test_lengths_of_labels_sum_to_that_of_all_wherever_labels_end(shift, ends):
    """An edge, and the end of contact in it, belongs to one label; a common vertex to both."""
    nodes, steps = hertzian(0.04, shift)
    n = len(nodes["arc"])
    edge_label = np.searchsorted(ends, np.arange(n - 1), side="right")
    shares = np.zeros((len(ends) + 1, n))
    for side in (slice(0, n - 1), slice(1, n)):
        np.add.at(shares, (edge_label, np.arange(n)[side]), 0.5)
    shares /= shares.sum(axis=0)
    whole = edges.contact_length(nodes, edges.chains(nodes), steps, 0)
    lengths = edges.contact_lengths(nodes | {"shares": shares}, edges.chains(nodes), steps, 0)
    assert lengths.sum() == pytest.approx(whole)
    closed = steps["status"][0] != OPEN
    inside = np.diff(nodes["arc"]) * (closed[1:] & closed[:-1])
    for k, length in enumerate(lengths):
        own = edge_label == k
        beside = own & (closed[1:] != closed[:-1])
        least = inside[own].sum()
        assert least - 1e-12 <= length <= least + np.diff(nodes["arc"])[beside].sum() + 1e-12


@pytest.mark.parametrize("scale", [1.0, 7.0])
def test_a_single_open_node_leaves_the_edge_to_the_pressure(scale):
    """Which vanishes like the root of the distance: 0.3 beyond the last node that touches, at
    either end of the boundary; half of the edge where a single node presses.
    """
    x = np.arange(6.0)
    pressure = scale * np.sqrt(np.maximum(4.3 - x, 0.0))
    for end in (1, -1):
        nodes, steps = line(x, (x < 5)[::end], pressure[::end], 1.0 * (x == 5)[::end])
        length = edges.contact_length(nodes, edges.chains(nodes), steps, 0)
        assert length == pytest.approx(4.3)
    nodes, steps = line(x[:2], np.array([True, False]), np.array([scale, 0]), np.array([0, 1.0]))
    assert edges.contact_length(nodes, edges.chains(nodes), steps, 0) == pytest.approx(0.5)


def test_a_peak_is_that_of_a_parabola_unless_contact_ends_beside_it():
    """Exact of a parabola on any three nodes; a node beside which nothing presses, or the last one
    of a boundary, has the peak itself.
    """
    x = np.array([-0.7, 0.1, 0.4, 2.0])
    assert q.peak(x, 3.0 - (x - 0.3)**2) == pytest.approx(3.0, rel=1e-14)
    assert q.peak(x, np.array([0.0, 2.0, 1.9, 0.5])) == 2.0
    assert q.peak(x, np.array([1.0, 2.0, 1.9, 0.5])) > 2.0
    assert q.peak(x, np.array([3.0, 2.9, 1.0, 0.0])) == 3.0 == q.peak(-x, np.array([0, 1, 2, 3.0]))


def test_edges_on_clamped_nodes_and_ends_of_the_boundary():
    x = np.linspace(0, 1, 11)
    nodes, steps = line(x, np.ones(11, bool), np.ones(11), 0 * x)
    assert values(nodes, steps)["contact_length"] == pytest.approx(1.0, rel=1e-12)
    clamped = {name: column[1:] for name, column in nodes.items()}  # the first node has no row
    steps = {name: column[:, 1:] for name, column in steps.items()}
    assert values(clamped, steps)["contact_length"] == pytest.approx(1.0, rel=1e-12)
    # that node alone: the edge to the clamp, and no dual segment beside it; openings that rise
    # steeply and no further put the edge of contact at the node
    one = {name: column.copy() for name, column in steps.items()}
    one["status"][0, 1:] = OPEN
    one["u_n"][0, 1:] = -np.linspace(1.0, 1.1, 9)
    assert values(clamped, one)["contact_length"] == pytest.approx(0.1, rel=1e-12)
    # beside the clamp: its edge is open as a whole, the next one in part
    steps["status"][0, 0] = OPEN
    assert 0.8 <= values(clamped, steps)["contact_length"] <= 0.9


@pytest.mark.parametrize("count", [12, 40])
@pytest.mark.parametrize("paired, curved", [(False, 1.0), (False, 1.0 + 1e-3), (True, 1.0)])
def test_a_ring_of_quadratic_elements_that_is_closed_has_its_length(count, paired, curved):
    """The edge that closes it counts once: by its chord, whatever the weights at its ends say.

    They are integrals of the shape functions over edges, of curved ones by their arcs; those of
    pairs are dual segments.
    """
    angle = 2 * np.pi * np.arange(2 * count) / (2 * count)
    x, middle = 5 * np.column_stack([np.cos(angle), np.sin(angle)]), np.arange(2 * count) % 2 == 1
    side = float(np.linalg.norm(x[1] - x[0]))
    nodes, steps = line(side * np.arange(2.0 * count), np.ones(2 * count, bool),
                        np.ones(2 * count), np.zeros(2 * count))
    share = np.where(middle, 2, 1) / (3 / 2) if not paired else np.where(middle, 4, 2) / 3
    nodes |= {"xy": x, "middle": middle, "weight": share * side * curved,
              "paired": np.full(2 * count, paired)}
    length = values(nodes, steps)["contact_length"]
    assert length == pytest.approx(2 * count * side, rel=1e-12)


THREE = """include "scene.idp"
real turned = physical("turned", 0.), apart = physical("apart", 0.);
int[int] sides = [1, 22, 3, 44];
mesh a = square(8, 4, [4.*x, 2.*y], label = sides);
mesh b = square(7, 5, [4. + apart + 3.*x, 3.*y], label = sides);
mesh c = square(7, 4, [-3. - apart + 3.*x, 2.5*y], label = sides);
if (turned > 0.5) { addBody(c) bodyMaterial("c", 1e4, 0.3); }
addBody(b) bodyMaterial("b", 2e4, 0.2);
addBody(a) bodyMaterial("a", 1e4, 0.3);
if (turned < 0.5) { addBody(c) bodyMaterial("c", 1e4, 0.3); }
macro support() on(3, u1 = 0.) //
macro contact() 1 //
macro gap() (-0.001*(1. + cos(x))) //
macro load1() traction(3, 0., -20.) //
include "export.idp"
"""


@pytest.mark.parametrize("options", [{}, {"turned": 1}, {"apart": 0.5}, {"element": "P2"}])
@pytest.mark.some(2)
def test_bodies_side_by_side_on_one_label_are_pieces_of_its_boundary(solved, named_scene, options):
    """In whatever order they come: the end of one and the start of the next have one arc."""
    run = solved(named_scene("three", THREE), **options)
    assert run.status == 0, run.reason
    assert (run.contact["status"] != "open").all()
    assert run.summary["quantities"]["contact_length"] == pytest.approx(10.0, rel=1e-9)
    x, arc = run.contact["x"][-1], run.contact["arc"][-1]
    pieces = np.split(np.arange(len(x)), np.flatnonzero(np.diff(arc) < 1e-9) + 1)
    assert len(pieces) == 3
    for piece in pieces:  # in either direction
        assert len(set(np.sign(np.diff(x[piece])))) == 1


@pytest.mark.parametrize("touching, expected", [
    ([5], 0.1), ([0], 0.05), ([10], 0.05), ([2, 8], 0.2), ([4, 5], 0.1), ([], 0.0)])
def test_a_node_that_touches_alone_counts_by_its_dual_segment(touching, expected):
    """Openings grow from it like |x|, whose 2/3 power puts the edge of contact behind the node; a
    neighbour in contact gives the length itself.
    """
    x = np.linspace(0, 1, 11)
    closed = np.isin(np.arange(11), touching)
    away = np.abs(x[:, None] - x[touching]).min(axis=1, initial=9.0)
    nodes, steps = line(x, closed, 1.0 * closed, np.where(closed, 0.0, 0.1 + away))
    assert values(nodes, steps)["contact_length"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("clamped", [1, 2], ids=["vertex next", "middle next"])
def test_quadratic_nodes_beside_a_clamped_end(clamped):
    """Edges of length 0.2 over [0, 1], whose first node or first two are clamped: closed
    everywhere, all of it counts.
    """
    x = np.linspace(0, 1, 11)
    nodes, steps = line(x, np.ones(11, bool), np.ones(11), 0 * x)
    middle = np.arange(11) % 2 == 1
    nodes |= {"middle": middle,
              "weight": 0.2 / 6 * np.where(middle, 4, np.where((x == 0) | (x == 1), 1, 2))}

    def cut(columns, axis):
        return {name: np.delete(column, np.s_[:clamped], axis)
                for name, column in columns.items()}

    length = values(cut(nodes, 0), cut(steps, 1))["contact_length"]
    # up to the last clamped node
    assert length == pytest.approx(1.0 - 0.1 * (clamped - 1), rel=1e-12)


def test_ring_and_separate_pieces():
    angle = np.arange(12) * np.pi / 6
    side = 2 * np.sin(np.pi / 12)
    one = np.ones(12)
    ring = {"xy": np.column_stack([np.cos(angle), np.sin(angle)]), "arc": side * np.arange(12),
            "weight": side * one,
            "gap": 0 * one, "chain": one, "paired": one < 0, "middle": one < 0,
            "mirrored": one < 0}
    steps = {"u_n": 0 * one, "slip": 0 * one, "sigma_n": -one, "sigma_t": 0 * one,
             "status": STICK * one}
    assert values(ring,
                  {k: v[None] for k, v in steps.items()})["contact_length"] == pytest.approx(
                      12 * side, rel=1e-12)
    x = np.r_[np.linspace(0, 1, 6), np.linspace(3, 4, 6)]
    nodes, steps = line(x, np.ones(12, bool), np.ones(12), 0 * x)
    nodes["arc"] = np.r_[np.linspace(0, 1, 6), np.linspace(1, 2, 6)]
    assert len(edges.chains(nodes)) == 2


def test_an_end_nodes_pressure_comes_from_inside():
    x = np.linspace(0, 1, 11)
    pressure = 1 + x
    pressure[-1] = 3.0  # what half a dual segment makes of 2
    assert values(*line(x, np.ones(11, bool), pressure,
                        0 * x))["peak_pressure"] == pytest.approx(2.0, rel=1e-12)


def test_slip_counts_in_contact_only_and_moment_is_that_of_load():
    x, closed = np.linspace(0, 1, 11), np.ones(11, bool)
    nodes, step = line(x, closed, np.ones(11), 0 * x)
    steps = {name: np.repeat(column, 3, axis=0) for name, column in step.items()}
    steps["slip"][:] = 0.5
    steps["sigma_t"][:] = np.array([-0.1, -0.2, -0.4])[:, None]
    steps["status"][0], steps["status"][1:] = SLIP, STICK
    steps["status"][2] = OPEN
    steps["sigma_n"][:] *= np.array([1.0, 2.0, 0.0])[:, None]
    steps["work"] = np.array([0.1, 0.2, 0.0])
    found, at = q.quantities(declared("friction"), nodes, steps, np.ones(3))
    assert at == 1 and found["normal_resultant"] == pytest.approx(2.0)
    assert found["slip"] == pytest.approx(0.5) and found["dissipated_energy"] == pytest.approx(0.3)
    assert found["tangential_resultant"] == pytest.approx(-0.2)


def test_a_run_has_what_its_scene_gives_sense_to(solved):
    def of(scene, **options):
        return solved(scene, **options).summary

    assert list(of("cantilever", cells=4)["quantities"]) == ["displacement"]
    assert list(of("hertz", h=0.006)["quantities"]) == [*contact.Room.quantities, "displacement"]
    bar = of("bar", cells=2)
    assert bar["quantities_time"] == 1.0  # the wall is left again by the end
    # where it is never reached, too: the pull's largest displacement, and not that of a first step
    free = of("bar", cells=2, gap=0.01)
    modulus = 210e3 * 0.7 / (1.3 * 0.4)
    assert free["quantities_time"] == 1.0
    assert free["quantities"]["displacement"] == pytest.approx(10 * 200 / modulus, rel=0.02)
    # closed form: the wall takes what M g/L leaves of the pull
    assert bar["quantities"]["peak_pressure"] == pytest.approx(200 - modulus * 0.005 / 10, rel=1e-5)
    assert of("pressfit")["quantities"]["contact_length"] == pytest.approx(np.pi * 10, rel=1e-4)
    model = solved("model", loading="nonmonotone")
    found, last = model.summary["quantities"], {name: column[-1]
                                                for name, column in model.history.items()}
    lengths = np.where(model.contact["status"] != "open", model.contact["weight"], 0.0)
    side = 2.0 / 40  # of an element: contact ends somewhere along it
    np.testing.assert_allclose(model.history["contact_length"], lengths.sum(axis=1), atol=side)
    assert found["contact_length"] == pytest.approx(last["contact_length"], rel=1e-12)
    assert set(found) == {*contact.Room.quantities, *friction.Room.quantities, "displacement"}
    assert found["normal_resultant"] == pytest.approx(-last["resultant_n"], rel=1e-12)
    assert found["tangential_resultant"] == pytest.approx(last["resultant_t"], rel=1e-12)
    assert found["dissipated_energy"] == pytest.approx(last["dissipated"], rel=1e-12)


@pytest.mark.slow
def test_limits_in_h_are_regular(solved):
    """Hertz: the closed form errs by (a/R)^2 = 0.1%; each quantity's error stays below a
    first-order line.
    """
    for h in (0.008, 0.004, 0.002):
        found = solved("hertz", h=h).summary["quantities"]
        a, p0 = hertz(found["normal_resultant"], NU)
        error = [abs(found["peak_pressure"] / p0 - 1), abs(found["contact_length"] / (2 * a) - 1)]
        # one tenth of h/a, far below the h/a of a count of nodes
        assert max(error) < 0.1 * h / a + (a / R) ** 2


def test_slip_reaches_to_the_edge_of_contact():
    """Slip that grows to an edge of contact at x = 0.66, between nodes: neither the last node's nor
    an overshoot.
    """
    x = np.linspace(0, 1, 11)
    opening = np.maximum(x - 0.66, 0) ** 1.5
    nodes, steps = line(x, x < 0.66, np.maximum(0.66 - x, 0) ** 0.5, opening, slip=2 * x,
                        status=np.where(x < 0.66, SLIP, OPEN))
    assert values(nodes, steps, "friction")["slip"] == pytest.approx(2 * 0.66, rel=1e-9)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_outline_with_roles_and_tractions(solved, element):
    """Clamped left, in contact at the bottom, pressed at the top, pulled at the right side."""
    with open(solved("model", STEPS=2, CELLS=3, ELEMENT=element).directory / "boundary.csv",
              newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * (12 + 6)
    expected = {"1": ("contact", 0, 0), "2": ("load", 3e7, 5e7), "3": ("load", 0, -1e8),
                "4": ("support", 0, 0)}
    for row in rows:
        role, x, y = expected[row["label"]]
        assert row["role"] == role
        # sums of some ten nodal forces over sums of as many lengths
        assert float(row["traction_x"]) == pytest.approx(x, rel=1e-13)
        assert float(row["traction_y"]) == pytest.approx(y, rel=1e-13)
        held = str(int(role == "support"))
        assert [row["fixed_x"], row["fixed_y"], row["moved_x"]] == [held, held, "0.0"]
    loads = solved("model", STEPS=2, CELLS=3, ELEMENT=element).summary["loads"]
    assert {load["effect"] for load in loads} == {"traction"}
    total = np.sum([load["force"] for load in loads], axis=0)
    assert total == pytest.approx([3e7, 5e7 - 2e8], rel=1e-9)  # the top is 2 long, the side 1


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_the_history_is_that_of_the_nodes(solved, element):
    """Sums and counts of every step's rows of contact.csv; reactions balance the loads.

    The largest pressure and the length in contact, which nodes give to a side, are the same in all
    tables.
    """
    run = solved("model", STEPS=2, CELLS=3, ELEMENT=element)
    table = read_table(run.directory / "boundaries.csv")
    for name in ("peak_pressure", "contact_length"):
        values = run.history[name].tolist()
        assert values == [float(value) for value in table[name]]
        assert values[-1] == run.summary["quantities"][name]
    h, c = run.history, run.contact
    names = np.array(["open", "stick", "slip"])
    assert h["step"].tolist() == [1, 2] and h["time"].tolist() == [0.5, 1.0]
    for k in range(2):
        weight, status = c["weight"][k], c["status"][k]
        for name in names:
            assert h[f"nodes_{name}"][k] == np.count_nonzero(status == name)
        touching = status != "open"
        assert 0 < np.count_nonzero(touching)
        assert h["peak_pressure"][k] == pytest.approx(-c["sigma_n"][k].min(), rel=0.2)
        assert h["resultant_n"][k] == pytest.approx(-weight @ -c["sigma_n"][k], rel=1e-12)
        assert h["resultant_t"][k] == pytest.approx(weight @ c["sigma_t"][k], rel=1e-12)
        assert h["contact_length"][k] == pytest.approx(weight[touching].sum(), abs=2.0 / 12)
        # normals point down, tangents to the right
        assert h["contact_x"][k] == pytest.approx(weight @ c["sigma_t"][k], rel=1e-12)
        assert h["contact_y"][k] == pytest.approx(-weight @ c["sigma_n"][k], rel=1e-12)
        for axis in "xy":
            total = sum(h[f"{of}_{axis}"][k] for of in ("load", "reaction", "contact"))
            assert abs(total) <= 1e-6 * abs(h["load_y"][k])
        assert h["fixed_point_iterations"][k] >= 1 and h["dual_multiplications"][k] >= 1
    work = run.summary["quantities"]["dissipated_energy"]  # a sum in another order
    assert h["dissipated"][0] <= h["dissipated"][1] == pytest.approx(work, rel=1e-13)
    assert h["max_displacement"][-1] == pytest.approx(run.summary["quantities"]["displacement"])


RING = """include "scene.idp"
units("m", "Pa");
subdomains("3");
border outer(t = 0, 2*pi) { x = cos(t); y = sin(t); label = 7; }
border inner(t = 0, 2*pi) { x = 0.5*cos(t); y = 0.5*sin(t); label = 3; }
body = buildmesh(outer(40) + inner(-24));
macro young() 1e3 //
macro poisson() 0.3 //
macro load1() pressure(7, 2.) //
macro displacement2() on(3, u1 = 0.001, u2 = 0.) //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_outline_of_a_ring_under_pressure(solved, tmp_path, element):
    """The traction follows the normal, edge by edge, and the body is on the left of every edge."""
    path = tmp_path / "ring.edp"
    path.write_text(RING)
    with open(solved(path, ELEMENT=element).directory / "boundary.csv", newline="") as file:
        rows = [{name: value if name == "role" else float(value) for name, value in row.items()}
                for row in csv.DictReader(file)]
    assert len(rows) == 64
    for row in rows:
        along = np.array([row["x1"] - row["x0"], row["y1"] - row["y0"]])
        out = np.array([along[1], -along[0]]) / np.linalg.norm(along)
        middle = np.array([row["x0"] + row["x1"], row["y0"] + row["y1"]]) / 2
        if row["label"] == 7:
            assert out @ middle > 0.9 and row["role"] == "load"
            # nodal forces of a polygon are 2 cos(pi/40) times the length: 3e-3 less
            assert [row["traction_x"], row["traction_y"]] == pytest.approx(-2 * out, abs=0.01)
        else:
            assert out @ middle < -0.4 and row["role"] == "support"
            assert [row["fixed_x"], row["fixed_y"]] == [1, 1]
            assert [row["moved_x"], row["moved_y"]] == [0.001, 0]


def test_a_node_that_is_missing_on_a_curve_does_not_end_it():
    """The middle of a curved side on an axis has no condition: contact is as long as the arc; in a
    corner another boundary begins.
    """
    angle = np.delete(np.linspace(0, 0.5, 26), 1)
    apart = angle - 0.3
    nodes, steps = line(angle, apart < 0, np.maximum(0.0, -apart), np.maximum(0.0, apart))
    nodes["xy"] = np.column_stack([np.sin(angle), np.cos(angle)])
    assert len(edges.chains(nodes)) == 1
    length = edges.contact_length(nodes, edges.chains(nodes), steps, 0)
    assert length == pytest.approx(0.3, abs=0.02)  # an edge
    nodes["xy"][1:] = [0.03, 0.97] + 0.03 * np.outer(np.arange(len(angle) - 1), [0, -1])
    nodes["arc"][1:] = 0.06 + 0.03 * np.arange(len(angle) - 1)
    assert [len(piece) for piece in edges.chains(nodes)] == [1, len(angle) - 1]


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_the_step_of_the_quantities_is_that_of_the_largest_where_the_last_is_nothing(unit):
    """Whatever the unit of forces: what rounding leaves of them is none."""
    assert q._moment(unit * np.array([1.0, 3.0, 2.0])) == 2
    assert q._moment(unit * np.array([1.0, 3.0, 3e-14])) == 1 and q._moment(np.zeros(3)) == 0


def test_nodes_that_press_round_are_counted_where_normals_vary():
    """Those without pressure do not make a straight boundary beside a round one count."""
    turn = np.array([0.0, 0.3, 0.6])
    round_one = np.column_stack([np.sin(turn), -np.cos(turn)])
    normal = np.vstack([np.tile([0.0, -1.0], (3, 1)), round_one])
    of = object.__new__(Record)
    of.contact = SimpleNamespace(boundary=SimpleNamespace(normal=normal,
                                                          chain=np.array([0, 0, 0, 1, 1, 1])))
    flat, both = np.array([-1, -2, 0, 0, 0, 0.0]), np.array([-1, 0, 0, -1, -1, 0.0])
    of.states = {"sigma_n": [flat, both, 0 * flat, 1 + flat]}
    assert [of._pressing_round(k) for k in range(4)] == [0, 3, 0, 0]


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_pressures_at_ends_are_told_beside_the_mean_one(unit):
    """In contact, by length; without any they are those of nothing. Ends are those of pieces."""
    x = np.array([0.0, 1.0, 3.0, 4.0])
    pressure = unit * np.array([1.0, 2.0, 4.0, 0.0])
    nodes, steps = line(x, pressure > 0, pressure, 0 * x)
    found = touch.Touch.of(nodes, steps, 0, 0)
    mean = (1 * 0.5 + 2 * 1.5 + 4 * 1.5) / 3.5
    np.testing.assert_allclose(found.ends, [[0, 0, 1 / mean], [4, 0, 0]], atol=1e-15)
    assert found.nodes == 3 and found.edges == pytest.approx(2.0)  # the first side, and the last
    apart = touch.Touch.of(*line(x, x < 0, 0 * x, unit * (1 + x)), 0, 0)
    assert not apart.ends[:, 2].any() and apart.apart == unit and apart.nodes == 0


def test_a_run_of_cycles_says_where_it_began():
    """A period before the end of the history; settled from the first of the last settled ones."""
    rows = [{"cycle": n, "settled": n in (1, 3, 4), "skipped": n, "error": 0.25} for n in range(5)]
    found = summary._cycles(SimpleNamespace(times=np.array([0.0, 2.0, 5.0]), period=3.0), rows)
    assert (found["start"], found["period"], found["number"]) == (2.0, 3.0, 4)
    assert (found["skipped"], found["settled_after"], found["error"]) == (10, 3, 1.25)
    assert found["last"] is rows[-1]
    rows[-1]["settled"] = False
    assert summary._cycles(SimpleNamespace(times=np.array([5.0]), period=3.0),
                           rows)["settled_after"] is None


def test_wear_is_that_of_the_whole_history():
    """Also where contact has gone by its end, and the other quantities are those of before."""
    x = np.arange(5.0)
    nodes, _ = line(x, x >= 0, 0 * x, 0 * x)
    pressing = np.array([1.0, 2.0, 0.0])[:, None]
    steps = {name: np.zeros((3, 5)) for name in ("u_n", "slip", "sigma_t", "work")}
    steps |= {"sigma_n": -pressing + 0 * x, "wear": np.array([0.0, 0.1, 0.3])[:, None] + 0 * x,
              "status": np.where(pressing > 0, STICK, OPEN) + 0 * x}
    effects = SimpleNamespace(contact=True, frictional=False,
                              quantities=("normal_resultant", "worn_volume"))
    found, index = q.quantities(effects, nodes, steps, np.ones(3))
    assert index == 1 and found == pytest.approx({"normal_resultant": 8.0, "worn_volume": 1.2})


def test_contact_that_pulls_and_pushes_alike_is_no_lost_contact():
    """Under a moment bilateral forces cancel; the quantities are those of the last step."""
    x = np.arange(5.0)
    nodes, _ = line(x, x >= 0, 0 * x, 0 * x)
    steps = {name: np.zeros((2, 5)) for name in ("u_n", "slip", "sigma_t", "work")}
    steps |= {"sigma_n": np.array([-1.0 + 0 * x, 3 * (x - 2)]), "status": np.full((2, 5), STICK)}
    found, index = q.quantities(declared(), nodes, steps, np.ones(2))
    assert index == 1 and found["peak_pressure"] > 3


def test_pressure_is_level_at_a_line_of_symmetry():
    """An even parabola is met exactly there; elsewhere an end is continued by a line."""
    x = np.linspace(0.0, 1.0, 6)
    nodes = {"arc": x, "xy": np.column_stack([x, 0 * x]),
             "weight": np.array([1, 2, 2, 2, 2, 1]) / 10,
             "paired": x < 0, "middle": x < 0, "mirrored": x == 0}
    pressure = 7 - 5 * x**2
    pressure[[0, -1]] = 9.0
    found = q.traction(nodes, pressure, np.arange(6))
    assert found[:-1] == pytest.approx((7 - 5 * x**2)[:-1])
    assert found[-1] == pytest.approx(2 * pressure[-2] - pressure[-3])


@pytest.mark.parametrize("side", [1, -1])
def test_a_largest_pressure_at_a_line_of_symmetry_stands_out_from_its_image(side):
    """By as much as the next node on one side and its image on the other say."""
    x = np.linspace(0.0, 1.0, 6)
    nodes = {"arc": x, "xy": np.column_stack([x, 0 * x]), "chain": np.zeros(6, int),
             "mirrored": (x == 0)[::side]}
    pressure = np.array([7.0, 5.0, 4.0, 3.0, 2.0, 1.0])[::side]
    assert touch._standing_out(nodes, pressure) == pytest.approx((7 - 5) / 2)
    nodes["mirrored"] = x < 0
    assert touch._standing_out(nodes, pressure) == 0.0


@pytest.mark.parametrize("forward", [True, False])
def test_a_peak_at_the_end_of_a_period_is_that_of_the_boundary_that_goes_on(forward):
    """p = 1 - (s - 0.05)^2 at s = -0.5, 0, 0.5, on two boundaries that meet across a period: one
    ends at 0, the other begins half on. That may be walked either way.

    The parabola through three nodes is exact.
    """
    s = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    order = np.arange(5) if forward else np.array([0, 1, 2, 4, 3])
    onward = np.where(s == 0.0, 3 if forward else 4, np.where(s == 0.5, 2, -1))[order]
    nodes = {"arc": np.array([0.0, 0.5, 1.0, 0.0, 0.5]), "chain": np.array([0, 0, 0, 1, 1]),
             "xy": np.column_stack([s[order], np.zeros(5)]), "weight": np.full(5, 0.5),
             "length": np.full(5, 0.5), "paired": np.zeros(5, bool), "middle": np.zeros(5, bool),
             "mirrored": np.zeros(5, bool), "onward": onward,
             "seam": np.where(onward >= 0, 0.5, 0.0)}
    pieces = [np.arange(3), np.arange(3, 5)]
    pressure = np.where(np.abs(s[order]) < 1, 1.0 - (s[order] - 0.05) ** 2, 0.3)
    assert q.largest_pressure(nodes, pieces, pressure) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("first", range(8))
def test_peaks_do_not_depend_on_where_a_period_begins(first):
    """f = 2 - (s - 0.01)^2 at s = -0.1, 0, 0.1, less elsewhere, on a boundary that follows itself,
    as a pressure and as a way of sliding.

    The parabola through three nodes is exact, wherever among them the first node is.
    """
    values = np.roll([1.0 + 0.1 * k for k in range(5)]
                     + [2 - (s - 0.01) ** 2 for s in (-0.1, 0.0, 0.1)], first)
    nodes = {"arc": 0.1 * np.arange(8), "chain": np.zeros(8, int),
             "xy": np.column_stack([0.1 * np.arange(8), np.zeros(8)]),
             "weight": np.full(8, 0.1), "length": np.full(8, 0.1), "gap": np.zeros(8),
             "paired": np.zeros(8, bool), "middle": np.zeros(8, bool),
             "mirrored": np.zeros(8, bool), "onward": np.array([7, *[-1] * 6, 0]),
             "seam": np.array([0.1, *[0.0] * 6, 0.1])}
    piece = np.arange(8)
    assert q.largest_pressure(nodes, [piece], values) == pytest.approx(2.0, rel=1e-12)
    steps = {"slip": values[None] / 2 * [[1], [-1]], "status": np.full((2, 8), SLIP),
             "u_n": np.zeros((2, 8)), "sigma_n": np.full((2, 8), -1.0), "sigma_t": np.ones((2, 8))}
    assert q.longest_ways(nodes, piece, steps) == pytest.approx([1.0, 2.0], rel=1e-12)


@pytest.mark.parametrize("bow, paired, straight", [(0.0, False, True), (1e-3, False, False),
                                                   (0.0, True, False)])
def test_a_round_obstacle_on_a_straight_boundary_makes_no_polygon_of_it(bow, paired, straight):
    """Whatever the directions of contact are, which are the obstacle's; of another body the sides
    may be chords.
    """
    x = np.array([0.0, 1.0, 2.0, 0.0, 1.0, 2.0])
    y = np.where(np.arange(6) < 3, 0.3 * x, 5.0 + x**2) + bow * (x == 1.0)
    of = object.__new__(Record)
    of.contact = SimpleNamespace(boundary=SimpleNamespace(
        xy=np.column_stack([x, y]), chain=np.array([0, 0, 0, 1, 1, 1]), paired=np.full(6, paired)))
    of.states = {"sigma_n": [np.array([-1, -2, 0, 0, 0, 0.0]), np.array([-1, 0, 0, -1, 0, 0.0])]}
    assert of._on_straight_sides(0) == straight and not of._on_straight_sides(1)


@pytest.mark.parametrize("closed, sides", [
    ([1, 1, 1, 1, 0, 0, 0, 0, 1], 1.6), ([1, 1, 1, 1, 0, 0, 1, 1, 0], 3.0), ([1] * 9, 0.0),
    ([0, 1, 0, 1, 1, 1, 0, 0, 0], 1.1 + 1.0), ([0, 0, 0, 1, 1, 1, 0, 0, 0], 0.0)])
def test_an_area_of_a_node_or_two_may_reach_over_the_sides_beside_it(closed, sides):
    """Beside an area that is resolved, whose ends its nodes locate."""
    arc = np.r_[0.0, np.cumsum([1.0, 1.1, 1.2, 1.3, 1.35, 1.4, 1.5, 1.6])]
    nodes = {"arc": arc, "middle": np.zeros(9, bool)}
    assert touch._of_few(nodes, np.arange(9), np.array(closed, bool)) == pytest.approx(sides)
