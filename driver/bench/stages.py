"""The FreeFEM stage, reading it back, memory and start-up."""

import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

from ..scene import freefem
from ..scene.loader import read_subdomains
from ..scene.manifest import read_manifest
from .workbench import REPEATS, Workbench, child, driver, in_turn, ratios, seconds

PART = "stages"
SUBDOMAINS = "64x32"
DOFS = 495_616
SMALLER = "32x16"


def measure(bench: Workbench) -> None:
    """Seconds per dof of the export on one and two ranks, reading, memory and start-up."""
    report, (model, graded) = bench.report, _scenes(bench)
    _export(bench, model, graded)
    for scene, text in ((model, "equal subdomains"), (graded, "a stiffness each")):
        _read_back(bench, scene, text)
    out = bench.folder / "run"
    _, peak = child(driver("run", "SCENE=model", f"SUBDOMAINS={SUBDOMAINS}", f"OUT={out}",
                           "ERRORS=no", "FIELDS=no", "FIGURES=no", "QUIET=yes"))
    report.add(PART, f"peak memory of the driver, {DOFS} dofs, one rank", peak, "MiB", "<= 1536")
    _start_up(bench)


def _scenes(bench: Workbench) -> tuple[Path, Path]:
    """The model example with equal subdomains, and one with a stiffness of its own in each."""
    model, graded = freefem.find_scene("model"), bench.folder / "graded.edp"
    before, macro, after = model.read_text().partition("macro young() E //")
    graded.write_text(f"{before}macro young() (E*(1 + x*y)) //{after}")
    if not macro:
        raise RuntimeError(
            f"{model} declares Young's modulus in another way than the benchmark knows")
    return model, graded


def _export(bench: Workbench, model: Path, graded: Path) -> None:
    """FreeFEM on one and two ranks, with equal subdomains and with a stiffness each.

    It assembles one of equal subdomains. Ranks share the assembly; their start costs the same.
    """
    for scene, subdomains, text, target in ((model, SMALLER, "equal subdomains", ""),
                                            (graded, SUBDOMAINS, "a stiffness each", ">= 1.7")):
        found = in_turn({ranks: lambda ranks=ranks: _fresh_export(
            bench, scene, subdomains, ranks) for ranks in (1, 2)})
        dofs = DOFS if subdomains == SUBDOMAINS else DOFS / 4
        bench.report.add(PART, f"FreeFEM stage, {subdomains}, {text}, per dof, one core",
                         [1e6 * s / dofs for s in found[1]], "µs", "<= 12")
        bench.report.add(PART, f"FreeFEM stage, {subdomains}, {text}, one rank over two",
                         ratios(found[1], found[2]), "", target)
    bench.export(SUBDOMAINS)
    bench.report.add(PART, f"FreeFEM stage, {SUBDOMAINS}, per dof, one core",
                     1e6 * bench.export_seconds[SUBDOMAINS, 10, 1] / DOFS, "µs", "<= 12")


def _fresh_export(bench: Workbench, scene: Path, subdomains: str, ranks: int) -> float:
    """Seconds of an export, which is thrown away."""
    directory = bench.folder / "fresh"
    try:
        return seconds(lambda: freefem.export(scene, directory,
                                              {"subdomains": subdomains, "cells": "10"}, ranks))
    finally:
        shutil.rmtree(directory, ignore_errors=True)


def _read_back(bench: Workbench, scene: Path, text: str) -> None:
    """The loader against the disk itself, past the page cache."""
    directory = bench.folder / "read"
    shutil.rmtree(directory, ignore_errors=True)
    freefem.export(scene, directory, {"subdomains": SUBDOMAINS, "cells": "10"})
    size = sum(path.stat().st_size for path in directory.glob("*.bin"))
    manifest = read_manifest(directory)

    def disk():
        for path in directory.glob("*.bin"):
            subprocess.run(["dd", f"if={path}", "of=/dev/null", "bs=4M",
                           "iflag=direct"], check=True, capture_output=True)

    try:
        found = in_turn({"loader": lambda: seconds(lambda: read_subdomains(manifest, 0,
                                                                           manifest.subdomains,
                                                                           MPI.COMM_SELF)),
                         "disk": disk}, REPEATS)
    except subprocess.CalledProcessError:
        bench.report.skip(PART, "the file system has no direct reads to compare the loader with")
        return
    finally:
        shutil.rmtree(directory)
    bench.report.add(PART, f"export of {DOFS} dofs, {text}", size / 1e6, "MB")
    bench.report.add(PART, f"reading it back with all checks, {text}", found["loader"], "s")
    bench.report.add(PART, f"reading it back with all checks, {text}", [
                     size / 1e6 / s for s in found["loader"]], "MB/s")
    bench.report.add(PART, f"disk alone, {text}", [size / 1e6 / s for s in found["disk"]], "MB/s")
    bench.report.add(PART, f"reading over disk speed, {text}", ratios(
        found["disk"], found["loader"]), "", ">= 1")


def _start_up(bench: Workbench) -> None:
    """make demo and the imports of a run."""
    demo = in_turn({"demo": lambda: child(
        ["make", "-s", "demo", f"OUT={bench.folder / 'demo'}", "QUIET=yes"])[0]}, 1)
    bench.report.add(PART, "make demo on a set-up machine", demo["demo"], "s", "<= 15")
    code = ("from driver import environment; environment.start_petsc(); "
            "import driver.cli, driver.runs.solve, driver.march.problem, driver.results.writer")
    found = in_turn({"driver": lambda: child([sys.executable, "-c", code])[0],
                     "python": lambda: child([sys.executable, "-c", "pass"])[0]}, REPEATS)
    imports = [a - b for a, b in zip(found["driver"], found["python"])]
    bench.report.add(PART, "importing the driver, numpy, PETSc and MPI included",
                     imports, "s", "<= 1")
