"""Stopping by the error budget: fewer products, contact tractions unchanged beyond the discretization error."""

import csv

import pytest

from driver.studies import stopping
from driver.errors import InputError


@pytest.mark.parametrize("row", ["1", pytest.param("2", marks=pytest.mark.slow)])
def test_the_two_smallest_meshes(tmp_path, row):
    paths = stopping.run_stopping({"rows": row, "out": str(tmp_path)})
    assert [path.name for path in paths] == ["stopping.csv", "stopping.png", "stopping.pdf"]
    rows = list(csv.DictReader(open(paths[0])))
    assert [(found["row"], found["loading"]) for found in rows] == [(row, loading) for loading in stopping.LOADINGS]
    for found in rows:
        number = {name: float(found[name]) for name in stopping.COLUMNS if name != "loading"}
        assert number["change_budget"] <= number["discretization"] < 0.1
        assert number["products_budget"] < number["products_fixed"]
        # the classical rule solves every QP of every iteration to the end: more than half is saved
        assert number["saved_classical"] > 0.5
        # under proportional loading 19 of 20 steps take one product: little is left to save there; else it is some
        # products of the ten or so of a step
        assert found["loading"] == "monotone" or number["saved_fixed"] > 0.1


def test_mistakes():
    for pairs in ({"rows": "9"}, {"cells": "3"}):
        with pytest.raises(InputError):
            stopping.run_stopping(pairs)
