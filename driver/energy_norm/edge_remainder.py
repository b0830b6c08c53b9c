"""Tractions on boundary edges that are not linear there, and the stress that takes the rest."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..scene.elements import areas, cross, hat_gradients
from ..vectors import turned_left
from .element_stress import johnson_mercier


@dataclass
class Fan:
    """Triangles on a boundary, cut from their apex at points of the boundary side.

    Corners of the n triangles are start and end of the side and apex, counterclockwise. The m parts
    of a triangle follow one another along its side. Fields on the side are given by their values
    (m, 2 ends, 2) on the parts.
    """

    triangle: np.ndarray  # (n, 3, 2) corners
    owner: np.ndarray  # (m,) triangle of each part
    at: np.ndarray  # (m, 2) ends on the side, in [0, 1]
    piece: np.ndarray  # (m,) given piece, -1 on what none covers

    @classmethod
    def of(cls, triangle: np.ndarray, owner: np.ndarray, at: np.ndarray) -> "Fan":
        """Parts from pieces `at` (k, 2) of the sides of `owner` (k,), and the uncovered ones."""
        order = np.lexsort((at[:, 0], owner))
        owner, at = owner[order], at[order]
        head, tail = np.r_[True, owner[1:] != owner[:-1]], np.r_[owner[1:] != owner[:-1], True]
        before = np.where(head, 0.0, np.r_[0.0, at[:-1, 1]])
        void, rest = at[:, 0] > before + 1e-9, tail & (at[:, 1] < 1.0 - 1e-9)
        at = np.column_stack([np.where(void, at[:, 0], before),
                              np.where(tail & ~rest, 1.0, at[:, 1])])
        piece = np.concatenate([order, np.full(void.sum() + rest.sum(), -1)])
        owner = np.concatenate([owner, owner[void], owner[rest]])
        left = np.column_stack([before, at[:, 0]])
        right = np.column_stack([at[:, 1], np.ones(len(at))])
        at = np.concatenate([at, left[void], right[rest]])
        order = np.lexsort((at[:, 0], owner))
        return cls(triangle, owner[order], at[order], piece[order])

    @cached_property
    def along(self) -> np.ndarray:
        """(m, 2) side vectors of the triangles."""
        return (self.triangle[:, 1] - self.triangle[:, 0])[self.owner]

    @cached_property
    def length(self) -> np.ndarray:
        """(m,) of the parts' sides."""
        return np.linalg.norm(self.along, axis=1) * (self.at[:, 1] - self.at[:, 0])

    @cached_property
    def corner(self) -> np.ndarray:
        """(m, 3, 2) of the parts."""
        start, apex = self.triangle[self.owner, 0], self.triangle[self.owner, 2]
        return np.stack([start + self.at[:, k, None] * self.along for k in (0, 1)] + [apex], axis=1)

    def given(self, values: np.ndarray) -> np.ndarray:
        """(m, 2, 2) field of values (k, 2, 2) on the pieces, zero on what they do not cover."""
        return np.where((self.piece >= 0)[:, None, None], values[self.piece], 0.0)

    def joined(self, values: np.ndarray) -> np.ndarray:
        """(m, 2, 2) continuous field of values (k, 2, 2) on the pieces, zero at the sides' ends."""
        field = self.given(values)
        same = np.r_[False, self.owner[1:] == self.owner[:-1]]
        void = self.piece < 0
        field[void & same, 0] = np.roll(field, 1, axis=0)[void & same, 1]
        same = np.roll(same, -1)
        field[void & same, 1] = np.roll(field, -1, axis=0)[void & same, 0]
        return field

    def moments(self, density: np.ndarray) -> np.ndarray:
        """(n, 2, 2) moments [end, component] of a field against the hats at the side's ends."""
        (s0, s1), (d0, d1) = self.at.T[:, :, None], density.transpose(1, 0, 2)
        sixth = self.length[:, None] / 6
        end = sixth * (d0 * (2 * s0 + s1) + d1 * (s0 + 2 * s1))
        moments = np.zeros((len(self.triangle), 2, 2))
        np.add.at(moments[:, 1], self.owner, end)
        np.add.at(moments[:, 0], self.owner, sixth * 3 * (d0 + d1) - end)
        return moments

    def remainder(self, density: np.ndarray) -> np.ndarray:
        """(n,) int |r|^2 of a field less the linear one with the same moments on every side."""
        side = np.linalg.norm(self.triangle[:, 1] - self.triangle[:, 0], axis=1)[:, None]
        a, b = (self.moments(density) / side[..., None]).transpose(1, 0, 2)
        start, end = (4 * a - 2 * b)[self.owner, None], (4 * b - 2 * a)[self.owner, None]
        r0, r1 = (density - start - self.at[:, :, None] * (end - start)).transpose(1, 0, 2)
        square = self.length / 3 * (r0 * r0 + r0 * r1 + r1 * r1).sum(axis=1)
        return np.bincount(self.owner, square, minlength=len(self.triangle))

    def bump_energy(self, values: np.ndarray, elasticity: np.ndarray) -> np.ndarray:
        """(n,) int C e : e of `values` (m, 2, 2) on the side, linear to zero at the apex."""
        d = np.einsum("mki,mkj->mij", hat_gradients(self.corner)[:, :2], values)
        strain = np.column_stack([d[:, 0, 0], d[:, 1, 1], d[:, 0, 1] + d[:, 1, 0]])
        energy = np.einsum("mi,mij,mj->m", strain, elasticity[self.owner], strain)
        return np.bincount(self.owner, energy * areas(self.corner), minlength=len(self.triangle))


APEXES = np.array([[0, 0, 6], [1, 1, 4], [2, 2, 2], [0, 3, 3], [3, 0, 3]]) / 6  # barycentric


def remainder_constant(triangle: np.ndarray, compliance: np.ndarray) -> np.ndarray:
    """(n,) c with ||s||^2 <= c int |r|^2 for s with tractions r on side 0 only and div s = 0.

    s lives on the triangle with this side and that one of the `APEXES` for which c is least.
    """
    side = triangle[:, :2]
    inside = [np.concatenate([side, np.einsum("k,nkj->nj", apex, triangle)[:, None]], axis=1)
              for apex in APEXES]
    return np.min([_remainder_constant(corners, compliance) for corners in inside], axis=0)


def _remainder_constant(triangle: np.ndarray, compliance: np.ndarray) -> np.ndarray:
    """(n,) the same with s on all of the triangle.

    r may be any field without moments against linear ones. It is a sum of piecewise linear fields
    on halves of the side, of its halves and so on, each without moments on what it lives on and
    orthogonal to the others (Alpert, A class of bases in L2 for the sparse representation of
    integral operators, 1993). On each of these parts stands a triangle similar to the whole one.
    There the line from the apex to the middle carries force and moment of one half, and both halves
    have their stress of Johnson and Mercier. If k is the largest energy of such a field with int
    |r|^2 = 1 on the side, it is k / 2^l on level l; by Cauchy's inequality c = k sum 2^-l = 2 k.
    """
    n, start, end, apex = len(triangle), *triangle.transpose(1, 0, 2)
    middle = (start + end) / 2
    half = np.linalg.norm(end - start, axis=1)[:, None] / 2
    line = apex - middle
    # int |r|^2 = 1 on a side of length 1
    fields = [(shape * np.sqrt(scale), axis) for axis in np.eye(2)
              for shape, scale in ((np.array([[1.0, -1], [-1, 1]]), 3.0),
                                   (np.array([[0.5, -1], [1, -0.5]]), 4.0))]
    stress = []
    for shape, axis in fields:
        # [half, n, end, component]
        density = (shape[:, None, :, None] * axis) / np.sqrt(2 * half)[:, None]
        base = half[:, None] / 6 * (2 * density + density[:, :, ::-1])
        force = base[0].sum(axis=1)
        across = turned_left(line)
        far = -cross(start - middle, base[0, :, 0])[:, None] * across
        far = far - 0.5 * (force * line).sum(axis=1)[:, None] * line
        far = far / (line**2).sum(axis=1)[:, None]
        right, none = np.stack([-force - far, far], axis=1), np.zeros((n, 2, 2))
        moments = [np.stack([base[0], right, none], axis=1),
                   np.stack([base[1], none, -right[:, ::-1]], axis=1)]
        stress.append([johnson_mercier(np.stack([a, b, apex], axis=1), given)
                       for a, b, given in zip((start, middle), (middle, end), moments)])
    mass = (np.eye(3) + 1) / 12 * (0.5 * cross(end - start, apex - start) / 6)[:, None, None]
    gram = np.einsum("ahtpms,tmn,tsr,bhtpnr->tab", np.array(stress), mass, compliance,
                     np.array(stress), optimize=True)
    return 2 * np.linalg.eigvalsh(gram)[:, -1]
