"""Runs from Python: what driver.run and driver.open give, and how they fail."""

import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

import driver
from driver import children, environment
from driver.files import read_table
from driver.python import run as runner

CASE = {"cells": 3, "steps": 3, "errors": "no", "figures": False, "loading": "nonmonotone"}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return driver.run("model", out=tmp_path_factory.mktemp("python") / "model",
                      friction=np.float64(0.25), **CASE)


def test_a_run_gives_the_files_by_name(result):
    assert result.summary["converged"] and result.summary["parameters"]["friction"] == 0.25
    contact = read_table(result.directory / "contact.csv")
    assert set(result.contact) == set(contact)
    assert np.array_equal(result.contact["sigma_n"], contact["sigma_n"])
    assert result.contact["step"].dtype.kind == "i" and result.contact["step"].max() == 3
    assert len(result.history["time"]) == 3 == len(result.boundaries["force_x"])
    assert result.probes == {}
    assert "products with F" in result.text and ": step " not in result.text
    assert "model" in repr(result)
    assert driver.open(result.directory).text == result.text


def test_fields_are_arrays(result):
    fields = result.fields(3)
    n, m = len(fields.nodes), len(fields.triangles)
    shapes = {"nodes": (n, 2), "triangles": (m, 3), "displacement": (n, 2), "stress": (n, 4),
              "triangle_stress": (m, 4), "von_mises": (m,), "subdomain": (m,), "body": (m,),
              "region": (m,)}
    assert {name: fields[name].shape for name in shapes} == shapes
    assert fields.triangles.max() == n - 1 and fields.time == 1.0
    largest = np.linalg.norm(fields.displacement, axis=1).max()
    assert largest == pytest.approx(result.history["max_displacement"][-1])
    assert result.fields().step == 3 and not result.fields(0).displacement.any()
    with pytest.raises(driver.DriverError, match="no fields of step 4"):
        result.fields(4)
    with pytest.raises(driver.DriverError, match="number of a step, not 'last'"):
        result.fields("last")


def test_a_column_that_is_not_there_names_those_that_are(result):
    with pytest.raises(KeyError, match="no column 'pressure'; it has step, .*sigma_n"):
        result.contact.__getitem__("pressure")
    with pytest.raises(KeyError, match="left no probes.csv"):
        result.probes.__getitem__("u_x")
    assert result.contact.get("pressure") is None and result.cycles == {}


def test_a_python_without_the_packages_starts_debians(monkeypatch):
    """As the kernel of a notebook that is installed beside them."""
    assert environment.interpreter() == sys.executable
    monkeypatch.setattr(environment.importlib.util, "find_spec", lambda name: None)
    assert environment.interpreter() == "/usr/bin/python3"
    monkeypatch.setattr(environment.shutil, "which", lambda *_, **__: None)
    assert environment.interpreter() == sys.executable


def test_a_finished_run_is_opened_without_solving(result):
    again = driver.open(str(result.directory))
    assert again.summary == result.summary
    assert np.array_equal(again.history["resultant_n"], result.history["resultant_n"])


@pytest.mark.parametrize("scene, options, status, words", [
    ("model", {"frction": 0.3}, 2, "FRCTION"), ("no-such-scene", {}, 2, "no-such-scene"),
    ("model", {"cells": 3, "CELLS": 4}, 2, "twice"), ("model", {"steps": "few"}, 2, "few"),
    ("slope", {"angle": 60, "cells": 3}, 3, "friction"),
    ("model", {**CASE, "max_products": 1}, 4, "partial results")])
@pytest.mark.some(1)
def test_errors_have_the_status_and_the_words_of_the_command_line(tmp_path, scene, options, status,
                                                                  words):
    with pytest.raises(driver.DriverError, match=words) as caught:
        driver.run(scene, out=tmp_path / "out", **options)
    assert caught.value.exit_status == status


def test_no_finished_run_to_open(tmp_path):
    with pytest.raises(driver.DriverError, match="no finished run") as caught:
        driver.open(tmp_path)
    assert caught.value.exit_status == 2
    (tmp_path / "summary.json").write_text("{")
    with pytest.raises(driver.DriverError, match="not readable"):
        driver.open(tmp_path)
    with pytest.raises(driver.DriverError, match="is a file: give the directory"):
        driver.open(tmp_path / "summary.json")
    (tmp_path / "summary.json").write_text('{"scene": "mine"}')
    with pytest.raises(driver.DriverError, match="is not the summary of a run"):
        driver.open(tmp_path)


def test_fields_that_are_cut_off_do_not_end_python(result, tmp_path):
    """As meshio does that reads them: a notebook would be gone."""
    copy = shutil.copytree(result.directory, tmp_path / "copy")
    path = copy / "fields" / "step_0002.vtu"
    path.write_bytes(path.read_bytes()[:3000])
    opened = driver.open(copy)
    assert opened.fields(1).step == 1
    with pytest.raises(driver.DriverError, match="step_0002.vtu is damaged") as caught:
        opened.fields(2)
    assert caught.value.exit_status == 2


def test_a_study_is_no_run_to_open(tmp_path):
    """One of a parameter leaves a summary, others a mark."""
    summary = {"scene": "model", "study": "friction", "units": {}, "seconds": {}, "converged": True}
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(driver.DriverError, match="holds a study of friction, not a run: its tab"):
        driver.open(tmp_path)
    (tmp_path / "summary.json").unlink()
    (tmp_path / ".study").write_text("effects")
    with pytest.raises(driver.DriverError, match="holds a study, not a run"):
        driver.open(tmp_path)


@pytest.mark.slow
def test_the_bar_follows_every_step(tmp_path, capsys, monkeypatch):
    seen = []

    class Bar:
        n, total = 0, 7

        def set_description_str(self, words, refresh):
            assert not refresh and words.startswith("model")
            seen.append(words.removeprefix("model"))

        def refresh(self):
            seen.append(self.n)

        def close(self):
            seen.append("closed")

    monkeypatch.setattr(runner, "_bar", lambda total, name: Bar() if total == 7 else None)
    driver.run("patch", out=tmp_path / "static", errors="no", figures=False, fields=False,
               progress=False)
    driver.run("model", out=tmp_path / "out", progress=True, **{**CASE, "steps": 7})
    assert seen == [1, 2, 3, 4, 5, 6, ", estimates and figures", 7, "", "closed"]
    assert capsys.readouterr() == ("", "")


def test_importing_is_cheap_and_running_starts_no_petsc(tmp_path):
    """Neither numpy nor the rest of the package before the first call; never PETSc and MPI."""
    code = ("import sys, driver\n"
            "assert not {'numpy', 'driver.runs', 'driver.options'} & set(sys.modules)\n"
            f"driver.run('patch', out={str(tmp_path / 'out')!r}, errors='no', figures=False)\n"
            "assert not {'petsc4py', 'mpi4py'} & set(sys.modules)\n")
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120,
                   env={**os.environ, "PYTHONPATH": children.python_path()})


@pytest.mark.slow
def test_the_script_of_the_documents_does_what_it_says(tmp_path):
    """As it stands there, elsewhere: the forces of all four runs lie on the closed form."""
    text = (environment.ROOT / "driver" / "README.md").read_text()
    code, = (block for block in re.findall(r"```python\n(.*?)```", text, re.S)
             if "import driver" in block)
    assert "plt.savefig" in code
    check = "\nprint(*(abs(a - b) for line in plt.gca().lines[::2] for a, b in " \
        "zip(line.get_ydata(), np.tan(np.radians(line.get_xdata()) + np.arctan(" \
        "float(line.get_label()[4:]))))))"
    done = subprocess.run([sys.executable, "-c", code + check], cwd=tmp_path, text=True,
                          capture_output=True, check=True, timeout=300,
                          env={**os.environ, "PYTHONPATH": children.python_path(),
                               "MPLBACKEND": "agg"})
    off = list(map(float, done.stdout.split()))
    assert len(off) == 4 and max(off) < 1e-3
    assert (tmp_path / "results/sweep/wedge.png").stat().st_size > 10_000
