"""Stage 4: the FETI-DP reduction: dual operator F, Dirichlet preconditioner, recovery of displacements.

With the space X = X^r + X^c of the slides (corner dofs c primal, all others r torn), constraint rows
B = [B_r, B_c] and multipliers lambda (forces),

    u_r = K_rr^-1 (f_r - B_r' lambda - K_rc u_c),
    S_cc u_c = f_c - K_cr K_rr^-1 f_r - A' lambda,        A = B_c - B_r K_rr^-1 K_rc,
    S_cc = K_cc - K_cr K_rr^-1 K_rc,

and elimination of u leaves  B u = d - F lambda  with

    F = B_r K_rr^-1 B_r' + A S_cc^-1 A',      d = B u(lambda = 0).

Bodies that no support holds make S_cc singular, with the orthonormal rigid motions Q (at the corners) as its
kernel. They are held by springs of small stiffness 1/rho whose rest positions alpha follow the motion until
they carry no force, the proximal point method or, in the dual, the augmented Lagrangian of G lambda = e with
G = Q' A', which keeps the QP's bounds scalar (SMALBE: Dostal, Horak (2010)):

    S_rho^-1 = P S_cc^+ P + rho Q Q',   P = I - Q Q',      d(alpha) = d + A Q alpha.

A rigid motion counts as one more load pattern with the factor alpha.

The local parts of F and A are explicit dense matrices (see reduction.py); subdomains with equal ones share
them, which turns the product into a few dense products with many columns. See Farhat, Lesoinne, Le Tallec, Pierson,
Rixen (2001); Klawonn, Rheinbach: FETI-DP methods for elasticity; Mandel, Dohrmann, Tezaur (2005) for the algebra.

Results do not depend on the number of ranks, not even in the last bit: MPRGP decides by comparisons, and
two runs that differ in rounding may take different paths to answers that differ by the tolerance. So
every sum is taken in an order that the distribution does not change: scalar products add the partial sums
of the subdomains in their order, dense products go in blocks of fixed size (blocks.py), classes take the matrices of
their first subdomain wherever it lives, and the (small) coarse problem is assembled and solved on every
rank.
"""

import copy
import dataclasses

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import lapack, qr
from scipy.sparse import coo_matrix, diags

from .blocks import BlockDiagonal
from ..errors import NoSolution, agree
from .gathering import Gathering
from .reduction import LocalClass, group, petsc_matrix, reduce_class
from .substructuring import GLUING, Substructure, partition

SOFTNESS = 10.0  # of the springs under free bodies: rho in units of (number of corner dofs) / (stiffness of one)
DEPENDENT = 1e-9  # eigenvalues of a local F below this part of the largest: rows that depend on one another
FLOOR = 0.01  # of a released corner's stiffness: what holds a subdomain all of whose corners are released


class DualOperator:
    """F and d on the rank's share of the dual rows; counts its products.

    Vectors of multipliers are numpy arrays of length `owned`, the rank's part of a PETSc vector of
    `dual_dofs` entries; `dot` is the global scalar product. Collective over `comm`.
    """

    def __init__(self, structure: Substructure, comm):
        self.structure, self.comm = structure, comm
        self.owned = structure.row_range[1] - structure.row_range[0]
        self.products, self.modes = 0, len(structure.rigid_modes)
        error = None
        self.classes: list[LocalClass] = []
        groups = group(structure, comm)
        try:
            self.classes = [reduce_class(structure, *found) for found in groups]
        except NoSolution as problem:
            error = problem
        agree(comm, error)
        self._lay_out()
        self._build_coarse()
        self.loads = [self._pattern_load(s) for s in range(len(structure.subdomains))]
        self._acts = [load.any() for load in self.loads]
        # local subdomains with loads or supports
        self.acting = [s for s, sub in enumerate(structure.subdomains) if sub.loads.any() or len(structure.fixed[s])]
        rigid = [self._rigid_response(k) for k in range(self.modes)]
        self._rigid = np.array([d for d, _ in rigid]).reshape(self.modes, self.owned).T
        self.rho = self._softness([d for d, _ in rigid])
        self.loaded = [self._respond(k) for k in range(structure.patterns)] + rigid
        self.rigid_work = self._rigid_work()

    # ---- layout ------------------------------------------------------------------------------
    def _lay_out(self) -> None:
        """Stack the local rows and corner dofs class by class; scatter between rows and dual vectors."""
        structure, order = self.structure, [s for c in self.classes for s in c.members]
        row_at = corner_at = 0
        for c in self.classes:
            k = len(c.members)
            c.rows = slice(row_at, row_at + k * c.F.shape[0])
            c.corners = slice(corner_at, corner_at + k * len(c.corner))
            row_at, corner_at = c.rows.stop, c.corners.stop
        self._F = BlockDiagonal(self.classes, [c.F for c in self.classes], "rows", "rows")
        self._A = BlockDiagonal(self.classes, [c.A for c in self.classes], "rows", "corners")
        self._A_transposed = BlockDiagonal(self.classes, [c.A_transposed for c in self.classes], "corners", "rows")
        self.sign = _join([structure.rows[s].sign for s in order], float)
        self.scaling = _join([structure.rows[s].scaling for s in order], float)
        self._row_numbers = _join([structure.rows[s].row for s in order], PETSc.IntType)
        self._dual = PETSc.Vec().createMPI((self.owned, structure.dual_dofs), comm=self.comm)
        self._local_rows, self._to_rows = _scatter(self._dual, self._row_numbers)
        self._out_rows = self._local_rows.duplicate()
        self._slots = _Slots(structure, self._row_numbers, order, self.comm) if structure.contact.paired.any() else None
        # partial sums of a scalar product: the rows of each subdomain, in the order of subdomains
        self._starts = structure.row_starts
        self._filled = self._starts < np.append(self._starts[1:], self.owned)  # reduceat has no empty segments
        self._filled_starts = self._starts[self._filled]
        self._all_partial = Gathering(self.comm, len(self._starts))
        # corner forces travel in the order of subdomains, so that every rank adds them up alike
        number = [structure.corner_global[s] for s in order]
        first = np.cumsum([0, *(len(n) for n in structure.corner_global)])
        self._corner_order = _join([np.arange(first[s], first[s + 1]) for s in order], int)
        self._corner_local = _join(number, int)
        self._corner_all = np.concatenate(self.comm.allgather(_join(structure.corner_global, int)))
        self._all_corners = Gathering(self.comm, len(self._corner_local))

    def _build_coarse(self) -> None:
        """Assemble and factorize S_cc on every rank; refuse a structure that is a mechanism."""
        n = self.structure.coarse_dofs
        self.coarse_solver, self.coarse_factor_entries = None, 0
        if n == 0:
            return
        # entries of the subdomains in their order, so that every rank adds them up alike
        count = np.array([len(number) for number in self.structure.corner_global], int)
        first, numbers = np.cumsum([0, *count**2]), self.structure.corner_global
        (rows, columns), values = np.empty((2, first[-1]), int), np.empty(first[-1])
        for c in self.classes:
            k = len(c.corner)
            at, number = first[c.members][:, None] + np.arange(k * k), np.array([numbers[s] for s in c.members])
            rows[at], columns[at], values[at] = np.repeat(number, k, axis=1), np.tile(number, k), c.S.ravel()
        rows, columns, values = (np.concatenate(self.comm.allgather(part)) for part in (rows, columns, values))
        self.coarse_matrix = coo_matrix((values, (rows, columns)), shape=(n, n)).tocsr()
        pc = PETSc.PC().create(PETSc.COMM_SELF)
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setOperators(petsc_matrix(self._held_coarse_matrix()))
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        factor.setMumpsIcntl(24, 1)  # count null pivots instead of dividing by them
        pc.setUp()
        negative, _, _ = factor.getInertia()
        null = factor.getMumpsInfog(28)
        if negative or null:
            raise NoSolution("the structure is a mechanism: parts of a body can move without deforming, hinged on "
                             "single points")
        self.coarse_factor_entries = factor.getMumpsInfog(29)
        # MUMPS vouches for the matrix; CHOLMOD's triangular solves are several times faster
        self.coarse_solver = PETSc.PC().create(PETSc.COMM_SELF)
        self.coarse_solver.setType("cholesky")
        self.coarse_solver.setFactorSolverType("cholmod")
        self.coarse_solver.setOperators(pc.getOperators()[0])
        self.coarse_solver.setUp()
        self._coarse = (PETSc.Vec().createSeq(n), PETSc.Vec().createSeq(n))

    def _held_coarse_matrix(self):
        """S_cc with as many dofs pinned as there are free rigid motions."""
        S, Q, n = self.coarse_matrix, self.structure.rigid_corners, self.structure.coarse_dofs
        if not self.modes:
            return S
        stiffness = S.diagonal().mean()
        self._pins = np.sort(qr(Q.T, pivoting=True)[2][: self.modes])
        free = np.ones(n)
        free[self._pins] = 0.0
        return (diags(free) @ S @ diags(free) + diags(stiffness * (1.0 - free))).tocsr()

    # ---- vectors -----------------------------------------------------------------------------
    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Global scalar product of two dual vectors: partial sums by subdomain, added in their order."""
        partial = np.zeros(len(self._starts))
        if self.owned:
            partial[self._filled] = np.add.reduceat(a * b, self._filled_starts)
        return float(self._all_partial(partial).sum())

    def minimum(self, value: float) -> float:
        """The smallest of the ranks' numbers."""
        return self.comm.allreduce(value, op=MPI.MIN) if self.comm.size > 1 else value

    def _gather(self, x: np.ndarray) -> np.ndarray:
        """The rank's stacked local rows of a dual vector, unsigned."""
        self._dual.array[:] = x
        self._to_rows.scatter(self._dual, self._local_rows, addv=False, mode="forward")
        return self._local_rows.array

    def _assemble(self, local: np.ndarray) -> np.ndarray:
        """Add up stacked local rows into a dual vector."""
        self._out_rows.array[:] = local
        return self._add_up(self._out_rows)

    def _add_up(self, rows: PETSc.Vec) -> np.ndarray:
        """Dual vector of the sums of stacked local rows."""
        if self._slots is not None:
            return self._slots.add_up(rows.array)
        self._dual.set(0)
        self._to_rows.scatter(rows, self._dual, addv=True, mode="reverse")
        return self._dual.array.copy()

    def coarse_solve(self, local: np.ndarray) -> np.ndarray:
        """S_cc^-1 of stacked local corner forces (added up), returned on the stacked corner dofs."""
        if self.coarse_solver is None:
            return np.zeros_like(local)
        forces = np.empty_like(local)
        forces[self._corner_order] = local
        total = np.bincount(self._corner_all, self._all_corners(forces), minlength=self.structure.coarse_dofs)
        return self._spring_held(total)[self._corner_local]

    def _spring_held(self, forces: np.ndarray) -> np.ndarray:
        """S_rho^-1 times assembled corner forces (n,)."""
        if not self.modes:
            return self._pinned_solve(forces)
        Q = self.structure.rigid_corners
        motion = Q.T @ forces
        right = forces - Q @ motion
        right[self._pins] = 0.0
        u = self._pinned_solve(right)
        return u + Q @ (self.rho * motion - Q.T @ u)

    def _pinned_solve(self, forces: np.ndarray) -> np.ndarray:
        """Solution with the factorized coarse matrix for one right-hand side (n,); overwritten by the next."""
        right, solution = self._coarse
        right.array[:] = forces
        self.coarse_solver.apply(right, solution)
        return solution.array

    def coarse_inverse(self, dofs: np.ndarray) -> np.ndarray:
        """Rows and columns `dofs` of the coarse solution operator, (k, k); a coarse solve a column, shared by the ranks."""
        mine = dofs[slice(*partition(len(dofs), self.comm))]
        columns, force = np.empty((len(mine), len(dofs))), np.zeros(self.structure.coarse_dofs)
        for k, dof in enumerate(mine):
            force[dof] = 1.0
            columns[k] = self._spring_held(force)[dofs]
            force[dof] = 0.0
        inverse = np.concatenate(self.comm.allgather(columns))
        return (inverse + inverse.T) / 2

    # ---- the dual problem --------------------------------------------------------------------
    def apply(self, multipliers: np.ndarray) -> np.ndarray:
        """F times a dual vector."""
        self.products += 1
        x, y, force = self._gather(multipliers), self._out_rows.array, np.zeros(len(self._corner_local))
        x *= self.sign
        self._F.multiply(x, y)
        self._A.multiply(x, force)
        self._A_transposed.multiply(self.coarse_solve(force), y, add=True)
        y *= self.sign
        return self._add_up(self._out_rows)

    def preconditioner(self) -> "DirichletPreconditioner":
        """The Dirichlet preconditioner of F."""
        return DirichletPreconditioner(self)

    def with_contact(self, contact) -> "DualOperator":
        """The same body with other gaps, friction or initial state at its contact nodes; counts its own products."""
        other = copy.copy(self)
        other.structure, other.products = dataclasses.replace(self.structure, contact=contact), 0
        return other

    def message_bytes(self) -> dict[str, int]:
        """Bytes that this rank receives: in a product with F, for gluing and coarse problem, and in a scalar product."""
        start, stop = self.structure.row_range
        foreign = int(np.count_nonzero((self._row_numbers < start) | (self._row_numbers >= stop)))
        corners = len(self._corner_all) - len(self._corner_local)
        return {"rows": 2 * 8 * foreign, "coarse": 8 * corners, "dot": 8 * (self.structure.total - len(self._starts))}

    def dots(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Global scalar products of the columns of two blocks (owned, k), added as in `dot`."""
        partial = np.zeros((len(self._starts), a.shape[1]))
        if self.owned:
            partial[self._filled] = np.add.reduceat(a * b, self._filled_starts, axis=0)
        return np.concatenate(self.comm.allgather(partial)).sum(axis=0)

    def _pattern_load(self, s: int) -> np.ndarray:
        """(patterns, dofs) loads with the forces of prescribed displacements moved to the right."""
        sub, fixed = self.structure.subdomains[s], self.structure.fixed[s]
        values = self.structure.fixed_values[s]
        if not values.any():
            return sub.loads
        held = np.zeros_like(sub.loads)
        held[:, fixed] = values
        return sub.loads - np.array([sub.multiply(u) for u in held])

    def _respond(self, pattern: int) -> tuple[np.ndarray, np.ndarray]:
        """d = B u and the stacked corner displacements of the body under one load pattern alone."""
        weights = np.eye(self.structure.patterns)[pattern]
        x, none = self._prescribed(weights), np.zeros(len(self.sign))
        right = [self._forces(c, weights, none, None) for c in self.classes]
        torn = self._torn_response(right)
        for c, u_r in zip(self.classes, torn):
            x[c.rows] += (c.B_r @ u_r).T.ravel()
        corner = self._corner_response(right, torn)
        self._A_transposed.multiply(corner, x, add=True)
        return self._assemble(x * self.sign), corner

    def _rigid_response(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """d = B u and the stacked corner displacements of a rigid motion."""
        structure, mode = self.structure, self.structure.rigid_modes[k]
        local = np.zeros(len(self.sign))
        for c in self.classes:
            m = c.F.shape[0]
            for i, s in enumerate(c.members):
                if structure.first + s in mode.members:
                    u = mode.displacement(structure.subdomains[s].xy).ravel()
                    rows = structure.rows[s]
                    local[c.rows.start + i * m : c.rows.start + (i + 1) * m] = (rows.coefficient * u[rows.dof]).sum(axis=1)
        glued = self._assemble(local * self.sign)
        glued[structure.row_kind[slice(*structure.row_range)] == GLUING] = 0.0  # what rounding leaves
        return glued, structure.rigid_corners[self._corner_local, k]

    def _softness(self, motions: list[np.ndarray]) -> np.ndarray:
        """(modes,) rho: SOFTNESS over the stiffness with which a contact row holds a motion, by the softer body's part.

        The compliance of a row is that of all subdomains it joins, their corners held by springs like their own stiffness.
        """
        local = np.zeros(len(self.sign))
        for c in self.classes if motions else ():
            held = np.linalg.solve(c.S + np.diag(np.diag(c.S)), c.A.T)
            local[c.rows] = np.tile(np.diag(c.F) + np.einsum("ij,ji->i", c.A, held), len(c.members))
        compliance, rho = self._assemble(local), np.zeros(len(motions))
        for k, moved in enumerate(motions):
            stiffness = np.divide(moved**2, compliance, out=np.zeros(self.owned), where=moved != 0)
            rows = self.dot(np.sign(stiffness), np.sign(stiffness))
            rho[k] = SOFTNESS * rows / self.dot(stiffness, np.ones(self.owned)) if rows else 0.0
        return np.where(rho > 0, rho, rho.max(initial=0.0) or 1.0)

    def _rigid_work(self) -> np.ndarray:
        """(patterns, modes): work of every load pattern on every rigid motion, and of its absolute values."""
        structure = self.structure
        work = np.zeros((2, structure.total, structure.patterns, self.modes))
        for s, sub in enumerate(structure.subdomains):
            for k, mode in enumerate(structure.rigid_modes):
                if structure.first + s in mode.members:
                    each = sub.loads * mode.displacement(sub.xy).ravel()
                    work[:, structure.first + s, :, k] = each.sum(axis=1), np.abs(each).sum(axis=1)
        return np.sum(self.comm.allgather(work), axis=0).sum(axis=1)

    def imbalance(self, multipliers: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(modes,) work of loads and contact forces on every rigid motion, zero in equilibrium, and their sizes."""
        factors, D = weights[: self.structure.patterns], self._rigid
        x = np.repeat(multipliers[:, None], self.modes, axis=1)
        net, size = np.split(self.dots(np.hstack([D, np.abs(D)]), np.hstack([x, np.abs(x)])), 2)
        return factors @ self.rigid_work[0] - net, np.abs(factors) @ self.rigid_work[1] + size

    def load_response(self, weights: np.ndarray) -> np.ndarray:
        """d for the load sum_k weights_k f_k; `weights` may go on with the factors of the rigid motions."""
        return sum((w * d for w, (d, _) in zip(weights, self.loaded)), np.zeros(self.owned))

    def corner_displacement(self, multipliers: np.ndarray, weights: np.ndarray) -> float:
        """Largest displacement of a corner: a cheap measure of how far the body moves."""
        corner = self._corner_displacements(self._gather(multipliers) * self.sign, weights)
        return self.comm.allreduce(float(np.abs(corner).max(initial=0)), op=MPI.MAX)

    def coarse_displacements(self, multipliers: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(coarse dofs,) displacements of the corners, on every rank."""
        corner = self._corner_displacements(self._gather(multipliers) * self.sign, weights)
        found = np.empty(self.structure.coarse_dofs)
        for numbers, values in self.comm.allgather((self._corner_local, corner)):
            found[numbers] = values
        return found

    def _corner_displacements(self, rows: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Displacements of the stacked corner dofs under the stacked, signed multipliers `rows`."""
        force = np.zeros(len(self._corner_local))
        self._A.multiply(rows, force)
        corner = -self.coarse_solve(force)
        for w, (_, loaded) in zip(weights, self.loaded):
            corner += w * loaded
        return corner

    def _prescribed(self, weights: np.ndarray) -> np.ndarray:
        """Stacked local rows of B on the prescribed displacements, which B_r and B_c leave out."""
        share = np.zeros(len(self.sign))
        for c in self.classes:
            m = c.F.shape[0]
            for k, s in enumerate(c.members):
                values = weights @ self.structure.fixed_values[s]
                if values.any():
                    local = self.structure.rows[s].fixed_share(self.structure.fixed[s], values,
                                                               self.structure.subdomains[s].dofs)
                    share[c.rows.start + k * m : c.rows.start + (k + 1) * m] = local
        return share

    def forces_on_supports(self, multipliers: np.ndarray) -> list[np.ndarray]:
        """B' lambda on the fixed dofs of every local subdomain: contact forces that a support takes directly."""
        x = self._gather(multipliers) * self.sign
        found = [np.empty(0)] * len(self.structure.subdomains)
        for c in self.classes:
            for s, forces in zip(c.members, x[c.rows].reshape(len(c.members), -1)):
                rows = self.structure.rows[s]
                if not len(self.structure.fixed[s]):
                    continue
                all_dofs = np.bincount(rows.dof.ravel(), (rows.fixed_part * forces[:, None]).ravel(),
                                       minlength=self.structure.subdomains[s].dofs)
                found[s] = all_dofs[self.structure.fixed[s]]
        return found

    def _solve(self, weights: np.ndarray, rows: np.ndarray, forces: list | None = None,
               corner: np.ndarray | None = None) -> list[np.ndarray]:
        """Displacements (dofs, members) of each class under sum_k weights_k f_k - B' lambda + forces.

        `rows` holds the signed stacked local multipliers; `weights` may go on with factors of the rigid motions;
        `forces`, if there are any, a (dofs,) array for every local subdomain. Finding the displacements `corner` of the
        stacked corner dofs takes one more solution for every subdomain, unless they are given.
        """
        right = [self._forces(c, weights, rows, forces) for c in self.classes]
        if corner is None:
            corner = self._corner_response(right, self._torn_response(right))
            if len(weights) > self.structure.patterns:
                corner += (self.structure.rigid_corners @ weights[self.structure.patterns :])[self._corner_local]
        result = []
        for c, f in zip(self.classes, right):
            u = np.zeros(f.shape)
            u[c.corner] = corner[c.corners].reshape(len(c.members), -1).T
            f = f[c.torn] - c.K_rc @ u[c.corner]
            u[c.torn] = c.factor.solve(f) if f.any() else 0.0
            result.append(u)
        return result

    def _forces(self, c: LocalClass, weights: np.ndarray, rows: np.ndarray, forces: list | None) -> np.ndarray:
        """Forces (dofs, members) on the subdomains of a class; see `_solve`."""
        f = np.zeros((c.K.shape[0], len(c.members)))
        for k, s in enumerate(c.members):
            if self._acts[s]:
                f[:, k] = weights[: self.structure.patterns] @ self.loads[s]
            if forces is not None:
                f[:, k] += forces[s]
        multipliers = rows[c.rows].reshape(len(c.members), -1).T
        f[c.torn] -= c.B_r.T @ multipliers
        f[c.corner] -= c.B_c.T @ multipliers
        return f

    def _torn_response(self, right: list[np.ndarray]) -> list[np.ndarray]:
        """K_rr^-1 f_r (n_r, members) of the classes under forces (dofs, members): displacements with fixed corners."""
        return [c.factor.solve(f[c.torn]) if f[c.torn].any() else np.zeros((len(c.torn), f.shape[1]))
                for c, f in zip(self.classes, right)]

    def _corner_response(self, right: list[np.ndarray], torn: list[np.ndarray]) -> np.ndarray:
        """Displacements of the stacked corner dofs under forces on the classes; `torn` is `_torn_response`."""
        force = np.empty(len(self._corner_local))
        for c, f, u_r in zip(self.classes, right, torn):
            force[c.corners] = (f[c.corner] - c.K_rc.T @ u_r).T.ravel()
        return self.coarse_solve(force)

    def displacements(self, multipliers: np.ndarray, weights: np.ndarray, forces: list | None = None) -> list[np.ndarray]:
        """Displacements (dofs,) of every local subdomain for given multipliers and pattern factors.

        `forces`: a (dofs,) array for every local subdomain that acts besides the patterns.
        """
        rows, factors = self._gather(multipliers) * self.sign, weights[: self.structure.patterns]
        corner = self._corner_displacements(rows, weights) if forces is None else None
        found = [np.empty(0)] * len(self.structure.subdomains)
        for c, u in zip(self.classes, self._solve(weights, rows, forces, corner)):
            for s, own in zip(c.members, np.ascontiguousarray(u.T)):
                if len(self.structure.fixed[s]):
                    own[self.structure.fixed[s]] = factors @ self.structure.fixed_values[s]
                found[s] = own
        return found

    def inner_forces(self, fields: list[np.ndarray]) -> list[np.ndarray]:
        """K u (dofs,) for displacements u of every local subdomain, with the stiffness of its class."""
        found = [np.empty(0)] * len(fields)
        for c in self.classes:
            forces = c.K @ np.column_stack([fields[s] for s in c.members])
            for s, force in zip(c.members, np.ascontiguousarray(forces.T)):
                found[s] = force
        return found


class _Slots:
    """Sums over the subdomains of a row in their order, for rows that more than two of them share.

    Sums of two terms do not depend on their order, those of more do: here every term travels to its own slot
    at the row's rank, and the slots of a row are added up there.
    """

    def __init__(self, structure: Substructure, rows: np.ndarray, order: list[int], comm):
        subdomain = np.repeat([structure.first + s for s in order], [len(structure.rows[s].row) for s in order])
        mine = np.column_stack([rows, subdomain]).astype(np.int64).reshape(-1, 2)
        pairs = np.concatenate(comm.allgather(mine))
        pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
        key = lambda table: table[:, 0] * structure.total + table[:, 1]
        first, last = np.searchsorted(pairs[:, 0], structure.row_range)
        self._starts = np.searchsorted(pairs[:, 0], np.arange(*structure.row_range)) - first
        self._vector = PETSc.Vec().createMPI((last - first, len(pairs)), comm=comm)
        slot = np.searchsorted(key(pairs), key(mine)).astype(PETSc.IntType)
        self._local, self._scatter = _scatter(self._vector, slot)

    def add_up(self, local: np.ndarray) -> np.ndarray:
        """Dual vector of stacked local rows."""
        self._local.array[:] = local
        self._scatter.scatter(self._local, self._vector, addv=False, mode="reverse")
        if not len(self._starts):
            return np.zeros(0)
        return np.add.reduceat(self._vector.array, self._starts)


class DirichletPreconditioner:
    """M = sum_i B_D,i S_i B_D,i' restricted to a face (Klawonn, Rheinbach; stiffness scaling).

    S_i is the stiffness of the subdomain in the displacements of its rows, the (pseudo) inverse of the explicit
    local F_i; corners that carry contact rows of their own are released: with v_b = B_r u, v_c = B_c' x the
    energy is that of v_b - A v_c plus that of v_c in S.
    """

    def __init__(self, operator: DualOperator):
        self.operator = operator
        general = operator.modes or operator.structure.contact.paired.any()
        self.schur = [_released(c) if general else _schur(c) for c in operator.classes]
        self.blocks = BlockDiagonal(operator.classes, self.schur, "rows", "rows")

    def __call__(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """M residual on the face `free`, zero elsewhere."""
        op = self.operator
        x, y = op._gather(np.where(free, residual, 0.0)), op._out_rows.array
        x *= op.scaling
        self.blocks.multiply(x, y)
        y *= op.scaling
        found = op._add_up(op._out_rows)
        found[~free] = 0.0
        return found


def _schur(c: LocalClass) -> np.ndarray:
    """(m, m) stiffness of one subdomain in its rows' displacements."""
    B_c = c.B_c.toarray()
    on_corner = np.abs(B_c).max(axis=1, initial=0) > 0
    torn = ~on_corner
    inverse = _inverse(c.F[np.ix_(torn, torn)])
    relative = np.zeros((torn.sum(), len(torn)))  # v_b - A v_c
    relative[:, torn] = np.eye(torn.sum())
    relative[:, on_corner] = -c.A[torn] @ B_c[on_corner].T
    schur = relative.T @ inverse @ relative
    schur[np.ix_(on_corner, on_corner)] += B_c[on_corner] @ c.S @ B_c[on_corner].T
    return schur


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive definite matrix; the pseudo-inverse, which costs more, if it is nearly singular."""
    factor, info = lapack.dpotrf(matrix) if matrix.size else (matrix, 1)
    if info or lapack.dpocon(factor, np.abs(matrix).sum(axis=0).max())[0] < DEPENDENT:
        return np.linalg.pinv(matrix, hermitian=True)
    upper = np.triu(lapack.dpotri(factor)[0])
    return upper + np.triu(upper, 1).T


def _released(c: LocalClass) -> np.ndarray:
    """(m, m) the same for rows of any kind: all corner dofs that contact rows move are released.

    Its inverse is F_i + A S^-1 A' over these corners; a subdomain with no other corners is held a little. Rows that
    depend on one another here, though not with the other body's part, get the stiffness of an average row.
    """
    moved = np.abs(c.B_c.toarray()).max(axis=0, initial=0) > 0
    S, A = c.S[np.ix_(moved, moved)], c.A[:, moved]
    S = S + FLOOR * np.diag(np.diag(S))
    compliance, vectors = np.linalg.eigh(c.F + A @ np.linalg.solve(S, A.T))
    independent = compliance > DEPENDENT * compliance.max(initial=0.0)
    average = np.median(compliance[independent]) if independent.any() else 1.0
    return (vectors / np.where(independent, compliance, average)) @ vectors.T


def _scatter(vector: PETSc.Vec, index: np.ndarray):
    """A local vector and the scatter that fills it with the entries `index` of `vector`."""
    local = PETSc.Vec().createSeq(len(index))
    source = PETSc.IS().createGeneral(index, comm=PETSc.COMM_SELF)
    target = PETSc.IS().createStride(len(index), first=0, step=1, comm=PETSc.COMM_SELF)
    return local, PETSc.Scatter().create(vector, source, local, target)


def _join(arrays: list, kind) -> np.ndarray:
    """Concatenation that also works for ranks without subdomains."""
    return np.concatenate([np.empty(0, kind), *arrays]).astype(kind)
