"""GetFEM on the same mesh, loads and steps: whole processes, the FreeFEM stage included."""

import re
import subprocess
import sys
from pathlib import Path
from statistics import median

import numpy as np

from ..figures.reading import field_files, read_mesh
from ..files import read_table
from ..scene.freefem import find_scene
from .workbench import BARE, REPEATS, Workbench, child, driver, in_turn, ratios

STEPS = 10
# 1/h: subdomains of 10 cells, target of the ratio
CASES = {20: ("4x2", ">= 1"), 40: ("8x4", ""), 80: ("16x8", ">= 20")}
LARGE = {160: ("32x16", ">= 50"), 320: ("64x32", ">= 100")}  # minutes and tens of minutes
OWN = {20_000: (0.016, ">= 10")}  # about so many dofs of an unstructured mesh: H, target
OWN_LARGE = {85_000: (0.0077, ">= 30")}
LOADING = "nonmonotone"
AGREE = 0.01  # of the largest nodal force
# the body of the model example as FreeFEM's mesh generator meshes it
RECTANGLE = re.compile(r"rectangle\(0., 2., 0., 1.\);.*")
MESHED = """real h = meshSize(0.1);
int along = int(round(1./h));
border bottom(t=0, 2) {x = t; y = 0; label = 1;}
border right(t=0, 1) {x = 2; y = t; label = 2;}
border top(t=2, 0) {x = t; y = 1; label = 3;}
border left(t=1, 0) {x = 0; y = t; label = 4;}
body = buildmesh(bottom(2*along) + right(along) + top(2*along) + left(along));
"""


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
        words = ["SCENE=model", f"SUBDOMAINS={subdomains}"]
        times = _compared(bench, words, f"h = 1/{cells}", REPEATS if cells < 80 else 1, target)
        measured["cells"].append(cells)
        for name, values in times.items():
            measured[name].append(median(values))
    scene = _own_mesh(bench.folder)
    for dofs, (h, target) in {**OWN, **(OWN_LARGE if large else {})}.items():
        _compared(bench, [f"SCENE={scene}", f"H={h}"], f"own mesh, {dofs} dofs", 1, target)
    return measured


def _compared(bench: Workbench, words: list[str], title: str, repeats: int, target: str) -> dict:
    """Seconds of both on the mesh of a run of `words`."""
    mesh, ours, theirs = (bench.folder / name for name in ("mesh.npz", "run", "getfem.npz"))
    words = [*words, f"LOADING={LOADING}", f"STEPS={STEPS}", f"OUT={ours}", "NP=1"]
    run = driver("run", *words, *BARE)
    child(driver("run", *words, *(word for word in BARE if word != "FIELDS=no")))
    _write_mesh(ours, mesh)
    script = str(Path(__file__).with_name("getfem_model.py"))
    model = [sys.executable, script, str(mesh), str(theirs), str(STEPS), LOADING]
    times = in_turn({"driver": lambda: child(run)[0], "GetFEM": lambda: child(model)[0]}, repeats)
    difference = _difference(ours, theirs)
    if not difference <= AGREE:
        raise RuntimeError(f"contact forces differ by {difference:.1e} from GetFEM's")
    for name, values in times.items():
        bench.add(f"{name}, {title}, {STEPS} steps", values, "s")
    bench.add(f"largest difference of nodal contact forces, {title}", difference, "",
              f"<= {AGREE}")
    bench.add(f"GetFEM over driver, {title}", ratios(times["GetFEM"], times["driver"]), "", target)
    return times


def _own_mesh(folder: Path) -> Path:
    """The model example's script with a mesh of its own."""
    text, scene = find_scene("model").read_text(), folder / "own-mesh.edp"
    text = RECTANGLE.sub(MESHED, text).replace('subdomains("4x2");', "")
    scene.write_text(text)
    return scene


def _write_mesh(out: Path, path: Path) -> None:
    """The untorn mesh of a run with fields."""
    mesh = read_mesh(field_files(out)[-1][1], 0.0)
    xy, of = np.unique(mesh.xy, axis=0, return_inverse=True)
    np.savez(path, xy=xy, triangles=of[mesh.corners])


def _difference(ours: Path, theirs: Path) -> float:
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
