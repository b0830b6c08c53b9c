"""Statically admissible stress inside the triangles, from equilibrated tractions on their edges.

Inside a triangle with given tractions a stress of Johnson and Mercier (1978) is unique: symmetric,
linear on each of the three parts that the centroid cuts off, with continuous tractions between
them, and with a constant divergence on each, chosen to give the moments of f. Tractions, body force
and stress map together by the Piola transformation, so that one constant matrix of the reference
triangle serves every element.
"""

from functools import lru_cache

import numpy as np

from ..scene.elements import hat_gradients
from .edge_mesh import Mesh, full_tensor

CORNER = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])  # of the reference triangle


@lru_cache(maxsize=1)
def reference_stress() -> np.ndarray:
    """(3, 3, 3, 18): stress [part, node, s11 s22 s12] of the reference triangle by its data.

    Part k lies opposite to corner k and has the nodes k + 1, k + 2 and the centroid. Data: moments
    of the tractions [side, end, component], side k going from corner k to k + 1, then of the body
    force [corner, component].
    """
    middle = CORNER.mean(axis=0)
    nodes = [np.array([CORNER[(k + 1) % 3], CORNER[(k + 2) % 3], middle]) for k in range(3)]
    unknown = np.arange(27).reshape(3, 3, 3)
    rows, right = [], []

    def traction(part, node, across):
        row = np.zeros((2, 27))
        row[0, unknown[part, node]] = across[0], 0, across[1]
        row[1, unknown[part, node]] = 0, across[1], across[0]
        return row

    for j in range(3):  # between the parts that meet on the line from corner j to the middle
        across = np.array([[0, 1], [-1, 0]]) @ (middle - CORNER[j])
        for left, right_node in ((1, 0), (2, 2)):
            rows.append(traction((j + 1) % 3, left, across)
                        - traction((j + 2) % 3, right_node, across))
            right.append(np.zeros((2, 18)))
    for side in range(3):  # density over [0, 1] with end values 4 m_a - 2 m_b and 4 m_b - 2 m_a
        part, along = (side + 2) % 3, CORNER[(side + 1) % 3] - CORNER[side]
        across = np.array([[0, 1], [-1, 0]]) @ along
        for end in range(2):
            value = np.zeros((2, 18))
            for c in range(2):
                value[c, 4 * side + 2 * end + c], value[c, 4 * side + 2 * (1 - end) + c] = 4, -2
            rows.append(traction(part, end, across))
            right.append(value)
    share = np.linalg.inv((4 - 3 * np.eye(3)) / 9) / (1 / 6)  # constant forces of parts by moments
    for part in range(3):
        gradient = hat_gradients(nodes[part][None])[0]
        row, value = np.zeros((2, 27)), np.zeros((2, 18))
        for node in range(3):
            row += traction(part, node, gradient[node])
        for c in range(2):
            value[c, 12 + c :: 2] = -share[part]
        rows.append(row)
        right.append(value)
    solution = np.linalg.pinv(np.concatenate(rows)) @ np.concatenate(right)
    return solution.reshape(3, 3, 3, 18)


def johnson_mercier(corner: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """(m, 3 parts, 3 nodes, 3) stress with balanced traction moments (m, side, end, 2)."""
    columns = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=2)
    data = np.einsum("mab,mseb->msea", np.linalg.inv(columns), moments).reshape(-1, 12)
    inner = (data @ reference_stress().reshape(27, 18)[:, :12].T).reshape(-1, 9, 3)
    full = columns[:, None] @ full_tensor(inner) @ columns.transpose(0, 2, 1)[:, None]
    stress = full[..., [0, 1, 0], [0, 1, 1]] / np.linalg.det(columns)[:, None, None]
    return stress.reshape(-1, 3, 3, 3)


@lru_cache(maxsize=2)
def reference_modes(body: bool) -> np.ndarray:
    """(27, 9), with `body` (27, 15), stresses of the reference triangle in deviations from sigma_h.

    Modes 2 k + c: moments +1, -1 of component c at corner k on the sides to its next and previous
    corner; 6 + k: moments +t, -t at the ends of side k along its direction t; 9 + 2 k + c: body
    force with moment 1 of component c at corner k, -1/2 on its two sides.
    """
    data = np.zeros((3, 2, 2, 15))  # [side, end, component, mode]
    force = np.zeros((3, 2, 15))
    for k in range(3):
        vertex, share = slice(2 * k, 2 * k + 2), slice(9 + 2 * k, 11 + 2 * k)
        for side, end, sign in ((k, 0, 1), (k - 1, 1, -1)):
            data[side, end, :, vertex] = sign * np.eye(2)
            data[side, end, :, share] = -0.5 * np.eye(2)
        force[k, :, share] = np.eye(2)
        data[k, 0, :, 6 + k] = CORNER[(k + 1) % 3] - CORNER[k]
        data[k, 1, :, 6 + k] = -data[k, 0, :, 6 + k]
    data = np.concatenate([data.reshape(12, 15), force.reshape(6, 15)])
    modes = reference_stress().reshape(27, 18) @ data
    return modes if body else modes[:, :9]


def piola(mesh: Mesh) -> np.ndarray:
    """(3, 3, n_t) maps J s J' / det J of reference stresses s11, s22, s12 to the triangles'."""
    (a, b), (c, d) = mesh.columns.transpose(1, 2, 0)
    rows = [[a * a, b * b, 2 * a * b], [c * c, d * d, 2 * c * d], [a * c, b * d, a * d + b * c]]
    return np.array(rows) / (2 * mesh.area)
