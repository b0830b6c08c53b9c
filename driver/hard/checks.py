"""Independent answers for the hard cases (assembled body, closed forms, runs), and conditions.

A check is a callable (case, size, outcome) -> Check. The assembled body is exported anew and knows
nothing of corners, gluing or dual rows; its sparse factorization is SuperLU's, where the driver's
are PETSc's and MUMPS's.
"""

import functools
import tempfile
from pathlib import Path

import numpy as np

from .. import environment, options
from ..scene import freefem
from ..scene.loader import read_subdomains
from ..scene.manifest import read_manifest
from .case import Case, Check, Outcome, reference
from .laws import ratio, same_nodes, violations
from .dense import coulomb_history
from .oracle import Assembled


@functools.lru_cache(maxsize=4)
def _read(scene: str, parameters: tuple):
    """Manifest and subdomains of a fresh export."""
    environment.start_petsc()
    from mpi4py import MPI

    with tempfile.TemporaryDirectory() as folder:
        freefem.export(freefem.find_scene(scene), Path(folder), dict(parameters))
        manifest = read_manifest(Path(folder))
        return manifest, read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)


def _exports(case: Case, size: dict) -> tuple[str, tuple]:
    """Scene and its parameters, without the driver's options."""
    return case.scene, tuple((name.lower(), value) for name, value in case.arguments(size).items()
                             if name.lower() not in options.OF_RUNS)


def exported(case: Case, size: dict):
    """Manifest and subdomains of the case, exported anew; cycles one after the other."""
    manifest, subdomains = _read(*_exports(case, size))
    if "cycles" in manifest.rooms:
        count = case.arguments(size).get("CYCLES", manifest.rooms["cycles"]["count"])
        manifest = manifest.unrolled(int(count))
    return manifest, subdomains


@functools.lru_cache(maxsize=2)
def _assembled(scene: str, parameters: tuple) -> Assembled:
    from mpi4py import MPI

    from ..march.tearing import build

    manifest, subdomains = _read(scene, parameters)
    body = Assembled(manifest, subdomains)
    if manifest.contact_pairs or manifest.axisymmetric and manifest.element != "P1":
        body.meet(build(manifest, subdomains, 0, MPI.COMM_SELF).contact)
    return body


def assembled(case: Case, size: dict) -> Assembled:
    """The untorn body of the case."""
    return _assembled(*_exports(case, size))


def dense(tolerance: float):
    """Against the dense fixed point on the assembled body, step by step.

    Deviations are relative to the largest displacement, between bodies of the bodies, and the
    largest pressure of the run.
    """
    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        manifest, _ = exported(case, size)
        body, error = assembled(case, size), 0.0
        expected = coulomb_history(body, manifest.factors)
        order = same_nodes(body, outcome.contact)
        for names in (("u_n", "u_t"), ("sigma_n", "sigma_t")):
            largest = max(np.abs(expected[name]).max() for name in names)
            # jumps, where nothing slides those of rounding
            if names[0] == "u_n" and manifest.contact_pairs:
                largest = outcome.history["max_displacement"].max()
            apart = max(np.abs(outcome.contact[name][:, order] - expected[name]).max()
                        for name in names)
            error = max(error, ratio(apart, largest))
        return Check("dense fixed point", error, tolerance)
    return check


def laws(tolerance: float):
    """Displacements of the assembled body under the reported contact forces obey all laws.

    Says everything where answers are unique, and stays right where they are not; see `violations`.
    """
    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        manifest, _ = exported(case, size)
        body = assembled(case, size)
        if not outcome.contact:
            error = _displacement_error(body, manifest.factors, outcome)
            return Check("laws on the assembled body", error, tolerance)
        errors = violations(body, manifest, outcome.contact).values()
        return Check("laws on the assembled body", float(max(errors)), tolerance)
    return check


LAWS, BOTH = (laws(1e-6),), (dense(1e-6), laws(1e-6))  # at case.TIGHT


def _displacement_error(body: Assembled, history: np.ndarray, outcome: Outcome) -> float:
    """Without contact: largest displacement against the reported one, over all steps."""
    far = np.array([np.linalg.norm(body.solve(w).reshape(-1, 2), axis=1).max()
                   for w in history[1:]])
    return ratio(np.abs(far - outcome.history["max_displacement"]).max(), far.max())


def same_as(tolerance: float, length: float = 1.0, stress: float = 1.0, *, options: dict,
            counts: bool = True):
    """Against the run with `options`: equal answers but for units, equal `counts` if asked.

    Lengths (displacements among them) are `length` times, stresses `stress` times those of the
    other run. Deviations are relative to the largest displacement and the largest stress at the
    contact nodes, or displacement of the bodies.
    """
    scale = {"u": length, "s": stress}  # by first letter

    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        other = reference(case, size, options)
        same = not counts or outcome.summary["counts"] == other.summary["counts"]
        far, error = 0.0, 0.0
        if other.summary["effects"]["bodies"] > 1:
            far = other.history["max_displacement"].max()
        for names, least in ((("u_n", "u_t"), far), (("sigma_n", "sigma_t"), 0.0)):
            largest = max(least, *(np.abs(other.contact[name]).max() for name in names))
            for name in names:
                apart = np.abs(outcome.contact[name] - scale[name[0]] * other.contact[name]).max()
                error = max(error, ratio(apart, scale[name[0]] * largest))
        if not same:
            return Check("the run in other units or places (other counts)", np.inf, tolerance)
        return Check("the run in other units or places", error, tolerance)
    return check


def holds(what: str, condition):
    """`condition(outcome)` must be true."""
    return lambda case, size, outcome: Check(what, 0.0 if condition(outcome) else np.inf, 1.0)


def closed_form(oracle: str, tolerance: float, formula):
    """Against a closed form: `formula(outcome)` gives pairs (computed, expected)."""
    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        errors = [ratio(np.abs(np.asarray(computed) - expected).max(), np.abs(expected).max())
                  for computed, expected in formula(outcome)]
        return Check(oracle, float(max(errors)), tolerance)
    return check


def condition(case: Case, size: dict, outcome: Outcome) -> float:
    """Estimated condition number of the preconditioned dual operator on the last step's face.

    The face holds all rows that glue and join, the normal rows of nodes that touch and the
    tangential rows of those that stick. See `face_condition`.
    """
    environment.start_petsc()
    from mpi4py import MPI

    from ..feti.dirichlet import DirichletPreconditioner
    from ..feti.operator import DualOperator
    from ..feti.rows import RowKind
    from ..march.tearing import build

    manifest, subdomains = exported(case, size)
    operator = DualOperator(build(manifest, subdomains, 0, MPI.COMM_SELF), MPI.COMM_SELF)
    free = np.isin(operator.structure.row_kind, [RowKind.GLUING, RowKind.JOINED])
    if outcome.contact:
        boundary, status = operator.structure.contact.declared, outcome.contact["status"][-1]
        for rows, wanted in ((boundary.normal_row, status != "open"),
                             (boundary.tangential_row, status == "stick")):
            free[rows[wanted & (rows >= 0)]] = True
    return face_condition(operator, DirichletPreconditioner(operator), free)


def face_condition(operator, preconditioner, free: np.ndarray, steps: int = 80) -> float:
    """Ratio of the extreme Ritz values of M F on the face `free` (owned,) from preconditioned CG.

    The coefficients of CG make up the Lanczos matrix (Golub, Van Loan, Matrix Computations, 10.2);
    its extreme eigenvalues approach those of M F from inside, so this is a lower bound of the
    condition number. NaN where the face is empty.
    """
    if not free.any():
        return np.nan
    r = np.where(free, np.random.default_rng(3).standard_normal(len(free)), 0.0)
    z = preconditioner(r, free)
    p, rho, first = z, r @ z, r @ z
    diagonal, off, beta, alpha = [], [], 0.0, 1.0
    for _ in range(min(steps, int(free.sum()))):
        Ap = np.where(free, operator.apply(p), 0.0)
        last, alpha = alpha, rho / (p @ Ap)
        diagonal.append(1 / alpha + beta / last)
        r = r - alpha * Ap
        z = preconditioner(r, free)
        beta, rho = (r @ z) / rho, r @ z
        if not rho > 1e-24 * first:
            break
        off.append(np.sqrt(beta) / alpha)
        p = z + beta * p
    off = off[: len(diagonal) - 1]
    ritz = np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))
    return float(ritz[-1] / ritz[0])
