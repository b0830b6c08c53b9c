"""The picture of a parameter study: its axis of values can be read, whatever they are."""

import numpy as np
import pytest

from driver.figures import effects, hard, study
from driver.figures.style import BLUE, INK, RED, STATUS, canvas
from driver.files import write_table


def drawn(values, **columns):
    """The figure of a study with these values of a wear coefficient, and other `columns`."""
    values = np.asarray(values, float)
    table = {"wear": values, "resultant_n": -values, "resultant_t": values, "peak_pressure": values,
             "dissipated": values, **{f"nodes_{zone}": values for zone in STATUS}, **columns}
    summary = {"study": "wear", "scene": "pad", "values": len(values),
               "units": {"length": "mm", "stress": "MPa"}}
    # pylint: disable-next=protected-access
    return canvas(lambda figure: study._fill(figure, summary, table), 12)


@pytest.mark.parametrize("values, scale", [
    ([1e-6, 1e-5, 1e-4], "log"), ([1e-6, 1e-4], "log"), ([1e-5, 2e-5, 5e-5], "linear"),
    (np.linspace(1e6, 3.3e7, 10), "linear"), (np.linspace(0.01, 1, 100), "linear"),
    ([-1.0, 0.0, 50.0], "linear"), ([5.0], "linear")])
def test_numbers_of_the_axis_do_not_stand_on_each_other(values, scale):
    """0.00002 beside 0.00004 did; decades stand in one distance."""
    axes = drawn(values).axes[2]
    assert axes.get_xscale() == scale
    low, high = axes.get_xlim()
    boxes = [label.get_window_extent() for label in axes.get_xticklabels()
             if low <= label.get_position()[0] <= high]
    assert not any(a.overlaps(b) for a, b in zip(boxes, boxes[1:]))


def test_states_that_no_node_has_are_not_drawn():
    """Two lines of zeros hid one another; without contact all of them are there."""
    none = np.zeros(2)
    axes = drawn([1.0, 2.0], nodes_open=none, nodes_stick=none).axes[2]
    assert [line.get_label() for line in axes.lines] == ["slip"]
    assert len(drawn([1.0, 2.0], **{f"nodes_{zone}": none for zone in STATUS}).axes[2].lines) == 3


def test_colours_are_those_of_a_run():
    """Slip is orange there and sticking blue: pressing is red, rubbing blue, work black."""
    forces, peak, _, work = drawn([1.0, 2.0]).axes
    assert [line.get_color() for line in forces.lines] == [RED, BLUE]
    assert [peak.lines[0].get_color(), work.lines[0].get_color()] == [RED, INK]


def test_the_table_of_hard_cases_is_drawn_without_a_layout_engine(tmp_path):
    """Its cells have places of their own; so have no other figures (`make hard` ended there)."""
    numbers = dict.fromkeys(hard.NUMBERS, 1e-9) | {"kkt_tolerance": 1e-8, "ratio_allowed": 2.0}
    rows = [{"family": "contact", "case": case, "status": status, "exit": exit_, "size": "CELLS=4",
             "sweep": "gap" if case == "solved" else "", **numbers, "place": place}
            for case, status, exit_, place in (
                ("solved", "solved", 0, 1.0), ("solved", "solved", 0, 2.0),
                ("not at all", "refused", 3, ""), ("wrong", "FAILED", 1, ""))]
    write_table(tmp_path / "report.csv", rows)
    assert {path.name for path in hard.draw(tmp_path / "report.csv")} == {
        "report.png", "report.pdf", "sweeps.png", "sweeps.pdf"}


def test_changes_of_effects_do_not_run_into_one_another():
    """Beside long names of effects they did: +0.45 %+0.05 %; what is refused has no solution to
    look for.
    """
    full = {"without": "", "status": "0", "dual_multiplications": "155", "seconds_total": "1.9",
            **{f"{name}_change": "" for name in effects.HEADINGS}}
    spent = {f"seconds_{stage}": "0.3" for stage in effects.STAGES}
    small = full | spent | {"without": "obstacle motion"} | {
        f"{name}_change": value for name, value in zip(effects.HEADINGS, 4 * ["0.0045", "-0.0068"])}
    ended = [full | {"without": "wear", "status": status, "reason": "so"} for status in "234"]
    # pylint: disable-next=protected-access
    figure = canvas(lambda page: effects._fill(page, "shoe", [full, small, *ended], {}), 6)
    texts = [text for text in figure.axes[0].texts]
    row = [text.get_window_extent() for text in texts if "%" in text.get_text()]
    assert len(row) == 8 and all(a.x1 < b.x0 for a, b in zip(row, row[1:]))
    assert [text.get_text() for text in texts[8:]] == [
        "refused: so", "no solution: so", "not converged: so"]
