"""Sparse elimination of a subdomain's interior: Schur complement on the rest, solves inside.

With the dofs that rows and corners see, the rest b, as the last,

    K = [ K_ii  K_ib ]        S = K_bb - K_bi K_ii^-1 K_ib.
        [ K_bi  K_bb ]

MUMPS leaves S behind when it factorizes the interior. That is about the work of one factorization,
where a solution for every dof of the rest would take a pass through the factors each.
"""

import ctypes

import numpy as np
from petsc4py import PETSc
from scipy.sparse import triu

from ..errors import NoSolution
from .factorization import petsc_upper, solve_columns

INTERIOR_ALONE = 26, 0  # ICNTL: solutions are those of K_ii
MARGIN = 14  # ICNTL: per cent of workspace beyond the estimate
FAILED, NEGATIVE = 1, 12  # INFOG: status, number of negative pivots
SINGULAR, TOO_SMALL = -10, (-8, -9)  # status; the workspace was estimated too small
PETSC = ctypes.CDLL(PETSc.__file__)  # for what petsc4py 3.18 does not know of


class Interior:
    """The factors of K_ii and `schur`, S (n_b, n_b), of a symmetric matrix.

    Raises NoSolution unless K_ii is positive definite, MemoryError where MUMPS finds no memory.
    """

    def __init__(self, matrix, rest: int):
        """`matrix` (n, n) scipy CSR; its last `rest` = n_b dofs are those that stay."""
        self.size, self.inner = matrix.shape[0], matrix.shape[0] - rest
        if not self.inner:
            self.schur = matrix.toarray()
            return
        upper = triu(matrix, format="csr")
        upper.sort_indices()
        matrix = petsc_upper(upper)
        for margin in (30, 300, 3000):  # estimates are poor for small matrices
            self._pc = _factorized(matrix, self.inner, margin)
            factor = self._pc.getFactorMatrix()
            if factor.getMumpsInfog(FAILED) not in TOO_SMALL:
                break
        _check(factor)
        factor.setMumpsIcntl(*INTERIOR_ALONE)
        self.schur = _schur(factor, rest) if rest else np.empty((0, 0))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """K_ii^-1 times the columns of `right` (n_i, k)."""
        if not right.size:
            return np.zeros_like(right)
        whole = np.zeros((self.size, right.shape[1]), order="F")
        whole[: self.inner] = right
        return solve_columns(self._pc, whole)[: self.inner]


def _factorized(matrix: PETSc.Mat, inner: int, margin: int) -> PETSc.PC:
    """The factorization of `matrix` by MUMPS, for all dofs after the first `inner` their S."""
    pc, size = PETSc.PC().create(PETSc.COMM_SELF), matrix.getSize()[0]
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setOperators(matrix)
    pc.setFactorSetUpSolverType()
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(MARGIN, margin)
    if inner < size:
        staying = np.arange(inner, size, dtype=PETSc.IntType)
        staying = PETSc.IS().createGeneral(staying, comm=PETSc.COMM_SELF)
        _call("MatFactorSetSchurIS", factor, staying)
    pc.setUp()
    return pc


def _check(factor: PETSc.Mat) -> None:
    """Raise the error that tells what the factorization of an interior has ended with."""
    status = factor.getMumpsInfog(FAILED)
    if status == SINGULAR or status >= 0 and factor.getMumpsInfog(NEGATIVE):
        raise NoSolution("a subdomain's stiffness is not positive definite; check material and "
                         "supports")
    if status < 0:
        raise MemoryError(f"MUMPS failed ({status})")


def _schur(factor: PETSc.Mat, rest: int) -> np.ndarray:
    """The Schur complement (rest, rest) that a factorization has left behind."""
    matrix, entries = ctypes.c_void_p(), ctypes.POINTER(ctypes.c_double)()
    _call("MatFactorCreateSchurComplement", factor, ctypes.byref(matrix), None)
    _call("MatDenseGetArrayRead", matrix, ctypes.byref(entries))
    schur = np.ctypeslib.as_array(entries, (rest, rest)).copy()
    _call("MatDenseRestoreArrayRead", matrix, ctypes.byref(entries))
    _call("MatDestroy", ctypes.byref(matrix))
    return schur


def _call(name: str, *arguments) -> None:
    """Call a function of PETSc; petsc4py objects go as their handles. Raises PETSc.Error."""
    plain = [ctypes.c_void_p(argument.handle) if isinstance(argument, PETSc.Object) else argument
             for argument in arguments]
    code = getattr(PETSC, name)(*plain)
    if code:
        raise PETSc.Error(code)
