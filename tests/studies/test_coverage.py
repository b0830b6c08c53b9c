"""make accuracy PART=coverage: how claims are judged, and that they hold in 95 of 100 cases."""

import csv
import shutil
import statistics

import pytest

from driver import cli, options
from driver.environment import ROOT
from driver.errors import InputError
from driver.figures import coverage as coverage_figure, prices as prices_figure, redraw
from driver.files import STUDY
from driver.studies import docs
from driver.studies.accuracy import coverage, run_accuracy

REFERENCE = ROOT / "results" / "reference" / "coverage.csv"


def read(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def check(rows):
    """The aims: 95 % hold, none below half of the truth, median overestimate 4."""
    judged = [row for row in rows if row["judged"] == "yes"]
    assert len({(row["scene"], row["setting"]) for row in judged}) >= 60
    assert len({row["scene"] for row in judged}) >= 20
    held = [row["held"] == "yes" for row in judged]
    assert sum(held) >= 0.95 * len(judged)
    ratio = [float(row["ratio"]) for row in judged if row["ratio"]]
    half = [row for row in judged if row["held"] == "no" and float(row["ratio"]) < 0.5]
    assert not half, half
    assert statistics.median(ratio) <= 4.0


def test_the_reference_table_meets_the_aims():
    check(read(REFERENCE))


def test_the_document_counts_every_run_of_the_table():
    """Also that of which no claim can be judged: the table had 81 runs, the document 80."""
    rows = read(REFERENCE)
    runs = {(row["scene"], row["setting"]) for row in rows}
    assert {run for run in runs if not any(
        row["judged"] == "yes" for row in rows if (row["scene"], row["setting"]) == run)}
    assert f"{len(runs)} runs of " in docs.coverage()


def test_the_document_counts_the_prices_of_the_table():
    """It had gone on telling of 70 lines when the table had 73."""
    rows = read(REFERENCE.with_name("prices.csv"))
    said, within = docs.prices(), sum(row["within"] == "yes" for row in rows)
    assert f"{len(rows)} lines of " in said and f"seconds of {within} within" in said
    assert said in (ROOT / "results" / "README.md").read_text()


@pytest.mark.parametrize("name, figure", [("coverage", coverage_figure), ("prices", prices_figure)])
@pytest.mark.some(1)
def test_pictures_of_the_reference_are_those_of_its_tables(tmp_path, name, figure):
    shutil.copy(REFERENCE.with_name(f"{name}.csv"), tmp_path)
    figure.draw(tmp_path / f"{name}.csv")
    drawn = (tmp_path / f"{name}.png").read_bytes()
    assert drawn == REFERENCE.with_name(f"{name}.png").read_bytes()


@pytest.mark.slow  # 81 runs and their references: minutes
def test_claims_hold_in_the_runs_of_the_table(tmp_path):
    run_accuracy({"part": "coverage", "out": str(tmp_path)})
    check(read(tmp_path / "coverage.csv"))
    assert (tmp_path / "coverage.png").stat().st_size > 0


def test_a_claim_is_judged_where_its_reference_is_better():
    entry = {"value": 1.1, "total": 0.05}
    row = coverage._verdict(entry, 1.0, 0.001, zero=False)
    assert row["judged"] == "yes" and row["held"] == "no"
    assert row["ratio"] == pytest.approx(0.5)
    assert coverage._verdict({**entry, "total": 0.12}, 1.0, 0.001, zero=False)["held"] == "yes"
    # the reference may be off by as much as the difference
    assert coverage._verdict(entry, 1.0, 0.06, zero=False)["judged"] == "no"
    assert coverage._verdict({**entry, "total": None}, 1.0, 0.0, zero=False)["judged"] == "no"
    assert coverage._verdict({"value": 1.0, "total": 0.0}, 1.0, 0.0, zero=False)["judged"] == "no"


def test_mistakes():
    with pytest.raises(InputError, match="nowhere"):
        coverage.run_coverage(ROOT, "nowhere")


@pytest.mark.parametrize("name", ["coverage", "prices"])
@pytest.mark.some(1)
def test_pictures_of_claims_and_prices_are_drawn_again(tmp_path, name):
    """`make figures` said that a study of claims had no tables to draw."""
    folder = tmp_path / name
    folder.mkdir()
    (folder / STUDY).touch()
    shutil.copy(REFERENCE.with_stem(name), folder)
    assert list(redraw.finished(tmp_path)) == [folder]
    assert folder / f"{name}.png" in redraw.redraw(folder)


def test_a_study_without_pictures_is_passed_over(tmp_path, monkeypatch, capsys):
    """Such as a benchmark of one part, which had ended `make figures`; asked for alone it says so.
    """
    for name, table in (("bench", "part,name,value,unit,target\n"),
                        ("coverage", REFERENCE.read_text())):
        (tmp_path / name).mkdir()
        (tmp_path / name / STUDY).touch()
        (tmp_path / name / f"{name}.csv").write_text(table)
    monkeypatch.setattr(options, "RESULTS", tmp_path)
    monkeypatch.setitem(redraw.NAMED, "coverage", lambda table: [table.with_suffix(".png")])
    cli.figures([])
    assert "coverage.png" in capsys.readouterr().out
    with pytest.raises(InputError, match="bench holds a study without pictures"):
        cli.figures([str(tmp_path / "bench")])
