"""In which order gluing rows and corners are eliminated, by patterns and places: a tree of fronts.

Unknowns that belong to the same subdomains make a group. Subdomains are halved by their places,
again and again, and groups inside a half come before those between halves, so that ranks have
halves of their own (nested dissection: A. George, SIAM J. Numer. Anal. 10 (1973) 345-363). The
front of a group waits for those of its children, whose rest it contains. Many groups are small and
their rest is large, as contact rows stay in it: then the time goes into copies of the rest. A child
whose rest fills most of its parent's front is eliminated there, with zeros for what it does not
meet (C. Ashcraft, R. G. Grimes, ACM Trans. Math. Softw. 15 (1989) 291-309: relaxed supernodes).
"""

from dataclasses import dataclass

import numpy as np

from .gathering import joined

# in the time of a multiplication of dense elimination
EACH_ENTRY = 30.0  # to form an entry of a front, and to take it over from a child
EACH_FRONT = 1e6  # a front however small
A_MOVE = 50.0  # an entry that goes to another rank
PARTS = (2, 4, 8, 16)  # of a rank's share: how large the subtrees are that stay together


@dataclass
class Front:
    """`groups` that are eliminated together, `pivots` unknowns, and those that they meet, `rest`.

    `size` are the unknowns of both.
    """

    groups: list[int]
    rest: set[int]
    pivots: int
    size: int

    @property
    def work(self) -> float:
        """What it takes, in multiplications."""
        return self.operations + EACH_ENTRY * float(self.size) ** 2 + EACH_FRONT

    @property
    def operations(self) -> float:
        """Multiplications that the elimination takes."""
        return self.pivots * float(self.size) ** 2 / 2

    @property
    def left(self) -> float:
        """Entries of what it leaves to its parent."""
        return float(self.size - self.pivots) ** 2


class EliminationTree:
    """Fronts in the order of elimination, children before parents.

    `place` (unknowns,) are the unknowns' places in that order, those of contact rows the last, and
    `start` (fronts + 1,) the first of every front and of contact. `pivots` are the numbers of a
    front's gluing rows and of its corner dofs, which come after them. `first` (subdomains,) is the
    front that a subdomain's matrix goes to, `parent` (fronts,) the one that waits for a front, as
    `children` (fronts + 1,) say of it; what waits for the last is contact, numbered like one more.
    """

    def __init__(self, numbers: list[np.ndarray], size: int, dual: int, rows: np.ndarray,
                 halves: np.ndarray):
        """`numbers` of every subdomain's unknowns: dual rows, then corner dofs from `dual` on.

        The contact `rows` are not eliminated. `halves` (subdomains,) as `dissection.halved` has
        them.
        """
        group, count = groups(numbers, size, dual, rows, halves)
        sizes = np.bincount(group)
        self.fronts = _merged(_met(numbers, group), sizes, count)
        fronts = len(self.fronts)
        front_of = np.full(len(sizes), fronts)
        for number, front in enumerate(self.fronts):
            front_of[front.groups] = number
        key = front_of[group]
        self.place = np.empty(size, int)
        order = np.lexsort((group, np.arange(size) >= dual, key))
        self.place[order] = np.arange(size)
        self.place[rows] = size - len(rows) + np.arange(len(rows))
        number = np.bincount(key, minlength=fronts + 1)
        self.start = np.append(0, np.cumsum(number)[:-1])
        corners = np.bincount(key[dual:], minlength=fronts + 1)[:-1]
        self.pivots = np.column_stack([number[:-1] - corners, corners])
        self.first = np.array([key[of].min(initial=fronts) for of in numbers], int)
        self.parent = np.array([min(front_of[list(front.rest)], default=fronts)
                                for front in self.fronts], int)
        self.children = [[] for _ in range(fronts + 1)]
        for front, parent in enumerate(self.parent):
            self.children[parent].append(front)
        self._weight = np.array([len(of) ** 2 for of in numbers], float)  # of a matrix to be sent

    @property
    def operations(self) -> float:
        """Multiplications that all of it takes."""
        return sum(front.operations for front in self.fronts)

    @property
    def entries(self) -> int:
        """Numbers that its factors have."""
        return sum(front.pivots * front.size for front in self.fronts)

    def shared(self, holders: np.ndarray, ranks: int) -> tuple[np.ndarray, np.ndarray]:
        """(fronts + 1,) the ranks that make the fronts and what is left on contact, and their turn.

        Each rank makes its own in this order of all, which none waits for ever in. `holders`
        (subdomains,) are the ranks of the subdomains.
        """
        count = len(self.fronts)
        if ranks == 1:
            return np.zeros(count + 1, int), np.arange(count + 1)
        held = np.zeros((count + 1, ranks))
        np.add.at(held, (self.first, holders), self._weight)
        work = np.array([front.work for front in self.fronts] + [0.0])
        below = work.copy()
        for front, parent in enumerate(self.parent):
            below[parent] += below[front]
        sizes = [np.inf, *(below[-1] / ranks / parts for parts in PARTS)]  # inf: one rank has all
        plans = (self._planned(work, below, held, size) for size in sizes)
        _, owner, order = min(plans, key=lambda plan: plan[0])
        return owner, order

    def _planned(self, work: np.ndarray, below: np.ndarray, held: np.ndarray,
                 largest: float) -> tuple[float, np.ndarray, np.ndarray]:
        """The same, and when all is done, where subtrees of `below` <= `largest` stay together.

        Those with most work after them come first, each where it is done first (H. Topcuoglu, S.
        Hariri, M.-Y. Wu, IEEE Trans. Parallel Distrib. Syst. 13 (2002) 260-274: HEFT). `held`
        (fronts + 1, ranks) are entries of matrices that go to a front, by the ranks that have them.
        """
        count, ranks = len(self.fronts), held.shape[1]
        parent, top = np.append(self.parent, count), np.arange(count + 1)
        for front in reversed(range(count)):  # the front that a subtree ends with, or itself
            if below[parent[front]] <= largest:
                top[front] = top[parent[front]]
        cost = np.bincount(top, work)
        moved = np.zeros((count + 1, ranks))
        np.add.at(moved, top, held.sum(axis=1)[:, None] - held)
        after, tops = cost.copy(), np.unique(top)
        for front in reversed(tops[:-1]):
            after[front] += after[parent[front]]
        owner, free = np.zeros(count + 1, int), np.zeros(ranks)
        ready = np.zeros((count + 1, ranks))
        turn = tops[np.argsort(-after[tops], kind="stable")]
        for front in turn:
            end = np.maximum(free, ready[front]) + cost[front] + A_MOVE * moved[front]
            owner[front] = rank = end.argmin()
            free[rank] = end[rank]
            if front < count:
                arrives = np.full(ranks, end[rank] + A_MOVE * self.fronts[front].left)
                arrives[rank] = end[rank]
                ready[parent[front]] = np.maximum(ready[parent[front]], arrives)
        place = np.empty(count + 1, int)
        place[turn] = np.arange(len(turn))
        return free[owner[-1]], owner[top], np.argsort(place[top], kind="stable")


def groups(numbers: list[np.ndarray], size: int, dual: int, rows: np.ndarray,
           halves: np.ndarray) -> tuple[np.ndarray, int]:
    """(size,) group of every unknown by its turn, and the number of those to be eliminated.

    Unknowns of a group belong to the same subdomains, and are gluing rows, corner dofs, numbers
    from `dual` on, or the contact `rows`, whose groups come last. Those inside one of the `halves`
    (subdomains,), or one of halves of these, come before those that reach beyond it.
    """
    of, every = _pairs(numbers)
    # equal sums of random numbers are those of equal sets
    meets = np.bincount(every, np.random.default_rng(1).random(len(numbers))[of], size)
    meets[dual:] += len(numbers) + 1.0
    meets[rows] += 2 * len(numbers) + 2.0
    inner = np.ones(size, bool)
    inner[rows] = False
    group = np.unique(meets, return_inverse=True)[1]
    count = int(group[inner].max(initial=-1)) + 1
    first, last = np.full(count, np.iinfo(int).max), np.full(count, -1)
    inner = inner[every]
    place, of = group[every[inner]], halves[of[inner]]
    np.minimum.at(first, place, of)
    np.maximum.at(last, place, of)
    level = np.frexp(first ^ last)[1]  # how many halves up one has them all
    turn = np.arange(group.max(initial=-1) + 1)
    turn[np.lexsort((level, (first >> level) + 1 << level))] = np.arange(count)
    return turn[group], count


def _pairs(numbers: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(k,) subdomain and number of all their unknowns, one after the other."""
    of = np.repeat(np.arange(len(numbers)), [len(number) for number in numbers])
    return of, joined(numbers, int)


def _met(numbers: list[np.ndarray], group: np.ndarray) -> list[set[int]]:
    """The groups of every subdomain that has unknowns."""
    of, every = _pairs(numbers)
    count = len(group) + 1
    of, met = np.divmod(np.unique(of * count + group[every]), count)
    return [set(part.tolist()) for part in np.split(met, np.flatnonzero(np.diff(of)) + 1)
            if len(part)]


def _merged(met: list[set[int]], sizes: np.ndarray, count: int) -> list[Front]:
    """The fronts of the first `count` groups, children merged with parents where that pays.

    `met` are the groups of every subdomain, `sizes` the unknowns of every group.
    """
    waiting, made = [[] for _ in range(count + 1)], [None] * count
    for every in met:
        waiting[min(min(every), count)].append(every)
    children, size_of = [[] for _ in range(count + 1)], sizes.tolist()
    for g in range(count):
        rest = set().union(*waiting[g], *(made[c].rest for c in children[g])) - {g}
        pivots = size_of[g]
        front = Front([g], rest, pivots, pivots + sum(map(size_of.__getitem__, rest)))
        for c in sorted(children[g], key=lambda c: (-made[c].left, c)):
            if _pays(made[c], front):
                child, made[c] = made[c], None
                front.groups += child.groups
                front.pivots, front.size = front.pivots + child.pivots, front.size + child.pivots
        made[g] = front
        children[min(min(rest, default=count), count)].append(g)
    return [front for front in made if front is not None]


def _pays(child: Front, parent: Front) -> bool:
    """Whether the child's pivots are better eliminated in its parent."""
    size = float(parent.size + child.pivots)
    more = child.pivots * (size**2 - float(child.size) ** 2) / 2
    grown = size**2 - float(parent.size) ** 2 - float(child.size) ** 2
    return EACH_FRONT - EACH_ENTRY * (grown - child.left) / 2 > more
