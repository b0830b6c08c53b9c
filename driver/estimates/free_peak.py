"""By how much a place may exceed the largest displacement on finer meshes.

Where a support prescribes the largest displacement of a body, or that of a node beside it, it is
about the same on all meshes, and they tell nothing of others that may exceed it: bulges UNSEEN on
coarse meshes. Where there are others, each peak of displacements is compared with the same one on
coarser meshes, as one that is not the largest may grow by more than the largest does. Peaks are
nodes with displacements that no neighbour exceeds, and which neither contact nor a support
prescribes. Beside a prescribed displacement all are lower, and come the nearer to it the finer the
mesh is: they are none.
"""

from dataclasses import dataclass

import numpy as np

from .budget import Part, extrapolate, located

ROUNDING = 1e-9  # relative change of a largest displacement that a support prescribes
# by how much others may exceed it, relative: bulges beside a support; 2.1 found, and 3.9 of a pad
# of rubber in shear
UNSEEN = 2.5e-2
SAME = 0.5  # part of a peak of displacements that the same one on a coarser mesh has at least
X, Y, SIZE, SIDE = range(4)


@dataclass(frozen=True)
class Peaks:
    """Displacements at the end of a run."""

    largest: float
    supported: float  # the largest that supports hold, or beside them, where it is little more
    free: np.ndarray  # (k, 4) peaks: place, size, extent of the elements around

    @classmethod
    def of(cls, operator, step, largest: float) -> "Peaks":
        """At the end of `step`. Collective over the ranks of `operator`."""
        operator.follow(step)
        fields = operator.displacements(step.multipliers, step.weights)
        sizes = [np.linalg.norm(u.reshape(-1, 2), axis=1) for u in fields]
        return cls(largest, _supported(operator, sizes), _free(operator, sizes))

    @classmethod
    def of_level(cls, level) -> "Peaks":
        """At the step of the quantities of a finished run (levels.py); collective."""
        return cls.of(level.solver.operator, level.steps[level.at], level.values["displacement"])

    @property
    def by_support(self) -> bool:
        """Whether no free place has the largest displacement."""
        return self.supported >= (1 - ROUNDING) * self.largest

    def near(self, peak: np.ndarray) -> float | None:
        """Size of the peak within an element's extent of another mesh's `peak`, None without one.
        """
        away = np.hypot(*(self.free[:, :SIZE] - peak[:SIZE]).T)
        here = self.free[away <= np.maximum(self.free[:, SIDE], peak[SIDE]), SIZE]
        size = here.max(initial=0.0)
        return float(size) if size > SAME * peak[SIZE] else None


def exceeded(part: Part, value: float, pairs: list[tuple[Peaks, Peaks]], ratios: list[float],
             formal: float) -> Part:
    """The `part` of the largest displacement `value`, beside what places that are not it, or not
    yet, may have on finer meshes; `pairs` as of `exceeding`, empty where none is known.
    """
    if pairs:
        part = located(part, exceeding(pairs, ratios, formal))
    unseen = any(each.by_support for pair in pairs for each in pair)
    if unseen or part.error is not None and part.error <= ROUNDING * value:
        # that of a support: no mesh tells when a place between the supports moves by more
        part = located(part, UNSEEN * value)
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
            part = extrapolate(same, ratios, formal, peak[SIZE], True)
            most = max(most, float(peak[SIZE]) + part.error - own.largest)
    return most


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


def _free(operator, sizes: list[np.ndarray]) -> np.ndarray:
    """(k, 4) peaks of the displacements' `sizes` by subdomain; the same on all ranks."""
    structure, comm = operator.structure, operator.comm
    placed = np.unique(structure.contact.declared.term_gid)
    tops, lower = [(np.empty(0, int), np.empty((0, 4)))], [np.empty(0, int)]
    for sub, fixed, size in zip(structure.subdomains, structure.fixed, sizes):
        around = size[sub.elements]
        exceeded = np.zeros(len(size), bool)
        exceeded[sub.elements[around < around.max(axis=1, keepdims=True)]] = True
        free = ~np.isin(sub.node_gid, placed) & ~exceeded
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
