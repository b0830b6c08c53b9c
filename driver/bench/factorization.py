"""Solver time over one sparse Cholesky factorization and solution of the assembled linear problem by MUMPS."""

import dataclasses

import numpy as np
from petsc4py import PETSc
from scipy.sparse import coo_matrix

from ..feti.operator import DualOperator
from ..options import Settings
from ..feti.factorization import petsc_matrix
from ..march.tearing import build
from ..studies.table import LOADINGS, method_settings
from .workbench import REPEATS, Workbench, in_turn, march, ratios, seconds

PART = "factorization"
SUBDOMAINS = "64x32"
ORDERINGS = {"AMD": 0, "SCOTCH": 3, "PORD": 4, "METIS": 5}  # MUMPS ICNTL(7)


def assembled(structure):
    """Stiffness (n, n) of the whole body without supported dofs, as CSR, and its loads (patterns, n); no contact."""
    size = 2 * (1 + max(int(sub.node_gid.max()) for sub in structure.subdomains))
    free, i, j, values, loads = np.ones(size, bool), [], [], [], np.zeros((structure.patterns, size))
    for sub, fixed in zip(structure.subdomains, structure.fixed):
        number = 2 * sub.node_gid[sub.dof_node] + sub.dof_component
        free[number[fixed]] = False
        i.append(number[sub.rows]), j.append(number[sub.columns]), values.append(sub.values)
        for k in range(structure.patterns):
            loads[k] += np.bincount(number, sub.loads[k], minlength=size)
    K = coo_matrix((np.concatenate(values), (np.concatenate(i), np.concatenate(j))), shape=(size, size)).tocsr()
    kept = np.flatnonzero(free)
    return K[kept][:, kept].tocsr(), loads[:, kept]


def factorize_and_solve(matrix: PETSc.Mat, right: np.ndarray, ordering: int) -> float:
    """Seconds of analysis, Cholesky factorization and one solution."""
    b, x = PETSc.Vec().createWithArray(right, comm=PETSc.COMM_SELF), PETSc.Vec().createSeq(len(right))

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
    left = b.duplicate()
    matrix.mult(x, left)
    left.axpy(-1.0, b)
    if not left.norm() <= 1e-8 * b.norm():
        raise RuntimeError("MUMPS did not solve the assembled problem")
    return spent


def measure(bench: Workbench) -> dict:
    """Both loadings against the factorization, taken in turn on one core."""
    report, problem = bench.report, bench.problem(SUBDOMAINS)
    K, loads = assembled(problem.structure)
    matrix = petsc_matrix(K)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    trials = {name: factorize_and_solve(matrix, loads[0], number) for name, number in ORDERINGS.items()}
    best = min(trials, key=trials.get)
    settings = method_settings("default")
    found = in_turn({
        "set-up": lambda: seconds(lambda: _set_up(problem, Settings(**settings))),
        **{loading: lambda loading=loading: march(bench.problem(SUBDOMAINS, loading), **settings).seconds
           for loading in LOADINGS},
        "MUMPS": lambda: factorize_and_solve(matrix, loads[0], ORDERINGS[best])}, REPEATS)
    matrix.destroy()
    both = [a + b for a, b in zip(*(found[loading] for loading in LOADINGS))]
    for name, values in found.items():
        report.add(PART, f"{name}, {SUBDOMAINS}" + f" ({best} ordering, {K.shape[0]} unknowns)" * (name == "MUMPS"),
                   values, "s")
    whole = [2 * setup + steps for setup, steps in zip(found["set-up"], both)]
    report.add(PART, "two runs (set-up and steps of both loadings) over MUMPS", ratios(whole, found["MUMPS"]), "", "<= 3")
    shared = [setup + steps for setup, steps in zip(found["set-up"], both)]
    report.add(PART, "a study of both loadings (one set-up) over MUMPS", ratios(shared, found["MUMPS"]), "")
    report.add(PART, "steps of both loadings over MUMPS", ratios(both, found["MUMPS"]), "")
    return {"found": found, "trials": trials, "best": best}


def _set_up(problem, settings: Settings) -> None:
    """Substructuring, reduction, norm, preconditioner and contact block anew from the subdomains as read."""
    comm = problem.operator.comm
    structure = build(problem.manifest, problem.structure.subdomains, 0, comm)
    dataclasses.replace(problem, structure=structure, operator=DualOperator(structure, comm)).solver(settings)


def draw(figure, found: dict) -> None:
    """Stacked times of the solver beside MUMPS under every ordering."""
    from ..figures import BLUE, GREEN, INK, ORANGE

    axes = figure.subplots()
    times = {name: float(np.median(values)) for name, values in found["found"].items()}
    left = 0.0
    for name, colour, factor in (("set-up", BLUE, 2), (LOADINGS[0], GREEN, 1), (LOADINGS[1], ORANGE, 1)):
        label = "set-up, twice" if factor == 2 else f"20 steps, {name}"
        axes.barh(0, factor * times[name], left=left, color=colour, label=label)
        left += factor * times[name]
    names = list(found["trials"])
    axes.barh([1 + k for k in range(len(names))], [found["trials"][name] for name in names], color=INK, label="MUMPS")
    axes.set_yticks(range(1 + len(names)), ["FETI-DP,\nboth loadings", *(f"MUMPS, {name}" for name in names)])
    axes.set_xlabel("seconds on one core, 2048 subdomains")
    axes.legend(frameon=False, fontsize="small")
