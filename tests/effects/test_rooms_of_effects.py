"""What single rooms add, asked for directly or by a run that shows nothing else."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.motion import ObstacleMotion
from driver.effects import cycles, large_sliding, probe, slip_law, wear
from driver.errors import InputError
from driver.march.closure import Closure

LAW = {"argument": "slip", "range": 2.0, "values": [1.0, 0.5, 0.25]}


def law(**changes) -> slip_law.Room:
    """The slip law of a scene with four contact nodes."""
    manifest = SimpleNamespace(rooms={"slip_law": LAW | changes}, patterns=[])
    room = slip_law.Room("slip_law", manifest)
    room.prepare(SimpleNamespace(gid=np.arange(4)))
    return room


def test_slip_accumulates_whatever_its_direction():
    """Forth by 0.5 and back by 0.5 is a way of 1; the factor at it is the table's middle value."""
    room, nodes = law(), np.array([1, 3])
    room.step_ends(nodes, np.array([0.5, 0.25]), np.ones(2))
    room.step_ends(nodes, np.array([-0.5, 0.0]), np.ones(2))
    np.testing.assert_array_equal(room.carried()["accumulated_slip"], [0, 1.0, 0, 0.25])
    still, back = np.zeros(2), np.array([-1.0, 0.0])
    np.testing.assert_allclose(room.coefficient_factor(nodes, still, still), [0.5, 0.875])
    np.testing.assert_allclose(room.coefficient_factor(nodes, back, still), [0.25, 0.875])


def test_displacement_counts_from_the_origin():
    """|u_t| and not the way there; constant beyond the range."""
    room, nodes = law(argument="displacement"), np.array([0, 2])
    room.step_ends(nodes, np.array([5.0, 5.0]), np.ones(2))
    u_t = np.array([-0.5, 7.0])
    np.testing.assert_allclose(room.coefficient_factor(nodes, u_t, np.zeros(2)), [0.75, 0.25])


@pytest.mark.parametrize("changes", [{"argument": "time"}, {"range": 0.0}, {"values": [1.0]},
                                     {"values": [1.0, np.nan]}, {"values": [1.0, -0.1]}])
def test_laws_that_make_no_sense_are_refused(changes):
    with pytest.raises(InputError, match="slip_law|negative"):
        law(**changes)


def test_wear_is_work_over_strength():
    """Depth by force times way, whichever way it goes; nothing where a node is pulled or open."""
    manifest = SimpleNamespace(rooms={"wear": {}}, patterns=[])
    room = wear.Room("wear", manifest)
    room.softness, room.depth = np.array([2.0, 2.0, 4.0, 4.0]), np.zeros(4)
    for slip in (0.5, -0.25):
        room.step_ends(np.array([0, 2, 3]), np.full(3, slip), np.array([0.1, -3.0, 0.0]))
    np.testing.assert_allclose(room.depth, [2 * 0.75 * 0.1, 0, 0, 0], rtol=1e-15)


def test_padding_adds_obstacles_that_stand_still():
    nodes, times = 2, np.array([0.0, 1.0])
    rng = np.random.default_rng(1)
    moving = ObstacleMotion(times, *(rng.random((2, nodes, *more)) for more in ((), (2,), ())),
                            *rng.random((3, nodes, 2)))
    assert moving.padded(0) is moving
    more = moving.padded(3)
    np.testing.assert_array_equal(more.way(0.0, 1.0)[:nodes], moving.way(0.0, 1.0))
    assert not more.way(0.0, 1.0)[nodes:].any() and len(more.way(0.0, 1.0)) == nodes + 3
    np.testing.assert_array_equal(more.gap_at(1.0), [*moving.gap_at(1.0), 0, 0, 0])


CURVE = {"reach": 0.5, "curve": [[0.0] * 8] * 3, "box": [0.0, 1.0, 0.0, 1.0]}
SPOILED = [
    (large_sliding, CURVE, [{"reach": 0.0}, {"reach": np.inf}, {"curve": [[0.0] * 7] * 3},
                            {"curve": [0.0] * 8}, {"curve": [[np.nan] * 8]}, {"box": [0.0, 1.0]},
                            {"box": [0.0, 1.0, 0.0, np.inf]}, {"reach": None}]),
    (cycles, {"start": 1, "count": 3}, [{"start": -1}, {"start": 4}, {"start": 1.0}, {"count": 0},
                                        {"count": 2.0}, {"start": None}]),
    (probe, {"labels": [2], "points": [1, 0.5]}, [{"labels": None}, {"points": None},
                                                  {"points": [1.0]}, {"points": [1.0, np.nan]},
                                                  {"points": [True, 1.0]}, {"labels": [3]}])]


@pytest.mark.parametrize("module, sound, changes", SPOILED,
                         ids=["large_sliding", "cycles", "probe"])
def test_what_a_manifest_cannot_mean_is_refused(module, sound, changes):
    """A thing at a time: all else is as it should be, and with nothing changed it is accepted."""
    name = module.__name__.rpartition(".")[2]

    def room(**changed):
        manifest = SimpleNamespace(rooms={name: sound | changed}, patterns=[], labels=[1, 2],
                                   steps=4, t_end=1.0, amplitudes={1: [0.0, 0.0, 1.0, 2.0, 0.0]})
        return module.Room(name, manifest)

    room()
    for change in changes:
        with pytest.raises(InputError):
            room(**change)


@pytest.mark.parametrize("unit", [1.0, 1e-6, 1e6])
def test_a_label_is_a_plane_whatever_the_unit(unit):
    """Four nodes of a slope: its offset where gaps agree to rounding of places, refused else."""
    manifest = SimpleNamespace(rooms={"large_sliding": {"reach": 1.0}}, patterns=[])
    room = large_sliding.Room("large_sliding", manifest)
    normal = np.tile([0.6, -0.8], (4, 1))
    xy = unit * (np.arange(4.0)[:, None] * [0.8, 0.6] + [0.6, -0.8])

    def offsets(unevenness):
        gap = unit * np.array([0.5, 0.5, 0.5 + unevenness, 0.5])
        nodes = SimpleNamespace(gid=np.arange(4), label=np.full(4, 7), family=np.zeros(4, int),
                                normal=normal, xy=xy, columns={"gap": gap})
        return room.following(nodes, None).surface.offset

    np.testing.assert_allclose(offsets(1e-14), 1.5 * unit, rtol=1e-12)
    with pytest.raises(InputError, match="label 7"):
        offsets(1e-3)


def test_a_cycle_ends_where_it_begins_to_rounding():
    manifest = SimpleNamespace(rooms={"cycles": {"start": 1, "count": 3}}, patterns=[], steps=2,
                               t_end=1.0, amplitudes={1: [0.0, 1.0, 1.0 + 1e-12]})
    assert cycles.Room("cycles", manifest).repeats == (1, 3)
    manifest.amplitudes = {1: [0.0, 1.0, 1.0 + 1e-6]}
    with pytest.raises(InputError, match="amplitude1 is 1 at time 0.5"):
        cycles.Room("cycles", manifest)


def test_a_preload_is_where_slip_is_measured_from(solved, variant):
    """Loads that rest from time 0 on: the preloaded body neither slips nor rubs, to the solver's
    tolerance; without preload it has slid, and rubs, after the first step.
    """
    rest = ("macro amplitude1(t)", "macro preload() 1 //\nmacro amplitude1(t) 1. + 0.*")
    scene = variant("at-rest", rest)
    preloaded, virgin = (solved(scene, cells=4, steps=2, rtol=1e-11, friction_rtol=1e-10, **without)
                         for without in ({}, {"without": "preload"}))
    way, rub = (np.abs(virgin.contact[name][0]).max() for name in ("slip", "sigma_t"))
    assert np.abs(virgin.contact["u_t"][0]).max() == pytest.approx(way, rel=1e-12) and way > 0
    assert np.abs(preloaded.contact["u_t"][0]).max() > 0.1 * way
    assert np.abs(preloaded.contact["slip"]).max() < 1e-7 * way
    assert np.abs(preloaded.contact["sigma_t"]).max() < 1e-5 * rub


def test_a_node_without_force_closes_by_what_it_is_beyond_its_gap():
    """The tangent about a closure leaves 0.1 without force: less where the node is apart."""
    closure = object.__new__(Closure)
    closure.offset, closure.slope = np.full((1, 3), 0.1), np.full((1, 3), 0.5)
    closure.slides = False
    closure.rows = SimpleNamespace(normal=np.arange(3), tangential=np.empty(0, int))
    force, own, _ = closure._state(np.array([2.0, 0.0, 0.0]), np.array([0.0, 0.3, -0.2]))
    np.testing.assert_allclose(force, [2.0, 0, 0])
    np.testing.assert_allclose(own, [[0.1 + 0.5 * 2, 0.1 - 0.3, 0.1]])


@pytest.mark.parametrize("law, tangent, missed", [(0.0, 0.0, 0.0), (2.0, 1.5, 0.25)])
def test_what_tangents_miss_is_relative_to_the_closure(law, tangent, missed):
    """Nothing where nothing closes."""
    closure = object.__new__(Closure)
    closure.rooms = [SimpleNamespace(closure=lambda nodes, force, slip: np.array([law, 0.0]))]
    closure.nodes, closure.slides = np.arange(2), False
    closure.offset, closure.slope = np.zeros((1, 2)), np.array([[tangent / 3, 0.0]])
    closure.rows = SimpleNamespace(normal=np.arange(2), tangential=np.empty(0, int))
    closure.qp = SimpleNamespace(operator=SimpleNamespace(comm=MPI.COMM_SELF))
    closure.residuals = SimpleNamespace(scales=SimpleNamespace(displacement=0.0))
    assert closure.missed(np.array([3.0, 0.0]), np.zeros(2)) == pytest.approx(missed)
