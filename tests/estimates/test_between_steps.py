"""Load histories between the steps: kinks and pulses that steps miss, and where to put steps."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.contact.motion import ObstacleMotion
from driver.estimates import between_steps
from driver.estimates.budget import OF_TIME, Part
from driver.estimates.companions import Companions
from driver.results.record import Record
from driver.scene.manifest import read_manifest


def manifest(history, steps, t_end=1.0):
    times = np.linspace(0.0, t_end, 16 * steps + 1)
    return SimpleNamespace(steps=steps, t_end=t_end, between={"1": [history(t) for t in times]})


def kink(t):
    return t / 0.33 if t < 0.33 else 1 - 0.7 * (t - 0.33) / 0.67


def pulse(t):
    return max(0.0, 1 - abs(t - 0.47) / 0.08)


@pytest.mark.parametrize("history, steps, step, better", [
    (kink, 7, 3, 100), (lambda t: 1 - abs(2 * t - 1), 5, 3, 6), (pulse, 5, 3, 100),
    (lambda t: max(0.0, t - 0.9) / 0.1, 5, 5, 10)])
def test_what_steps_miss_is_named_with_steps_that_do_not(history, steps, step, better):
    line, = between_steps.warnings(manifest(history, steps))
    assert f"most in step {step}" in line
    offered = int(line.split("STEPS=")[1].split()[0])
    # kinks are located between samples by the lines on both sides: to a part of a sample
    assert abs(offered - better) <= 0.06 * better
    assert not between_steps.warnings(manifest(history, better))


@pytest.mark.parametrize("history, steps, offered", [
    (lambda t: np.sin(40 * np.pi * t), 20, 80),  # of which 40 steps see zeros alone, too
    (lambda t: 0.0 if t < 0.5 else 1.0, 20, 0), (lambda t: t * t, 2, 4)])
def test_steps_that_are_said_to_follow_better_halve_what_is_missed(history, steps, offered):
    """A jump stays in one step, however short that is."""
    line, = between_steps.warnings(manifest(history, steps))
    assert (f"STEPS={offered} follows it better" in line) == bool(offered)
    assert ("a jump by a ramp, use stepTimes" in line) == (not offered)
    missed = [found.size for n in (steps, offered) if n
              for found in between_steps.departures(manifest(history, n))]
    assert not offered or sum(missed[1:]) <= missed[0] / 2


@pytest.mark.parametrize("history, steps, index, missed", [
    (lambda t: np.sin(1.2 * np.pi * t), 10, 3, 1 - np.sin(0.48 * np.pi)),
    (lambda t: np.sin(1.2 * np.pi * t), 12, 4, 0.0),  # a step ends at the peak
    (lambda t: 1 - abs(2.5 * t - 1.125), 5, 1, 0.125), (lambda t: t, 4, 3, 0.0)])
def test_what_steps_leave_open_of_the_step_with_most_force(history, steps, index, missed):
    """A force in proportion to the load, and a length that hangs on none."""
    around = [{"force": 5 * history((index + k) / steps), "length": 3.0} for k in (0, 1, 2)
              if index + k <= steps]
    left = between_steps.of_instant(manifest(history, steps), index, around)
    assert left["force"] == pytest.approx(5 * missed, rel=0.1, abs=1e-9) and left["length"] == 0


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("kink, onset", [(0.32, 0.86), (0.32, 0.5), (0.47, 0.9), (0.36, 0.1)])
def test_a_force_that_begins_late_is_steeper_than_the_steps_say(power, kink, onset):
    """A punch comes, turns between two of six steps and goes: its force begins at a part of its
    way. On the mean slope between the steps 2 % were claimed where 11 % were missed. Not claimed is
    more than four times the tangent, the steepest slope, or what the parabola through three steps
    says.
    """
    def history(t):
        return t / kink if t < kink else 1.0 - 0.68 * (t - kink)

    def force(load):
        return max(load - onset, 0.0)**power

    loads = np.array([history(k / 6) for k in range(7)])
    index = int(loads.argmax()) - 1
    around = [{"normal_resultant": force(load)} for load in loads[index:index + 3]]
    left = between_steps.of_instant(manifest(history, 6), index, around)["normal_resultant"]
    missed, tangent = force(1.0) - force(loads.max()), power * (1.0 - onset)**(power - 1)
    still = SimpleNamespace(steps=6, t_end=1.0, between={})
    parabola = between_steps.of_instant(still, index, around)["normal_resultant"]
    assert 0.99 * missed <= left <= max(4 * tangent * (1.0 - loads.max()), parabola)


@pytest.mark.parametrize("off", [-0.4, -0.1, 0.25])
def test_other_quantities_are_those_of_the_moment_with_most_force(off):
    """They may have their own largest values elsewhere: by their slope times the way there."""
    def around(slope):
        return [{"normal_resultant": 1 - 0.1 * (t - off)**2, "displacement": 2 + slope * t}
                for t in (-1.0, 0.0, 1.0)]

    still = SimpleNamespace(steps=5, t_end=1.0, between={})
    left = between_steps.of_instant(still, 2, around(0.3))
    assert left["normal_resultant"] == pytest.approx(0.1 * off**2)
    assert left["displacement"] == pytest.approx(0.3 * abs(off))
    # a load with a peak between the steps: the moment is anywhere near
    peaked = manifest(lambda t: 1 - abs(2.5 * t - 1.125), 5)
    left = between_steps.of_instant(peaked, 1, around(0.3))
    assert left["displacement"] >= 0.15 - 1e-12  # half a step


def test_a_moment_in_the_first_step_has_the_start_before_it():
    """Of which nothing is recorded: contact carried nothing then."""
    def history(t):
        return np.exp(-(t - 0.14)**2 / 0.01)

    record = object.__new__(Record)
    record.effects = SimpleNamespace(contact=False)
    record.displacements = [history(0.2 * k) for k in range(1, 6)]
    record._columns, record.cycles = lambda: ({}, {}), None
    left = between_steps.of_earlier_moment(manifest(history, 5), record, 0)["displacement"]
    assert 1.0 - history(0.2) <= 1.2 * left


@pytest.mark.parametrize("at, recorded, found, share", [
    # in the history, at its end, in steps of more than one cycle
    (3, 10, {}, 1.0), (9, 10, {}, 0.0), (3, 20, {}, 1.0),
    (3, 10, {"force": Part(0.5), "slip": Part(0.1)}, None)])
def test_claims_of_a_moment_before_the_end_have_what_steps_leave_open(at, recorded, found, share):
    """Slip adds up, and is of no moment."""
    def history(t):
        return np.sin(1.2 * np.pi * t)

    of = object.__new__(Companions)
    of.strides = SimpleNamespace(motion=None)
    of.values, of.at, of.manifest = {"force": 1.0, "slip": 0.1}, at, manifest(history, 10)
    cycles = SimpleNamespace(place=lambda step: (step - 1) % 10 + 1) if recorded > 10 else None
    of.record = SimpleNamespace(
        displacements=[1.0] * recorded, cycles=cycles,
        beside=lambda index: [{"force": history((index + k) / 10)} for k in (0, 1, 2)])
    parts = of._of_instant(found)
    expected = 0.5 if share is None else share * OF_TIME * (1 - np.sin(0.48 * np.pi))
    assert parts["force"].error == pytest.approx(expected, rel=0.1)
    assert parts["slip"].error == (0.1 if found else 0.0)


def test_what_steps_leave_open_of_a_step_where_an_obstacle_is_nearest():
    """No load tells: the parabola through the three steps does."""
    around = [{"force": 1 - (t - 0.1)**2} for t in (-1.0, 0.0, 1.0)]
    still = SimpleNamespace(steps=5, t_end=1.0, between={})
    assert between_steps.of_instant(still, 2, around)["force"] == pytest.approx(0.01)


@pytest.mark.parametrize("steps, sampling, between", [
    (1, 1, 512), (5, 1, 64), (5, 4, 4), (5, 32, 0), (20, 1, 16), (250, 1, 8), (2000, 1, 4)])
def test_a_history_is_looked_at_so_often_in_a_step_of_the_scene(exported, steps, sampling,
                                                                between):
    """By runs of a finer history as well: what they see themselves is not written once more.

    In one of many steps less often, but so that half of it can be told to follow better; in one of
    few more often, so that pulses of a hundredth of the history are seen.
    """
    found = read_manifest(exported(loading="nonmonotone", cells=1, steps=steps, sampling=sampling))
    assert found.steps == steps * sampling
    assert {len(history) for history in found.amplitudes.values()} == {found.steps + 1}
    finer = {len(history) for history in found.between.values()}
    assert finer == ({between * found.steps + 1} if between else set())


@pytest.mark.parametrize("turns, kinks", [(1, 1), (2, 1), (3, 1), (4, 0), (6, 0)])
def test_a_kink_is_a_turn_within_two_samples(turns, kinks):
    """Where the lines before and after it meet; what takes longer is a bend."""
    slope = np.repeat([0.5, 0.0, -1.0], [20, turns - 1, 20])
    slope[20 : 19 + turns] = 0.5 - 1.5 * np.arange(1, turns) / turns
    times = np.arange(len(slope) + 1.0)
    fine = np.append(0.0, np.cumsum(slope))
    found = between_steps._kinks(times, fine)
    assert len(found) == kinks
    if kinks:  # 0.5 t = fine[-1] + (t_end - t)
        assert found[0] == pytest.approx((fine[-1] + times[-1]) / 1.5)


@pytest.mark.parametrize("kinks, steps, found", [
    ([0.5], 4, 4), ([1 / 3], 4, 6), ([0.25, 1 / 3], 5, 12), ([], 4, None),
    ([0.5 - 0.019 / 4], 4, 4), ([1 / 40], 2, 40), ([1 / 41], 2, None)])
def test_steps_that_end_at_kinks(kinks, steps, found):
    """As few as possible, to a fiftieth of a step; up to twenty times as many."""
    assert between_steps.steps_at(2.0 * np.array(kinks), steps, 2.0) == found


def test_smooth_histories_and_kinks_at_steps_are_no_reason_to_warn():
    assert not between_steps.warnings(manifest(lambda t: -4 * t**2 + 5 * t, 20))
    assert not between_steps.warnings(manifest(lambda t: 1 - abs(2 * t - 1), 20))
    assert not between_steps.warnings(manifest(lambda t: t, 1))
    # but fewer steps would miss them
    assert between_steps.departures(manifest(lambda t: 1 - abs(2 * t - 1), 20), stride=4)
    line, = between_steps.warnings(manifest(lambda t: -4 * t**2 + 5 * t, 5))
    assert "STEPS=10 follows it better" in line


@pytest.mark.slow
def test_time_share_of_one_step_and_of_a_missed_pulse(solved, budget_of, variant):
    """One step of a history that comes back tells nothing of the way; its share says so."""
    quantities = budget_of("model", loading="nonmonotone", cells=4, steps=1)["quantities"]
    true = solved("model", loading="nonmonotone", cells=4, steps=40).summary["quantities"]
    for name in ("dissipated_energy", "slip"):
        entry = quantities[name]
        assert entry["time"] >= abs(entry["value"] - true[name]), name
    # the load comes and goes between the first two of four steps
    missed = variant("pulse", ("-4*t^2 + 5*t", "max(0., 1 - abs(t - 0.37)/0.1)"))
    run = solved(missed, loading="nonmonotone", cells=4, steps=4)
    assert any("the steps do not follow it there" in line for line in run.summary["warnings"])
    found = budget_of(missed, loading="nonmonotone", cells=4, steps=4)
    entry = found["quantities"]["dissipated_energy"]
    true = solved(missed, loading="nonmonotone", cells=4, steps=100).summary["quantities"]
    assert entry["time"] >= abs(entry["value"] - true["dissipated_energy"])


@pytest.mark.slow
def test_proportional_loading_has_no_share_of_time(budget_of):
    found = budget_of("model", loading="monotone", cells=4, steps=1)
    for entry in found["quantities"].values():
        assert entry["time"] <= 1e-5 * abs(entry["value"])


FRICTION, NONE = SimpleNamespace(frictional=True), SimpleNamespace(frictional=False)


def obstacles(history, steps: int, rigid=True, far=0.0, t_end=2.0) -> ObstacleMotion:
    """Obstacles that sink by a history, of three nodes alike; as rigid bodies, or by distances."""
    times = np.linspace(0.0, t_end, steps + 1)
    sunk = np.tile([history(t) for t in times], (3, 1)).T
    none, shift = np.zeros((3, 2)), np.zeros((steps + 1, 3, 2))
    if rigid:
        shift[..., 1] = sunk
    return ObstacleMotion(times, far + sunk, shift, 0 * sunk, none, none, none,
                          missed={"obstacleY": (0.03, 0.2)})


@pytest.mark.parametrize("rigid", [True, False])
@pytest.mark.parametrize("turns, stride, missed", [(1.0, 10, 0.0), (1.0, 8, 1 / 4), (0.9, 10, 0.1),
                                                   (1.0, 4, 0.1)])
def test_obstacles_that_turn_between_the_steps(rigid, turns, stride, missed):
    """Rising to `turns` and at rest: steps, counted from the last one, that have the turn inside
    miss by the height of the triangle that they cut off.
    """
    motion = obstacles(lambda t: min(t, turns), 20, rigid, far=5.0)
    (name, (size, when)), = between_steps.of_obstacles(motion, 20, stride).items()
    assert name == ("obstacleY" if rigid else "the distance of an obstacle")
    ends = np.unique(np.r_[0, np.arange(20, -1, -stride)]) / 10
    left, right = ends[ends <= turns + 1e-9].max(), ends[ends > turns + 1e-9].min()
    cut = (turns - left) * (right - turns) / (right - left) / turns
    assert size == pytest.approx(cut, abs=1e-9) and (cut > 0.01) == (missed > 0)
    assert not cut > 0.01 or when == pytest.approx(turns)
    still = SimpleNamespace(steps=20, t_end=2.0, between={})
    assert between_steps.misses(FRICTION, still, motion, stride) == (missed > 0)
    assert not between_steps.misses(NONE, still, motion, stride)
    assert not between_steps.misses(FRICTION, still, None, stride)


@pytest.mark.parametrize("rigid, finer", [(True, 1), (False, 1), (True, 50), (False, 50)])
def test_a_force_is_open_by_what_an_obstacle_does_between_the_steps(rigid, finer):
    """It comes, turns between two of six steps and goes: 0.4 % were claimed of a force that erred
    by 9.9 %. From the departure that an export tells, or from finer times. An even motion leaves
    nothing open, nor does a departure in other steps.
    """
    def history(t):
        return t / 0.32 if t < 0.32 else 1.0 - 0.68 * (t - 0.32)

    def left(index, of, missed):
        motion = obstacles(of, 6 * finer, rigid, t_end=1.0)
        motion.missed = {"obstacleY" if rigid else "gapInTime": missed}
        around = [{"normal_resultant": max(of(k / 6) - 0.86, 0.0)}
                  for k in range(index, index + 3)]
        return [between_steps.of_instant(still, index, around, each)["normal_resultant"]
                for each in (motion, None)]

    still = SimpleNamespace(steps=6, t_end=1.0, between={})
    chord = np.interp(0.3177, [1 / 6, 2 / 6], [history(1 / 6), history(2 / 6)])
    away = (history(0.3177) - chord) / history(2 / 6)
    missed = history(0.32) - history(2 / 6)
    assert missed <= left(1, history, (away, 0.3177))[0] <= 10 * missed
    if finer == 1:
        with_motion, without = left(3, history, (away, 0.3177))
        assert with_motion == without
    with_motion, without = left(3, lambda t: t, (0.0, 0.0))
    assert with_motion == without


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("far", [0.0, -0.5, -20.0])
def test_a_surface_that_turns_between_steps_counts_beside_a_motion(moves, far):
    """What is missed of its distance is a part of the change, wherever it begins: from 0.5 to -0.5
    half of it was taken, and nothing beside an obstacle that also slides.
    """
    def history(t):
        return t / 0.32 if t < 0.32 else 1.0 - 0.68 * (t - 0.32)

    motion = obstacles(history, 6, rigid=False, far=far, t_end=1.0)
    if moves:
        motion.shift[..., 0] = motion.times[:, None]
    ends, chord = np.array([1, 2, 3]), np.interp(0.3177, [1 / 6, 2 / 6],
                                                 [history(1 / 6), history(2 / 6)])
    motion.missed = {"gapInTime": ((history(0.3177) - chord) / history(2 / 6), 0.3177)}
    beyond = max(excess for _, excess in between_steps._ways_of_obstacles(motion, 6, ends))
    missed = history(0.32) - history(2 / 6)
    assert missed <= beyond <= 10 * missed


@pytest.mark.parametrize("turn, steps, said", [
    (360.0, 40, "by 9 rad, 1.4 turns, in step 1:"), (360.0, 400, ""),
    (2 * np.pi, 2, "by 3.14 rad, 0.5 turns, in step 1:"), (2 * np.pi, 3, ""), (0.0, 5, "")])
def test_steps_that_turn_an_obstacle_too_far_are_named(turn, steps, said):
    motion = obstacles(lambda t: 0.0, steps)
    motion.angle = np.tile(np.linspace(0.0, turn, steps + 1), (3, 1)).T
    lines = between_steps.half_turns(motion)
    assert len(lines) == bool(said)
    assert all(said in line and "angles are in radians" in line for line in lines)
    assert between_steps.half_turns(None) == []


def test_steps_of_an_obstacles_own_number_miss_what_the_export_saw():
    motion = obstacles(lambda t: t, 20)
    assert between_steps.of_obstacles(motion, 20) == motion.missed
    assert between_steps.of_obstacles(motion, 10)["obstacleY"][0] == pytest.approx(0, abs=1e-12)
    rough = obstacles(lambda t: 1e-16 * (t > 1), 20, rigid=False, far=5.0)
    assert not between_steps.of_obstacles(rough, 20, 8)  # rounding of a distance is no motion


def test_loads_that_turn_between_the_steps_are_missed():
    history = manifest(lambda t: min(t, 0.5), 20)
    assert [between_steps.misses(FRICTION, history, None, stride) for stride in (1, 2, 4, 8)] == [
        False, False, True, True]
    assert not between_steps.misses(NONE, history, None, 8)


@pytest.mark.parametrize("history, steps, parts", [
    (lambda t: t, 2, 4),  # followed anyway
    (lambda t: np.sin(5 * t), 4, 8),  # turns back at 0.94: 16 steps are off by 1.2 % there
    (lambda t: np.sin(5 * t), 2, 8),  # samples tell no more
    (lambda t: np.sin(5 * t), 6, 4), (lambda t: 0.0 if t < 0.5 else 1.0, 2, 4)])
def test_steps_are_cut_until_they_miss_nothing(history, steps, parts):
    """As far as that needs no more than sixty-four; not for jumps, which any miss."""
    assert between_steps.finer(manifest(history, steps), None, 4, 64) == parts


@pytest.mark.parametrize("steps, parts", [(1, 64), (2, 32), (5, 8), (16, 4), (40, 4)])
def test_steps_are_cut_as_often_as_allowed_where_they_miss_what_an_obstacle_does(steps, parts):
    """How many follow it no export tells."""
    still = SimpleNamespace(steps=steps, t_end=2.0, between={})
    motion = obstacles(lambda t: t, steps)
    assert between_steps.finer(still, motion, 4, 64) == parts
    motion.missed = {"obstacleY": (0.005, 0.2)}
    assert between_steps.finer(still, motion, 4, 64) == 4


TURNS = """include "scene.idp"
quasistatic(1.);
body = square(12, 6, [12. * x, 4. * y]);
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(3, u2 = 0.) //
macro displacement1() on(3, u1 = 0.05) //
macro amplitude1(t) (sin(5. * t)) //
macro contact() 1 //
macro gap() -0.02 //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.slow  # two runs with claims
def test_a_turn_that_all_companions_would_miss_is_claimed(solved, tmp_path):
    """In two, four and eight steps the body ends sliding one way; it has turned back before."""
    path = tmp_path / "turns.edp"
    path.write_text(TURNS)
    few, many = (solved(path, subdomains=3, steps=steps, errors=errors).summary
                 for steps, errors in ((2, "yes"), (30, "no")))
    value, other = (run["quantities"]["tangential_resultant"] for run in (few, many))
    claim = few["errors"]["quantities"]["tangential_resultant"]["time"]
    assert 0.05 * abs(value) < abs(value - other) < claim


def test_a_kink_or_a_jump_takes_other_steps_than_twice_as_many():
    """A kink at a third of the time is at no end of 10, 20, 40, ... steps, but of 12; a jump at no
    number that is looked at.
    """
    histories = {"even": lambda t: t, "kink": lambda t: min(3 * t, 1.0),
                 "jump": lambda t: float(t > 0.477)}
    found = {name: between_steps.more_steps(manifest(history, 10))
             for name, history in histories.items()}
    assert found == {"even": 20, "kink": 12, "jump": None}
