"""Scenes on meshes of their own against one factorization: whole processes, memory, forces equal.

The peer is the scene's linear problem in plain FreeFEM (direct.py) on the same mesh. The suite
solves the same load case with contact and friction, and where the scene has a history that, in its
own steps, against the same single load case.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path
from statistics import median

import numpy as np

from ..figures.reading import field_files, read_mesh
from ..scene import freefem
from . import direct
from .workbench import BARE, REPEATS, Workbench, child, driver, in_turn, ratios

# what is left out of each scene for one static step at the end time
CASES = {"hertz": ("curved",), "bracket": ("quasistatic",), "tutorial": ("quasistatic",)}
SIZES = (20_000, 85_000, 340_000)
LARGE = 1_000_000
ELEMENTS = ("P1", "P2")
TARGET = "<= 1.5"
HISTORY = "<= 3"  # a history of 20 steps
ONCE = 200_000  # dofs from which a time is taken once
NEAR = 0.05  # of the wanted dofs
AGREE = 1e-8  # of the largest displacement: both are solutions of the same equations


def measure(bench: Workbench, large: bool = False) -> dict:
    """Ratios of time and memory at every size; median seconds and MiB for the picture.

    Raises RuntimeError where the suite without contact and the script move otherwise.
    """
    measured = {}
    for scene, without in CASES.items():
        for element in ELEMENTS:
            place = bench.folder / "geometry"
            mesh_size = 1.0
            curves = measured[f"{scene}, {element}"] = {
                name: [] for name in ("dofs", "driver", "direct", "driver_mib", "direct_mib")}
            for wanted in (*SIZES, *[LARGE] * large):
                mesh_size, dofs = size(scene, element, wanted, place, mesh_size)
                if wanted == SIZES[0]:
                    off = difference(scene, element, mesh_size, place)
                    if not off <= AGREE:
                        raise RuntimeError(f"{scene}, {element}: displacements differ by {off:.1e}")
                _compared(bench, (scene, without, element, mesh_size, dofs), place, curves)
            shutil.rmtree(place)
    return measured


def _compared(bench: Workbench, case: tuple, place: Path, curves: dict) -> None:
    """Both processes in turn at one size."""
    scene, without, element, mesh_size, dofs = case
    words = [f"WITHOUT={','.join(without)}"] * bool(without)
    whole = driver("run", f"SCENE={scene}", f"H={mesh_size!r}", f"ELEMENT={element}",
                   f"OUT={place / 'run'}", "RESUME=no", *BARE)
    run = [*whole, *words]
    peer, options = direct.command(freefem.find_scene(scene), element, mesh_size, place / "direct")
    peak = {"driver": [], "direct": []}

    def taken(name: str, command: list[str], **given) -> float:
        spent, memory = child(command, **given)
        if name == "driver":  # on several ranks those together
            summary = json.loads((place / "run" / "summary.json").read_text())
            memory = max(memory, summary["memory_mib"])
        peak[name].append(memory)
        return spent

    ways = {"driver": lambda: taken("driver", run),
            "direct": lambda: taken("direct", peer, **options)}
    if "quasistatic" in without:
        ways["history"] = lambda: child(whole)[0]
    times = in_turn(ways, REPEATS if dofs < ONCE else 1)
    title = f"{scene}, {element}, {dofs} dofs"
    curves["dofs"].append(dofs)
    if "history" in times:
        spent = times.pop("history")
        bench.add(f"{title}: history over direct", ratios(spent, times["direct"]), "", HISTORY)
    for name, values in times.items():
        bench.add(f"{title}: {name}", values, "s")
        curves[name].append(median(values))
        curves[f"{name}_mib"].append(bench.add(f"{title}: {name}", peak[name], "MiB"))
    bench.add(f"{title}: time over direct", ratios(times["driver"], times["direct"]), "", TARGET)
    memory = ratios(peak["driver"], peak["direct"])
    bench.add(f"{title}: memory over direct", memory, "", TARGET)


def size(scene: str, element: str, wanted: int, place: Path, guess: float) -> tuple[float, int]:
    """Element size H with which the body has about `wanted` dofs, and their number.

    Raises RuntimeError if the scene's mesh does not follow H.
    """
    for _ in range(10):
        command, options = direct.command(freefem.find_scene(scene), element, guess,
                                          place / "direct", "-count", "1")
        done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
        counted = re.search(r"^dofs (\d+)", done.stdout, re.MULTILINE)
        if not counted:
            raise RuntimeError(f"{scene}: {' '.join(done.stdout.split())[-300:]}")
        dofs = int(counted[1])
        if abs(dofs / wanted - 1) <= NEAR:
            return guess, dofs
        guess = float(f"{guess * (dofs / wanted) ** 0.5:.4g}")
    raise RuntimeError(f"{scene}: no H gives about {wanted} dofs")


def difference(scene: str, element: str, mesh_size: float, place: Path) -> float:
    """Largest difference of displacements of the vertices, suite without contact and script.

    Over the largest displacement; infinite where their meshes differ.
    """
    out, written = place / "run", place / "displacement.txt"
    child(driver("run", f"SCENE={scene}", f"H={mesh_size!r}", f"ELEMENT={element}", f"OUT={out}",
                 "RESUME=no", f"WITHOUT={','.join(('contact', *CASES[scene]))}", "ERRORS=no",
                 "FIGURES=no", "QUIET=yes"))
    command, options = direct.command(freefem.find_scene(scene), element, mesh_size,
                                      place / "direct", "-written", str(written))
    child(command, **options)
    mesh = read_mesh(field_files(out)[-1][1], 0.0)
    corners = np.unique(mesh.corners)
    ours = np.unique(np.column_stack([mesh.xy, mesh.displacement])[corners].round(15), axis=0)
    theirs = np.loadtxt(written)
    return _apart(ours, theirs)


def _apart(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference of displacements in tables (n, 4) x, y, u_x, u_y, over the largest."""
    from scipy.spatial import cKDTree

    extent = np.ptp(theirs[:, :2], axis=0).max()
    distance, place = cKDTree(ours[:, :2]).query(theirs[:, :2])
    if distance.max() > 1e-9 * extent:
        return np.inf
    return float(np.abs(ours[place, 2:] - theirs[:, 2:]).max() / np.abs(theirs[:, 2:]).max())
