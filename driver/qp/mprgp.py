"""MPRGP: modified proportioning with reduced gradient projections for box constraints.

Solves

    min  f(x) = 1/2 x'Ax - b'x     subject to   lower <= x <= upper

for a symmetric positive (semi)definite operator A.  Sources: Z. Dostal, J. Schoeberl,
"Minimizing quadratic functions subject to bound constraints with the rate of convergence and
finite termination", Comput. Optim. Appl. 30 (2005) 23-43; Z. Dostal, "Optimal Quadratic
Programming Algorithms", Springer 2009, chapter 5 (algorithm "MPRGP"; preconditioning in the
face is treated there too).  Here both bounds may be present.

Notation, with g = Ax - b and componentwise definitions:

    free gradient      phi  = g where lower < x < upper, 0 elsewhere
    chopped gradient   beta = min(g, 0) at x == lower, max(g, 0) at x == upper, 0 elsewhere
    projected gradient g^P  = phi + beta       (zero exactly at the solutions)
    reduced free grad. phi~ = (x - P(x - abar phi)) / abar,   abar = alpha_factor / norm_bound

SPMD.  Every 1-D array is the local part of a distributed vector, and the only communication are
the callables ``dot``, ``dots`` and ``minimum``; every decision is taken on what they returned.  If
they give the same float to all ranks, all ranks take the same branches.  Local parts may be empty.

One module because the steps share one state, of which x and g always belong together, and each
decision is argued beside it. box.py has what needs none of it: gradients and steps at bounds.
"""

from dataclasses import dataclass, replace

import numpy as np

from .box import (ARC, bound_ratios, clipped, projected_gradient, reduced_free_gradient,
                  split_gradient)

EPS = np.finfo(float).eps

CURVATURE_ROUNDINGS = 64  # of ||A|| p'p, below which the curvature p'Ap cannot be told from zero
SMALLEST = np.finfo(float).tiny / EPS  # products below have lost digits
GRADIENT_ROUNDINGS = 10  # of ||A|| ||x|| + ||b||: how exact a gradient Ax - b is
TURNED = 0.5  # cosine against the gradient beyond which a preconditioner is wrong, not rounded
MAX_DOUBLINGS = 40  # a factor 2^40 between bound and norm is no bad estimate, but noise in A
MAX_REFUTATIONS = 3  # of convergence by a recomputed gradient that has not been halved


@dataclass(frozen=True)
class Result:
    """Feasible point x (n,) and gradient A x - b there, local parts, and how mprgp ended.

    status               "converged" | "iteration limit" | "stagnated" | "indefinite operator" |
                         "stopped" (by the monitor)
    reason               one line saying why it stopped
    products             calls of A, all of them counted
    norm_bound           the bound of ||A|| used last (raised if the given one was too small)
    residual             ||g^P(x)||
    """

    x: np.ndarray
    gradient: np.ndarray
    status: str
    reason: str
    products: int
    cg_steps: int
    expansion_steps: int
    proportioning_steps: int
    norm_bound: float
    residual: float


class _Stop(Exception):
    """Ends the iteration from inside a step; args are (status, reason)."""


def _cut_step(ratio, wish, minimum):
    """min(wish, smallest ratio over all ranks), and whether a bound is met on the way."""
    smallest = minimum(float(ratio.min(initial=np.inf)))
    return min(smallest, wish), smallest <= wish and smallest < np.inf


class _Mprgp:
    """State of one solve: x, g always belong together and x is always feasible."""

    def __init__(self, A, b, lower, upper, tol, bound, gamma, alpha_factor, preconditioner,
                 max_products, dot, dots, minimum, monitor, projected_cg, relax):
        self.A, self.b, self.lower, self.upper = A, b, lower, upper
        # most components have no bounds where few of many multipliers belong to contact
        bounded = (lower > -np.inf) | (upper < np.inf)
        self.bounded = slice(None) if bounded.all() else np.flatnonzero(bounded)
        self.box = lower[self.bounded], upper[self.bounded]
        self.tol, self.bound, self.gamma, self.alpha_factor = tol, bound, gamma, alpha_factor
        self.preconditioner, self.max_products = preconditioner, max_products
        self.dot, self.dots, self.minimum, self.monitor = dot, dots, minimum, monitor
        self.projected_cg, self.relax = projected_cg, relax
        self.products = 0
        self.counts = {"cg": 0, "expansion": 0, "proportioning": 0}
        ones = np.ones_like(b)
        b2, size = dots((b, b), (ones, ones))
        self.b_norm = np.sqrt(b2)
        # products without a better residual: CG may wander for about as many as there are unknowns
        self.window = 200 + 2 * min(int(size), 1000)
        self.x = self.g = self.p = self.Ap = None
        self.curvature = 0.0
        self.updates = 0  # gradient updates by recurrence since the last product at x
        self.residual = np.inf
        self.trust = 0.0  # rounding of the gradient that the updates started from
        self.best, self.best_at, self.decrease = np.inf, 0, 0.0
        self.refuted, self.refuted_at = 0, np.inf

    # -- products and moves -----------------------------------------------------------------

    def product(self, v):
        """A v, counted; refuses when the limit is reached (the state is consistent then)."""
        if self.products >= self.max_products:
            raise _Stop("iteration limit", f"products used: {self.products}, all of MAX_PRODUCTS")
        self.products += 1
        return self.A(v)

    def gradient_at(self, x):
        """A x - b (n,) at x (n,); one product."""
        return self.product(x) - self.b

    def place(self, x, g, updates):
        """The only place where the iterate changes: new x with its gradient."""
        self.x, self.g, self.updates = x, g, updates

    def go(self, p, Ap, step, ratio):
        """x - step p with the components that met a bound put exactly on it, and clipped."""
        b, (lower, upper) = self.bounded, self.box
        x, met = self.x - step * p, ratio <= step * (1 + 4 * EPS)
        x[b] = clipped(np.where(met, np.where(p[b] > 0, lower, upper), x[b]), lower, upper)
        self.place(x, self.g - step * Ap, self.updates + 1)

    def ratios(self, p):
        """For each component that has bounds the step at which x - a p meets one."""
        return bound_ratios(self.x[self.bounded], p[self.bounded], *self.box)

    def gradient_rounding(self, x):
        """Size of the rounding error in a computed A x - b."""
        return EPS * (self.bound * np.sqrt(self.dot(x, x)) + self.b_norm)

    # -- one evaluation and the three steps -------------------------------------------------

    def evaluate(self):
        """Split the gradient; sets the squares of the norms, phi~'phi and the residual."""
        b, self.phi, self.beta = self.bounded, self.g.copy(), np.zeros_like(self.g)
        x = self.x[b]
        self.phi[b], self.beta[b] = split_gradient(x, self.g[b], *self.box)
        reduced = self.phi.copy()
        reduced[b] = reduced_free_gradient(x, self.phi[b], *self.box,
                                           self.alpha_factor / self.bound)
        phi, beta = self.phi, self.beta
        self.phi2, self.beta2, self.reduced_slope = self.dots((phi, phi), (beta, beta),
                                                              (reduced, phi))
        self.residual = float(np.sqrt(self.phi2 + self.beta2))
        if not np.isfinite(self.residual):
            raise _Stop("indefinite operator", "A returned values that are not finite")

    def is_proportional(self):
        """Release criterion: ||beta||^2 <= gamma^2 phi~'phi keeps the face."""
        return self.beta2 <= self.gamma**2 * self.reduced_slope

    def step(self):
        """One step of the algorithm; returns its kind."""
        if not self.is_proportional():
            needed = 0.5 * self.beta2 / self.bound
            if self.relax is None or not self.relaxed_step(self.x, self.g, needed):
                self.proportioning_step()
            return "proportioning"
        p, slope = self.direction()
        Ap = self.product(p)
        wish = self.exact_step(p, Ap, slope)
        ratio = self.ratios(p)
        length, blocked = _cut_step(ratio, wish, self.minimum)
        self.refuse_endless(length, p, slope)
        if blocked and np.isfinite(wish):
            half_step = length * (slope - 0.5 * length * self.curvature)
            # a projected gradient step lowers f by abar (1 - alpha_factor / 2) phi~'phi at least
            projected = (1 - 0.5 * self.alpha_factor) * self.alpha_factor / self.bound
            needed = max(half_step, projected * self.reduced_slope)
            end = (self.x - wish * p, self.g - wish * Ap)
            if self.relax is not None and self.relaxed_step(*end, needed):
                return "expansion"
            if self.projected_cg and self.projected_step(p, length, wish, needed):
                return "expansion"
        self.go(p, Ap, length, ratio)
        self.decrease += length * (slope - 0.5 * length * self.curvature)
        if not blocked:
            self.p, self.Ap = p, Ap
            return "cg"
        self.p = self.Ap = None
        self.expand()
        return "expansion"

    def direction(self):
        """CG direction p (n,) in the face, A-orthogonal to the last one, and its slope g'p."""
        phi, z, slope = self.phi, self.phi, self.phi2
        b, free = self.bounded, np.ones(phi.shape, bool)
        free[b] = (self.x[b] != self.box[0]) & (self.x[b] != self.box[1])
        if self.preconditioner is not None:
            z = self.preconditioner(phi, free)
        if self.p is not None:
            p = z - (self.dot(z, self.Ap) / self.curvature) * self.p
            p[b] *= free[b]  # a CG step may have been rounded onto a bound
            ahead = self.dot(phi, p)
            if ahead > 0:
                return p, ahead
        if self.preconditioner is not None:
            slope = self.dot(phi, z)
        if not slope > 0:
            if not slope >= -TURNED * np.sqrt(self.dot(z, z) * self.phi2):
                raise ValueError("preconditioner is not positive definite on the free set")
            raise _Stop("stagnated", "the preconditioned gradient is rounding")
        return z, slope

    def exact_step(self, p, Ap, slope):
        """Minimiser of f(x - a p) over a: g'p / p'Ap, or inf where f has no curvature along p."""
        curvature, size = self.dots((p, Ap), (p, p))
        noise = size * self.bound * CURVATURE_ROUNDINGS * EPS
        if not np.isfinite(curvature):
            raise _Stop("indefinite operator", "A returned values that are not finite")
        if noise < SMALLEST:
            raise _Stop("stagnated", "what is left of the gradient underflows")
        if curvature < -noise:
            raise _Stop("indefinite operator", f"negative curvature p'Ap = {curvature:.3e}")
        self.curvature = curvature if curvature > noise else 0.0
        return slope / curvature if curvature > noise else np.inf

    def refuse_endless(self, length, p, slope):
        """Stops at a ray without curvature and without bound: unbounded, or only rounding."""
        if length < np.inf:
            return
        slack = GRADIENT_ROUNDINGS * (1 + self.updates) * self.gradient_rounding(self.x)
        if slope > slack * np.sqrt(self.dot(p, p)):
            raise _Stop("indefinite operator",
                        "unbounded: f descends along a ray of zero curvature inside the box")
        raise _Stop("stagnated", "the gradient left over on a ray of zero curvature is rounding")

    def proportioning_step(self):
        """Releases components: exact minimisation along -beta, cut at the opposite bounds."""
        d = self.beta
        Ad = self.product(d)
        wish = self.exact_step(d, Ad, self.beta2)
        ratio = self.ratios(d)
        length, _ = _cut_step(ratio, wish, self.minimum)
        self.refuse_endless(length, d, self.beta2)
        self.go(d, Ad, length, ratio)
        self.decrease += length * (self.beta2 - 0.5 * length * self.curvature)
        self.p = self.Ap = None

    def projected_step(self, p, length, wish, needed):
        """x <- P(x - a p), on the projected arc of the CG step; returns whether it was taken.

        Many components meet their bounds at once, where the half step stops at the first, after
        `length`. The longest step of `ARC` (a / wish) is taken that lowers f by `needed`: as far as
        on the half step and as far as the gradient projection provably takes it; so the convergence
        proof of MPRGP, which rests on that decrease, holds with it. (J. J. More, G. Toraldo, SIAM
        J. Optim. 1 (1991) 93-113, search such an arc.)
        """
        steps = [part * wish for part in ARC if part * wish > length]
        return any(self.try_step(clipped(self.x - a * p, self.lower, self.upper), needed)
                   for a in steps)

    def relaxed_step(self, y, g, needed):
        """x <- relax(y, g, residual), if f decreases as much as in other steps; whether it does.

        y is the end of the whole CG step, feasible or not (then its active set follows from the
        block problem instead of a projection), or x itself where components are to be released.
        """
        return self.try_step(self.relax(y, g, self.residual), needed)

    def try_step(self, new, needed):
        """x <- new (n,), feasible, if that lowers f by `needed` at least; one product."""
        d = new - self.x
        if not self.dot(d, d) > 0:
            return False
        g_new = self.gradient_at(new)
        change = 0.5 * self.dot(d, self.g + g_new)
        if not change <= -needed:
            return False
        self.decrease -= change
        self.place(new, g_new, 0)
        self.p = self.Ap = None
        return True

    def expand(self):
        """x <- P(x - abar phi(x)) from the point the half step has reached.

        With d the step taken, f changes by exactly 1/2 d'(g_old + g_new), and this is <= 0 if abar
        <= 2/||A||, because -g'd >= d'd/abar.  An increase therefore disproves the norm bound: it is
        doubled and the step is taken again.  The slack is ||d|| times the rounding error of the two
        gradients; the old one has gathered one error per recurrence.
        """
        x, g, given = self.x, self.g, self.bound
        phi, _ = split_gradient(x, g, self.lower, self.upper)
        for _ in range(MAX_DOUBLINGS):
            new = clipped(x - (self.alpha_factor / self.bound) * phi, self.lower, self.upper)
            d = new - x
            length = np.sqrt(self.dot(d, d))
            if length == 0:  # nothing free moves; the product would bring nothing new
                return
            g_new = self.gradient_at(new)
            change = 0.5 * self.dot(d, g + g_new)
            if not np.isfinite(change):
                raise _Stop("indefinite operator", "A returned values that are not finite")
            error = max(self.gradient_rounding(x), self.gradient_rounding(new))
            if change <= (GRADIENT_ROUNDINGS + self.updates) * error * length:
                self.decrease -= change
                self.place(new, g_new, 0)
                return
            self.bound *= 2
        self.bound = given  # not the bound was at fault
        raise _Stop("stagnated", "no gradient step of any length decreases f: noise in A")

    # -- control ------------------------------------------------------------------------------

    def refresh(self):
        """Recomputes a gradient that updates have brought below the rounding of the first one.

        Only where x has become so much smaller since then that this brings digits back. Without
        them the gradient says nothing of x any more, and CG would follow it into underflow.
        """
        if self.updates == 0:
            self.trust = self.gradient_rounding(self.x)
        elif self.tol < self.residual < GRADIENT_ROUNDINGS * self.updates * self.trust:
            rounding = self.gradient_rounding(self.x)
            if rounding < 0.01 * self.trust:
                self.place(self.x, self.gradient_at(self.x), 0)
                self.p = self.Ap = None
                self.trust = rounding
                self.evaluate()

    def is_converged(self):
        """||g^P|| <= tol, on a recomputed gradient where the recurrence may have drifted.

        A recurrence of m updates is off by about m eps (||A|| ||x|| + ||b||); a tenth of tol is
        trusted.  A refutation sets the fresh gradient and restarts CG; refutations that no longer
        halve the residual mean that tol is below what the arithmetic of A can give.
        """
        if self.residual > self.tol:
            return False
        if self.updates * self.gradient_rounding(self.x) * GRADIENT_ROUNDINGS <= 0.1 * self.tol:
            return True
        self.place(self.x, self.gradient_at(self.x), 0)
        self.p = self.Ap = None
        self.evaluate()
        if self.residual <= self.tol:
            return True
        self.refuted = 0 if self.residual < 0.5 * self.refuted_at else self.refuted + 1
        self.refuted_at = min(self.residual, self.refuted_at)
        if self.refuted >= MAX_REFUTATIONS:
            raise _Stop("stagnated", "the recomputed gradient does not get below the tolerance")
        return False

    def refuse_stagnation(self):
        """Stops after a long stretch in which neither the residual nor f made headway.

        One CG or gradient step lowers f by ||phi||^2 / (2 ||A||) or more, so a stretch of hundreds
        of steps that sums up to rounding of f only is spent on rounding errors.  A residual below
        the rounding of the product that its gradient was updated from hardly knows of x any more:
        what it gains there, per cent by per cent down to underflow, counts for nothing.
        """
        if self.trust < self.best and self.residual < 0.99 * self.best:
            self.best, self.best_at, self.decrease = self.residual, self.products, 0.0
        elif self.products - self.best_at >= self.window:
            size = np.sqrt(self.dot(self.x, self.x)) * self.gradient_rounding(self.x)
            if self.decrease <= GRADIENT_ROUNDINGS * size:
                raise _Stop("stagnated", f"no progress in {self.window} products")
            self.best_at, self.decrease = self.products, 0.0

    def iterate(self):
        """Runs to the end; returns (status, reason)."""
        kind = "start"
        try:
            if self.g is None:
                self.g = np.full_like(self.x, np.nan)  # until the first product is there
                self.place(self.x, self.gradient_at(self.x), 0)
            while True:
                self.evaluate()
                self.refresh()
                stop = self.monitor is not None and self.monitor(kind, self.products,
                                                                 self.residual)
                if self.is_converged():
                    return "converged", "projected gradient within tolerance"
                if stop:
                    return "stopped", "the monitor asked for it"
                self.refuse_stagnation()
                kind = self.step()
                self.counts[kind] += 1
        except _Stop as stop:
            return stop.args

    def result(self):
        """Runs to the end; the Result."""
        status, reason = self.iterate()
        g_projected = projected_gradient(self.x, self.g, self.lower, self.upper)
        residual = float(np.sqrt(self.dot(g_projected, g_projected)))
        return Result(self.x, self.g, status, reason, self.products, self.counts["cg"],
                      self.counts["expansion"], self.counts["proportioning"], float(self.bound),
                      residual)


def _anywhere(mask, dot):
    """Whether the mask is set on any rank."""
    flag = mask.astype(float)
    return dot(flag, flag) > 0


def _checked(b, lower, upper, x0, dot):
    """The data as float arrays (n,), x0 projected on the box; ValueError where impossible."""
    b = np.asarray(b, dtype=float)
    lower = np.broadcast_to(np.asarray(lower, dtype=float), b.shape)
    upper = np.broadcast_to(np.asarray(upper, dtype=float), b.shape)
    x0 = np.zeros_like(b) if x0 is None else np.asarray(x0, dtype=float)
    if b.ndim != 1 or x0.shape != b.shape:
        raise ValueError("b and x0 must be 1-D arrays of the same length")
    start = np.clip(x0, lower, upper)
    good = (np.isfinite(b) & (lower <= upper) & (lower < np.inf) & (upper > -np.inf)
            & np.isfinite(start))
    if not _anywhere(~good, dot):
        return b, lower, upper, start
    for bad, reason in ((~np.isfinite(b), "b has a value that is not finite"),
                        (np.isnan(lower) | np.isnan(upper), "a bound is NaN"),
                        ((lower > upper) | (lower == np.inf) | (upper == -np.inf),
                         "the box is empty"), (np.isnan(x0), "x0 has a NaN"),
                        (np.isinf(start), "x0 has an infinite value inside the box")):
        if _anywhere(bad, dot):
            raise ValueError(reason)
    raise ValueError("the box or x0 is not usable")


def mprgp(A, b, lower, upper, x0=None, *, tol, norm_bound, gamma=1.0, alpha_factor=1.95,
          preconditioner=None, max_products=10_000, gradient0=None, dot=np.dot, dots=None,
          minimum=float, monitor=None, expansion="gradient", scale=None, relax=None):
    """Minimise 1/2 x'Ax - b'x over lower <= x <= upper; returns a Result.

    A               callable (n,) -> (n,), symmetric positive (semi)definite; local parts
    b, lower, upper (n,); bounds may be +-inf, equal (the component is fixed), or scalars
    x0              (n,) start, projected on the box; default 0 projected
    tol             stops at ||g^P(x)|| <= tol.  Absolute: the caller scales it, e.g. 1e-6 ||b||.
                    For positive definite A this gives ||x - x*|| <= tol / lambda_min(A).
    norm_bound      upper bound of ||A||, see lanczos.norm_bound(); too small a value is found out
                    by an expansion step that increases f, and doubled
    gamma           Gamma > 0 of the release criterion ||beta||^2 <= Gamma^2 phi~'phi
    alpha_factor    expansion steps have the length abar = alpha_factor / norm_bound, in (0, 2]
    preconditioner  callable (phi, free mask) -> z, z = 0 off the mask, SPD on the face
    max_products    limit of calls of A
    gradient0       A x0 - b if known, for a feasible x0; saves the first product
    dot             global scalar product of two local parts
    dots            callable (*pairs) -> (k,): those of k pairs of local parts at once, as `dot`
                    gives them; by default one after the other
    minimum         callable: the smallest of the ranks' numbers
    monitor         callable (kind, products, residual) after every step, kind in {"start", "cg",
                    "expansion", "proportioning"}; what it returns, if true, ends the iteration
    expansion       "gradient": half a CG step, then the fixed gradient projection step; "cg": the
                    CG step, or a part of it, projected where that lowers f enough, else as
                    "gradient"
    scale           (n,) D > 0: the iteration runs in y = x / D, with D A D and D b, which makes up
                    for rows of very different size. `tol` then bounds ||D g^P||, also
                    Result.residual, and `norm_bound` ||D A D||. Powers of two round nothing.
    relax           callable (y, g, residual) -> x: from any y (n,) and g = A y - b a feasible x
                    that nearly minimises f over some components, the others being those of y, by
                    the `residual` of the feasible iterate. Tried in expansion and proportioning
                    steps, and taken where it lowers f enough

    Products: one for a CG or a proportioning step, two for an expansion step, and one more for each
    point of the arc and of `relax` that was tried in vain.  All iterates are feasible.  Data that
    make no problem raise ValueError (on all ranks); an operator that is indefinite, or returns NaN
    or inf, or leaves f unbounded ends with "indefinite operator".
    """
    if not (np.isfinite(norm_bound) and norm_bound > 0):
        raise ValueError("norm_bound must be positive and finite")
    if expansion not in ("gradient", "cg"):
        raise ValueError("expansion must be gradient or cg")
    if not (0 < alpha_factor <= 2 and gamma > 0 and tol >= 0 and max_products >= 1):
        raise ValueError("need 0 < alpha_factor <= 2, gamma > 0, tol >= 0, max_products >= 1")
    if scale is not None and (scale != 1).any():
        options = dict(tol=tol, norm_bound=norm_bound, gamma=gamma, alpha_factor=alpha_factor,
                       preconditioner=preconditioner, max_products=max_products, dot=dot,
                       dots=dots, gradient0=gradient0, minimum=minimum, monitor=monitor,
                       expansion=expansion, relax=relax)
        return _unscaled(A, b, lower, upper, x0, scale, options)
    b, lower, upper, x = _checked(b, lower, upper, x0, dot)
    dots = dots or (lambda *pairs: [dot(a, b) for a, b in pairs])
    run = _Mprgp(A, b, lower, upper, tol, float(norm_bound), gamma, alpha_factor, preconditioner,
                 max_products, dot, dots, minimum, monitor, expansion == "cg", relax)
    run.x = x
    if gradient0 is not None:
        moved = np.zeros_like(x) if x0 is None else x - x0
        if _anywhere(moved != 0, dot):
            raise ValueError("gradient0 was given for an x0 outside the box")
        run.g = np.array(gradient0, dtype=float)
    return run.result()


def _unscaled(A, b, lower, upper, x0, scale, options):
    """mprgp in the variables y = x / scale, its Result in x."""
    inner, gradient0, relax = map(options.get, ("preconditioner", "gradient0", "relax"))
    if inner is not None:
        options["preconditioner"] = lambda phi, free: inner(phi / scale, free) / scale
    if gradient0 is not None:
        options["gradient0"] = scale * gradient0
    if relax is not None:
        options["relax"] = lambda y, g, known: relax(scale * y, g / scale, known) / scale
    scaled = mprgp(lambda y: scale * A(scale * y), scale * b, lower / scale, upper / scale,
                  None if x0 is None else x0 / scale, **options)
    return replace(scaled, x=scale * scaled.x, gradient=scaled.gradient / scale)
