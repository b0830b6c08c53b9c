"""make accuracy PART=curved: its table and picture."""

import pytest

from driver.errors import InputError
from driver.files import read_rows
from driver.figures.redraw import redraw
from driver.studies.accuracy import curved, run_accuracy


@pytest.mark.slow
def test_table_and_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(curved, "SIDES", {"P2": ("P2", {})})
    monkeypatch.setattr(curved, "SIZES", (0.16, 0.08))
    paths = run_accuracy({"part": "curved", "out": str(tmp_path)})
    assert [path.name for path in paths] == ["curved.csv", "curved.png", "curved.pdf"]
    coarse, fine = read_rows(paths[0])
    assert [row["h"] for row in (coarse, fine)] == ["0.16", "0.08"]
    for name, order in (("pressure", 1.5), ("displacement", 2.5)):  # 2 and 3 on finer meshes
        assert float(coarse[name]) > 2**order * float(fine[name])
    assert float(fine["displacement"]) < 1e-4
    assert {path.name for path in redraw(tmp_path)} == {"curved.png", "curved.pdf"}
    with pytest.raises(InputError):
        run_accuracy({"part": "curved", "cells": "3", "out": str(tmp_path)})
