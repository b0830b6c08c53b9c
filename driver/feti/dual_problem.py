"""What the time stepping needs to know of a dual problem min 1/2 lambda' F lambda - lambda' d."""

import copy
import dataclasses
from abc import ABC, abstractmethod

import numpy as np
from mpi4py import MPI

from .structure import Substructure


class DualProblem(ABC):
    """F and d on the rank's share of the dual rows.

    Vectors of multipliers are numpy arrays (owned,), the rank's part of `structure.dual_dofs`
    entries; loads are factors of the load patterns, which may go on with those of the free rigid
    motions. `products` counts those with F. `contact_rows_only`: there are no other rows, and F is
    the dense matrix `C` on every rank.

    Of bodies that no support holds, nothing by default: `modes` is the number of their rigid
    motions, `motions` (owned,) each the displacements of the dual rows under them, `rho` (modes,)
    the compliances of the springs that hold them and `rigid_work` (2, patterns, modes) the work of
    the load patterns on them, and that of its absolute values. `row_level` (owned,) is which of the
    `levels` of stiffness a row belongs to, see stiff_parts.py; `uneven`: stiffness jumps by so much
    that only refined displacements have the digits of a step's tolerances. `travels` holds by load
    pattern the displacements (owned,) of the dual rows by the rigid motion that supports prescribe,
    where any.
    """

    contact_rows_only = False
    softness: np.ndarray | None = None  # (owned,) diagonal that a step adds to F
    structure: Substructure
    owned: int
    products = 0
    modes = 0
    motions: list[np.ndarray]
    travels: dict[int, np.ndarray]
    levels = 1
    uneven = bodies_differ = False
    row_level: np.ndarray
    rho: np.ndarray
    rigid_work: np.ndarray

    def __init__(self, structure: Substructure, owned: int, comm):
        self.structure, self.owned, self.comm = structure, owned, comm
        self.row_level = np.zeros(owned, int)
        self.motions, self.travels, self.rho = [], {}, np.zeros(0)
        self.rigid_work = np.zeros((2, structure.patterns, 0))

    @abstractmethod
    def apply(self, multipliers: np.ndarray) -> np.ndarray:
        """F times a dual vector; collective."""

    def gradient(self, multipliers: np.ndarray, load) -> np.ndarray:
        """F lambda - d (owned,) of a Load of march/step.py, to all digits.

        A product that rounds off less than F itself may where stiffness jumps; then springs that
        hold bodies without support move nothing, as they do in equilibrium. Collective.
        """
        return self.apply(multipliers) - load.d

    @abstractmethod
    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Global scalar product of two dual vectors; collective."""

    def dots(self, *pairs: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """(k,) those of k pairs, to the last bit, at once where that is cheaper; collective."""
        return np.array([self.dot(a, b) for a, b in pairs])

    def minimum(self, value: float) -> float:
        """The smallest of the ranks' numbers; collective."""
        return self.comm.allreduce(value, op=MPI.MIN) if self.comm.size > 1 else value

    @abstractmethod
    def elastic_response(self, weights: np.ndarray) -> np.ndarray:
        """B w (owned,) by the load sum_k weights_k f_k, without any rigid motion."""

    def rigid_response(self, weights: np.ndarray) -> np.ndarray:
        """B r (owned,) by the travel of the patterns and the motions that their factors go on with.
        """
        factors = [(weights[k], moved) for k, moved in self.travels.items()]
        factors += zip(weights[self.structure.patterns :], self.motions)
        return sum((w * moved for w, moved in factors), np.zeros(self.owned))

    @abstractmethod
    def deformation(self, multipliers: np.ndarray, weights: np.ndarray) -> float:
        """Largest displacement of a node relative to the rigid motion of its body; collective."""

    def deformation_by_level(self, multipliers: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(levels,) what displacements of the rows of every level are relative to; collective."""
        return np.array([self.deformation(multipliers, weights)])

    def least_deformation(self, multipliers: np.ndarray, weights: np.ndarray) -> float:
        """A lower bound of the deformation, for less work where there is one; collective."""
        return self.deformation(multipliers, weights)

    @abstractmethod
    def preconditioner(self):
        """Callable (residual, free) -> preconditioned residual on the face, zero elsewhere."""

    def follow(self, step) -> None:
        """Take the contact rows that a Step was solved with, where they change; collective."""

    def norm_bound(self, scale: np.ndarray) -> float | None:
        """Bound of ||D F D||, D = diag(scale), (owned,); None where only products could tell."""
        return None

    def imbalance(self, multipliers: np.ndarray,
                  weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(modes,) work of all forces on the rigid motions, zero in equilibrium; its sizes."""
        return np.zeros(0), np.zeros(0)

    @property
    def jumps(self) -> bool:
        """Whether rows differ in stiffness, or displacements have too few digits."""
        return self.levels > 1 or self.uneven

    def by_springs(self, multipliers: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(owned,) what springs that hold bodies without support move the rows by; collective."""
        if not self.modes:
            return np.zeros(self.owned)
        net, _ = self.imbalance(multipliers, weights)
        return sum((way * motion for way, motion in zip(self.rho * net, self.motions)),
                   np.zeros(self.owned))

    def with_contact(self, contact) -> "DualProblem":
        """The same body with other gaps, friction or initial state; counts its own products."""
        other = copy.copy(self)
        other.structure, other.products = dataclasses.replace(self.structure, contact=contact), 0
        return other
