"""What single rooms add, asked for directly or by a run that shows nothing else."""

import dataclasses
import importlib
import pkgutil
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

import driver.effects
from driver.contact.found_nodes import rubbing
from driver.contact.motion import ObstacleMotion
from driver.contact.nodes import Nodes
from driver.effects import (Effect, Effects, compliance_exponent, cycles, large_sliding,
                            normal_compliance, probe, slip_law, springs, tie, wear)
from driver.errors import InputError
from driver.march.closure import Closure
from driver.quantity_table import QUANTITIES
from driver.results.summary import Summary

LAW = {"argument": "slip", "range": 2.0, "values": [1.0, 0.5, 0.25]}


def law(**changes) -> slip_law.Room:
    """The slip law of a scene with four contact nodes, the last but one above what it meets."""
    manifest = SimpleNamespace(rooms={"slip_law": LAW | changes}, patterns=[])
    room = slip_law.Room("slip_law", manifest)
    level = SimpleNamespace(gid=np.arange(4), xy=np.column_stack([np.arange(4.0), np.zeros(4)]),
                            gap=np.array([0.0, 1e-12, 0.1, 0.0]))
    level.at = lambda time: level
    room.prepare(level)
    return room


def test_a_bound_by_pressure_is_known_by_what_a_law_gives():
    """Not by its name: a step is a fixed point, and energy's bound leaves something out."""
    class Sticky(Effect):
        """A law of pressure that is not `friction`."""

        def friction_coefficient(self, contact):
            return np.full(len(contact.gid), 0.3)

    effects = Effects(SimpleNamespace(rooms={}, patterns=[], bodies=1, contact_labels=[],
                                      quasistatic=False))
    assert not effects.pressure_bounds_friction
    manifest = SimpleNamespace(rooms={"sticky": {}}, patterns=[])
    effects.rooms["sticky"] = Sticky("sticky", manifest)
    assert effects.pressure_bounds_friction


def test_nodes_rub_by_what_laws_give_whatever_these_are_called():
    """Where supports hold one of two bodies the rows depend on it."""
    class Sticky(Effect):
        """A law of friction by a column of its own."""

        def friction_offset(self, contact):
            return contact.columns["stickiness"] * contact.weight

    manifest = SimpleNamespace(rooms={"sticky": {}}, patterns=[])
    nodes = Nodes(np.arange(3), *np.zeros((3, 3)), np.array([0.0, 1.0, 1.0]), *np.zeros((2, 3)),
                  {"stickiness": np.array([2.0, 0.0, 2.0])}, [], {})
    assert not rubbing([Effect("sticky", manifest)], nodes).any()
    assert rubbing([Sticky("sticky", manifest)], nodes).tolist() == [True, False, True]


def test_every_quantity_of_a_room_has_its_row():
    """Errors of one without unit, kind and caution could not be claimed."""
    rooms = [importlib.import_module(f"driver.effects.{module.name}")
             for module in pkgutil.iter_modules(driver.effects.__path__)]
    declared = {name for room in rooms for name in room.Room.quantities}
    assert declared | {"displacement"} == set(QUANTITIES)


def test_what_rooms_say_in_the_summary_is_described():
    """Entries of `effects`, and values of those that are words."""
    entries = {field.name: field for field in dataclasses.fields(Summary)}
    parts = entries["effects"].metadata["parts"]
    for module in pkgutil.iter_modules(driver.effects.__path__):
        room = importlib.import_module(f"driver.effects.{module.name}").Room
        for name, value in room.summary.items():
            assert name in parts and (value is True or value in parts[name]), (room, name)
    assert {"cycles", "bodies", "time"} < parts.keys() and "coulomb and tresca" in parts["friction"]


def test_slip_accumulates_whatever_its_direction():
    """Forth by 0.5 and back by 0.5 is a way of 1; the factor at it is the table's middle value."""
    room, nodes = law(), np.array([1, 3])
    room.step_ends(nodes, np.array([0.5, 0.25]), np.ones(2))
    room.step_ends(nodes, np.array([-0.5, 0.0]), np.ones(2))
    np.testing.assert_array_equal(room.carried()["accumulated_slip"], [0, 1.0, 0, 0.25])
    still, back = np.zeros(2), np.array([-1.0, 0.0])
    np.testing.assert_allclose(room.coefficient_factor(nodes, still, still), [0.5, 0.875])
    np.testing.assert_allclose(room.coefficient_factor(nodes, back, still), [0.25, 0.875])


def test_only_slip_in_contact_accumulates():
    """Half of a step in which a node touches or opens, nothing of those in which it is open."""
    room, node = law(), np.array([2])
    room.step_ends(node, np.array([4.0]), np.zeros(1))
    assert room.carried()["accumulated_slip"][2] == 0.0
    # the node would touch in the step at hand, whose half counts
    np.testing.assert_allclose(room.coefficient_factor(node, np.ones(1), np.zeros(1)), [0.75])
    room.step_ends(node, np.array([0.5]), np.ones(1))
    room.step_ends(node, np.array([-0.25]), np.ones(1))
    assert room.carried()["accumulated_slip"][2] == 0.5
    room.step_ends(node, np.array([0.5]), np.zeros(1))
    room.step_ends(node, np.array([0.5]), np.zeros(1))
    assert room.carried()["accumulated_slip"][2] == 0.75
    assert room.carried()["pressed"].tolist() == [True, True, False, True]


def test_displacement_counts_from_the_origin():
    """|u_t| and not the way there; constant beyond the range."""
    room, nodes = law(argument="displacement"), np.array([0, 2])
    room.step_ends(nodes, np.array([5.0, 5.0]), np.ones(2))
    u_t = np.array([-0.5, 7.0])
    np.testing.assert_allclose(room.coefficient_factor(nodes, u_t, np.zeros(2)), [0.75, 0.25])


@pytest.mark.parametrize("argument, values, slid, largest", [
    ("displacement", [0.2, 0.9, 0.5], [0.0, 3.0], [0.9, 0.9]),  # any may come
    ("slip", [0.2, 0.9, 0.5], [0.0, 0.5], [0.9, 0.9]),
    ("slip", [0.2, 0.9, 0.5], [1.0, 1.5], [0.9, 0.7]),  # slip does not get less
    ("slip", [0.2, 0.4, 0.9], [0.0, 0.5], [0.9, 0.9]),  # beyond the next place of the table, too
    ("slip", [0.9, 0.2, 0.5], [0.5, 1.0], [0.55, 0.5]),
    ("slip", [0.2, 0.9, 0.5], [2.0, 3.0], [0.5, 0.5]), ("slip", [0.2, 0.4, 0.9], [1.5, 2.0],
                                                        [0.9, 0.9])])
def test_the_largest_factor_is_that_of_slip_to_come(argument, values, slid, largest):
    room = law(argument=argument, values=values)
    room.step_ends(np.array([1, 3]), np.array(slid), np.ones(2))
    np.testing.assert_allclose(room.largest_factor(np.array([1, 3])), largest)


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
    closure.rows = SimpleNamespace(normal=np.arange(3), tangential=np.empty(0, int),
                                   pulls=np.zeros(3, bool))
    force, own, _ = closure._state(np.array([2.0, 0.0, -1.0]), np.array([0.0, 0.3, -0.2]))
    np.testing.assert_allclose(force, [2.0, 0, 0])
    np.testing.assert_allclose(own, [[0.1 + 0.5 * 2, 0.1 - 0.3, 0.1]])
    closure.rows.pulls = np.array([False, False, True])  # stays on the tangent
    force, own, _ = closure._state(np.array([2.0, 0.0, -1.0]), np.array([0.0, 0.3, -0.2]))
    np.testing.assert_allclose(force, [2.0, 0, -1.0])
    np.testing.assert_allclose(own, [[0.1 + 0.5 * 2, 0.1 - 0.3, 0.1 - 0.5]])


@pytest.mark.parametrize("force, law, tangent, pulls, deformed, missed", [
    (3.0, 0.0, 0.0, False, 0.0, 0.0), (3.0, 2.0, 1.5, False, 0.0, 0.25),
    (3.0, 2.0, 1.5, False, 5.0, 0.1),  # of what its material deforms by, if that is more
    (-3.0, 0.0, -1.5, True, 3.0, 0.5), (-3.0, 0.0, -1.5, False, 3.0, 0.0)])
def test_what_tangents_miss_is_relative_to_the_closure(force, law, tangent, pulls, deformed,
                                                       missed):
    """Nothing where nothing closes. What another node's material deforms by does not count."""
    closure = object.__new__(Closure)
    closure.rooms = [SimpleNamespace(closure=lambda nodes, force, slip: np.array([law, 0.0]))]
    closure.nodes, closure.slides = np.arange(2), False
    closure.offset, closure.slope = np.zeros((1, 2)), np.array([[tangent / force, 0.0]])
    closure.rows = SimpleNamespace(normal=np.arange(2), tangential=np.empty(0, int),
                                   pulls=np.array([pulls, False]))
    closure.qp = SimpleNamespace(operator=SimpleNamespace(comm=MPI.COMM_SELF,
                                                          row_level=np.array([1, 0])))
    closure.residuals = SimpleNamespace(scales=SimpleNamespace(
        displacements=np.array([100.0, deformed])))
    found = closure.missed(np.array([force, 0.0]), np.zeros(2))
    assert found == pytest.approx(missed)


def room_of(module, rooms=(), columns=None, weight=(1.0,)):
    """A room that is prepared for contact nodes with these columns and weights."""
    name = module.__name__.rpartition(".")[2]
    manifest = SimpleNamespace(rooms={name: {}, **dict.fromkeys(rooms, {})}, patterns=[])
    room = module.Room(name, manifest)
    columns = {key: np.array(of, float) for key, of in (columns or {}).items()}
    contact = SimpleNamespace(columns=columns, weight=np.array(weight), faced=np.array(weight),
                              gid=np.arange(len(weight)))
    room.prepare(contact)
    return room, contact


@pytest.mark.parametrize("m", [0.5, 1.0, 2.0, 3.3])
def test_tangents_of_a_power_law_are_its_slopes(m):
    """p = c z^m at weights of their own: closures, and about them the line that touches the law;
    none where the surface is smooth.
    """
    nodes, force = np.arange(3), np.array([6.0, 0.5, 2.0])
    room, _ = room_of(compliance_exponent, ["normal_compliance"], {
        "normal_compliance": [3.0, 0.2, 0.0], "compliance_exponent": [m, m, 0.0]}, [2.0, 0.5, 1.0])
    z = room.closure(nodes, force, None)
    np.testing.assert_allclose(z, [(6 / 2 / 3) ** (1 / m), (0.5 / 0.5 / 0.2) ** (1 / m), 0.0])
    assert room.reach(nodes, force, z) == pytest.approx(z.max())
    slope, offset = room.tangent(nodes, force, z, None, z.max())
    np.testing.assert_allclose(offset + slope * force, z, rtol=1e-12)
    step = 1e-6 * force
    change = room.closure(nodes, force + step, None) - room.closure(nodes, force - step, None)
    np.testing.assert_allclose(slope, change / (2 * step), rtol=1e-6)
    # about the closure at hand where the law is smooth in it, about the force where it is not
    about = 0.25 * z
    slope, offset = room.tangent(nodes, force, about, None, z.max())
    c, weight = np.array([3.0, 0.2]), np.array([2.0, 0.5])
    at = np.where(m < 1, z, about)[:2]
    np.testing.assert_allclose(offset[:2] + slope[:2] * weight * c * at**m, at, rtol=1e-12)
    # without a closure that of the force; without either a slope at a part of the largest
    np.testing.assert_allclose(room.tangent(nodes, force, 0 * z, None, 1.0)[1][:2],
                               (z - m**-1 * z)[:2], rtol=1e-9)
    slope, offset = room.tangent(nodes, 0 * force, 0 * z, None, 1.0)
    steepest = c * m * compliance_exponent.FLOOR ** (m - 1)
    np.testing.assert_allclose(slope[:2], 1 / (steepest * weight))
    assert not offset.any() and slope[2] == 0.0
    slope, _ = room.tangent(nodes, 0 * force, 0 * z, None, 0.0)  # a line has one everywhere
    np.testing.assert_allclose(slope[:2], 1 / (c * weight) if m == 1 else 0.0)
    room.about(SimpleNamespace(faced=np.array([1.0, 0.5, 1.0])))  # half of the first faces nothing
    np.testing.assert_allclose(room.closure(nodes, force, None), z * [2 ** (1 / m), 1.0, 0.0])


def test_laws_of_nodes_add_up():
    """Friction by its coefficient, cohesion and a given bound by lengths; all of a node pulls where
    any part of it is bilateral; what faces nothing has no strength.
    """
    columns = {"friction": [0.5, 0.25], "cohesion": [3.0, 1.0], "tresca": [0.5, 0.5],
               "bilateral": [0.0, 0.1]}
    manifest = SimpleNamespace(
        rooms=dict.fromkeys(("contact", "friction", "cohesion", "tresca", "bilateral"), {}),
        patterns=[], contact_labels=[1], quasistatic=True, bodies=1)
    effects = Effects(manifest)
    contact = SimpleNamespace(
        columns={name: np.array(of) for name, of in columns.items()}, weight=np.array([2.0, 4.0]),
        joined=0, covered=None, gap=np.zeros(2), motion=None, following=None, gid=np.arange(2))
    law = effects.contact_law(contact)
    np.testing.assert_allclose(law.friction_bound(np.array([10.0, -8.0])), [5 + 7, 2 + 6])
    assert law.bilateral.tolist() == [False, True]
    contact.covered = np.array([0.5, 0.0])
    np.testing.assert_allclose(effects.contact_law(contact).offset, [3.5, 0.0])
    contact.joined, contact.is_joint = 1, np.array([True, False])
    assert effects.contact_law(contact).bilateral.tolist() == [True, True]
    assert not effects.homogeneous(contact, np.zeros(2))  # an offset does not grow with the load
    del effects.rooms["cohesion"], effects.rooms["tresca"]
    assert effects.homogeneous(contact, np.zeros(2))
    for name, value in (("gap", np.array([0.0, 1.0])), ("motion", "some"), ("following", "some")):
        before = getattr(contact, name)
        setattr(contact, name, value)
        assert not effects.homogeneous(contact, np.zeros(2))
        setattr(contact, name, before)
    assert not effects.homogeneous(contact, np.array([0.0, 0.1]))
    effects.prepare(contact)
    assert effects.rooms["bilateral"].summary == {"contact": "unilateral and bilateral"}
    assert effects.quantities[-1] == "displacement" and "slip" in effects.quantities
    np.testing.assert_array_equal(effects.distance({}, 3), np.zeros(3))


def test_rough_surfaces_yield_by_their_area():
    """1/(c w), nothing where c is zero; with an exponent tangents do it."""
    columns = {"normal_compliance": [2.0, 0.0]}
    room, contact = room_of(normal_compliance, (), columns, [0.25, 1.0])
    np.testing.assert_array_equal(room.compliance(contact), [2.0, 0.0])
    room, contact = room_of(normal_compliance, ["compliance_exponent"], columns, [0.25, 1.0])
    assert room.compliance(contact) is None


def test_an_effect_that_the_driver_lacks_is_said():
    manifest = SimpleNamespace(rooms={"moonlight": {}}, patterns=[], contact_labels=[])
    with pytest.raises(InputError, match="moonlight, which driver/effects lacks"):
        Effects(manifest)
    with pytest.raises(InputError, match="labels of springs"):
        springs.Room("springs", SimpleNamespace(rooms={"springs": {"labels": [7]}}, patterns=[],
                                                labels=[1]))
    with pytest.raises(InputError, match="labels of tie"):
        tie.Room("tie", SimpleNamespace(rooms={"tie": {"labels": [[1, 9]]}}, patterns=[],
                                        labels=[1]))
    joined = tie.Room("tie", SimpleNamespace(rooms={"tie": {"labels": [[1, 2]]}}, patterns=[],
                                             labels=[1, 2])).joints()
    assert [(one.first, one.second, one.periodic) for one in joined] == [(1, 2, False)]
