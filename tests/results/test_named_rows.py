"""Names that gmsh files give to labels, beside the labels wherever these are shown."""

from types import SimpleNamespace

import numpy as np

from driver.figures import geometry, history
from driver.figures.reading import Run
from driver.report import run as page_of_run
from driver.results import screen, summary
from driver.results.tables import BOUNDARIES

UNITS = {"length": "mm", "stress": "MPa"}
NAMES = SimpleNamespace(label_names={7: "foot", 12: "a $ b"})


def rows(*labels, step=2) -> list[dict]:
    return [{column.name: 1.0 for column in BOUNDARIES} | {"step": step, "boundary": label}
            for label in labels]


def test_rows_of_the_last_step_have_the_names_of_their_labels():
    found = summary._of_last(rows(7, step=1) + rows(7, 1), 2, "boundary", NAMES)
    assert [(row["boundary"], row.get("name")) for row in found] == [(7, "foot"), (1, None)]
    probes = [{"step": 2, "probe": name} for name in ("label12", "point7", "label1")]
    found = summary._of_last(probes, 2, "probe", NAMES)
    assert [row.get("name") for row in found] == ["a $ b", None, None]


def test_names_stand_beside_their_labels():
    """On the screen, on the page and over the panels of figures, where $ begins no formula."""
    found = summary._of_last(rows(7, 12, 1), 2, "boundary", NAMES)
    lines = [line.split("  ")[0] for line in screen.boundaries(found, UNITS)]
    assert lines == ["boundary", "7 'foot'", "12 'a $ b'", "1"]
    table = page_of_run._rows({"boundaries": found, "units": UNITS}, "boundaries", "boundary",
                              BOUNDARIES)
    assert "7 &#x27;foot&#x27;" in table and "12 &#x27;a $ b&#x27;" in table
    run = Run({"label_names": {"7": "foot", "12": "a $ b"}}, *[None] * 6)
    assert [run.label_name(k) for k in (7, 12, 1)] == ["7 'foot'", r"12 'a \$ b'", "1"]


def test_names_explain_the_numbers_in_figures():
    """In the picture of the scene in the colour of the number, in that of loops beside it."""
    run = Run({"label_names": {"7": "foot", "12": "a $ b"}}, *[None] * 6)
    roles = np.array(["free", "contact", "free", "support"])
    found = geometry._label_names(run, np.array([7, 7, 1, 12]), roles)
    assert [(one.get_marker(), one.get_label()) for one in found] == [
        ("$7$", "foot"), ("$12$", r"a \$ b")]
    assert [one.get_color() for one in found] == [geometry.LINES[k] for k in ("contact", "support")]
    assert [history._probe_name(run, name) for name in ("label7", "label1", "point2")] == [
        "label 7 'foot'", "label 1", "point 2"]


def test_scenes_without_names_and_with_many_have_none_in_the_legend():
    none, many = Run({}, *[None] * 6), {str(k): f"side {k}" for k in range(20)}
    labels, roles = np.arange(20), np.array(["free"] * 20)
    assert geometry._label_names(none, labels, roles) == []
    assert geometry._label_names(Run({"label_names": many}, *[None] * 6), labels, roles) == []
