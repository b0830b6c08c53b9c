"""Jumps over cycles in the error budget and in the price of the next digit."""

import pytest

from driver.estimates.jumps import Jumps, carried_on, halved, remedy
from driver.estimates.prices import Quantity
from driver.text import assignments


@pytest.mark.parametrize("plan, shorter", [
    ([0, 0, 9, 0], [0, 0, 4, 0, 3, 0]), ([4], [1, 0, 1]), ([2, 0], [0, 0, 0, 0]), ([0], [0])])
def test_jumps_half_as_long_go_as_far(plan, shorter):
    assert halved(plan) == shorter
    assert len(shorter) + sum(shorter) == len(plan) + sum(plan)


def test_cycles_after_a_jump_tell_what_it_went_on_with():
    """Of cycles whose work tends to 1 like 1 + 0.4^k forty are taken for the seventh, and the one
    after them is the eighth; of work that grows by as much a cycle the one after is the later one.
    """
    work, plan = [1 + 0.4**k for k in (5, 6, 7, 8)], [0, 0, 40, 0]
    true = sum(1 + 0.4**7 - (1 + 0.4**k) for k in range(8, 48))
    assert true <= carried_on(work, plan) <= 1.1 * true
    work, plan = [1 + 0.1 * k for k in (0, 1, 12)], [0, 10, 0]
    true = sum(0.1 * k - 0.1 for k in range(2, 12))
    assert true <= carried_on(work, plan) <= 2.1 * true
    assert carried_on([1.0, 1.0, 1.0], [0, 9, 0]) == carried_on([2.0], [0]) == 0.0


def test_shorter_jumps_err_by_less_until_there_are_none():
    """Ten of a hundred cycles computed at 2 %: errors halve as computed cycles double."""
    found = Jumps.of(0.4, "100 jump 2%", [0, 0, 90, 0, 0, 0, 0, 0, 0, 0]).choices()
    assert found == [("100 jump 2%", 0.4, 1.0), ("100 jump 1%", 0.2, 2.0),
                     ("100 jump 0.5%", 0.1, 4.0), ("100 jump 0.25%", 0.05, 8.0), ("100", 0.0, 10.0)]
    assert remedy("jump", [0, 0, 90, 0, 0, 0, 0, 0, 0, 0]) == 'CYCLES="100 jump 0.5%"'


def test_prices_leave_room_for_jumps():
    """Of what is allowed, 0.3, the mesh gets what steps, jumps and solver leave."""
    jumps = Jumps(0.2, 0.02, 10, 40)
    quantity = Quantity("slip", 1.0, 8, False, {8: 0.1}, 1.0, 0.05, jumps)
    found = [entry for entry in quantity.choices(0.3) if entry[0]["STEPS"] == "8"]
    assert [entry[0]["CYCLES"] for entry in found] == ['"40 jump 1%"', '"40"']
    assert [entry[1] for entry in found] == [16, 32]
    assert [entry[2] for entry in found] == pytest.approx([0.05, 0.15])
    assert assignments(found[0][0]) == 'STEPS=8 CYCLES="40 jump 1%"'
