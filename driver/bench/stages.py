"""The FreeFEM stage, reading it back, memory and start-up."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..scene import freefem
from ..scene.loader import read_subdomains
from ..scene.manifest import read_manifest
from .workbench import BARE, Workbench, child, driver, in_turn, ratios, seconds

SUBDOMAINS = "64x32"
DOFS = 495_616
SMALLER = "32x16"


def measure(bench: Workbench) -> None:
    """Seconds per dof of the export on one and two ranks, reading, memory and start-up."""
    model, graded = _scenes(bench)
    _export(bench, model, graded)
    for scene, text in ((model, "equal subdomains"), (graded, "a stiffness each")):
        _read_back(bench, scene, text)
    out = bench.folder / "run"
    _, peak = child(driver("run", "SCENE=model", f"SUBDOMAINS={SUBDOMAINS}", f"OUT={out}", "NP=1",
                      *BARE))
    bench.add(f"peak memory of the driver, {DOFS} dofs, one rank", peak, "MiB", "<= 1536")
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
        times = in_turn({ranks: lambda ranks=ranks: _fresh_export(bench, scene, subdomains, ranks)
                         for ranks in (1, 2)})
        dofs = DOFS if subdomains == SUBDOMAINS else DOFS / 4
        name = f"FreeFEM stage, {subdomains}, {text}"
        bench.add(f"{name}, per dof, one core", [1e6 * s / dofs for s in times[1]], "µs", "<= 12")
        bench.add(f"{name}, one rank over two", ratios(times[1], times[2]), "", target)
    bench.export(SUBDOMAINS)
    spent = 1e6 * bench.export_seconds[SUBDOMAINS, 10, 1] / DOFS
    bench.add(f"FreeFEM stage, {SUBDOMAINS}, per dof, one core", spent, "µs", "<= 12")


def _fresh_export(bench: Workbench, scene: Path, subdomains: str, ranks: int) -> float:
    """Seconds of an export, which is thrown away."""
    directory = bench.folder / "fresh"
    try:
        parameters = {"subdomains": subdomains, "cells": "10"}
        return seconds(lambda: freefem.export(scene, directory, parameters, ranks))
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
            subprocess.run(["dd", f"if={path}", "of=/dev/null", "bs=4M", "iflag=direct"],
                           check=True, capture_output=True)

    def load():
        read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)

    try:
        times = in_turn({"loader": lambda: seconds(load), "disk": disk})
    except subprocess.CalledProcessError:
        bench.skip("the file system has no direct reads to compare the loader with")
        return
    finally:
        shutil.rmtree(directory)
    bench.add(f"export of {DOFS} dofs, {text}", size / 1e6, "MB")
    name = f"reading it back with all checks, {text}"
    bench.add(name, times["loader"], "s")
    bench.add(name, [size / 1e6 / s for s in times["loader"]], "MB/s")
    bench.add(f"disk alone, {text}", [size / 1e6 / s for s in times["disk"]], "MB/s")
    speeds = ratios(times["disk"], times["loader"])
    bench.add(f"reading over disk speed, {text}", speeds, "", ">= 1")


def _start_up(bench: Workbench) -> None:
    """make demo and the imports of a run."""
    demo, _ = child(["make", "-s", "demo", f"OUT={bench.folder / 'demo'}", "QUIET=yes"])
    bench.add("make demo on a set-up machine", demo, "s", "<= 15")
    code = ("from driver import environment; environment.start_petsc(); "
            "import driver.cli, driver.runs.solve, driver.march.problem, driver.results.writer")
    times = in_turn({"driver": lambda: child([sys.executable, "-c", code])[0],
                     "python": lambda: child([sys.executable, "-c", "pass"])[0]})
    imports = np.subtract(times["driver"], times["python"])
    bench.add("importing the driver, numpy, PETSc and MPI included", imports, "s", "<= 1")
