"""Parts of a time step by themselves, on rows and a dual matrix made by hand."""

import functools
import io
import tracemalloc
import zlib
from types import SimpleNamespace

import constants
import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.kkt import Scales
from driver.contact.law import ContactLaw
from driver.contact.rows import ContactRows
from driver.contact.states import OPEN, SLIP, STICK
from driver.effects import Effect
from driver.march import cycle_verdict as cycles
from driver.march import checkpoint, globalization
from driver.march import relaxation as relaxation_module
from driver.march.closure import Closure
from driver.march.cycle_verdict import MOVED, WORN, Past, judged
from driver.march.following import (AFRESH, COMBINED, EACH, PLAIN, SHARES, FollowingSolver,
                                    _Nearing, by_much)
from driver.march.friction_qp import FrictionQP
from driver.march.packing import Stack, pack, unpacked
from driver.march.relaxation import ContactRelaxation
from driver.march.slip import FAR, SlipState
from driver.march.step import WINDOW, History, Trace, Unfinished
from driver.march.uniqueness import CONDENSED_NODES, FEW, SMALL, Uniqueness, too_many, worthwhile
from driver.options import Settings
from driver.qp import complementarity
from driver.qp.branching import Search
from driver.qp.coulomb import CoulombProblem
from driver.qp.box import projected_gradient


def rows(n=2, **more) -> ContactRows:
    """n normal rows, then n tangential ones, then a gluing one."""
    node = np.arange(n)
    return ContactRows(**{
        "normal": node, "normal_node": node, "gap": np.zeros(n), "tangential": n + node,
        "tangential_node": node, "pair": node, "coefficient": np.full(n, 0.5), "offset": None,
        "gluing": np.array([2 * n]), "pulls": np.zeros(n, bool), **more})


def matrix(seed: int, size: int) -> np.ndarray:
    root = np.random.default_rng(seed).standard_normal((size, size + 2))
    return root @ root.T


# ------------------------------------------------------------------------------ rows

def test_states_and_bounds_of_rows():
    """Open where no force acts, unless contact pulls; slipping on the bound, where there is one."""
    one = rows(4, pulls=np.array([False, False, False, True]), offset=np.array([0, 0.25, 0, 0]))
    x = np.array([0.0, 2, 2, -2, 0.5, 1.25, 0.75, -1.0, 9])
    np.testing.assert_array_equal(one.friction_bound(x), [0, 1.25, 1, 1])
    assert one.states(x).tolist() == [OPEN, SLIP, STICK, SLIP]
    lower, upper = one.limits(9, x)
    inf = np.inf
    assert lower.tolist() == [0, 0, 0, -inf, 0, -1.25, -1, -1, -inf]
    assert upper.tolist() == [inf] * 4 + [0, 1.25, 1, 1, inf]
    assert one.sliding(x, one.friction_bound(x)).tolist() == [1, 1, 0, -1]
    for part, signs in ((1 - 1e-14, [1, 1, 0, -1]), (1 - 1e-12, [1, 0, 0, 0])):  # rounding, and not
        inside = np.append(x[:4], part * x[4:])
        assert one.sliding(inside, one.friction_bound(x)).tolist() == signs
    pressed = one.pressing(x - [1, 0, 0, 0, 0, 0, 0, 0, 0])
    assert pressed[:4].tolist() == [0, 2, 2, -2]
    more = np.array([4.0, 4, 4, -4, 9, -9, 0.5, 0.5, 0])
    moved = one.follow(more, np.array([1.0, -1, 0, 0]))
    assert moved.tolist() == [4, 4, 4, -4, 2, -2.25, 0.5, 0.5, 0]
    assert one.follow(more, np.zeros(4)).tolist() == [4, 4, 4, -4, 2, -2.25, 0.5, 0.5, 0]
    free = rows(4, coefficient=None)
    assert free.bound_is_given and not free.friction_bound(x).any()
    assert free.states(x).tolist() == [OPEN, SLIP, SLIP, SLIP]
    idle = rows(4, idle=np.array([1, 5]))
    assert [limit[[1, 5]].tolist() for limit in idle.limits(9, x)] == [[0, 0], [0, 0]]


@pytest.mark.parametrize("coefficient, offset, expected", [
    (None, None, [0, 0]), (None, [3.0, 4.0], [3, 4]), ([0.5, 0.25], None, [1, 1]),
    ([0.5, 0.25], [3.0, 4.0], [4, 5])])
def test_friction_bounds_are_affine(coefficient, offset, expected):
    law = ContactLaw(*(None if of is None else np.array(of) for of in (coefficient, offset)),
                     np.zeros(2, bool))
    assert law.friction_bound(np.array([2.0, -4.0])).tolist() == expected


# ------------------------------------------------------------------------------ the QP

def qp(F: np.ndarray, rows_: ContactRows, scale=None, **operator) -> FrictionQP:
    """What measures displacements of the rows of F."""
    n = len(F)
    found = object.__new__(FrictionQP)
    found.rows, found.scale = rows_, np.ones(n) if scale is None else scale
    found.bound, found.scales, found.settings = 1.0, Scales(), Settings(rtol=1e-3)
    found.operator = SimpleNamespace(**{
        "comm": MPI.COMM_SELF, "dot": np.dot, "apply": lambda x: F @ x, "travels": {}, "modes": 0,
        "owned": n, "levels": 1, "minimum": lambda value: value,
        "structure": SimpleNamespace(contact=SimpleNamespace(motion=None)), **operator})
    return found


@pytest.mark.parametrize("carried", [{"modes": 1}, {"travels": {0: None}}, {
    "structure": SimpleNamespace(contact=SimpleNamespace(motion="some"))}, {}])
def test_displacements_that_are_to_be_overcome(carried):
    """Openings as far as the load's own response is one, slips from where nodes were, and of what
    carries bodies no more than of the rest or of what forces move.
    """
    one = rows(2, gap=np.array([0.5, 0.0]), pulls=np.array([False, True]))
    scale = np.array([1.0, 1, 2, 4, 1])
    elastic, before = np.array([0.25, -3.0, 1.0, 1.0, 0.125]), np.array([0.75, 1.0])
    rigid, moved = np.array([-9.0, -1.0, 100.0, -0.25, 0.0]), np.array([0, 0, 0, 0, 6.0])
    found = qp(np.eye(5), one, scale, **carried)
    # over: 0.25 - 9 - 0.5, but not beyond -0.25; bilateral: -3 - 1 in whole
    seen = np.array([-0.25, -4.0, 0.25, 0.0, 0.125])
    if carried:
        seen[2:4] += [6.0 / 2, -0.25]
    assert found.extent(elastic, rigid, before, moved) == pytest.approx(
        np.linalg.norm(scale * seen))


def test_travel_alone_deforms_by_given_friction():
    """No load, no pressure: what the offset of the bound moves is to be overcome."""
    F, offset = matrix(1, 5), np.array([0.5, 0.25])
    found = qp(F, rows(2, offset=offset), modes=1)
    rigid = np.array([0, 0, 3.0, -2.0, 0])
    none = np.zeros(5)
    moved = F @ np.array([0, 0, 0.5, -0.25, 0])
    limit = np.abs(moved).max()
    assert found.extent(none, rigid, np.zeros(2), none) == pytest.approx(
        np.linalg.norm(np.clip([0, 0, 3.0, -2.0, 0], -limit, limit)))
    found.rows.offset = None
    assert found.extent(none, rigid, np.zeros(2), none) == 0.0


def test_tolerances_and_sizes_of_a_qp():
    """Part of the step's own, and no finer than rounding; norms in the scale of the rows."""
    F = np.diag([1.0, 2, 3, 4, 5])
    found = qp(F, rows(), np.full(5, 2.0))
    found.scales.d = 10.0
    for part, tol in ((1.0, 1e-2), (0.1, 1e-3), (1e-20, 1e-13)):
        found.aim(part, np.ones(5))
        assert found.tol == pytest.approx(tol)
    found.bound = 3.0
    assert found.size(np.array([3.0, 0, 4, 0, 0])) == 10.0
    assert found.largest(np.array([3.0, 0, 4, 0, 0])) == 7.5
    x = np.array([0.1, 0.2, 0.3, 0.4, 0.7])
    assert found.rounded(x) <= 1e-14 * found.size(F @ x)
    moved, gradient = found.placed(x, np.ones(5), 2 * x, x)
    np.testing.assert_allclose(gradient, F @ x - 1)
    assert found.placed(x, np.ones(5), x.copy(), x)[1] is x and moved is x
    np.testing.assert_allclose(found.placed(x, np.ones(5), x, None)[1], F @ x - 1)


@pytest.mark.parametrize("step", [1e-8, 1e-15, 1e-16])
@pytest.mark.parametrize("part", [1.0, 1e-5, 1e-10, 1e-20])
def test_no_qp_is_asked_for_more_than_products_round_off(part, step):
    """Here to multiples of a `step`, a part of the displacements to be overcome that may be larger
    or smaller than 1e-14 of them, but not by more than 1e-2. Far above it costs nothing.
    """
    products = []

    def product(x):
        products.append(x)
        return np.round(x / step) * step

    found = qp(np.eye(5), rows(), apply=product)
    found.scales.d = 10.0
    found.aim(part, np.full(5, 0.4 * step))  # 0, and of 3 x the third of a step
    least = max(2 * np.sqrt(5) * step / 3, 1e-15)
    assert found.tol == pytest.approx(max(part * 1e-2, least))
    assert len(products) == (2 if part < 1e-7 else 0)


def test_the_contact_problem_for_given_gluing_forces(monkeypatch):
    """Until a tenth of the whole residual is left; gradients of contact rows are those there."""
    F, d = matrix(2, 9), np.random.default_rng(3).standard_normal(9)
    near, scale = np.arange(6), np.random.default_rng(4).uniform(0.5, 2, 9)
    lower = np.r_[np.zeros(3), np.full(3, -0.2), np.full(3, -np.inf)]
    upper = np.r_[np.full(3, np.inf), np.full(3, 0.2), np.full(3, np.inf)]

    def scatter(values, into):
        into = into.copy()
        into[near] = values
        return into

    block = SimpleNamespace(gather=lambda x: x[near], scatter=scatter,
                            gathered=lambda *xs: np.array([x[near] for x in xs]),
                            apply=lambda x: F[:6, :6] @ x)
    deflation = SimpleNamespace(block=block, contact=None)
    history, bound = History(), 2 * np.linalg.norm(scale[:, None] * F * scale, 2)
    structure = SimpleNamespace(at_contact=SimpleNamespace(row=near), dual_dofs=9)
    relaxation = ContactRelaxation(SimpleNamespace(dot=np.dot, structure=structure), deflation,
                                   bound, scale, history)
    y = np.random.default_rng(5).standard_normal(9)
    gradient = F @ y - d
    x, g = relaxation(y, gradient, (lower, upper), 1e-12)
    np.testing.assert_array_equal(x[6:], y[6:])
    np.testing.assert_allclose(g[:6], (F @ x - d)[:6], atol=1e-10)
    assert (x >= lower).all() and (x <= upper).all()
    assert history.counts["contact_block_products"] > 0
    left = projected_gradient(x, F @ x - d, lower, upper)[:6]
    start = np.r_[np.clip(y, lower, upper)[:6], y[6:]]
    whole = np.r_[projected_gradient(start, F @ start - d, lower, upper)[:6], gradient[6:]]
    assert np.linalg.norm(left * scale[:6]) <= 0.1 * np.linalg.norm(whole * scale)
    relaxed = functools.partial(relaxation.relaxed, y, gradient, limits=(lower, upper), tol=1e-12)
    np.testing.assert_array_equal(relaxed(np.inf), x)
    np.testing.assert_array_equal(relaxed(1e-6), x)
    # without gluing a tenth of what the iterate has already, however far y is outside the box
    relaxation.whole = True
    before, counts = history.counts["contact_block_products"], history.counts
    np.testing.assert_array_equal(relaxed(np.inf), x)
    own = counts["contact_block_products"] - before
    relaxed(1e-6)  # a few products more, not as many as that takes: products with F are as cheap
    assert own < counts["contact_block_products"] - before - own <= own + relaxation_module.MORE
    monkeypatch.setattr(relaxation_module, "MORE", relaxation_module.LIMIT)
    better = relaxed(1e-6)
    assert np.linalg.norm(left * scale[:6]) > 1e-7
    left = projected_gradient(better, F @ better - d, lower, upper)[:6]
    assert np.linalg.norm(left * scale[:6]) <= 1e-7
    np.testing.assert_allclose(relaxation.moved(x, y, gradient)[:6],
                               (gradient + F[:, :6] @ (x - y)[:6])[:6])


# ------------------------------------------------------------------------------ slip

def slip_state(one: ContactRows, carried: np.ndarray, **effects) -> SlipState:
    """Slips of nodes that a pattern carries by `carried`, at 0.5 times that from the start."""
    def rigid(weights):
        full = np.zeros(5)
        full[one.tangential] = weights[0] * carried
        return full

    F = matrix(6, 5)
    operator = SimpleNamespace(
        structure=SimpleNamespace(patterns=1), modes=0, rigid_response=rigid,
        minimum=lambda value: value, apply=lambda x: F @ x,
        elastic_response=lambda weights: weights[0] * np.arange(5.0))
    return SlipState(operator, one, SimpleNamespace(**{"coefficient_changes": False, **effects}),
                     np.array([0.25, 0.5]))


def test_slip_is_measured_from_the_last_step():
    """Less the gradient; displacements are elastic ones and what carries the bodies, whose changes
    over the step and those of the obstacle are no deformation.
    """
    one, carried = rows(), np.array([2.0, 3.0])
    state = slip_state(one, carried)
    np.testing.assert_array_equal(state.u_t, [0.25, 0.5])
    state.way = np.array([0.125, 0.25])
    gradient = np.array([9.0, 9, -0.5, 1.0, 9])
    slip = state.advance(np.zeros(5), gradient, np.array([0.5]), Scales(
        displacements=np.array([1.0])))
    np.testing.assert_allclose(slip, [0.5, -1.0])
    # u_t goes by the slip and the obstacle's way
    np.testing.assert_allclose(state.u_t, [0.25 + 0.5 + 0.125, 0.5 - 1 + 0.25])
    np.testing.assert_allclose(state.elastic, state.u_t - 0.5 * carried)
    # so far that digits are lost: by what loads and multipliers move
    x = np.random.default_rng(7).standard_normal(5)
    state.advance(x, gradient, np.array([3 * FAR]), Scales(displacements=np.array([1.0])))
    np.testing.assert_allclose(state.elastic, (3 * FAR * np.arange(5.0) - matrix(6, 5) @ x)[2:4])


def test_coefficients_are_those_of_displacements_and_slips():
    """Of the latest iterate: the law gets where nodes are, and where they were, on the surface that
    has travelled.
    """
    asked = []

    def factor(nodes, u_t, last):
        asked.append((nodes, u_t, last))
        return 1 + np.abs(u_t - last)

    one = rows(coefficient=np.array([0.5, 0.25]))
    state = slip_state(one, np.zeros(2), coefficient_changes=True, coefficient_factor=factor)
    state.way, state.travelled = np.array([1.0, 1.0]), np.array([2.0, 0.5])
    state.renew_coefficient(np.array([9.0, 9, -0.5, 1.0, 9]))
    (nodes, u_t, last), = asked
    np.testing.assert_allclose(last, [0.25 - 2.0, 0.5 - 0.5])
    np.testing.assert_allclose(u_t, [0.75 - 2.0, -0.5 - 0.5])
    np.testing.assert_allclose(one.coefficient, [0.75, 0.5])
    assert nodes.tolist() == [0, 1]


# ------------------------------------------------------------------------------ laws of nodes

class Quadratic(Effect):
    """Nodes that yield by h = force^2, of which tangents know the last iterate."""

    closes = True

    def worn(self, nodes):
        return 0.125 * np.ones(len(nodes))

    def closure(self, nodes, force, slip):
        return force**2

    def tangent(self, nodes, force, own, slip, reach):
        return 2 * force, -force**2


def test_a_law_and_its_tangent_agree_at_last():
    """A spring of compliance 1 pushed by d over a gap with what has worn away:
    f + f^2 = d - gap - worn, by Newton's method.
    """
    d, gap = 5.0, 0.5
    one = rows(1, gap=np.array([gap]), tangential=np.zeros(0, int), pair=np.zeros(0, int),
               tangential_node=np.zeros(0, int), gluing=np.zeros(0, int), coefficient=None)
    softness = []
    operator = SimpleNamespace(comm=MPI.COMM_SELF, owned=1, row_level=np.zeros(1, int))
    qp_ = SimpleNamespace(rows=one, operator=operator,
                          soften=lambda full: softness.append(full[0]),
                          settings=Settings(primal_rtol=1e-12))
    room = object.__new__(Quadratic)
    closure = Closure(qp_, [room], SimpleNamespace(
        scales=SimpleNamespace(displacements=np.zeros(1))))
    closure.begin_step(False)
    assert one.gap[0] == gap + 0.125 and softness == [0.0]
    way = SimpleNamespace(shift=0.0)
    way.widen = lambda change: setattr(way, "shift", way.shift - change[0])
    again = []
    trace = SimpleNamespace(again=lambda: again.append(1))

    def solve(index, load, x, gradient, sliding, trace):
        force = max((d - one.gap[0] + load.shift * -1) / (1 + softness[-1]), 0.0)
        left = force * (1 + softness[-1]) - (d - one.gap[0] - load.shift)
        return np.array([force]), np.array([left]), 0.0, {"complementarity": 0.0}

    x, gradient, _, residuals = closure.settled(1, way, (np.ones(1), np.zeros(1), None), trace,
                                                solve)
    exact = (-1 + np.sqrt(1 + 4 * (d - gap - 0.125))) / 2
    assert x[0] == pytest.approx(exact, rel=1e-11) and gradient[0] == pytest.approx(0, abs=1e-11)
    assert closure.yielded(x)[0] == pytest.approx(exact**2)
    assert 3 < len(again) < 10 and residuals["complementarity"] <= 1e-12
    for pulls in (-3.0, -0.5):  # what pulls does not close
        force, own, slip = closure._state(np.array([pulls]), np.array([-0.25]))
        assert force[0] == 0.0 and slip[0] == 0.0 and own[0] == closure.offset.sum()
    closure.begin_step(True)  # gaps are those of the step already
    assert one.gap[0] == gap + 0.25 and not closure.slope.any()
    room.tangent = lambda nodes, force, own, slip, reach: (0 * force, 0 * force)
    with pytest.raises(Unfinished, match="still has an error of"):
        closure.settled(1, way, (np.ones(1), np.zeros(1), None), trace, solve)


# ------------------------------------------------------------------------------ states, cycles

def test_states_come_back_as_they_were():
    state = {"numbers": {"x": np.arange(3.0), "deep": {"k": np.array([[1, 2]])}}, "word": "a",
             "list": [1, 2.5, None], "flag": True, "empty": np.zeros((0, 2)),
             "column": np.arange(6.0).reshape(2, 3).T, "name": np.array("x"),
             "stack": Stack([np.array([1, 2]), np.array([0.5, 3])])}
    back = unpacked(packed(state))
    np.testing.assert_equal(back, state | {"stack": np.array([[1, 2], [0.5, 3]])})
    assert back["numbers"]["deep"]["k"].dtype == state["numbers"]["deep"]["k"].dtype


def packed(state):
    """What `pack` writes."""
    file = io.BytesIO()
    pack(state, file)
    return file.getvalue()


def test_states_are_written_without_a_copy(tmp_path):
    """Thirty arrays of a MiB, in a stack and one by one: what is at hand at a time is one."""
    state = {"steps": {"forces": Stack([np.full(2**17, float(k)) for k in range(30)])},
             **{f"array{k}": np.full(2**17, float(k)) for k in range(30)}}
    tracemalloc.start()
    checkpoint.write(tmp_path, state)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * 2**20
    content = (tmp_path / checkpoint.NAME).read_bytes()
    assert zlib.crc32(content[4:]).to_bytes(4, "little") == content[:4]
    assert unpacked(content[4:])["steps"]["forces"][:, 5].tolist() == list(range(30))


def test_series_end_in_their_limits():
    """1 + 1/2 + 1/4 + ... from any three terms; what does not lessen has none."""
    assert cycles.geometric(0.5, 0.5) == 0.5 and cycles.geometric(0.5, 1.0) == np.inf
    assert cycles.geometric(0.5, 0.0) == 0.0 and cycles.geometric(0.5, -0.5) == np.inf
    assert cycles.limit(1.0, 1.5, 1.75) == 2.0 and cycles.limit(4.0, 2.0, 1.0) == 0.0
    assert cycles.limit(3.0, 2.0, 2.0) == 2.0 and cycles.limit(1.0, 2.0, 4.0) == np.inf
    assert cycles.limit(2.0, 2.0, 3.0) == np.inf and cycles.limit(3.0, 1.0, 0.25) == 0.0


def largest(*arrays) -> float:
    return max((float(np.abs(of).max(initial=0.0)) for of in arrays), default=0.0)


@pytest.mark.parametrize("way, drift, worn, kind, settled", [
    ([0.0] * 4, [0.0] * 4, 0.0, cycles.SHAKEDOWN, True),
    ([8.0, 0.8, 0.08, 0.008], [1.0, 0.1, 0.01, 0.001], 0.0, cycles.SHAKEDOWN, True),
    ([8.0] * 4, [0.0] * 4, 0.0, cycles.ALTERNATING, True),
    ([8.0] * 4, [2.0] * 4, 0.0, cycles.RATCHETING, True),
    ([8.0, 7, 6, 5], [2.0, 1.9, 1.8, 1.7], 0.0, cycles.RATCHETING, False),
    ([8.0] * 4, [2.0, 0.2, 0.02, 0.002], 0.0, cycles.ALTERNATING, True),
    ([8.0] * 4, [0.0] * 4, 0.5, cycles.WEAR, True)])
def test_what_cycles_come_to(way, drift, worn, kind, settled):
    """By what slides in them and what of it comes back, of four cycles with the same forces."""
    past = Past()
    for number, (slid, carried) in enumerate(zip(way, drift), 1):
        past.number, past.way = number, np.array([slid, -0.5 * slid])
        growth = {MOVED: np.array([carried, 0.0])}
        if worn:
            growth[WORN] = np.array([worn, 0.0])
        forces = {"normal": np.ones((3, 2))}
        cycle = judged(past, SimpleNamespace(index=number, time=1.0 * number), growth, forces,
                       largest, 1e-6, 1e-5)
        past.rows.append(vars(cycle))
        past.before, past.growth = forces, growth
        past.plan.append(0)
    assert (cycle.kind, cycle.settled) == (kind, settled)
    assert (cycle.slip, cycle.drift, cycle.wear) == (way[-1], drift[-1], worn)
    assert cycle.change == cycle.remaining == 0.0
    assert past.rows[0]["change"] == 1.0 and not past.rows[0]["settled"] or not any(way)


@pytest.mark.parametrize("changes, remaining", [
    ([0.5, 0.1, 0.02], 0.02 * 0.2 / 0.8), ([0.5, 0.1, 0.1], 1.0), ([0.5, 0.1, 0.2], 1.0),
    ([0.5, 0.1, 0.0999], 1.0), ([0.5], 1.0), ([0.5, 0.1, 1e-6], 1e-6), ([0.5, 0.0, 0.1], 1.0)])
def test_what_forces_are_still_to_change_by(changes, remaining):
    """A series goes on as it has begun, to the whole at most; of what tolerances leave open no more
    than that; relative to the largest force, of any kind. Over a jump nothing is known.
    """
    forces = {"normal": np.array([[0.0]]), "tangential": np.array([[-4.0]])}
    past = Past(rows=[{"change": 1.0}], plan=[0])  # of the first cycle
    for change in changes:
        past.before = {"normal": forces["normal"] - 4.0 * change,
                       "tangential": forces["tangential"]}
        found = cycles._of_forces(past, forces, largest, 1e-5)
        assert found[0] == pytest.approx(change)
        past.rows.append({"change": found[0]})
        past.plan.append(0)
    assert found[1] == pytest.approx(remaining)
    assert cycles._of_forces(Past(), forces, largest, 1e-5) == (1.0, 1.0)
    past.plan[-1] = 3
    change, remaining = cycles._of_forces(past, forces, largest, 1e-5)
    assert change == pytest.approx(changes[-1] / 4)  # the mean of four cycles
    assert remaining == (1.0 if changes[-1] > 1e-5 else change)
    none = {"normal": np.zeros((1, 1)), "tangential": np.zeros((1, 1))}
    past.before = none
    assert cycles._of_forces(past, none, largest, 1e-5) == (0.0, 0.0)


def test_a_jump_errs_by_what_growth_bends_in_it():
    """Growth that has changed over a jump: by as much in each of the cycles skipped."""
    past = Past(number=9, plan=[0, 7], way=np.ones(1), growth={MOVED: np.array([1.0]),
                                                              WORN: np.array([2.0])},
                rows=[{"slip": 1.0, "drift": 1.0, "change": 0.0}], before={"n": np.ones((1, 1))})
    cycle = judged(past, SimpleNamespace(index=1, time=0.0),
                   {MOVED: np.array([0.9]), WORN: np.array([2.25]), "weights": np.array([99.0])},
                   {"n": np.ones((1, 1))}, largest, 1e-6, 1e-5)
    assert cycle.skipped == 7 and cycle.error == pytest.approx(7 * 0.25)
    assert not cycle.settled  # growth is not even


# ------------------------------------------------------------------------------ geometries

def facing(angle, gap, **more) -> SimpleNamespace:
    """Three contact nodes that meet the mean of the two places after theirs, of five."""
    normal = np.column_stack([np.sin(angle), -np.cos(angle)])
    boundary = SimpleNamespace(**{
        "gid": np.arange(3), "normal": normal, "gap": np.array(gap, float),
        "tangent": np.column_stack([-normal[:, 1], normal[:, 0]]), "idle": np.zeros(3, bool),
        "normal_row": np.array([2, 0, 1]), "term_node": np.repeat(np.arange(3), 3),
        "term_gid": np.add.outer(np.arange(3), np.arange(3)).ravel(),
        "term_value": np.tile([1.0, -0.5, -0.5], 3), **more})
    boundary.declared = boundary
    return boundary


def test_what_geometry_misses_is_a_distance_or_a_change_of_forces():
    """Of nodes that touch the change of their distance, of others what penetrates; forces by the
    largest change at a place.
    """
    rng = np.random.default_rng(8)
    used = facing([0.1, 0.2, 0.3], [0.5, 0.25, 0.125])
    u, forces = rng.random((5, 2)), np.array([2.0, 0.0, 1.0, 0.5, 0.0, -0.25, 0.0])
    solver = object.__new__(FollowingSolver)
    solver.contact, solver.rows = used, rows(3)
    solver.operator = SimpleNamespace(comm=MPI.COMM_SELF)
    solver.following = SimpleNamespace(gids=np.arange(5))
    solver.closure = SimpleNamespace(worn=0.0)
    solver.scales = Scales(displacements=np.array([4.0]), force=2.0)
    step = SimpleNamespace(index=1, multipliers=forces, status=np.array([STICK, OPEN, SLIP]))

    def over(of):
        jump = u[:3] - (u[1:4] + u[2:]) / 2
        return (of.normal * jump).sum(axis=1) - of.gap

    def pushed(of):
        force = forces[:3, None] * of.normal + forces[3:6, None] * of.tangent
        total = np.zeros((5, 2))
        for node in range(3):
            total[node] += force[node]
            total[node + 1 : node + 3] -= force[node] / 2
        return total

    for now in (facing([0.1, 0.2, 0.3], [0.5, 0.25, 0.625]),
                facing([0.1, 0.2, 0.3], [-9, 0, 0.125]),
                facing([0.1, 0.2, 0.3], [0.5, -9, 0.125]), facing([0.5, 0.2, 0.3], used.gap),
                facing([0.1, 0.2, 0.3], [0.5, 9, 0.125])):
        solver._about = lambda u, index, now=now: now
        change = np.abs(over(now) - over(used))
        error = np.array([change[0], max(over(now)[1], 0.0), change[2]])
        missed = max(error.max() / 4, np.abs(pushed(now) - pushed(used)).max() / 2)
        assert solver._missed(step, u, 0.0) == pytest.approx(missed, rel=1e-12)
        missed = max(error.max() / 8, np.abs(pushed(now) - pushed(used)).max() / 2)
        assert solver._missed(step, u, 8.0) == pytest.approx(missed, rel=1e-12)
    # an open node may be as far beyond as it has worn
    solver._about = lambda u, index: facing([0.1, 0.2, 0.3], [0.5, -9, 0.125])
    before, solver.closure.worn = solver._missed(step, u, 0.0), np.array([0.0, 20.0, 0.0])
    assert solver._missed(step, u, 0.0) < before
    solver.closure.worn = 0.0
    # what faces nothing has no distance
    now = facing([0.1, 0.2, 0.3], [-9, 0.25, 0.125], idle=np.array([True, False, False]))
    solver._about = lambda u, index: now
    assert solver._missed(step, u, 0.0) == pytest.approx(max(over(now)[:2].max(), 0.0) / 4)
    solver.scales = Scales()
    assert solver._missed(step, u, 0.0) == 1.0


def test_geometries_that_go_to_and_fro_are_combined():
    """Plain ones while they settle; then in combination, and at last by parts of the way."""
    nearing, u = _Nearing(), np.ones((2, 2))
    for k in range(8):
        np.testing.assert_array_equal(nearing.next(0 * u, u, 0.1**k), u)
    assert nearing.stalled is None
    # x -> 1 - 2 x goes away from its fixed point 1/3, which combinations come to
    nearing, x = _Nearing(), np.full((2, 2), 0.3)
    for _ in range(PLAIN + 6):
        x = nearing.next(x, 1 - 2 * x, float(np.abs(1 - 3 * x).max()))
    np.testing.assert_allclose(x, 1 / 3, atol=1e-8)
    assert PLAIN < nearing.stalled < nearing.count  # anew where a tenth was missed
    # those of before the last places are combined no more
    begun, nearing.begun = nearing.stalled, 1.0
    nearing.next(x, 1 - 2 * x, 2 * AFRESH)
    assert nearing.stalled == begun
    nearing.next(x, 1 - 2 * x, 0.5 * AFRESH)
    assert nearing.stalled == nearing.count and len(nearing.combined.points) == 1
    nearing.count = nearing.stalled + COMBINED - 1
    for share in [*[SHARES[0]] * EACH, *[SHARES[1]] * EACH, SHARES[1]]:
        np.testing.assert_allclose(nearing.next(0 * u, u, 1.0), share * u)


# ------------------------------------------------------------------------------ other solutions

def test_what_is_said_of_other_solutions():
    """The first step that has some, and whether others have; or why nothing is known."""
    found = Uniqueness(True)
    assert found.verdict == "not examined"
    found.examined = 3
    assert found.verdict == "no second solution found" and found.warnings() == []
    found.exhaustive = 3
    assert found.verdict == "unique"
    one = {"open": 1, "stick": 2, "slip": 3, "resultant_n": -4.5, "resultant_t": 0.25}
    found.several[2] = [one, one | {"stick": 0}]
    said, = found.warnings()
    assert said.startswith("step 2: the solution is not unique") and said.count(" open, ") == 2
    assert "2 stick, 3 slip, contact force -4.5 normal 0.25 tangential; 1 open, 0 stick" in said
    found.several[5] = []
    assert found.warnings()[0].startswith("step 2 and others: ")
    assert found.verdict == "not unique" and found.summary()["steps_not_unique"] == [2, 5]
    assert found.summary()["solutions"] == found.several[2]
    assert not found.ended and "UNIQUENESS" not in found.warnings()[0]
    asked_by_doubt = Uniqueness(True, examined=3, several={2: found.several[2]}, first_only=True)
    assert asked_by_doubt.ended and "UNIQUENESS=yes" in asked_by_doubt.warnings()[0]
    failed = Uniqueness(True, examined=1, exhaustive=1, failure="too many")
    assert failed.verdict == "not examined" and "too many" in failed.warnings()[0]
    assert Uniqueness(False).verdict == "unique"


@pytest.mark.parametrize("whole, isolated, proofs", [
    (True, True, 1), (True, False, 0), (False, True, 0), (False, False, 0)])
def test_a_proof_takes_all_states_and_isolated_solutions(monkeypatch, whole, isolated, proofs):
    """States of corners leave some out, and a singular system may hide a continuum."""
    problem = SimpleNamespace(n=1, rows=1, k=0, bilateral=np.zeros(1, bool), whole=lambda x: x,
                              scale=lambda x: float(x[0]))
    for name, value in (("newton", np.ones(1)), ("all_solutions", [np.ones(1)]),
                        ("all_isolated", isolated), ("index", 1)):
        monkeypatch.setattr(complementarity, name, lambda *_, value=value: value)
    found = Uniqueness(True)
    found.examine(1, problem, np.ones(1), np.ones(1), whole)
    assert found.examined == 1 and found.exhaustive == proofs and not found.several


@pytest.mark.parametrize("unit", [1.0, 1e6, 1e-6])
def test_solutions_are_told_exactly_in_any_unit(unit):
    """An open node that a drag presses down if friction resists it may stick, slide or stay open.
    The solution that is followed is known to a thousandth, and told exactly.
    """
    problem = CoulombProblem(np.array([[1.0, -0.8], [-0.8, 1.0]]), unit * np.array([-0.2, 0.5]),
                             np.array([2.0]), np.array([0]))
    solutions = complementarity.all_solutions(problem)
    assert len(solutions) == 3
    for z in solutions:
        if not z.any():
            continue
        found = Uniqueness(True)
        found.examine(7, problem, z * (1 + 1e-3), np.array([2.0]))
        first, *others = found.several[7]
        assert len(others) == 2
        assert first["resultant_n"] == pytest.approx(-z[0], rel=1e-9)
        assert first["resultant_t"] == pytest.approx(-z[1], rel=1e-9)
        assert first["largest_nodal_pressure"] == pytest.approx(z[0] / 2.0, rel=1e-9)
        assert sum(of["index"] for of in found.several[7]) == 1
        # beside forces of which all that there are is rounding
        found.several.clear()
        found.examine(8, problem, z, np.array([2.0]), least=2 * np.abs(z).max())
        assert found.examined == 2 and not found.several


@pytest.mark.parametrize("choice, nodes, friction, doubtful, expected", [
    ("yes", 900, 0.1, False, True), ("no", 1, 9.0, True, False), ("auto", FEW, 0.1, False, True),
    ("auto", FEW + 1, 0.1, False, False), ("auto", SMALL, 0.9, False, True),
    ("auto", SMALL, 0.1, True, True), ("auto", SMALL + 1, 0.9, True, False)])
def test_when_other_solutions_are_looked_for(choice, nodes, friction, doubtful, expected):
    assert worthwhile(choice, nodes, friction, doubtful) == expected
    assert too_many(CONDENSED_NODES) == "" and str(CONDENSED_NODES + 1) in too_many(
        CONDENSED_NODES + 1)


@pytest.mark.parametrize("solver, motions, friction, method", [
    ("newton", 0, 0.5, globalization.NEWTON), ("lemke", 0, 0.5, globalization.LEMKE),
    ("all alike", 1, 0.5, globalization.NEWTON), ("springs", 1, 0.5, globalization.SPRINGS),
    ("lemke", 1, 0.5, globalization.LEMKE),
    ("path", 0, 0.5, globalization.CONTINUATION), ("path", 1, 0.5, globalization.CONTINUATION),
    ("search", 1, 0.5, globalization.SEARCH), ("descend", 1, 0.0, globalization.SEARCH)])
def test_the_first_method_that_finds_a_solution(monkeypatch, solver, motions, friction, method):
    """In their order; starts in which all nodes are alike, and springs, for bodies without support.
    """
    tried = []

    def attempt(name, found, nothing=None):
        def call(*_):
            tried.append(name)
            return found if name == solver else nothing
        return call

    z, alike = np.array([1.0]), np.array([7.0])
    monkeypatch.setattr(globalization.approximations, "approached", attempt("newton", z))
    monkeypatch.setattr(globalization.complementarity, "newton", attempt("all alike", z))
    monkeypatch.setattr(globalization.complementarity, "lemke", attempt("lemke", z))
    monkeypatch.setattr(globalization.complementarity, "all_alike", lambda problem: [alike])
    monkeypatch.setattr(globalization.complementarity, "descend", attempt("descend", z))
    monkeypatch.setattr(globalization, "search_states",
                        attempt("search", Search(z, True), Search(None, False)))
    monkeypatch.setattr(globalization, "on_springs", attempt("springs", z))
    monkeypatch.setattr(globalization, "at_the_end_of_a_path", attempt("path", z))
    problem = SimpleNamespace(k=motions, bilateral=np.zeros(1, bool), n=2,
                              coefficient=np.array([friction]))
    found, by = globalization.solve_condensed(problem, np.zeros(1))
    assert found is z and by == method and tried[-1] == solver
    order = ["newton", *(["all alike", "springs"] if motions else []), "lemke", "path", "descend"]
    if solver == "search":
        order += ["descend", "search"]  # descent from two starts
    assert tried == order[: order.index(solver) + 1]


def test_where_no_method_finds_a_solution(monkeypatch):
    """There is none if all states were tried; of many nodes a few are searched."""
    monkeypatch.setattr(globalization.approximations, "approached", lambda *_: None)
    for name in ("lemke", "descend"):
        monkeypatch.setattr(globalization.complementarity, name, lambda *_: None)
    monkeypatch.setattr(globalization.complementarity, "all_alike", lambda problem: [])
    monkeypatch.setattr(globalization, "on_springs", lambda *_: None)
    monkeypatch.setattr(globalization, "at_the_end_of_a_path", lambda *_: None)
    problem = SimpleNamespace(k=1, bilateral=np.zeros(1, bool), n=globalization.MOST_NODES,
                              coefficient=np.ones(1))
    for certain, method in ((True, globalization.NO_STATE), (False, globalization.SEARCH)):
        monkeypatch.setattr(globalization, "search_states",
                            lambda problem, certain=certain: Search(None, certain))
        assert globalization.solve_condensed(problem, np.zeros(1)) == (None, method)
    problem.n += 1
    monkeypatch.setattr(globalization, "solution_among", lambda *_: (np.ones(1), "few"))
    assert globalization.solve_condensed(problem, np.zeros(1))[1] == "few"


@pytest.mark.parametrize("more, pivots", [(0, 1), (1, 0)])
def test_many_nodes_are_not_solved_by_pivots(monkeypatch, more, pivots):
    """Of k nodes there are about 4 k, each of 16 k^2 numbers: minutes and more."""
    tried = []
    monkeypatch.setattr(globalization.approximations, "approached", lambda *_: None)
    monkeypatch.setattr(globalization.complementarity, "lemke", tried.append)
    problem = SimpleNamespace(k=0, bilateral=np.zeros(1, bool),
                              n=globalization.CONDENSED_NODES + more)
    assert globalization.followed(problem, np.zeros(1)) == (None, "")
    assert len(tried) == pivots


@pytest.mark.parametrize("balance, method", [(0.0, globalization.NEWTON),
                                             (2.0, globalization.NO_STATE)])
def test_where_no_node_meets_anything_there_is_one_state(balance, method):
    """Of a sleeve that has slid off its shaft: it rests where nothing pulls it."""
    none = np.zeros(0)
    problem = CoulombProblem(np.zeros((0, 0)), none, none, np.zeros(0, int), np.zeros(0, bool),
                             np.zeros((0, 1)), np.array([balance]))
    start = np.array([0.3])
    found, by = globalization.solve_condensed(problem, start)
    assert by == method and (found is None if balance else found is start)


def test_methods_are_told_with_their_steps():
    fallbacks = globalization.Fallbacks()
    for method, step in (("one", 2), ("one", 2), ("one", 5), ("two", 3)):
        fallbacks.note(method, step)
    first, second = fallbacks.warnings()
    assert first.startswith("one found") and first.endswith("in 2 steps from step 2 on")
    assert second.endswith("did not converge, in step 3")


@pytest.mark.parametrize("seed", range(3))
def test_contraction_is_the_mean_ratio_over_a_window(seed):
    """Geometric, of the last WINDOW ratios of changes that are none but zero."""
    changes = np.random.default_rng(seed).uniform(0.1, 1.0, 3 * WINDOW)
    ratios = changes[1:] / changes[:-1]
    mean = np.exp(np.log(ratios[-WINDOW:]).mean())
    still = np.insert(changes, [3, 2 * WINDOW + 1], 0.0)
    assert Trace(changes=still.tolist()).contraction == pytest.approx(mean)
    assert Trace(changes=[1.0, 0.25, 0.0]).contraction == 0.25
    assert np.isnan(Trace(changes=[1.0]).contraction) and np.isnan(Trace().contraction)


def test_constants_that_are_called_parts_are_between_none_and_all():
    assert not constants.beyond("march")


@pytest.mark.parametrize("missed, said", [
    (2.6e7, "more than the deformation of the bodies"),
    (np.inf, "more than the deformation of the bodies"),
    (0.0123, "1.2 % of the deformation or of the contact forces"),
    (2e-5, "0.002 % of the deformation or of the contact forces")])
def test_changes_of_geometry_are_named_by_what_they_are_relative_to(missed, said):
    """A hook that jumps off a ledge and is bent no more had changed "by 2.6e+07"."""
    assert by_much(missed) == said
