"""Where steps start from, and what they take that start from the solution."""

import numpy as np
import pytest

from driver.effects import Effects
from driver.feti.rows import RowKind
from driver.march.quasistatic import QuasistaticSolver
from driver.options import Settings


def test_a_step_starts_from_its_answer_where_the_load_grows_in_proportion(built):
    """Multipliers of the third step are half as many again as those of the second, to what is left
    of the tolerance of a step.
    """
    problem = built(loading="monotone", cells=3, steps=4)
    solver = QuasistaticSolver(
        problem.operator, Effects(problem.manifest), problem.manifest.factors,
        np.linspace(0, 1, 5), Settings(rtol=1e-10, friction_rtol=1e-9))
    steps = solver.steps()
    next(steps)
    second = next(steps).multipliers
    _, start, _ = solver._predicted(3)
    third = next(steps).multipliers
    size = np.abs(third).max()
    np.testing.assert_allclose(third, 1.5 * second, atol=1e-6 * size)
    np.testing.assert_allclose(start, third, atol=1e-6 * size)


@pytest.mark.parametrize("subdomains, preconditioner, corrector, relaxed", [
    ("4x2", "deflated", "contact", True), ("4x2", "none", "none", False),
    ("1x1", "deflated", "contact", True)])
def test_contact_is_relaxed_where_it_is_asked_for(built, subdomains, preconditioner, corrector,
                                                  relaxed):
    problem = built(cells=3, subdomains=subdomains)
    solver = QuasistaticSolver(
        problem.operator, Effects(problem.manifest), problem.manifest.factors,
        np.linspace(0, 1, 3), Settings(preconditioner=preconditioner, corrector=corrector,
                                       expansion="contact" if relaxed else "gradient"))
    assert (solver.qp.accelerators.relaxation is not None) == relaxed


def test_what_makes_qps_quick_knows_what_rows_yield_whenever_it_is_made(built):
    """Surfaces that yield make F softer: before or after preconditioner and relaxation are made."""
    problem = built(cells=3, subdomains="4x2")
    m, operator = problem.manifest, problem.operator
    softness = np.where(operator.structure.row_kind == RowKind.NORMAL, 0.1, 0.0)
    residual = np.random.default_rng(1).standard_normal(len(softness))

    def made(*, soft: bool, early: bool):
        qp = QuasistaticSolver(operator, Effects(m), m.factors, np.linspace(0, 1, m.steps + 1),
                               Settings()).qp
        if early:
            assert qp.accelerators
        if soft:
            qp.soften(softness)
        qp.bound *= 2  # as MPRGP does where it was too small, and a resumed run begins with
        applied = qp.accelerators.preconditioner(residual, residual < 0.5)
        operator.softness = None
        return applied, qp.accelerators.relaxation.norm_bound

    found = [made(soft=True, early=early) for early in (True, False)]
    np.testing.assert_array_equal(found[0][0], found[1][0])
    stiff, bound = made(soft=False, early=True)
    assert not np.array_equal(stiff, found[0][0])
    assert found[0][1] == found[1][1] > bound
