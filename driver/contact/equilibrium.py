"""Bodies without support: can contact hold them, and where would they come to rest?

The loads' work on every free rigid motion must be balanced by contact forces inside their cones, a
linear program in the multipliers:

    min gap' lambda_n   with   G lambda = L,   lambda_n >= 0,   |lambda_t| <= offset + F lambda_n,

column j of G' being the motion of the contact rows under rigid motion j. Without a solution there
is no equilibrium whatever the bodies deform; with one its dual variables are the rigid motion that
closes the gaps first. Compare Haslinger, Kucera, Sassi: floating bodies; for the static theorem
Kanno (2011), ch. 1.

Where contact is bilateral lambda_n = p - q with p, q >= 0, and F |lambda_n| becomes F (p + q). That
admits friction under p = q, without pressure, which one node has not. But nodes that press and pull
against one another have it: the answer "cannot" stays certain.

Scaled to forces of order one it is the same program for all loads that grow in proportion, if the
friction that pressure does not bound does so as well: it is solved once for steps that follow each
other so.
"""

import numpy as np
from scipy.sparse import csr_matrix

from ..environment import PLAIN_PROGRAM, silenced
from ..feti.free_motions import STILL
from .law import law_at
from .rows import ContactRows

SLACK = 1e-7  # relative imbalance that counts as balanced: the solver's own tolerance
ROUNDING = 1e-12  # by which programs may differ that are the same


def still_balances(rows: ContactRows, motions: np.ndarray, work: np.ndarray, size: np.ndarray,
                   x: np.ndarray, comm) -> bool:
    """Whether contact forces near those of the step before, multipliers x (owned,), balance loads.

    Each may change by a part of itself, or of its friction bound: by the least in all. Yes needs no
    linear program then; no may still be yes by other forces. Arguments as of `rigid_equilibrium`.
    Collective; the same answer on every rank.
    """
    motions = felt(rows, motions)
    normal, tangential = motions[rows.normal], motions[rows.tangential]
    pressure, bound = x[rows.normal], rows.friction_bound(x)
    held = comm.allreduce(normal.T @ pressure + tangential.T @ x[rows.tangential])
    gross = comm.allreduce(np.abs(normal).T @ np.abs(pressure) + np.abs(tangential).T @ bound)
    gives = comm.allreduce(normal.T @ (np.abs(pressure)[:, None] * normal)
                           + tangential.T @ (bound[:, None] * tangential))
    reach = np.sqrt(gives.diagonal())
    reach[reach == 0] = 1.0
    way = np.linalg.lstsq(gives / np.outer(reach, reach), (work - held) / reach, rcond=None)[0]
    way /= reach
    balanced = np.all(np.abs(held + gives @ way - work) <= SLACK * size + ROUNDING * gross)
    moved = x.copy()
    moved[rows.normal] += np.abs(pressure) * (normal @ way)
    moved[rows.tangential] += bound * (tangential @ way)
    obeys = (moved[rows.normal][~rows.pulls] >= 0).all() and (
        np.abs(moved[rows.tangential]) <= rows.friction_bound(moved)).all()
    return bool(balanced) and bool(comm.allreduce(int(not obeys)) == 0)


class Latest:
    """The program that was solved last, and its answer."""

    def __init__(self):
        self._law, self._loads, self._answer = None, None, None

    def answer(self, normal, gap, tangential, pair, coefficient, offset, pulls, work, size):
        """As of `_solve`, which is left out where the program is that of the last call."""
        law = normal, gap, tangential, pair, coefficient, pulls
        force = size.max(initial=0.0) or 1.0
        loads = np.concatenate([offset, work, size]) / force
        if not (self._law and all(map(np.array_equal, law, self._law))
                and np.allclose(loads, self._loads, rtol=0.0, atol=ROUNDING)):
            self._answer = _solve(normal, gap, tangential, pair, coefficient, offset, pulls, work,
                                  size)
            self._law, self._loads = law, loads
        return self._answer


def rigid_equilibrium(rows: ContactRows, motions: np.ndarray, work: np.ndarray, size: np.ndarray,
                      comm, latest: Latest | None = None):
    """Rigid motion (modes,) in which contact first balances the loads, or None if it cannot.

    `motions` (owned, modes): dual rows' displacement under every rigid motion; `work` (modes,) of
    the loads on them, `size` (modes,) of its terms; `latest`: of the steps before. Collective; the
    same answer on every rank.
    """
    motions = felt(rows, motions)
    law = law_at(rows, np.arange(len(rows.tangential)))
    parts = comm.gather((motions[rows.normal], rows.gap, rows.normal_node, rows.pulls,
                         motions[rows.tangential], rows.tangential_node, *law))
    answer = None
    if comm.rank == 0:
        columns = map(np.concatenate, zip(*parts))
        normal, gap, node, bilateral, tangential, rubbing, coefficient, offset = columns
        one, two = np.argsort(node), np.argsort(rubbing)  # ranks may own nodes in turn
        pair, pulls = np.searchsorted(node[one], rubbing[two]), np.flatnonzero(bilateral[one])
        answer = (latest or Latest()).answer(normal[one], gap[one], tangential[two], pair,
                                             coefficient[two], offset[two], pulls, work, size)
    return comm.bcast(answer)


def felt(rows: ContactRows, motions: np.ndarray) -> np.ndarray:
    """`motions` (owned, modes) without what nodes that face nothing move by."""
    if rows.idle is not None:
        motions = motions.copy()
        motions[rows.idle] = 0.0
    return motions


def _solve(normal, gap, tangential, pair, coefficient, offset, pulls, work, size):
    """The linear program, scaled to forces and motions of order one; `pulls`: bilateral nodes."""
    normal, gap = np.vstack([normal, -normal[pulls]]), np.append(gap, -gap[pulls])
    k, j = len(normal), len(tangential)
    reach = np.abs(np.vstack([normal, tangential])).max(axis=0, initial=0.0)
    if not size.any():
        return np.zeros(len(work))  # no load: no motion
    reach[reach <= STILL] = 0.0  # rounding, by which forces without end would resist a motion
    if np.any(reach[np.abs(work) > SLACK * size] == 0):
        return None  # a motion that no contact resists
    if not k + j:
        return np.zeros(len(work))  # nothing pushes, and nothing resists
    reach[reach == 0] = 1.0
    force = np.max(size / reach)
    balance = np.vstack([normal, tangential]).T / reach[:, None]
    cone, limit = None, np.full(j, np.inf)
    if not coefficient.any():
        limit = offset / force
    else:
        cone = _cone(coefficient, pair, pulls, k)
    from scipy.optimize import linprog  # slow to import, and only free bodies need it

    far = np.abs(gap).max(initial=0.0) or 1.0
    with silenced():
        answer = linprog(np.concatenate([gap / far, np.zeros(j)]), A_ub=cone,
                         b_ub=None if cone is None else np.tile(offset / force, 2), A_eq=balance,
                         b_eq=work / reach / force, method="highs", options=PLAIN_PROGRAM,
                         bounds=[(0.0, None)] * k + [(-b, b) for b in limit])
    if answer.status == 2:
        return None
    if answer.status != 0 or not gap.any():
        # unbounded: bodies overlap everywhere; the steps themselves find the motion
        return np.zeros(len(work))
    return answer.eqlin.marginals * far / reach


def _cone(coefficient: np.ndarray, pair: np.ndarray, pulls: np.ndarray, k: int) -> csr_matrix:
    """(2 j, k + j) rows of lambda_t - F lambda_n and of -lambda_t - F lambda_n.

    Assembled from its entries: many short histories wait for it. `pair` (j,) normal multipliers of
    tangential ones, k of them with the second parts of bilateral ones, which are the last.
    """
    row, either = np.arange(len(pair)), np.flatnonzero(np.isin(pair, pulls))
    second = k - len(pulls) + np.searchsorted(pulls, pair[either])
    rows = np.concatenate([row, either, row])
    columns = np.concatenate([pair, second, k + row])
    bound = np.concatenate([coefficient, coefficient[either]])
    values = [np.concatenate([-bound, np.full(len(row), sign)]) for sign in (1.0, -1.0)]
    return csr_matrix((np.concatenate(values), (np.concatenate([rows, rows + len(row)]),
                                                np.tile(columns, 2))),
                      shape=(2 * len(row), k + len(row)))
