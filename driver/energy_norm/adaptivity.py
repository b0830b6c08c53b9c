"""Adaptive refinement: from an error indicator on one mesh to the element sizes of the next.

The energy error of a triangle of degree p falls like the power p + 1 of its size h (p for the
strain, once more for the root of its area): eta -> eta (h_new/h)^(p+1). A mesh of given accuracy
has the fewest triangles when all carry the same error c (Zienkiewicz, Zhu: Int. J. Numer. Meth.
Engng 24, 1987; Diez, Huerta: CMAME 177, 1999), so

    h_new = h (c/eta)^(1/(p+1)),   new triangles = sum of (h/h_new)^2 = sum of (eta/c)^(2/(p+1)),

and c follows from the number of triangles wanted. edp/lib/adapt.idp, gmsh.idp make the mesh.
"""

from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..errors import InputError
from ..scene import element_kinds, elements

GROWTH = 4.0  # triangles of one cycle's mesh over the last one's: as if sizes were halved
CONTACT_GROWTH = 3.0  # contact nodes likewise: twice by that, and kinks are places of their own
STEEPEST = 0.5  # difference of sizes over distance: neighbours must not differ too much
GENTLE = 0.15  # the same next to contact, whose tractions see the meshes behind it
SMALLEST, LARGEST = 0.125, 2.0  # new size over old in one cycle: an indicator does not see further
ROUNDING = 1e-8  # an error below this part of the solution's norm is none


def element_sizes(xy: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n_t,) side of the equilateral triangle of the same area."""
    return np.sqrt(4 / np.sqrt(3) * elements.areas(xy[triangles]))


def new_sizes(size: np.ndarray, indicator: np.ndarray, wanted: float, degree: float = 1,
              dimension: int = 2) -> np.ndarray:
    """(n_t,) sizes that spread the error evenly over about `wanted` triangles of a `degree`.

    `size` (n_t,) of the present triangles, `indicator` (n_t,) energy error of each, not squared.
    In one dimension the same with the edges of a boundary. Triangles that
    meet a limit leave fewer or more for others, for which the repetition makes up.
    """
    if not indicator.any():
        return size * (len(size) / wanted)**(1 / dimension)
    power = dimension / (degree + 1)
    level = ((indicator**power).sum() / wanted) ** (1 / power)
    for _ in range(20):
        ratio = (level / np.maximum(indicator, 1e-300)) ** (power / dimension)
        ratio = np.clip(ratio, SMALLEST, LARGEST)
        level *= ((ratio**-dimension).sum() / wanted) ** (1 / power)
    return size * ratio


def vertex_sizes(xy: np.ndarray, triangles: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(n_v,) sizes at the vertices: geometric means over their triangles."""
    corners = triangles.ravel()
    count = np.maximum(np.bincount(corners, minlength=len(xy)), 1)
    return np.exp(np.bincount(corners, np.repeat(np.log(size), 3), minlength=len(xy)) / count)


def even(xy: np.ndarray, triangles: np.ndarray, nodal: np.ndarray, slope: float) -> np.ndarray:
    """(n_v,) sizes at the vertices, lowered to a limited slope."""
    nodal = nodal.copy()
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    rise = slope * np.linalg.norm(xy[start] - xy[end], axis=1)
    for _ in range(len(xy)):
        before = nodal.copy()
        np.minimum.at(nodal, start, before[end] + rise)
        np.minimum.at(nodal, end, before[start] + rise)
        if np.array_equal(before, nodal):
            return nodal
    return nodal


def contact_sizes(boundary, states: list[dict]) -> tuple[np.ndarray, np.ndarray]:
    """(k, 2) places on the contact boundary and (k,) sizes of the next mesh there.

    What pressure and shear of `states` differ from the line between their neighbours, each as a
    part of its largest norm in L2, is spread evenly over CONTACT_GROWTH as many nodes. Where
    sticking, slipping and open parts meet tractions have kinks: the error of a node in L2 falls
    like h^(3/2). The energy of a body hardly knows them. A mesh tells the place of a kink no
    closer than its edges: neighbours are refined alike.
    """
    b, vertices = boundary, np.flatnonzero(~boundary.middle)
    before, own, after = vertices[:-2], vertices[1:-1], vertices[2:]
    inside = (b.chain[before] == b.chain[own]) & (b.chain[own] == b.chain[after])
    before, own, after = before[inside], own[inside], after[inside]
    left, right = b.arc[own] - b.arc[before], b.arc[after] - b.arc[own]
    square = np.zeros(len(b.arc))
    for name in ("sigma_n", "sigma_t"):
        largest = max((b.weight * state[name]**2).sum() for state in states)
        for t in (state[name] for state in states if largest > 0):
            line = (right * t[before] + left * t[after]) / (left + right)
            square[own] += (t[own] - line)**2 / largest
    size = (left + right) / 2
    if not square.any():
        return np.empty((0, 2)), np.empty(0)
    widest = np.max([square[before], square[own], square[after]], axis=0)
    wanted = CONTACT_GROWTH * len(own)
    return b.xy[own], new_sizes(size, np.sqrt(size * widest), wanted, 0.5, 1)


def check(reason: str) -> None:
    """Raise InputError if there is a `reason` why a run has no error in the energy norm."""
    if reason:
        raise InputError(f"ADAPT has no error to refine by: {reason}")


def next_mesh(stem: Path, estimator, estimates: list) -> None:
    """Write the sizes of the mesh that follows that of `estimator` (energy.EnergyEstimator).

    A triangle's error is that of all steps of its `estimates` together, as far as they have one; on
    the contact boundary sizes are at most those of `contact_sizes`. Raises InputError without any.
    """
    known = [e for e in estimates if not e.reason]
    check("" if known else estimates[0].reason if estimates else "nothing was estimated")
    mesh, degree = estimator.body.mesh, element_kinds.DEGREE[estimator.manifest.element]
    states = [state for _, state in estimator.considered]
    square = sum(e.indicator**2 * (e.mesh > ROUNDING * e.norm) for e in known)
    xy = np.zeros((mesh.triangles.max() + 1, 2))
    xy[mesh.triangles] = mesh.corner
    outline = mesh.edges[mesh.boundary]
    near = _near_contact(xy, mesh.triangles, np.unique(outline),
                         *contact_sizes(estimator.contact.boundary, states))
    nodal = _both(xy, mesh.triangles, np.sqrt(square), degree, near)
    write_sizes(stem, xy, mesh.triangles, outline, nodal)


def _near_contact(xy: np.ndarray, triangles: np.ndarray, rim: np.ndarray, places: np.ndarray,
                  sizes: np.ndarray) -> np.ndarray:
    """(n_v,) largest sizes at the vertices that `sizes` (k,) at `places` (k, 2) leave."""
    near = np.full(len(xy), np.inf)
    if len(places):
        from scipy.spatial import cKDTree  # of all runs that import this module few refine

        distance, place = cKDTree(places).query(xy[rim])
        near[rim] = sizes[place] + GENTLE * distance
    return even(xy, triangles, near, GENTLE)


def _both(xy: np.ndarray, triangles: np.ndarray, indicator: np.ndarray, degree: int,
          near: np.ndarray) -> np.ndarray:
    """(n_v,) sizes for the error in energy, at most `near`, on GROWTH as many triangles.

    What contact takes the bodies lack, but for a half of them.
    """
    size, wanted = element_sizes(xy, triangles), GROWTH * len(triangles)
    given = wanted
    for _ in range(5):
        own = vertex_sizes(xy, triangles, new_sizes(size, indicator, given, degree))
        nodal = np.minimum(even(xy, triangles, own, STEEPEST), near)
        count = (size**2 * (nodal[triangles]**-2.0).mean(axis=1)).sum()
        given = max(wanted / 2, given * wanted / count)
    return nodal


def write_sizes(stem: Path, xy: np.ndarray, triangles: np.ndarray, edges: np.ndarray,
                size: np.ndarray) -> None:
    """The files of a size field (n_v,) for edp/lib/adapt.idp; `edges` (n_e, 2) are the outline's.

    Bodies, which share no vertex, have files of their own: where they touch their meshes overlap.
    Their vertices come one body after the other. gmsh's file is for a body that is alone: a scene
    may mesh one of several elsewhere and move it.
    """
    ends = triangles.ravel(), np.roll(triangles, 1, axis=1).ravel()
    links = coo_matrix((np.ones(3 * len(triangles)), ends), (len(xy),) * 2)
    body = connected_components(links, directed=False)[1]
    names, first = np.unique(body, return_index=True)
    for k, name in enumerate(names[np.argsort(first)]):
        own = np.flatnonzero(body == name)
        inside, rim = (np.searchsorted(own, part[body[part[:, 0]] == name])
                       for part in (triangles, edges))
        with open(f"{stem}-{k}.msh", "w") as file:
            file.write(f"{len(own)} {len(inside)} {len(rim)}\n")
            vertices = np.column_stack([xy[own], np.zeros(len(own), int)])
            np.savetxt(file, vertices, fmt="%.17g %.17g %d")
            np.savetxt(file, np.column_stack([inside + 1, np.zeros(len(inside), int)]), fmt="%d")
            np.savetxt(file, np.column_stack([rim + 1, np.ones(len(rim), int)]), fmt="%d")
        with open(f"{stem}-{k}.bin", "wb") as file:
            file.write(np.int64(len(own)).tobytes() + size[own].astype(float).tobytes())
    if len(names) > 1:
        return
    corner = np.concatenate([xy, np.zeros((len(xy), 1))], axis=1)[triangles].reshape(-1, 9)
    with open(f"{stem}.pos", "w") as file:
        file.write('View "size" {\n')
        np.savetxt(file, np.column_stack([corner, size[triangles]]),
                   fmt=f"ST({','.join(['%.17g'] * 9)}){{%.17g,%.17g,%.17g}};")
        file.write("};\n")
