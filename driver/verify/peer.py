"""Cases solved by GetFEM too, on the mesh of our run: contact forces node by node."""

import functools
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import DriverError
from ..scene import sides

SIDES = [[0, 1, 3], [1, 2, 4], [2, 0, 5]]  # of a quadratic triangle in VTK's order
SAME = 1e-6  # of the largest force: the same discrete problem, so tolerances alone are between them
NOTE = "GetFEM is not installed (apt package python3-getfem): not compared with it"


@dataclass(frozen=True)
class Peer:
    """A body on a rigid obstacle as GetFEM is told of it: E, nu and supports of the nodes.

    `supports` are (where(x), component, displacement), the last a number or one for each step of
    the run, and before them one for the step without friction if there is a `preload`.
    """

    E: float
    nu: float
    supports: tuple[tuple[Callable, int, object], ...]
    friction: float | None = None
    preload: bool = False


@functools.cache
def installed() -> bool:
    """Whether GetFEM can be imported."""
    return subprocess.run([sys.executable, "-c", "import getfem"], capture_output=True,
                          check=False).returncode == 0


def difference(view, peer: Peer, folder: Path) -> float:
    """Largest difference of a node's contact force from GetFEM's, over the largest force.

    Of normal and tangential forces after the last step. Raises DriverError where GetFEM does not
    solve.
    """
    fields = view.result.fields(0)
    x, steps = fields.nodes, view.result.summary["steps"] + peer.preload
    rows = [(node, component, np.broadcast_to(value, steps))
            for where, component, value in peer.supports for node in np.flatnonzero(where(x))]
    place = np.column_stack([view["x"], view["y"]])
    contact = np.array([np.hypot(*(x - node).T).argmin() for node in place])
    cells = fields.elements
    quadratic = cells.shape[1] == 6
    if not (quadratic and sides.are_curved(x[cells[:, SIDES].reshape(-1, 3)])):
        cells = fields.triangles
    problem, out = folder / "peer.npz", folder / "getfem.npz"
    np.savez(problem, nodes=x, triangles=cells, E=peer.E, nu=peer.nu,
             fixed=[row[:2] for row in rows], displacements=[row[2] for row in rows],
             order=1 + quadratic, contact=contact,
             normals=np.column_stack([view["normal_x"], view["normal_y"]]), gap=view["gap"],
             rough=peer.friction is not None, friction=peer.friction or 0.0, preload=peer.preload)
    script = Path(__file__).with_name("getfem_peer.py")
    done = subprocess.run([sys.executable, script, problem, out], capture_output=True, text=True,
                          check=False)
    if done.returncode:
        raise DriverError(f"GetFEM failed: {done.stderr.strip().splitlines()[-1]}")
    theirs, w = np.load(out), view["weight"]
    ours = {"force": -view["sigma_n"] * w, "shear": view["sigma_t"] * w}
    largest = np.abs(ours["force"]).max()
    return float(max(np.abs(own - theirs[name]).max() for name, own in ours.items()) / largest)
