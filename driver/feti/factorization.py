"""Sparse Cholesky (LDL') factorizations by PETSc, MUMPS and CHOLMOD, each on one rank."""

import numpy as np
from petsc4py import PETSc


def petsc_matrix(matrix) -> PETSc.Mat:
    """Sequential PETSc matrix of a symmetric scipy CSR matrix (n, n)."""
    csr = (matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data)
    mat = PETSc.Mat().createAIJ(matrix.shape, csr=csr, comm=PETSc.COMM_SELF)
    mat.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return mat


def petsc_upper(upper) -> PETSc.Mat:
    """Sequential symmetric PETSc matrix (n, n) of its `upper` triangle, sorted scipy CSR."""
    csr = (upper.indptr.astype(PETSc.IntType), upper.indices.astype(PETSc.IntType), upper.data)
    return PETSc.Mat().createSBAIJ(upper.shape, 1, csr=csr, comm=PETSc.COMM_SELF)


def factorized(matrix: PETSc.Mat, package: str = "petsc") -> PETSc.PC:
    """Factorization of a symmetric matrix (n, n) by `package`: petsc, mumps or cholmod.

    MUMPS counts null pivots (INFOG(28)) instead of dividing by them. Raises PETSc.Error.
    """
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setType("cholesky")
    pc.setFactorSolverType(package)
    pc.setOperators(matrix)
    if package == "petsc":
        pc.setFactorOrdering("nd")
    if package == "mumps":
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(24, 1)
    pc.setUp()
    return pc


def solve_columns(pc: PETSc.PC, right: np.ndarray) -> np.ndarray:
    """Solution (n, k) for the columns of `right` (n, k), n and k positive."""
    b = PETSc.Mat().createDense(right.shape, array=np.asfortranarray(right), comm=PETSc.COMM_SELF)
    x = PETSc.Mat().createDense(right.shape, comm=PETSc.COMM_SELF)
    x.setUp()
    pc.getFactorMatrix().matSolve(b, x)
    solution = x.getDenseArray().copy()
    b.destroy()
    x.destroy()
    return solution
