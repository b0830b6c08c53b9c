"""Where rough punches and spheres stick: rings or strips of traction on an elastic half-space.

A growing load on a sphere adds, step by step, what a flat round punch of the present radius of
contact adds (Spence, Proc. R. Soc. Lond. A 305 (1968) 55-80; J. Elasticity 5 (1975) 297-319): the
disc that sticks has the same share c/a of the radius for both. For the punch, a = 1, rings of
constant pressure and shear are found with

    u_z = 1 on r < 1,   u_r = 0 on r < c,   q = F p on c < r < 1,   q < F p on r < c.

Spence's closed form follows if the sinking of the surface under shear is left out (Johnson, Contact
Mechanics, 5.4): `coupled=False` gives it, which is a check of the rings. With it c/a is less.
Displacements are those of Hankel's transforms (Johnson, 3.8; Gladwell, Contact Problems, 1980); a
flat punch in plane strain has strips instead, two at +-s (Johnson, 2.25), and sinks by any amount.
"""

import functools

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

POINTS = 12  # of Gauss on a ring


def spence(friction: float, poisson: float, plane: bool = False) -> float:
    """Spence's closed form of c/a, with shear that does not move the surface along the normal.

    In the plane K(sqrt(1 - c^2/a^2))/K(c/a) = beta/F, of revolution (a/2c) ln((a + c)/(a - c)) =
    F/beta K(sqrt(1 - c^2/a^2)); K the complete elliptic integral, beta = (1 - 2 nu)/(2 (1 - nu)) of
    an elastic body on a rigid one.
    """
    beta = (1 - 2 * poisson) / (2 * (1 - poisson))
    if plane:
        return float(brentq(lambda c: ellipk(1 - c**2) * friction - beta * ellipk(c**2), 1e-9,
                            1 - 1e-12))
    return float(brentq(lambda c: np.log((1 + c) / (1 - c)) / (2 * c) * beta
                        - friction * ellipk(1 - c**2), 1e-9, 1 - 1e-12))


@functools.cache
def stick_ratio(friction: float, poisson: float, coupled: bool = True,
                plane: bool = False) -> float:
    """c/a of the rings, extrapolated from 100 and 200 of them, whose error is of first order."""
    coarse, fine = (_on_rings(n, friction, poisson, coupled, plane) for n in (100, 200))
    return 2 * fine - coarse


def _on_rings(n: int, friction: float, poisson: float, coupled: bool, plane: bool) -> float:
    ends, pressed, sunk, drawn, sheared = (_strips if plane else _rings)(n, poisson)
    sunk = sunk if coupled else 0 * sunk

    def over(m: int) -> float:
        """Shear over pressure, less F, of the outermost of `m` rings that stick."""
        A, b = np.zeros((2 * n, 2 * n)), np.repeat([1.0, 0.0], n)
        A[:n, :n], A[:n, n:] = pressed, sunk
        A[n:n + m, :n], A[n:n + m, n:] = drawn[:m], sheared[:m]
        slips = np.arange(m, n)
        A[n + slips, n + slips], A[n + slips, slips] = 1.0, -friction
        p, q = np.split(np.linalg.solve(A, b), 2)
        return float(q[m - 1] / p[m - 1] - friction)

    low, high = 1, n - 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if over(middle) <= 0 else (low, middle)
    below, above = over(low), over(high)
    return float(ends[low] + below / (below - above) * (ends[high] - ends[low]))


@functools.cache
def _strips(n: int, nu: float) -> tuple:
    """The same as `_rings` of strips at +-s; a rigid motion along z is in u_z as it comes."""
    ends = np.sin(np.pi / 2 * np.linspace(0, 1, n + 1))
    x = ((ends[1:] + ends[:-1]) / 2)[:, None]

    def log(t):  # antiderivative of ln|t|
        return t * np.log(np.abs(t) + 1e-300) - t

    along, across = 2 * (1 - nu**2) / np.pi, (1 - 2 * nu) * (1 + nu)
    far, near = np.diff(log(ends + x), axis=1), np.diff(log(ends - x), axis=1)
    drawn = -across / 2 * (np.diff(np.abs(ends + x), axis=1) - np.diff(np.abs(ends - x), axis=1))
    outside = np.clip(ends[1:] - np.maximum(ends[:-1], x), 0, None)
    rigid = 10 * along * np.diff(ends)  # any sinking in proportion to the load
    return ends, rigid - along * (far + near), -across * outside, drawn, along * (far - near)


@functools.cache
def _rings(n: int, nu: float) -> tuple:
    """Ends of rings (n + 1,), and displacements at their middles times E, (n, n) each.

    u_z under pressure, u_z under shear, u_r under pressure, u_r under shear; u_z and p point into
    the half-space, u_r and q outwards.
    """
    ends = np.sin(np.pi / 2 * np.linspace(0, 1, n + 1))  # finer where the pressure is infinite
    r = ((ends[1:] + ends[:-1]) / 2)[:, None]
    along, across = 2 * (1 - nu**2), (1 - 2 * nu) * (1 + nu)
    pressed = along * np.diff(_sinking(r, ends), axis=1)
    drawn = -across * np.diff(np.where(r < ends, r / 2, ends**2 / (2 * r)), axis=1)
    sunk = -across * np.clip(ends[1:] - np.maximum(ends[:-1], r), 0, None)
    return ends, pressed, sunk, drawn, along * _shear(ends)


def _sinking(r, b):
    """int b J1(kb) J0(kr)/k dk, k from 0: what a disc of radius b under pressure sinks."""
    near, far = np.minimum(r, b), np.maximum(r, b)
    m = (near / far)**2
    outside = far * (ellipe(m) - (1 - m) * ellipk(np.minimum(m, 1 - 1e-15)))
    return 2 / np.pi * np.where(r < b, far * ellipe(m), outside)


def _shear(ends: np.ndarray) -> np.ndarray:
    """int s G(s, r) ds over rings, G = int J1(ks) J1(kr) dk, at the middles r of all rings.

    G is infinite like a logarithm at s = r: points gather at the end of a ring that is next to r.
    """
    r = (ends[1:] + ends[:-1]) / 2
    n = len(r)
    own = np.arange(n)
    left, right = np.tile(ends[:-1], (n, 1)), np.tile(ends[1:], (n, 1))
    inner = left < r[:, None]  # rings nearer to the middle, and the own one's inner half
    right[own, own] = r
    total = _toward(np.where(inner, left, right), np.where(inner, right, left), r[:, None])
    outer = _toward(ends[1:], r, r)
    total[own, own] += outer
    return total


def _toward(start, end, r):
    """Integrals of s G(s, r) from `start` to `end`, next to which r lies."""
    places, weights = np.polynomial.legendre.leggauss(POINTS)
    t = (places + 1) / 2
    s = end[..., None] + (start - end)[..., None] * t**4
    near, far = np.minimum(s, r[..., None]), np.maximum(s, r[..., None])
    m = (near / far)**2
    G = 2 / (np.pi * near) * (ellipk(m) - ellipe(m))
    return np.abs(start - end) * ((s * G) @ (2 * t**3 * weights))
