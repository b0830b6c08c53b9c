"""Loads that come and go: what they give, what the body stores, what friction takes; and that
nothing drifts.
"""

import numpy as np
import pytest
from small_scenes import RIGHT, TOP, Body, Scene, rectangle, solve

from driver.hard.oracle import Assembled

CYCLE = 8  # steps


def sheared_block(cycles: int, shear=0.4) -> Scene:
    """Clamped on the left, pressed from above from the first step on, sheared to and fro on the
    right.
    """
    xy, triangles, outline = rectangle(8, 4)
    part = (xy[triangles].mean(axis=1)[:, 0] > 1).astype(int)
    body = Body(xy, triangles, outline, part, np.ones(len(triangles)), 0.277)
    t = np.arange(CYCLE * cycles + 1) / CYCLE
    amplitudes = np.column_stack([np.minimum(1.0, CYCLE * t), np.sin(2 * np.pi * t)])
    return Scene(body, [{TOP: np.array([0.0, -1e-3])}, {RIGHT: np.array([shear * 1e-3, 0.0])}],
                 amplitudes, friction=0.3)


@pytest.fixture(scope="module", params=[10, pytest.param(100, marks=pytest.mark.slow)])
def cycled(request):
    """(cycles, run, body, multipliers (steps + 1, 2 n), displacements (steps + 1, dofs)), zero at
    the start.
    """
    scene = sheared_block(request.param)
    run = solve(scene, rtol=1e-11, friction_rtol=1e-11)
    assert run.solver.failure is None, str(run.solver.failure)
    body, contact = Assembled(run.manifest, run.subdomains), run.structure.contact
    order = [int(np.flatnonzero(contact.gid == g)[0]) for g in body.gid]
    lam = np.array([np.concatenate([s.multipliers[contact.normal_row],
                                    s.multipliers[contact.tangential_row]])
                    [[*order, *(len(order) + np.array(order))]] for s in run.steps])
    u = np.array([body.solve(s.weights, -body.B.T @ x) for s, x in zip(run.steps, lam)])

    def start(values):
        return np.vstack([0 * values[:1], values])

    return request.param, run, body, start(lam), start(u)


def work(cycled):
    """Per step: work of the loads, of contact (mean force times displacement), change of the stored
    energy.
    """
    _, run, body, lam, u = cycled
    loads = np.vstack([0 * body.loads[:1], np.array([s.weights for s in run.steps]) @ body.loads])
    step, load, force = np.diff(u, axis=0), *((v[1:] + v[:-1]) / 2 for v in (loads, lam))
    stored = np.diff(0.5 * np.einsum("ki,ki->k", u, (body.K @ u.T).T))
    return (load * step).sum(axis=1), (force * (step @ body.B.T)).sum(axis=1), stored


def test_energy_balances_in_every_cycle(cycled):
    """With K u = f - B' lambda at both ends of a step, mean forces times displacements balance
    exactly: 1e-6 of the work of a cycle is far above the rounding of the sums. The implicit
    dissipation lambda_k Du differs by 1/2 Dlambda Du."""
    given, rubbed, stored = (values[CYCLE:].reshape(-1, CYCLE).sum(axis=1)
                             for values in work(cycled))
    assert np.abs(given - rubbed - stored).max() <= 1e-6 * np.abs(given).max()
    assert given.min() > 0, "no cycle without friction's work: the test would be empty"
    # a closed cycle stores nothing: friction takes all
    assert np.abs(stored[-1]) <= 1e-6 * given[-1]


def test_reported_dissipation_differs_by_its_known_term(cycled):
    _, _, body, lam, u = cycled
    n, slip = len(body.gid), np.diff(u @ body.B.T, axis=0)[:, len(body.gid):]
    implicit = (lam[1:, n:] * slip).sum(axis=1)
    _, rubbed, _ = work(cycled)
    normal = (0.5 * (lam[1:, :n] + lam[:-1, :n]) * np.diff(u @ body.B.T, axis=0)[:, :n]).sum(axis=1)
    known = 0.5 * ((lam[1:, n:] - lam[:-1, n:]) * slip).sum(axis=1)
    np.testing.assert_allclose(rubbed - normal, implicit - known, rtol=0,
                               atol=1e-12 * np.abs(rubbed).max())
    assert implicit.min() >= -1e-9 * implicit.max(), "friction gave energy"


def test_nothing_drifts(cycled):
    """After some cycles each repeats the one before, to the tolerance 1e-11 times cond F (1e3) and
    a hundred steps.
    """
    _, _, _, lam, u = cycled
    for values in (lam, u):
        last, before = values[-CYCLE:], values[-2 * CYCLE : -CYCLE]
        assert np.abs(last - before).max() <= 1e-6 * np.abs(values).max()
    first = np.abs(lam[CYCLE + 1 : 2 * CYCLE + 1] - lam[1 : CYCLE + 1]).max()
    assert first > 1e-3 * np.abs(lam).max(), "the first cycle is to differ: there is a way to go"
