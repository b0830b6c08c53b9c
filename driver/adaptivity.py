"""Adaptive refinement: from an error indicator on one mesh to the element sizes of the next.

The energy error of a linear triangle falls like the square of its size h (once for the strain, once for the root of its
area): eta -> eta (h_new/h)^2. A mesh of given accuracy has the fewest triangles when all carry the same error c
(Zienkiewicz, Zhu: Int. J. Numer. Meth. Engng 24, 1987; Diez, Huerta: CMAME 177, 1999), so

    h_new = h sqrt(c/eta),   number of new triangles = sum of (h/h_new)^2 = sum of eta / c,

and c follows from the number of triangles that is wanted. edp/lib/adapt.idp and gmsh.idp make the mesh.
"""

import csv
import json
from pathlib import Path

import numpy as np

STEM = "size"  # of the files of a size field, see write_sizes
GROWTH = 4.0  # triangles of one cycle's mesh over those of the one before: half the error on a well graded mesh
STEEPEST = 0.5  # difference of sizes over distance: neighbours must not differ too much
SMALLEST, LARGEST = 0.125, 2.0  # new size over old in one cycle: an indicator does not see further


def element_sizes(xy: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n_t,) side of the equilateral triangle of the same area."""
    a, b, c = (xy[triangles[:, k]] for k in range(3))
    double = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return np.sqrt(2 / np.sqrt(3) * double)


def new_sizes(size: np.ndarray, indicator: np.ndarray, wanted: float) -> np.ndarray:
    """(n_t,) sizes that spread the error evenly over about `wanted` triangles.

    `size` (n_t,) of the present triangles, `indicator` (n_t,) energy error of each, not squared. Triangles that meet
    a limit leave fewer or more for the others, which the repetition makes up for.
    """
    if not indicator.any():
        return size * np.sqrt(len(size) / wanted)
    level = indicator.sum() / wanted
    for _ in range(20):
        ratio = np.clip(np.sqrt(level / np.maximum(indicator, 1e-300)), SMALLEST, LARGEST)
        level *= (ratio**-2).sum() / wanted
    return size * ratio


def nodal_sizes(xy: np.ndarray, triangles: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(n_v,) sizes at the vertices: geometric mean over the triangles around, then cut to the steepest slope."""
    corners = triangles.ravel()
    count = np.bincount(corners, minlength=len(xy))
    nodal = np.exp(np.bincount(corners, np.repeat(np.log(size), 3), minlength=len(xy)) / np.maximum(count, 1))
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    rise = STEEPEST * np.linalg.norm(xy[start] - xy[end], axis=1)
    for _ in range(len(xy)):
        before = nodal.copy()
        np.minimum.at(nodal, start, before[end] + rise)
        np.minimum.at(nodal, end, before[start] + rise)
        if np.array_equal(before, nodal):
            return nodal
    return nodal


def write_sizes(stem: Path, xy: np.ndarray, triangles: np.ndarray, edges: np.ndarray, size: np.ndarray) -> None:
    """The three files of a size field (n_v,) that edp/lib/adapt.idp names; `edges` (n_e, 2) of the outline."""
    zero = lambda rows: np.zeros(len(rows), np.int64)
    with open(f"{stem}.msh", "w") as file:
        file.write(f"{len(xy)} {len(triangles)} {len(edges)}\n")
        np.savetxt(file, np.column_stack([xy, zero(xy)]), fmt="%.17g %.17g %d")
        np.savetxt(file, np.column_stack([triangles + 1, zero(triangles)]), fmt="%d")
        np.savetxt(file, np.column_stack([edges + 1, zero(edges) + 1]), fmt="%d")
    with open(f"{stem}.bin", "wb") as file:
        file.write(np.int64(len(size)).tobytes() + np.ascontiguousarray(size, float).tobytes())
    corner = np.concatenate([xy, zero(xy)[:, None]], axis=1)[triangles].reshape(-1, 9)
    with open(f"{stem}.pos", "w") as file:
        file.write('View "size" {\n')
        np.savetxt(file, np.column_stack([corner, size[triangles]]),
                   fmt=f"ST({','.join(['%.17g'] * 9)}){{%.17g,%.17g,%.17g}};")
        file.write("};\n")


# ---- what a run tells of its cycles ------------------------------------------------------------------

def seconds(place: Path) -> float:
    """Seconds that the cycle in directory `place` took."""
    spent = _summary(place)["seconds"]
    return spent["total"] - spent.get("adaptation", 0.0)


def describe(place: Path) -> str:
    """One line about a finished cycle."""
    row = _row(0, place)
    return ", ".join([f"{row['primal_dofs']} primal dofs", f"error indicator {row['indicator']:.3g}", f"{row['seconds']:.2f} s"])


def report(work: Path, cycles: list[Path]) -> None:
    """Write adaptivity.csv, a row for every cycle and one for the run itself in `work`; complete its summary."""
    from .results import write_json  # starts MPI, which commands without a solver do without

    rows = [_row(k, place) for k, place in enumerate([*cycles, work])]
    with open(work / "adaptivity.csv", "w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    summary = _summary(work)
    summary["adaptivity"] = {"cycles": len(cycles), "primal_dofs": [row["primal_dofs"] for row in rows],
                             "indicator": [row["indicator"] for row in rows]}
    write_json(work / "summary.json", summary)
    for path in work.glob(f"{STEM}.*"):
        path.unlink()


def _summary(place: Path) -> dict:
    return json.loads((place / "summary.json").read_text())


def _row(cycle: int, place: Path) -> dict:
    summary = _summary(place)
    return {"cycle": cycle, "subdomains": summary["sizes"]["subdomains"], "primal_dofs": summary["sizes"]["primal_dofs"],
            "indicator": summary.get("indicator"), "seconds": round(seconds(place), 3), **summary["quantities"]}


class Recovery:
    """Error indicator by recovered stresses (Zienkiewicz, Zhu 1987), the mean over the steps; collective."""

    def __init__(self, structure, manifest, comm):
        self.structure, self.comm, self.steps = structure, comm, 0
        subs = structure.subdomains
        parts = comm.allgather([(s.vertex_gid, s.xy, s.vertex_gid[s.triangles],
                                 s.vertex_gid[s.edges[s.edge_label != manifest.interface_label]]) for s in subs])
        parts = [p for part in parts for p in part]
        self.xy = np.zeros((manifest.vertices, 2))
        for gid, xy, _, _ in parts:
            self.xy[gid] = xy
        self.triangles, self.edges = (np.concatenate([p[k] for p in parts]) for k in (2, 3))
        self.square = np.zeros(len(self.triangles))

    def add(self, step, fields):
        from .results import stresses

        gather = lambda arrays: np.concatenate(sum(self.comm.allgather(arrays), []))
        subs = self.structure.subdomains
        sigma = gather([stresses(s, u, step.weights)[0] for s, u in zip(subs, fields)])
        compliance = np.linalg.inv(gather([s.elasticity for s in subs]))
        area = np.sqrt(3) / 4 * element_sizes(self.xy, self.triangles) ** 2
        total, smooth = np.zeros(len(self.xy)), np.zeros((len(self.xy), 3))
        np.add.at(total, self.triangles.ravel(), np.repeat(area, 3))
        np.add.at(smooth, self.triangles.ravel(), np.repeat(area[:, None] * sigma, 3, axis=0))
        smooth /= total[:, None]
        corner = smooth[self.triangles] - sigma[:, None]
        middle = 0.5 * (corner + np.roll(corner, 1, axis=1))
        self.square += np.einsum("tqi,tij,tqj,t->t", middle, compliance, middle, area / 3)
        self.steps += 1

    def close(self, directory, growth=GROWTH):
        eta = np.sqrt(self.square / self.steps)
        size = new_sizes(element_sizes(self.xy, self.triangles), eta, growth * len(eta))
        write_sizes(directory / STEM, self.xy, self.triangles, self.edges, nodal_sizes(self.xy, self.triangles, size))
        return float(np.sqrt((eta**2).sum()))
