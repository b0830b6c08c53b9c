"""make accuracy PART=locking: its table and picture."""

import pytest

from driver.errors import InputError
from driver.files import read_rows
from driver.studies.accuracy import locking, run_accuracy


@pytest.mark.slow
def test_table_and_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(locking, "POISSON", (0.3,))
    monkeypatch.setattr(locking, "CELLS", (1, 2))
    paths = run_accuracy({"part": "locking", "out": str(tmp_path)})
    assert [path.name for path in paths] == ["locking.csv", "locking.png", "locking.pdf"]
    rows = read_rows(paths[0])
    assert [(row["element"], row["h"]) for row in rows] == [(element, h) for element in ("P1", "P2",
                                                                                         "P2-mixed")
                                                            for h in ("0.5", "0.25")]
    assert all(0 < float(row[name]) < 1 for row in rows for name in (
        "displacement", "strain", "pressure"))
    with pytest.raises(InputError):
        run_accuracy({"part": "locking", "cells": "3", "out": str(tmp_path)})
