"""Whether a refusal is right, by arguments that owe nothing to the solver.

A linear program over the assembled bodies: no contact forces inside their cones balance the loads
on a free rigid motion. A mixed-integer program: no choice of open, sticking and sliding nodes
solves the step.
"""

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import bmat, csr_matrix, diags, identity

from . import laws
from .oracle import Assembled

SLACK = 1e-6  # share of the forces that must stay unbalanced at least
NODES = 40  # most contact nodes of the mixed-integer program
SECONDS = 30.0  # that it may take
# contact forces and displacements that it looks for, relative to the loads' own: far enough that a
# solution is not missed, near enough that rounding of the binaries does not open closed nodes
REACHES = 100.0, 3000.0


def unbalanced(body: Assembled, manifest, weights: np.ndarray, rough: bool = True,
               slipped: np.ndarray | None = None) -> float:
    """Least imbalance of any contact forces in their cones, relative to the loads; 0 if none.

    Without friction if not `rough`.

    The friction cone is that of the largest coefficient a slip law can give, to nodes that have
    slipped by `slipped` (n_c,) before; where contact can pull, friction is free, which only makes
    balance easier.
    """
    count = len(body.gid)
    if not body.motions.shape[1]:
        return 0.0
    work = body.motions.T @ (weights @ body.loads)
    size = np.abs(body.motions).T @ (np.abs(weights) @ np.abs(body.loads))
    if not size.any():
        return 0.0
    work, force = work / size.max(), size.max()
    moves = (body.B @ body.motions).T  # (modes, 2 n_c): work of unit forces along n and t
    pulls = laws.pulling(body, manifest)
    coefficient, offset = (rough * of for of in largest_friction(body, manifest, slipped))
    unit = identity(count, format="csr")
    cone = bmat([[diags(coefficient) @ unit, unit], [diags(coefficient) @ unit, -unit]])
    room = np.tile(offset / force, 2)
    kept = np.tile(~pulls | (coefficient == 0), 2)
    modes = len(work)
    share = np.ones((modes, 1))
    answer = linprog(
        np.append(np.zeros(2 * count), 1.0),
        A_ub=bmat([[cone.tocsr()[kept], None], [csr_matrix(moves), -share],
                   [csr_matrix(-moves), -share]]).tocsr() if modes else None,
        b_ub=np.concatenate([room[kept], -work, work]),
        bounds=[(None, None if pull else 0.0) for pull in pulls] + [(None, None)] * count
        + [(0.0, None)], method="highs")
    return float(answer.fun) if answer.status == 0 else 0.0


def largest_friction(body: Assembled, manifest, slipped: np.ndarray | None = None,
                     largest=np.maximum) -> tuple[np.ndarray, np.ndarray]:
    """(n_c,) largest coefficient that a slip law can give, and bound that needs no pressure.

    Slip only grows: nodes that have `slipped` (n_c,) have the law's values from there on. Zero
    where nothing rubs. With np.minimum for `largest` the least coefficient.
    """
    zero, factor, law = np.zeros(len(body.gid)), 1.0, manifest.rooms.get("slip_law")
    if law:
        table, values = np.linspace(0.0, law["range"], len(law["values"])), np.array(law["values"])
        known = slipped is not None and law["argument"] == "slip"
        start = slipped if known else np.full(len(body.gid), -np.inf)
        now = np.interp(start, table, values)
        to_come = np.where(table > start[:, None], values, now[:, None])
        factor = largest(now, largest.reduce(to_come, axis=1))
    offset = body.columns.get("cohesion", zero) + body.columns.get("tresca", zero)
    rubs = laws.rubbing(body)
    return rubs * factor * body.columns.get("friction", zero), rubs * offset * body.weight


def no_state(body: Assembled, manifest, weights: np.ndarray, u_t: np.ndarray,
             slipped: np.ndarray | None = None) -> str:
    """Empty if the step has no solution, else why that is not shown.

    `weights` (patterns,) of the step's loads, `u_t` (n_c,) tangential displacements before it,
    `slipped` (n_c,) the way of nodes until then. Binary variables say whether a node is closed, and
    whether it sticks or slides to either side; where a slip law changes friction, with any force
    between the least and the largest that it can give: more than it has is admitted, so that "no
    solution" is certain.
    """
    count = len(body.gid)
    coefficient, offset = largest_friction(body, manifest, slipped)
    least, _ = largest_friction(body, manifest, slipped, np.minimum)
    pulls = laws.pulling(body, manifest)
    meets = laws.corners(body).any(axis=1)
    if coefficient[pulls].any() or offset[meets].any():
        return "the law of friction is no linear one"
    if count > NODES:
        return f"{count} contact nodes are too many for the mixed-integer program"
    C = np.array([body.B @ body.solve(0 * weights, row) for row in body.B]).T
    loaded, turned = body.B @ body.solve(weights), body.B @ body.motions
    near = max(np.abs(loaded).max(), np.abs(body.gap).max(), np.abs(u_t).max())
    force = near / np.diag(C).max()
    size = np.abs(turned).max(axis=0, initial=0.0)
    size[size == 0] = 1.0
    load = body.motions.T @ (weights @ body.loads) / force / size
    room = np.where(laws.supported(body), np.inf, (body.gap - loaded[:count]) / near)
    for reach in REACHES:
        program = _Program(count, len(size), reach)
        program.balance((turned / size).T, load)
        program.contact(C[:count] * force / near, turned[:count] / size, room, pulls)
        program.corners(laws.corners(body))
        program.friction(C[count:] * force / near, turned[count:] / size,
                         (u_t - loaded[count:]) / near, (least, coefficient), offset / force)
        status = program.solve(pulls)
        if status != 2:
            return "the mixed-integer program has a solution" if status == 0 else (
                "the mixed-integer program was not decided in time")
    return ""


class _Program:
    """Forces and displacements in units of order one.

    Unknowns: forces on the body along n (n,) and t (n,), rigid motions, and binaries: the node is
    open, sticks, slides forwards, backwards, rests in a corner (n,) each.
    """

    STATES = "open", "stick", "forwards", "backwards", "rests"

    def __init__(self, count: int, modes: int, reach: float):
        self.count, self.modes, self.reach = count, modes, reach
        self.rows, self.low, self.high = [], [], []

    def _add(self, low, high, normal=0.0, tangential=0.0, motions=None, **states) -> None:
        """Rows low <= ... <= high; coefficients of the states as numbers or (n,)."""
        n = self.count
        parts = [value if np.ndim(value) == 2 else np.diag(value * np.ones(n))
                 for value in (normal, tangential)]
        parts.append(np.zeros((n, self.modes)) if motions is None else motions)
        parts += [np.diag(states.get(name, 0.0) * np.ones(n))
                  for name in self.STATES]
        self.rows.append(np.hstack(parts))
        self.low.append(low * np.ones(n))
        self.high.append(high * np.ones(n))

    def balance(self, turned: np.ndarray, load: np.ndarray) -> None:
        """Forces balance the load (modes,) on every rigid motion."""
        self.rows.append(np.hstack([turned, np.zeros((self.modes, self.modes + 5 * self.count))]))
        self.low.append(-load)
        self.high.append(-load)

    def contact(self, C: np.ndarray, motions: np.ndarray, room: np.ndarray, pulls) -> None:
        """u_n <= gap, and equal or without force: `room` (n,) is what the load leaves of the gap.
        """
        n = self.count
        self._add(-self.reach, np.inf, normal=1.0, open=-self.reach)
        self._add(-np.inf, room, C[:, :n], C[:, n:], motions)
        self._add(np.where(np.isinf(room), -np.inf, room), np.inf, C[:, :n], C[:, n:], motions,
                  open=self.reach)
        self._add(-np.inf, np.where(pulls, 0.0, 1.0), open=1.0)

    def corners(self, others: np.ndarray) -> None:
        """Only nodes at a vertex with another one, `others` (n, n), rest there, if both close."""
        self._add(-np.inf, others.any(axis=1).astype(float), rests=1.0)
        self._add(-np.inf, 1.0, rests=1.0, open=1.0)
        n = self.count
        for i, k in zip(*np.nonzero(others)):
            row = np.zeros((1, 7 * n + self.modes))
            row[0, [6 * n + self.modes + i, 2 * n + self.modes + k]] = 1.0
            self.rows.append(row)
            self.low.append(np.array([-np.inf]))
            self.high.append(np.array([1.0]))

    def friction(self, C: np.ndarray, motions, start: np.ndarray, coefficients, offset) -> None:
        """Within its bound, on it and against the slip where it slides from `start` (n,).

        On it: between the bounds by the least and the largest of `coefficients`.
        """
        least, coefficient = coefficients
        n, reach = self.count, self.reach * (1.0 + coefficient) + offset
        self._add(1.0, 1.0, stick=1.0, forwards=1.0, backwards=1.0, rests=1.0)
        far, slip = self.reach, (C[:, :n], C[:, n:], motions)
        self._add(-np.inf, start, *slip, forwards=-far, rests=-far)
        self._add(start, np.inf, *slip, backwards=far, rests=far)
        self._add(-np.inf, offset, coefficient, 1.0)
        self._add(-offset, np.inf, -coefficient, 1.0)
        self._add(-np.inf, 2 * reach - offset, -least, 1.0, forwards=2 * reach)
        self._add(offset - 2 * reach, np.inf, least, 1.0, backwards=-2 * reach)

    def solve(self, pulls: np.ndarray) -> int:
        """0 if there is a solution, 2 if there is none, else undecided."""
        n, m = self.count, self.modes
        lower = np.concatenate([np.full(n, -self.reach), np.full(n + m, -np.inf), np.zeros(5 * n)])
        upper = np.concatenate([np.where(pulls, self.reach, 0.0), np.full(n + m, np.inf),
                                np.ones(5 * n)])
        constraints = LinearConstraint(csr_matrix(np.vstack(self.rows)),
                                       np.concatenate(self.low), np.concatenate(self.high))
        return milp(np.zeros(7 * n + m), integrality=np.arange(7 * n + m) >= 2 * n + m,
                    bounds=Bounds(lower, upper), constraints=constraints,
                    options={"time_limit": SECONDS}).status
