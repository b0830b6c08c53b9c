"""The hysteresis loop of repeated histories."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from driver.figures import cycles
from driver.figures.reading import Run


def area(x: np.ndarray, y: np.ndarray) -> float:
    """Area inside a closed polygon."""
    return abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2


def swayed() -> Run:
    """Two cycles of three nodes on a spring each, past which an obstacle goes to and fro.

    A step of it is as long as a spring yields from one friction bound to the other: in the steps
    after it has turned nothing slides, in all others of the second cycle forces are constant.
    """
    pushed = np.tile([0.2, 0.4, 0.2, 0.0, -0.2, -0.4, -0.2, 0.0], 2)
    spring = np.zeros(17)
    for k, step in enumerate(np.diff(pushed, prepend=0.0)):
        spring[k + 1] = np.clip(spring[k] + step, -0.1, 0.1)
    slip = np.diff(spring) - np.diff(pushed, prepend=0.0)
    rows = {"step": np.repeat(np.arange(1, 17), 3), "node": np.tile(np.arange(3), 16),
            "arc": np.tile(np.arange(3.0), 16), "weight": np.tile([0.5, 1.0, 0.5], 16),
            "u_t": np.repeat(spring[1:], 3), "slip": np.repeat(slip, 3),
            "sigma_t": np.repeat(10 * spring[1:], 3)}
    work = -2 * np.add.reduceat(10 * spring[1:] * slip, [0, 8])
    table = {"cycle": np.array([1, 2]), "step": np.array([8, 16]), "dissipated": work,
             **{name: np.zeros(2) for name in ("skipped", "change", "drift", "wear")},
             "slip": np.ones(2)}
    found = {"settled_after": 1, "skipped": 0, "number": 2, "start": 0.0,
             "last": {"kind": "alternating slip"}}
    summary = {"scene": "own", "converged": True, "units": {"length": "", "stress": ""},
               "effects": {"obstacle_motion": True}, "cycles": found}
    history = {"step": np.arange(1, 17), "time": np.arange(1, 17) / 8}
    return Run(summary, history, rows, None, None, None, None, cycles=table)


def test_the_loop_past_an_obstacle_that_moves_has_the_area_of_the_work_of_friction():
    """Six steps of 0.2 slide under 2 N: 2.4. The nodes' own displacements would have no loop."""
    run, axes = swayed(), Figure().add_subplot()
    cycles._loop(axes, run, run.cycles)  # pylint: disable=protected-access
    last = max(axes.lines, key=lambda line: line.get_zorder())
    assert run.cycles["dissipated"][1] == pytest.approx(2.4, rel=1e-12)
    assert area(*last.get_data()) == pytest.approx(2.4, rel=1e-12)
