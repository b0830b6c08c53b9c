"""Rigid motions of bodies that no support holds, in the dual, and the springs that hold them.

Springs of small stiffness 1/rho hold such bodies; their rest positions alpha follow the motion
until they carry no force, the proximal point method or, in the dual, the augmented Lagrangian of G
lambda = e with G = Q' A', which keeps the QP's bounds scalar (SMALBE: Dostal, Horak (2010)):

    d(alpha) = d + A Q alpha.

A rigid motion counts as one more load pattern with the factor alpha.
"""

import numpy as np

from .gathering import largest
from .reduction import LocalClass
from .rigid_modes import RigidMode
from .rows import RowKind
from .structure import Substructure
from .travel import Bodies
from .vectors import DualVectors

# displacement of a row under a motion of norm one at the corners, up to which it is rounding: as of
# a disc that turns in its hole
STILL = 1e-9
OUT_OF_ROUND = 1e-2  # part of a motion that rows feel of bodies that turn together on polygons
SOFTNESS = 10.0  # of the springs: rho in units of (number of corner dofs) / (stiffness of one)


def displacements(structure: Substructure, classes: list[LocalClass], vectors: DualVectors,
                  comm) -> list[np.ndarray]:
    """(owned,) d = B u of every rigid motion; gluing rows do not move. Collective.

    Nothing resists what all bodies move by together, if they meet but one another. Polygons that
    are not quite round would, and the friction of nodes that are apart: rows do not feel it.
    """
    motions = [_displacement(structure, classes, vectors, k)
               for k in range(len(structure.rigid_modes))]
    together = _together(structure) if motions and structure.contact.paired.all() else None
    if together is None or not together.size:
        return motions
    columns, turn = np.array(motions).T, of_bodies(structure.travel.bodies, structure.rigid_modes)
    opens = structure.row_kind != RowKind.TANGENTIAL
    largest_of = [largest(comm, np.abs(moved[opens]).max(axis=0, initial=0.0))
                  for moved in (columns, columns @ together)]
    # periodic boundaries resist that bodies turn
    together = together[:, largest_of[1] < OUT_OF_ROUND * largest_of[0].max()]
    if together.size:
        weighted = turn.T @ turn @ together
        columns = columns - columns @ together @ np.linalg.solve(together.T @ weighted, weighted.T)
    return list(np.ascontiguousarray(columns.T))


def of_bodies(bodies: Bodies, modes: list[RigidMode]) -> np.ndarray:
    """(3 bodies, modes) rigid modes as in Bodies.rigid, body by body."""
    return np.array([bodies.coefficients(mode) for mode in modes]).T


def _together(structure: Substructure) -> np.ndarray:
    """(modes, c) combinations of rigid modes by which all bodies move as one."""
    bodies = structure.travel.bodies
    turn = of_bodies(bodies, structure.rigid_modes)
    away = bodies.center - bodies.center.mean(axis=0)
    one = np.zeros((len(away), 3, 3))
    one[:, 0, 0] = one[:, 1, 1] = 1.0
    one[:, 0, 2], one[:, 1, 2], one[:, 2, 2] = -away[:, 1], away[:, 0], bodies.size
    one = (one * bodies.possible[:, None]).reshape(-1, 3)[:, bodies.possible > 0]
    together = np.linalg.lstsq(turn, one, rcond=None)[0]
    missed = np.abs(turn @ together - one).max(axis=0)
    return together[:, missed < STILL * np.abs(one).max(axis=0)]


def _displacement(structure: Substructure, classes: list[LocalClass], vectors: DualVectors,
                  k: int) -> np.ndarray:
    """As `displacements`, of the k-th rigid motion by itself. Collective."""
    mode, local = structure.rigid_modes[k], np.zeros(len(vectors.sign))
    for c in classes:
        moved = local[c.rows].reshape(len(c.members), -1)
        for i, s in enumerate(c.members):
            if structure.first + s in mode.members:
                u = mode.displacement(structure.subdomains[s].xy).ravel()
                rows = structure.rows[s]
                moved[i] = (rows.coefficient * u[rows.dof]).sum(axis=1)
    glued = vectors.assemble(local * vectors.sign)
    kind = structure.row_kind
    # rounding, also of what is joined to itself, periodically, or slides along without friction
    glued[(kind == RowKind.GLUING) | (np.abs(glued) < STILL)] = 0.0
    return glued


def touched(structure: Substructure, classes: list[LocalClass], vectors: DualVectors,
            modes: list) -> np.ndarray:
    """(owned,) largest translation by the `modes` of a body times what contact rows feel of it.

    Whatever their directions; gluing rows feel nothing. Collective.
    """
    size = max(np.linalg.norm(mode.translation) for mode in modes)
    local = np.zeros(len(vectors.sign))
    for c in classes:
        felt = local[c.rows].reshape(len(c.members), -1)
        for i, s in enumerate(c.members):
            if structure.first + s in modes[0].members:
                felt[i] = size * np.abs(structure.rows[s].coefficient).sum(axis=1)
    total = vectors.assemble(local * np.abs(vectors.sign))
    total[structure.row_kind == RowKind.GLUING] = 0.0
    return total


def spring_compliances(classes: list[LocalClass], vectors: DualVectors,
                       motions: list[np.ndarray]) -> np.ndarray:
    """(modes,) rho: SOFTNESS over a contact row's stiffness against a motion, the softer body's.

    `motions` are the displacements (owned,) of the dual rows under each. A row's compliance is that
    of all subdomains it joins, their corners on springs like their own stiffness. Collective.
    """
    if not motions:
        return np.zeros(0)
    local = np.zeros(len(vectors.sign))
    for c in classes:
        held = np.linalg.solve(c.S + np.diag(c.corner_stiffness), c.A.T)
        local[c.rows] = np.tile(np.diag(c.F) + np.einsum("ij,ji->i", c.A, held), len(c.members))
    compliance, rho = vectors.assemble(local), np.zeros(len(motions))
    for k, moved in enumerate(motions):
        stiffness = np.divide(moved**2, compliance, out=np.zeros(vectors.owned),
                              where=np.abs(moved) > STILL)
        rows = vectors.dot(np.sign(stiffness), np.sign(stiffness))
        rho[k] = SOFTNESS * rows / vectors.dot(stiffness, np.ones(vectors.owned)) if rows else 0.0
    return np.where(rho > 0, rho, rho.max() or 1.0)


def work_of_loads(structure: Substructure, comm) -> np.ndarray:
    """(2, patterns, modes) work of patterns on motions, and what it could be; collective.

    That is nodal forces times motions whatever their directions: forces across a motion work by its
    rounding. Loads on fixed displacements are their supports' and do none, not by rounding either.
    """
    work = np.zeros((2, structure.total, structure.patterns, len(structure.rigid_modes)))
    for k, mode in enumerate(structure.rigid_modes):
        for s, (sub, moved) in enumerate(zip(structure.subdomains, mode.fields(structure))):
            if structure.first + s in mode.members:
                moved[structure.fixed[s]] = 0.0
                work[0, structure.first + s, :, k] = (sub.loads * moved).sum(axis=1)
                work[1, structure.first + s, :, k] = _nodal(sub.loads) @ _nodal(moved)
    return np.sum(comm.allgather(work), axis=0).sum(axis=1)


def _nodal(values: np.ndarray) -> np.ndarray:
    """(..., nodes) lengths of the nodal vectors of (..., dofs)."""
    return np.linalg.norm(values.reshape(*values.shape[:-1], values.shape[-1] // 2, 2), axis=-1)
