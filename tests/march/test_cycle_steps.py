"""Cycles step by step, followed through a solver made by hand: rows, jumps, checkpoints."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.march.cycle_verdict import MOVED
from driver.march.cycles import SHORTEST, Cycles

BEGIN, LENGTH = 1, 2  # one step, then cycles of two
WORN = "wear.worn_depth"


class Effects:
    """One that carries a depth."""

    def __init__(self):
        self.depth = np.zeros(4)

    def carried(self) -> dict:
        return {WORN: self.depth}


class Slip:
    """Displacements of three rows, all of them elastic."""

    def __init__(self):
        self.elastic, self.weights = np.zeros(3), np.zeros(2)

    @property
    def u_t(self) -> np.ndarray:
        """(3,) displacements."""
        return self.elastic


def solver_of(count: int, choice: str, plan=None) -> tuple:
    """A solver of three tangential rows, of nodes 0, 1 and 3, at the start of so many cycles."""
    node = np.array([0, 1, 3])
    rows = SimpleNamespace(normal=np.arange(3), normal_node=node, tangential=3 + np.arange(3),
                           tangential_node=node)
    solver = SimpleNamespace(
        rows=rows, slip=Slip(), done=[], motion=np.zeros(1), older_motion=np.zeros(1),
        bodies=SimpleNamespace(placed=np.zeros((1, 3))), effects=Effects(),
        settings=SimpleNamespace(primal_rtol=1e-6),
        scales=SimpleNamespace(largest={"displacements": np.array([1.0])}),
        operator=SimpleNamespace(comm=MPI.COMM_SELF, structure=SimpleNamespace(
            contact=SimpleNamespace(gid=np.arange(4)))),
        times=np.array([0.0, 1.0, 2.0, 3.0]), amplitudes=np.array([[0.0], [1.0], [2.0], [1.0]]),
        loads=[1.0, 2.0, 1.0], history=SimpleNamespace(warnings=[]))
    of = Cycles(BEGIN, count, choice, plan)
    of.join(solver)
    return solver, of


def gone_through(solver, of, wears=lambda cycle: 1.0, upto=99) -> list:
    """Steps of a solver whose nodes slide by 1 to and by 0.5 fro; wear in a cycle `wears(cycle)`.

    Forces are those of the cycle's step.
    """
    steps, index = [], len(solver.done)
    while index + 1 < len(solver.times) and index < upto:
        index += 1
        of.before(solver, index)
        way = np.array([1.0, -0.5][index % 2] * np.ones(3))
        if index > BEGIN:
            solver.slip.elastic = solver.slip.elastic + way
            solver.effects.depth[[0, 1, 3]] += wears(of.past.number) / 2
            solver.motion = solver.motion + 0.25
            solver.bodies.placed = solver.bodies.placed + 0.125
        force = np.array([4.0, 4, 0, 2, -2, 0]) * (1 + index % 2)
        step = SimpleNamespace(index=index, time=solver.times[index], multipliers=force,
                               friction_bound=np.abs(force[3:]), cycle=0, skips=0, grown=())
        of.follow(solver, step, way)
        steps.append(step)
        solver.done.append(step)
    return steps


def test_a_history_goes_on_cycle_by_cycle():
    """Rows with what nodes have slid and carried on, times and factors repeated, no jump."""
    solver, of = solver_of(3, "")
    steps = gone_through(solver, of)
    assert len(steps) == of.total == BEGIN + 3 * LENGTH
    assert [step.cycle for step in steps] == [0, 0, 1, 0, 2, 0, 3]
    assert [row["cycle"] for row in of.past.rows] == [1, 2, 3]
    assert all(row["slip"] == 1.5 and row["drift"] == 0.5 and row["wear"] == 1.0
               for row in of.past.rows)  # of nodes on their bound
    np.testing.assert_allclose(solver.times, np.arange(8.0))
    assert solver.amplitudes.ravel().tolist() == [0, 1, 2, 1, 2, 1, 2, 1]
    assert solver.loads == [1, 2, 1, 2, 1, 2, 1]
    assert [of.place(k) for k in (1, 2, 3, 4, 5, 6)] == [1, 2, 3, 2, 3, 2]
    assert of.past.plan == [0, 0, 0] and of.past.rows[1]["settled"]


def test_cycles_end_when_they_have_settled():
    solver, of = solver_of(9, "until settled")
    gone_through(solver, of)
    assert of.past.number == 2 and len(solver.times) == 1 + BEGIN + 2 * LENGTH
    assert not of.warnings()
    fresh = solver_of(1, "1 until settled")
    gone_through(*fresh)
    assert "not settled after cycle 1" in fresh[1].warnings()[0]


def test_jumps_carry_on_what_grows():
    """By the growth of the last cycle, which bends by 1 % each: to err by 5 % of it, by 4 cycles;
    so the depth is that of so many cycles, and so are rigid motions.
    """
    solver, of = solver_of(20, "jump 5%")
    growing = []

    def wears(cycle):
        growing.append(cycle)
        return 1.0 + 0.01 * len(set(growing))

    steps = gone_through(solver, of, wears)
    plan = of.past.plan
    assert sum(plan) + len(plan) == 20 == of.past.number and plan[0] == 0 and max(plan) >= 2
    assert len(steps) == of.total == BEGIN + LENGTH * len(plan)
    jumps = [step for step in steps if step.skips]
    assert jumps and all(set(step.grown) == {MOVED, WORN} for step in jumps)
    # 0.5 a cycle in displacements and motions, whether computed or jumped over
    np.testing.assert_allclose(solver.slip.elastic, 20 * 0.5)
    np.testing.assert_allclose(solver.motion, 20 * 0.5)
    np.testing.assert_allclose(solver.bodies.placed, 20 * 0.25)  # bodies rest where they come to
    np.testing.assert_allclose(solver.older_motion, sum(plan) * 0.5)  # no step is as long as jumps
    grown = np.array([1.0 + 0.01 * (k + 1) for k in range(len(plan))])
    np.testing.assert_allclose(solver.effects.depth[[0, 1, 3]],
                               (grown * (1 + np.array(plan))).sum())
    assert solver.effects.depth[2] == 0.0
    assert all(step.skips <= 0.05 * 1.5 / 0.01 for step in jumps)
    following, again = solver_of(20, "", plan)
    gone_through(following, again)
    assert again.past.plan == plan and again.count == 20


@pytest.mark.parametrize("bends, settled, left, skips", [
    (0.0099, False, 50, 4), (0.0099, False, 4, 3), (0.0099, False, 3, 2), (0.0099, False, 2, 0),
    (0.0, False, 50, 49), (0.017, False, 50, 0), (0.016, False, 50, 2), (0.012, False, 50, 3),
    (None, True, 50, 49), (None, True, 2, 0), (None, False, 50, 0)])
def test_how_many_cycles_are_jumped_over(bends, settled, left, skips):
    """So many that what grows by 1 a cycle, and by more every time, errs by 5 % of that; one
    always is left, shorter jumps than SHORTEST do not pay, and what has settled needs no other.
    """
    solver, of = solver_of(60, "jump 5%")
    assert SHORTEST == 2
    of.past.number = 60 - left
    row = SimpleNamespace(settled=settled, slip=1.0)
    of.past.plan = [0]
    of.past.growth = {WORN: np.full(3, 1.0 - (bends or 0.0))}
    growth = {WORN: np.full(3, 0.0 if bends is None else 1.0)}
    assert of._skips(solver, row, growth) == skips
    if bends is not None:
        of.past.plan = [4]  # the growth before is that before a jump
        assert of._skips(solver, row, growth) == 0
        of.past.plan, of.past.growth = [0], {}
        assert of._skips(solver, row, growth) == 0
    plain = solver_of(60, "")[1]
    assert plain._skips(solver, row, growth) == 0
    given = solver_of(60, "jump 5%", [2, 7, 1])[1]
    given.past.plan = [2]
    assert given._skips(solver, row, growth) == 7 and given.count == 3 + 10


@pytest.mark.parametrize("name, size, error, told", [
    (WORN, 1.0, 3e-3, False), (WORN, 1.0, 3e-1, True), ("accumulated_slip", 1.0, 3e-3, False),
    ("accumulated_slip", 1e-3, 3e-3, True)])
def test_a_jump_that_errs_by_more_than_was_foreseen_is_said(name, size, error, told):
    """In what grows, of a law of slip what has been slid."""
    solver, of = solver_of(9, "jump 1%")
    row = SimpleNamespace(drift=1e-6, slip=1.0, error=error, skipped=5, cycle=7)
    growth = {name: np.array([0.5, 1.0]) * size}
    of._warn(solver, row, growth)
    assert len(solver.history.warnings) == told
    row.skipped = 0
    of._warn(solver, row, growth)
    assert len(solver.history.warnings) == told


@pytest.mark.parametrize("stop", [2, 3, 4, 6])
def test_cycles_go_on_from_a_checkpoint(stop):
    """Wherever they were: the same rows, plan and forces as without a stop."""
    whole, of = solver_of(6, "jump 5%")
    gone_through(whole, of)
    solver, first = solver_of(6, "jump 5%")
    gone_through(solver, first, upto=stop)
    state = first.kept(solver)
    other, again = solver_of(6, "jump 5%")
    other.slip.elastic, other.motion = solver.slip.elastic.copy(), solver.motion.copy()
    other.effects.depth[:] = solver.effects.depth
    other.done = list(solver.done)
    again.resume(other, state)
    np.testing.assert_allclose(other.times, solver.times)
    np.testing.assert_allclose(other.amplitudes, solver.amplitudes)
    assert other.loads == solver.loads
    for part in ("older", "before"):
        kept, found = getattr(first.past, part), getattr(again.past, part)
        assert set(found) == set(kept) and all((found[name] == kept[name]).all() for name in kept)
    gone_through(other, again)
    assert again.past.plan == of.past.plan
    for one, two in zip(again.past.rows, of.past.rows, strict=True):
        assert one == pytest.approx(two)
    np.testing.assert_allclose(other.slip.elastic, whole.slip.elastic)
