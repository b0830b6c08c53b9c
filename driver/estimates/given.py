"""Resultants that loads give by equilibrium, whatever the mesh does to contact.

On a translation r that neither supports nor springs resist all forces do no work in equilibrium, of
finite elements as well: contact forces lambda do what loads do, with the other sign,

    sum_i lambda_i (B r)_i = - work of the loads on r.

A resultant J = sum_i a_i lambda_i, a_i the signs of its rows, is given by the loads if a is a
combination of such B r on all rows that may carry: on all rows of contact and joints, ANYWHERE it
may be, or on those of the nodes that touch, HERE, a sliding one with its friction. The first is an
identity, on any mesh: J errs by what loads err, which coarser meshes tell without chance. The
second holds as long as the same states do, and where all that presses has one normal: coarser
meshes have to agree on it, but may have the same few nodes at the ends of a round boundary.

Rotations give resultants as well, by the places of contact, which a mesh may not know: an arch on
the edges of its feet has shares of its weight at places where nodes are.
"""

from dataclasses import dataclass

import numpy as np

from ..contact.states import OPEN, SLIP
from ..quantity_table import SUMMED
from ..results.record import ROUND

ROUNDING = 1e-7  # part of a row by which work may differ: its direction and weight are sums
TURNS = 1e-9  # way by a rotation over that by a motion of the body, below which it is a translation


@dataclass(frozen=True)
class Given:
    """Names of the resultants that loads give."""

    anywhere: frozenset = frozenset()
    here: frozenset = frozenset()


def by_loads(operator, record, values: dict, index: int) -> Given:
    """Those among the `values` of the step with an `index` in the record of a run; collective.

    Where contact follows the motion rows are those of the last step, and tell of no other.
    """
    names = [name for name in SUMMED if name in values]
    motions = translations(operator) if names else []
    if not motions:
        return Given()
    contact, last = record.contact, index == len(record.displacements) - 1
    if contact.boundary.moves and not last:
        return Given()
    rows, state = contact.solver.rows, record.state(index)
    ratio = frozen_ratio(rows, state, operator.comm)
    pressing = contact.boundary.normal[state["sigma_n"] < 0]
    level = not len(pressing) or np.ptp(pressing, axis=0).max() <= ROUND
    found = {}
    for name in names:
        target = of_resultant(rows, record.signed_shares(name, index), name, operator.owned)
        found[name] = [
            _combines(operator, reduced(rows, target), [reduced(rows, r) for r in motions]),
            level and _combines(operator, reduced(rows, target, state["status"], ratio),
                                [reduced(rows, r, state["status"], ratio) for r in motions])]
    anywhere, here = (frozenset(name for name in names if found[name][k]) for k in (0, 1))
    return Given(anywhere, here)


def of_resultant(rows, signs: np.ndarray, name: str, owned: int) -> np.ndarray:
    """(owned,) `signs` (n_c,) of the nodes at their rows of a resultant's kind, zero at others."""
    row, node = ((rows.normal, rows.normal_node) if name == "normal_resultant"
                 else (rows.tangential, rows.tangential_node))
    target, own = np.zeros(owned), node < len(signs)  # beyond are joints
    target[row[own]] = signs[node[own]]
    return target


def translations(operator) -> list[np.ndarray]:
    """Displacements (owned,) of the dual rows under translations that supports and springs leave to
    bodies, without those that turn a body.
    """
    modes = operator.structure.rigid_modes
    size = operator.structure.travel.bodies.size.max(initial=0.0) if modes else 0.0
    found = []
    for body in sorted({mode.body for mode in modes}):
        own = [k for k, mode in enumerate(modes) if mode.body == body]
        turn = np.array([[modes[k].rotation * size for k in own]])
        way = max(np.linalg.norm(modes[k].translation) for k in own)
        _, sizes, basis = np.linalg.svd(turn)
        turns = int(sizes[0] > TURNS * max(way, sizes[0]))
        found += [sum(c * operator.motions[k] for c, k in zip(of, own)) for of in basis[turns:]]
    return found


def frozen_ratio(rows, state: dict, comm) -> np.ndarray | None:
    """(j,) force of friction over the pressing one at the tangential rows of nodes that slide, None
    where a bound, or a part of it, does not follow pressure.
    """
    offset = rows.offset is not None and bool(np.any(rows.offset))
    if comm.allreduce(int(rows.coefficient is None or offset)):
        return None
    node = rows.tangential_node
    contact = node < len(state["status"])
    at = np.where(contact, node, 0)
    sign = np.sign(state["sigma_t"] * state["sigma_n"])[at]
    return np.where(contact & (state["status"][at] == SLIP), rows.coefficient * sign, 0.0)


def reduced(rows, moved: np.ndarray, status: np.ndarray | None = None,
            ratio: np.ndarray | None = None) -> np.ndarray:
    """`moved` (owned,) at the rows that may carry: all, or with a `status` (n_c,) those of nodes
    that touch; of sliding ones along their whole force, where friction has a `ratio` (j,) to it.
    """
    found = np.zeros(len(moved))
    for row, node in ((rows.normal, rows.normal_node), (rows.tangential, rows.tangential_node)):
        carries = np.ones(len(row), bool)
        if status is not None:
            own = node < len(status)
            carries[own] = status[node[own]] != OPEN
        found[row[carries]] = moved[row[carries]]
    if status is not None and ratio is not None:
        slides = ratio != 0
        np.add.at(found, rows.pair[slides], (ratio * moved[rows.tangential])[slides])
        found[rows.tangential[slides]] = 0.0
    if rows.idle is not None:
        found[rows.idle] = 0.0
    return found


def _combines(operator, target: np.ndarray, motions: list[np.ndarray]) -> bool:
    """Whether a `target` (owned,), not zero, is a combination of `motions`; collective."""
    gram = np.array([[operator.dot(a, b) for b in motions] for a in motions])
    right = np.array([operator.dot(a, target) for a in motions])
    factors = np.linalg.lstsq(gram, right, rcond=1e-12)[0]
    rest = target - np.tensordot(factors, motions, axes=1)
    parts = operator.comm.allgather([np.abs(of).max(initial=0.0) for of in (rest, target)])
    missed, most = np.max(parts, axis=0)
    return bool(0 < most and missed <= ROUNDING * most)
