"""What load histories do between the steps: kinks and pulses that steps miss.

Steps follow straight lines from one of their ends to the next. Where a history departs from them by
more than `NOTICEABLE` of its largest value, the step before does not know of the load that the
scene declares: an extreme is cut off, a pulse is not there.
"""

from dataclasses import dataclass

import numpy as np

NOTICEABLE = 0.01
ROUNDING = 1e-9  # part of a distance by which one that stays the same may change
SHARP = 8.0  # a turn that is so many times as large as the median one is a kink
MOST = 20  # times the steps, up to which a number is looked for that has kinks at its ends
LEADING = "normal_resultant", "displacement"  # whose largest value is the moment of all others
HALF = 0.5  # of a step, by which a moment may be off where loads go beyond their steps
# of a history, between the times at which an export looks at an obstacle's (obstacle_motion.idp)
SAMPLES = {"obstacleX": 1 / 160, "obstacleY": 1 / 160, "obstacleAngle": 1 / 160,
           "gapInTime": 1 / 80, "obstacleInTime": 1 / 80}
SURFACES = "gapInTime", "obstacleInTime"  # distances, of which departures are parts of their change
TANGENT = 2.0  # slope of a force over the mean one since contact began, at most
CLOSE = 0.02  # part of a step by which a kink may miss its end


@dataclass
class Departure:
    """Largest departure of a history from the steps, relative to its largest value."""

    amplitude: str
    size: float
    step: int
    time: float
    kinks: np.ndarray  # times
    follows: int = 0  # how many times the steps halve the departure; 0: none that samples tell


def departures(manifest, stride: int = 1) -> list[Departure]:
    """Of the histories that depart noticeably from every `stride`-th step, counted from the last.
    """
    found = []
    for number, times, fine, per_step in _histories(manifest):
        away, largest = _away(times, fine, per_step * stride), np.abs(fine).max()
        k = int(away.argmax())
        if away[k] > NOTICEABLE * largest:
            follows = next((n for n in range(2, per_step) if per_step % n == 0 and _away(
                times, fine, per_step // n).max() <= away[k] / 2), 0)
            found.append(Departure(number, float(away[k] / largest), k // per_step + 1,
                                   float(times[k]), _kinks(times, fine), follows))
    return found


def of_obstacles(motion, steps: int, stride: int = 1) -> dict[str, tuple[float, float]]:
    """Departures of an ObstacleMotion from every `stride`-th of `steps`, and when, by name.

    Relative to the largest value; of what has more times than steps those tell. Distances, which
    follow from rigid motions where there are any, count where there are none.
    """
    every = (len(motion.times) - 1) // steps * stride
    if every <= 1:
        return motion.missed
    parts = {"obstacleX": motion.shift[..., 0], "obstacleY": motion.shift[..., 1],
             "obstacleAngle": motion.angle}
    moving = {name: values for name, values in parts.items() if np.ptp(values, axis=0).any()}
    if not moving and len(motion.gap) == len(motion.times):
        moving = {"the distance of an obstacle": motion.gap}
    found = {}
    for name, values in moving.items():
        moved = np.unique((values - values[0]).T, axis=0).T  # nodes of an obstacle have one history
        away = np.array([_away(motion.times, column, every) for column in moved.T]).T
        largest = np.abs(moved).max(initial=0.0)
        if largest > ROUNDING * np.abs(values).max(initial=0.0):
            k = int(away.max(axis=1).argmax())
            found[name] = float(away[k].max() / largest), float(motion.times[k])
    return found


def of_earlier_moment(manifest, record, at: int, motion=None) -> dict[str, float]:
    """What steps leave open of the quantities of the step `at`, an index in the `record`, where
    they do not belong to the last one: as `of_instant`, empty for the last.

    `manifest` and the ObstacleMotion `motion` have the declared history, of which cycles are
    repeated.
    """
    if at >= len(record.displacements) - 1:
        return {}
    index = at if record.cycles is None else record.cycles.place(at + 1) - 1
    return of_instant(manifest, index, record.beside(at), motion)


def of_instant(manifest, index: int, beside: list[dict], motion=None) -> dict[str, float]:
    """What steps leave open of the quantities in that with an `index` in the history, at which
    contact carries most, or the body deforms most: the moment may lie between it and the steps
    `beside` it, the one before and the one after.

    Its place is the largest value of the quantity that it belongs to, on the parabola through the
    three; other quantities are followed there along their own parabolas. Where loads, or obstacles
    with a `motion`, go beyond what they are in these steps it is elsewhere: others are followed by
    half a step to either side.
    And by loads: how far these go beyond, times what the quantity changes by between these steps
    over what the load does, on the side where it is steeper, see `_steepest`; where the load goes
    farther beyond them than it changes, times the quantity over the load.
    """
    ends = np.arange(index, min(index + 2, manifest.steps) + 1)
    histories = [(fine[ends * per_step], _excess(fine, per_step, ends))
                 for _, _, fine, per_step in _histories(manifest)]
    histories += _ways_of_obstacles(motion, manifest.steps, ends) if motion else []
    goes = any(excess > 0 for _, excess in histories)
    leading = next((name for name in LEADING if name in beside[0]), None)
    found = {}
    for name in beside[0]:
        values = np.array([each[name] for each in beside])
        own = np.array([each[leading or name] for each in beside])
        other = goes and leading not in (None, name)
        places = [_place(own), *((-HALF, HALF) if other else ())]
        beyond = sum(_beyond(at_ends, excess, values) for at_ends, excess in histories)
        found[name] = float(max(beyond, *(_departs(values, place) for place in places)))
    return found


def _place(values: np.ndarray) -> float:
    """Of the extreme of the parabola through three `values`, in steps from the middle one; 0 where
    there are not three, or there is none between the outer ones.
    """
    bend, slope = _parabola(values)
    return -slope / bend if abs(bend) > abs(slope) else 0.0


def _departs(values: np.ndarray, place: float) -> float:
    """Change of the parabola through three `values` from the middle one to a `place`."""
    bend, slope = _parabola(values)
    return abs(slope * place + bend * place**2 / 2)


def _parabola(values: np.ndarray) -> tuple[float, float]:
    """Second and first differences of three `values` about the middle one; 0 of fewer."""
    if len(values) < 3:
        return 0.0, 0.0
    return values[0] - 2 * values[1] + values[2], (values[2] - values[0]) / 2


def _excess(fine: np.ndarray, per_step: int, ends: np.ndarray) -> float:
    """How far a history goes beyond its values at the steps `ends` between them."""
    at_ends = fine[ends * per_step]
    between = fine[ends[0] * per_step:ends[-1] * per_step + 1]
    excess = max(_top(between) - at_ends.max(), at_ends.min() + _top(-between))
    return float(excess) if excess > ROUNDING * np.abs(at_ends).max() else 0.0


def _top(values: np.ndarray) -> float:
    """The largest of a history, from samples: at a kink between them the lines on both sides meet
    above all of them, by no more than to the next sample.
    """
    k = int(values.argmax())
    if not 3 <= k < len(values) - 3:
        return float(values[k])
    rise, fall = values[k - 1] - values[k - 2], values[k + 1] - values[k + 2]
    beside = np.abs(np.diff(values[k - 3:k + 4], 2))[[0, -1]].max()
    if min(rise, fall) <= 0 or rise + fall <= SHARP * beside:  # it turns smoothly
        return float(values[k])
    # lines through the samples k - 2, k - 1 and k + 1, k + 2, at the place where they meet
    meet = (values[k - 1] * fall + values[k + 1] * rise + 2 * rise * fall) / (rise + fall)
    return float(np.clip(meet, values[k], 2 * values[k] - values[[k - 1, k + 1]].min()))


def _ways_of_obstacles(motion, steps: int, ends: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Of the history of every obstacle's shift or angle, of an ObstacleMotion, and if there is none
    or its surface changes of the distance that changes most: its values at the steps `ends`, and
    how far it goes beyond them. An export tells only by how much it departs most from its steps,
    and when, to a sample.
    """
    every, found = (len(motion.times) - 1) // steps, []
    if not every:  # fewer times than steps tell nothing
        return []
    parts = {"obstacleX": motion.shift[..., 0], "obstacleY": motion.shift[..., 1],
             "obstacleAngle": motion.angle}
    if len(motion.gap) == len(motion.times):
        most = np.ptp(motion.gap, axis=0).argmax(keepdims=True) if motion.gap.size else []
        moves = any(values.any() for values in parts.values())
        names = motion.missed.keys() & SURFACES if moves else motion.missed
        parts = (parts if moves else {}) | {name: motion.gap[:, most] for name in sorted(names)}
    times = motion.times[ends * every]
    for name, values in parts.items():
        size, when = motion.missed.get(name, (0.0, 0.0))
        # that of which the size is a part; a whole one may be more than any change that steps show
        start = values[0] if name in SURFACES and size < 1 else 0.0
        largest = np.abs(values - start).max(initial=0.0)
        near = when + SAMPLES.get(name, 0.0) * motion.times[-1] * np.array([-1.0, 0.0, 1.0])
        _, first = np.unique(np.round(values / (largest or 1.0), 9).T, axis=0, return_index=True)
        for column in values.T[first]:
            at_ends, excess = column[ends * every], _excess(column, every, ends)
            if times[0] < when < times[-1]:
                chord = np.interp(near, times, at_ends)
                excess = max(excess, chord.max() + size * largest - at_ends.max(),
                             at_ends.min() - chord.min() + size * largest)
            found.append((at_ends, float(excess)))
    return found


def _beyond(at_ends: np.ndarray, excess: float, values: np.ndarray) -> float:
    """Change of a quantity with `values` in steps by what a history does beyond `at_ends` there."""
    if not excess:
        return 0.0
    if np.ptp(at_ends) > excess:
        return float(excess * max(np.ptp(values) / np.ptp(at_ends),
                                  _steepest(at_ends, values, excess)))
    return float(excess * np.abs(values).max() / max(np.abs(at_ends).max(), excess))


def _steepest(loads: np.ndarray, values: np.ndarray, least: float) -> float:
    """Slope of a quantity over a load beyond what it is in two or three steps, from its slopes
    between them where the load changes by more than `least`; 0 where it does nowhere.

    Contact stiffens as it grows: forces go like a power of the approach up to the second, of a
    cone, whose slope at the end is twice that from where it began. It is the steeper slope times
    its ratio to the other one, at most TANGENT; that much where there is no other one. A force that
    is zero under a load begins between the steps: about halfway.
    """
    change = np.abs(np.diff(loads))
    none = (values == 0) & (np.abs(loads) > least)
    part = np.where(none[1:] | none[:-1], HALF, 1.0) * change
    slopes = np.sort(np.abs(np.diff(values))[change > least] / part[change > least])
    if not len(slopes):
        return 0.0
    known = len(slopes) > 1 and slopes[0] > 0
    return float(slopes[-1] * (min(TANGENT, slopes[-1] / slopes[0]) if known else TANGENT))


def half_turns(motion) -> list[str]:
    """A line where a step turns an obstacle by half a turn or more, of an ObstacleMotion or None.

    Friction has the whole way, but of where the obstacle stands in between the step sees nothing.
    """
    if motion is None:
        return []
    turns = np.abs(np.diff(motion.angle, axis=0)).max(axis=1, initial=0.0)
    k = int(np.argmax(turns >= turns.max() * (1 - ROUNDING)))
    if turns[k] < np.pi * (1 - ROUNDING):
        return []
    return [f"obstacleAngle turns an obstacle by {turns[k]:.3g} rad, {turns[k] / (2 * np.pi):.2g} "
            f"turns, in step {k + 1}: positions in between are not computed; angles are in "
            "radians: if this is intended, use more STEPS"]


def misses(effects, manifest, motion, stride: int) -> bool:
    """Whether every `stride`-th step misses noticeably what a load or an obstacle does.

    Without friction the end does not depend on the way to it: nothing is missed.
    """
    if not effects.frictional:
        return False
    return bool(departures(manifest, stride)) or bool(
        motion and _missing(motion, manifest.steps, stride))


def _missing(motion, steps: int, stride: int = 1) -> bool:
    """Whether every `stride`-th of `steps` misses noticeably what an ObstacleMotion does."""
    return any(size > NOTICEABLE for size, _ in of_obstacles(motion, steps, stride).values())


@dataclass
class Strides:
    """Every how many of the steps of a run its companions may take."""

    effects: object
    manifest: object
    motion: object | None  # of obstacles, contact.motion.ObstacleMotion of all times

    def up_to(self, wanted: int) -> int:
        """The largest of 4, 2, 1 up to `wanted` that leaves a step."""
        return max(stride for stride in (1, 2, 4) if stride <= min(wanted, self.manifest.steps))

    def misses(self, stride: int) -> bool:
        """Whether every `stride`-th time misses what the history does."""
        return misses(self.effects, self.manifest, self.motion, stride)

    @property
    def of_coarse_meshes(self) -> int:
        """That of the times at which the two coarser meshes are compared: every second one, if
        histories with friction do not turn in between, whose end depends on the way.
        """
        return 1 if self.misses(2) else self.up_to(2)


def finer(manifest, motion, least: int, most: int) -> int:
    """Into how many parts steps are to be cut so that they miss nothing noticeable of the history.

    `least`, or two, four, ... times as many, as far as there are no more than `most` steps then, or
    half as many as samples. If these still miss something of the loads: the largest number if it
    halves that, else `least`, as it is at jumps. Of an obstacle's ObstacleMotion, or None, an
    export tells only how much its steps miss: where that is noticeable, as many as `most` allows.
    """
    if motion and _missing(motion, manifest.steps):
        return least * 2 ** max(int(np.log2(most / (least * manifest.steps))), 0)
    samples = min((len(history) - 1 for history in manifest.between.values()), default=0)
    parts, missed = least, [_missed(manifest, least)]
    while missed[-1] > NOTICEABLE and 2 * parts * manifest.steps <= min(most, samples // 2):
        parts *= 2
        missed.append(_missed(manifest, parts))
    return parts if missed[-1] <= max(NOTICEABLE, missed[0] / 2) else least


def _missed(manifest, parts: int) -> float:
    """The largest departure, relative to its largest value, of a history from steps cut so."""
    return max((_away(times, fine, max(per_step // parts, 1)).max() / np.abs(fine).max()
                for _, times, fine, per_step in _histories(manifest)), default=0.0)


def _histories(manifest):
    """Number, times, values and samples a step of every load's history but those that are zero."""
    for number, history in manifest.between.items():
        fine = np.array(history)
        if fine.any():
            yield (number, np.linspace(0.0, manifest.t_end, len(fine)), fine,
                   (len(fine) - 1) // manifest.steps)


def _away(times: np.ndarray, fine: np.ndarray, every: int) -> np.ndarray:
    """Distances of a history from the lines through `every` so many-th value of it."""
    ends = np.unique(np.r_[0, np.arange(len(fine) - 1, -1, -every)])
    return np.abs(fine - np.interp(times, times[ends], fine[ends]))


def _kinks(times: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Times at which a history turns sharply, where the lines before and after it meet."""
    slope = np.diff(fine) / np.diff(times)
    turn = np.abs(np.diff(slope))
    largest = turn.max(initial=0.0)
    sharp = (turn > 0.05 * largest) & (turn > SHARP * np.median(turn))
    kinks, k = [], 0
    places = np.flatnonzero(sharp)
    while k < len(places):
        first = last = places[k]
        while k + 1 < len(places) and places[k + 1] == last + 1:
            k += 1
            last = places[k]
        before, after = slope[first], slope[last + 1]
        if last - first < 3 and before != after:
            # through the points before the first and after the last sharp turn
            a, b = first, last + 2
            kinks.append((fine[b] - fine[a] + before * times[a] - after * times[b])
                         / (before - after))
        k += 1
    return np.array(kinks)


def steps_at(kinks: np.ndarray, steps: int, t_end: float) -> int | None:
    """The least number of steps, `steps` or more, that end at all kinks; None up to MOST times."""
    for n in range(steps, MOST * steps + 1):
        place = kinks * n / t_end
        if len(kinks) and np.abs(place - np.round(place)).max() <= CLOSE:
            return n
    return None


def more_steps(manifest) -> int | None:
    """How many equal steps leave less: twice as many, or the number that follows histories better
    which depart from the steps; None where none that was looked at does.
    """
    better = [_better(departure, manifest) for departure in departures(manifest)]
    return None if None in better else max(better, default=2 * manifest.steps)


def _better(departure: Departure, manifest) -> int | None:
    """The number of steps with an end at every kink, else one that halves the departure, if any."""
    at_kinks = steps_at(departure.kinks, manifest.steps, manifest.t_end)
    if at_kinks is not None and at_kinks > manifest.steps:
        return at_kinks
    return departure.follows * manifest.steps or None


def warnings(manifest, motion=None) -> list[str]:
    """A line for every history that the steps do not follow.

    `motion` is the ObstacleMotion of the contact boundary, None where no obstacle moves.
    """
    lines = [f"{name} deviates between steps by {100 * size:.0f} % of its largest value, most at "
             f"time {time:.4g}: the steps do not follow the obstacle there; use more STEPS, or for "
             "kinks stepTimes without STEPS"
             for name, (size, time) in (of_obstacles(motion, manifest.steps) if motion
                                        else {}).items() if size > NOTICEABLE]
    for d in departures(manifest):
        better = steps_at(d.kinks, manifest.steps, manifest.t_end)
        remedy = ("no number of equal steps tried is better: replace a jump by a ramp, use "
                  "stepTimes for a pulse")
        if d.follows:
            remedy = f"STEPS={d.follows * manifest.steps} follows it better"
        if better is not None and better > manifest.steps:
            remedy = f"STEPS={better} has a step end at every kink"
        lines.append(f"amplitude {d.amplitude} deviates between steps by {100 * d.size:.0f} % of "
                     f"its largest value, most in step {d.step} at time {d.time:.4g}: the steps do "
                     f"not follow it there; {remedy}")
    return lines
