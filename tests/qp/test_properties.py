"""Random box QPs and random small scenes, drawn by hypothesis (the same ones in every run), against
dense oracles.

`make test` runs 60 QPs and 40 scenes, `make test-long` 1500 and 700.
"""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_scenes import Scene, random_scene, solve
from test_mprgp import EPS, assert_solves, orthogonal, residual_of

from driver.qp.mprgp import mprgp
from driver.hard.dense import OracleFailure, coulomb_step
from driver.hard.oracle import Assembled

CALM = {"deadline": None, "derandomize": True, "database": None,
        "suppress_health_check": list(HealthCheck)}


def sizes(quick: int, long: int):
    """Runs a property with `quick` examples by default and with `long` ones among the slow tests.
    """
    return pytest.mark.parametrize("examples", [quick, pytest.param(long, marks=pytest.mark.slow)])


# ------------------------------------------------------------------------------------------------
# box QPs

@st.composite
def box_qps(draw):
    """(A, b, lower, upper, options): SPD of condition 1..1e10, any kind of box, any start, perhaps
    a wrong norm bound.
    """
    n, rng = draw(st.integers(1, 14)), np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread = draw(st.sampled_from([0, 1, 3, 6, 10]))
    d = 10.0 ** -np.append(spread * rng.random(max(n - 2, 0)), [0.0, spread])[:n]
    A = (lambda Q: (Q * d) @ Q.T)(orthogonal(rng, n)) * 10.0 ** draw(st.sampled_from([-12, 0, 9]))
    A = (A + A.T) / 2
    lower, upper = -rng.random(n), rng.random(n)
    box = draw(st.sampled_from(["two-sided", "lower", "upper", "mixed", "some fixed", "all fixed",
                                "one free", "none"]))
    if box in ("lower", "none"):
        upper[:] = np.inf
    if box in ("upper", "none"):
        lower[:] = -np.inf
    if box == "mixed":
        lower[rng.random(n) < 0.5], upper[rng.random(n) < 0.5] = -np.inf, np.inf
    if box in ("some fixed", "all fixed", "one free"):
        fixed = {"some fixed": rng.random(n) < 0.5, "all fixed": np.ones(n, bool),
                 "one free": np.arange(n) > 0}[box]
        upper[fixed] = lower[fixed]
    b = A @ (2 * rng.standard_normal(n))
    # degenerate: at the solution bound and multiplier vanish together in most components
    if draw(st.booleans()):
        x = np.clip(3 * rng.standard_normal(n), lower, upper)
        push = np.where(x == lower, 1.0, np.where(x == upper, -1.0, 0.0)) * np.linalg.norm(A, 2)
        b = A @ x - push * (rng.random(n) < 0.2)
    if draw(st.integers(0, 9)) == 0:
        b = 0.0 * b
    start = draw(st.sampled_from(["zero", "outside", "corner"]))
    x0 = {"zero": np.zeros(n), "outside": 5 * rng.standard_normal(n),
          "corner": np.where(np.isfinite(lower), lower,
                             np.where(np.isfinite(upper), upper, 0.0))}[start]
    wrong = draw(st.sampled_from([1.0, 1.0, 0.01, 0.5, 1.1, 100.0]))
    options = {"norm_bound": max(wrong * np.linalg.norm(A, 2), 1e-300),
               "expansion": draw(st.sampled_from(["cg", "gradient"]))}
    if draw(st.booleans()):
        diagonal = np.diag(A).copy()
        options["preconditioner"] = lambda r, free: np.where(free, r / diagonal, 0.0)
    return A, b, lower, upper, x0, options


@sizes(60, 1500)
def test_random_box_qps(examples):
    @settings(max_examples=examples, **CALM)
    @given(box_qps())
    def check(problem):
        A, b, lower, upper, x0, options = problem
        start = np.clip(x0, lower, upper)
        # without b the scale is that of earlier loads, from which the start comes
        tol = 1e-8 * np.linalg.norm(b if b.any() else A @ start)
        found = mprgp(lambda v: A @ v, b, lower, upper, x0, tol=tol, max_products=20_000, **options)
        residual = residual_of(A, b, lower, upper, found.x)[0]
        # rounding of A x - b on the way; a tolerance below it may be missed, and must then be said
        # to be
        size = np.linalg.norm(found.x if b.any() else start)
        noise = 100 * len(b) * EPS * (np.linalg.norm(A, 2) * size + np.linalg.norm(b))
        if found.status == "stagnated":
            assert tol <= noise and residual <= noise
        elif b.any():
            assert_solves(A, b, lower, upper, found)
        else:
            assert found.status == "converged" and residual <= tol + noise

    check()


@sizes(10, 100)
def test_random_empty_boxes(examples):
    @settings(max_examples=examples, **CALM)
    @given(box_qps(), st.data())
    def check(problem, data):
        A, b, lower, upper, x0, options = problem
        i = data.draw(st.integers(0, len(b) - 1))
        lower[i] = (upper[i] if np.isfinite(upper[i]) else 1.0) + 1e-3
        upper[i] = lower[i] - 1e-3
        with pytest.raises(ValueError, match="box is empty"):
            mprgp(lambda v: A @ v, b, lower, upper, x0, tol=1e-8 * np.linalg.norm(b), **options)

    check()


# -------------------------------------------------------------------------------------------------
# scenes

RTOL = 1e-11
# Residuals of the contact rows are at most RTOL ||d||; what is left on the gluing rows reaches them
# through the body, by a factor of about the root of cond F_gg (10 for these), and a step inherits
# the tangential displacements of those before.
LEFT = 100 * RTOL


@st.composite
def scenes(draw):
    """A random scene, its largest friction coefficient and the law of its contact."""
    friction = draw(st.sampled_from([0.0, 1e-6, 0.1, 0.3, 0.5, 0.5, 1.0, 3.0, 10.0]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scene = random_scene(rng, friction, draw(st.integers(2, 12)), draw(st.integers(1, 5)),
                         draw(st.integers(1, 8)),
                         draw(st.integers(1, 4)))
    scene.effects = draw(st.sampled_from([{}, {}, {}, {}, {"friction": "tresca"},
                                          {"contact": "bilateral"},
                                          {"friction": "none"}]))
    if scene.effects.get("friction") == "tresca":
        scene.friction = scene.friction * max(np.abs(force).max() for t in scene.tractions
                                              for force in t.values())
    return scene, friction


class DenseScene:
    """The assembled body of a solved scene: its compliance at the contact nodes and what loads
    alone do there.
    """

    def __init__(self, run):
        self.body, contact = Assembled(run.manifest, run.subdomains), run.structure.contact
        self.C, B, self.n = self.body.compliance(), self.body.B, len(self.body.gid)
        self.unit = np.array([B @ self.body.solve(w) for w in np.eye(len(self.body.loads))])
        place = {g: k for k, g in enumerate(contact.gid)}
        order = np.array([place[g] for g in self.body.gid])
        self.normal, self.tangential = contact.normal_row[order], contact.tangential_row[order]

    def multipliers(self, step) -> np.ndarray:
        """(2 n,) normal, then tangential ones; without friction the latter are zero."""
        lam = step.multipliers
        return np.concatenate([lam[self.normal], np.where(self.tangential >= 0,
                                                          lam[self.tangential], 0.0)])


def assert_obeys(scene: Scene, dense: DenseScene, steps, allowed: float):
    """Contact and friction law at every node and step, written down anew, on the assembled body;
    errors as displacements.
    """
    n, law, previous = dense.n, scene.effects, np.zeros(dense.n)
    for step in steps:
        lam = dense.multipliers(step)
        moved = step.weights @ dense.unit - dense.C @ lam
        lambda_n, lambda_t = lam[:n], lam[n:]
        over, slip = moved[:n] - dense.body.gap, moved[n:] - previous
        bilateral = law.get("contact") == "bilateral"
        bound = dense.body.friction * (dense.body.weight if law.get("friction") == "tresca"
                                       else np.abs(lambda_n))
        bound = 0 * bound if law.get("friction") == "none" else bound
        assert bilateral or lambda_n.min() >= 0
        assert np.all(np.abs(lambda_t) <= bound * (1 + 1e-14))
        assert over.max() <= allowed
        assert np.abs(over[(lambda_n != 0) | bilateral]).max(initial=0) <= allowed
        assert np.abs(slip[np.abs(lambda_t) < bound]).max(initial=0) <= allowed
        against = slip * np.sign(lambda_t)
        assert against[bound > 0].min(initial=0) >= -allowed
        previous = moved[n:]


def oracle_multipliers(dense: DenseScene, steps, coefficient):
    """The oracle's multipliers (steps, 2 n) of its own history."""
    x, u_t, found = np.zeros(2 * dense.n), np.zeros(dense.n), []
    for step in steps:
        loaded = step.weights @ dense.unit
        x = coulomb_step(dense.C, loaded - np.concatenate([dense.body.gap, u_t]), coefficient, x)
        u_t = (loaded - dense.C @ x)[dense.n :]
        found.append(x)
    return np.array(found)


@pytest.mark.slow
@sizes(40, 700)
def test_random_scenes(examples):
    compared = []

    @settings(max_examples=examples, **CALM)
    @given(scenes())
    def check(drawn):
        scene, _ = drawn
        run = solve(scene, rtol=RTOL, friction_rtol=1e-10)
        assert run.solver.failure is None, str(run.solver.failure)
        assert len(run.steps) == len(scene.amplitudes) - 1
        dense, allowed = DenseScene(run), LEFT * run.solver.scales.largest["d"]
        assert_obeys(scene, dense, run.steps, allowed)
        if scene.effects.get("contact") == "bilateral" or scene.effects.get("friction") == "tresca":
            return
        coefficient = dense.body.friction * (scene.effects.get("friction") != "none")
        try:
            expected = oracle_multipliers(dense, run.steps, coefficient)
        except OracleFailure:
            # its fixed point does not contract: the law, checked above, is all there is to say
            return
        found = np.array([dense.multipliers(step) for step in run.steps])
        stiffest = np.linalg.norm(np.linalg.inv(dense.C), 2)
        apart = np.abs(found - expected).max()
        if apart > 10 * allowed * stiffest:  # two solutions: that must have been said
            assert run.solver.uniqueness.verdict == "not unique"
            return
        compared.append(apart)

    check()
    assert len(compared) > examples / 2, "too few comparisons with the oracle"


def test_bilateral_contact_closes_gaps_without_load():
    """No load at all: the gap itself is what has to be overcome, and the tolerance must follow it.
    """
    scene = random_scene(np.random.default_rng(5), 0.3, 6, 3, 3, 1)
    scene.effects, scene.gap, scene.amplitudes = {"contact": "bilateral"}, 1e-3, np.zeros((2, 2))
    run = solve(scene, rtol=RTOL)
    assert run.solver.failure is None, str(run.solver.failure)
    assert_obeys(scene, DenseScene(run), run.steps, LEFT * run.solver.scales.largest["d"])
    assert np.abs(run.steps[0].multipliers).max() > 0
