"""Cases solved by GetFEM too, on the mesh of our run: contact forces node by node."""

import functools
import subprocess
import sys
from pathlib import Path

import numpy as np

from ..errors import DriverError

SAME = 1e-6  # of the largest force: the same discrete problem, so tolerances alone are between them
NOTE = "GetFEM is not installed (apt package python3-getfem): not compared with it"


@functools.cache
def installed() -> bool:
    """Whether GetFEM can be imported."""
    return subprocess.run([sys.executable, "-c", "import getfem"], capture_output=True,
                          check=False).returncode == 0


def difference(view, peer, folder: Path) -> float:
    """Largest difference of a node's contact force from GetFEM's, over the largest force.

    `peer` gives E, nu and supports of the nodes: (where(x), component, displacement). Raises
    DriverError where GetFEM does not solve.
    """
    fields, (E, nu, supports) = view.result.fields(0), peer(view)
    x = fields.nodes
    fixed = [(node, component, value) for where, component, value in supports
             for node in np.flatnonzero(where(x))]
    place = np.column_stack([view["x"], view["y"]])
    contact = np.array([np.hypot(*(x - node).T).argmin() for node in place])
    normals = np.column_stack([view["normal_x"], view["normal_y"]])
    problem, out = folder / "peer.npz", folder / "getfem.npz"
    np.savez(problem, nodes=x, triangles=fields.triangles, E=E, nu=nu, fixed=fixed,
             order=2 if fields.elements.shape[1] == 6 else 1, contact=contact, normals=normals,
             gap=view["gap"])
    script = Path(__file__).with_name("getfem_peer.py")
    done = subprocess.run([sys.executable, script, problem, out], capture_output=True, text=True,
                          check=False)
    if done.returncode:
        raise DriverError(f"GetFEM failed: {done.stderr.strip().splitlines()[-1]}")
    ours = -view["sigma_n"] * view["weight"]
    return float(np.abs(ours - np.load(out)["force"]).max() / np.abs(ours).max())
