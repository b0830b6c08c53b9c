"""Which part of the loads at which bodies buckle the loads of a step are.

The stress s of a step changes the stiffness K by G, v' G w = int s : Q(grad v, grad w) with Q of
second_order.py: K + mu G is singular where 1/mu is an eigenvalue of -K^-1 G, and the largest of
these is the part of the buckling load that has been reached, with contact as it is at the end of
the step. It is sought in a Krylov space of a few vectors, from forces that are smooth, have no
symmetry and act where bodies are compressed, as a strut may be a small part of a large body: a
lower bound, mostly within some hundredths. A straight strut shows nothing of it in its
displacements.

Pressure from all sides is left out of nearly incompressible materials, see
finite_rotations.Triangles.turning_part: if it is twice the shear modulus it would take all
stiffness.

The first of the vectors, by which bodies give way most, mostly tells by its Rayleigh quotient that
nothing is near its buckling load: then it is the only one. Bodies that round contact alone keeps
from turning are not looked at: they roll, and other points carry their forces then. They may hold
others as they do in the step, but their own stress softens nothing. Bodies with flat feet stand
(standing.py).
"""

import numpy as np

from .finite_rotations import Triangles, turning

VECTORS = 6
SLIGHT = 0.02  # quotient of the first vector with which it is the only one
# times the compression of a body in steps that were looked at, for another one to be: tension says
# nothing of it, however large
MORE = 1.2
DEPENDENT = 1e-10  # part of the largest of the space's eigenvalues that is rounding


def reached(frozen, structure, fields: list[np.ndarray], before: np.ndarray | float,
            stands: np.ndarray) -> tuple[float, np.ndarray | float]:
    """Part of the buckling load in the step of a FrozenState with displacements `fields` (dofs,) of
    the local subdomains, and how much each of the bodies is compressed, a strain, to be given as
    `before` for another step; 0 where none is compressed by more than before. `stands` (bodies,)
    as standing.standing has it; others are not looked at. Collective.
    """
    weights, bodies = frozen.step.weights, structure.travel.bodies
    if not stands.any():
        return 0.0, before
    triangles = [Triangles(sub) for sub in structure.subdomains]
    stresses = [stands[bodies.number[of.sub.index]]
                * of.turning_part(of.of_run(of.gradient(u), u, weights))
                for of, u in zip(triangles, fields)]
    sums = np.zeros((2, structure.total))  # volume, and the square of a strain in it
    for of, stress in zip(triangles, stresses):
        pressed = compression(stress) / of.law[0, 0]
        sums[:, of.sub.index] = of.share.sum(), (of.share * pressed**2).sum()
    volume, square = (np.bincount(bodies.number, values, len(bodies.size))
                      for values in frozen.operator.comm.allreduce(sums))
    strain = np.sqrt(square / np.where(volume > 0, volume, np.inf))
    if (strain <= MORE * before).all():
        return 0.0, before
    part = _largest(frozen, triangles, stresses, bodies.size.max())
    return part, np.maximum(strain, before)


def compression(stress: np.ndarray) -> np.ndarray:
    """(n_t, m) largest pressure on a section in the plane of stresses (3 or 4, n_t, m), or zero."""
    xx, yy, xy = stress[:3]
    return np.maximum(np.hypot((xx - yy) / 2, xy) - (xx + yy) / 2, 0.0)


def _largest(frozen, triangles: list, stresses: list, size: float) -> float:
    """The largest eigenvalue that the Krylov space of forces over a length `size` finds."""
    total = frozen.operator.structure.total

    def softened(w: list) -> list:
        return [-of.nodal(0.0 * stress, turning(stress, of.gradient(v)))
                for of, stress, v in zip(triangles, stresses, w)]

    force = [of.uneven_forces(size, compression(stress) / of.law[0, 0])
             for of, stress in zip(triangles, stresses)]
    answers, forces, changed = [], [], []
    for k in range(VECTORS):
        _, w = frozen.under(force)
        norm = np.sqrt(abs(_work(frozen, triangles, force, w, total))) or 1.0
        answers.append([v / norm for v in w])
        forces.append([f / norm for f in force])
        force = softened(answers[-1])
        changed.append(force)
        if k == 0:
            quotient = _work(frozen, triangles, force, answers[0], total)
            if quotient <= SLIGHT:
                return max(quotient, 0.0)
    stiff, soft = (np.array([[_work(frozen, triangles, f, w, total) for f in of] for w in answers])
                   for of in (forces, changed))
    values, vectors = np.linalg.eigh((stiff + stiff.T) / 2)
    kept = values > DEPENDENT * values.max(initial=0.0)
    if not kept.any():
        return 0.0
    base = vectors[:, kept] / np.sqrt(values[kept])
    return float(max(np.linalg.eigvalsh(base.T @ (soft + soft.T) @ base / 2).max(), 0.0))


def _work(frozen, triangles: list, force: list, w: list, total: int) -> float:
    """Of forces (dofs,) of the local subdomains on displacements (dofs,), for any number of ranks.
    """
    work = np.zeros(total)
    for of, f, v in zip(triangles, force, w):
        work[of.sub.index] = f @ v
    return float(frozen.operator.comm.allreduce(work).sum())
