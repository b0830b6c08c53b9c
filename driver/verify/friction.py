"""Cases with friction: thresholds, wedges, partial slip."""

import numpy as np

from .case import Case, Check, Curve, View
from .plane import ROUNDING, hertz, places

SLOPE = 0.1  # tangent of the wedge's angle

# ---- equilibrium alone ---------------------------------------------------------------------------


def _driving(view: View) -> float:
    """Driving force over load: the reaction of contact on the block, turned into x and y."""
    force = view.result.boundaries
    return float(abs(force["force_x"][-1] / force["force_y"][-1]))


def _wedge(friction: float) -> Case:
    wanted = (SLOPE + friction) / (1 - friction * SLOPE)
    settings = {"angle": np.degrees(np.arctan(SLOPE)), "steps": 10, "friction": friction}
    return Case(f"wedge-{friction:g}", f"Wedge under a block, friction {friction:g}", "wedge",
                "NAFEMS CGS-4", ({"h": 8}, {"h": 4}), (
                    Check("force over load", wanted, _driving, 1e-5,
                          "equilibrium alone, once all of the slope slides"),),
                settings, others=f"published: {wanted:.6g} (0.1, 0.20202, 0.30612, 0.412371 with "
                                 "friction 0, 0.1, 0.2, 0.3)", fast=friction == 0.3)


def _drag(view: View, time: float) -> float:
    """Tangential resultant at a time."""
    table = view.result.boundaries
    return float(table["tangential_resultant"][np.abs(table["time"] - time).argmin()])


def _tilted(view: View) -> float:
    tilt = np.radians(10.0)
    normal, shear = np.cos(tilt)**2, np.cos(tilt) * np.sin(tilt)
    return float(max(np.abs(-view["sigma_n"] / normal - 1).max(),
                     np.abs(np.abs(view["sigma_t"]) / shear - 1).max()))


EQUILIBRIUM = (
    *map(_wedge, (0.0, 0.1, 0.2, 0.3)),
    Case("threshold", "Block pushed with 99 and 101 % of what friction carries",
         "verify/threshold", "Code_Aster V6.04.503, SSNV503", ({"cells": 5}, {"cells": 10}), (
             Check("friction at 99 %", 0.99 * 3600, lambda v: v.Q, 1e-6,
                   "equilibrium alone"),),
         {"share": 0.99}, refused=({"share": 1.01},), fast=True),
    Case("slope", "Block on an incline", "slope", "friction angle", ({"cells": 4}, {"cells": 8}), (
        Check("tangential over normal resultant", np.tan(np.radians(20)),
              lambda v: v.quantities["tangential_resultant"] / v.quantities["normal_resultant"],
              1e-6, "equilibrium alone"),),
         {}, refused=({"friction": 0.36},), fast=True),
    Case("cohesion", "Pad that slides with friction and cohesion", "cohesion",
         "Mohr and Coulomb: c L + F N", ({"cells": 4}, {"cells": 8}), (
             Check("tangential_resultant", 2e6 * 2 + 0.3 * 10e6 * 2,
                   lambda v: abs(v.quantities["tangential_resultant"]), 1e-6,
                   "equilibrium alone, once all of the base slides", "tangential_resultant"),),
         {"steps": 5}, fast=True),
    Case("moving-disc", "Brake pad on a disc that slides to and fro", "brake-pad",
         "Coulomb: F p L, against the disc's motion", ({"h": 4}, {"h": 2}), (
             Check("drag to the right", 0.4 * 2 * 60, lambda v: _drag(v, 2.0), 1e-6,
                   "equilibrium alone, once all of the lining slides"),
             Check("drag to the left", -0.4 * 2 * 60, lambda v: _drag(v, 3.0), 1e-6,
                   "equilibrium alone, once all of the lining slides")),
         {"steps": 12}, fast=True),
    Case("patch-friction", "Two blocks across a tilted interface that sticks", "patch-bodies",
         "Taylor, Papadopoulos (1991)", ({"h": 0.2}, {"h": 0.1}), (
             Check("largest difference of a traction from the exact one", 0.0,
                   _tilted, 1e-6, ROUNDING),),
         {"steps": 1}, fast=True),
)


# ---- partial slip --------------------------------------------------------------------------------

EQUAL = 2000 / (1 - 0.3**2) / 2  # E* of two equal bodies
F, RADIUS = 0.3, 25.0


def stick_ends(view: View) -> tuple[float, float]:
    """Where the stick zone ends: between the last node that sticks and the next one."""
    stick = np.flatnonzero(view["status"] == "stick")
    x = view["x"]
    return (float((x[stick[0]] + x[stick[0] - 1]) / 2),
            float((x[stick[-1]] + x[stick[-1] + 1]) / 2))


def mindlin(view: View, radius: float) -> tuple[float, float, float]:
    """Hertz's a and p0, and the half-width c of the stick zone under Q < F P."""
    a, peak = hertz(radius, EQUAL, view.P)
    return a, peak, a * float(np.sqrt(1 - view.Q / (F * view.P)))


def _shear(view: View, radius: float, x: np.ndarray, middle: float = 0.0) -> np.ndarray:
    """Cattaneo's and Mindlin's shear (Johnson, 7.2), the stick zone about `middle`."""
    a, peak, c = mindlin(view, radius)
    return F * peak * (np.sqrt(np.maximum(0.0, 1 - (x / a)**2))
                       - c / a * np.sqrt(np.maximum(0.0, 1 - ((x - middle) / c)**2)))


def shear_error(radius: float, middle=lambda view: 0.0, power: int = 1):
    """Distance of the shear from the closed form's in L1 or L2, over the closed form's size."""
    def error(view: View) -> float:
        exact, w = _shear(view, radius, view["x"], middle(view)), view["weight"]
        distance = (w * np.abs(np.abs(view["sigma_t"]) - exact)**power).sum()
        return float((distance / (w * exact**power).sum())**(1 / power))
    return error


def _middle(view: View) -> float:
    """Mean place of what Cattaneo's correction takes from F p, symmetric about its middle."""
    taken = (F * -view["sigma_n"] - np.abs(view["sigma_t"])) * view["weight"]
    return float((view["x"] * taken).sum() / taken.sum())


def _drawn(radius: float, middle=lambda view: 0.0) -> Curve:
    def reference(view: View):
        a = mindlin(view, radius)[0]
        x = places(1.05 * a, -1.05 * a, 61)
        return x, _shear(view, radius, x, middle(view))

    return Curve("x [mm]", "shear [MPa]", lambda v: (v["x"], np.abs(v["sigma_t"])), reference)


def _moved(view: View) -> float:
    """Middle of the stick zone under bulk tension."""
    return float(view.settings["bulk"]) * 25.0 / (F * EQUAL)


HALF_PLANES = "half-planes: of order a/R, a hundredth"
ENDS = HALF_PLANES + "; the end of sticking is known to half an element"
PARTIAL = (
    Case("cattaneo-mindlin", "Two cylinders pressed, then sheared", "mindlin-bodies",
         "Cattaneo (1938), Mindlin (1949); Johnson, Contact Mechanics (1985), 7.2",
         ({"h": 0.06}, {"h": 0.03}, {"h": 0.015}), (
             Check("half-width of the stick zone", lambda v: mindlin(v, RADIUS)[2],
                   lambda v: (stick_ends(v)[1] - stick_ends(v)[0]) / 2, 2e-2, ENDS),
             Check("shear in L1", 0.0, shear_error(RADIUS), 2e-2, HALF_PLANES),
             Check("shear in L2", 0.0, shear_error(RADIUS, power=2), 1.5e-2,
                   HALF_PLANES + "; where sticking ends the slope is infinite")),
         {"steps": 12}, _drawn(RADIUS)),
    Case("fretting", "Fretting under bulk tension", "verify/fretting",
         "Nowell, Hills (1987); Hills, Nowell, Mechanics of Fretting Fatigue (1994), 4",
         ({"h": 0.06}, {"h": 0.03}, {"h": 0.015}), (
             Check("middle of the stick zone", _moved, _middle, 5e-2,
                   HALF_PLANES + ", of the half-width, which is eleven times as large"),
             Check("half-width of the stick zone", lambda v: mindlin(v, 50.0)[2],
                   lambda v: (stick_ends(v)[1] - stick_ends(v)[0]) / 2, 2e-2, ENDS),
             Check("shear in L1", 0.0, shear_error(50.0, _moved), 3e-2, HALF_PLANES)),
         {"steps": 10, "bulk": 0.7}, _drawn(50.0, _moved)),
)

CASES = (*EQUILIBRIUM, *PARTIAL)
