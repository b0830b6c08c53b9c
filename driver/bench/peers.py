"""GetFEM on the same mesh, loads and steps: whole processes, the FreeFEM stage included."""

import subprocess
import sys
from pathlib import Path
from statistics import median

import numpy as np

from ..files import read_table
from .workbench import BARE, REPEATS, Workbench, child, driver, in_turn, ratios

STEPS = 10
# 1/h: subdomains of 10 cells, target of the ratio
CASES = {20: ("4x2", ">= 1"), 40: ("8x4", ""), 80: ("16x8", ">= 20")}
LARGE = {160: ("32x16", ">= 50"), 320: ("64x32", ">= 100")}  # minutes and tens of minutes
LOADING = "nonmonotone"
AGREE = 0.01  # of the largest nodal force


def installed() -> bool:
    """Is GetFEM's Python interface there?"""
    return subprocess.run([sys.executable, "-c", "import getfem"],
                          capture_output=True).returncode == 0


def measure(bench: Workbench, large: bool = False) -> dict:
    """Time ratios at every mesh size, median seconds for the picture.

    Raises RuntimeError where the contact forces differ by more than AGREE.
    """
    if not installed():
        bench.skip("GetFEM is not installed (apt package python3-getfem)")
        return {}
    measured = {"cells": [], "driver": [], "GetFEM": [], "steps": STEPS}
    for cells, (subdomains, target) in {**CASES, **(LARGE if large else {})}.items():
        mesh, ours, theirs = (bench.folder / name for name in ("mesh.npz", "run", "getfem.npz"))
        _write_mesh(bench.problem(subdomains).structure, mesh)
        bench.forget(subdomains)
        script = str(Path(__file__).with_name("getfem_model.py"))
        run = driver("run", "SCENE=model", f"LOADING={LOADING}", f"SUBDOMAINS={subdomains}",
                     f"STEPS={STEPS}", f"OUT={ours}", "NP=1", *BARE)
        model = [sys.executable, script, str(mesh), str(theirs), str(STEPS), LOADING]
        times = in_turn({"driver": lambda: child(run)[0], "GetFEM": lambda: child(model)[0]},
                        REPEATS if cells < 80 else 1)
        difference = _compare(ours, theirs)
        if not difference <= AGREE:
            raise RuntimeError(f"contact forces differ by {difference:.1e} from GetFEM's")
        measured["cells"].append(cells)
        for name, values in times.items():
            bench.add(f"{name}, h = 1/{cells}, {STEPS} steps", values, "s")
            measured[name].append(median(values))
        bench.add(f"largest difference of nodal contact forces, h = 1/{cells}", difference, "",
                  f"<= {AGREE}")
        gain = ratios(times["GetFEM"], times["driver"])
        bench.add(f"GetFEM over driver, h = 1/{cells}", gain, "", target)
    return measured


def _write_mesh(structure, path: Path) -> None:
    """The untorn mesh."""
    subdomains = structure.subdomains
    xy = np.empty((1 + max(int(sub.node_gid.max()) for sub in subdomains), 2))
    for sub in subdomains:
        xy[sub.node_gid] = sub.xy
    triangles = np.concatenate([sub.node_gid[sub.triangles] for sub in subdomains])
    np.savez(path, xy=xy, triangles=triangles)


def _compare(ours: Path, theirs: Path) -> float:
    """Largest difference of nodal forces at the last step over the largest force of its kind."""
    table = read_table(ours / "contact.csv")
    last = {name: column[table["step"] == STEPS] for name, column in table.items()}
    other = np.load(theirs)
    if not np.allclose(last["x"], other["x"]):
        return np.inf
    worst = 0.0
    for name, sign, key in (("sigma_n", -1, "normal"), ("sigma_t", 1, "tangential")):
        force = sign * last[name] * last["weight"]
        worst = max(worst, float(np.abs(force - other[key]).max() / np.abs(force).max()))
    return worst
