"""By how much a place may exceed the largest displacement on finer meshes.

Where a support prescribes the largest displacement of a body, or that of a node beside it, or a
rigid obstacle that moves, it is about the same on all meshes, and they tell nothing of others that
may exceed it: bulges UNSEEN on coarse meshes. Where there are others, each peak of displacements is
compared with the same one on coarser meshes, as one that is not the largest may grow by more than
the largest does, at the orders that the largest has, no slower than UNSETTLED. Peaks are nodes with
displacements that no neighbour exceeds, and which neither contact nor a support prescribes. Contact
prescribes those along its normal: a node that moves along the boundary is free. Beside a prescribed
displacement all are lower, and come the nearer to it the finer the mesh is: they are none.

What a support prescribes has no error, whatever meshes and adjoint problems say of a place beside
it that moves by little more: the true largest displacement is that or more. It is more where
another place moves by more. What a place moves by from the support is a sum of strains, which err
by the error in energy: so much of its way from the support is added to the displacement of every
place. Beyond that, and what is UNSEEN, no error is claimed.

A bulge has an energy. To move a place of a boundary by b, over an element's length, takes about
E b^2/6 of a half-plane, of a corner less; a body that moves by w from its support has about
E w^2/2, and e^2 of that is all that an error in it allows: b is a few times e w. So a body that
hardly deforms, or whose stresses are uniform, has no bulge that is worth UNSEEN.

The largest displacement is that of a node. Where the outline goes on smoothly the true one may be
at a place BETWEEN that node and the next, as under a round indenter: meshes differ by where their
nodes lie, and adjoint problems are about the node. The parabola through the node and its two
neighbours on the outline tells how much more that is.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from .budget import UNSETTLED, Part, extrapolate, located

ROUNDING = 1e-9  # relative change of a largest displacement that a support prescribes
# by how much others may exceed it, relative: bulges beside a support; 2.1 found, and 3.9 of a pad
# of rubber in shear
UNSEEN = 2.5e-2
# times the relative error in energy: displacement of a place over the way from the support that
# this allows, 3 to 6 on an edge or a corner, in a body that is 300 times as soft as what has the
# energy
PLACE = 100.0
AGREE = 1e-5  # relative change of one that contact prescribes, which holds to its tolerance
SAME = 0.5  # part of a peak of displacements that the same one on a coarser mesh has at least
X, Y, SIZE, SIDE = range(4)
SMOOTH = 0.83  # cosine of the turn of an outline up to which it goes on smoothly, 34 degrees


@dataclass(frozen=True)
class Peaks:
    """Displacements at the end of a run."""

    largest: float
    supported: float  # the largest that supports hold, or beside them, where it is little more
    free: np.ndarray  # (k, 4) peaks: place, size, extent of the elements around
    between: float = 0.0  # by how much the largest one may be more between nodes of the outline
    held: float = 0.0  # the largest that supports prescribe
    # (m, 2) of free nodes: size, and way from the largest that is prescribed; those alone that none
    # exceeds in both
    ways: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))

    @classmethod
    def of(cls, operator, step, largest: float) -> "Peaks":
        """At the end of `step`. Collective over the ranks of `operator`."""
        operator.follow(step)
        fields = operator.displacements(step.multipliers, step.weights)
        sizes = [np.linalg.norm(u.reshape(-1, 2), axis=1) for u in fields]
        return cls(largest, _supported(operator, sizes), _free(operator, fields, sizes),
                   _between(operator, sizes), *_from_support(operator, fields, sizes))

    @classmethod
    def of_level(cls, level) -> "Peaks":
        """At the step of the quantities of a finished run (levels.py); collective."""
        return cls.of(level.solver.operator, level.steps[level.at], level.values["displacement"])

    @property
    def by_support(self) -> bool:
        """Whether a support prescribes the largest displacement, or that of a node beside it."""
        return self.supported >= (1 - ROUNDING) * self.largest

    @property
    def is_free(self) -> bool:
        """Whether a place that neither contact nor a support prescribes has the largest one."""
        return self.free[:, SIZE].max(initial=0.0) >= (1 - ROUNDING) * self.largest

    def most(self, energy: float) -> float:
        """What the largest one may err by at most, beside the largest that is prescribed, with a
        relative error in `energy`.
        """
        beyond = (self.ways @ [1.0, energy] - self.held).max(initial=0.0)
        return float(max(beyond, self.largest - self.held, self.unseen(energy)))

    def unseen(self, energy: float) -> float:
        """What a bulge that no mesh shows may add to the largest, with a relative error in `energy`
        or 0 where that is not known.
        """
        near = self.held > 0 and self.held >= (1 - UNSEEN) * self.largest
        way = self.ways[:, 1].max(initial=0.0) if near else self.largest
        allowed = PLACE * energy * way if energy else np.inf
        return float(min(UNSEEN * self.largest, allowed))

    def near(self, peak: np.ndarray) -> float | None:
        """Size of the peak within an element's extent of another mesh's `peak`, None without one;
        of several that of the nearest.
        """
        away = np.hypot(*(self.free[:, :SIZE] - peak[:SIZE]).T)
        here = self.free[:, SIZE] > SAME * peak[SIZE]
        here &= away <= np.maximum(self.free[:, SIDE], peak[SIDE])
        return float(self.free[here][away[here].argmin(), SIZE]) if here.any() else None


def exceeded(part: Part, value: float, pairs: list[tuple[Peaks, Peaks]], ratios: list[float],
             formal: float, energy: float = 0.0) -> Part:
    """The `part` of the largest displacement `value`, beside what places that are not it, or not
    yet, may have on finer meshes; `pairs` as of `exceeding`, empty where none is known, `energy`
    the relative error in it, 0 where that is not.
    """
    if pairs and energy and part.error is not None:
        part = replace(part, error=min(part.error, pairs[0][0].most(energy)))
    if pairs:
        part = located(part, exceeding(pairs, ratios, formal))
        if part.error is not None:
            part = replace(part, error=part.error + pairs[0][0].between)
    unseen = any(each.by_support for pair in pairs for each in pair)
    agree = ROUNDING if pairs and pairs[0][0].is_free else AGREE
    if unseen or part.error is not None and part.error <= agree * value:
        # that of a support or of an obstacle: no mesh tells when a place between moves by more
        least = pairs[0][0].unseen(energy) if pairs else UNSEEN * value
        part = located(part, least)
        if pairs and pairs[0][0].by_support:
            part = replace(part, floor=least)
    return part


def exceeding(pairs: list[tuple[Peaks, Peaks]], ratios: list[float], formal: float) -> float:
    """By how much a free peak may exceed the largest displacement, zero for one that is it on all
    meshes; from `pairs` of finer and coarser ones, finest first.
    """
    own, most = pairs[0][0], 0.0
    for peak in own.free[own.free[:, SIZE] > SAME * own.largest]:
        same, largest = [], True
        for fine, coarse in pairs:
            sizes = fine.near(peak), coarse.near(peak)
            if None in sizes:
                break
            same.append(sizes[0] - sizes[1])
            largest &= all(size >= (1 - ROUNDING) * of.largest
                           for size, of in zip(sizes, (fine, coarse)))
        if same and not largest:
            part = extrapolate(same, ratios, formal, peak[SIZE], True, least=UNSETTLED,
                               falling=True)  # as the largest one
            most = max(most, float(peak[SIZE]) + part.error - own.largest)
    return most


def _between(operator, sizes: list[np.ndarray]) -> float:
    """By how much the parabola along the outline exceeds the largest of displacements' `sizes`.

    Zero where a support prescribes it, inside a body and at corners of the outline.
    """
    structure, comm = operator.structure, operator.comm
    own = max(((float(size.max()), int(sub.node_gid[size.argmax()]))
               for sub, size in zip(structure.subdomains, sizes)), default=(-1.0, -1))
    largest, top = max(comm.allgather(own))
    found, held = [np.empty((0, 4))], False
    for sub, fixed, size in zip(structure.subdomains, structure.fixed, sizes):
        held |= bool((sub.node_gid[sub.dof_node[fixed]] == top).any())
        ends = _outline(sub, structure.outer_edges[:, :2])
        beside = ends[(sub.node_gid[ends] == top).any(axis=1)]
        found += [np.column_stack([sub.node_gid[pair], sub.xy[pair], size[pair]])
                  for pair in beside]
    parts = comm.allgather((held, np.concatenate(found)))
    table = np.unique(np.concatenate([rows for _, rows in parts]), axis=0)
    place, others = table[table[:, 0] == top, 1:3], table[table[:, 0] != top]
    if any(held for held, _ in parts) or len(others) != 2:
        return 0.0
    before, after = place[0] - others[0, 1:3], others[1, 1:3] - place[0]
    sides = np.hypot(*before), np.hypot(*after)
    if before @ after < SMOOTH * sides[0] * sides[1]:
        return 0.0
    return _above((others[0, 3], largest, others[1, 3]), sides)


def _outline(sub, outer: np.ndarray) -> np.ndarray:
    """(k, 2) nodes of a Subdomain that are next to each other on the boundary of the body, whose
    edges end at the `outer` (n, 2) vertices; those between subdomains are none of it.
    """
    edges = sub.edges[np.isin(_keys(sub.node_gid[sub.edges]), _keys(outer))]
    if sub.elements.shape[1] < 6:  # linear elements
        return edges
    middle = sub.middles(edges)
    return np.concatenate([np.column_stack([end, middle]) for end in edges.T])


def _keys(pairs: np.ndarray) -> np.ndarray:
    """(n,) a number for each of the unordered `pairs` (n, 2) of global numbers."""
    low, high = np.sort(pairs.astype(np.int64), axis=1).T
    return (low << 32) + high


def _above(sizes: tuple, sides: tuple) -> float:
    """By how much the parabola through three `sizes` exceeds the middle one, the largest."""
    falls = (sizes[1] - sizes[0]) / sides[0], (sizes[1] - sizes[2]) / sides[1]
    bend = sum(falls) / sum(sides)
    slope = (falls[0] * sides[1] - falls[1] * sides[0]) / sum(sides)
    return float(slope**2 / (4 * bend)) if bend > 0 else 0.0


def _supported(operator, sizes: list[np.ndarray]) -> float:
    """Largest displacement of nodes held in both directions, or in an element with one and UNSEEN.
    """
    structure, found = operator.structure, [0.0]
    for sub, fixed, size in zip(structure.subdomains, structure.fixed, sizes):
        held = np.bincount(sub.dof_node[fixed], minlength=len(size)) == 2
        around = size[sub.elements]
        prescribed = np.where(held[sub.elements], around, 0.0).max(axis=1, keepdims=True)
        found.append(around.max(initial=0.0, where=around <= (1 + UNSEEN) * prescribed))
    return float(max(operator.comm.allgather(max(found))))


def _from_support(operator, fields: list[np.ndarray],
                  sizes: list[np.ndarray]) -> tuple[float, np.ndarray]:
    """The largest displacement of nodes held in both directions, zero without any, and the ways
    (m, 2) from it, see Peaks; of `fields` (dofs,) by subdomain and their `sizes`.
    """
    structure, comm = operator.structure, operator.comm
    subs, tops, ways = structure.subdomains, [(0.0, 0.0, 0.0)], [np.zeros((0, 2))]
    held = [np.bincount(sub.dof_node[fixed], minlength=len(size)) == 2
            for sub, fixed, size in zip(subs, structure.fixed, sizes)]
    for u, own, size in zip(fields, held, sizes):
        if own.any():
            k = int(np.where(own, size, -1.0).argmax())
            tops.append((float(size[k]), *u[2 * k:2 * k + 2].tolist()))
    largest, *support = max(comm.allgather(max(tops)))
    for u, own, size in zip(fields, held, sizes):
        away = np.hypot(*(u.reshape(-1, 2) - support).T)
        ways.append(_outermost(np.column_stack([size, away])[~own]))
    return largest, _outermost(np.concatenate(comm.allgather(np.concatenate(ways))))


def _outermost(pairs: np.ndarray) -> np.ndarray:
    """Those of the `pairs` (n, 2) that no other one exceeds in both."""
    pairs = pairs[np.argsort(-pairs[:, 0], kind="stable")]
    before = np.maximum.accumulate(np.append(-1.0, pairs[:, 1]))[:-1]
    return pairs[pairs[:, 1] > before]


def _by_contact(declared, sub, u: np.ndarray) -> np.ndarray:
    """(n,) whether the displacement `u` (dofs,) of a Subdomain's node is mostly one along a normal
    of the `declared` contact boundary, as contact prescribes it.
    """
    order = np.argsort(sub.node_gid)
    at = order[np.searchsorted(sub.node_gid, declared.term_gid, sorter=order) % len(order)]
    own = sub.node_gid[at] == declared.term_gid
    at, normal = at[own], declared.normal[declared.term_node[own]]
    moved = u.reshape(-1, 2)[at]
    found = np.zeros(len(order), bool)
    found[at[2 * (moved * normal).sum(axis=1) ** 2 >= (moved**2).sum(axis=1)]] = True
    return found


def _free(operator, fields: list[np.ndarray], sizes: list[np.ndarray]) -> np.ndarray:
    """(k, 4) peaks of the displacements' `fields` (dofs,) and their `sizes` by subdomain; the same
    on all ranks.
    """
    structure, comm = operator.structure, operator.comm
    tops, lower = [(np.empty(0, int), np.empty((0, 4)))], [np.empty(0, int)]
    for sub, fixed, u, size in zip(structure.subdomains, structure.fixed, fields, sizes):
        around = size[sub.elements]
        exceeded = np.zeros(len(size), bool)
        exceeded[sub.elements[around < around.max(axis=1, keepdims=True)]] = True
        free = ~exceeded & ~_by_contact(structure.contact.declared, sub, u)
        free[sub.dof_node[fixed]] = False
        extent = np.zeros(len(size))
        across = np.ptp(sub.xy[sub.elements], axis=1).max(axis=1, keepdims=True)
        np.maximum.at(extent, sub.elements, across)
        tops.append((sub.node_gid[free], np.column_stack([sub.xy, size, extent])[free]))
        lower.append(sub.node_gid[exceeded])
    everywhere = comm.allgather([np.concatenate(parts) for parts in zip(*tops)])
    gids, peaks = (np.concatenate(parts) for parts in zip(*everywhere))
    # of a node on an interface the other subdomains have neighbours, too
    beside = np.any(comm.allgather(np.isin(gids, np.concatenate(lower))), axis=0)
    return peaks[~beside]
