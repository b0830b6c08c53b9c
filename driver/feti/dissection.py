"""A large coarse problem, factorized by nested dissection of its subdomains over the ranks.

Subdomains are halved by their places, again and again, into groups. A rank eliminates the dofs i
inside each of its groups, which no other group has, and leaves it as one element on its boundary b,

    S_b = K_bb - K_bi K_ii^-1 K_ib,     f_b - W' f_i,     u_i = K_ii^-1 f_i - W u_b,

W = K_ii^-1 K_ib. Groups of these, and so on, until one is left. How subdomains are grouped follows
from their places alone, and a group's arithmetic is that of one rank: results do not depend on how
many there are. (George, SIAM J. Numer. Anal. 10 (1973); Przemieniecki, AIAA J. 1 (1963), for
substructures.)

Groups of one padded shape are multiplied by one call: there are many, and small ones.
"""

import numpy as np
from scipy.linalg import lapack

from ..errors import NoSolution, agree
from .blocks import STEP
from .cholesky import SINGULAR
from .exchange import Route, exchange
from .gathering import gather, joined
from .halves import mirrored

GROUP = 32  # at most so many subdomains make a group


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
    every = [sub.xy for sub in structure.subdomains]
    if not every:
        return np.empty((0, 2))
    first, xy = np.cumsum([0, *map(len, every[:-1])]), np.concatenate(every)
    return (np.minimum.reduceat(xy, first) + np.maximum.reduceat(xy, first)) / 2


class Dissection:
    """The factor of a matrix that is a sum over elements; collective over `comm`.

    `top` are the dofs whose part (k, k) of the inverse is asked for, `inverse`, on every rank.
    `work` are the multiplications that a solution takes of this rank, `received` is how many
    numbers it receives, in so many `messages`.
    """

    def __init__(self, comm, elements: "Elements", depth: int, kept: np.ndarray, pins: np.ndarray):
        """`kept` and `pins` (dofs,) mark dofs that are asked for, and such that do not move.

        Groups with dofs that are asked for are eliminated once more, without these dofs, which stay
        to the last there: their part of the inverse is that of what is left. Raises NoSolution
        where the matrix is singular.
        """
        self.levels, none = [], np.zeros_like(kept)
        asked = elements.of_groups(comm, elements.group[elements.have(kept)])
        while True:
            level = Level(comm, elements, 2**depth, none, pins)
            beside = Level(comm, asked, 2**depth, kept, pins, level.shared)
            self.levels.append(level)
            if not depth:
                break
            elements, depth = level.left.in_pairs(), depth - 1
            asked = elements.replaced(comm, beside.left.in_pairs())
        self.top, self.inverse = _inverse(comm, beside.left, pins)
        self.work = sum(level.work for level in self.levels)
        self.received = sum(2 * level.route.size for level in self.levels)
        self.messages = sum(2 * level.route.neighbours for level in self.levels)

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Displacements (n,) of the elements' dofs under their `forces` (n,), added up."""
        inner = []
        for level in self.levels:
            forces, own = level.condense(forces)
            inner.append(own)
        u = forces  # nothing is left
        for level, own in zip(reversed(self.levels), reversed(inner)):
            u = level.expand(u, own)
        return u


class Elements:
    """The rank's elements: `numbers` of their dofs one after the other, `sizes` (m,), `group` (m,).

    `matrices` are theirs, row by row, one after the other. In the order of subdomains, or of groups
    that are elements of the next level: then `own` (m,) are their numbers.
    """

    def __init__(self, numbers: np.ndarray, sizes: np.ndarray, group: np.ndarray,
                 matrices: np.ndarray, own: np.ndarray | None = None):
        self.numbers, self.sizes, self.group, self.matrices = numbers, sizes, group, matrices
        self.own = own

    def in_pairs(self) -> "Elements":
        """The same as elements of the next level, two to a group."""
        return Elements(self.numbers, self.sizes, self.group >> 1, self.matrices, self.group)

    def have(self, marked: np.ndarray) -> np.ndarray:
        """(m,) whether elements have a dof that is `marked` (dofs,)."""
        element = np.repeat(np.arange(len(self.sizes)), self.sizes)
        return np.bincount(element[marked[self.numbers]], minlength=len(self.sizes)) > 0

    def of_groups(self, comm, groups: np.ndarray) -> "Elements":
        """Those of the groups that any rank names; collective."""
        return self._where(np.isin(self.group, gather(comm, np.unique(groups))))

    def replaced(self, comm, others: "Elements") -> "Elements":
        """Those of the groups of `others`, with these in the place of their own; collective."""
        named = self.of_groups(comm, others.group)
        rest = named._where(~np.isin(named.own, others.own))
        both = [others, rest]
        together = Elements(*(np.concatenate([getattr(of, name) for of in both])
                              for name in ("numbers", "sizes", "group", "matrices", "own")))
        return together._picked(np.argsort(together.own, kind="stable"))

    def _where(self, chosen: np.ndarray) -> "Elements":
        return self._picked(np.flatnonzero(chosen))

    def _picked(self, order: np.ndarray) -> "Elements":
        """Some of them in another order."""
        sizes, own = self.sizes[order], None if self.own is None else self.own[order]
        return Elements(self.numbers[_stretches(self.sizes, order)], sizes, self.group[order],
                        self.matrices[_stretches(self.sizes**2, order)], own)


def _stretches(lengths: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Entries of stretches of such lengths one after the other, taken in an `order`."""
    start, lengths = (np.cumsum(lengths) - lengths)[order], lengths[order]
    within = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return np.repeat(start, lengths) + within


class Level:
    """Groups of elements on their ranks, those dofs eliminated that no other group has.

    `left` are the groups as elements on their boundaries, `shared` (dofs,) marks what more than one
    group has. Groups of one padded shape make a batch: their dofs stand one after the other, the
    inner ones of a group before those around it.
    """

    def __init__(self, comm, elements: Elements, groups: int, kept: np.ndarray, pins: np.ndarray,
                 shared: np.ndarray | None = None):
        """`kept` (dofs,) are not eliminated. `shared` if there are other groups beside these."""
        to, sizes, dofs = _holders(elements.group, groups, comm), elements.sizes, len(kept)
        self.route = Route(comm, np.repeat(to, sizes))
        numbers = self.route.forward(elements.numbers)
        _, sizes, group = exchange(comm, to, sizes, elements.group)
        _, matrices = exchange(comm, np.repeat(to, elements.sizes**2), elements.matrices)
        present, group = np.unique(group, return_inverse=True)
        key, place = np.unique(np.repeat(group, sizes) * dofs + numbers, return_inverse=True)
        of, number = np.divmod(key, dofs)
        self.shared = _shared(comm, number, dofs) if shared is None else shared
        outer = self.shared[number] | kept[number]
        self._lay_out(of, outer, len(present))
        self._place, self._outer = self._position[place], self._position[outer]
        left, error, fixed = [None] * len(present), None, np.zeros(self._size, bool)
        fixed[self._position] = pins[number]
        try:
            for b, batch in enumerate(self._batches):
                sums = self._sums(b, group, sizes, matrices)
                for g, S in zip(batch.members,
                                batch.eliminate(sums, fixed[batch.start : batch.stop])):
                    left[g] = S.ravel()
        except NoSolution as problem:
            error = problem
        agree(comm, error)
        self.left = Elements(number[outer], np.bincount(of[outer], minlength=len(present)), present,
                             joined(left, float))
        self.work = sum(batch.multiplications for batch in self._batches)

    def _lay_out(self, of: np.ndarray, outer: np.ndarray, groups: int) -> None:
        """Batches of groups, and positions of their dofs; sorted dofs are `of` groups, `outer` or
        inner.
        """
        shapes, ranks = [], np.empty(len(of), np.int64)
        for which in (~outer, outer):
            count = np.bincount(of[which], minlength=groups)
            ranks[which] = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            shapes.append(count)
        sizes = np.column_stack(shapes)  # (groups, 2) inner dofs and those around
        padded = -(-sizes // STEP) * STEP
        shapes, self._batch = np.unique(padded, axis=0, return_inverse=True)
        self._batches, self._first, end = [], np.zeros(groups, np.int64), 0
        for b, shape in enumerate(shapes):
            members = np.flatnonzero(self._batch == b)
            batch = _Batch(members, sizes[members], shape, end)
            self._first[members] = end + np.arange(len(members)) * shape.sum()
            self._batches.append(batch)
            end = batch.stop
        self._position = self._first[of] + ranks + np.where(outer, padded[of, 0], 0)
        self._size = end

    def _sums(self, b: int, group: np.ndarray, sizes: np.ndarray,
              matrices: np.ndarray) -> np.ndarray:
        """(n, m, m) sums of the elements of every group of batch b, in their order.

        `group`, `sizes` and `matrices` are those of the elements.
        """
        batch, chosen = self._batches[b], np.flatnonzero(self._batch[group] == b)
        sizes_of, m = sizes[chosen], batch.width
        place = self._place[_stretches(sizes, chosen)]
        column = (place - np.repeat(self._first[group[chosen]], sizes_of))
        row = (place - batch.start) // m * m + column  # of all groups, one after the other
        of = np.repeat(np.arange(len(chosen)), sizes_of)  # a row of the element's
        cells = np.repeat(row * m, sizes_of[of]) + column[_stretches(sizes_of, of)]
        values = matrices[_stretches(sizes**2, chosen)]
        count = len(batch.members)
        return np.bincount(cells, values, count * m * m).reshape(count, m, m)

    def condense(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces on the groups' boundaries for those (n,) on the elements, and on all dofs."""
        total = np.bincount(self._place, self.route.forward(forces), minlength=self._size)
        total = total.astype(float, copy=False)
        for batch in self._batches:
            batch.condense(total)
        return total[self._outer], total

    def expand(self, u: np.ndarray, total: np.ndarray) -> np.ndarray:
        """Displacements (n,) of the elements' dofs for those of the groups' boundaries.

        In the place of the forces that `condense` has left in `total`.
        """
        total[self._outer] = u
        for batch in self._batches:
            batch.expand(total)
        return self.route.backward(total[self._place])


class _Batch:
    """Groups of one padded shape: their dofs from `start` to `stop`, `width` of each group.

    `members` (n,) are the groups.
    """

    def __init__(self, members: np.ndarray, sizes: np.ndarray, shape: np.ndarray, start: int):
        """`sizes` (n, 2) are the numbers of inner dofs and of those around, `shape` as padded."""
        (self._inner, _), self.width = shape, int(shape.sum())
        self.members, self.start, self.stop = members, start, start + len(members) * self.width
        self._sizes = sizes
        self._solution = np.zeros((len(members), self._inner, self.width))  # [K_ii^-1, -W]

    @property
    def multiplications(self) -> int:
        """What a solution takes."""
        n, inner, width = self._solution.shape
        return n * inner * (2 * width - inner)

    def eliminate(self, sums: np.ndarray, fixed: np.ndarray) -> list[np.ndarray]:
        """S_b of every group. `fixed` dofs (of all groups) do not move. Raises NoSolution."""
        left = []
        for K, still, solution, (inner, outer) in zip(
                sums, fixed.reshape(len(sums), -1), self._solution, self._sizes):
            real = np.append(np.arange(inner), self._inner + np.arange(outer))
            K, still = K[np.ix_(real, real)], still[real]
            stiffest = K.diagonal().max(initial=0.0) or 1.0
            K[still] = K[:, still] = 0.0
            K[still, still] = stiffest
            solution[:inner, :inner], W, S = _eliminated(K, inner)
            solution[:inner, self._inner : self._inner + outer] = -W
            left.append(S)
        return left

    def condense(self, total: np.ndarray) -> None:
        """Take inner forces to the boundaries, in place."""
        own = total[self.start : self.stop].reshape(-1, self.width)
        inner, W = own[:, None, : self._inner], self._solution[:, :, self._inner :]
        own[:, self._inner :] += np.matmul(inner, W)[:, 0]

    def expand(self, total: np.ndarray) -> None:
        """Put inner displacements in the place of forces; those of the boundaries are there."""
        own = total[self.start : self.stop].reshape(-1, self.width)
        own[:, : self._inner] = np.matmul(self._solution, own[:, :, None])[:, :, 0]


def _holders(group: np.ndarray, groups: int, comm) -> np.ndarray:
    """(n,) rank of every group of so many: of groups of groups the middle one of all their ranks.

    So no rank has groups of two levels, once there are fewer groups than ranks.
    """
    return (2 * group + 1) * comm.size // (2 * groups)


def _shared(comm, number: np.ndarray, dofs: int) -> np.ndarray:
    """(dofs,) whether more than one group of all ranks has a dof; collective.

    `number` (n,) are those of the rank's groups, one after the other.
    """
    count, everywhere = np.bincount(number, minlength=dofs), np.empty(dofs, np.int64)
    comm.Allreduce(count, everywhere)
    return everywhere > 1


def _inverse(comm, last: Elements, pins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Dofs of the last group and the inverse of its matrix, zero for `pins`; collective.

    On all ranks. Raises NoSolution.
    """
    inverse, error, holder = None, None, _holders(0, 1, comm)
    if comm.rank == holder:
        try:
            inverse, *_ = _eliminated(last.matrices.reshape([len(last.numbers)] * 2),
                                      len(last.numbers))
            still = pins[last.numbers]
            inverse[still] = inverse[:, still] = 0.0
        except NoSolution as problem:
            error = problem
    agree(comm, error)
    return comm.bcast((last.numbers, inverse), holder)


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
