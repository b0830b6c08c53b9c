"""A large coarse problem, factorized by nested dissection of its subdomains over the ranks.

Subdomains are halved by their places, again and again, into groups. A rank eliminates the dofs i
inside each of its groups, which no other group has, and leaves it as one element on its boundary b,

    S_b = K_bb - K_bi K_ii^-1 K_ib,     f_b - W' f_i,     u_i = K_ii^-1 f_i - W u_b,

W = K_ii^-1 K_ib. Groups of these, and so on, until one is left. How subdomains are grouped follows
from their places alone, and a group's arithmetic is that of one rank: results do not depend on how
many there are. (George, SIAM J. Numer. Anal. 10 (1973); Przemieniecki, AIAA J. 1 (1963), for
substructures.)
"""

import numpy as np
from scipy.linalg import lapack

from ..errors import NoSolution, agree
from .cholesky import SINGULAR, mirrored
from .exchange import Route, exchange
from .gathering import gather, joined

GROUP = 64  # at most so many subdomains make a group
MERGED = 2  # times that groups are halved from one level to the next: 4 make one


def grouped(places: np.ndarray, comm) -> tuple[np.ndarray, int]:
    """Group (n,) of every element of the rank by its place (n, 2), and how often all were halved.

    Groups g and g ^ 1 come from one half, as do those with equal g >> k for any k. Collective.
    """
    group, depth = halved(gather(comm, places), GROUP)
    first = sum(comm.allgather(len(places))[: comm.rank])
    return group[first : first + len(places)], depth


def halved(places: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """Group (n,) of every element by its place (n, 2), of `most` each, and how often all were
    halved.
    """
    depth = max(0, int(np.ceil(np.log2(max(len(places), 1) / most))))
    group, parts = np.zeros(len(places), np.int64), [np.arange(len(places))]
    for _ in range(depth):
        halves = []
        for part in parts:
            xy = places[part]
            axis = int(np.ptp(xy, axis=0).argmax()) if len(part) else 0
            order, middle = np.argsort(xy[:, axis], kind="stable"), len(part) // 2
            halves += [np.sort(part[order[:middle]]), np.sort(part[order[middle:]])]
        parts = halves
    for number, part in enumerate(parts):
        group[part] = number
    return group, depth


def middles(structure) -> np.ndarray:
    """(subdomains, 2) the middle of each of the rank's subdomains."""
    return np.reshape([(sub.xy.min(axis=0) + sub.xy.max(axis=0)) / 2
                       for sub in structure.subdomains], (-1, 2))


class Dissection:
    """The factor of a matrix that is a sum over elements; collective over `comm`.

    `top` are the dofs that stay to the last, `inverse` their part (k, k) of the inverse, on every
    rank. `entries` is how many numbers this rank keeps, `received` how many it receives for a
    solution, in so many `messages`.
    """

    def __init__(self, comm, elements: "Elements", depth: int, kept: np.ndarray, pins: np.ndarray):
        """`kept` and `pins` (dofs,) mark dofs that stay to the last, and such that do not move.

        Raises NoSolution where the matrix is singular.
        """
        self.levels = [Level(comm, elements, 2**depth, kept, pins)]
        while depth:
            merged, elements = min(MERGED, depth), self.levels[-1].left
            elements.group, depth = elements.group >> merged, depth - merged
            self.levels.append(Level(comm, elements, 2**depth, kept, pins))
        self._root, last, error, inverse = comm.rank == 0, self.levels[-1].left, None, None
        if self._root:  # the last group is here
            try:
                inverse, *_ = _eliminated(last.matrices.reshape([len(last.numbers)] * 2),
                                          len(last.numbers))
                still = pins[last.numbers]
                inverse[still] = inverse[:, still] = 0.0
            except NoSolution as problem:
                error = problem
        agree(comm, error)
        self.top, self.inverse = comm.bcast((last.numbers, inverse))
        self.entries = sum(level.entries for level in self.levels) + self.inverse.size
        self.received = sum(2 * level.route.size for level in self.levels)
        self.messages = sum(2 * level.route.neighbours for level in self.levels)

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Displacements (n,) of the elements' dofs under their `forces` (n,), added up."""
        inner = []
        for level in self.levels:
            forces, own = level.condense(forces)
            inner.append(own)
        u = self.inverse @ forces if self._root else forces
        for level, own in zip(reversed(self.levels), reversed(inner)):
            u = level.expand(u, own)
        return u


class Elements:
    """The rank's elements: `numbers` of their dofs one after the other, `sizes` (m,), `group` (m,).

    `matrices` are theirs, row by row, one after the other. In the order of subdomains.
    """

    def __init__(self, numbers: np.ndarray, sizes: np.ndarray, group: np.ndarray,
                 matrices: np.ndarray):
        self.numbers, self.sizes, self.group, self.matrices = numbers, sizes, group, matrices


class Level:
    """Groups of elements on their ranks, those dofs eliminated that no other group has.

    `left` are the groups as elements on their boundaries.
    """

    def __init__(self, comm, elements: Elements, groups: int, kept: np.ndarray, pins: np.ndarray):
        to, sizes = elements.group * comm.size // groups, elements.sizes
        self.route = Route(comm, np.repeat(to, sizes))
        numbers = self.route.forward(elements.numbers)
        _, sizes, group = exchange(comm, to, sizes, elements.group)
        _, matrices = exchange(comm, np.repeat(to, elements.sizes**2), elements.matrices)
        present, group = np.unique(group, return_inverse=True)
        dofs = len(kept)
        key, place = np.unique(np.repeat(group, sizes) * dofs + numbers, return_inverse=True)
        of, number = np.divmod(key, dofs)
        count, everywhere = np.bincount(number, minlength=dofs), np.empty(dofs, np.int64)
        comm.Allreduce(count, everywhere)
        outer = (everywhere[number] > 1) | kept[number]
        order = np.lexsort((number, outer, of))  # inner dofs of a group before those around it
        position = np.empty_like(order)
        position[order] = np.arange(len(order))
        self._place, of, number, outer = position[place], of[order], number[order], outer[order]
        first = np.searchsorted(of, np.arange(len(present) + 1))
        middle = first[:-1] + np.bincount(of[~outer], minlength=len(present))
        self._outer, self._inner = np.flatnonzero(outer), np.flatnonzero(~outer)
        self._size, self._groups, error, left = len(order), [], None, []
        boundary = np.searchsorted(self._outer, first)
        for g, assembled in enumerate(_grouped(self._place, sizes, matrices, group, first)):
            fixed = pins[number[first[g] : first[g + 1]]]
            stiffest = assembled.diagonal().max(initial=0.0) or 1.0
            assembled[fixed] = assembled[:, fixed] = 0.0
            assembled[fixed, fixed] = stiffest
            try:
                inverse, W, S = _eliminated(assembled, middle[g] - first[g])
            except NoSolution as problem:
                error = problem
                break
            self._groups.append((slice(first[g], middle[g]), slice(middle[g], first[g + 1]),
                                 slice(boundary[g], boundary[g + 1]), inverse, W))
            left.append(S.ravel())
        agree(comm, error)
        self.entries = sum(inverse.size + W.size for *_, inverse, W in self._groups)
        self.left = Elements(number[outer], first[1:] - middle, present, joined(left, float))

    def condense(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces on the groups' boundaries for those (n,) on the elements, and on inner dofs."""
        total = np.bincount(self._place, self.route.forward(forces), minlength=self._size)
        total = total.astype(float, copy=False)
        for inner, outer, _, _, W in self._groups:
            total[outer] -= total[inner] @ W
        return total[self._outer], total

    def expand(self, u: np.ndarray, total: np.ndarray) -> np.ndarray:
        """Displacements (n,) of the elements' dofs for those of the groups' boundaries."""
        whole = np.empty(self._size)
        whole[self._outer] = u
        for inner, _, boundary, inverse, W in self._groups:
            whole[inner] = inverse @ total[inner] - W @ u[boundary]
        return self.route.backward(whole[self._place])


def _grouped(place: np.ndarray, sizes: np.ndarray, matrices: np.ndarray, group: np.ndarray,
             first: np.ndarray):
    """Sums (n, n) of the elements of every group, in their order."""
    start, begin = np.cumsum(sizes) - sizes, np.cumsum(sizes**2) - sizes**2
    order = np.argsort(group, kind="stable")
    ends = np.searchsorted(group[order], np.arange(len(first)))
    for g, (one, other) in enumerate(zip(ends, ends[1:])):
        n, cells, values = first[g + 1] - first[g], [], []
        for e in order[one:other]:
            p = place[start[e] : start[e] + sizes[e]] - first[g]
            cells.append((p[:, None] * n + p).ravel())
            values.append(matrices[begin[e] : begin[e] + sizes[e] ** 2])
        yield np.bincount(np.concatenate(cells), np.concatenate(values), n * n).reshape(n, n)


def _eliminated(K: np.ndarray, inner: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K_ii^-1, W and S_b of K (n, n), its first dofs being the inner ones. Raises NoSolution."""
    if not inner:
        return np.empty((0, 0)), np.empty((0, len(K))), K
    diagonal = K.diagonal()[:inner].copy()
    L, failed = lapack.dpotrf(K[:inner, :inner], lower=True)
    pivots = L.diagonal() ** 2
    if failed or not np.all(pivots > inner * np.finfo(float).eps * diagonal):
        raise NoSolution(f"the coarse problem's {SINGULAR}")
    W, _ = lapack.dpotrs(L, K[:inner, inner:], lower=True) if inner < len(K) else (
        np.empty((inner, 0)), 0)
    inverse = mirrored(lapack.dpotri(L, lower=True)[0])
    S = K[inner:, inner:] - K[inner:, :inner] @ W
    return inverse, np.ascontiguousarray(W), (S + S.T) / 2
