"""Whether a refusal is right, by arguments that owe nothing to the solver.

A linear program over the assembled bodies: no contact forces inside their cones balance the loads
on a free rigid motion. Where contact pulls, the same with the friction that it allows (bounded.py).
A search of the states of the nodes (states.py), where contact pulls within the limits that friction
puts on normal forces: none of them solves the step. Where that comes to no end, dense
complementarity from random states (trials.py), which may find that the step has a solution.
"""

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import bmat, csr_matrix, diags, identity

from ..environment import PLAIN_PROGRAM, silenced
from . import laws
from .bounded import unbalanced_by_friction
from .oracle import Assembled
from .programs import MOST, none_within
from .slip_limits import SlipLimits
from .states import States
from .trials import solution

SLACK = 1e-6  # share of the forces that must stay unbalanced at least
# of the search of states and of the mixed-integer program, whatever the machine: a minute each
PROGRAMS, NODES = 4000, 2000
STARTS = 500  # random states from which a solution is looked for: half a minute


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
    size = laws.sizes(body, np.abs(weights) @ np.abs(body.loads))
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
    with silenced():
        answer = linprog(
            np.append(np.zeros(2 * count), 1.0),
            A_ub=bmat([[cone.tocsr()[kept], None], [csr_matrix(moves), -share],
                       [csr_matrix(-moves), -share]]).tocsr() if modes else None,
            b_ub=np.concatenate([room[kept], -work, work]),
            bounds=[(None, None if pull else 0.0) for pull in pulls] + [(None, None)] * count
            + [(0.0, None)], method="highs", options=PLAIN_PROGRAM)
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
             slipped: np.ndarray | None = None, gap: np.ndarray | None = None,
             counts: np.ndarray | float = 1.0) -> tuple[bool, str]:
    """Whether the step is shown to have no solution, and by which argument, or why not.

    `weights` (patterns,) of the step's loads, `u_t` (n_c,) tangential displacements of nodes that
    do not slide in it, `slipped` (n_c,) the way of nodes until then, `gap` (n_c,) if it is not
    that of the start, `counts` (n_c,) the part of slip in the step that a slip law counts. Where
    friction needs no pressure, any inside its bound is admitted at corners: more than there is, so
    that "no solution" is certain.
    """
    states = _in_units(body, manifest, weights, u_t, slipped, gap, counts)
    share, limited = unbalanced_by_friction(states)
    if share > SLACK:
        return True, f"bounds of friction: {share:.1e} of the forces stay unbalanced"
    solved = limited.search(PROGRAMS)
    if solved:
        return False, "it has a solution, in states that the search has come to"
    if solved is None:
        if solution(states, STARTS) is not None:
            return False, "it has a solution, to which random states lead"
        if none_within(states, NODES):
            return True, (f"mixed-integer program: no states solve it by forces and ways of up to "
                          f"{MOST:g} times the loads'")
        return True, f"dense complementarity: {STARTS} random states lead to no solution"
    return True, "search of states: no states of the nodes solve it"


def _slip_limits(body: Assembled, manifest, before, unit, ways, counts) -> SlipLimits | None:
    """The slip law of a step, None if there is none.

    `before` (2, n_c): sum of slip and displacement where nothing slides in the step; `unit` (n_c,)
    of coefficients and `ways` (n_c,) of slip, of which an accumulated one `counts` (n_c,).
    """
    law = manifest.rooms.get("slip_law")
    if not law:
        return None
    travelled = law["argument"] == "slip"
    own = laws.rubbing(body) * body.columns.get("friction", np.zeros(len(body.gid)))
    return SlipLimits(np.linspace(0.0, law["range"], len(law["values"])), np.array(law["values"]),
                      own * unit, ways * counts if travelled else ways,
                      before[0] if travelled else before[1], travelled)


def _in_units(body: Assembled, manifest, weights, u_t, slipped, gap, counts) -> States:
    """The step in which loads make forces and ways of order one; every row in its own stiffness.

    Stiff nodes: large forces, small ways, by the root of their compliance over the largest.
    """
    count, gap = len(body.gid), body.gap if gap is None else gap
    most, offset = largest_friction(body, manifest, slipped)
    least, _ = largest_friction(body, manifest, slipped, np.minimum)
    C = np.array([body.B @ body.solve(0 * weights, row) for row in body.B]).T
    loaded, turned = body.B @ body.solve(weights), body.B @ body.motions
    own = np.diag(C)
    unit = np.sqrt(own.max() / np.where(own > 1e-12 * own.max(), own, own.max()))
    u_n, u_s = unit[:count], unit[count:]
    near = max(np.abs(loaded).max(), np.abs(gap).max(), np.abs(u_t).max())
    force = near / own.max()
    size = np.abs(turned).max(axis=0, initial=0.0)
    size[size == 0] = 1.0
    room = np.where(laws.supported(body), np.inf, (gap - loaded[:count]) * u_n / near)
    turned = turned / size * unit[:, None]
    before = np.zeros(count) if slipped is None else slipped, u_t
    return States(
        np.hstack([C * unit[:, None] * unit * force / near, turned]), room,
        (u_t - loaded[count:]) * u_s / near, least * u_n / u_s, most * u_n / u_s,
        offset / force / u_s, turned.T, body.motions.T @ (weights @ body.loads) / force / size,
        laws.pulling(body, manifest), laws.resting(body),
        law=_slip_limits(body, manifest, before, u_n / u_s, near / u_s, counts),
        slips=np.array([[-np.inf], [np.inf]]) * np.ones(count))
