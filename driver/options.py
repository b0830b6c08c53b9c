"""Numerical options of the solver: none of them is physics, each has a default that suits most runs."""

from dataclasses import dataclass


@dataclass
class Settings:
    """Numerical options of the solver; all tolerances are relative."""

    rtol: float = 1e-8  # MPRGP: projected gradient over ||d||
    friction_rtol: float = 1e-6  # fixed point: change of lambda_n over lambda_n
    primal_rtol: float = 1e-4  # gluing jump and penetration over the body's displacement; else rtol is tightened
    max_fixed_point: int = 100  # per time step
    max_products: int = 200_000  # per QP
    preconditioner: str = "deflated"  # Dirichlet with contact tractions deflated, "dirichlet" alone, or "none"
    predictor: str = "load"  # start a step from multipliers extrapolated with the load, or "previous"
    inner_rtol: float = 0.1  # residual reduction of a QP before its friction bound is renewed
    estimator: str = "equilibrated"  # error in the energy norm: a bound; "recovery": averaged stresses; "none"
    expansion: str = "contact"  # MPRGP's expansion step: contact problem solved, "cg" step projected, or "gradient" step
    corrector: str = "contact"  # before each QP contact and friction for given gluing (condensed: by Newton), or "none"
    linearization: str = "initial"  # of contact between bodies: about the initial geometry, or "updated" once
    uniqueness: str = "auto"  # look for other solutions of every step: "yes", "no", or where few nodes or doubt suggest it
