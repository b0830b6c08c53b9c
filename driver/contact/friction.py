"""Contact and friction laws at the contact nodes: bounds of the multipliers, status, KKT residuals.

Multipliers are nodal forces on the body: lambda_n >= 0 presses along -n, lambda_t pushes along -t, so
that sigma_n = -lambda_n / weight and sigma_t = -lambda_t / weight. With r = F lambda - d the rows read
B u - c = -r, where c is the gap (normal) or the previous tangential displacement (tangential rows).
"""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ..feti.substructuring import GLUING, Substructure
from .states import OPEN, SLIP, STICK


@dataclass(frozen=True)
class SlipLaw:
    """Factor of the friction coefficient that depends on slip or displacement, tabulated by the scene.

    `argument`: "slip" (length of the way slid so far) or "displacement" (|u_t|); `values` at equal steps
    over [0, range], constant beyond.
    """

    argument: str
    range: float
    values: np.ndarray

    def factor(self, u_t: np.ndarray, previous: np.ndarray, way: np.ndarray) -> np.ndarray:
        """(j,) factors for tangential displacements u_t, those of the previous step and the way slid until then."""
        s = np.abs(u_t) if self.argument == "displacement" else way + np.abs(u_t - previous)
        return np.interp(s, np.linspace(0.0, self.range, len(self.values)), self.values)


@dataclass
class ContactRows:
    """The contact rows a rank owns, as positions in its dual vectors.

    `normal` (k,) with `gap` and `node`; `tangential` (j,) with `pair`, the position of the same node's
    normal row, `bound` (friction coefficient, or given bound times weight for Tresca) and `node`.
    """

    normal: np.ndarray
    normal_node: np.ndarray
    gap: np.ndarray
    tangential: np.ndarray
    tangential_node: np.ndarray
    pair: np.ndarray
    bound: np.ndarray
    gluing: np.ndarray
    tresca: bool
    bilateral: bool

    def limits(self, size: int, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of all owned multipliers under nodal pressures `pressure` (owned,)."""
        return self.limits_at(size, self.friction_bound(pressure))

    def limits_at(self, size: int, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same under the friction bounds `bound` (j,)."""
        lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
        if not self.bilateral:
            lower[self.normal] = 0.0
        lower[self.tangential], upper[self.tangential] = -bound, bound
        return lower, upper

    def pressing(self, x: np.ndarray) -> np.ndarray:
        """x without the pulling normal multipliers that contact has not, unless it is bilateral."""
        pressed = x.copy()
        if not self.bilateral:
            pressed[self.normal] = np.maximum(x[self.normal], 0.0)
        return pressed

    def sliding(self, x: np.ndarray, bound: np.ndarray) -> np.ndarray:
        """(j,) sign of the multiplier at tangential rows that are on their bound, 0 at the others."""
        multiplier = x[self.tangential]
        return np.where(np.abs(multiplier) >= bound, np.sign(multiplier), 0.0)

    def follow(self, x: np.ndarray, sliding: np.ndarray) -> np.ndarray:
        """x with sliding nodes moved to, and the others cut at, the friction bound of its own pressures.

        Left where they were, sliding nodes would be inside a bound that has grown and the QP would have to
        find them again one expansion step after the other.
        """
        moved, t = x.copy(), self.tangential
        bound = self.friction_bound(x)
        moved[t] = np.where(sliding != 0, sliding * bound, np.minimum(np.maximum(x[t], -bound), bound))
        return moved

    def friction_bound(self, multipliers: np.ndarray) -> np.ndarray:
        """(j,) largest friction force: F |lambda_n| (Coulomb) or the given bound (Tresca)."""
        return self.bound if self.tresca else self.bound * np.abs(multipliers[self.pair])


def contact_rows(structure: Substructure, effects: dict) -> ContactRows:
    """The rank's contact rows from the replicated contact boundary."""
    contact, (start, stop) = structure.contact, structure.row_range
    mine = lambda rows: np.flatnonzero((rows >= start) & (rows < stop))
    normal, tangential = mine(contact.normal_row), mine(contact.tangential_row)
    tresca = effects["friction"] == "tresca"
    bound = contact.friction[tangential] * (contact.weight[tangential] if tresca else 1.0)
    return ContactRows(
        contact.normal_row[normal] - start, normal, contact.gap[normal],
        contact.tangential_row[tangential] - start, tangential, contact.normal_row[tangential] - start, bound,
        np.flatnonzero(structure.row_kind[start:stop] == GLUING), tresca, effects["contact"] == "bilateral")


class SlidState:
    """What friction keeps from step to step: tangential displacements `u_t` and the length `way` of the way slid, (j,).

    Friction coefficients that depend on them are renewed in `rows`.
    """

    def __init__(self, rows: ContactRows, initial: np.ndarray, law: SlipLaw | None):
        self.rows, self.law, self.coefficient = rows, law, rows.bound
        self.u_t, self.way = initial[rows.tangential_node], np.zeros(len(rows.tangential))

    def renew_coefficient(self, gradient: np.ndarray) -> None:
        """Friction coefficients at the tangential displacements of the latest iterate."""
        if self.law is not None:
            u_t = self.u_t - gradient[self.rows.tangential]
            self.rows.bound = self.coefficient * self.law.factor(u_t, self.u_t, self.way)

    def advance(self, gradient: np.ndarray) -> None:
        """A step ends with this gradient."""
        slip = -gradient[self.rows.tangential]
        self.u_t, self.way = self.u_t + slip, self.way + np.abs(slip)


@dataclass
class Scales:
    """Largest values met so far in a run: what residuals are relative to, also in steps without load."""

    d: float = 0.0  # ||d||
    displacement: float = 0.0
    pressure: float = 0.0  # nodal force
    work: np.ndarray | float = 0.0  # (modes,) of the forces on every free rigid motion, absolute values added up


def kkt_residuals(rows: ContactRows, multipliers, gradient, left: float, scales: Scales, comm) -> dict:
    """Relative KKT residuals of one time step, the largest over the contact and gluing rows.

    gluing, penetration: relative to the largest displacement; sign, cone: relative to the largest nodal
    pressure; complementarity: pressure times distance, and friction's lost dissipation g |slip| - lambda_t slip,
    relative to the product of both; stationarity: norm `left` of the projected gradient relative to ||d||.
    Updates the largest pressure in `scales`.
    """
    move = -gradient
    lambda_n, lambda_t = multipliers[rows.normal], multipliers[rows.tangential]
    bound, slip, over = rows.friction_bound(multipliers), move[rows.tangential], move[rows.normal]
    one_sided = np.zeros(0) if rows.bilateral else lambda_n
    local = np.array([
        np.abs(move[rows.gluing]).max(initial=0),
        (np.abs(over) if rows.bilateral else over).max(initial=0),
        (-one_sided).max(initial=0) + 0.0,  # no -0.0
        (np.abs(lambda_t) - bound).max(initial=0),
        (np.abs(one_sided * over[: len(one_sided)])).max(initial=0),
        (bound * np.abs(slip) - lambda_t * slip).max(initial=0),
        np.abs(lambda_n).max(initial=0),
    ])
    local[np.isnan(local)] = np.inf  # which MPI's maximum may lose
    comm.Allreduce(MPI.IN_PLACE, local, op=MPI.MAX)
    gluing, penetration, sign, cone, gap_work, slip_work, force = local
    scales.pressure = max(scales.pressure, float(force))
    ratio = lambda a, b: float(a / b) if b > 0 else float(a > 0)
    return {"stationarity": ratio(left, scales.d), "gluing": ratio(gluing, scales.displacement),
            "penetration": ratio(penetration, scales.displacement), "sign": ratio(sign, scales.pressure),
            "cone": ratio(cone, scales.pressure),
            "complementarity": ratio(max(gap_work, slip_work), scales.pressure * scales.displacement)}


def status(rows: ContactRows, multipliers: np.ndarray) -> np.ndarray:
    """(k,) open, stick or slip of the nodes with a normal row, by exact comparison with the bounds."""
    found = np.full(len(rows.normal), STICK)
    if not rows.bilateral:
        found[multipliers[rows.normal] == 0] = OPEN
    sliding = np.abs(multipliers[rows.tangential]) >= rows.friction_bound(multipliers)
    at = np.searchsorted(rows.normal_node, rows.tangential_node)
    found[at[sliding & (found[at] == STICK)]] = SLIP
    if len(rows.tangential) == 0:  # without friction nothing holds a node that touches
        found[found == STICK] = SLIP
    return found

