"""The FETI-DP reduction of the torn body, min 1/2 lambda' F lambda - lambda' d.

With the space X = X^r + X^c of the slides (corner dofs c primal, all others r torn), constraint
rows B = [B_r, B_c] and multipliers lambda (forces),

    u_r = K_rr^-1 (f_r - B_r' lambda - K_rc u_c),
    S_cc u_c = f_c - K_cr K_rr^-1 f_r - A' lambda,        A = B_c - B_r K_rr^-1 K_rc,
    S_cc = K_cc - K_cr K_rr^-1 K_rc,

and elimination of u leaves  B u = d - F lambda  with

    F = B_r K_rr^-1 B_r' + A S_cc^-1 A',      d = B u(lambda = 0).

Where no support holds a body springs do (free_motions.py). The local parts of F and A are explicit
dense matrices (see reduction.py); subdomains with equal ones share them, which turns the product
into a few dense products with many columns. See Farhat, Lesoinne, Le Tallec, Pierson, Rixen (2001);
Klawonn, Rheinbach: FETI-DP methods for elasticity; Mandel, Dohrmann, Tezaur (2005) for the algebra.

Results do not depend on the number of ranks, not even in the last bit (see vectors.py): dense
products go in blocks of fixed size (blocks.py), classes take the matrices of their first subdomain
wherever it lives, and the coarse problem is solved on every rank or by groups of subdomains.
"""

import numpy as np

from ..environment import give_back_memory, heed_lost_interrupt
from ..errors import NoSolution, agree
from . import free_motions
from .blocks import BlockDiagonal, by_half
from .coarse import CoarseProblem
from .dirichlet import DirichletPreconditioner
from .dual_problem import DualProblem
from .extended_precision import Refinement
from .recovery import Recovery
from .reduction import LocalClass, group, reduce_class, renew_rows, stack
from .rigid_parts import LeastDeformation, RigidParts
from .rows import RowKind
from .stiff_parts import StiffParts
from .structure import Substructure
from .travel import rows_moved
from .vectors import DualVectors

# part of a load's terms, or of all contact forces, below which what they come to is nothing:
# tolerances down to 1e-8 are met beside it
BALANCED = 1e-6


class DualOperator(DualProblem):
    """F and d of a torn body; collective over `comm`. Raises NoSolution where something is loose.

    `classes` are those of equal subdomains, `vectors` the layout of dual vectors and local rows,
    `coarse` the coarse problem; `acting` are the local subdomains with loads, supports or springs.
    """

    def __init__(self, structure: Substructure, comm, ahead: dict | None = None):
        """`ahead`: interiors of local subdomains that were eliminated before, by their numbers."""
        super().__init__(structure, structure.row_range[1] - structure.row_range[0], comm)
        self.modes = len(structure.rigid_modes)
        self.classes = _reduced(structure, comm, ahead or {})
        self._lay_out()
        self.coarse = CoarseProblem(structure, self.classes, comm)
        self._recovery = Recovery(structure, self.classes, self.coarse)
        self._refinement = self._finest = None  # made where they are first needed
        self.acting = [s for s, sub in enumerate(structure.subdomains)
                       if sub.loads.any() or len(structure.fixed[s]) or sub.springs is not None]
        self.motions = free_motions.displacements(structure, self.classes, self.vectors, comm)
        self._motion_columns = np.array(self.motions).reshape(self.modes, self.owned).T
        self._contact = (structure.row_kind != RowKind.GLUING).astype(float)
        self.rho = self.coarse.rho = free_motions.spring_compliances(self.classes, self.vectors,
                                                                     self.motions)
        self.travels = {k: rows_moved(structure, self.classes, self.vectors, k)
                        for k in structure.travel.patterns}
        # B w and the stacked corner displacements under every load pattern, then rigid motion
        self._loaded = [self._response(unit) for unit in np.eye(structure.patterns)]
        corners = structure.rigid_corners[self.coarse.numbers]
        self._loaded += [(d, corners[:, k]) for k, d in enumerate(self.motions)]
        self.rigid_work = free_motions.work_of_loads(structure, comm)
        self.rigid_parts = RigidParts(structure, comm)
        self.stiff_parts = StiffParts(structure, comm)
        self.row_level = self.stiff_parts.level
        self.levels = len(self.stiff_parts.exponents)
        self.uneven = self.stiff_parts.uneven
        self.bodies_differ = self.stiff_parts.bodies_differ
        self._least = LeastDeformation(structure, self.classes, comm)
        self._latest = None  # multipliers, weights and their fields, see `deformations`
        self._fields = None  # displacements under every load pattern, see `renew`
        give_back_memory()

    def _lay_out(self) -> None:
        """Local rows of all classes, and products with their matrices."""
        stack(self.classes)
        self.vectors = DualVectors(self.structure, self.classes, self.comm)
        self._F = BlockDiagonal(self.classes, [c.F_kept for c in self.classes], "rows", "rows")
        for c, block in zip(self.classes, self._F.blocks):
            c.F_kept = block  # where the product keeps it, and not once more
        self._A = BlockDiagonal(self.classes, [c.A for c in self.classes], "rows", "corners")
        transposed = [c.A_transposed for c in self.classes]
        self._A_transposed = BlockDiagonal(self.classes, transposed, "corners", "rows")

    def _response(self, weights: np.ndarray,
                  forces: list | None = None) -> tuple[np.ndarray, np.ndarray]:
        """B w (owned,) and stacked corner displacements under loads and forces alone."""
        rows, corner = self._recovery.response(weights, forces)
        self._A_transposed.multiply(corner, rows, add=True)
        return self.vectors.assemble(rows * self.vectors.sign), corner

    # ---- contact that follows the motion ---------------------------------------------------------
    def renew(self, contact) -> None:
        """Take the contact rows of `contact`, a ContactBoundary with the same nodes; collective.

        Factors of subdomains, the coarse problem and all rows of others stay.
        """
        structure = self.structure
        if self._fields is None:
            none = np.zeros(len(self.vectors.sign))
            self._fields = [self._recovery.between_corners(none, unit, corner) for
                            unit, (_, corner) in zip(np.eye(structure.patterns), self._loaded)]
        structure.contact = contact
        for s, rows in structure.numbering.renewed(contact, structure.subdomains).items():
            structure.rows[s] = rows
        changed = [k for k, c in enumerate(self.classes) if c.kept is not None]
        for k in changed:
            c = self.classes[k]
            F, c.A = renew_rows(structure, c)
            c.A_transposed = np.ascontiguousarray(c.A.T)
            if contact.paired.any():
                c.F_kept = by_half(F, c.shared)
            else:
                for blocks, matrix in ((self._F, F), (self._A, c.A),
                                       (self._A_transposed, c.A_transposed)):
                    blocks.put(k, matrix)
        if contact.paired.any():  # other subdomains may be met
            self._lay_out()
        patterns = structure.patterns
        self.motions = free_motions.displacements(structure, self.classes, self.vectors, self.comm)
        for k, motion in enumerate(self.motions):
            self._loaded[patterns + k] = motion, self._loaded[patterns + k][1]
        self._motion_columns = np.array(self.motions).reshape(self.modes, self.owned).T
        self.travels = {k: rows_moved(structure, self.classes, self.vectors, k)
                        for k in structure.travel.patterns}
        for k, fields in enumerate(self._fields):
            d, corner = self._loaded[k]
            moved = self._contact_rows_of(fields, changed)
            self._loaded[k] = np.where(self._contact > 0, moved, d), corner
        self._latest = self._finest = None

    def follow(self, step) -> None:
        """See DualProblem; nothing where contact does not follow the motion."""
        contact = self.structure.contact
        if contact.following is None or step.about is None:
            return
        if contact.about.u is not step.about or contact.time != step.time:
            now = contact.following.about(step.about, step.time)
            if now.has_rows_of(contact):
                self.structure.contact = now
            else:
                self.renew(now)

    def _contact_rows_of(self, fields: list[np.ndarray], changed: list[int]) -> np.ndarray:
        """(owned,) B u of `fields` (dofs,) on contact rows, those of the classes `changed`."""
        local = np.zeros(len(self.vectors.sign))
        for k in changed:
            c, s = self.classes[k], self.classes[k].members[0]
            rows = self.structure.rows[s]
            whole = rows.coefficient + rows.fixed_part
            local[c.rows] = (whole * fields[s][rows.dof]).sum(axis=1)
        return self.vectors.assemble(local * self.vectors.sign)

    # ---- the dual problem --------------------------------------------------------------------
    def apply(self, multipliers: np.ndarray) -> np.ndarray:
        """F times a dual vector."""
        heed_lost_interrupt()
        self.products += 1
        vectors = self.vectors
        x, y, force = vectors.gather(multipliers), vectors.local, np.zeros(len(self.coarse.numbers))
        x *= vectors.sign
        self._F.multiply(x, y)
        self._A.multiply(x, force)
        self._A_transposed.multiply(self.coarse.solve(force), y, add=True)
        y *= vectors.sign
        total = vectors.add_up()
        return total if self.softness is None else total + self.softness * multipliers

    def gradient(self, multipliers: np.ndarray, load) -> np.ndarray:
        """See DualProblem: displacements are refined where stiffness jumps."""
        if not self.jumps:
            return super().gradient(multipliers, load)
        fields = self._refined(multipliers, load.weights)
        moved = self._refinement.moved(self._signed_rows(multipliers), fields)
        total = -load.rest - self.vectors.assemble(moved * self.vectors.sign)
        return total if self.softness is None else total + self.softness * multipliers

    def _refined(self, multipliers: np.ndarray, weights: np.ndarray) -> list:
        """Refined displacements (dofs,) of every local subdomain, in extended precision.

        The latest are kept: a step is reported by those that it was judged by.
        """
        weights = weights[: self.structure.patterns]
        if self._refinement is None:  # what few runs need
            self._refinement = Refinement(self.structure, self.classes, self.coarse, self._recovery)
        known = self._finest is not None and all(map(np.array_equal, self._finest[:2],
                                                     (multipliers, weights)))
        if not self.minimum(float(known)):
            fields = self._refinement.fields(self._signed_rows(multipliers), weights)
            self.products += 1 + self._refinement.passes
            self._finest = multipliers.copy(), weights.copy(), fields
        return self._finest[-1]

    def _by_forces(self, multipliers: np.ndarray, weights: np.ndarray, refined: bool) -> list:
        """Displacements (dofs,) of every local subdomain, by factors or `refined`."""
        rows, patterns = self._signed_rows(multipliers), self.structure.patterns
        if not refined:
            corner = self._corner_displacements(rows, weights)
            return self._recovery.between_corners(rows, weights, corner)
        fields = self._refined(multipliers, weights)
        if not self.modes:
            return fields
        motions = np.append(np.zeros(patterns), weights[patterns:])
        rigid = self._recovery.displacements(np.zeros(len(rows)), motions, None)
        return [u + r for u, r in zip(fields, rigid)]

    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Global scalar product: partial sums by subdomain, added in their order."""
        return self.vectors.dot(a, b)

    def dots(self, *pairs: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """(k,) scalar products of k pairs of dual vectors, in one message."""
        return self.vectors.dots_of(pairs)

    @property
    def alike(self) -> bool:
        """Whether most subdomains, of all ranks, are some of several equal ones; collective."""
        return self._are_most(sum(len(c.members) for c in self.classes if c.shared))

    @property
    def cut_alike(self) -> bool:
        """Whether most subdomains, of all ranks, are pieces of a rectangle cut alike; collective.

        Of few pieces each has supports or neighbours of its own, and none are equal in all.
        """
        return self._are_most(sum(sub.cut_alike for sub in self.structure.subdomains))

    def _are_most(self, count: int) -> bool:
        """Whether so many of this rank and those of the others are most subdomains; collective."""
        return 2 * self.comm.allreduce(count) > self.structure.total

    def preconditioner(self) -> DirichletPreconditioner:
        """The Dirichlet preconditioner of F."""
        return DirichletPreconditioner(self)

    def elastic_response(self, weights: np.ndarray) -> np.ndarray:
        """B w (owned,) for the load sum_k weights_k f_k, without any rigid motion."""
        loaded = zip(weights[: self.structure.patterns], self._loaded)
        return sum((w * d for w, (d, _) in loaded), np.zeros(self.owned))

    def response_to(self, forces: list[np.ndarray]) -> np.ndarray:
        """B w (owned,) by forces (dofs,) on the local subdomains alone; collective."""
        return self._response(np.zeros(self.structure.patterns), forces)[0]

    def imbalance(self, multipliers: np.ndarray,
                  weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(modes,) work of all forces on the rigid motions, zero in equilibrium; its sizes.

        Loads that balance themselves, heat or a pinch, count by what their rounding is worth, and
        so do contact forces across a motion: a body on rollers lies on a smooth floor.
        """
        factors, D = weights[: self.structure.patterns], self._motion_columns
        x = np.repeat(multipliers[:, None], self.modes, axis=1)
        both = self.vectors.dots(np.hstack([D, np.abs(D)]), np.hstack([x, np.abs(x)]))
        net, size = np.split(both, 2)
        work, terms = self.rigid_work
        loads = np.maximum(np.abs(work), BALANCED * terms)
        reach = np.abs(self.structure.rigid_corners).max(axis=0, initial=0.0)
        across = BALANCED * reach * self.dot(self._contact, np.abs(multipliers))
        return factors @ work - net, np.maximum(np.abs(factors) @ loads + size, across)

    def load(self) -> dict[str, int]:
        """What a product takes of this rank: multiplications, and messages that it receives."""
        local = sum(len(c.members) * (len(c.A) ** 2 + 2 * c.A.size) for c in self.classes)
        return {"work": local + self.coarse.work,
                "messages": 2 * self.vectors.neighbours + self.coarse.messages}

    def message_bytes(self) -> dict[str, int]:
        """Bytes that this rank receives in a product with F (gluing, coarse) and in a dot."""
        return {"rows": 2 * 8 * self.vectors.foreign, "coarse": 8 * self.coarse.received,
                "dot": 8 * self.vectors.received}

    # ---- displacements and forces of the subdomains ------------------------------------------
    def deformation(self, multipliers: np.ndarray, weights: np.ndarray) -> float:
        """Largest displacement of a node relative to the rigid motion of its body; collective."""
        return self.rigid_parts.deformation(self.deformations(multipliers, weights))

    def deformation_by_level(self, multipliers: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(levels,) what displacements of the rows of every level are relative to; collective."""
        fields = self.deformations(multipliers, weights)
        return self.stiff_parts.deformations(fields, self.rigid_parts.deformation(fields))

    def least_deformation(self, multipliers: np.ndarray, weights: np.ndarray) -> float:
        """A lower bound of the deformation that takes no fields; collective."""
        return self._least(self._corner_displacements(self._signed_rows(multipliers), weights))

    def coarse_displacements(self, multipliers: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(coarse dofs,) displacements of the corners, on every rank."""
        corner = self._corner_displacements(self._signed_rows(multipliers), weights)
        return self.coarse.whole(corner)

    def deformations(self, multipliers: np.ndarray, weights: np.ndarray,
                     forces: list | None = None, refined: bool = False) -> list[np.ndarray]:
        """Displacements w (dofs,) of every local subdomain less the travel, see travel.py.

        For given multipliers and pattern factors; `refined` as those of `gradient`. `forces`: a
        (dofs,) array for every local subdomain that acts besides the patterns. Without them the
        latest fields are kept, for readers only: a step's residuals need them, and its results do
        again. Collective.
        """
        if forces is not None:
            return self._recovery.displacements(self._signed_rows(multipliers), weights, forces)
        known = self._latest is not None and all(map(np.array_equal, self._latest[:3],
                                                     (multipliers, weights, refined)))
        if not self.minimum(float(known)):
            fields = [u.astype(float) for u in self._by_forces(multipliers, weights, refined)]
            for u in fields:
                u.flags.writeable = False
            self._latest = multipliers.copy(), weights.copy(), refined, fields
        return self._latest[-1]

    def displacements(self, multipliers: np.ndarray, weights: np.ndarray) -> list[np.ndarray]:
        """`deformations` with the travel: all of u."""
        return self.with_travel(self.deformations(multipliers, weights), weights)

    def with_travel(self, fields: list[np.ndarray], weights: np.ndarray) -> list[np.ndarray]:
        """`fields` (dofs,) of the local subdomains, moved as supports carry their bodies."""
        if not self.travels:
            return fields
        moved = self.structure.travel.displacements(weights, self.structure.subdomains)
        return [u + r for u, r in zip(fields, moved)]

    def forces_on_supports(self, multipliers: np.ndarray) -> list[np.ndarray]:
        """B' lambda on the fixed dofs of every subdomain: contact forces on its supports."""
        return self._recovery.forces_on_supports(self._signed_rows(multipliers))

    def inner_forces(self, fields: list[np.ndarray]) -> list[np.ndarray]:
        """K u (dofs,) for displacements u (dofs,) of every subdomain, with its class's K."""
        return self._recovery.inner_forces(fields)

    def movements(self, corner: np.ndarray) -> np.ndarray:
        """(owned,) what dual rows move by with the stacked corner dofs `corner`; collective."""
        rows = np.zeros(len(self.vectors.sign))
        # of numbers that lie apart products may round by how many there are
        self._A_transposed.multiply(np.ascontiguousarray(corner), rows)
        return self.vectors.assemble(rows * self.vectors.sign)

    def _signed_rows(self, multipliers: np.ndarray) -> np.ndarray:
        """Stacked, signed local multipliers of a dual vector."""
        return self.vectors.gather(multipliers) * self.vectors.sign

    def _corner_displacements(self, rows: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Displacements of the stacked corner dofs under the stacked, signed multipliers `rows`."""
        force = np.zeros(len(self.coarse.numbers))
        self._A.multiply(rows, force)
        corner = -self.coarse.solve(force)
        for w, (_, loaded) in zip(weights, self._loaded):
            corner += w * loaded
        return corner


def _reduced(structure: Substructure, comm, ahead: dict) -> list[LocalClass]:
    """The rank's classes of equal subdomains, reduced; every rank raises the NoSolution of any."""
    groups, classes, error = group(structure, comm), [], None
    try:
        classes = [reduce_class(structure, *members, ahead) for members in groups]
    except NoSolution as problem:
        error = problem
    agree(comm, error)
    return classes
