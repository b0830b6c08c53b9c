"""Bodies of revolution: Hertz's and Spence's contact of spheres, the round punch of NAFEMS."""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipk

from .case import Case, Check, Curve, View
from .plane import column, places, pressures, profile_error

MODULUS = 2000 / (1 - 0.3**2)  # of edp/sphere.edp, whose radius is 1
HALF_SPACE = "the formula is that of half-spaces; on this body it errs by (contact/size)^2"


def hertz(view: View) -> tuple[float, float]:
    """Radius and peak pressure of Hertz's point contact (Johnson, 4.2(a)) for the resultant."""
    a = (0.75 * view.P / MODULUS) ** (1 / 3)
    return float(a), float(1.5 * view.P / (np.pi * a**2))


def _pressure(view: View, r: np.ndarray) -> np.ndarray:
    a, peak = hertz(view)
    return peak * np.sqrt(np.maximum(0.0, 1 - (r / a) ** 2))


SPHERE = Case(
    "sphere", "Sphere on a smooth plane", "sphere", "Johnson, Contact Mechanics (1985), 4.2(a)",
    ({"h": 0.004}, {"h": 0.002}, {"h": 0.001}), (
        Check("peak_pressure", lambda view: hertz(view)[1], column("peak_pressure"), 1e-2,
              HALF_SPACE + ", 0.1 %; a node's pressure is a mean over its surroundings",
              "peak_pressure"),
        Check("contact_length", lambda view: hertz(view)[0], column("contact_length"), 1.5e-2,
              HALF_SPACE + "; the edge of contact is known to a part of an element",
              "contact_length"),
        Check("pressure in L1", 0.0, profile_error(_pressure), 2e-2, HALF_SPACE)),
    {"friction": 0, "steps": 1},
    Curve("radius [mm]", "pressure [MPa]", pressures,
          lambda view: (places(hertz(view)[0]), _pressure(view, places(hertz(view)[0])))))


def spence(friction: float, poisson: float) -> float:
    """Radius of the disc that sticks over that of contact, c/a, for the growing load of a sphere.

    (a/2c) ln((a + c)/(a - c)) = F/beta K(sqrt(1 - c^2/a^2)), K the complete elliptic integral and
    beta = (1 - 2 nu)/(2 (1 - nu)) of an elastic body on a rigid one (Spence 1975; Johnson, 5.4).
    """
    beta = (1 - 2 * poisson) / (2 * (1 - poisson))
    return float(brentq(lambda c: np.log((1 + c) / (1 - c)) / (2 * c) * beta
                        - friction * ellipk(1 - c**2), 1e-9, 1 - 1e-12))


def stick_ratio(view: View) -> float:
    """The same of a run: between the last node that sticks and the first that slips.

    Over its own radius of contact: under the same load friction makes that smaller than Hertz's.
    """
    r, status = view["x"], view["status"]
    end = (r[status == "stick"].max() + r[status == "slip"].min()) / 2
    return float(end / view.quantities["contact_length"])


def _rough(friction: float, **more) -> Case:
    return Case(
        f"spence-{friction:g}", f"Sphere on a rough plane, friction {friction:g}", "sphere",
        "Spence, J. Elasticity 5 (1975) 297-319; Johnson, Contact Mechanics (1985), 5.4",
        ({"h": 0.002, "steps": 20}, {"h": 0.001, "steps": 40}), (
            Check("radius that sticks over radius of contact", spence(friction, 0.3), stick_ratio,
                  6e-2, "known to half a node's distance, and what touches first in a step slides "
                  "there at its end only"),),
        {"friction": friction}, **more)


# ---- two hemispheres, and the punch --------------------------------------------------------------

HEMISPHERES = Case(
    "hemispheres", "Two hemispheres pressed by their flat faces", "verify/hemispheres",
    "Code_Aster V6.04.104 (SSNV104)", ({"h": 2}, {"h": 1}, {"h": 0.5}), (
        Check("peak_pressure", 2798.33, column("peak_pressure"), 8e-2,
              "half-spaces far from where they are driven, but a/R is 0.2", "peak_pressure"),
        Check("contact_length", 10.0, column("contact_length"), 4e-2,
              "half-spaces far from where they are driven, but a/R is 0.2", "contact_length")),
    fast=True)


CURVES = ("read from curves of linear elements, whose displacement of the centre is 1.7 % below "
          "that of quadratic ones")


def _punch(friction: float, center: float, linear: float, out: float, **more) -> Case:
    def surface(name: str, component: str):
        return lambda view: view.probe(name, component)

    checks = [Check("axial displacement of the block's centre", center, surface("point1", "u_y"),
                    1.5e-2, "linear and quadratic elements of other codes differ by 1.7 %; the "
                    "edge's pressure depends on the mesh")]
    if not friction:
        checks += [Check(f"axial displacement at r = {r}", value, surface(f"point{k}", "u_y"), 3e-2,
                         CURVES) for k, r, value in (
                             (2, 20.8, -0.1290), (3, 50.2, -0.0814), (4, 59.3, -0.0668))]
    checks.append(Check("largest radial displacement", out, surface("point5", "u_x"), 8e-2,
                        CURVES + "; in it differences of elements show more"))
    return Case(f"round-punch-{friction:g}", f"Punch with a rounded edge, friction {friction:g}",
                "verify/round-punch", "NAFEMS, Konter (2006), benchmark 2; Code_Aster SSNA122",
                ({"h": 4}, {"h": 2}, {"h": 1}), tuple(checks), {"friction": friction},
                others=f"{center} with quadratic elements, {linear} with linear ones", **more)


CASES = (SPHERE, _rough(0.1), _rough(0.2), HEMISPHERES,
         _punch(0.0, -0.1329, -0.1307, -0.01558), _punch(0.1, -0.1308, -0.1286, -0.01293))
