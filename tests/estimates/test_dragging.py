"""Shear of contact that slides as a whole, where motion has turned just before."""

import numpy as np
import pytest

from driver.contact.states import SLIP, STICK
from driver.estimates.budget import Part
from driver.estimates.caution import Caution
from driver.estimates.dragging import lacking, with_lacking
from driver.results.touch import Touch
from driver.results.ways import onward

SHEAR, SLID = Part(1e-9), Part(0.06)
VALUES = {"slip": 0.24, "tangential_resultant": 10.0}


def sliding(ways, forces, dragged=True) -> Touch:
    """Nodes that have slid by `ways` since they turned, with friction `forces`."""
    return Touch(nodes=len(ways), dragged=dragged, open={}, onward=np.column_stack([ways, forces]))


def test_ways_count_since_nodes_stuck_or_turned():
    """Of four nodes: one always slid on, one turned in the second step, one stuck in it, one sticks
    at the end and is none of them.
    """
    status = np.array([[SLIP] * 4, [SLIP, SLIP, STICK, SLIP], [SLIP, SLIP, SLIP, STICK]])
    slip = np.array([[1.0, -1, 1, 1], [2, 2, 0, 2], [4, 4, 4, 0]])
    steps = {"status": status, "slip": slip, "sigma_t": np.array([[9.0] * 4] * 2 + [[-3, 3, 2, 1]])}
    nodes = {"weight": np.array([1.0, 2, 1, 1])}
    np.testing.assert_array_equal(onward(nodes, steps, 2), [[7, 3], [6, 6], [4, 2]])
    np.testing.assert_array_equal(onward(nodes, steps, 0), [[1, 9], [1, 18], [1, 9], [1, 9]])


def test_a_node_that_slid_by_less_than_ways_err_may_stick():
    """A layer on a wavy floor that turned in the last step: its crest has slid by 0.14 of what its
    flanks have, ways err by a quarter, and meshes agreed on 5.4 N/mm, to nothing, of 5.38. By
    0.25 - 0.14 of the longest way it lacks so much of its friction.
    """
    touch = sliding([0.0014, 0.01, 0.009], [4.0, 3.0, 3.0])
    assert lacking(touch, 0.25) == pytest.approx((0.25 - 0.14) * 4.0)
    assert with_lacking(SHEAR, touch, VALUES, {"slip": SLID}).error == pytest.approx(0.44)
    # all of them if nothing is known of ways, but not one that has slid the longest
    assert with_lacking(SHEAR, touch, VALUES, {"slip": Part(None)}).error == pytest.approx(
        0.86 * 4.0 + 0.1 * 3.0)
    assert with_lacking(Part(0.5), touch, VALUES, {"slip": SLID}).error == 0.5


@pytest.mark.parametrize("touch", [
    sliding([0.01, 0.01, 0.004], [4.0, 3.0, 3.0]), sliding([], []), sliding([0.0, 0.0], [1.0, 1.0]),
    sliding([0.0, 0.01], [4.0, 3.0], dragged=False)])
def test_what_slid_on_lacks_no_friction(touch):
    """By more than ways err; nor is anything said where nothing slides, or some of it sticks."""
    assert with_lacking(SHEAR, touch, VALUES, {"slip": SLID}) == SHEAR


def test_shear_that_loads_give_does_not_hang_on_what_sticks():
    """By equilibrium, whatever slides: with slip that may be all error it was unknown."""
    values = {"tangential_resultant": [5.0, 5.0, 5.0], "slip": [0.1, 0.3, 0.7],
              "normal_resultant": [9.0, 9.0, 9.0], "displacement": [1.0, 1.0, 1.0]}
    runs = [dict(zip(values, column)) for column in zip(*values.values())]
    touch = sliding([0.0, 0.1], [2.0, 3.0])
    for given, error in ((frozenset({"tangential_resultant"}), 0.0), (frozenset(), 5.0)):
        found = Caution("P1", touch=touch, given=given).parts(
            runs[0], list(zip(runs, runs[1:])), [2.0, 2.0], ())
        assert found["tangential_resultant"].error == error
