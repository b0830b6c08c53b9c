"""Classes of equal subdomains, each reduced to its rows and corners.

K_rr of a class is factorized once; its dual operator B_r K_rr^-1 B_r' and its coupling A to the
corners are explicit: in 2D these dense matrices are small and faster than triangular solves.
"""

import hashlib
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix

from ..scene.loader import Subdomain
from ..scene.symmetric import Symmetric
from .blocks import BLOCK, by_half, whole
from .cholesky import Interior
from .exchange import exchange
from .gathering import joined
from .halves import Half
from .rows import LocalRows
from .structure import Substructure
from .torn_factor import TornFactor

LEAST = 0.01  # of K's diagonal: the smallest stiffness of a corner in springs
DIGEST = 20  # bytes of a sha1
ENTRIES = 40_000  # of displacements of a class's members that are solved for at once, about
SAME = 1e-12  # stiffness entries equal to this, relative to the largest, differ by rounding only


@dataclass
class LocalClass:
    """Subdomains with equal matrices: m rows, n_r torn, n_c corner dofs; local indices `members`.

    `rows` and `corners` are the slices of the rank's stacked local rows and corner dofs that belong
    to the members, member after member.
    """

    members: list[int]
    torn: np.ndarray  # (n_r,) dofs of X^r
    corner: np.ndarray  # (n_c,) dofs of X^c
    K: Symmetric  # (dofs, dofs)
    factor: TornFactor  # of K_rr
    B_r: np.ndarray  # (m, n_r) sparse
    B_c: np.ndarray  # (m, n_c) sparse
    K_rc: np.ndarray  # (n_r, n_c) sparse
    F_kept: np.ndarray | Half  # (m, m) F = B_r K_rr^-1 B_r'
    A: np.ndarray  # (m, n_c)
    S: np.ndarray  # (n_c, n_c) local part of S_cc
    shared: bool  # BLOCK members or more on all ranks together
    kept: "Kept | None" = None  # of a subdomain whose contact rows may change
    rows: slice | None = None
    corners: slice | None = None
    schur: np.ndarray | Half | None = None  # of the Dirichlet preconditioner, once for all rows

    def __post_init__(self):
        self.A_transposed = np.ascontiguousarray(self.A.T)

    @property
    def F(self) -> np.ndarray:
        """(m, m) B_r K_rr^-1 B_r', a copy where half of it is kept."""
        return whole(self.F_kept)

    def groups(self) -> list[slice]:
        """Members that are solved for at once: few enough that their fields stay in the cache."""
        step = BLOCK * (ENTRIES // (BLOCK * self.K.shape[0]) + 1) if self.shared else 1
        return [slice(first, first + step) for first in range(0, len(self.members), step)]

    @property
    def corner_stiffness(self) -> np.ndarray:
        """(n_c,) the diagonal of S, at least LEAST of K's: S itself may give way to a corner.

        A subdomain that hangs on two corners resists none of their motions across their line.
        """
        return np.maximum(np.diag(self.S), LEAST * self.K.diagonal()[self.corner])


@dataclass
class Kept:
    """What rows that change leave as it is: K_rr^-1 (t, t) and K_rr^-1 K_rc (t, c).

    On the torn dofs t that rows may act on, `seen` (n_r,) of all.
    """

    seen: np.ndarray
    inverse: np.ndarray
    coupling: np.ndarray


def stack(classes: list[LocalClass]) -> None:
    """Stack local rows and corner dofs class by class: sets every class's `rows` and `corners`."""
    row = corner = 0
    for c in classes:
        count = len(c.members)
        c.rows = slice(row, row + count * len(c.A))
        c.corners = slice(corner, corner + count * len(c.corner))
        row, corner = c.rows.stop, c.corners.stop


def group(structure: Substructure, comm) -> list[tuple[list[int], Symmetric, bool]]:
    """Classes of subdomains with the same dof sets, rows and (to rounding) stiffness; collective.

    Returns for every class with members on this rank their local indices, the stiffness of the
    class's first subdomain, which may live on another rank, and whether it has so many members
    on all ranks together that dense products with many columns pay.
    """
    keys, patterns = [], {}
    for s, sub in enumerate(structure.subdomains):
        same = id(sub.stiffness)  # shared if found equal by the loader
        pattern = patterns.get(same) or patterns.setdefault(same, _pattern(sub.stiffness))
        keys.append(_fingerprint(structure, s, pattern))
    open_, classes = list(range(len(keys))), []
    while comm.allreduce(len(open_)):
        mine = {}
        for s in open_:
            mine.setdefault(keys[s], []).append(s)
        models = {key: structure.subdomains[members[0]].stiffness
                  for key, members in mine.items()}
        models |= _of_first(comm, models)
        open_, round_ = [], {}
        for key, candidates in mine.items():
            same = [_same(models[key], structure.subdomains[s].stiffness) for s in candidates]
            round_[key] = [s for s, ok in zip(candidates, same) if ok]
            open_ += [s for s, ok in zip(candidates, same) if not ok]
        sizes, _ = _met(comm, round_, [len(members) for members in round_.values()])
        classes += [(members, models[key], bool(size[1] >= BLOCK))
                    for (key, members), size in zip(round_.items(), sizes) if members]
        open_.sort()
    return sorted(classes, key=lambda pair: pair[0])


def _of_first(comm, models: dict[bytes, Symmetric]) -> dict[bytes, Symmetric]:
    """Of those of the rank's `models` by key that a lower rank has, that of the first.

    Those of a key have their entries in the same places. Collective over `comm`.
    """
    if comm.size == 1:
        return {}
    keys, values = list(models), [model.values for model in models.values()]
    _, others = _met(comm, keys, [1] * len(keys))
    place, to = others.T
    length = np.array([len(values[k]) for k in place], np.int64)
    _, met, length_ = exchange(comm, to, _numbers(keys)[place], length)
    _, entries = exchange(comm, np.repeat(to, length), joined((values[k] for k in place), float))
    parts = np.split(entries, np.cumsum(length_)[:-1])
    theirs = {key.tobytes()[:DIGEST]: part for key, part in zip(met, parts)}
    return {key: models[key].replaced(part) for key, part in theirs.items()}


def _met(comm, keys, counts: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """(k, 2): the first rank that has a key, and the sum of all ranks' `counts`, for distinct keys.

    And (m, 2): positions of the keys whose first rank this is, and another rank that has them. A
    rank chosen by the key brings those together that have it; collective over `comm`.
    """
    numbers = _numbers(keys)
    table = np.column_stack([numbers, counts, np.arange(len(numbers))]).astype(np.int64)
    source, met = exchange(comm, (numbers[:, 0] & 0xFFFFFF) % comm.size, table)
    order = np.lexsort((source, *met[:, :3].T))
    source, met = source[order], met[order]
    new = np.ones(len(met), bool)
    new[1:] = (met[1:, :3] != met[:-1, :3]).any(axis=1)
    first, group = np.flatnonzero(new), np.cumsum(new) - 1
    total = np.bincount(group, met[:, 3], len(first)).astype(np.int64)
    answer = np.column_stack([met[:, 4], source[first][group], total[group]])
    _, answer = exchange(comm, source, answer)
    known = np.empty((len(numbers), 2), np.int64)
    known[answer[:, 0]] = answer[:, 1:]
    pairs = np.column_stack([met[first, 4][group], source])[~new]
    return known, exchange(comm, source[first][group][~new], pairs)[1]


def _numbers(keys) -> np.ndarray:
    """(k, 3) digests as whole numbers."""
    text = b"".join(key.ljust(24, b"\0") for key in keys)
    return np.frombuffer(text, np.int64).reshape(-1, 3)


def _same(one: Symmetric, other: Symmetric) -> bool:
    """Whether two stiffnesses with entries in the same places differ by rounding only."""
    apart = 0.0 if one is other else np.abs(one.values - other.values).max()
    return bool(apart <= SAME * np.abs(one.values).max())


def _pattern(stiffness: Symmetric) -> bytes:
    """Digest that equal stiffnesses share: where entries are, and their first digits."""
    digest = hashlib.sha1(f"{np.linalg.norm(stiffness.values):.5e}".encode())
    digest.update(stiffness.row_start.tobytes())
    digest.update(stiffness.columns.tobytes())
    return digest.digest()


def _fingerprint(structure: Substructure, s: int, pattern: bytes) -> bytes:
    """Digest that equal subdomains share: dof sets, rows and the `pattern` of the stiffness."""
    rows = structure.rows[s]
    digest = hashlib.sha1(pattern)
    parts = [structure.fixed[s], structure.corner_dofs[s], rows.dof, rows.coefficient.round(13),
             structure.subdomains[s].rim]
    if structure.yields:
        parts.append(structure.own_compliance(s))
    if s in structure.renewed:  # its rows will be its own
        parts.append(np.array([structure.first + s]))
    for part in parts:
        digest.update(part.tobytes())
        digest.update(b"|")
    return digest.digest()


def reduce_class(structure: Substructure, members: list[int], K: Symmetric,
                 shared: bool, ahead: dict[int, Interior]) -> LocalClass:
    """Factorize K_rr of a class with the stiffness K and form its explicit F, A and S.

    `ahead` has interiors of subdomains that `interior_of` has eliminated before, by their numbers.
    """
    s = members[0]
    sub, corner = structure.subdomains[s], structure.corner_dofs[s]
    is_torn = np.ones(sub.dofs, bool)
    is_torn[structure.fixed[s]] = is_torn[corner] = False
    torn = np.flatnonzero(is_torn)
    B_r, B_c, K_rc = *_torn_rows(structure, s, torn), K.between(torn, corner)
    touched = np.diff(B_r.tocsc().indptr) > 0
    changes = s in structure.renewed
    if changes:
        touched |= structure.may_move(s)[torn]
    nodes = np.unique(torn[touched] // 2)
    known = ahead if K is sub.stiffness else {}  # a class's may be those of another rank
    interior = _interior(structure, s, K, np.union1d(nodes, corner // 2), known)
    factor = TornFactor(interior, torn, nodes, BLOCK if shared else 1)
    inverse, coupling, S = factor.reduced(corner)
    seen = factor.seen
    F, A = _of_rows(structure, s, B_r[:, seen], B_c, inverse, coupling)
    return LocalClass(members, torn, corner, K, factor, B_r, B_c, K_rc, by_half(F, shared), A, S,
                      shared, Kept(seen, inverse, coupling) if changes else None)


def interior_of(sub: Subdomain) -> Interior:
    """The interior of a subdomain, eliminated, by what its own record says of its rim.

    Raises NoSolution if the stiffness is not positive definite there.
    """
    return Interior(sub.stiffness, sub.rim, _free(sub.dofs, sub.fixed))


def _interior(structure: Substructure, s: int, K: Symmetric, needed: np.ndarray,
              ahead: dict) -> Interior:
    """The interior of local subdomain s with the stiffness K, the nodes `needed` (n,) in its rim.

    By what its own record says of both, unless other subdomains or effects add to it: so the bits
    are the same whether it was eliminated `ahead` or is now.
    """
    sub = structure.subdomains[s]
    known = ahead.pop(sub.index, None)
    own, free = _free(sub.dofs, sub.fixed), _free(sub.dofs, structure.fixed[s])
    inner = np.ones(sub.dofs, bool)
    inner[2 * sub.rim] = inner[2 * sub.rim + 1] = False
    if np.array_equal(free[inner], own[inner]) and np.isin(needed, sub.rim).all():
        return known or Interior(K, sub.rim, own)
    del known  # before another one is made
    return Interior(K, np.union1d(sub.rim, needed), free)


def _free(dofs: int, fixed: np.ndarray) -> np.ndarray:
    """(dofs,) marks those that are not `fixed`."""
    free = np.ones(dofs, bool)
    free[fixed] = False
    return free


def renew_rows(structure: Substructure, c: LocalClass) -> tuple[np.ndarray, np.ndarray]:
    """F (m, m) and A (m, n_c) of a class with the present rows of its only member.

    Its B_r and B_c are renewed, the factor stays.
    """
    s, kept = c.members[0], c.kept
    c.B_r, c.B_c = _torn_rows(structure, s, c.torn)
    c.schur = None
    return _of_rows(structure, s, c.B_r[:, kept.seen], c.B_c, kept.inverse, kept.coupling)


def _torn_rows(structure: Substructure, s: int, torn: np.ndarray):
    """B_r and B_c of local subdomain s as scipy CSR."""
    B = constraint_matrix(structure.rows[s], structure.subdomains[s].dofs)
    return B[:, torn], B[:, structure.corner_dofs[s]]


def _of_rows(structure: Substructure, s: int, B_t, B_c, inverse, coupling):
    """F and A of local subdomain s by its rows on the dofs t of `inverse`, and on corners."""
    F = B_t @ (B_t @ inverse).T
    if structure.yields:
        F[np.diag_indices_from(F)] += structure.own_compliance(s)
    return (F + F.T) / 2, B_c.toarray() - B_t @ coupling


def constraint_matrix(rows: LocalRows, dofs: int):
    """Unsigned rows of B on one subdomain as scipy CSR, shape (m, dofs)."""
    m, w = rows.dof.shape
    entries = rows.coefficient.ravel(), (np.repeat(np.arange(m), w), rows.dof.ravel())
    return coo_matrix(entries, shape=(m, dofs)).tocsr()
