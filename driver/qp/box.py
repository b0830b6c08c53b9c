"""Gradients and steps at the bounds of a box, lower <= x <= upper, component by component.

Notation as in mprgp.py. All arrays are local parts of distributed vectors, (n,), and may be empty.
"""

import numpy as np

ARC = (1.0, 1 / 4, 1 / 16)  # parts of a step that are tried on its projected arc


def split_gradient(x, g, lower, upper):
    """Free gradient phi and chopped gradient beta, each (n,), at the feasible x (n,).

    The bounds are met by exact comparison: iterates have been projected, so an active component
    equals its bound.  Components of zero-width boxes are in neither part.
    """
    at_lower, at_upper = x == lower, x == upper
    phi = np.where(at_lower | at_upper, 0.0, g)
    beta = np.where(at_lower & ~at_upper, np.minimum(g, 0.0), 0.0)
    beta = np.where(at_upper & ~at_lower, np.maximum(g, 0.0), beta)
    return phi, beta


def projected_gradient(x, g, lower, upper):
    """g^P = phi + beta, shape (n,), at the feasible x with gradient g; see split_gradient."""
    projected = np.array(g, float)
    met = np.flatnonzero((x == lower) | (x == upper))  # few of many components
    lower, upper = (bound[met] if np.ndim(bound) else bound for bound in (lower, upper))
    projected[met] = split_gradient(x[met], projected[met], lower, upper)[1]
    return projected


def reduced_free_gradient(x, phi, lower, upper, step):
    """phi~ (n,): what the projection leaves of phi in a gradient step of length `step`."""
    with np.errstate(over="ignore"):
        to_lower, to_upper = (x - lower) / step, (x - upper) / step
    return np.where(phi > 0, np.minimum(phi, to_lower), np.maximum(phi, to_upper))


def bound_ratios(x, p, lower, upper):
    """(n,) the step a >= 0 at which a component of x - a p meets a bound; inf if it never does."""
    ratio = np.full(x.shape, np.inf)
    with np.errstate(over="ignore"):
        np.divide(x - lower, p, out=ratio, where=p > 0)
        np.divide(x - upper, p, out=ratio, where=p < 0)
    return ratio


def clipped(x, lower, upper):
    """x (n,) put into the box: np.clip takes several times as long for small arrays."""
    return np.minimum(np.maximum(x, lower), upper)
