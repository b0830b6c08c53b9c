"""The elimination of gluing rows and corners by dense fronts, against the dense dual matrix."""

import numpy as np
import pytest

from driver.errors import NotConverged
from driver.feti import dense_front, elimination_tree, fronts
from driver.feti.fronts import GluingElimination
from driver.feti.rows import RowKind, contact_row_numbers

SCENES = [
    ("model", {"subdomains": "4x2", "cells": 4}),
    ("model", {"subdomains": "1x1", "cells": 4}),  # no gluing rows, no corners
    ("model", {"subdomains": "4x2", "cells": 3, "element": "P2"}),
    ("bracket", {}),  # graph partition; interfaces between materials are corners as a whole
    ("mindlin-bodies", {"subdomains": "6"}),  # mortar rows of two bodies
]


@pytest.mark.parametrize("scene, options", SCENES)
@pytest.mark.some(3)
def test_fronts_leave_the_schur_complement_on_the_contact_rows(built, scene, options):
    problem = built(scene, **options)
    F, contact = problem.F, contact_row_numbers(problem.structure.contact)
    gluing = problem.structure.row_kind == RowKind.GLUING
    elimination = GluingElimination(problem.operator)
    C = elimination.compliance()
    schur = F[contact][:, contact]
    if gluing.any():
        schur = schur - F[contact][:, gluing] @ np.linalg.solve(
            F[gluing][:, gluing], F[gluing][:, contact])
    # rounding, times a condition number of F_gg of less than 1e3 in these bodies
    assert np.abs(C - schur).max() <= 1e-10 * np.abs(schur).max()
    assert np.array_equal(C, C.T) and elimination.compliance() is C
    x, d = np.random.default_rng(4).standard_normal((2, len(F)))
    residual = F @ x - d * np.abs(F).sum(axis=1)
    change = elimination.change(residual)
    assert not change[~gluing].any()
    left = np.abs((residual + F @ change)[gluing]).max(initial=0.0)
    assert left <= 1e-11 * np.abs(residual).max()


@pytest.mark.parametrize("merged", [True, False])
def test_the_order_of_fronts_follows_the_interfaces(built, monkeypatch, merged):
    """No front is larger than what subdomains beside one another have: 2 rows a node of the
    interfaces and of contact, and corners; a bad order would fill them with all there are. Merged
    ones are fewer, and their pivots the same. The price counts these sizes.
    """
    problem, sizes, one = built("model", subdomains="8x4", cells=4), [], fronts.eliminated

    def eliminated(columns, rest, pivots):
        sizes.append((pivots.sum(), len(columns)))
        return one(columns, rest, pivots)

    monkeypatch.setattr(fronts, "eliminated", eliminated)
    if not merged:
        monkeypatch.setattr(elimination_tree, "_pays", lambda child, parent: False)
    elimination = GluingElimination(problem.operator)
    elimination.compliance()
    unknowns = problem.structure.dual_dofs + problem.structure.coarse_dofs
    contact = len(contact_row_numbers(problem.structure.contact))
    assert max(size for _, size in sizes) < (0.7 if merged else 0.4) * unknowns
    made = elimination._tree.fronts
    assert len(made) < 10 if merged else len(made) == len(sizes) > 60
    assert sum(m for m, _ in sizes) == sum(front.pivots for front in made) == unknowns - contact
    if not merged:
        assert [(front.pivots, front.size) for front in made] == sizes
    assert elimination._tree.operations == pytest.approx(
        sum(front.pivots * front.size**2 / 2 for front in made), rel=1e-12)
    # what is kept to solve with has no contact rows
    kept = max(factors.index.max() for factors in elimination._factors.values())
    assert kept < unknowns - contact


def test_price_is_higher_where_many_subdomains_share_a_matrix(built):
    """In products, which take less there; that of dense operations likewise."""
    problem = built("model", subdomains="6x4", cells=4)
    elimination = GluingElimination(problem.operator)
    price, each = elimination.price, elimination.products(1e9)
    shared = [c for c in problem.operator.classes if c.shared]
    for c in shared:
        c.shared = False
    alone = GluingElimination(problem.operator)
    for c in shared:
        c.shared = True
    assert shared and 0 < alone.price < price and alone.products(1e9) < each


def test_what_is_not_definite_is_refused():
    matrix = np.array([[4.0, 0.0], [2.0, 1.0]])  # lower triangle
    for sign, pivots in ((1.0, (1, 0)), (-1.0, (0, 1))):
        columns, rest = sign * matrix[:, :1], sign * matrix[1:, 1:]
        (part,), left = dense_front.eliminated(columns, rest, np.array(pivots))
        assert (part.pivots, part.rest, left) == ([[2.0]], [[sign]], [[0.0]])
    with pytest.raises(NotConverged, match="could not be eliminated"):
        dense_front.eliminated(matrix[:, :1], matrix[1:, 1:], np.array([0, 1]))
