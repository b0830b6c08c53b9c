"""Fixed points of the friction bound, and what steps do with them, on a dense dual matrix."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.kkt import Scales
from driver.contact.rows import ContactRows
from driver.errors import NoSolution, NotConverged
from driver.feti.dual_problem import DualProblem
from driver.march import condensation, fixed_point
from driver.march.condensation import Condensation
from driver.march.fixed_point import FixedPoint
from driver.march.friction_qp import FrictionQP
from driver.march.quasistatic import QuasistaticSolver
from driver.march.residuals import Residuals
from driver.march.slip import FAR
from driver.march.step import WINDOW, History, Load, Trace, Unfinished
from driver.march.supported import RigidSurfaces, SupportedBodies
from driver.options import Settings
from driver.qp import complementarity

N = 3  # contact nodes: normal rows, tangential ones, as many that glue


def matrix(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).standard_normal((3 * N, 4 * N))
    return root @ root.T / N


class Dense:
    """Operator of a dense dual matrix."""

    uneven, jumps = False, DualProblem.jumps
    alike = True

    def __init__(self, F: np.ndarray):
        self.F, self.owned, self.products, self.modes, self.travels = F, len(F), 0, 0, {}
        self.comm, self.softness, self.rho, self.levels = MPI.COMM_SELF, None, None, 1
        self.contact_rows_only, self.row_level = False, np.zeros(len(F), int)
        contact = SimpleNamespace(normal_row=np.arange(N), tangential_row=N + np.arange(N),
                                  gid=np.arange(N), motion=None, weight=np.ones(N),
                                  idle=np.zeros(N, bool))
        self.structure = SimpleNamespace(contact=contact, row_range=(0, len(F)), patterns=1,
                                         dual_dofs=len(F))

    def apply(self, x: np.ndarray) -> np.ndarray:
        """F x."""
        self.products += 1
        return self.F @ x

    def gradient(self, x: np.ndarray, load: Load) -> np.ndarray:
        """F x - d."""
        return self.apply(x) - load.d

    @staticmethod
    def dot(a: np.ndarray, b: np.ndarray) -> float:
        """Of whole vectors."""
        return float(a @ b)

    @staticmethod
    def dots(*pairs: tuple[np.ndarray, np.ndarray]) -> list[float]:
        """The same of several pairs."""
        return [float(a @ b) for a, b in pairs]

    @staticmethod
    def minimum(value: float) -> float:
        """Over the one rank."""
        return value


def parts(seed=1, friction=0.3, offset=None, levels=1, **settings) -> SimpleNamespace:
    """A fixed point, its QP and condensed problem, by a dense matrix."""
    operator, node = Dense(matrix(seed)), np.arange(N)
    operator.levels = levels
    rows = ContactRows(node, node, np.zeros(N), N + node, node, node,
                       None if friction is None else np.full(N, friction),
                       None if offset is None else np.full(N, offset), 2 * N + node,
                       np.zeros(N, bool))
    qp = object.__new__(FrictionQP)
    qp.operator, qp.rows, qp.scale = operator, rows, np.ones(operator.owned)
    qp.settings, qp.history, qp.scales = Settings(**settings), History(), Scales()
    qp.accelerators = SimpleNamespace(preconditioner=None, relaxation=None)
    qp.bound, qp.softest = 1.1 * np.linalg.norm(operator.F, 2), 1.0
    bodies = SupportedBodies()
    slip = SimpleNamespace(effects=SimpleNamespace(coefficient_changes=False),
                           renew_coefficient=lambda gradient: None)
    condensed = Condensation(operator, rows)
    condensed.elimination = None  # which is that of subdomains
    c, g = slice(2 * N), slice(2 * N, None)
    F = operator.F
    condensed._compliance = F[c, c] - F[c, g] @ np.linalg.solve(F[g, g], F[g, c])
    return SimpleNamespace(operator=operator, rows=rows, qp=qp, bodies=bodies, slip=slip,
                           condensation=condensed,
                           fixed=FixedPoint(qp, bodies, slip, condensed))


def load_of(of: SimpleNamespace, seed=2) -> Load:
    """A load that presses two of the nodes and drags all."""
    d = np.random.default_rng(seed).standard_normal(3 * N)
    d[:N] = [2.0, 3.0, -1.0]
    d[N : 2 * N] *= 2.0
    of.qp.scales.renew(d=np.linalg.norm(d))
    of.qp.aim(1.0, np.zeros(len(d)))
    return Load(np.ones(1), d, np.linalg.norm(d))


def solves(of, load, x, rtol=1e-5) -> bool:
    """Whether forces obey contact and friction, and glue holds: natural residuals."""
    move, bound = load.d - of.operator.F @ x, of.rows.friction_bound(x)
    n, t = x[:N], x[N : 2 * N]
    natural = [n - np.maximum(n + move[:N], 0.0),
               t - np.clip(t + move[N : 2 * N], -bound, bound), move[2 * N :]]
    return max(np.abs(part).max() for part in natural) <= rtol * np.abs(x).max()


def test_compliance_that_rounding_has_made_negative_is_refused(monkeypatch):
    """As that of a body whose stiffness loses all digits: no state of contact would follow."""
    of = parts(1, 0.3, None)
    of.condensation._compliance = None
    for worst in (-1e-9, np.nan):
        monkeypatch.setattr(condensation, "contact_compliance",
                            lambda operator, c=worst: np.diag([1.0] * (2 * N - 1) + [c]))
        with pytest.raises(NoSolution, match="contact nodes' stiffness is not positive definite"):
            of.condensation.compliance()
        of.condensation._compliance = None


TIGHT = {"rtol": 1e-11, "friction_rtol": 1e-9}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("friction, offset", [(0.3, None), (0.3, 0.5), (None, 0.5), (None, None)])
def test_successive_approximations_solve_the_law(seed, friction, offset):
    """With local Coulomb friction; given bounds are one QP."""
    of = parts(seed, friction, offset, **TIGHT)
    load, trace = load_of(of), Trace()
    zero = np.zeros(3 * N)
    x, gradient, sliding = of.fixed.find(1, load, zero, -load.d, np.zeros(N), trace, 1e-9)
    assert solves(of, load, x)
    np.testing.assert_allclose(gradient, of.operator.F @ x - load.d, atol=1e-8)
    at_bound = np.abs(x[N : 2 * N]) >= of.rows.friction_bound(x) * (1 - 1e-6)
    np.testing.assert_array_equal(sliding, np.where(at_bound, np.sign(x[N : 2 * N]), 0.0))
    assert (trace.iterations == 1) == (friction is None) and not trace.fallback
    problem = of.condensation.problem(load, x, gradient)
    z = complementarity.newton(problem, problem.whole(of.condensation.gather(x)))
    np.testing.assert_allclose(of.condensation.gather(x), z, atol=1e-6)


@pytest.mark.parametrize("seed", [1, 4, 5])
def test_large_friction_is_solved_by_other_methods(seed):
    """Where successive approximations do not contract; noted with the step."""
    of = parts(seed, 4.0, **TIGHT)
    load, trace = load_of(of, seed), Trace()
    zero = np.zeros(3 * N)
    x, _, _ = of.fixed.find(7, load, zero, -load.d, np.zeros(N), trace, 1e-9)
    assert solves(of, load, x)
    # the condensed problem alone comes to a solution as well
    y, _, _ = of.fixed.condensed(7, load, zero, -load.d, None, Trace(), 1e-9)
    assert solves(of, load, y)
    assert all(steps == [7] for steps in of.qp.history.fallbacks.steps.values())
    assert of.qp.history.fallbacks.steps


def test_qps_are_solved_as_far_as_it_pays():
    """Each reduces its residual by INNER_RTOL until the last one; in full they take more products.
    """
    counts = {}
    for inner in (0.1, 1e-12):
        of = parts(1, 0.5, **TIGHT, inner_rtol=inner)
        load, trace = load_of(of), Trace()
        x, _, _ = of.fixed.find(1, load, np.zeros(3 * N), -load.d, np.zeros(N), trace, 1e-9)
        assert solves(of, load, x)
        counts[inner] = of.operator.products
    assert counts[0.1] < 0.8 * counts[1e-12]


def test_a_fixed_point_that_takes_too_long_is_unfinished():
    of = parts(1, 0.9, **TIGHT, max_fixed_point=2)
    load = load_of(of)
    with pytest.raises(Unfinished, match="no fixed point of the friction bound in 2 iterations"):
        of.fixed.find(3, load, np.zeros(3 * N), -load.d, np.zeros(N), Trace(), 1e-9)


def test_without_any_method_a_step_has_no_solution(monkeypatch):
    of = parts(1, 4.0, **TIGHT)
    load = load_of(of, 1)
    monkeypatch.setattr(of.fixed, "_accelerate", lambda *_: None)
    monkeypatch.setattr(of.fixed, "_eliminate", lambda *_: None)
    with pytest.raises(Unfinished) as stop:
        of.fixed._globalise(4, load, np.zeros(3 * N), np.zeros(0), Trace())
    assert isinstance(stop.value.error, NoSolution) and not stop.value.final
    assert "does not contract" in str(stop.value.error)
    np.testing.assert_allclose(stop.value.gradient, -load.d)
    failure = Unfinished(NotConverged("as before"), None, None)
    with pytest.raises(Unfinished, match="as before"):
        of.fixed.condensed(4, load, np.zeros(3 * N), -load.d, None, Trace(), 1e-9, failure)


# ------------------------------------------------------------------------------ condensation

def test_the_condensed_problem_is_exact_where_it_is_made():
    """Its load gives the movements of the contact rows at x, whatever glue leaves."""
    of = parts(3)
    load, x = load_of(of), np.random.default_rng(4).standard_normal(3 * N)
    gradient = of.operator.F @ x - load.d
    problem = of.condensation.problem(load, x, gradient)
    near = of.condensation.gather(x)
    np.testing.assert_allclose(problem.movement(problem.whole(near)), -gradient[: 2 * N])
    lower, upper = of.condensation.fixing(x)
    assert (lower[: 2 * N] == x[: 2 * N]).all() and (upper[: 2 * N] == x[: 2 * N]).all()
    assert np.isinf(lower[2 * N :]).all() and np.isinf(upper[2 * N :]).all()
    np.testing.assert_array_equal(of.condensation.place(near + 1, x)[: 2 * N], x[: 2 * N] + 1)
    np.testing.assert_array_equal(of.condensation.place(near + 1, x)[2 * N :], x[2 * N :])
    before = of.condensation.compliance()
    of.operator.softness = np.arange(9.0)
    np.testing.assert_allclose(of.condensation.compliance() - before, np.diag(np.arange(6.0)))


@pytest.mark.parametrize("seed", range(5))
def test_a_solution_is_recognised_by_one_product(seed):
    """The condensed step starts from it with its movements, and from its states."""
    of = parts(seed, **TIGHT)
    load = load_of(of)
    x, gradient, sliding = of.fixed.condensed(1, load, np.zeros(3 * N), -load.d, np.zeros(N),
                                              Trace(), 1e-9)
    before = of.operator.products
    found, after = of.condensation.solution(load, x, gradient, sliding)
    assert of.operator.products - before == 1
    np.testing.assert_allclose(found, x, atol=1e-8 * np.abs(x).max())
    np.testing.assert_allclose(after[: 2 * N], gradient[: 2 * N], atol=1e-8 * np.abs(load.d).max())


# ------------------------------------------------------------------------------ steps

def solver(find, residuals, **more) -> QuasistaticSolver:
    """A solver whose fixed points are `find`, and whose residuals in turn are `residuals`."""
    of, said = parts(1, **TIGHT), iter(residuals)
    s = object.__new__(QuasistaticSolver)
    s.operator, s.rows, s.qp, s.settings = of.operator, of.rows, of.qp, of.qp.settings
    s.bodies, s.slip, s.scales = of.bodies, of.slip, of.qp.scales
    s.corners, s.fixed_point = SimpleNamespace(find=find, condensed="condensed"), of.fixed
    s.loads, s.largest_friction = [1.0, 1.0], 0.3
    s.residuals = Residuals(of.qp, of.bodies, of.slip, of.condensation)
    s.residuals.of = lambda *given, **kinds: {"gluing": 0.0, "penetration": 0.0} | next(said)
    s.residuals.faded = lambda x: False
    vars(s).update(more)
    return s


def found(index, load, x, gradient, sliding, trace, rtol):
    """A fixed point, which has been asked for with a tolerance."""
    found.asked.append(rtol)
    return x, gradient, sliding


def earned(s):
    load = Load(np.ones(1), np.ones(9), 1.0)
    s.scales.renew(d=1.0)
    return s._earned(1, load, np.zeros(9), -load.d, np.zeros(N), Trace())


def test_tolerances_get_tighter_until_residuals_are_small_enough():
    """QPs by what the worst one misses, at least a tenth; friction as well where that gluing or
    penetration do not say that QPs are to blame.
    """
    found.asked = []
    s = solver(found, [{"penetration": 30 * 1e-4, "equilibrium": 0.0}, {"cone": 2e-4},
                       {"cone": 1e-5}], settings=Settings(primal_rtol=1e-4, rtol=1e-6,
                                                          friction_rtol=1e-5))
    s.qp.settings = s.settings
    aims = []
    aim, s.qp.aim = s.qp.aim, lambda part, x: aims.append(part) or aim(part, x)
    *_, residuals = earned(s)
    assert residuals["cone"] == 1e-5
    assert aims == pytest.approx([1.0, 0.3 / 30, 0.3 / 30 * 0.1])
    assert found.asked == pytest.approx([1e-5, 1e-5, 1e-6])


@pytest.mark.parametrize("imbalance, modes, parts_of", [
    (5e-4, 1, [1.0, 1e-2, 1e-4, 1e-6]), (1e-3, 1, [1.0, 1e-2, 1e-4, 1e-6]), (2e-3, 1, [1.0]),
    (5e-4, 0, [1.0])])
def test_a_search_that_nearly_balances_bodies_goes_on_with_exacter_qps(imbalance, modes, parts_of):
    """By hundredths down to a millionth, where what is free is nearly in equilibrium: forces answer
    to what QPs leave by stiffness. Then what ended the search stands.
    """
    asked = []

    def fails(index, load, x, gradient, sliding, trace, rtol):
        trace.iterations += 1
        asked.append((s.qp.tol, trace.stalls))
        trace.changes = [1.0] * (2 * WINDOW + 2)
        raise Unfinished(NotConverged("it wanders"), x, gradient)

    s = solver(fails, 9 * [{"cone": 0.5}])
    s.settings = s.qp.settings = Settings(rtol=1e-3)
    s.operator.modes, s.operator.motions = modes, []
    s.bodies.imbalance = lambda load, x: imbalance
    s.residuals.free_of_forces = lambda *given: None
    s.qp.hides = lambda x: False
    s.corners.condensed = fails
    with pytest.raises(Unfinished, match="it wanders" if len(parts_of) == 1 else "wanders|stays"):
        earned(s)
    tols = [tol for tol, _ in asked][: len(parts_of)]
    np.testing.assert_allclose(tols, [1e-3 * part for part in parts_of], rtol=1e-9)
    assert not any(stalls for _, stalls in asked)  # each begins its changes anew


@pytest.mark.parametrize("later, taken", [
    ([0.5], 2), ([4.0, 0.5], 3), ([4.0, 2.0], 3), ([4.0, 4.0], 1), ([2.0, 2.5], 2)])
def test_what_a_bound_of_rounding_admits_is_the_last_resort(later, taken):
    """At corners, too: tolerances get tighter first, then the contact rows are condensed, and where
    that leads no further the best state that will do comes back, with the states that corners had.

    `later` are residuals, over what is asked for, of the states after one with three times that.
    """
    said = [{"cone": 3e-4}, {"cone": 1e-5}]
    best = 3.0
    for value in later:
        said.append({"cone": value * 1e-4})
        if 1 < value < best:
            said.append({"cone": 1e-5})
        best = min(best, value)
    s = solver(None, said, settings=Settings(primal_rtol=1e-4, rtol=1e-6))
    s.qp.settings, s.operator.levels, s.rows.corners = s.settings, 2, SimpleNamespace(
        acting=np.zeros(2, int), without_friction=np.zeros(0, int))
    selected, motions, ways = [], [], []
    s.fixed_point.condensation.select = lambda: selected.append(s.rows.corners.acting)
    s.bodies.bring = lambda load, place: motions.append(place)

    def way(name):
        def find(index, load, x, *others):
            ways.append(name)
            s.rows.corners.acting = s.rows.corners.acting + 1
            return x + 1.0, *others[:2]
        return find

    judged, of = [], s.residuals.of

    def residuals_of(*given, **kinds):
        s.scales.renew(displacements=np.array([float(len(judged))]))
        judged.append(of(*given, **kinds))
        return judged[-1]

    s.residuals.of = residuals_of
    s.corners.find, s.corners.condensed = way("find"), way("condensed")
    x, _, _, residuals = earned(s)
    assert x[2 * N :].tolist() == [1.0 * taken] * N  # gluing rows: no bounds cut them
    enough = later[-1] <= 1
    # corners share forces, and slip is told from noise, by the scales with which it is admitted
    assert s.scales.displacement == next(k for k, each in enumerate(judged) if each is residuals)
    assert residuals["cone"] == pytest.approx(later[-1] * 1e-4 if enough else 1e-5)
    assert s.rows.corners.acting.tolist() == [taken] * 2
    assert ways == ["find", "find", "condensed"][: 1 + len(later)]
    assert len(selected) == (taken <= len(later))


@pytest.mark.parametrize("unbalanced", [False, True])
def test_what_exacter_forces_do_not_balance_is_no_refusal(unbalanced):
    """A search that ends without equilibrium at tightened tolerances, where forces balance to what
    was asked for: a residual stays too large. `unbalanced`: they do not.
    """
    ways = []

    def fails(index, load, x, gradient, *_):
        ways.append("find")
        if len(ways) > 1:
            raise Unfinished(NoSolution("no equilibrium"), x, gradient)
        return x, gradient, np.zeros(N)

    def condensed(index, load, x, gradient, *_):
        ways.append("condensed")
        raise Unfinished(NoSolution("no equilibrium"), x, gradient)

    said = [{"cone": 0.5, "equilibrium": 1.0 if unbalanced else 0.0} for _ in range(9)]
    s = solver(fails, said)
    s.operator.levels, s.corners.condensed = 2, condensed
    with pytest.raises(Unfinished) as failed:
        earned(s)
    assert isinstance(failed.value.error, NoSolution if unbalanced else NotConverged)
    assert ways == ["find", "find", "condensed"]


def test_what_stays_too_large_is_said():
    """After the condensed problem has been tried in the place of successive approximations."""
    found.asked, tried = [], []
    s = solver(found, 99 * [{"cone": 0.5}])

    def condensed(*given):
        tried.append(given[-1])
        return found(*given)

    s.corners.condensed = condensed
    with pytest.raises(Unfinished, match="the cone residual stays at 5.0e-01, above the"):
        earned(s)
    assert tried and len(found.asked) > len(tried)
    assert tried[0] == s.settings.friction_rtol > found.asked[-1 - len(tried)]  # the step's own


@pytest.mark.parametrize("farthest, modes, anew", [
    (0.9, 1, False), (1.1, 1, True), (1.1, 0, False)])
def test_a_gradient_that_followed_bodies_far_is_made_anew(farthest, modes, anew):
    """Their rounding is in it: from FAR times the deformation on."""
    found.asked = []
    s, given = solver(found, [{"cone": 0.0}]), []
    s.scales.renew(displacements=np.array([0.25]))
    s.operator.modes, into = modes, s.into_cone
    s.into_cone = lambda d, x, gradient, sliding: given.append(gradient) or into(
        d, x, gradient, sliding)
    load = Load(np.ones(1), np.ones(9), 1.0, farthest=farthest * FAR * 0.25)
    s.scales.renew(d=1.0)
    s._earned(1, load, np.zeros(9), -load.d, np.zeros(N), Trace())
    assert (given[0] is None) == anew


def test_what_is_rounding_without_forces_needs_none():
    """The state without any force is taken where that is a solution."""
    s = solver(found, [{"cone": 0.5}])
    found.asked = []
    s.residuals.faded = lambda x: True
    s.residuals.free_of_forces = lambda *given: "free"
    assert earned(s) == "free"

    def fails(*_):
        raise Unfinished(NotConverged("no"), np.zeros(9), np.zeros(9))

    s.corners.find = fails
    assert earned(s) == "free"
    s.residuals.free_of_forces = lambda *given: None
    with pytest.raises(Unfinished, match="no"):
        earned(s)


def test_what_a_step_asks_for():
    """Displacements of its loads and of what carries bodies into contact, not along it; overlaps
    with obstacles that have moved.
    """
    s = solver(found, [])
    s.amplitudes, s.times = np.array([[0.0], [2.0]]), np.array([0.0, 1.0])
    s.operator.rigid_response = lambda weights: weights[0] * np.arange(9.0)
    s.operator.elastic_response = lambda weights: weights[0] * np.ones(9)
    s.contact = SimpleNamespace(motion=None)
    expected = np.array([2, 4, 6, 2, 2, 2, 14, 16, 18.0])
    assert s._size(1) == pytest.approx(np.linalg.norm(expected))
    s.contact.motion = SimpleNamespace(gap_at=lambda time: np.array([-3.0, 5.0, 0.0]) * time)
    expected[0] += 3
    assert s._size(1) == pytest.approx(np.linalg.norm(expected))


def test_the_load_of_a_step():
    """Elastic displacements from those before along contact, less gaps; what carries bodies by its
    increment there, less the obstacle's way.
    """
    s = solver(found, [])
    s.rows.gap = np.array([0.5, 0.25, 0.0])
    s.amplitudes = np.array([[0.0], [2.0]])
    s.slip = SimpleNamespace(weights=np.array([0.5]), way=np.array([0.1, 0.0, 0.0]),
                             elastic=np.array([0.25, 0.5, 1.0]))
    s.operator.rigid_response = lambda weights: weights[0] * np.arange(9.0)
    s.operator.elastic_response = lambda weights: weights[0] * np.ones(9)
    seen = []
    s.qp.extent = lambda *given: seen.append(given) or 7.0
    load = s.load(1, np.zeros(0), np.full(9, 3.0))
    rigid = np.array([0.0, 2, 4, 1.5 * 3 - 0.1, 1.5 * 4, 1.5 * 5, 0, 0, 0])
    np.testing.assert_allclose(load.d, 2 + rigid - [0.5, 0.25, 0, 0.25, 0.5, 1, 0, 0, 0])
    assert load.extent == 7.0 and load.travel == pytest.approx(7.5)
    np.testing.assert_allclose(load.rest, load.d - 2)
    np.testing.assert_allclose(seen[0][1], rigid)
    assert load.weights.tolist() == [2.0]


def test_obstacles_that_move_take_contact_with_them():
    s = solver(found, [])
    s.times, s.rows.corners = np.array([0.0, 1.0, 3.0]), SimpleNamespace(
        nodes=np.array([[0, 1], [2, 2]]), shifted=None)
    s.contact = SimpleNamespace(
        motion=SimpleNamespace(gap_at=lambda time: time * np.arange(3.0),
                               moved=lambda before, now: np.array([False, True, False])),
        way=lambda before, now: (now - before) * np.array([0.5, 0.0, 0.0]))
    s.slip, s.effects = SimpleNamespace(way=0.0), SimpleNamespace(coefficient_changes=False)
    s._move_obstacles(2)
    assert s.rows.gap.tolist() == [0, 3, 6] and s.slip.way.tolist() == [1, 0, 0]
    assert s.rows.corners.shifted.tolist() == [True, False]
    # laws of displacement see what the surface has travelled before, step by step where it turns
    s.effects.coefficient_changes, s.contact.gid = True, np.arange(3)
    s.times, asked = np.array([0.0, 1.0, 3.0, 4.0]), []
    for angle, steps in ((0.0, [(0, 3)]), (0.1, [(0, 1), (1, 3)])):
        s.contact.motion.angle = np.array([angle])
        s.contact.way = lambda before, now: asked.append((before, now)) or (
            (now - before) * np.array([0.5, 0.0, 0.0]))
        s._move_obstacles(3)
        assert s.slip.travelled.tolist() == [1.5, 0, 0] and asked == [(3, 4), *steps]
        asked.clear()
    s._move_obstacles(1)
    assert not s.slip.travelled.any()


def test_equilibrium_without_friction_is_that_of_the_dense_box():
    """Coefficients, offsets and laws are afterwards what they were."""
    s = solver(found, 99 * [{"cone": 0.0}])
    of = parts(1, **TIGHT)
    s.corners = of.fixed
    of.fixed.qp, of.fixed.operator, of.fixed.rows = s.qp, s.operator, s.rows
    s.amplitudes, s.closure = np.array([[1.0]]), RigidSurfaces()
    s.slip = SimpleNamespace(weights=np.zeros(1), way=0.0, elastic=np.zeros(N), coefficient="own",
                             effects=of.slip.effects, renew_coefficient=lambda gradient: None)
    d = load_of(of).d
    s.operator.rigid_response = lambda weights: np.zeros(9)
    s.operator.elastic_response = lambda weights: d.copy()
    known = s.rows.coefficient
    x, gradient, load = s.without_friction()
    assert s.rows.coefficient is known and s.slip.coefficient == "own"
    F, free = s.operator.F, np.r_[0:N, 2 * N : 3 * N]
    assert not x[N : 2 * N].any() and (x[:N] >= 0).all()
    over = (load.d - F @ x)[:N]
    assert np.abs(np.minimum(x[:N], -over)).max() < 1e-7
    assert np.abs((load.d - F @ x)[2 * N :]).max() < 1e-7 and len(free) == 6
    np.testing.assert_allclose(gradient, F @ x - load.d, atol=1e-9)


# ------------------------------------------------------------------------------ residuals

def residuals(levels=1, **more) -> Residuals:
    """Those of three contact nodes, so many levels of stiffness for rows."""
    of = parts(1, **TIGHT)
    of.operator.levels = levels
    of.qp.softest, of.qp.scales = 2.0, Scales(displacements=np.zeros(levels))
    found = Residuals(of.qp, of.bodies, of.slip, of.condensation)
    vars(found).update(more)
    return found


@pytest.mark.parametrize("levels", [1, 3])
def test_displacements_that_are_rounding(levels):
    """Beside what is to be overcome, in the softest rows, and beside what bodies travel; residuals
    are relative to no less than what makes the travel's rounding as large as is asked for.
    """
    load, found = Load(np.ones(1), np.zeros(9), 3.0, travel=0.0), residuals(levels)
    others = np.zeros(levels - 1)
    for asked in (1e-6, 1e-3):
        found.qp.settings = replace(found.qp.settings, primal_rtol=asked)
        rounded = max(1e-9, 64 * np.finfo(float).eps / asked)
        for load.travel, load.farthest in ((0.0, 0.0), (0.5, 0.7), (50.0, 7.0)):
            way = max(load.travel, load.farthest)
            nothing, least = found._least_deformation(load)
            assert nothing == pytest.approx(max(1e-8 * 3 / 2, 1e-9 * way))
            np.testing.assert_allclose(least, [max(1e-8 * 3 / 2, rounded * way),
                                               *(others + rounded * way)])


def test_residuals_are_relative_to_what_deforms():
    """To a lower bound of it, and where that is too little to the deformation; or to what is not
    rounding. What friction bounds miss of their slip counts as a force.
    """
    found = residuals()
    found.qp.settings = Settings(primal_rtol=1e-3, friction_rtol=1e-3)
    op, load = found.operator, Load(np.ones(1), np.zeros(9), 1.0)
    x = np.array([4.0, 2, 1, 0, 0, 0, 0, 0, 0])
    gradient = np.zeros(9)
    gradient[0], gradient[6] = -1e-4, 2e-4  # the first node penetrates, the first glued row gapes
    asked = []
    op.least_deformation = lambda *_: asked.append("least") or 0.01
    op.deformation_by_level = lambda *_: asked.append("whole") or np.array([0.5])
    said = found.of(load, x, gradient)
    assert asked == ["least", "whole"] and not found.still
    assert said["gluing"] == pytest.approx(2e-4 / 0.5)
    assert said["penetration"] == pytest.approx(1e-4 / 0.5)
    op.least_deformation = lambda *_: asked.append("enough") or 1.0
    found.scales.largest = {}
    assert found.of(load, x, gradient)["gluing"] == pytest.approx(2e-4)
    assert asked == ["least", "whole", "enough"]
    op.levels = 1
    load.extent = 1e9  # of which everything else is rounding
    assert found.of(load, x, gradient)["gluing"] == pytest.approx(
        2e-4 / (1e-8 * 1e9 / found.qp.softest)) and found.still
    found._changing = lambda x, gradient: 3.0
    assert found.of(load, x, gradient)["cone"] == pytest.approx(3.0 / 4.0)


@pytest.mark.parametrize("exact, off", [(False, 1e-3), (False, 4e-3), (True, 1e-3)])
def test_what_products_round_off_on_stiff_rows(exact, off):
    """A product, measured, is off by 5e-4 there, and another one may be four times as far off: what
    that makes of a stiff row will do, unless its residual is asked for as it is, and no more than
    that. What soft rows round off, any amount, says nothing of stiff ones.
    """
    found, F = residuals(2), np.eye(9)
    found.operator.row_level = np.array([1] + 8 * [0])
    found.operator.deformation_by_level = lambda *_: np.array([1e6, 1.0])
    noise = np.r_[5e-4, np.full(8, 0.3)]
    found.operator.apply = lambda x: F @ x + noise * (x[0] == 1)
    x, gradient = np.r_[np.ones(3), np.zeros(6)], np.zeros(9)
    gradient[0] = -off
    asked = found.asked("penetration")
    said = found.of(Load(np.ones(1), np.zeros(9), 1.0), x, gradient, exact)["penetration"]
    assert said == pytest.approx(off if exact else off / (4 * 5e-4 / asked))
    assert (said <= asked) == (off <= 2e-3 and not exact)


@pytest.mark.parametrize("exact", [True, False])
def test_missing_forces_are_not_excused_by_rounding(exact):
    """A row of stiffness 1e6 presses by one and is known to 5e-10 in a product: forces differ by
    1e-3 from cut to cut, and are said to.
    """
    found, stiffness = residuals(2), np.r_[1e6, np.ones(8)]
    found.operator.row_level = np.array([1] + 8 * [0])
    found.operator.deformation_by_level = lambda *_: np.full(2, 1e6)
    found.operator.apply = lambda x: x + np.r_[5e-10, np.zeros(8)] * (x[0] == 1)
    found.qp.accelerators.preconditioner = lambda missed, free: stiffness * missed
    x, gradient = np.r_[1.0, np.zeros(8)], np.r_[-1e-9, np.zeros(8)]
    said = found.of(Load(np.ones(1), np.zeros(9), 1.0), x, gradient, exact)
    assert said["stationarity"] == pytest.approx(1e-3)


@pytest.mark.parametrize("pressing, relative", [(0.0, 2.0), (1e-9, 2e-6)])
def test_what_is_left_out_without_forces_counts_beside_those_before(pressing, relative):
    """A way of 3e-9 on a row of stiffness one, where forces of two have pressed before. What the
    state without forces leaves out is 1.5e-9 of these: they are not known better, nor is what a
    step starts from. Beside forces that are there, as small as they may be, it is too much.
    """
    found = residuals()
    found.scales.largest = {"pressing": 2.0}
    found.qp.accelerators.preconditioner = lambda missed, free: missed
    x, gradient = np.r_[0.0, pressing, np.zeros(7)], np.r_[-3e-9, np.zeros(8)]
    found.operator.deformation_by_level = found.operator.least_deformation = lambda *_: np.ones(1)
    said = found.of(Load(np.ones(1), np.zeros(9), 1.0), x, gradient)
    assert said["stationarity"] == pytest.approx(3e-9 / relative)
    assert said["penetration"] == pytest.approx(3e-9)


@pytest.mark.parametrize("x, largest, still, faded", [
    (np.zeros(9), 0.0, False, False), (np.ones(9), 0.0, False, False),
    (np.ones(9), 0.0, True, True),
    (np.full(9, 1e-9), 1.0, False, True), (np.full(9, 1e-3), 1.0, False, False),
    (np.r_[np.zeros(6), 1e-9, 0, 0], 1.0, False, True)])
def test_forces_that_may_be_rounding(x, largest, still, faded):
    """Beside those before, or the least that move anything; gluing ones where nothing presses; or
    where nothing has deformed. None at all are no rounding.
    """
    found = residuals()
    found.scales.largest, found.scales.d, found.still = {"pressing": largest}, 0.0, still
    assert found.faded(x) == faded


def test_all_residuals_are_asked_for():
    """The imbalance of bodies as friction, all else as displacements."""
    found = residuals()
    found.qp.settings = Settings(primal_rtol=1e-3, friction_rtol=1e-5)
    assert found.asked("equilibrium") == 1e-5 and found.asked("cone") == 1e-3
    assert found.enough({"cone": 1e-3, "equilibrium": 1e-5}) and found.enough({})
    assert not found.enough({"cone": 2e-3, "equilibrium": 0.0})
    assert not found.enough({"cone": 0.0, "equilibrium": 2e-5})


def test_bounds_that_miss_those_of_their_slip():
    """The law is asked at the slip of the gradient, and the coefficients stay."""
    found = residuals()
    x = np.array([4.0, 2, 1, 0, 0, 0, 0, 0, 0])
    assert found._changing(x, np.zeros(9)) == 0.0
    known = found.rows.coefficient

    def renew(gradient):
        found.rows.coefficient = known + gradient[N : 2 * N]

    found.slip = SimpleNamespace(effects=SimpleNamespace(coefficient_changes=True),
                                 renew_coefficient=renew)
    gradient = np.r_[np.zeros(3), 0.1, -0.3, 0.0, np.zeros(3)]
    assert found._changing(x, gradient) == pytest.approx(max(0.1 * 4, 0.3 * 2))
    assert found.rows.coefficient is known


@pytest.mark.parametrize("uneven", [False, True])
def test_the_state_without_forces(uneven):
    """With bodies where they are to be tried; if that is no solution all is as before.

    Where stiffness jumps by much d is that of products near other forces: the gradient is not -d.
    """
    found = residuals()
    found.operator.uneven = uneven
    found.operator.gradient = lambda x, load: x - 2.0 * load.d
    load, tried = Load(np.ones(1), np.arange(9.0), 1.0), []
    found.bodies = SimpleNamespace(place=lambda load: load.weights[1:].copy(),
                                   bring=lambda load, place: tried.append(place.copy()))
    answer = {"cone": 0.0}

    def of(load, x, gradient):
        found.scales.renew(d=99.0)
        found.still = True
        tried.append((x.any(), gradient.copy()))
        return answer

    found.of = of
    x = np.ones(9)
    nothing, gradient, moved, _ = found.free_of_forces(load, x)
    assert not nothing.any() and moved is x
    np.testing.assert_array_equal(gradient, -(1.0 + uneven) * load.d)
    answer, found.still, found.scales.d = {"cone": 1.0}, False, 1.0
    load.weights = np.array([1.0, 5.0])
    tried.clear()
    assert found.free_of_forces(load, x, np.array([2.0])) is None
    assert tried[0].tolist() == [2.0] and tried[-1].tolist() == [5.0]
    assert found.scales.d == 1.0 and not found.still


def test_gaps_that_close_stay_closed_wherever_bodies_go():
    """What surfaces wear is no motion: bodies that are back find it, and went no farther by it."""
    load, motion = Load(np.zeros(1), np.array([1.0, -2.0]), 1.0), [np.array([1.0, 0.5])]
    load.move(motion, np.array([3.0]))
    load.widen(np.array([0.25, 0.0]))
    assert load.d.tolist() == [4.25, -0.5] and load.farthest == 3.0
    change = load.move(motion, np.array([-3.0]))
    assert load.d.tolist() == [1.25, -2.0] and change.tolist() == [-3.0, -1.5]
    assert load.rest.tolist() == [1.25, -2.0]
    load.forget()
    assert load.farthest == 0.0


def test_what_bodies_move_by_has_digits_beside_what_springs_make_of_loads():
    """Which d has not: of 1e6 beside 1e-12 nothing is left."""
    far, rest = np.array([1e6, -1e6]), np.array([1e-12, 0.0])
    load = Load(np.zeros(1), far + rest, 1.0, rest=rest)
    load.move([np.array([1.0, 0.5])], np.array([2e-12]))
    load.widen(np.array([0.0, 1e-12]))
    assert load.rest.tolist() == [3e-12, 2e-12] and load.d.tolist() == far.tolist()


def test_what_has_no_free_motion_stays_where_it_is():
    """Neither bodies that supports hold nor surfaces that do not yield change anything of a step.
    """
    bodies, surfaces = SupportedBodies(), RigidSurfaces()
    load, x, trace = Load(np.ones(1), np.ones(3), 1.0), np.ones(3), Trace()
    assert bodies.shift(load, np.zeros(0)) == bodies.imbalance(load, x) == 0.0
    assert bodies.bring(load, bodies.place(load)) == 0.0
    assert bodies.settle(load, x, x) == 0.0 and surfaces.yielded(x) == 0.0
    assert not len(bodies.can_rest(1, load.weights)) and bodies.placed.shape == (0, 3)
    assert bodies.secants() is None and bodies.note_loose_motion(1, x) is None
    assert surfaces.settled(4, load, ("x", "g"), trace, lambda *given: given) == (
        4, load, "x", "g", trace)
    np.testing.assert_array_equal(load.d, np.ones(3))


@pytest.mark.parametrize("far, kept", [(0.9, True), (1.1, False)])
def test_a_start_that_went_astray_is_forgotten(far, kept, monkeypatch):
    """Other methods start from the latest forces; from the first ones if these have grown beyond
    ASTRAY times the load or those.
    """
    of = parts(1, **TIGHT)
    load, starts = load_of(of), []
    grown = 1.0 * (np.abs(np.arange(3 * N) - 4) > 1)  # all but friction
    grown *= far * fixed_point.ASTRAY * of.qp.scales.d / of.qp.largest(grown)

    def approximate(index, trace, *_):
        trace.fallback = True
        trace.changes = [1.0]
        return SimpleNamespace(x=grown, gradient=-load.d, status="converged"), 1.0

    monkeypatch.setattr(of.fixed, "_approximate", approximate)
    monkeypatch.setattr(of.fixed, "_globalise",
                        lambda index, load, x, motion, trace: starts.append(x) or x)
    monkeypatch.setattr(of.fixed.shortcut, "pays", lambda *_: False)
    monkeypatch.setattr(Trace, "stalls", True)
    first = np.full(3 * N, 1e-3)
    of.fixed.find(1, load, first, -load.d, np.zeros(N), Trace(exact=True), 1e-9)
    assert (np.abs(starts[0]).max() > 1.0) == kept


def test_a_trace_that_begins_again_knows_its_iterations_alone():
    trace = Trace(5, [1.0, 0.5], True, True)
    trace.again()
    assert trace == Trace(5)


def test_bodies_that_are_back_leave_no_trace_of_where_they_went():
    """Of a way of 1e14 there and back d keeps nothing, and what it is good to is that of its place.
    """
    load = Load(np.zeros(1), np.array([1.0, -2.0]), 1.0)
    load.move([np.array([1.0, 0.5])], np.array([1e14]))
    load.move([np.array([1.0, 0.5])], np.array([0.25 - 1e14]))
    load.forget()
    assert load.farthest == pytest.approx(0.25) and load.d == pytest.approx([1.25, -1.875])
