"""make accuracy PART=handpicked: which settings by hand ACCURACY is compared with."""

import pytest

from driver.studies.accuracy.handpicked import Pick, best_of, compared


def pick(fineness, steps, seconds, value, element="P1"):
    return Pick({"h": 1 / fineness, "element": element}, fineness, steps, seconds, {"slip": value})


def test_the_best_by_hand_is_the_cheapest_that_can_be_trusted():
    """Not one that meets by chance what finer meshes or more steps do not."""
    picks = [pick(1, 1, 1.0, 2.0), pick(2, 1, 2.0, 2.2), pick(4, 1, 4.0, 2.02),
             pick(4, 2, 8.0, 2.01), pick(1, 1, 3.0, 1.9, "P2")]
    best, trusted = best_of(picks, "slip", 0.03, 2.0)
    assert best is picks[2] and trusted == pytest.approx(0.01)
    assert best_of(picks, "slip", 0.1, 2.0)[0] is picks[4]
    assert best_of(picks, "slip", 0.001, 2.0) == (None, None)


def test_medians_of_repeated_runs_are_compared():
    """The least of many times is one by chance."""
    found = compared([9.0, 12.0, 8.0], [4.0, 1.0, 3.1])
    assert found["seconds"] == 9.0 and found["by_hand"] == 3.1 and found["within"] == "yes"
    assert compared([9.4, 12.0, 8.0], [4.0, 1.0, 3.1])["within"] == "no"
