"""What linear elements miss of gaps that bend between contact nodes."""

from dataclasses import replace

import numpy as np
import pytest

from driver.contact.states import OPEN, STICK
from driver.estimates import adjoint
from driver.estimates.adjoint import Sizes, held
from driver.estimates.budget import Part
from driver.estimates.nodal_gaps import missed_gaps


def line(x: np.ndarray) -> dict:
    """Nodes at places x of a straight boundary."""
    side, none = np.diff(x), np.zeros(len(x), bool)
    return {"arc": x, "xy": np.column_stack([x, 0 * x]), "chain": 0 * x.astype(int),
            "weight": (np.r_[side, 0] + np.r_[0, side]) / 2, "paired": none, "mirrored": none}


@pytest.mark.parametrize("x", [np.linspace(-1, 1, 9), np.array([-1, -0.7, -0.5, 0, 0.2, 0.9, 1])])
def test_chords_miss_a_parabola_by_what_lies_under_it(x):
    """Integral of g - g_h of g = x^2/2: -sum h^3/12, on sides of any length."""
    missed = missed_gaps(line(x), x**2 / 2, np.full(len(x), STICK))
    assert missed @ line(x)["weight"] == pytest.approx(-(np.diff(x)**3).sum() / 12, rel=1e-12)
    even = len(set(np.diff(x).round(9))) == 1
    assert not even or missed[1:-1] == pytest.approx(-(x[1] - x[0])**2 / 12)


def test_sides_that_are_open_or_of_pairs_miss_nothing():
    """Nor do straight gaps, nor boundaries of fewer than three nodes."""
    x = np.linspace(0, 1, 6)
    nodes, status = line(x), np.array([STICK, STICK, STICK, OPEN, OPEN, OPEN])
    found = missed_gaps(nodes, x**2, status)
    assert found[:3].all() and not found[3:].any() and found[2] == pytest.approx(found[1] / 2)
    assert not missed_gaps(nodes | {"paired": x >= 0}, x**2, status).any()
    assert not missed_gaps(nodes, 0.1 + x, np.full(6, STICK)).round(15).any()
    assert not missed_gaps(line(x[:2]), x[:2]**2, status[:2]).any()


def test_claims_of_adjoint_problems_that_speak_alone_have_what_gaps_miss():
    """A bump pressed flat: a third of the error of its force is in no stress: 1.4 % stood for 1.9.
    """
    sizes = Sizes(1.0, 2.0, 30.0, gaps=0.7)
    part = held("normal_resultant", Part(99.0), sizes, told=False)
    assert part.error == pytest.approx(2.0 / adjoint.SEES**2 + 0.7)
    told = held("normal_resultant", Part(99.0), replace(sizes, product=10.0))
    assert told.error == pytest.approx(2 * 10.0 / adjoint.SEES**2 + 0.7)
