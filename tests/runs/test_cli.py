"""The command line as a user meets it: exit statuses, one-line reasons, what a run leaves."""

import csv
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import meshio
import numpy as np
import pytest

from driver import children, environment
from driver.march import checkpoint

FAST = ("CELLS=2", "SUBDOMAINS=2x1", "STEPS=2", "FIGURES=no", "FIELDS=no", "ERRORS=no")


def one_line(done, *words):
    """Exit status 2 and one line on stderr that starts with 'error:' and holds `words`."""
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr + done.stdout
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert done.stderr.startswith("error: "), done.stderr
    for word in words:
        assert word in done.stderr, done.stderr


def listing(folder):
    """Everything in a folder, hidden names included, with a digest of every file."""
    return {str(path.relative_to(folder)):
            hashlib.sha1(path.read_bytes()).hexdigest() if path.is_file() else None
            for path in sorted(folder.rglob("*"))}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """scene(text): path of a scene with that text after the model example."""
    folder = tmp_path_factory.mktemp("broken")
    count = iter(range(1000))

    def make(text: str, name=None):
        path = folder / f"{name or f'broken{next(count)}'}.edp"
        path.write_text(text)
        return path

    return make


# --------------------------------------------------------------------------------- mistakes

@pytest.mark.parametrize("words, expected", [
    (("SCENE=modle",), ["modle", "model"]),
    (("SCENE=/no/such/file.edp",), ["/no/such/file.edp"]),
    (("SCENE=model", "FRICTOIN=0.4"), ["FRICTOIN", "did you mean FRICTION"]),
    (("SCENE=model", "FRICTION=o.3"), ["FRICTION", "o.3"]),
    (("SCENE=model", "FRICTION=1-2"), ["FRICTION", "1-2"]),
    (("SCENE=model", "FRICTION=0.3.1"), ["FRICTION", "0.3.1"]),
    (("SCENE=model", "FRICTION=3e"), ["FRICTION", "3e"]),
    (("SCENE=model", "FRICTION=-0.3"), ["friction"]),
    (("SCENE=model", "FRICTION=1e999"), ["FRICTION"]),
    (("SCENE=model", "LOADING=monoton"), ["monotone|nonmonotone", "monoton"]),
    (("SCENE=model", "SUBDOMAINS=4y2"), ["SUBDOMAINS", "4y2"]),
    (("SCENE=model", "SUBDOMAINS=0"), ["SUBDOMAINS"]),
    (("SCENE=model", "SUBDOMAINS=4x"), ["SUBDOMAINS"]),
    (("SCENE=model", "SUBDOMAINS=0x2"), ["SUBDOMAINS"]),
    (("SCENE=model", "SUBDOMAINS=-4x-2"), ["SUBDOMAINS"]),
    (("SCENE=model", "SUBDOMAINS=4x2x2"), ["SUBDOMAINS"]),
    (("SCENE=model", "CELLS=0"), ["CELLS"]),
    (("SCENE=model", "CELLS=2.5"), ["CELLS", "2.5"]),
    (("SCENE=model", "STEPS=-1"), ["STEPS"]),
    (("SCENE=model", "STEPS=many"), ["STEPS", "many"]),
    (("SCENE=model", "NP=two"), ["NP", "two"]),
    (("SCENE=model", "NP=0"), ["NP"]),
    (("SCENE=model", "RTOL=abc"), ["RTOL", "abc"]),
    (("SCENE=model", "RTOL=-1"), ["RTOL"]),
    (("SCENE=model", "RTOL=nan"), ["RTOL"]),
    (("SCENE=model", "MAX_FIXED_POINT=1.5"), ["MAX_FIXED_POINT"]),
    (("SCENE=model", "PRECONDITIONER=ilu"), ["PRECONDITIONER", "dirichlet"]),
    (("SCENE=model", "PREDICTOR=best"), ["PREDICTOR", "previous"]),
    (("SCENE=model", "FIELDS=maybe"), ["FIELDS", "yes or no"]),
    # what would change nothing
    (("SCENE=model", "QUANTITY=slip", "ERRORS=no"), ["QUANTITY", "ERRORS=no", "leave one"]),
    (("SCENE=model", "QUANTITY=slip", "ERRORS=energy"), ["QUANTITY", "ERRORS=energy"]),
    (("SCENE=model", "ESTIMATOR=none", "ERRORS=no"), ["ESTIMATOR", "ERRORS=no"]),
    (("SCENE=model", "RTOL"), ["NAME=VALUE"]),
    (("SCENE=model", "=3"), ["NAME=VALUE"]),
    (("SCENE=model", "RTOL="), ["RTOL= has no value"]),
], ids=lambda v: "_".join(v) if isinstance(v, tuple) else "")
@pytest.mark.some(2)
def test_mistyped_words(command_here, tmp_path, words, expected):
    """Names and values: said in one line, with what was expected; nothing is left on disk."""
    others = [word for word in FAST[2:] if word.split("=")[0] not in str(words)]
    done = command_here("run", *words, f"OUT={tmp_path / 'out'}", *others)
    one_line(done, *expected)
    assert listing(tmp_path) == {}


def test_unknown_command(command):
    done = command("rnu", "SCENE=model")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "there is no command rnu; there are run, model" in done.stderr
    assert "solve" not in done.stderr


def test_options_with_dashes_are_refused_in_one_line(command):
    done = command("run", "SCENE=model", "--friction=0.2")
    assert done.returncode == 2
    assert done.stderr.splitlines() == ["error: '--friction=0.2' is not of the form NAME=VALUE: "
                                        "options have no dashes, as in FRICTION=0.2"]


@pytest.mark.parametrize("closed, ranks", [("2>&-", 2), (">&- 2>&- <&-", 1)])
@pytest.mark.some(1)
def test_closed_streams_are_no_mistake(tmp_path, closed, ranks):
    """Files and pipes of ranks would take their numbers."""
    words = f"run SCENE=model {' '.join(FAST)} NP={ranks} OUT={tmp_path / 'out'} {closed}"
    done = subprocess.run(f"{sys.executable} -m driver {words}", shell=True, timeout=60,
                          cwd=environment.ROOT, env=dict(os.environ), check=False)
    assert done.returncode == 0 and (tmp_path / "out" / "summary.json").exists()


def test_ranks_are_not_started_by_hand(command):
    done = command("solve")
    assert done.returncode == 2
    one_line(done, "solve is what the processes of a run are started with")


def test_seeds_of_no_random_scenes_are_refused(command_here):
    one_line(command_here("hard", "FAMILY=scale", "SEED=3"), "have SEED", "FAMILY=random")


def test_no_scene_lists_the_scenes(command_here):
    done = command_here("run")
    assert done.returncode == 0 and "model" in done.stdout


def test_missing_freefem(command, tmp_path):
    done = command("run", "SCENE=model", f"OUT={tmp_path / 'out'}", PATH=str(tmp_path))
    one_line(done, "FreeFem++", "not installed", "make setup")
    assert listing(tmp_path) == {}


def test_a_python_without_packages_begins_nothing(tmp_path):
    """As another one than Debian's; -S leaves out where packages are."""
    done = subprocess.run([sys.executable, "-S", "-m", "driver", "run", "SCENE=model",
                           f"OUT={tmp_path / 'out'}"], cwd=environment.ROOT, text=True,
                          capture_output=True, check=False)
    assert done.returncode == 2
    one_line(done, "the Python package numpy is not installed", "make setup")
    assert listing(tmp_path) == {}


def test_missing_mpirun(command, tmp_path):
    done = command("run", "SCENE=model", "NP=2", f"OUT={tmp_path / 'out'}", PATH=str(tmp_path))
    one_line(done, "not installed")
    assert listing(tmp_path) == {}


def test_missing_gmsh(command, tmp_path):
    programs = tmp_path / "programs"
    programs.mkdir()
    for name in ("FreeFem++", "setpriv", "sh"):
        (programs / name).symlink_to(shutil.which(name))
    done = command("run", "SCENE=bracket", f"OUT={tmp_path / 'out'}", PATH=str(programs))
    one_line(done, "gmsh is not installed", "make setup")
    assert not (tmp_path / "out").exists()


HEADER = 'include "scene.idp"\nsubdomains("2x1");\n'


@pytest.mark.parametrize("text, expected", [
    (HEADER + "rectangle(0., 2., 0., 1.;\n", [" 3", "a '(' is not closed"]),
    (HEADER + "\nreal a = undeclared + 1;\n", [" 4", "undeclared"]),
    (HEADER + "\n\nassert(1 > 2);\n", [" 5", "assert"]),
    (HEADER + 'mesh Th = readmesh("no-such-file.msh");\n', [" 3", "no-such-file.msh"]),
    ('include "no-such-library.idp"\n', ["no-such-library.idp"]),
    (HEADER + 'real F = physical("friction", 0.3);\ninclude "export.idp"\n', ["body"]),
    ("int k = 1;\n", ["manifest"]),
], ids=["syntax", "undeclared", "assert", "readmesh", "include", "no body", "exports nothing"])
def test_failing_script(command_here, tmp_path, scene, text, expected):
    """FreeFEM's own message and the script line, in one line."""
    path = scene(text)
    out = tmp_path / "out"
    done = command_here("run", f"SCENE={path}", f"OUT={out}", "FIGURES=no")
    one_line(done, *expected)
    assert listing(tmp_path) == {}


def test_failing_script_on_ranks(command, tmp_path, scene):
    path = scene(HEADER + "assert(1 > 2);")
    done = command("run", f"SCENE={path}", "NP=2", f"OUT={tmp_path / 'out'}")
    one_line(done, "assert", " 3")
    assert listing(tmp_path) == {}


def test_contact_on_a_label_without_nodes(command_here, tmp_path, variant):
    path = variant("nolabel", ("macro contact() 1 //", "macro contact() 9 //"))
    done = command_here("run", f"SCENE={path}", *FAST, f"OUT={tmp_path / 'out'}")
    one_line(done, "label", "9")


# ------------------------------------------------------------------------ where results go

@pytest.mark.parametrize("out", ["file/out", "file/deep/er/out"])
def test_unwritable_out(command_here, tmp_path, out):
    """A path through a regular file cannot be created even by root."""
    (tmp_path / "file").write_text("mine")
    before = listing(tmp_path)
    one_line(command_here("run", "SCENE=model", *FAST, f"OUT={tmp_path / out}"), "cannot write")
    assert listing(tmp_path) == before


@pytest.mark.parametrize("out", ["/", "/proc/nothing/out"])
def test_impossible_out(command_here, out):
    one_line(command_here("run", "SCENE=model", *FAST, f"OUT={out}"))


def test_out_that_is_a_file(command_here, tmp_path):
    """Refused or replaced, but its content must not vanish unasked, nor a hidden copy stay."""
    (tmp_path / "out").write_text("mine")
    before = listing(tmp_path)
    one_line(command_here("run", "SCENE=model", *FAST, f"OUT={tmp_path / 'out'}"), "out")
    assert listing(tmp_path) == before


def test_out_that_holds_other_files(command, tmp_path):
    """OUT=. or a home directory by mistake: files that no run has written survive."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    done = command("run", "SCENE=model", *FAST, f"OUT={out}")
    assert (out / "thesis.tex").exists(), "a directory that holds no run was deleted"
    if done.returncode:
        one_line(done, "out")


def test_failing_run_leaves_earlier_results(command_here, tmp_path, scene):
    out = tmp_path / "out"
    assert command_here("run", "SCENE=model", *FAST, f"OUT={out}").returncode == 0
    before = listing(tmp_path)
    for words in (("FRICTION=zero",), ("STEPS=0",), (f"SCENE={scene(HEADER + 'assert(1 > 2);')}",)):
        one_line(command_here("run", *dict.fromkeys(("SCENE=model", *words)), f"OUT={out}"))
        assert listing(tmp_path) == before


def test_export_spoiled_on_the_way_leaves_earlier_results(tmp_path, monkeypatch):
    """A failure after FreeFEM has come through."""
    from driver import cli, errors
    from driver.scene import freefem

    out = tmp_path / "out"
    words = cli.parse_pairs(["SCENE=model", *FAST, f"OUT={out}", "QUIET=yes"])
    cli.execute(cli.Run.from_pairs(words))
    before, export = listing(tmp_path), freefem.export

    def truncate(scene, directory, *rest):
        manifest = export(scene, directory, *rest)
        block = directory / "block-0.bin"
        block.write_bytes(block.read_bytes()[:-800])
        return manifest

    monkeypatch.setattr(freefem, "export", truncate)
    with pytest.raises(errors.InputError, match="truncated"):
        cli.execute(cli.Run.from_pairs(words))
    assert listing(tmp_path) == before


def test_runs_leave_nothing_else(command, tmp_path):
    """No temporary directory beside the results, also when an earlier run is replaced."""
    for _ in range(2):
        assert command("run", "SCENE=model", *FAST, f"OUT={tmp_path / 'out'}").returncode == 0
        assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert not [name for name in listing(tmp_path) if re.search("/\\.|block-|request|answer", name)]


def test_not_converged_keeps_marked_results(command_here, tmp_path):
    done = command_here("run", "SCENE=model", *FAST, "MAX_FIXED_POINT=1", f"OUT={tmp_path / 'out'}")
    assert done.returncode == 4 and "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1 and "fixed point" in done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["converged"] is False and summary["warnings"]
    assert (tmp_path / "out" / "contact.csv").exists()


def test_no_solution_has_its_own_status(command, tmp_path, variant):
    path = variant("cli_loose", ("macro support() on(4, u1 = 0., u2 = 0.) //\n", ""),
                   ('"friction", 0.3', '"friction", 0.1'))
    for ranks in (1, 2):
        done = command("run", f"SCENE={path}", *FAST, f"NP={ranks}", f"OUT={tmp_path / 'out'}")
        assert done.returncode == 3 and "Traceback" not in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1 and "support" in done.stderr
        assert listing(tmp_path) == {}


# ------------------------------------------------------------------------------- results

@pytest.fixture(scope="module")
def finished(command, tmp_path_factory):
    """A complete run: (directory, finished process)."""
    out = tmp_path_factory.mktemp("results") / "out"
    done = command("run", "SCENE=model", "LOADING=nonmonotone", "CELLS=4", "STEPS=5", f"OUT={out}")
    assert done.returncode == 0, done.stderr
    return out, done


SUMMARY = {
    "scene": str, "variant": str, "converged": bool, "warnings": list, "steps": int,
    "t_end": (int, float), "memory_mib": float, "ranks": int, "parameters": dict, "versions": dict,
    "effects": ["contact", "friction", "time", "body_force", "bodies"],
    "sizes": ["subdomains", "primal_dofs", "dual_dofs", "dual_gluing", "dual_normal",
              "dual_tangential", "coarse_dofs", "contact_nodes"],
    "counts": ["fixed_point_iterations", "dual_multiplications", "dual_multiplications_setup",
               "cg_steps", "expansion_steps", "proportioning_steps"],
    "residuals": ["stationarity", "gluing", "penetration", "sign", "cone", "complementarity"],
    "seconds": ["export", "read", "setup", "solve", "output", "total"]}


@pytest.mark.parametrize("name", SUMMARY)
def test_summary_entry(finished, name):
    summary = json.loads((finished[0] / "summary.json").read_text())
    kind = SUMMARY[name]
    if isinstance(kind, list):
        assert set(kind) <= set(summary[name])
    else:
        assert isinstance(summary[name], kind)


def test_summary_values(finished):
    s = json.loads((finished[0] / "summary.json").read_text())
    assert (s["scene"], s["variant"], s["converged"], s["steps"], s["t_end"], s["ranks"]) == (
        "model", "nonmonotone", True, 5, 1, 1)
    effects = {"contact": "unilateral", "friction": "coulomb", "time": "quasistatic",
               "body_force": False, "bodies": 1}
    assert s["effects"] == {**s["effects"], **effects}
    # 4x2 subdomains of 5x5 vertices; 10 interfaces of 3 inner nodes; 16 contact nodes, one is fixed
    sizes = {"subdomains": 8, "primal_dofs": 400, "dual_gluing": 60, "dual_normal": 16,
             "dual_tangential": 16, "dual_dofs": 92, "coarse_dofs": 24, "contact_nodes": 16}
    assert s["sizes"] == {**s["sizes"], **sizes}
    parameters = {"friction": 0.3, "cells": 4, "subdomains": "4x2"}
    assert s["parameters"] == {**s["parameters"], **parameters}
    seconds = dict(s["seconds"])
    # the user waits for the figures, too
    assert seconds["figures"] > 0 and seconds["start"] > 0
    assert seconds.pop("total") == pytest.approx(sum(seconds.values()))


def table(path):
    with open(path, newline="") as file:
        names, *rows = csv.reader(file)
    return names, rows


def test_contact_columns(finished):
    """The fixed order of columns; one row per node and step; numbers in full precision."""
    names, rows = table(finished[0] / "contact.csv")
    assert names == ["step", "time", "node", "x", "y", "arc", "weight", "normal_x", "normal_y",
                     "gap", "u_n", "u_t", "slip", "sigma_n", "sigma_t", "bound", "status"]
    order = [(int(row[0]), int(row[2])) for row in rows]
    assert order == [(step, node) for step in range(1, 6) for node in range(16)]
    assert all(float(r[1]) == pytest.approx(int(r[0]) / 5) for r in rows)


def test_contact_geometry(finished):
    """n = (0, -1) is the outward normal, t = (1, 0) is n turned by +90 degrees; arc follows x."""
    names, rows = table(finished[0] / "contact.csv")

    def value(name):
        return np.array([float(row[names.index(name)]) for row in rows[:16]])

    np.testing.assert_allclose(value("x"), np.arange(1, 17) / 8, rtol=1e-15)
    np.testing.assert_allclose(value("weight"), [1 / 8] * 15 + [1 / 16], rtol=1e-14)
    assert np.all(value("normal_y") == -1)
    assert not value("y").any() and not value("normal_x").any()
    np.testing.assert_allclose(np.diff(value("arc")), 1 / 8, rtol=1e-14)


def test_history_has_a_row_a_step(finished):
    names, rows = table(finished[0] / "history.csv")
    assert {"step", "time", "fixed_point_iterations", "dual_multiplications"} <= set(names)
    steps = [int(row[names.index("step")]) for row in rows]
    assert steps[-5:] == [1, 2, 3, 4, 5]  # a row for the start may come before


def test_files_are_complete(finished):
    out = finished[0]
    files = {"summary.json", "contact.csv", "history.csv", "fields.pvd", "figures"}
    assert files <= {path.name for path in out.iterdir()}
    assert list(out.glob("*.log"))
    assert len(list((out / "figures").glob("*.png"))) >= 7
    assert all(p.stat().st_size > 1000 for p in (out / "figures").iterdir())


def test_vtu_series(finished):
    """One file a step, named in fields.pvd; contact nodes move there as contact.csv says."""
    out = finished[0]
    files = re.findall(r'timestep="([^"]+)".*?file="([^"]+)"', (out / "fields.pvd").read_text())
    files = [(float(t), name) for t, name in files if float(t) > 0]
    assert [t for t, _ in files] == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    names, rows = table(out / "contact.csv")
    for step, (_, name) in enumerate(files, 1):
        mesh = meshio.read(out / name)
        assert set(mesh.cell_data) >= {"stress", "von_mises", "subdomain"}
        u = mesh.point_data["displacement"]
        for row in (dict(zip(names, r)) for r in rows if r[0] == str(step)):
            away = np.abs(mesh.points[:, :2] - [float(row["x"]), float(row["y"])]).max(axis=1)
            here = np.flatnonzero(away < 1e-12)
            assert len(here) >= 1
            n, t = np.array([0, -1]), np.array([1, 0])
            largest = np.abs(u).max()
            for copy in here:  # copies in several subdomains differ by the gluing tolerance
                assert abs(u[copy, :2] @ n - float(row["u_n"])) <= 1e-4 * largest
                assert abs(u[copy, :2] @ t - float(row["u_t"])) <= 1e-4 * largest


def test_vtu_subdomains_and_size(finished):
    mesh = meshio.read(finished[0] / "fields" / "step_0005.vtu")
    assert len(mesh.points) == 200 and len(mesh.cells_dict["triangle"]) == 8 * 32
    number = np.asarray(mesh.cell_data["subdomain"][0])
    assert np.array_equal(np.bincount(number), [32] * 8)
    x = mesh.points[mesh.cells_dict["triangle"]].mean(axis=1)
    expected = np.floor(2 * x[:, 0]) + 4 * np.floor(2 * x[:, 1])
    assert np.array_equal(number, expected)


@pytest.mark.slow
def test_figures_are_redrawn_without_solving(command, finished, tmp_path):
    """From the files alone: neither FreeFEM nor the solver, nor any change of the numbers."""
    out = shutil.copytree(finished[0], tmp_path / "copy")
    drawn = sorted(p.stem for p in (out / "figures").iterdir())
    shutil.rmtree(out / "figures")
    before = listing(out)
    done = command("figures", out, PATH=str(tmp_path))
    assert done.returncode == 0, done.stderr
    for kind in ("png", "pdf"):
        assert sorted(p.stem for p in (out / "figures").glob(f"*.{kind}")) == drawn
    after = listing(out)
    assert {name: after[name] for name in before} == before


def test_figures_of_no_run(command_here, tmp_path):
    one_line(command_here("figures", tmp_path / "nowhere"), "nowhere")


def test_progress_lines(finished):
    """Not on a terminal: plain lines with step, products and residual, no carriage returns."""
    text = finished[1].stdout + finished[1].stderr
    assert "\r" not in text
    # of the run: on a slow machine its companions tell theirs as well
    lines = [line for line in text.splitlines() if re.search(r"^model: step \d+/5", line)]
    assert lines and "step 5/5" in lines[-1]
    assert "fixed-point iterations" in finished[1].stdout  # the closing summary


def test_quiet(command, tmp_path):
    done = command("run", "SCENE=model", *FAST, "QUIET=yes", f"OUT={tmp_path / 'out'}")
    assert done.returncode == 0 and "step 1/" not in done.stdout + done.stderr


def test_out_relative_to_where_the_user_is(tmp_path, command):
    done = command("run", "SCENE=model", *FAST, "OUT=mine/run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "mine" / "run" / "summary.json").exists()


def test_scene_by_path_from_another_directory(tmp_path, command):
    shutil.copy(environment.ROOT / "edp" / "model.edp", tmp_path / "own.edp")
    done = command("run", "SCENE=own.edp", *FAST, "OUT=out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["scene"] == "own"


def test_a_terminal_gets_a_bar(tmp_path):
    """On a terminal one line that is redrawn instead of many."""
    words = [sys.executable, "-m", "driver", "run", "SCENE=model", *FAST, f"OUT={tmp_path / 'out'}"]
    done = subprocess.run(["script", "-qec", " ".join(words), "/dev/null"], cwd=environment.ROOT,
                          stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
    assert done.returncode == 0
    assert b"step/s" in done.stdout and b"2/2" in done.stdout and b"\rmodel" in done.stdout


# ------------------------------------------------------------------------ what a scene misspells

@pytest.mark.parametrize("old, new, said", [
    ("macro friction()", "macro fricton()",
     "nothing reads the macro fricton; did you mean friction?"),
    ("macro amplitude1(t)", "macro amplitud1(t)", "amplitud1"),
    ("macro poisson() nu //\n", "", "not poisson")])
def test_misspelt_declaration_is_refused(command_here, tmp_path, variant, old, new, said):
    """Left alone it would be a scene without friction, or with a load that is always on."""
    path = variant("misspelt", (old, new))
    one_line(command_here("run", f"SCENE={path}", *FAST, f"OUT={tmp_path / 'out'}"), said)


def test_unconverged_run_does_not_replace_a_converged_one(command_here, tmp_path):
    out = tmp_path / "out"
    assert command_here("run", "SCENE=model", *FAST, f"OUT={out}").returncode == 0
    before = listing(out)
    done = command_here("run", "SCENE=model", *FAST, "MAX_FIXED_POINT=1", f"OUT={out}")
    assert done.returncode == 4 and "out-unconverged" in done.stderr
    assert listing(out) == before
    summary = json.loads((tmp_path / "out-unconverged" / "summary.json").read_text())
    assert summary["converged"] is False


def heed_sigint():
    """Let a child heed SIGINT also where these tests are a job in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.parametrize("number, ranks", [
    (signal.SIGINT, 1), *(
        pytest.param(number, ranks, marks=pytest.mark.slow)
        for number, ranks in ((signal.SIGTERM, 1), (signal.SIGINT, 2), (signal.SIGTERM, 2)))])
def test_interrupted_run_leaves_no_results(tmp_path, ranks, number):
    """Amid the solve: one line, no orphan, and only a run to go on from."""
    words = ["SCENE=model", "LOADING=nonmonotone", "CELLS=4", "RTOL=1e-12", "STEPS=20000",
             "FIGURES=no", f"NP={ranks}", f"OUT={tmp_path / 'out'}"]
    # as in a terminal: a session of its own, the signal goes to the driver
    run = subprocess.Popen([sys.executable, "-m", "driver", "run", *words], cwd=environment.ROOT,
                           env=dict(os.environ),  # without what MPI has put into this process
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                           start_new_session=True, preexec_fn=heed_sigint)
    while run.poll() is None and not list(tmp_path.glob(f".out.*/{checkpoint.NAME}")):
        time.sleep(0.01)
    run.send_signal(number)
    _, said = run.communicate(timeout=120)
    assert run.returncode == 130, said
    assert "interrupted" in said and "Traceback" not in said and len(said.splitlines()) == 1
    remaining = [path.name for path in tmp_path.iterdir()]
    assert "goes on after step" in said and len(remaining) == 1
    assert re.fullmatch(r"\.out\.\d+", remaining[0])
    assert not [words for words in command_lines() if str(tmp_path).encode() in words]


def test_children_of_a_job_in_the_background_end_with_it(tmp_path):
    """Shells let such jobs ignore SIGINT, which children inherit: they get another signal."""
    script = 'trap "touch ended; exit" TERM; touch ready; while :; do sleep 0.01; done'

    def interrupt():
        while not (tmp_path / "ready").exists():
            time.sleep(0.01)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with pytest.raises(KeyboardInterrupt):
            children.run_child(["sh", "-c", script], interrupt, cwd=tmp_path)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (tmp_path / "ended").exists()


def command_lines():
    """Command lines of the processes that are there; one that ends meanwhile has none."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            yield path.read_bytes()
        except OSError:
            pass


def test_result_of_a_run_killed_while_publishing_comes_back(command, tmp_path):
    """Between two renames the older result has its private name only: it must not be swept away."""
    out = tmp_path / "out"
    assert command("run", "SCENE=model", *FAST, f"OUT={out}").returncode == 0
    before = listing(out)
    out.rename(tmp_path / ".out.old.999999999")
    one_line(command("run", "SCENE=model", *FAST, "FRICTION=x", f"OUT={out}"))
    assert listing(out) == before and not list(tmp_path.glob(".out*"))


def test_settings_of_a_process_by_itself_are_not_its_childrens(monkeypatch):
    """mpirun started from here must find its networks."""
    monkeypatch.setattr(environment, "LAUNCHED", ())
    for name in environment.ALONE:
        monkeypatch.delenv(name, raising=False)
    before = dict(os.environ)
    environment.start_petsc()
    assert dict(os.environ) == before
    # what the MPI library has set itself must not show either
    inherited = subprocess.run(["env"], capture_output=True, text=True).stdout
    assert not re.search("^(OMPI_MCA_ess|OMPI_MCA_pmix)=", inherited, re.MULTILINE)


SWALLOWED = """
import os, signal, sys, time, weakref
sys.path.insert(0, {root!r})
from driver import environment
environment.heed_interrupts()

class Thing:
    pass

thing = Thing()
callback = weakref.ref(thing, lambda _: (os.kill(os.getpid(), signal.{name}), time.sleep(0.01)))
try:
    del thing
    time.sleep(10)
except KeyboardInterrupt:
    print("heeded")
"""


DROPPED = """
import os, signal, sys
sys.path.insert(0, {root!r})
import numpy
from driver import environment
environment.heed_interrupts()

class Class(type):
    def __getattr__(cls, name):
        os.kill(os.getpid(), signal.{name})
        raise AttributeError(name)

class Number(int, metaclass=Class):
    pass

numpy.add(1, Number(2))
try:
    environment.heed_lost_interrupt()
except KeyboardInterrupt:
    print("heeded")
"""


AMID = """
import os, pathlib, signal, sys
sys.path.insert(0, {root!r})
from driver import environment
environment.heed_interrupts()

class Finder:
    @staticmethod
    def find_spec(name, *_):
        if name == "numpy.core":
            os.kill(os.getpid(), signal.{name})

sys.meta_path.insert(0, Finder)
try:
    {load}
except KeyboardInterrupt:
    print("whole" if hasattr(sys.modules.get("numpy"), "dtype") else "in parts")
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("load", [
    "from driver.march import checkpoint; checkpoint.read(pathlib.Path('nowhere'))",
    "environment.prepare_numpy()"])
def test_numpy_is_loaded_whole(name, load):
    """An interrupt waits for the end of its import, which NumPy might go on from with parts."""
    code = AMID.format(root=str(environment.ROOT), name=name, load=load)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                          check=True, preexec_fn=heed_sigint)
    assert done.stdout == "whole\n"


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("code", [SWALLOWED, DROPPED], ids=["printed", "dropped"])
def test_interrupts_in_callbacks_are_not_forgotten(code, name):
    """Python itself has such callbacks, in its imports; those of NumPy drop what they raise."""
    code = code.format(root=str(environment.ROOT), name=name)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                          preexec_fn=heed_sigint)
    assert (done.stdout, done.stderr) == ("heeded\n", "")
