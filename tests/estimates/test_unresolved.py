"""Meshes that make another problem of a scene, and areas of contact that they do not resolve."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

from driver.contact.states import OPEN, STICK
from driver.errors import NotConverged
from driver.estimates import mesh_part, successive, unresolved
from driver.estimates.budget import OF_TIME, Part
from driver.estimates.budget_words import share
from driver.estimates.given import Given
from driver.results.touch import Touch
from driver.runs import search, trials

VALUES = {"normal_resultant": 100.0, "tangential_resultant": 5.0, "displacement": 1.0, "slip": 0.1}


def touch_of(pressure, xy=None, arc=None):
    """Contact of nodes, on a line if nothing else is said, that press so much; weights are one."""
    pressure = np.array(pressure, float)
    zero = np.zeros(len(pressure))
    arc = np.arange(len(zero)) * 1.0 if arc is None else arc
    xy = np.column_stack([arc, zero]) if xy is None else xy
    nodes = {"arc": arc, "xy": xy, "chain": zero.astype(int), "weight": zero + 1, "gap": zero,
             "middle": zero > 0, "mirrored": zero > 0, "paired": zero > 0}
    steps = {"sigma_n": -pressure, "sigma_t": zero, "u_n": zero, "u_t": zero, "slip": zero,
             "status": np.where(pressure > 0, STICK, OPEN)}
    return Touch.of(nodes, {name: column[None] for name, column in steps.items()}, 0, 0)


@pytest.mark.parametrize("pressure, lone", [
    ([1, 1, 1, 0, 0], 0.0), ([1, 1, 0, 0, 0], 1.0), ([0, 3, 0, 1, 1], 1.0),
    ([1, 0, 1, 1, 1], 0.25), ([1, 1, 1, 1, 0, 1], 0.2), ([0, 0, 0], 0.0)])
def test_forces_that_act_at_a_node_or_two(pressure, lone):
    assert touch_of(pressure).lone == pytest.approx(lone)


def test_an_area_of_a_ring_goes_on_where_its_nodes_begin():
    """A circle of eight nodes: the first and the last two are one area."""
    angle = np.arange(8) * np.pi / 4
    found = touch_of([1, 0, 0, 0, 0, 0, 1, 1], np.column_stack([np.cos(angle), np.sin(angle)]),
                     2 * np.sin(np.pi / 8) * np.arange(8))
    assert found.lone == 0.0


@pytest.mark.parametrize("lone, names", [
    (0.0, set()), (0.09, set()),
    (0.2, {"normal_resultant", "tangential_resultant", "slip"})])
def test_the_place_of_a_force_on_a_node_or_two_is_not_known(lone, names):
    """Adjoint problems, made on the state of contact, do not see it; displacements they hold."""
    found = unresolved.parts(VALUES, 0.1, Touch(20, lone, open={}), "P1", True)
    assert set(found) == names
    if names:
        assert "areas of one or two nodes carry 20 %" in found["slip"].note


@pytest.mark.parametrize("touch", [Touch(20, 1.0, open={}), Touch(3, 0.0, open={}),
                                   Touch(20, 0.0, round=2, open={})])
@pytest.mark.parametrize("error, adjoint, known", [(0.019, False, True), (0.021, False, False),
                                                   (0.3, True, True)])
def test_a_body_that_is_resolved_has_displacements_however_few_nodes_touch(touch, error, adjoint,
                                                                           known):
    """By an adjoint problem, or by its error in energy where elements have none."""
    found = unresolved.parts(VALUES, error, touch, "P2", adjoint)
    assert ("displacement" not in found) == known and "slip" in found
    assert ("the body or the other side is round: refine the mesh" in found["slip"].note) == bool(
        touch.round)


def test_errors_of_the_step_that_quantities_belong_to_count():
    """As `carrying`, where contact is lost at the end of the history."""
    entry = {"kind": "equilibrated", "step": 3, "mesh": 0.1, "norm": 1.0,
             "carrying": {"step": 2, "mesh": 0.3, "norm": 1.0}}
    assert unresolved.energy_error(entry) == pytest.approx(0.3)
    assert unresolved.blind(entry, 0.03, 2) and not unresolved.blind(entry, 0.03, 3)


LOST = """include "scene.idp"
quasistatic(1.);
real h = meshSize(1.);
func real n(real l) { return max(1., rint(l/h)); }
border a(t=0, 40) { x = t; y = 0; label = 1; }
border stop(t=40, 50) { x = t; y = 0; label = 9; }
border b(t=0, 6) { x = 50; y = t; label = 2; }
border c(t=50, 0) { x = t; y = 6; label = 3; }
border d(t=6, 0) { x = 0; y = t; label = 4; }
body = buildmesh(a(n(40)) + stop(n(10)) + b(n(6)) + c(n(50)) + d(n(6)));
macro young() 70e3 //
macro poisson() 0.33 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() pressure(3, 1.) //
macro amplitude1(t) sin(1.2*pi*t) //
macro load2() traction(2, 0.2, 0.) //
macro amplitude2(t) t //
macro contact() 9 //
macro gap() 0.005 //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.slow  # companions
def test_contact_that_is_lost_at_the_end_has_an_adjoint_problem_and_claims(solved, named_scene):
    """Four nodes of the stop touch; without its adjoint problem nothing could be claimed."""
    run = solved(named_scene("lost", LOST), errors="yes", element="P2", steps=10)
    errors = run.summary["errors"]
    assert "normal_resultant" in errors["adjoint"]["quantities"]
    assert 0 < errors["quantities"]["normal_resultant"]["relative"] < 0.05
    assert 0 < errors["quantities"]["displacement"]["relative"] < 0.1
    assert errors["energy"]["carrying"]["step"] < errors["energy"]["step"]


def test_a_mesh_that_makes_another_problem_tells_nothing():
    """Polygons that overlap where circles have play press forty times as hard."""
    fine, middle = VALUES, VALUES | {"normal_resultant": 110.0}
    far = VALUES | {"normal_resultant": 4000.0}
    assert unresolved.alike([(fine, middle), (middle, fine)]) == [(fine, middle), (middle, fine)]
    assert unresolved.alike([(fine, middle), (middle, far)]) == [(fine, middle)]
    assert unresolved.alike([(fine, far), (far, middle)]) == []
    assert unresolved.alike([({"slip": 0.1}, {"slip": 5.0})]) == [({"slip": 0.1}, {"slip": 5.0})]
    # rounding, of contact that pulls as it presses
    none = {"normal_resultant": 1e-13, "peak_pressure": 0.8, "contact_length": 40.0}
    assert unresolved.alike([(none, none | {"normal_resultant": -4e-13})])


PLAY = """include "scene.idp"
units("mm", "MPa");
real h = meshSize(1.6);
func real n(real l) { return max(4., rint(l/h)); }
border ring(t=0, 2*pi) { x = 10*cos(t); y = 10*sin(t); label = 1; }
border hole(t=2*pi, 0) { x = 5*cos(t); y = 5*sin(t); label = 3; }
border pin(t=0, 2*pi) { x = 4.98*cos(t); y = 4.98*sin(t); label = 4; }
border core(t=2*pi, 0) { x = 2*cos(t); y = 2*sin(t); label = 5; }
addBody(buildmesh(ring(n(63)) + hole(2*n(31))))
addBody(buildmesh(pin(2*n(31)) + core(n(13))))
macro young() 70e3 //
macro poisson() 0.3 //
macro support() on(5, u1 = 0., u2 = 0.) //
macro displacement1() on(1, u1 = 0., u2 = 0.06) //
macro contactPair() 3, 4 //
include "export.idp"
"""


@pytest.mark.slow
def test_a_pin_with_play_has_no_claims_from_polygons_that_overlap(solved, named_scene):
    """With elements of 6.4 they press over the whole hole; by them forces would err by 2000 %."""
    run = solved(named_scene("pin-with-play", PLAY), errors="yes", quantity="normal_resultant")
    errors = run.summary["errors"]
    assert errors["quantities"]["normal_resultant"]["relative"] < 0.5
    assert any("H=6.4" in note and "another problem" in note for note in errors["notes"])


BULGE = """include "scene.idp"
units("mm", "MPa");
real h = meshSize(1.2);
func real n(real l) { return max(1., rint(l/h)); }
border a(t=0, 1) { x = 15*t; y = 0.02*sin(pi*t); label = 1; }
border b(t=0, 1) { x = 15; y = 4*t; label = 2; }
border c(t=0, 1) { x = 15 - 15*t; y = 4; label = 3; }
border d(t=0, 1) { x = 0; y = 4 - 4*t; label = 4; }
body = buildmesh(a(n(15)) + b(n(4)) + c(n(15)) + d(n(4)));
macro young() 210e3 //
macro poisson() 0.3 //
macro support() on(4, u1 = 0.) + on(2, u1 = 0.) //
macro load1() pressure(3, 40.) //
macro contact() 1 //
macro gap() (y) //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.slow  # companions
def test_loads_do_not_give_the_resultant_of_normals_that_turn(solved, named_scene):
    """Three meshes agree to 2e-6, and miss 0.1 % that friction adds where contact is inclined."""
    run = solved(named_scene("bulge", BULGE), errors="yes", quantity="displacement")
    found = run.summary["errors"]["quantities"]
    assert found["normal_resultant"]["total"] is None and found["displacement"]["total"] > 0


@pytest.fixture
def searched(monkeypatch):
    """searched(error, energy): parts of a search on two meshes, of which coarser ones tell an
    `error` of every quantity, and the arguments that they got.
    """
    def parts(error: float, energy: dict, **more) -> tuple[dict, list]:
        touch = touch_of([3, 4, 5, 5, 4, 3, 2, 0, 0])
        record = SimpleNamespace(quantities=lambda: (VALUES, 1), touch=lambda _: touch,
                                 singular_places=lambda: ())
        level = SimpleNamespace(touch=touch, values=VALUES, record=record, steps=3 * [None], at=1,
                                declared=3, energy=None)
        manifest = SimpleNamespace(element="P1")
        problems = [SimpleNamespace(manifest=manifest, operator=None, lost=part)
                    for part in (0.02, 0.05)]
        given, said = [], {}
        caution = SimpleNamespace(
            parts=lambda *of: given.append(of) or dict.fromkeys(VALUES, Part(error)),
            beside=lambda part, *of: given.append(of) or part, adapted=False)
        for owner, name, answer in (
                (successive, "of_level", energy), (successive.Peaks, "of_level", None),
                (mesh_part, "stand_for_curves", False), (mesh_part, "by_loads", Given())):
            monkeypatch.setattr(owner, name, lambda *_, answer=answer, **__: answer)
        monkeypatch.setattr(successive.adjoint, "assess", lambda *of: said.update(
            adjoint=of[3]) or ({"normal_resultant": 1.0}, {"smoothed": 0.01}))
        monkeypatch.setattr(mesh_part.Caution, "of",
                            lambda *of: said.update(seen=of[6]) or caution)
        monkeypatch.setattr(mesh_part.soundness, "lost", lambda problem: problem.lost)
        monkeypatch.setattr(mesh_part, "contact_ratios", lambda _, ratios: ratios)
        found = successive.mesh_parts(problems, [level, level], [2.0], "normal_resultant",
                                      "bound", **more)
        assert level.energy is energy  # for the next time that it is asked for
        return found, [*given, said]

    return parts


@pytest.mark.parametrize("step, known", [(2, False), (3, True)])
def test_the_bound_says_nothing_of_an_earlier_step(searched, step, known):
    """That smoothed stresses miss most of it is seen at the step that the bound of the error in
    energy is of: the values are of the second one, after which contact is lost.
    """
    found, given = searched(0.01, {"kind": "equilibrated", "step": step, "mesh": 1.0})
    assert (found["slip"].error is not None) == known
    assert given[-1]["seen"] == (1.0 if known else 0.01)


def test_a_search_claims_no_more_than_a_run_would(searched):
    """Nothing of what may be its own error, but of what it is asked for, which it goes on with;
    and what edges miss of the loads counts, of either mesh.
    """
    found, given = searched(1.5 * max(VALUES.values()), {})
    assert [name for name, part in found.items() if part.error is not None] == ["normal_resultant"]
    assert given[0][-1] == [0.02, 0.05]
    value, peaks, touches, ratios = given[1]
    assert value == VALUES["displacement"] and len(peaks) == 1 and len(touches) == 2
    assert ratios == [2.0]


def test_what_a_search_was_not_asked_for_has_its_adjoint_problems(searched, monkeypatch):
    """Steered by one quantity, it claims the others by theirs; the one that was met stays."""
    assert searched(0.01, {})[1][-1]["adjoint"] == {"normal_resultant": VALUES["normal_resultant"]}
    assert searched(0.01, {}, others=True)[1][-1]["adjoint"] == {
        name: value for name, value in VALUES.items() if name != "normal_resultant"}
    of = SimpleNamespace(name="slip", parts={"mesh": {"slip": Part(0.1), "displacement": None}},
                         compared=lambda: ([], [], [], "slip", "bound"))
    monkeypatch.setattr(search, "mesh_parts", lambda *given, others: dict.fromkeys(
        ("slip", "displacement"), Part(0.2 if others and given == of.compared() else None)))
    search._claim_others(of)  # pylint: disable=protected-access
    assert of.parts == {"mesh": {"slip": Part(0.1), "displacement": Part(0.2)}}


@dataclasses.dataclass
class History:
    """A load that goes up and down within eight steps; steps may be others."""

    steps: int = 8
    t_end: float = 1.0
    between: dict = dataclasses.field(default_factory=lambda: {
        "1": np.sin(1.2 * np.pi * np.linspace(0, 1, 65))})


def timed(stride: int = 1, at: int = 7, on_arrival: float = 0.0):
    """Trials of eight steps, and a level whose quantities belong to the step `at`."""
    of = object.__new__(trials.Trials)
    of.name, of.motion = "displacement", None
    of.sizes, of.stride, of.total, of.history = [1.0], stride, 8, History()
    of.parts = {"time": dict.fromkeys(VALUES, Part(0.0))}
    record = SimpleNamespace(
        arrivals=lambda: 0.3, slid_on_arrival=lambda: on_arrival, displacements=[1.0] * 8,
        cycles=None, beside=lambda index: [
            {"normal_resultant": np.sin(1.2 * np.pi * (index + k) / 8)} for k in range(3)])
    of.level = lambda size, *_: SimpleNamespace(values=VALUES, at=at, declared=8, record=record)
    return of


def test_a_search_claims_what_steps_leave_open_of_a_moment_before_the_end():
    """Of a force in proportion to the load, whose peak is between two steps."""
    missed = 1 - np.sin(1.2 * np.pi * 3 / 8)
    assert timed(at=2).claimed["time"]["normal_resultant"].error == pytest.approx(
        OF_TIME * missed, rel=0.1)
    assert timed(at=7).claimed["time"]["normal_resultant"].error == 0.0


@pytest.mark.parametrize("stride, error", [(2, OF_TIME * 0.3), (8, 0.0)])
def test_a_search_claims_what_steps_leave_open_of_a_slip(stride, error):
    """Nodes that touch within a step have slid in a part of it; in one step that all grows with in
    proportion, nothing is open.
    """
    of = timed(stride)
    found = of.budget()
    assert found["slip"]["time"] == pytest.approx(error) and found["displacement"]["time"] == 0.0
    assert of.claimed["time"]["slip"].error == pytest.approx(error)  # of prices as well


@pytest.mark.parametrize("on_arrival, known", [(0.4, True), (0.6, False)])
def test_a_search_for_another_quantity_does_not_claim_slip_that_was_made_on_touching(on_arrival,
                                                                                     known):
    """In few steps, which coarser ones join with more of the way in the air."""
    found = timed(2, on_arrival=on_arrival).claimed["time"]["slip"]
    assert (found.error is not None) == known and bool(found.note) != known


def test_a_search_says_of_too_few_steps_what_it_claims():
    of = timed()
    of.name, of.asked = "slip", 0.01
    claimed = of.budget()["slip"]["time"]
    with pytest.raises(NotConverged, match=re.escape(
            f"the slip has an error of {share(claimed, VALUES['slip'])}:")):
        of.more_steps(1.0)


def test_what_may_be_nothing_but_its_own_error_has_no_claim():
    """Nor has the work of such a slip, though it is next to nothing by itself; zero is zero."""
    values = {"normal_resultant": 100.0, "displacement": 1.0, "slip": 0.1,
              "dissipated_energy": 1e-3, "tangential_resultant": 0.0}
    errors = {"normal_resultant": 1.0, "displacement": 0.9, "slip": 0.2, "dissipated_energy": 1e-3,
              "tangential_resultant": 1e-9}
    parts = {name: Part(error) for name, error in errors.items()}
    found = unresolved.claimable(parts, values)
    assert {name for name, part in found.items() if part.error is None} == {"slip",
                                                                           "dissipated_energy"}
    assert all("nothing but its error" in found[name].note
               for name in ("slip", "dissipated_energy"))
    sure = unresolved.claimable(parts | {"slip": Part(0.05)}, values)
    assert sure["slip"].error == 0.05 and sure["dissipated_energy"].error == 1e-3


def test_what_touches_is_not_known_where_displacements_are_not():
    """Feet of an arch of stiff triangles lay flat on three meshes, by 2 mm, 10 % of which was
    claimed: they stand on 0.7 mm of their inner edges, as the arch yields twice as much. Resultants
    may have their adjoint problems, and what is zero or unknown stays that.
    """
    values = {"normal_resultant": 100.0, "displacement": 1.0, "contact_length": 2.0,
              "peak_pressure": 50.0, "slip": 0.0, "dissipated_energy": 0.0}
    errors = {"normal_resultant": 1.0, "displacement": 1.1, "contact_length": 0.2,
              "peak_pressure": None, "slip": 0.0, "dissipated_energy": 0.0}
    parts = {name: Part(error) for name, error in errors.items()}
    found = unresolved.claimable(parts, values)
    assert {name for name, part in found.items() if part.error is None} == {
        "displacement", "contact_length", "peak_pressure"}
    assert "nothing but its error" in found["contact_length"].note
    assert found["peak_pressure"].note == ""
    sure = unresolved.claimable(parts | {"displacement": Part(0.9)}, values)
    assert sure["contact_length"].error == 0.2


@pytest.mark.parametrize("slip, touches, known, before", [
    (0.0, True, False, 0.0), (0.0, False, True, 0.0), (1e-3, True, True, None),
    (1e-3, True, True, 2e-3), (1e-3, True, False, 0.0), (1e-3, False, True, 0.0)])
def test_slip_of_what_only_sticks_has_no_claim(slip, touches, known, before):
    """All meshes agree that nothing slides, but finer ones have microslip. Of a tee that rocks on
    its foot the next coarser mesh had none, and 0.4 um were claimed of 0.06, which was 0.65.
    """
    values = {"slip": slip, "dissipated_energy": slip, "displacement": 1.0}
    parts = dict.fromkeys(values, Part(0.0))
    coarser = None if before is None else values | {"slip": before}
    found = unresolved.claimable(parts, values, touches, coarser)
    assert (found["slip"].error is not None) == known == (
        found["dissipated_energy"].error is not None)
    assert found["displacement"].error == 0.0


def touches_at(shape, sizes, where=0.0, mirrored=False):
    """Contact on meshes of `sizes` of a side from 0 to 8 whose node at `where` carries all, and
    the others open by a `shape` of their distance from it.
    """
    found = []
    for size in sizes:
        arc = np.arange(0.0, 8.0 + size / 2, size)
        zero, presses = np.zeros(len(arc)), (arc == where).astype(float)
        nodes = {"arc": arc, "xy": np.column_stack([arc, zero]), "chain": zero.astype(int),
                 "weight": zero + 1, "gap": shape(np.abs(arc - where)), "middle": zero > 0,
                 "mirrored": zero + mirrored > 0, "paired": zero > 0}
        steps = {"sigma_n": -presses, "sigma_t": zero, "u_n": zero, "u_t": zero, "slip": zero,
                 "status": np.where(presses > 0, STICK, OPEN)}
        found.append(Touch.of(nodes, {name: column[None] for name, column in steps.items()}, 0, 0))
    return found


@pytest.mark.parametrize("shape, where, mirrored, at_corners", [
    (lambda way: 0.1 * way, 0.0, False, True), (lambda way: 0.1 * way, 8.0, False, True),
    (lambda way: 0.1 * way**2, 0.0, False, False), (lambda way: 0.1 * way, 0.0, True, False),
    (lambda way: 0.1 * way, 4.0, False, False)])
def test_contact_at_a_corner_has_no_more_nodes_on_finer_meshes(shape, where, mirrored, at_corners):
    """It is at an end of a side, not on a line of symmetry, and opens like a corner: a curve has
    more nodes once they are near enough.
    """
    assert unresolved.at_corners(touches_at(shape, [0.25, 0.5, 1.0], where, mirrored),
                                 4.0) is at_corners


def test_contact_that_gains_nodes_is_at_no_corner():
    fine, middle, coarse = touches_at(lambda way: 0.1 * way, [0.25, 0.5, 1.0])
    more = dataclasses.replace(fine, nodes=2)
    assert not unresolved.at_corners([more, middle, coarse], 4.0)


@pytest.mark.parametrize("sizes, yields, expected", [
    ([0.25, 0.5, 1.0], 1e-3, np.log2(25.0)),  # a width of 0.01
    ([0.25, 0.5, 1.0], 0.0, np.log2(1e3)), ([0.25, 0.5], 1e-3, 0.0),
    ([0.25, 0.5, 1.0], 5e-3, np.log2(5.0)), ([0.25, 0.5, 1.0], 2.4e-2, 0.0)])
def test_how_far_meshes_are_from_the_width_of_contact_at_a_corner(sizes, yields, expected):
    """The next node opens by what the corner has there, less what the body yields by."""
    touches = touches_at(lambda way: 0.1 * way - yields * (way > 0), sizes)
    assert unresolved.halvings(touches, [2.0] * (len(sizes) - 1)) == pytest.approx(expected)


def test_forces_at_corners_have_claims_of_what_halved_elements_may_change():
    fine = VALUES | {"peak_pressure": 3.0}
    coarse = fine | {"normal_resultant": 98.0, "slip": 0.1}
    found = dict.fromkeys(fine, Part(0.01))
    claimed = unresolved.of_corners(found, (fine, coarse), 4.0, 5.0)
    assert claimed["normal_resultant"].error == pytest.approx(5.0)  # two halvings changed it by 2
    assert claimed["slip"].error == claimed["peak_pressure"].error == 0.01
    touch = Touch(2, 1.0, open={})
    for error, corners, known in ((0.1, True, True), (0.1, False, False), (0.6, True, False)):
        unknown = unresolved.parts(fine, error, touch, "P2", False, corners=corners)
        assert ("normal_resultant" not in unknown and "slip" not in unknown) is known
        assert "peak_pressure" in unknown


SPRING = """include "scene.idp"
real h = meshSize(0.7);
func int n(real l) { return ceil(l/h); }
macro axisymmetric() 1 //
border a(t=0, 1) { x = 8 + 8*t; y = 0.5*(1 - t); label = 1; }
border b(t=0, 1) { x = 16; y = t; label = 2; }
border c(t=1, 0) { x = 8 + 8*t; y = 1 + 0.5*(1 - t); label = 3; }
border d(t=1, 0) { x = 8; y = 0.5 + t; label = 4; }
body = buildmesh(a(n(8.)) + b(n(2.)) + c(n(8.)) + d(n(2.)));
macro young() 206e3 //
macro poisson() 0.3 //
macro contact() 1, 3 //
macro gap() (label == 1 ? y : 1.35 - y) //
macro contactNormal() [0., (label == 1 ? -1. : 1.)] //
include "export.idp"
"""


@pytest.mark.slow  # companions
def test_a_disc_spring_on_its_corners_has_a_force_with_a_claim(solved, named_scene):
    """Of a node at each corner, on meshes of any size."""
    runs = [solved(named_scene("spring", SPRING), element="P2", errors=errors, **size)
            for errors, size in (("yes", {}), ("no", {"h": 0.2}))]
    claimed = runs[0].summary["errors"]["quantities"]["normal_resultant"]
    fine = runs[1].summary["quantities"]["normal_resultant"]
    assert abs(claimed["value"] - fine) < claimed["total"] < 0.05 * fine
