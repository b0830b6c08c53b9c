"""Rigid motions that nothing determines: the least one that contact and friction allow; bodies
that no state of contact balances.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.effects.free_bodies import FreeBodies, _least, _sum


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_a_body_moves_least_whatever_the_unit_of_its_motions(unit):
    """Two shifts and a turn; a row holds the second shift, one lets the first go by 0.3 at most."""
    held, limited, aim = np.array([[0.0, 1.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]), [0.5, -2.0, 0.1]
    found = _least(unit * held, unit * limited, unit * np.array([0.3]), np.array(aim))
    np.testing.assert_allclose(found, [0.3, 0.0, 0.1], atol=1e-9)
    # rows that feel a motion by less than a thousandth of a per cent do not hold it
    faint = np.vstack([held, [[0.0, 0.0, 1e-6]]])
    found = _least(unit * faint, unit * limited, unit * np.array([0.6]), np.array(aim))
    np.testing.assert_allclose(found, [0.5, 0.0, 0.1], atol=1e-9)
    # nor is there a motion where all are held
    found = _least(unit * np.eye(3), unit * limited, unit * np.array([0.3]), np.array(aim))
    np.testing.assert_allclose(found, 0.0, atol=1e-9)


def test_bodies_that_stay_unbalanced_are_named():
    """Those with more than a tenth of the largest imbalance, and where the largest one pulls."""
    modes = [SimpleNamespace(body=body) for body in (0, 1, 1, 2)]
    bodies = SimpleNamespace(
        _shares=lambda load, x: np.array([0.2, 0.01, 0.002, 0.03]), _names=FreeBodies._names,
        operator=SimpleNamespace(structure=SimpleNamespace(rigid_modes=modes)),
        _way=lambda load, x, body: f"body {body + 1} is pulled")
    said = FreeBodies.why_unbalanced(bodies, None, None)
    assert "20 % of the forces on bodies 1, 3, which" in said and "body 1 is pulled" in said


def test_the_loads_resultant_is_that_of_one_body_along_its_free_motions():
    """Two shifts make a vector, one a part of it; a turn says nothing, nor two bodies."""
    def mode(body, translation, rotation=0.0):
        return SimpleNamespace(body=body, translation=np.array(translation), rotation=rotation)

    both = [mode(0, [2.0, 0.0]), mode(0, [0.0, 1.0]), mode(0, [0.3, 0.1], 1.0)]
    assert _sum(both, np.array([6.0, -4.0, 9.0])) == " (3, -4)"
    assert _sum(both[:1], np.array([6.0])) == " (3, 0)"
    assert _sum(both[2:], np.array([9.0])) == ""
    assert _sum([both[0], mode(1, [1.0, 0.0])], np.array([6.0, 1.0])) == ""
