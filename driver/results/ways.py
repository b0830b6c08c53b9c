"""Ways that nodes have slid, as far as errors depend on how they were made."""

import numpy as np

from ..contact.states import SLIP
from .quantities import moves


def passed(nodes: dict, steps: dict, index: int, node: int) -> np.ndarray:
    """(steps,) ways until step `index` that a node has slid by motion of an obstacle, not its own.

    Zero where nothing drives it, and where contact follows the motion: as normals turn, changes of
    u_t are not the node's own way. `nodes`, `steps` as of quantities.py.
    """
    way = np.where(steps["status"] == SLIP, moves(steps), 0.0)[: index + 1, node]
    if not nodes.get("driven", np.zeros(len(nodes["arc"]), bool))[node]:
        return np.zeros(len(way))
    own = np.abs(np.diff(steps["u_t"][: index + 1, node], prepend=0.0))
    past = np.abs(steps["slip"][: index + 1, node])
    share = np.divide(own, past, out=np.ones_like(own), where=past > own)
    return way * (1 - share)


def onward(nodes: dict, steps: dict, index: int) -> np.ndarray:
    """(k, 2) of the nodes that slide in step `index`: the way since they last stuck or turned, and
    the size of their friction force.
    """
    slip, sliding = steps["slip"][: index + 1], steps["status"][: index + 1] == SLIP
    same = sliding & (np.sign(slip) == np.sign(slip[-1]))
    since = np.logical_and.accumulate(same[::-1])[::-1]
    way = np.where(since, np.abs(slip), 0.0).sum(axis=0)
    force = np.abs(steps["sigma_t"][index] * nodes["weight"])
    return np.column_stack([way, force])[sliding[-1]]
