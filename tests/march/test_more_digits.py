"""Steps that rounding keeps from ending, as of thin rails, whose loads alone bend them far."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest
from thin_rail import RAIL

from driver.errors import NotConverged
from driver.march import globalization
from driver.march.more_digits import MoreDigits
from driver.march.step import Unfinished

LENGTH, THICK, WEIGHT, FRICTION = 2.0, 0.01, 1e7, 0.4


def sliding(run, length: float, thick: float) -> bool:
    """Whether the floor carries the weight, and friction of all of it stands against the heat.

    But for that of the node that is held, which carries as much as a side beside it is long.
    """
    floor, weight = run.summary["boundaries"][0], WEIGHT * length * thick
    held = 2.0 / np.count_nonzero(run.contact["weight"][-1])
    carried = floor["normal_resultant"], -floor["tangential_resultant"] / FRICTION
    return (carried[0] == pytest.approx(weight, rel=1e-6)
            and weight * (1 - held) < carried[1] < weight)


@pytest.fixture
def rail(solved, named_scene):
    """rail(..): a run to residuals far below the rounding of the rail's displacements."""
    def run(**options):
        return solved(named_scene("rail", RAIL), cells=1, steps=2, primal_rtol=1e-9, **options)

    return run


@pytest.mark.parametrize("cut", ["7x1", "3"])
def test_contact_rows_get_more_digits_than_products_have(rail, monkeypatch, cut):
    """As many as there are once Newton's method has eliminated the gluing, of any number of nodes.
    """
    monkeypatch.setattr(globalization, "CONDENSED_NODES", 10)
    run = rail(subdomains=cut)
    assert run.status == 0 and max(run.summary["residuals"].values()) <= 1e-9
    assert run.summary["counts"]["condensed_steps"] == 2
    assert sliding(run, LENGTH, THICK)


def test_steps_begin_with_the_digits_that_the_one_before_needed(rail, monkeypatch):
    """And fail no more before they have them."""
    from driver.march import more_digits

    begun, own = [], more_digits.MoreDigits.settled

    def settled(self, *args):
        begun.append(self.needed)
        return own(self, *args)

    monkeypatch.setattr(more_digits.MoreDigits, "settled", settled)
    rail(subdomains="7x1", uniqueness="no")
    assert begun == [False, True]


@pytest.mark.parametrize("needed", [False, True])
def test_what_fails_by_little_again_is_solved_from_its_first_start(needed):
    """By refined displacements; a start near the solution may stay as near as it is."""
    latest, tried = np.ones(1), []
    first = np.zeros(1), np.zeros(1), np.zeros(1)

    def settled(_index, _load, start, _trace, _solve):
        tried.append(start[0])
        if len(tried) < 3 - needed:
            raise Unfinished(NotConverged("by little"), latest, latest, near=True)
        return "answer"

    march = SimpleNamespace(
        fixed_point=SimpleNamespace(place=lambda load: "place", back=lambda load, place, at: at),
        operator=SimpleNamespace(uneven=False, bodies_differ=False), solve=None,
        effects=SimpleNamespace(closes=False), closure=SimpleNamespace(settled=settled),
        rows=SimpleNamespace(friction_bound=lambda x: x, sliding=lambda x, bound: x),
        condensation=SimpleNamespace(refined=contextlib.nullcontext))
    more = MoreDigits(march)
    more.needed = needed
    assert more.settled(1, None, first, None) == "answer" and more.needed
    begun = [first[0], latest, first[0]] if not needed else [first[0], first[0]]
    assert all(x is known for x, known in zip(tried, begun, strict=True))


@pytest.mark.slow
def test_thin_rails_of_a_thousand_nodes(solved, named_scene):
    """A thousand times as long as thick: loads alone would move it by 1e6 of what is left."""
    run = solved(named_scene("rail", RAIL), cells=1, steps=1, subdomains="5x1", length=2.5,
                 thick=0.0025)
    assert run.status == 0 and sliding(run, 2.5, 0.0025)
