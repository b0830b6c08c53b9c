"""make accuracy PART=handpicked: which settings by hand ACCURACY is compared with."""

import pytest

from driver.studies.accuracy.handpicked import Pick, compared


def pick(fineness, steps, seconds, value, element="P1"):
    return Pick({"h": 1 / fineness, "element": element}, fineness, steps, seconds, {"slip": value})


def test_the_best_by_hand_is_the_cheapest_that_can_be_trusted():
    """Not one that meets by chance what finer meshes or more steps do not."""
    picks = [pick(1, 1, 1.0, 2.0), pick(2, 1, 2.0, 2.2), pick(4, 1, 4.0, 2.02),
             pick(4, 2, 8.0, 2.01), pick(1, 1, 3.0, 1.9, "P2")]
    found = compared({"status": 0, "seconds": 9.0}, picks, "slip", 0.03, 2.0)
    assert found["by_hand"] == 4.0 and found["trusted"] == pytest.approx(0.01)
    assert found["ratio"] == 2.25 and found["within"] == "yes"
    found = compared({"status": 0, "seconds": 9.1}, picks, "slip", 0.1, 2.0)
    assert found["by_hand"] == 3.0 and found["within"] == "no"
    assert compared({"status": 0, "seconds": 9.0}, picks, "slip", 0.001, 2.0) == {"within": ""}
    assert compared({"status": 4, "seconds": 9.0}, picks, "slip", 0.1, 2.0) == {"within": ""}
