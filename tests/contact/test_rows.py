"""What the contact rows of one rank say of its nodes."""

from types import SimpleNamespace

import constants
import numpy as np
import pytest

from driver.contact import rows as module
from driver.contact.law import ContactLaw, law_at
from driver.contact.rows import ContactRows, contact_rows
from driver.contact.states import OPEN, SLIP, STICK
from driver.effects import Effects


def rows(tangential: int, friction: bool) -> ContactRows:
    """Two nodes with normal rows, and tangential ones for the first `tangential` of them."""
    normal, own = np.arange(2), np.arange(tangential)
    return ContactRows(normal, normal, np.zeros(2), 2 + own, own, own,
                       np.full(tangential, 0.5) if friction else None, None,
                       np.empty(0, int), np.zeros(2, bool))


@pytest.mark.parametrize("tangential, friction, touching", [
    (2, True, STICK), (1, True, STICK),
    (0, True, STICK),  # supports hold them against sliding: so say other ranks of their like
    (0, False, SLIP)])
def test_only_without_friction_nothing_holds_a_node(tangential, friction, touching):
    states = rows(tangential, friction).states(np.array([3.0, 0.0, 0.1, 0.0])[: 2 + tangential])
    assert states.tolist() == [touching, OPEN]


def test_a_law_at_places_has_nothing_at_others():
    law = ContactLaw(np.array([0.5, 0.25]), None, np.zeros(2, bool))
    assert law_at(law, np.array([[1, -1], [-1, 0]])).tolist() == [[[0.25, 0], [0, 0.5]],
                                                                  [[0, 0], [0, 0]]]


def test_another_law_holds_for_a_block_also_where_that_fails():
    one = rows(2, friction=True)
    x = np.array([3.0, 4.0, 0.0, 0.0])
    with pytest.raises(ValueError):
        with one.under(np.full(2, 2.0), np.full(2, 1.0)):
            assert one.friction_bound(x).tolist() == [7, 9]
            raise ValueError
    assert one.friction_bound(x).tolist() == [1.5, 2] and one.offset is None


def test_rows_of_idle_nodes_do_not_act(monkeypatch):
    """On the rank that has them, by their place there; a node may have rows of one kind alone."""
    monkeypatch.setattr(module, "corner_nodes", lambda *_: None)
    contact = SimpleNamespace(
        gid=np.arange(5), gap=np.arange(5.0), idle=np.array([True, False, True, True, False]),
        normal_row=np.array([9, 10, 12, -1, 15]), tangential_row=np.array([20, 11, -1, 14, 16]))
    structure = SimpleNamespace(contact=contact, row_range=(10, 17),
                                row_kind=np.array([1, 2, 1, 0, 2, 1, 2]))
    law = ContactLaw(np.full(5, 0.5), None, np.array([False, True, True, False, False]))
    of = contact_rows(structure, law)
    assert of.normal.tolist() == [0, 2, 5] and of.normal_node.tolist() == [1, 2, 4]
    assert of.tangential.tolist() == [1, 4, 6] and of.idle.tolist() == [2, 4]
    assert of.gap.tolist() == [1.0, 2.0, 4.0] and of.gluing.tolist() == [3]
    lower, upper = of.limits_at(7, np.array([3.0, 4.0, 5.0]))
    inf = np.inf
    assert lower.tolist() == [-inf, -3, 0, -inf, 0, 0, -5]
    assert upper.tolist() == [inf, 3, 0, inf, 0, inf, 5]
    contact.idle[:] = False
    assert contact_rows(structure, law).idle is None


def test_every_contact_row_is_of_one_rank(built):
    """Wherever ranks part the rows, also in front of a tangential one."""
    problem = built(cells=2, subdomains="2x1")
    structure = problem.structure
    law, contact = Effects(problem.manifest).contact_law(structure.contact), structure.contact
    expected = sorted(row for row in (*contact.normal_row, *contact.tangential_row) if row >= 0)
    known, rows = structure.row_range, structure.dual_dofs
    try:
        for cut in range(rows + 1):
            found = []
            for structure.row_range in ((0, cut), (cut, rows)):
                own = contact_rows(structure, law)
                found += (np.append(own.normal, own.tangential) + structure.row_range[0]).tolist()
            assert sorted(found) == expected
    finally:
        structure.row_range = known


def test_constants_that_are_called_parts_are_between_none_and_all():
    assert not constants.beyond("contact")
