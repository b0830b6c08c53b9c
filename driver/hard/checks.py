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
from .oracle import Assembled, coulomb_history


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
    """Manifest and subdomains of the case, exported anew."""
    return _read(*_exports(case, size))


@functools.lru_cache(maxsize=2)
def _assembled(scene: str, parameters: tuple) -> Assembled:
    from mpi4py import MPI

    from ..march.tearing import build

    manifest, subdomains = _read(scene, parameters)
    body = Assembled(manifest, subdomains)
    if manifest.contact_pairs:
        body.meet(build(manifest, subdomains, 0, MPI.COMM_SELF).contact)
    return body


def assembled(case: Case, size: dict) -> Assembled:
    """The untorn body of the case."""
    return _assembled(*_exports(case, size))


def _same_nodes(body: Assembled, contact: dict) -> np.ndarray:
    """Column of contact.csv for every contact node of the assembled body."""
    label = contact.get("boundary", np.full(contact["x"].shape, body.label[0]))[-1]
    names = "normal_y", "normal_x", "y", "x"  # at a corner two nodes differ in their normals alone
    theirs = np.lexsort([*(np.round(contact[name][-1], 6) for name in names[:2]),
                         *(contact[name][-1] for name in names[2:]), label])
    ours = np.lexsort([*np.round(body.normal, 6).T[::-1], *body.xy.T[::-1], body.label])
    order = np.empty(len(ours), int)
    order[ours] = theirs
    if not np.array_equal(body.xy, np.column_stack([contact["x"][-1], contact["y"][-1]])[order]):
        raise ValueError("contact.csv and the assembled body have different contact nodes")
    return order


def dense(tolerance: float):
    """Against the dense fixed point on the assembled body, step by step.

    Deviations are relative to the largest displacement, between bodies of the bodies, and the
    largest pressure of the run.
    """
    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        manifest, _ = exported(case, size)
        body, error = assembled(case, size), 0.0
        expected = coulomb_history(body, manifest.factors)
        order = _same_nodes(body, outcome.contact)
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

    Says everything where answers are unique, and stays right where they are not. Bodies that no
    support holds: the forces must balance, and their rigid motion is fitted to the reported
    displacements. Deviations of displacements and gaps are relative to the largest displacement of
    the run, those of tractions to its largest pressure.
    """
    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        manifest, _ = exported(case, size)
        body, contact = assembled(case, size), outcome.contact
        history = manifest.factors
        if not contact:
            error = _displacement_error(body, history, outcome)
            return Check("laws on the assembled body", error, tolerance)
        order = _same_nodes(body, contact)
        far, press = outcome.history["max_displacement"].max(), np.abs(contact["sigma_n"]).max()
        u_n, u_t, sigma_n, sigma_t, slip = (contact[name][:, order] for name in (
            "u_n", "u_t", "sigma_n", "sigma_t", "slip"))
        start, reported = u_t[:1] - slip[:1], np.concatenate([u_n, u_t], axis=1)
        force = np.concatenate([sigma_n * body.weight, sigma_t * body.weight], axis=1)
        u = np.array([body.B @ body.solve(w, body.B.T @ f) for w, f in zip(history[1:], force)])
        turned = body.B @ body.motions
        u += (turned @ np.linalg.lstsq(turned, (reported - u).T, rcond=None)[0]).T
        work = [(body.motions.T @ (w @ body.loads + body.B.T @ f),
                 np.abs(body.motions).T @ np.abs(body.B.T @ f)) for w, f in zip(history[1:], force)]
        u_n, u_t = np.split(u, 2, axis=1)
        slip = np.diff(np.concatenate([start, u_t]), axis=0)
        bound = body.friction * np.abs(sigma_n)
        # nodes with friction of their own
        free = np.isin(2 * body.gid, body.free) & np.isin(2 * body.gid + 1, body.free)
        errors = [*(ratio(np.abs(part).max(), far) for part in np.split(u - reported, 2, axis=1)),
                  ratio((u_n - body.gap).max(initial=0), far), ratio(sigma_n.max(initial=0), press),
                  ratio(np.abs(sigma_n * (u_n - body.gap)).max(), far * press),
                  ratio((np.abs(sigma_t) - bound).max(initial=0), press),
                  ratio((free * (bound * np.abs(slip) + sigma_t * slip)).max(initial=0),
                        far * press),
                  *(ratio(np.abs(net).max(initial=0), size.max(initial=0)) for net, size in work)]
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


def ratio(part: float, whole: float) -> float:
    """part / whole; where the whole is zero, 0 for nothing and infinity for something."""
    return float(part / whole) if whole > 0 else (0.0 if part == 0 else np.inf)


def condition(case: Case, size: dict, outcome: Outcome) -> float:
    """Estimated condition number of the preconditioned dual operator on the last step's face.

    The face holds all gluing rows, the normal rows of nodes that touch and the tangential rows of
    those that stick. See `face_condition`.
    """
    from mpi4py import MPI

    from ..feti.dirichlet import DirichletPreconditioner
    from ..feti.operator import DualOperator
    from ..feti.rows import RowKind
    from ..march.tearing import build

    manifest, subdomains = exported(case, size)
    operator = DualOperator(build(manifest, subdomains, 0, MPI.COMM_SELF), MPI.COMM_SELF)
    free = operator.structure.row_kind == RowKind.GLUING
    if outcome.contact:
        boundary, status = operator.structure.contact, outcome.contact["status"][-1]
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
