"""Strains and rotations of all triangles in a step, which are taken for small."""

from dataclasses import dataclass, field

import numpy as np

from ..scene import elements, kinematics

MEASURES = ("largest_strain", "largest_rotation")
AT_A_TIME = 20_000  # triangles: many small subdomains take longer one by one than their triangles


@dataclass
class SmallStrains:
    """What a rank's triangles strain and turn by.

    `largest` are of each measure the largest value and its place (2,); of the subdomains of all
    ranks, zero for others, `areas` (total,) and `beyond` (measures, limits, total) the areas where
    a measure exceeds a limit, `turns` (total,) integrals of the rotation, counterclockwise;
    `squares` (2, total) of the strain and of the stretch that a turn by theta leaves out of it,
    theta^2/2, their squares times the stiffness.
    """

    areas: np.ndarray
    beyond: np.ndarray
    turns: np.ndarray
    squares: np.ndarray
    largest: dict[str, tuple[float, tuple]] = field(default_factory=dict)

    @classmethod
    def of(cls, subdomains: list, fields: list[np.ndarray], turned: np.ndarray, total: int,
           limits: np.ndarray) -> "SmallStrains":
        """By displacements (dofs,) of each of the `subdomains`, which are further turned by
        `turned` (k,); `limits` (measures, limits).
        """
        found = cls(np.zeros(total), np.zeros((*limits.shape, total)), np.zeros(total),
                    np.zeros((2, total)))
        first = 0
        for last in _ends(subdomains):
            found._add(subdomains[first:last], fields[first:last], turned[first:last], limits)
            first = last
        return found

    def _add(self, subs: list, fields: list[np.ndarray], turned: np.ndarray, limits) -> None:
        """Triangles of some subdomains together."""
        counts = [len(sub.triangles) for sub in subs]
        corner = np.concatenate([sub.xy[sub.triangles] for sub in subs])
        value = np.concatenate([u.reshape(-1, 2)[sub.triangles] for sub, u in zip(subs, fields)])
        strain, turn = kinematics.strain_and_turn(corner, value)
        if subs[0].axisymmetric:
            hoop = [kinematics.strains(sub, u)[:, 3] for sub, u in zip(subs, fields)]
            strain = np.maximum(strain, np.abs(np.concatenate(hoop)))
        turn = turn + np.repeat(turned, counts)
        area, start = elements.areas(corner), np.cumsum([0, *counts[:-1]])
        own = [sub.index for sub in subs]
        self.areas[own] = np.add.reduceat(area, start)
        self.turns[own] = np.add.reduceat(turn * area, start)
        stiff = area * np.concatenate([sub.elasticity[:, 0, 0] for sub in subs])
        self.squares[:, own] = np.add.reduceat(
            stiff * np.array([strain**2, (turn**2 / 2)**2]), start, axis=1)
        for m, (name, values) in enumerate(zip(MEASURES, (strain, np.abs(turn)))):
            k = values.argmax()
            if name not in self.largest or values[k] > self.largest[name][0]:
                self.largest[name] = float(values[k]), tuple(corner[k].mean(axis=0).tolist())
            for g, limit in enumerate(limits[m]):
                if values[k] > limit:
                    inside = np.where(values > limit, area, 0.0)
                    self.beyond[m, g, own] = np.add.reduceat(inside, start)

    def left_out(self, comm, body: np.ndarray) -> float:
        """Stretches that linear strains leave out beside these, root mean squares of the body where
        they are the largest; `body` (total,) of the subdomains. Collective.
        """
        strained, stretched = (np.bincount(body, of) for of in comm.allreduce(self.squares))
        most = np.sqrt(stretched / np.where(strained > 0, strained, np.inf))
        return float(most.max(initial=0.0))


def _ends(subdomains: list) -> list[int]:
    """After which of the subdomains they make AT_A_TIME triangles, and after the last."""
    counts = np.cumsum([len(sub.triangles) for sub in subdomains])
    full = counts // AT_A_TIME
    return [*(np.flatnonzero(np.diff(full)) + 1).tolist(), len(subdomains)] if len(counts) else []
