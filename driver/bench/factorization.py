"""Solver time over one sparse Cholesky factorization and solution by MUMPS, assembled."""

import dataclasses
import functools
from statistics import median

import numpy as np
from petsc4py import PETSc
from scipy.sparse import coo_matrix

from ..feti.factorization import petsc_matrix
from ..feti.operator import DualOperator
from ..march.tearing import build
from ..options import Settings
from ..studies.table import LOADINGS, method_settings
from .workbench import Workbench, in_turn, march, ratios, seconds

SUBDOMAINS = "64x32"
ORDERINGS = {"AMD": 0, "SCOTCH": 3, "PORD": 4, "METIS": 5}  # MUMPS ICNTL(7)


def assembled(structure):
    """CSR stiffness (n, n) of the whole body without supported dofs, and loads (patterns, n)."""
    size = 2 * (1 + max(int(sub.node_gid.max()) for sub in structure.subdomains))
    free, loads = np.ones(size, bool), np.zeros((structure.patterns, size))
    i, j, values = [], [], []
    for sub, fixed in zip(structure.subdomains, structure.fixed):
        number = 2 * sub.node_gid[sub.dof_node] + sub.dof_component
        free[number[fixed]] = False
        row, column, value = sub.stiffness.entries()
        i.append(number[row])
        j.append(number[column])
        values.append(value)
        for k in range(structure.patterns):
            loads[k] += np.bincount(number, sub.loads[k], minlength=size)
    entries = np.concatenate(values), (np.concatenate(i), np.concatenate(j))
    K = coo_matrix(entries, shape=(size, size)).tocsr()
    unknowns = np.flatnonzero(free)
    return K[unknowns][:, unknowns].tocsr(), loads[:, unknowns]


def factorize_and_solve(matrix: PETSc.Mat, right: np.ndarray, ordering: int) -> float:
    """Seconds of analysis, Cholesky factorization and one solution.

    Raises RuntimeError if the solution leaves a residual.
    """
    b = PETSc.Vec().createWithArray(right, comm=PETSc.COMM_SELF)
    x = PETSc.Vec().createSeq(len(right))

    def once():
        pc = PETSc.PC().create(PETSc.COMM_SELF)
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setOperators(matrix)
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(7, ordering)
        pc.setUp()
        pc.apply(b, x)
        pc.destroy()

    spent = seconds(once)
    residual = b.duplicate()
    matrix.mult(x, residual)
    residual.axpy(-1.0, b)
    if not residual.norm() <= 1e-8 * b.norm():
        raise RuntimeError("MUMPS did not solve the assembled problem")
    return spent


def measure(bench: Workbench) -> dict:
    """Both loadings and the factorization in turn on one core; median seconds for the picture."""
    problem = bench.problem(SUBDOMAINS)
    K, loads = assembled(problem.structure)
    matrix = petsc_matrix(K)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    trials = {name: factorize_and_solve(matrix, loads[0], number)
              for name, number in ORDERINGS.items()}
    best = min(trials, key=trials.get)
    settings = method_settings("default")

    def steps(loading: str) -> float:
        return march(bench.problem(SUBDOMAINS, loading), **settings).seconds

    times = in_turn({"set-up": lambda: seconds(lambda: _set_up(problem, Settings(**settings))),
                     **{loading: functools.partial(steps, loading) for loading in LOADINGS},
                     "MUMPS": lambda: factorize_and_solve(matrix, loads[0], ORDERINGS[best])})
    matrix.destroy()
    for name, values in times.items():
        note = f" ({best} ordering, {K.shape[0]} unknowns)" if name == "MUMPS" else ""
        bench.add(f"{name}, {SUBDOMAINS}{note}", values, "s")
    both = np.add(*(times[loading] for loading in LOADINGS))
    set_up = np.array(times["set-up"])
    for name, values, target in (
            ("two runs (set-up and steps of both loadings)", 2 * set_up + both, "<= 3"),
            ("a study of both loadings (one set-up)", set_up + both, ""),
            ("steps of both loadings", both, "")):
        bench.add(f"{name} over MUMPS", ratios(values, times["MUMPS"]), "", target)
    parts = {"set-up, twice": 2 * median(times["set-up"]),
             **{f"20 steps, {loading}": median(times[loading]) for loading in LOADINGS}}
    return {"seconds": parts, "orderings": trials, "subdomains": problem.structure.total}


def _set_up(problem, settings: Settings) -> None:
    """Substructuring, reduction, norm, preconditioner and contact block anew."""
    comm = problem.operator.comm
    structure = build(problem.manifest, problem.structure.subdomains, 0, comm)
    dataclasses.replace(problem, structure=structure,
                        operator=DualOperator(structure, comm)).solver(settings)
