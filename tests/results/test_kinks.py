"""Kinks of rigid obstacles press into bodies, whose pressure has no limit there."""

import numpy as np
import pytest

from driver.contact.states import OPEN, STICK
from driver.results import quantities as q
from driver.results.kinks import kinks

X = np.linspace(-3, 3, 25)


def pressed(gap: np.ndarray, x: np.ndarray = X, middle: bool = False) -> tuple[dict, dict]:
    """A boundary along x pressed by 1 all over on an obstacle with a gap; most in the middle."""
    none = np.zeros(len(x), bool)
    nodes = {"arc": x - x[0], "xy": np.column_stack([x, 0 * x]), "gap": gap,
             "chain": none.astype(int), "weight": 1.0 + 0 * x, "paired": none, "mirrored": none,
             "middle": middle & (np.arange(len(x)) % 2 == 1)}
    steps = {"u_n": np.full(len(x), -1.0), "sigma_n": -2.0 + 0.6 * np.abs(x), "sigma_t": 0 * x,
             "status": np.full(len(x), STICK)}
    return nodes, {name: column[None] for name, column in steps.items()}


@pytest.mark.parametrize("middle", [False, True])
@pytest.mark.parametrize("place, found", [(0.0, [12]), (0.1, [12, 13])])
def test_a_wedge_presses_with_its_edge(place, found, middle):
    """At a node, or between two, which share its bend; pressure may then be infinite."""
    nodes, steps = pressed(0.1 * np.abs(X - place), middle=middle)
    assert np.flatnonzero(kinks(nodes, steps, 0)).tolist() == found
    assert q.singular_places(nodes, steps, 0) == ("peak_pressure",)


@pytest.mark.parametrize("gap", [
    X**2 / 20, 0.1 * np.sin(X), -0.1 * np.abs(X), 0 * X, 1e-3 * np.abs(X),
    0.1 * np.maximum(np.abs(X) - 1, 0)**2])  # rounded from 1 on
def test_smooth_obstacles_and_such_as_fall_away_have_none(gap):
    """Nor do kinks by less than a hundredth of what the body is pressed in by."""
    nodes, steps = pressed(gap)
    assert not kinks(nodes, steps, 0).any()
    assert q.singular_places(nodes, steps, 0) == ()


def test_kinks_count_where_they_touch_a_rigid_obstacle():
    """Gaps between two bodies bend at the nodes of either mesh; short boundaries tell nothing."""
    nodes, steps = pressed(0.1 * np.abs(X))
    assert not kinks(nodes | {"paired": X > -9}, steps, 0).any()
    moved = steps | {"gap": np.array([0.1 * np.abs(X - 1.0)])}
    assert np.flatnonzero(kinks(nodes, moved, 0)).tolist() == [16]
    steps["status"][0, 12] = OPEN
    assert not kinks(nodes, steps, 0).any()
    assert not kinks(*pressed(np.array([1.0, 0.0]), X[:2]), 0).any()
