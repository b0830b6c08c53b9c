"""The FETI-DP saddle-point matrix of the slides, assembled as a whole for a small case.

With torn dofs r, corner dofs c and multipliers lambda = (lambda_gluing, lambda_nu, lambda_T) it is

    [ K_rr  K_rc  B_r' ]        K_rr block diagonal, one block a subdomain,
    [ K_cr  K_cc  B_c' ]        K_cc assembled at the corners,
    [ B_r   B_c   0    ]

without the dofs that the supports fix. Nothing in a run uses it: it shows the structure, and its
Schur complement -F onto the multipliers checks the operator of feti/operator.py.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import mmwrite
from scipy.sparse import coo_matrix, csr_matrix

from ..errors import InputError
from ..feti.reduction import constraint_matrix
from ..feti.rows import RowKind
from ..feti.structure import Substructure
from ..files import renamed, write_json
from ..march.tearing import build
from ..runs.guard import study_folder
from ..scene import freefem
from ..scene.loader import read_subdomains

LARGEST = 20_000  # unknowns; a picture of more shows nothing


@dataclass
class Saddle:
    """Saddle-point matrix (n, n) and the ends of its blocks.

    `torn` are the ends of the subdomains' blocks of K_rr, `corners` is the end of the corner dofs,
    `kinds` the ends of the gluing, normal and tangential multipliers; `rows` (dual_dofs,) is the
    dual row of every multiplier in the order of the matrix.
    """

    matrix: csr_matrix
    torn: np.ndarray
    corners: int
    kinds: np.ndarray
    rows: np.ndarray


def saddle(structure: Substructure) -> Saddle:
    """Assemble the saddle-point matrix of a structure that is whole on this rank."""
    rows = np.argsort(structure.row_kind, kind="stable")
    position = np.empty_like(rows)
    position[rows] = np.arange(len(rows))
    numbers, end, torn = [], 0, []
    for sub, fixed, corner in zip(structure.subdomains, structure.fixed, structure.corner_dofs):
        number = np.zeros(sub.dofs, np.int64)
        number[fixed] = number[corner] = -1
        free = number == 0
        number[free] = end + np.arange(free.sum())
        end += free.sum()
        torn.append(end)
        numbers.append(number)
    for number, corner, coarse in zip(numbers, structure.corner_dofs, structure.corner_global):
        number[corner] = end + coarse
    corners = end + structure.coarse_dofs
    parts = []
    for sub, number, local in zip(structure.subdomains, numbers, structure.rows):
        i, j, value = sub.stiffness.entries()
        i, j = number[i], number[j]
        free = (i >= 0) & (j >= 0)
        parts.append((i[free], j[free], value[free]))
        B = constraint_matrix(local, sub.dofs).tocoo()
        value = B.data * local.sign[B.row]
        free = (value != 0) & (number[B.col] >= 0)
        i, j = corners + position[local.row[B.row[free]]], number[B.col[free]]
        parts += [(i, j, value[free]), (j, i, value[free])]
    i, j, value = (np.concatenate(column) for column in zip(*parts))
    size = corners + structure.dual_dofs
    kinds = corners + np.cumsum(np.bincount(structure.row_kind, minlength=RowKind.COUNT))
    return Saddle(coo_matrix((value, (i, j)), shape=(size, size)).tocsr(), np.array(torn), corners,
                  kinds, rows)


def read_structure(scene: Path, parameters: dict[str, str], comm) -> Substructure:
    """Export a scene to a temporary directory and build its skeleton on `comm` (of one rank)."""
    with tempfile.TemporaryDirectory() as directory:
        manifest = freefem.export(scene, Path(directory) / "export", parameters)
        return build(manifest, read_subdomains(manifest, 0, manifest.subdomains, comm), 0, comm)


def write_saddle(scene: Path, parameters: dict[str, str], folder: Path, comm) -> list[Path]:
    """Write saddle.mtx, saddle.json with the ends of its blocks and a picture; the files.

    Raises InputError if it is too large.
    """
    from ..figures.saddle import draw

    folder = study_folder(folder, "saddle")
    structure = read_structure(scene, parameters, comm)
    size = structure.primal_dofs + structure.dual_dofs
    if size > LARGEST:
        raise InputError(f"the saddle-point matrix would have about {size:,} unknowns, more than "
                         f"the {LARGEST:,} that a picture can show; take fewer SUBDOMAINS or CELLS")
    whole = saddle(structure)
    path = folder / "saddle.mtx"
    comment = (f" FETI-DP saddle-point matrix of {scene.name}: {whole.torn[-1]} torn dofs of "
               f"{len(whole.torn)} subdomains, {structure.coarse_dofs} corner dofs,\n gluing, "
               f"normal, tangential multipliers end at {whole.kinds.tolist()}")
    with renamed(path) as hidden:
        mmwrite(str(hidden), whole.matrix, comment=comment, precision=17, symmetry="symmetric")
    write_json(folder / "saddle.json", {"torn": whole.torn.tolist(), "corners": int(whole.corners),
                                        "kinds": whole.kinds.tolist()})
    return [path, *draw(folder)]
