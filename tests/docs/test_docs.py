"""Documents: generated parts are those of the code, and what they name exists."""

import csv
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mutants
import test_house
from driver import environment, options
from driver.bench import workbench
from driver.hard import report
from driver.scene import freefem, rooms
from driver.studies import docs, effects

ROOT = environment.ROOT
MOST = 10 * 1024  # bytes of README.md
PICTURE, PICTURES = 60_000, 1_500_000  # bytes of a picture of the gallery, of all
NO_OPTIONS = {"HISTORY", "CONTACT", "SETTINGS", "BLOCKS", "FAILED", "HEAD", "COMMIT"}
FENCED = re.compile(r"^```\w*\n(.*?)^```", re.MULTILINE | re.DOTALL)

documents = pytest.mark.parametrize("path", docs.DOCUMENTS, ids=lambda path: str(
    path.relative_to(ROOT)))


# ---- what is generated ---------------------------------------------------------------------------

@documents
def test_documents_are_up_to_date(path):
    assert path.read_text() == docs.renewed(path), "run make docs"


def test_stale_documents_are_noticed(tmp_path):
    for path in docs.DOCUMENTS:
        text = path.read_text()
        empty = docs.MARKED.sub(lambda match: f"{match[1]}{match[4]}", text)
        assert path.name and (empty != text) == ("<!-- generated" in text)
        (tmp_path / path.name).write_text(empty)
        assert docs.renewed(tmp_path / path.name) == text
        assert text.count("<!-- generated") == len(docs.MARKED.findall(text))


def test_a_block_that_does_not_exist(tmp_path):
    (tmp_path / "a.md").write_text("<!-- generated: nothing -->\n<!-- end -->\n")
    with pytest.raises(KeyError, match="nothing"):
        docs.renewed(tmp_path / "a.md")


def test_markup_in_cells():
    table = docs.markdown(("a", "b"), [("`x_|`", "u_n |u| <F> `a_b`")])
    assert table.splitlines()[-1] == r"| `x_\|` | u\_n \|u\| &lt;F> `a_b` |"


def test_every_effect_scene_and_package_is_in_the_documents():
    text = (ROOT / "edp" / "README.md").read_text()
    assert all(f"#### {room.name.replace('_', ' ')}\n" in text for room in rooms.rooms())
    assert all(f"]({name}.edp)" in text for name in freefem.scenes())
    assert docs.PACKAGES == test_house.ORDER
    driver = (ROOT / "driver" / "README.md").read_text()
    assert all(f"| `{package}` |" in driver for package in docs.PACKAGES)


def test_the_gallery_has_small_pictures_of_the_scenes_that_ship():
    pictures = {path.stem: path.stat().st_size for path in docs.GALLERY.glob("*")}
    assert set(pictures) == set(freefem.scenes()), "run make docs GALLERY=missing"
    assert max(pictures.values()) <= PICTURE and sum(pictures.values()) <= PICTURES


def test_pictures_are_drawn_from_a_run(tmp_path, monkeypatch):
    picture = tmp_path / "gallery" / "patch.png"
    monkeypatch.setattr(docs, "GALLERY", picture.parent)
    monkeypatch.setattr(docs, "DOCUMENTS", ())
    monkeypatch.setattr(docs, "PICTURES", {})
    monkeypatch.setattr(freefem, "scenes", lambda: {"patch": ""})
    assert docs.renew("no") == [] and not picture.exists()
    assert docs.renew("missing") == [picture] and docs.renew("missing") == []
    assert picture.read_bytes() == (ROOT / "results/reference/gallery/patch.png").read_bytes()


# ---- what documents name -------------------------------------------------------------------------

def code(text: str) -> list[str]:
    """Code of a document: lines of blocks, and what stands between backquotes."""
    blocks = "".join(FENCED.findall(text)) + "".join(re.findall(r"^    .*\n", text, re.MULTILINE))
    spans = re.findall(r"`([^`\n]+)`", FENCED.sub("", text))
    return [line.split("  #")[0].strip() for line in blocks.splitlines()] + spans


def anchors(text: str) -> set[str]:
    """Anchors of the headings, as the Markdown of code hosting makes them."""
    titles = re.findall(r"^#+ (.*)$", FENCED.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


def missing_links(path: Path, text: str) -> list[str]:
    """Links and pictures of a document that lead nowhere."""
    links = re.findall(r"\]\(([^)\s]+)\)|src=\"([^\"]+)\"", text)
    wrong = []
    for link in (one or two for one, two in links):
        name, _, anchor = link.partition("#")
        target = path.parent / name if name else path
        if not target.exists() or anchor and anchor not in anchors(
                text if target == path else target.read_text()):
            wrong.append(link)
    return wrong


def missing_files(text: str) -> list[str]:
    """Files of the project that a document names and that do not exist."""
    names = re.findall(r"(?:driver|edp|tests|meshes|results/reference)/[\w./-]*\w", " ".join(
        code(text)))
    return [name for name in names if not (ROOT / name).exists()]


def unknown_targets(text: str) -> list[str]:
    """Targets of make that a document names and that do not exist."""
    makefile = (ROOT / "Makefile").read_text()
    targets = {*options.COMMANDS, *freefem.scenes(), *re.findall(r"^(\w[\w-]*):", makefile, re.M)}
    return [name for line in code(text) for name in re.findall(r"\bmake ([a-z][\w-]*)", line)
            if name not in targets]


def unknown_options(text: str) -> list[str]:
    """Options that no command takes and no scene reads, or not the one that they stand behind."""
    def parameters(*paths: Path) -> set[str]:
        return {name for path in paths for name in re.findall(
            r'\b(?:physical|whole|choice)\("(\w+)"', path.read_text())}

    wrong, library = [], parameters(*environment.LIBRARY.glob("*.idp"))
    general = library | parameters(*freefem.SCENES.rglob("*.edp"))
    names = {option.name for option in options.TABLE} | general | {"args", "omp_num_threads"}
    for line in code(text):
        single = re.fullmatch(r"([A-Z][A-Z_]+|H)(?:=\S*)?", line)
        named = re.findall(r"\b([A-Z][A-Z_]+|H)=(\S*)", line)
        command = re.search(r"\bmake ([a-z][\w-]*)", line)
        command = command[1] if command else ""
        if single and single[1] not in NO_OPTIONS and single[1].lower() not in names:
            wrong.append(line)
        if command == "mutants":
            wrong += [line for name, _ in named if name not in mutants.OPTIONS]
            continue
        if not command or command in ("test", "test-long"):
            wrong += [line for name, _ in named if name.lower() not in names]
            continue
        known, read = options.options_of("run"), general
        if command in options.COMMANDS:
            known = options.options_of(command)
            read = general if options.COMMANDS[command].parameters else set()
        elif command in freefem.scenes():
            read = library | parameters(freefem.find_scene(command))
        for name, value in named:
            if name.lower() in known:
                if value and "<" not in value and "path/to" not in value:
                    known[name.lower()].read(value.strip(",;"))
            elif name.lower() not in read:
                wrong.append(line)
    return wrong


@documents
def test_links_lead_somewhere(path):
    assert missing_links(path, path.read_text()) == []


@documents
def test_files_targets_and_options_exist(path):
    text = path.read_text()
    assert missing_files(text) == [] and unknown_targets(text) == [] and unknown_options(text) == []


@pytest.mark.parametrize("rule, text", [
    (lambda text: missing_links(docs.DOCUMENTS[0], text), "[a](edp/nothing.md)"),
    (lambda text: missing_links(docs.DOCUMENTS[0], text), "[a](edp/README.md#nothing)"),
    (lambda text: missing_links(docs.DOCUMENTS[0], text), "# A heading\n[a](#another)"),
    (lambda text: missing_links(docs.DOCUMENTS[0], text), '<img src="nothing.png">'),
    (missing_files, "`driver/nothing.py`"), (missing_files, "    python3 tests/nothing.py\n"),
    (unknown_targets, "    make nothing\n"), (unknown_targets, "`make nothing`"),
    (unknown_options, "`NOTHING`"), (unknown_options, "`NOTHING=2`"),
    (unknown_options, "    make table NP=2 SCENE=model\n"),
    (unknown_options, "    make hertz FRICTION=0.3\n")])
def test_names_of_nothing_are_noticed(rule, text):
    assert rule(text)


def test_links_to_headings_are_understood():
    text = "# What it is\n[a](#what-it-is) [b](edp/README.md#error-estimates)"
    assert not missing_links(docs.DOCUMENTS[0], text)


def test_messages_are_those_of_the_code():
    """What stands between the dots of a message is in the text of the driver or the library."""
    sources = [path.read_text() for folder, kind in (("driver", "*.py"), ("edp/lib", "*.idp"))
               for path in sorted((ROOT / folder).rglob(kind))]
    source = re.sub(r'"\s*\n\s*f?"', "", "".join(sources))  # of strings on several lines
    text = (ROOT / "results" / "README.md").read_text().split("## Messages")[1].split("\n## ")[0]
    messages = re.findall(r"^\| `(.*?)` \|", text, re.MULTILINE)
    assert len(messages) > 10
    parts = [part.strip(" :") for message in messages for part in message.split("...")]
    assert [part for part in parts if part not in source] == []


def test_columns_of_studies_are_described():
    text = (ROOT / "results" / "README.md").read_text()
    names = [name for row in (report.Row, workbench.Row) for name in row.__annotations__]
    names += [name for name in effects.COLUMNS if not re.search("seconds_|_change", name)]
    names = set(names) - set(report.RESIDUALS)
    assert [name for name in sorted(names) if f"`{name}`" not in text] == []


def test_reference_files_name_commands_that_exist():
    for table in json.loads((docs.REFERENCE / "measured.json").read_text()).values():
        assert all(len(row) == len(table["columns"]) for row in table["rows"])
        text = "".join(f"    {command}\n" for command in table["commands"])
        assert table["commands"] and not unknown_targets(text) and not unknown_options(text)
    with open(docs.REFERENCE / "table.csv", newline="") as file:
        assert [row["n_s"] for row in csv.DictReader(file)] == ["8", "32", "128", "512", "2048"]


# ---- README.md -----------------------------------------------------------------------------------

def test_readme_is_short():
    assert len((ROOT / "README.md").read_bytes()) <= MOST


@pytest.mark.slow
def test_scene_and_snippet_of_the_readme(tmp_path):
    """As a reader would: save the scene, run it as told there, read its results from Python."""
    text = (ROOT / "README.md").read_text()
    scene, snippet = (re.search(rf"```{language}\n(.*?)```", text, re.DOTALL)[1]
                      for language in ("freefem", "python"))
    words = re.search(r"`make run SCENE=block.edp (.*?)`", text)[1].split()
    (tmp_path / "block.edp").write_text(scene)
    env = {"PYTHONPATH": str(ROOT), "PATH": environment.os.environ["PATH"]}
    for command in (["-m", "driver", "run", "SCENE=block.edp", *words, "FIGURES=no", "ERRORS=no"],
                    ["-c", snippet]):
        done = subprocess.run([sys.executable, *command], cwd=tmp_path, env=env,
                              capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert "normal_resultant" in done.stdout and " nodes slip" in done.stdout
    slipping = int(done.stdout.split()[-3])
    assert slipping > 0 and snippet.count("\n") <= 5


# ---- recipes of driver/README.md -----------------------------------------------------------------

@pytest.fixture
def extended(tmp_path, monkeypatch):
    """The library and the effects with those that driver/README.md shows how to add."""
    import driver.effects
    from driver.scene import manifest

    text = (ROOT / "driver" / "README.md").read_text()
    library = shutil.copytree(environment.LIBRARY, tmp_path / "lib")
    modules = tmp_path / "modules"
    modules.mkdir()
    for block in FENCED.findall(text):
        if found := re.match(r"// (\w+\.idp) - ", block):
            (library / "effects" / found[1]).write_text(block)
        elif found := re.match(r'""".*"""  # (\w+\.py)\n', block):
            (modules / found[1]).write_text(block)
    assert {path.stem for path in modules.glob("*.py")} == {"coating", "snow"}
    monkeypatch.setattr(environment, "LIBRARY", library)
    for owner in (rooms, manifest):
        monkeypatch.setattr(owner, "EFFECTS", library / "effects")
    monkeypatch.setattr(driver.effects, "__path__", [*driver.effects.__path__, str(modules)])
    caches = (rooms.rooms, rooms.vocabulary, rooms.studied)
    for cached in caches:
        cached.cache_clear()
    yield
    for name in ("coating", "snow"):
        sys.modules.pop(f"driver.effects.{name}", None)
    for cached in caches:
        cached.cache_clear()


def test_effect_and_load_are_added_as_described(extended, tmp_path, variant):
    from conftest import read_problem

    scene = variant("snowed", ("macro amplitude1(t)", "macro gap() 0.5 //\n"
                               "macro coating() 0.2*x //\nmacro snowOn() 3 //\n"
                               "macro snow2() 7. //\nmacro amplitude1(t)"))
    freefem.export(scene, tmp_path / "export", {"cells": "2"})
    problem = read_problem(tmp_path / "export", reduce=False)
    boundary = problem.structure.contact
    assert boundary.gap == pytest.approx(0.5 - 0.2 * boundary.xy[:, 0], abs=1e-12)
    snow = [pattern["kind"] for pattern in problem.manifest.patterns].index("snow")
    forces = sum(sub.loads[snow].reshape(-1, 2).sum(axis=0) for sub in problem.subdomains)
    assert forces == pytest.approx([0, -14], abs=1e-12)  # 7 on a length of 2
    assert "#### snow" in docs.effects() and "| coating | bound |" in docs.estimates()
