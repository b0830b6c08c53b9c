"""PETSc's bound-constrained solvers (TAO) on a QP of the model: products to equal tolerance."""

import functools

import numpy as np
from petsc4py import PETSc

from ..options import Settings
from ..qp.lanczos import norm_bound
from ..qp.box import projected_gradient
from ..qp.mprgp import mprgp
from ..studies.table import LOADINGS
from .workbench import Workbench

SIZES = ("4x2", "8x4", "16x8")
# not bqpip: it changes F's diagonal, for which products are no use
SOLVERS = ("bncg", "bqnls", "blmvm", "gpcg", "tron", "bnls", "bntr", "bntl")
RTOL = 1e-6  # projected gradient over ||d||
LIMIT = 20_000  # products after which a solver has failed


class Limit(Exception):
    """Too many products."""


def problem_of(bench: Workbench, subdomains: str):
    """Operator, d, bounds and solver of the QP at t = 0.25, where contact states are mixed."""
    problem = bench.problem(subdomains, LOADINGS[1])
    solver = problem.solver(Settings())
    step = next(step for step in solver.steps() if step.index == 5)
    d = problem.operator.apply(step.multipliers) - step.gradient
    return problem.operator, d, solver.rows.limits(len(d), step.multipliers), solver


def ours(operator, d, bounds, solver) -> int:
    """Products of MPRGP from zero, the estimate of the norm included."""
    before, tol, made = operator.products, RTOL * np.linalg.norm(d), solver.qp.accelerators
    bound, _ = norm_bound(operator.apply, operator.owned, dot=operator.dot)
    result = mprgp(operator.apply, d, *bounds, np.clip(np.zeros_like(d), *bounds), tol=tol,
                   norm_bound=bound, preconditioner=made.preconditioner, dot=operator.dot,
                   expansion="cg", relax=functools.partial(made.relaxation.relaxed, limits=bounds,
                                                           tol=0.5 * tol))
    if result.status != "converged":
        raise RuntimeError(f"MPRGP ended with {result.status}")
    return operator.products - before


def theirs(name: str, operator, d, bounds, bound: float) -> tuple[int, bool]:
    """Products of a TAO solver from zero, and whether it reached the tolerance.

    TAO's tolerances and first steps are absolute: norms of F and of d are scaled to one.
    """
    size, before, length = len(d), operator.products, np.linalg.norm(d)
    unit, right = length / bound, d / length
    lower, upper = (bound_ / unit for bound_ in bounds)
    best = [np.inf]

    def product(x: np.ndarray) -> np.ndarray:
        if operator.products - before >= LIMIT:
            raise Limit
        return operator.apply(x) / bound

    def objective_gradient(tao, x, g):
        Fx = product(x.array_r)
        g.array[:] = Fx - right
        return float(0.5 * x.array_r @ Fx - x.array_r @ right)

    def monitor(tao):
        x, g = tao.getSolution().array_r, tao.getGradient()[0].array_r
        projected = projected_gradient(np.clip(x, lower, upper), g, lower, upper)
        best[0] = float(np.linalg.norm(projected))
        if best[0] <= RTOL:
            tao.setConvergedReason(PETSc.TAO.Reason.CONVERGED_USER)

    class Shell:
        """F as a matrix without entries."""

        def mult(self, matrix, x, y):
            """y = F x."""
            y.array[:] = product(x.array_r)

    def vec(values: np.ndarray) -> PETSc.Vec:
        return PETSc.Vec().createWithArray(np.array(values), comm=PETSc.COMM_SELF)

    hessian = PETSc.Mat().createPython((size, size), Shell(), comm=PETSc.COMM_SELF)
    hessian.setUp()
    hessian.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    tao = PETSc.TAO().create(PETSc.COMM_SELF)
    tao.setType(name)
    tao.setObjectiveGradient(objective_gradient, vec(np.zeros(size)))
    tao.setHessian(lambda tao, x, H, P: None, hessian)
    tao.setVariableBounds(*(vec(np.clip(limit, PETSc.NINFINITY, PETSc.INFINITY))
                            for limit in (lower, upper)))
    tao.setSolution(vec(np.clip(np.zeros(size), lower, upper)))
    tao.setTolerances(gatol=0.0, grtol=0.0, gttol=0.0)  # the monitor decides
    tao.setMaximumIterations(LIMIT)
    tao.setMaximumFunctionEvaluations(LIMIT)
    tao.setMonitor(monitor)
    PETSc.Options()["tao_subset_type"] = "matrixfree"  # tron, gpcg: faces without taking F apart
    tao.setFromOptions()
    if tao.getKSP():
        tao.getKSP().getPC().setType("none")
    try:
        tao.solve()
    except Limit:
        pass
    return operator.products - before, best[0] <= RTOL


def measure(bench: Workbench) -> dict:
    """Products of every solver, ours beside them."""
    products = {}
    for subdomains in SIZES:
        operator, d, bounds, solver = problem_of(bench, subdomains)
        own, counts = ours(operator, d, bounds, solver), []
        for name in SOLVERS:
            count, converged = theirs(name, operator, d, bounds, solver.qp.bound)
            bench.add(f"{name}, {subdomains}{'' if converged else ', not converged'}", count)
            counts.append(count)
        bench.add(f"MPRGP, {subdomains}, {len(d)} multipliers", own, "", f"<= {min(counts) - 1}")
        products[subdomains] = [own, *counts]
    return {"solvers": ["mprgp", *SOLVERS], "products": products, "rtol": RTOL}
