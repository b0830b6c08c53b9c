"""The contact nodes beside corners between two bodies: what tractions the flanks have there."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Beside:
    """The next contact nodes on both sides of v corners between bodies.

    `rows` (v, 2, 2): positions of their normal and tangential rows in the rank's dual vectors, -1
    where it owns none; `ratio` (v, 2) of the corner's weight to theirs; `known` (v,): there are
    two.
    """

    rows: np.ndarray
    ratio: np.ndarray
    known: np.ndarray

    def forces(self, x: np.ndarray, comm) -> np.ndarray:
        """(v, 2, 2) normal and tangential forces of the corners with their tractions; collective.
        """
        mine = np.where(self.rows >= 0, np.append(x, 0.0)[self.rows], 0.0) * self.ratio[..., None]
        return np.sum(comm.allgather(mine), axis=0)


def beside(contact, nodes: np.ndarray, owned) -> Beside:
    """The neighbours of the corners `nodes` (v, 2) on a ContactBoundary.

    `owned(rows)`: positions of dual rows in the rank's dual vectors, -1 of those of other ranks.
    """
    near = neighbours(contact, nodes)
    known = (near >= 0).all(axis=1) & contact.paired[nodes].all(axis=1)
    rows = np.stack([contact.normal_row[near], contact.tangential_row[near]], axis=2)
    return Beside(owned(rows), contact.weight[nodes] / contact.weight[near], known)


def neighbours(contact, nodes: np.ndarray) -> np.ndarray:
    """The nearest nodes beside `nodes`, of any shape, on the same boundary; -1 where there is none.
    """
    near = np.full(nodes.shape, -1)
    for place, i in np.ndenumerate(nodes):
        away = np.linalg.norm(contact.xy - contact.xy[i], axis=1)
        on = [k for k in (i - 1, i + 1) if 0 <= k < len(away) and away[k] > 0
              and contact.chain[k] == contact.chain[i] and contact.family[k] == contact.family[i]]
        near[place] = min(on, key=away.__getitem__, default=-1)
    return near
