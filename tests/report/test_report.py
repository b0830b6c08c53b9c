"""The page of a run or study: whole, by itself, and saying what its files say."""

import json
import re
import shutil
from html.parser import HTMLParser

import pytest

from driver import cli, options
from driver.errors import InputError
from driver.estimates import budget_words
from driver.figures import redraw
from driver.files import STUDY, write_table
from driver.report import page
from driver.report import run as single
from driver.report import study
from driver.results.screen import UNCHECKED

EMPTY = {"img", "meta", "br"}  # elements without an end
PNG = bytes.fromhex("89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c489"
                    "0000000d49444154789c6360606060000000050001a5f645400000000049454e44ae426082")


class Page(HTMLParser):
    """Text, tables and pictures of a page whose elements are closed in their order."""

    def __init__(self, path):
        super().__init__()
        self.open, self.links, self.text, self.rows = [], [], [], []
        self.feed(path.read_text())
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.links += [value for name, value in attrs if name in ("src", "href", "data")]
        if tag not in EMPTY:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data

    @property
    def words(self) -> str:
        return " ".join(" ".join(self.text).split())


@pytest.fixture
def place(tmp_path):
    """A directory that a study has marked as its own."""
    (tmp_path / STUDY).write_text("hard\n")
    return tmp_path


@pytest.fixture(scope="module")
def finished(solved):
    """A run that every page is made of: two boundaries, a warning-free end, errors."""
    return solved("bracket", steps=2, h=10, errors="energy")


def test_every_run_leaves_a_page_by_itself(finished):
    path = finished.directory / "report.html"
    text, page = path.read_text(), Page(path)
    assert 'name="viewport"' in text and '<meta charset="utf-8">' in text
    assert not re.search(r"https?://|<script|@import|url\(", text)
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert "Converged in 2 steps" in page.words
    values = {row[0]: row[1:3] for row in page.rows if len(row) > 2}
    for name, value in finished.summary["quantities"].items():
        assert values[budget_words.titled(name, 2)][0] == f"{value:.4g}"
    assert "passes through both of them counts at each" in page.words
    assert values["normal resultant, sum of 2"][1] == "N/mm"
    assert values["dissipated energy"][1] == "J/m"
    assert "energy norm" in page.words


def test_boundaries_and_figures_are_on_the_page(finished, tmp_path):
    copy = shutil.copytree(finished.directory, tmp_path / "run")
    (copy / "figures").mkdir(exist_ok=True)
    for name in ("history", "geometry", "unheard_of"):
        (copy / "figures" / f"{name}.png").write_bytes(PNG)
    page = Page(single.write(copy))
    assert len(page.links) == 3
    text = (copy / "report.html").read_text()
    assert text.index("Geometry, boundary") < text.index("Contact forces over time") < text.index(
        "unheard of")
    head = next(row for row in page.rows if row[0] == "boundary")
    assert "force x [N/mm]" in head
    labels = [row[0] for row in page.rows[page.rows.index(head) + 1:][:2]]
    assert labels == [str(row["boundary"]) for row in finished.summary["boundaries"]]


@pytest.mark.parametrize("change, words, colour", [
    ({"converged": False, "reason": "too <few> iterations"}, "Not converged: too <few> iterations",
     "bad"),
    ({"warnings": ["elements lock & more"]}, "1 warning, see below", "doubtful"),
    ({"validity": {"verdict": "ok"}, "warnings": []}, "contact: ok", "good"),
    ({"validity": {"verdict": "invalid", "reason": "rotation 0.8"}}, "invalid, rotation 0.8",
     "bad")])
def test_the_verdict_comes_first_and_in_its_colour(finished, tmp_path, change, words, colour):
    copy = shutil.copytree(finished.directory, tmp_path / "run")
    (copy / "summary.json").write_text(json.dumps(finished.summary | {"warnings": []} | change))
    page = Page(single.write(copy))
    assert words in page.words and page.words.index(words) < page.words.index("Quantities")
    assert single.page.COLOURS[colour] in (copy / "report.html").read_text().split("Quantities")[0]


def test_a_study_is_judged_by_its_table(place):
    write_table(place / "report.csv", [
        {"case": "<a>", "status": "solved", "seconds": "1.5"},
        {"case": "b", "status": "refused", "seconds": ""},
        {"case": "c", "status": "FAILED", "seconds": "2"}])
    write_table(place / "contact.csv", [{"status": "open", "x": "1"}])
    (place / "report.png").write_bytes(PNG)
    page = Page(study.write(place))
    assert "report: of 3 rows 1 solved, 1 refused as it should be, 1 not." in page.words
    assert "contact:" not in page.words and len(page.links) == 1
    assert ["<a>", "solved", "1.5"] in page.rows


def test_the_slides_table_is_read_beside_ours(place):
    write_table(place / "table.csv", [
        {"n_s": "8", "it_monotone": "25", "slides_n_s": "8", "slides_it_monotone": "135",
         "seconds": "0.6", "method": "plain"}])
    text = study.write(place).read_text()
    first = text[text.index("fixed-point iterations"): text.index("<details")]
    assert "25 / 135" in first and "plain" in first and "slides_" not in first
    assert ">8<" in first and "8 / 8" not in first and "slides_n_s" in text


def test_a_study_is_named_by_its_table_and_shows_a_short_one(place):
    """A folder of the user's own name stands in the title; pictures of a kind share a caption."""
    folder = place.rename(place.parent / "hard")
    write_table(folder / "report.csv", [{"family": "contact", "status": "solved"}])
    write_table(folder / "more.csv", [{"x": str(k)} for k in range(3)])
    (folder / "work_precision_slip.png").write_bytes(
        PNG[:16] + (1200).to_bytes(4, "big") + (900).to_bytes(4, "big") + PNG[24:])
    text = study.write(folder).read_text()
    assert "<h1>Hard cases</h1>" in text and "front below: slip" in text and 'class="wide"' in text
    assert "<summary>more.csv" in text and "<p>report.csv, 1 row</p>" in text
    mine = folder.rename(place.parent / "mine")
    assert "<h1>Hard cases: mine</h1>" in study.write(mine).read_text()


def test_effects_that_are_needed_are_no_failure(place):
    """Left out, a support or friction may leave no solution: that is what the study shows."""
    write_table(place / "slope.csv", [{"without": "", "status": "0"},
                                     {"without": "friction", "status": "3"}])
    page = Page(study.write(place))
    assert "slope: of 2 rows 1 converged, 1 without a solution." in page.words
    assert single.page.COLOURS["good"] in (place / "report.html").read_text()


def test_nothing_to_report_on_is_refused(tmp_path, command_here):
    with pytest.raises(InputError, match="no finished run"):
        study.write(tmp_path)
    done = command_here("report", str(tmp_path))
    assert done.returncode == 2 and "no finished run" in done.stderr
    done = command_here("report", "SCENE=model")
    assert done.returncode == 2 and "make report has no option SCENE; it has OUT" in done.stderr


@pytest.mark.parametrize("name", ["mine.csv", "report.png", "summary.json"])
def test_files_of_somebody_are_no_study(tmp_path, command_here, name):
    """A table that begins like one of a study, a picture or a summary of another program."""
    write_table(tmp_path / "mine.csv", [{"kind": "a", "status": "solved"}])
    path = tmp_path / name
    if name.endswith("png"):
        path.write_bytes(PNG)
    elif name.endswith("json"):
        path.write_text('{"scene": "mine"}')
    (tmp_path / "report.html").write_text("mine")
    before = sorted(tmp_path.iterdir())
    for command in ("report", "figures"):
        done = command_here(command, f"OUT={tmp_path}")
        assert done.returncode == 2 and "holds no finished run and no study" in done.stderr
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "report.html").read_text() == "mine"


def test_a_page_of_somebody_is_left_in_a_study_and_a_run(finished, place):
    """A page of ours is renewed, any other file of its name stays."""
    write_table(place / "report.csv", [{"family": "contact", "status": "solved"}])
    first = study.write(place).read_text()
    assert study.write(place).read_text() == first
    copy = shutil.copytree(finished.directory, place / "run")
    for folder in (place, copy):
        (folder / "report.html").write_text("<!doctype html><title>mine</title>")
        with pytest.raises(InputError, match="is no page of make report and stays as it is"):
            study.write(folder)
        assert "mine" in (folder / "report.html").read_text()


def test_all_that_is_finished_is_found_however_deep(tmp_path, command_here, monkeypatch):
    """With spaces in names; not what lies in a run or ships, nor the place of a run at work."""
    monkeypatch.setattr(options, "RESULTS", tmp_path)
    assert command_here("report").returncode == 2
    run, table = tmp_path / "my runs" / "one", tmp_path / "accuracy" / "block"
    for folder in (run / "inner", tmp_path / ".two.77", tmp_path / "reference", table):
        folder.mkdir(parents=True)
    (table / STUDY).write_text("hard\n")
    for folder in (run, run / "inner", tmp_path / ".two.77", tmp_path / "reference"):
        (folder / "summary.json").write_text("{}")
    write_table(table / "mine.csv", [{"family": "contact", "status": "solved"}])
    assert list(redraw.finished(tmp_path)) == [table, run]
    (run / "summary.json").unlink()
    (run / "inner" / "summary.json").unlink()
    done = command_here("report")
    assert done.returncode == 0 and (table / "report.html").exists(), done.stderr


def test_the_command_renews_pages(finished, tmp_path, capsys):
    copy = shutil.copytree(finished.directory, tmp_path / "run")
    (copy / "report.html").write_text(page.page("old", []))
    cli.report([str(copy)])
    assert capsys.readouterr().out.strip().endswith("report.html")
    assert "Converged" in Page(copy / "report.html").words


def test_what_a_benchmark_missed_stands_below_its_verdict(place):
    names = ("part", "name", "value", "unit", "target", "met")
    rows = [("products", "one", 52, "", "<= 651", "yes"), ("studies", "two", 5.2, "", "<= 5", "no")]
    write_table(place / "report.csv", [dict(zip(names, row)) for row in rows])
    write_table(place / "accuracy.csv", [{"sweep": "mesh", "value": 0.5}])
    (place / "products.png").write_bytes(PNG)
    found = Page(study.write(place))
    assert "What accuracy costs: " in found.words and "of 2 rows 1 met, 1 not" in found.words
    assert found.rows[:2] == [["part", "name", "value", "target", "met"],
                              ["studies", "two", "5.2", "<= 5", "no"]]
    assert "Products with F beside a tenth" in found.words


def test_the_page_of_a_parameter_study(tmp_path, command_here):
    done = command_here("study", "SCENE=model", "FRICTION=0.1,0.3", "CELLS=2", "STEPS=2",
                        "FIGURES=no", "QUIET=yes", f"OUT={tmp_path / 'out'}")
    assert done.returncode == 0, done.stderr
    page = Page(tmp_path / "out" / "report.html")
    assert "study of friction" in page.words and "study: all 2 converged." in page.words
    assert "Lengths in m, stresses in Pa, forces in N/m, energies in J/m." in page.words
    # "converged" is all that a study knows of its values
    assert UNCHECKED in done.stdout and UNCHECKED[1:] in page.words


def test_wide_pictures_are_scrolled_where_the_screen_is_narrow(tmp_path):
    """Numbers of the width and height of a PNG stand in its first bytes."""
    for width, height, wide in ((5000, 1000, True), (2000, 1000, False), (800, 200, False)):
        path = tmp_path / "picture.png"
        path.write_bytes(PNG[:16] + width.to_bytes(4, "big") + height.to_bytes(4, "big") + PNG[24:])
        assert ('class="wide"' in page.picture(path, "")) == wide


@pytest.mark.parametrize("units, said", [
    (("mm", "psi"), "Lengths in mm, stresses in psi, forces in psi·mm, energies in psi·mm²."),
    (("1", "MPa"), "Lengths in 1, stresses in MPa, forces in MPa, energies in MPa."),
    (("1", "1"), ""), (("", "-"), "")])
def test_a_study_says_its_units_if_it_has_some(place, units, said):
    """A scene without units has numbers: "lengths in 1" had said nothing."""
    summary = place / "summary.json"
    summary.write_text(json.dumps({"units": dict(zip(("length", "stress"), units))}))
    found = study._units(summary)  # pylint: disable=protected-access
    assert said in found and bool(found) == bool(said)
