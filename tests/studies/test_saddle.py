"""The saddle-point matrix as a whole against the operator that never forms it."""

import numpy as np
import pytest
from mpi4py import MPI

from driver.scene import freefem
from driver.errors import InputError
from driver.feti.operator import DualOperator
from driver.runs.guard import STUDY
from driver.studies.saddle import LARGEST, read_structure, saddle, write_saddle


@pytest.fixture(scope="module", params=["2x1", "2x2"])
def case(request):
    structure = read_structure(freefem.find_scene(
        "model"), {"cells": "3", "subdomains": request.param}, MPI.COMM_SELF)
    return structure, saddle(structure)


def test_symmetric_to_rounding(case):
    whole = case[1].matrix
    assert abs(whole - whole.T).max() <= 1e-14 * abs(whole).max()


def test_torn_subdomains_meet_only_at_corners(case):
    whole = case[1]
    i, j = whole.matrix[: whole.torn[-1], : whole.torn[-1]].nonzero()
    assert np.array_equal(np.searchsorted(whole.torn, i, side="right"),
                          np.searchsorted(whole.torn, j, side="right"))


def test_schur_complement_is_the_dual_operator(case):
    """B K^-1 B' = F; K has a condition number of about 1e3 here, so 1e-10 leaves rounding much
    room."""
    structure, whole = case
    n, c = whole.matrix.shape[0], whole.corners
    dense = whole.matrix.toarray()
    schur = dense[c:, :c] @ np.linalg.solve(dense[:c, :c], dense[:c, c:])
    operator = DualOperator(structure, MPI.COMM_SELF)
    F = np.column_stack([operator.apply(unit) for unit in np.eye(n - c)])
    F = F[np.ix_(whole.rows, whole.rows)]
    assert np.abs(schur - F).max() <= 1e-10 * np.abs(F).max()


def test_refuses_what_no_picture_can_show(tmp_path):
    with pytest.raises(InputError, match=f"more than the {LARGEST:,}"):
        write_saddle(freefem.find_scene("model"), {"cells": "40"}, tmp_path, MPI.COMM_SELF)
    assert {path.name for path in tmp_path.iterdir()} <= {STUDY}  # the mark of a study's folder
