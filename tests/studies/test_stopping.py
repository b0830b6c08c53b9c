"""Stopping by the error budget: fewer products, contact tractions unchanged beyond the
discretization error."""

import pytest

from driver.errors import InputError
from driver.files import read_rows
from driver.studies.accuracy import stopping, run_accuracy


@pytest.mark.slow  # runs of one mesh by several tolerances
@pytest.mark.parametrize("row", ["1", "2"])
def test_the_two_smallest_meshes(tmp_path, row):
    paths = run_accuracy({"part": "stopping", "rows": row, "out": str(tmp_path)})
    assert [path.name for path in paths] == ["stopping.csv", "stopping.png", "stopping.pdf"]
    rows = read_rows(paths[0])
    expected = [(row, loading) for loading in stopping.LOADINGS]
    assert [(line["row"], line["loading"]) for line in rows] == expected
    for line in rows:
        number = {name: float(line[name]) for name in stopping.COLUMNS if name != "loading"}
        assert number["change_budget"] <= number["discretization"] < 0.1
        assert number["products_budget"] < number["products_fixed"]
        # the classical rule solves every QP of every iteration to the end: more than half is saved
        assert number["saved_classical"] > 0.5
        # under proportional loading 19 of 20 steps take one product: little is left to save there;
        # else it is some products of the ten or so of a step
        assert line["loading"] == "monotone" or number["saved_fixed"] > 0.1


def test_mistakes(tmp_path):
    for pairs in ({"rows": "9"}, {"cells": "3"}):
        with pytest.raises(InputError):
            run_accuracy({"part": "stopping", **pairs, "out": str(tmp_path)})
