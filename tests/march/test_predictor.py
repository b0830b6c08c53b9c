"""Where steps start from, and what they take that start from the solution."""

import numpy as np
import pytest

from driver.effects import Effects
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
