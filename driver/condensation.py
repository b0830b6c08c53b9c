"""The contact part of the dual vectors: dense, in the order of the contact nodes, the same on every rank."""

from dataclasses import dataclass

import numpy as np

from .complementarity import CoulombProblem
from .compliance import ContactCompliance
from .fetidp import DualOperator
from .friction import ContactRows
from .step import Load
from .substructuring import GLUING


@dataclass
class Condensation:
    """Contact rows in the order of the contact nodes, normal ones first, and their compliance once it is asked for.

    Collective over the operator's communicator.
    """

    operator: DualOperator | ContactCompliance
    rows: ContactRows

    def __post_init__(self):
        contact = self.operator.structure.contact
        self._nodes = len(contact.gid)
        self._normal, self._tangential = (np.flatnonzero(r >= 0) for r in (contact.normal_row, contact.tangential_row))
        self.pair = np.searchsorted(self._normal, self._tangential)
        self.n, self.m = len(self._normal), len(self._tangential)
        self._compliance = None

    def gather(self, local: np.ndarray) -> np.ndarray:
        """(n + m,) contact part of a dual vector, on every rank."""
        found = np.zeros((2, self._nodes))
        found[0, self.rows.normal_node] = local[self.rows.normal]
        found[1, self.rows.tangential_node] = local[self.rows.tangential]
        found = np.sum(self.operator.comm.allgather(found), axis=0)
        return np.concatenate([found[0, self._normal], found[1, self._tangential]])

    def place(self, x: np.ndarray, into: np.ndarray) -> np.ndarray:
        """The dual vector `into` with its contact part replaced by x (n + m,)."""
        full, moved = np.zeros((2, self._nodes)), into.copy()
        full[0, self._normal], full[1, self._tangential] = x[: self.n], x[self.n :]
        moved[self.rows.normal] = full[0, self.rows.normal_node]
        moved[self.rows.tangential] = full[1, self.rows.tangential_node]
        return moved

    def held(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Limits that hold the contact part of the dual vector x and leave its gluing part free."""
        lower, upper = np.full(len(x), -np.inf), np.full(len(x), np.inf)
        for rows in (self.rows.normal, self.rows.tangential):
            lower[rows] = upper[rows] = x[rows]
        return lower, upper

    @property
    def known(self) -> bool:
        """Whether the compliance was asked for."""
        return self._compliance is not None

    def compliance(self) -> np.ndarray:
        """C (n + m, n + m), found at the first call. Raises NotConverged."""
        if self._compliance is None:
            op, structure = self.operator, self.operator.structure
            whole = op.C if isinstance(op, ContactCompliance) else ContactCompliance(op).C
            rows = np.concatenate([structure.contact.normal_row[self._normal],
                                   structure.contact.tangential_row[self._tangential]])
            order = np.searchsorted(np.flatnonzero(structure.row_kind != GLUING), rows)
            self._compliance = whole[np.ix_(order, order)]
        return self._compliance

    def problem(self, load: Load, x: np.ndarray, gradient: np.ndarray) -> CoulombProblem:
        """The condensed problem whose load is exact at the dual vector x with zero gradient on the gluing rows.

        Rigid motions of bodies without support are relative to those in `load`.
        """
        C, op = self.compliance(), self.operator
        coefficient = np.zeros(len(x))
        coefficient[self.rows.tangential] = self.rows.bound
        coefficient, motions, balance = self.gather(coefficient)[self.n :], None, None
        if op.modes:
            motions = np.column_stack([self.gather(d) for d, _ in op.loaded[op.structure.patterns :]])
            balance = load.weights[: op.structure.patterns] @ op.rigid_work[0]
        return CoulombProblem(C, C @ self.gather(x) - self.gather(gradient), coefficient, self.pair, self.rows.bilateral,
                              motions, balance)
