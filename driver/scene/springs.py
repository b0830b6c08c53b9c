"""Springs at nodes: what a subdomain's record says of them, and the stiffness with them.

The room of springs writes the three entries of every node's stiffness as nodal numbers. On an
elastic foundation these are integrals of its stiffness against the node's shape function, those of
quadratic elements by Simpson's rule, so that uniform displacements meet the forces of uniform
tractions node by node.
"""

import numpy as np

FIELDS = ("spring_xx", "spring_xy", "spring_yy")  # as springs.idp names them


def stiffened(piece: dict, fields: dict[str, np.ndarray]) -> dict:
    """What springs of its nodes change of `piece`, attributes of a Subdomain.

    `fields` (n_v,) are the nodal numbers of its record. Empty where no node has a spring.
    """
    if FIELDS[0] not in fields:
        return {}
    springs = np.column_stack([fields[name] for name in FIELDS])
    node = np.flatnonzero(springs.any(axis=1))
    if not len(node):
        return {}
    rows, columns = ((2 * node[:, None] + place).ravel() for place in ([0, 1, 1], [0, 0, 1]))
    return {"springs": springs,
            "stiffness": piece["stiffness"].plus(rows, columns, springs[node].ravel())}


def forces(sub, u: np.ndarray) -> np.ndarray:
    """(dofs,) forces of the springs on a Subdomain `sub` that has any, at displacements u."""
    moved, (xx, xy, yy) = u.reshape(-1, 2), sub.springs.T
    return -np.column_stack([xx * moved[:, 0] + xy * moved[:, 1],
                             xy * moved[:, 0] + yy * moved[:, 1]]).ravel()
