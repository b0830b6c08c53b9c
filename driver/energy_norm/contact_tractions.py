"""Contact tractions of rigid obstacles for the bound of the error in the energy norm."""

import numpy as np

from ..vectors import turned_left


class ContactTractions:
    """Tractions t* of rigid obstacles in the cone, linear on edges between the computed nodal ones.

    Arrays over the nodes: those of the contact boundary, then the clamped ones. A node has no
    traction of its own in a direction that a support holds, and takes its neighbours' mean: of the
    pressure, and of the part of the friction bound that the shear is.
    """

    def __init__(self, contact, state: dict, move: np.ndarray, step_move: np.ndarray,
                 times: tuple[float, float]):
        """`contact` is a results.ContactState, `state` its quantities at the end of the step.

        `move`, `step_move` (n_k, 2): displacement of the clamped nodes and its change in the step;
        `times` at which that begins and ends.
        """
        b = contact.boundary.at(times[1])
        c = b.clamped
        self.boundary, self.constrained, self.computed = b, contact.constrained, state
        self.gid = np.concatenate([b.gid, c.gid])
        self.xy, self.normal = np.concatenate([b.xy, c.xy]), np.concatenate([b.normal, c.normal])
        self.tangent = turned_left(self.normal)
        self.node = b.edges
        self.length = np.linalg.norm(self.xy[self.node[:, 0]] - self.xy[self.node[:, 1]], axis=1)
        none, zero = np.zeros(len(c.gid), bool), np.zeros(len(c.gid))
        self.own_normal, self.own_tangential = (np.concatenate([(rows >= 0) & ~b.paired, none])
                                                for rows in (b.normal_row, b.tangential_row))
        sigma_n, sigma_t, bound = (np.concatenate([state[name], zero])
                                   for name in ("sigma_n", "sigma_t", "bound"))
        self.pressure = -continued(self.node, sigma_n, self.own_normal)
        self.bound = continued(self.node, bound, self.own_normal)
        self.shear = np.zeros(len(self.gid))
        if contact.frictional:
            # what a support holds there is its own: of t* the part of the bound goes on, so that
            # no work is missed, on a way of any length, beside nodes that all slide
            part = sigma_t / np.where(bound > 0, bound, np.inf)
            part = continued(self.node, part, self.own_tangential)
            self.shear = np.where(self.own_tangential, sigma_t, part * self.bound)
            self.shear = np.clip(self.shear, -self.bound, self.bound)
        self.bilateral = contact.law.bilateral
        self.before = state["u_t"] - state["slip"]
        distance = np.maximum(c.gap - (move * c.normal).sum(axis=1), 0.0)
        slip = (step_move * self.tangent[len(b.gid) :]).sum(axis=1)
        if c.motion is not None:
            slip -= c.motion.way(*times)
        self.distance = np.concatenate([np.zeros(len(b.gid)), distance])
        self.slip = np.concatenate([np.zeros(len(b.gid)), slip])
        self.moments = self._moments()

    def _moments(self) -> np.ndarray:
        """(n, 2, 2) moments [edge, end, component] of t* against the hats.

        Without friction, where normals differ from node to node, the small tangential sums that the
        neighbours' normals leave at a node are taken off its edges: nothing could hold them.
        """
        i, j = self.node.T
        traction = -self.pressure[:, None] * self.normal + self.shear[:, None] * self.tangent
        third = self.length[:, None] / 6
        moments = np.stack([third * (2 * traction[i] + traction[j]),
                            third * (traction[i] + 2 * traction[j])], axis=1)
        loose = self.own_normal & ~self.own_tangential
        loose[: len(self.constrained)] &= ~self.constrained.any(axis=1)
        edges = np.bincount(self.node.ravel(), minlength=len(self.gid))
        rest = (self._nodal(moments) * self.tangent).sum(axis=1) * loose / np.maximum(edges, 1)
        return moments - (rest[:, None] * self.tangent)[self.node]

    def _nodal(self, moments: np.ndarray) -> np.ndarray:
        """Sums of the moments at the nodes, two components each."""
        total = np.zeros((len(self.gid), 2))
        np.add.at(total, self.node, moments)
        return total

    def multipliers(self, computed: np.ndarray, rows) -> np.ndarray:
        """The rank's multipliers with the nodal forces of t* in their contact rows."""
        b = self.boundary
        force = self._nodal(self.moments)[: len(b.gid)]
        normal, tangential = -(force * b.normal).sum(axis=1), -(force * b.tangent).sum(axis=1)
        alone = (b.tangential_row < 0) & self.constrained.any(axis=1)  # one component acts
        free = b.normal * ~self.constrained
        square = np.maximum((free**2).sum(axis=1), 1e-300)
        normal = np.where(alone, -(force * free).sum(axis=1) / square, normal)
        multipliers = computed.copy()
        for row, node, force in ((rows.normal, rows.normal_node, normal),
                                 (rows.tangential, rows.tangential_node, tangential)):
            multipliers[row] = np.where(b.paired[node], multipliers[row], force[node])
        return multipliers

    def place(self, u: np.ndarray) -> None:
        """Set distances and slip of the contact nodes by their displacements or jumps (n_c, 2)."""
        b, n = self.boundary, len(self.boundary.gid)
        self.distance[:n] = b.gap - (u * b.normal).sum(axis=1)
        self.slip[:n] = (u * b.tangent).sum(axis=1) - self.before

    def onto_obstacle(self, stiffness: np.ndarray) -> np.ndarray:
        """(n_c,) normal moves of the contact nodes, see _admissible; nodal stiffness."""
        n, force = len(self.boundary.gid), -self.computed["sigma_n"] * self.boundary.weight
        distance = self.distance[:n]
        onto = (distance < 0) | self.bilateral | (stiffness * distance <= force)
        move = np.where(onto & self.own_normal[:n], distance, 0.0)
        self.distance[:n] = np.where(self.bilateral, 0.0, np.maximum(distance - move, 0.0))
        return move

    def back_to_stick(self, stiffness: np.ndarray) -> np.ndarray:
        """(n_c,) tangential moves of the contact nodes, see _admissible; nodal stiffness."""
        n, c = len(self.boundary.gid), self.computed
        slip = self.slip[:n]
        missed = (c["bound"] + c["sigma_t"] * np.sign(slip)) * self.boundary.weight  # work per slip
        able = self.own_tangential[:n].copy()
        able[self.boundary.corners[:, :2]] = False  # where another condition stands in the way
        move = np.where((stiffness * np.abs(slip) <= missed) & able, -slip, 0.0)
        self.slip[:n] += move
        return move

    def duality_gap(self) -> float:
        """int -t*_n (gap - v_n) + s |slip| + t*_t slip over the contact boundary."""
        return (self._product(self.pressure, self.distance) + self._product(self.shear, self.slip)
                + slid(self.length, self.bound[self.node], self.slip[self.node]))

    def _product(self, f: np.ndarray, g: np.ndarray) -> float:
        """int f g over the contact boundary of fields linear between their nodal values."""
        ends = f[self.node] * g[self.node] + 0.5 * f[self.node] * g[self.node[:, ::-1]]
        return float((self.length / 3) @ ends.sum(axis=1))

    def nodal_gap(self) -> float:
        """Nodal sum of lambda_n (gap - v_n) + g |slip| - lambda_t slip, which the QP makes zero."""
        b, c = self.boundary, self.computed
        n = len(b.gid)
        slip = self.slip[:n]
        slid = np.where(b.tangential_row >= 0, c["bound"] * np.abs(slip) + c["sigma_t"] * slip, 0.0)
        return max(float(b.weight @ (-c["sigma_n"] * self.distance[:n] + slid)), 0.0)


def continued(edges: np.ndarray, value: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Nodal values; where none is `own`, the mean of the neighbours' along the edges (n, 2)."""
    total, count = np.zeros(len(value)), np.zeros(len(value))
    for here, there in (edges.T, edges.T[::-1]):
        np.add.at(total, here, np.where(own[there], value[there], 0.0))
        np.add.at(count, here, own[there])
    return np.where(own, value, total / np.maximum(count, 1))


def slid(length: np.ndarray, bound: np.ndarray, slip: np.ndarray,
         bend: np.ndarray | float = 0.0) -> float:
    """int s |slip| of s and slip (m, 2), linear between the ends of pieces of `length` (m,).

    Slip may change its sign inside a piece; each part by Simpson's rule, exact there. Where normals
    turn slip has a quadratic part, `bend` (m,) in the middle.
    """
    (s0, s1), (d0, d1) = bound.T, slip.T
    changes = d0 * d1 < 0
    zero = np.where(changes, d0 / np.where(changes, d0 - d1, 1.0), 1.0)

    def value(x):
        return (s0 + x * (s1 - s0)) * np.abs(d0 + x * (d1 - d0) + 4 * x * (1 - x) * bend)

    def simpson(a, c):
        return (c - a) / 6 * (value(a) + 4 * value((a + c) / 2) + value(c))

    return float(length @ (simpson(0.0, zero) + simpson(zero, 1.0)))
