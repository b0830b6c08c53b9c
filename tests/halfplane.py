"""Dense boundary-element reference: a rigid plane under an elastic parabola, Coulomb friction, with
coupling.

Surface displacements of the half-plane z > 0 under pressure p and shear q on its surface (Johnson,
Contact Mechanics, 1985, eq. 2.25):

    u_x = -k int sgn(x-s) p ds - m int ln|x-s| q ds + C_x,     k = (1-2 nu)(1+nu)/(2E)
    u_z = -m int ln|x-s| p ds + k int sgn(x-s) q ds + C_z,     m = 2 (1-nu^2)/(pi E)

Constant tractions on equal segments, collocated at their midpoints; C_x and C_z follow from the
resultants.
"""

import numpy as np

OPEN, STICK, RIGHT, LEFT = range(4)  # RIGHT: the shear on the body is +F p


class HalfPlane:
    """March through given resultants P, Q; `p`, `q`, `dissipated` are the state.

    Lengths and E as they come.
    """

    def __init__(self, E, nu, R, F, reach, segments=160):
        """`reach`: half-width of the part of the surface that may touch."""
        width = 2 * reach / segments
        self.x = -reach + width * (np.arange(segments) + 0.5)
        self.width, self.F, self.gap = width, F, self.x**2 / (2 * R)
        d = self.x[:, None] - self.x[None, :]

        # antiderivative of ln|t|
        def log(t):
            return t * np.log(np.abs(t)) - t

        self.own = -2 * (1 - nu**2) / (np.pi * E) * (log(d + width / 2) - log(d - width / 2))
        self.cross = -(1 - 2 * nu) * (1 + nu) / (2 * E) * width * np.sign(d)
        self.p = self.q = self.u_x = np.zeros(segments)
        self.state = np.where(np.abs(self.x) < reach / 2, STICK, OPEN)
        self.dissipated = 0.0

    def preload(self, P, a, p0):
        """Start from Hertz's pressure, put on without friction."""
        self.p = p0 * np.sqrt(np.maximum(0.0, 1 - (self.x / a) ** 2))
        self.p *= P / (self.width * self.p.sum())
        self.u_x = self.cross @ self.p
        return self

    def step(self, P, Q):
        """Advance to the resultants P, Q by an active-set iteration; AssertionError if its KKT
        conditions fail.
        """
        seen = set()
        for _ in range(200):
            p, q, u_x, g, slip = self._solve(P, Q)
            state = self._next_state(p, q, g, slip)
            if np.array_equal(state, self.state):
                break
            assert state.tobytes() not in seen or len(seen) < 150, "active set cycles"
            seen.add(state.tobytes())
            self.state = state
        self._check(p, q, g, slip)
        self.dissipated -= self.width * q @ slip
        self.p, self.q, self.u_x = p, q, u_x
        return self

    def _solve(self, P, Q):
        """Tractions and displacements of the present active set: unknowns p, q, C_x, C_z."""
        n, s = len(self.x), self.state
        one, none = np.ones((n, 1)), np.zeros((n, 1))
        u_x = np.hstack([self.cross, self.own, one, none])
        u_z = np.hstack([self.own, -self.cross, none, one])
        eye = np.eye(2 * n + 2)
        A, b = np.empty((2 * n + 2, 2 * n + 2)), np.zeros(2 * n + 2)
        scale = np.abs(self.own).max()
        closed, stick = s != OPEN, s == STICK
        A[:n] = np.where(closed[:, None], u_z, eye[:n] * scale)
        b[:n][closed] = -self.gap[closed]
        bound = np.where(s == RIGHT, self.F, np.where(s == LEFT, -self.F, 0.0))
        A[n : 2 * n] = np.where(stick[:, None], u_x,
                                scale * (eye[n : 2 * n] - bound[:, None] * eye[:n]))
        b[n : 2 * n][stick] = self.u_x[stick]
        A[2 * n :] = 0
        A[2 * n, :n] = A[2 * n + 1, n : 2 * n] = self.width
        b[2 * n :] = P, Q
        if not stick.any():  # full sliding: Q is what friction gives, C_x is free
            A[2 * n + 1] = eye[2 * n]
            b[2 * n + 1] = 0
        value = np.linalg.solve(A, b)
        p, q, moved = value[:n], value[n : 2 * n], u_x @ value
        return p, q, moved, self.gap + u_z @ value, moved - self.u_x

    def _next_state(self, p, q, g, slip):
        s = self.state
        small_p, small_u = 1e-10 * np.abs(p).max(), 1e-10 * self.gap.max()
        closed = np.where(s == OPEN, g < -small_u, p > -small_p)
        over = np.abs(q) > self.F * p + small_p
        back = np.where(s == RIGHT, slip > small_u, np.where(s == LEFT, slip < -small_u, False))
        slides = np.where(s == STICK, np.where(over, np.where(q > 0, RIGHT, LEFT), STICK),
                          np.where(back, STICK, s))
        return np.where(~closed, OPEN, np.where(s == OPEN, STICK, slides))

    def _check(self, p, q, g, slip):
        tiny_p, tiny_u = 1e-8 * p.max(), 1e-8 * self.gap.max()
        assert p.min() > -tiny_p and g.min() > -tiny_u, (p.min()/tiny_p, g.min()/tiny_u)
        assert np.all(np.abs(q) <= self.F * p + tiny_p)
        assert np.abs(p * g).max() <= tiny_p * self.gap.max() + p.max() * tiny_u
        # zero where it sticks or slides against the shear
        lost = self.F * p * np.abs(slip) + q * slip
        assert np.all(np.where(self.state == OPEN, 0, lost) <= p.max() * tiny_u)
