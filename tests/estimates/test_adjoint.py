"""Adjoint problems: their solutions are influence functions, their sizes those of true errors."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from driver.effects import Effects
from driver.energy_norm.torn_body import Gather, gather_body
from driver.estimates import adjoint
from driver.estimates.adjoint import Adjoint, Sizes, held
from driver.estimates.budget import Part
from driver.march import frozen_state
from driver.march.frozen_system import FrozenSystem
from driver.march.problem import Problem
from driver.march.quasistatic import QuasistaticSolver
from driver.options import Settings
from driver.results.record import Record

TIGHT = Settings(rtol=1e-11, friction_rtol=1e-10, primal_rtol=1e-8, uniqueness="no")
SCALE = {"tangential_resultant": "normal_resultant", "slip": "displacement"}  # of small ones
MORE = 1e-4  # of all loads: little enough for no node to change its state


@pytest.fixture(scope="module")
def marched(built):
    """marched(scene, factor, **parameters): problem, record and last step of a run.

    All loads are multiplied by `factor` in the last step.
    """
    made = {}

    def march(scene, factor=1.0, **parameters):
        key = scene, factor, tuple(parameters.items())
        if key not in made:
            one = built(scene, **parameters)
            problem, m = Problem(one.manifest, one.structure, one.operator), one.manifest
            factors = m.factors.copy()
            factors[-1] *= factor
            times = np.linspace(0, m.t_end, m.steps + 1)
            solver = QuasistaticSolver(problem.operator, Effects(m), factors, times, TIGHT)
            record = Record(problem.operator, solver)
            steps = list(solver.steps())
            for step in steps:
                record.add(step)
            made[key] = problem, record, steps[-1]
        return made[key]

    return march


def of(problem, record, step):
    """The Adjoint of a run's last step."""
    return Adjoint(problem, record, step, gather_body(Gather(problem.operator)))


def functionals(record, like):
    """What the adjoint problems are about, in the last step; places are those of `like`."""
    last, weight = len(record.work or record.displacements) - 1, record.contact.boundary.weight
    state = record.state(last)
    found = {name: float((record.signed_shares(name, last) * state[field]) @ weight)
             for name, field in (("normal_resultant", "sigma_n"),
                                 ("tangential_resultant", "sigma_t"))}
    found["peak_pressure"] = state["sigma_n"][like.peak_nodes(last)].mean()
    found["slip"] = state["u_t"][like.farthest_node(last)]
    return found | {"displacement": record.displacements[last]}


INFLUENCE = [("model-static", dict(cells=4)),  # all states, gluing, one step
             ("model-static", dict(cells=3, element="P2")),
             ("model", dict(cells=4, steps=2, loading="nonmonotone")),
             ("stack", dict(h=0.25, steps=2))]  # bodies without support, between bodies


@pytest.mark.parametrize("scene, parameters", INFLUENCE)
@pytest.mark.some(1)
def test_the_adjoint_is_the_influence_of_more_load(marched, scene, parameters, monkeypatch):
    """Little more of all loads changes a quantity by the work of the loads on the adjoint solution,
    as contact stays in its state.
    """
    monkeypatch.setattr(frozen_state, "TOLERANCE", 1e-10)
    monkeypatch.setattr(frozen_state, "STILL", 1e-10)
    monkeypatch.setattr(frozen_state, "ROUNDS", 60)
    problem, record, step = marched(scene, **parameters)
    _, other, more = marched(scene, 1 + MORE, **parameters)
    assert np.array_equal(step.status, more.status)
    before, after = functionals(record, record), functionals(other, record)
    load = (more.weights - step.weights)[: problem.structure.patterns]
    changes = of(problem, record, step)
    for name in before:
        _, fields = changes.solution(name)
        work = sum(load @ sub.loads @ z for sub, z in zip(problem.structure.subdomains, fields))
        change = after[name] - before[name]
        scale = MORE * max(abs(before[name]), abs(before[SCALE.get(name, name)]))
        # signs of goals are arbitrary; residuals of 1e-8 of the deformation against MORE
        assert abs(abs(work) - abs(change)) <= 5e-3 * scale, name



@pytest.mark.some(1)
def test_forces_of_the_adjoint_are_the_influence_of_gaps(marched):
    """A half-disc pressed by more is one with gaps that are smaller by as much: their work on what
    it goes farther is the change of its pressing force.
    """
    problem, record, step = marched("hertz", h="0.004")
    _, other, _ = marched("hertz", 1 + MORE, h="0.004")
    changes = of(problem, record, step)
    forces, _ = changes.solution("normal_resultant")
    farther = MORE * float(problem.manifest.parameters["approach"])
    change = other.quantities()[0]["normal_resultant"] - record.quantities()[0]["normal_resultant"]
    assert abs(forces[changes.rows.normal].sum() * farther) == pytest.approx(change, rel=5e-3)
    assert 0 < changes.sizes(["normal_resultant"])["normal_resultant"].gaps < change / MORE


@pytest.mark.parametrize("scene, parameters", [
    ("bracket", dict(subdomains=7, steps=2)), ("joint", dict(h=1.6, subdomains=3, steps=1)),
    ("stack", dict(h=0.25, steps=2))])
@pytest.mark.some(2)
def test_frozen_states_are_solved_by_the_contact_rows_alone(marched, monkeypatch, scene,
                                                            parameters):
    """Where steps have eliminated the gluing rows: as conjugate gradients do, to their tolerance,
    without any; also where bodies have no support, and in states that do not hold them.
    """
    monkeypatch.setattr(frozen_state, "TOLERANCE", 1e-10)
    monkeypatch.setattr(frozen_state, "STILL", 1e-10)
    monkeypatch.setattr(frozen_state, "ROUNDS", 60)
    problem, record, step = marched(scene, **parameters)
    solver = record.contact.solver
    assert solver.condensation.eliminated
    directly = of(problem, record, step)
    assert directly.system is not None
    values = record.quantities()[0]
    with monkeypatch.context() as forbidden:
        forbidden.setattr(solver.qp, "linear", None)
        found = directly.sizes(values)
    monkeypatch.setattr(solver.condensation, "eliminated", False)
    iterated = of(problem, record, step)
    wanted = iterated.sizes(values)
    assert iterated.system is None and found.keys() == wanted.keys() and len(wanted) >= 3
    for name, sizes in wanted.items():
        nothing = 1e-7 * max(abs(values[name]), abs(values[SCALE.get(name, name)]))
        for part in ("net", "gross", "product"):
            assert getattr(found[name], part) == pytest.approx(
                getattr(sizes, part), rel=1e-6, abs=nothing), (name, part)


def test_nothing_is_eliminated_for_adjoint_problems_alone(marched, monkeypatch):
    """As where a last step, by conjugate gradients, has seen that elimination had been cheaper: it
    takes hundreds of products then.
    """
    problem, record, step = marched("joint", h=1.6, subdomains=3, steps=1)
    solver = record.contact.solver
    assert of(problem, record, step).system is not None
    monkeypatch.setitem(solver.history.counts, "condensed_steps", 0)
    monkeypatch.setattr(type(solver.condensation), "compliance", None)
    assert solver.condensation.eliminated and of(problem, record, step).system is None


def condensed(n: int, m: int, compliance: np.ndarray) -> SimpleNamespace:
    """A condensation without gluing rows, of n normal and m tangential ones."""
    return SimpleNamespace(
        n=n, size=n + m, pair=np.arange(m), of_tangential=lambda values: values,
        gather=lambda values: values, place=lambda force, x: force,
        glued=lambda d, x, gradient: (x, gradient),
        operator=SimpleNamespace(apply=lambda x: compliance @ x),
        compliance=lambda: compliance)


def test_frozen_systems_of_bodies_that_touch_nothing_have_no_forces():
    system = FrozenSystem(condensed(3, 2, np.eye(5)), np.zeros(5, bool), np.zeros(2))
    assert not system.solution(np.ones(5)).any()


def test_frozen_systems_take_no_more_matrices_than_they_need():
    """Two at most, of all rows and of those that are held, which the factors take the place of; the
    system is not symmetric.
    """
    n, m = 200, 150
    rng = np.random.default_rng(1)
    compliance = rng.random((n + m, n + m)) + (n + m) * np.eye(n + m)
    condensation = condensed(n, m, compliance)
    ratio, held, moved = np.full(m, 0.4), np.arange(n + m) % 7 > 0, rng.random(n + m)
    tracemalloc.start()
    system = FrozenSystem(condensation, held, ratio)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2.1 * compliance.nbytes
    force = system.solution(moved)
    left = compliance @ force - moved
    left[:m] += 0.4 * left[n:]
    assert not force[~held].any() and np.abs(left[held]).max() < 1e-12


def test_forces_that_balance_the_load_have_no_error(marched):
    """The resultants between stacked blocks are weights and the push: no mesh changes them."""
    problem, record, step = marched("stack", h=0.25, steps=2)
    values = record.quantities()[0]
    sizes, _ = adjoint.assess(problem, record, step, values,
                              lambda: gather_body(Gather(problem.operator)))
    assert "peak_pressure" in sizes and "normal_resultant" not in sizes


@pytest.mark.parametrize("scene, parameters, name, exact", [
    # closed form of the beam; Hertz' disc on its finest mesh of the reference table, 0.4 % off
    ("cantilever", dict(cells=4), "displacement", np.hypot(0.0025 * np.sin(2.6), 0.02)),
    ("hertz", dict(h=0.008), "normal_resultant", 1.74577)])
def test_smooth_solutions_err_as_estimated(marched, scene, parameters, name, exact):
    """Smoothed stresses are asymptotically exact there, on boundaries and coarse meshes a fourth
    off.
    """
    problem, record, step = marched(scene, **parameters)
    sizes = of(problem, record, step).sizes([name])[name]
    true = abs(record.quantities()[0][name] - exact)
    assert 0.75 * true <= sizes.net <= 1.25 * true
    assert sizes.net <= sizes.gross <= 2 * sizes.product + 1e-12


def test_quantities_without_adjoint_problem_and_runs_without_any(marched):
    problem, record, step = marched("model-static", cells=4)
    assert set(of(problem, record, step).sizes(["contact_length", "dissipated_energy"])) == set()
    _, kept = adjoint.assess(problem, record, None, {"slip": 1.0}, None)
    assert kept == {"reason": adjoint.EARLIER}


ONCE = 1 / adjoint.SEES**2  # what smoothed stresses do not see of a product of two errors


@pytest.mark.parametrize("name, error, sizes, expected", [
    ("slip", 5.0, Sizes(1.0, 2.0, 2.0), 5.0),  # between: as companions say
    ("slip", 1.0, Sizes(2.0, 2.0, 1.0), 2 * adjoint.NET),  # no claim below the estimated error
    ("slip", 99.0, Sizes(1.0, 2.0, 1.5), 2 * 1.5 * ONCE),  # nor above Cauchy's and Schwarz' bound
    ("peak_pressure", 99.0, Sizes(1.0, 2.0, 9.0), 2 * adjoint.PEAK),
    ("peak_pressure", 1.0, Sizes(2.0, 2.0, 9.0), 1.0),
    ("peak_pressure", 99.0, Sizes(1.0, 2.0, 3.0), 99.0),  # both errors under the peak: singular
    ("slip", 99.0, Sizes(0.0, 1e-9, 1e-9), 99.0),  # data err, which no adjoint sees
    ("slip", None, Sizes(1.0, 2.0, 1.0), None), ("slip", 5.0, None, 5.0)])
def test_claims_are_held_between_what_the_adjoint_leaves(name, error, sizes, expected):
    part = held(name, Part(error, 1.5, "a note", 1.2), sizes)
    assert part == Part(pytest.approx(expected), 1.5, "a note", 1.2)


@pytest.mark.parametrize("name", ["normal_resultant", "tangential_resultant", "displacement"])
@pytest.mark.parametrize("gross, factor", [(2.0, ONCE), (2.5, 0.8 * ONCE), (9.0, adjoint.NET)])
def test_errors_that_do_not_cancel_are_what_smoothed_stresses_leave_of_them(name, gross, factor):
    """Both errors of a brake shoe on its drum work alike everywhere: three meshes claimed 1.1 % of
    its pressing force, for 1.4 %. Where they cancel, what is left hangs on how they do.
    """
    assert held(name, Part(0.1), Sizes(2.0, gross, 9.0)).error == pytest.approx(2.0 * factor)


@pytest.mark.parametrize("error, slack, expected", [
    (1e-3, 1.0, 2.0 * ONCE), (99.0, 1.0, 2.0 * ONCE), (99.0, 3.0, 2.0 * ONCE),
    (99.0, np.inf, 99.0), (1e-3, np.inf, 2.0 * ONCE)])  # of a polygon's error they see nothing
def test_the_adjoint_speaks_alone_where_meshes_tell_no_order(error, slack, expected):
    """Without cancellation, whatever coarse meshes differ by; the slack is for what it misses."""
    part = held("normal_resultant", Part(error), Sizes(0.1, 2.0, 30.0), slack, told=False)
    assert part.error == pytest.approx(expected)


@pytest.mark.parametrize("linear, expected", [(True, 2.0), (False, 2.0 * ONCE)])
def test_displacements_of_quadratic_elements_err_at_ends_of_contact(linear, expected):
    """As forces do: how errors cancel there hangs on the contact state, which meshes do not tell.
    """
    part = held("displacement", Part(99.0), Sizes(0.1, 2.0, 30.0), told=False, linear=linear)
    assert part.error == pytest.approx(expected)


@pytest.mark.parametrize("seen, factor", [
    (1.0, ONCE), (0.6, ONCE), (0.3, 1 / (0.3 * adjoint.OVER) ** 2)])
def test_what_smoothed_stresses_see_is_what_the_bound_says_where_that_is_less(seen, factor):
    """Of a belt on a drum, one element thick, they see 0.3 of the bound: 2.25 times the error
    without cancellation were 0.6 % for 0.9 %.
    """
    for name, told, expected in (("normal_resultant", False, 2.0), ("slip", True, 2 * 3.0)):
        part = held(name, Part(99.0), Sizes(0.1, 2.0, 3.0), 1.0, told, seen)
        assert part.error == pytest.approx(expected * factor)


def test_stresses_that_see_nothing_leave_a_number():
    """Which unresolved.py takes back: a body whose smoothed stresses are its own."""
    part = held("normal_resultant", Part(99.0), Sizes(0.1, 2.0, 3.0), 1.0, False, 0.0)
    assert part.error == pytest.approx(2.0 / (adjoint.FAINT * adjoint.OVER) ** 2)


@pytest.mark.slow
def test_a_run_says_what_its_adjoint_problems_took_and_holds_its_claims(solved):
    """Hertz' peak: companions that have few nodes in contact claim 17 %; it errs by 1.7 %."""
    errors = solved("hertz", h="0.004", errors="yes").summary["errors"]
    # the largest displacement is that of a support
    assert set(errors["adjoint"]["quantities"]) == {"peak_pressure", "normal_resultant"}
    assert 0 < errors["adjoint"]["products"] < 100
    assert 0.016 < errors["quantities"]["peak_pressure"]["relative"] < 0.1
