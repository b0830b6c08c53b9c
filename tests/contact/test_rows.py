"""What the contact rows of one rank say of its nodes."""

import numpy as np
import pytest

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
