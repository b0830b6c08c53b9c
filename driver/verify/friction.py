"""Cases with friction: thresholds, wedges, partial slip."""

from collections.abc import Callable

import numpy as np

from . import halfspace
from .case import Case, Check, Curve, View
from .plane import HALF_PLANE, ROUNDING, half_block, hertz, places
from .peer import Peer
from .sizes import Sizes

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
                                 "friction 0, 0.1, 0.2, 0.3)", fast=friction in (0, 0.3))


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
F = 0.3


def stick_zone(view: View) -> tuple[float, float]:
    """Middle and half-width of the stick zone: what Cattaneo takes from F p is half an ellipse.

    Its square is a parabola, fitted to the nodes that stick; where that is zero sticking ends.
    """
    stick = view["status"] == "stick"
    x, spare = view["x"][stick], (coefficient(view) * -view["sigma_n"]
                              - np.abs(view["sigma_t"]))[stick]
    bent, slope, height = np.polyfit(x, spare**2, 2, w=view["weight"][stick])
    middle = -slope / (2 * bent)
    return float(middle), float(np.sqrt(middle**2 - height / bent))


def stick_width(view: View) -> float:
    """Half-width of the stick zone."""
    return stick_zone(view)[1]


LAST = 4  # nodes that show how the shear of a stick zone comes to its bound


def stick_end(view: View, power: float) -> float:
    """Where the stick zone about x = 0 ends: F p - |q| falls to zero like a power of the distance.

    1/2 where the load grows under an indenter of constant width, 3/2 where contact grows with it.
    """
    x, friction = view["x"], coefficient(view)
    stick = np.flatnonzero((view["status"] == "stick")
                           & (x <= x[view["status"] == "slip"].min()))[-LAST:]
    spare = np.maximum(0.0, (friction * -view["sigma_n"] - np.abs(view["sigma_t"]))[stick])
    slope, start = np.polyfit(x[stick], spare**(1 / power), 1)
    return float(-start / slope)


def cylinders(view: View) -> float:
    """1/(1/R1 + 1/R2) of two equal cylinders."""
    return float(view.settings.get("radius", 50.0)) / 2


def half_plane(view: View) -> float:
    """Radius of the one cylinder of `fretting`."""
    return 50.0 * float(view.settings.get("size", 1.0))


def coefficient(view: View) -> float:
    """The friction coefficient of a run."""
    return float(view.settings.get("friction", F))


def mindlin(view: View, radius: Callable[[View], float],
            modulus: float = EQUAL) -> tuple[float, float, float]:
    """Hertz's a and p0, and the half-width c of the stick zone under Q < F P."""
    a, peak = hertz(radius(view), modulus, view.P)
    return a, peak, a * float(np.sqrt(1 - view.Q / (coefficient(view) * view.P)))


def _shear(view: View, radius: Callable[[View], float], x: np.ndarray, middle: float = 0.0,
           modulus: float = EQUAL) -> np.ndarray:
    """Cattaneo's and Mindlin's shear (Johnson, 7.2), the stick zone about `middle`."""
    a, peak, c = mindlin(view, radius, modulus)
    return coefficient(view) * peak * (np.sqrt(np.maximum(0.0, 1 - (x / a)**2))
                       - c / a * np.sqrt(np.maximum(0.0, 1 - ((x - middle) / c)**2)))


def shear_error(radius: Callable[[View], float], middle=lambda view: 0.0, power: int = 1,
                modulus: float = EQUAL):
    """Distance of the shear from the closed form's in L1 or L2, over the closed form's size."""
    def error(view: View) -> float:
        exact, w = _shear(view, radius, view["x"], middle(view), modulus), view["weight"]
        distance = (w * np.abs(np.abs(view["sigma_t"]) - exact)**power).sum()
        return float((distance / (w * exact**power).sum())**(1 / power))
    return error


def _drawn(radius: Callable[[View], float], middle=lambda view: 0.0) -> Curve:
    def reference(view: View):
        a = mindlin(view, radius)[0]
        x = places(1.05 * a, -1.05 * a, 61)
        return x, _shear(view, radius, x, middle(view))

    return Curve("x [mm]", "shear [MPa]", lambda v: (v["x"], np.abs(v["sigma_t"])), reference)


def _moved(view: View) -> float:
    """Middle of the stick zone under bulk tension."""
    return float(view.settings["bulk"]) * half_plane(view) / (2 * F * EQUAL)


def _cylinders(radius: float) -> dict:
    """Settings with the same half-width a on another radius."""
    a = 0.4
    return {"radius": radius, "approach": a**2 / radius * np.log(2 * radius / a), "h": 0.03}


def _smaller(size: float) -> dict:
    """Settings of fretting on smaller bodies, nearly the same a, Q/P and bulk/p0."""
    far = np.log(2 * 50 * size / 0.6) / np.log(2 * 50 / 0.6)
    return {"size": size, "approach": 0.0176 / size * far, "shift": 0.0025 / size * far,
            "bulk": 0.7 / size, "h": 0.03}


ENDS = HALF_PLANE + "; where sticking ends, the slope of the shear is infinite"
PARTIAL = (
    Case("cattaneo-mindlin", "Two cylinders pressed, then sheared", "mindlin-bodies",
         "Cattaneo (1938), Mindlin (1949); Johnson, Contact Mechanics (1985), 7.2",
         ({"h": 0.06}, {"h": 0.03}, {"h": 0.015}), (
             Check("half-width of the stick zone", lambda v: mindlin(v, cylinders)[2],
                   stick_width, 1e-2, ENDS),
             Check("shear in L1", 0.0, shear_error(cylinders), 1e-2, HALF_PLANE),
             Check("shear in L2", 0.0, shear_error(cylinders, power=2), 1.5e-2, ENDS)),
         {"steps": 12}, _drawn(cylinders),
         sizes=Sizes(tuple(map(_cylinders, (50, 12.5, 6.25, 3.125))),
                     lambda v: mindlin(v, cylinders)[0] / (2 * cylinders(v)), "a/R")),
    Case("cattaneo-mindlin-adaptive", "The same cylinders on meshes that find where sticking ends",
         "verify/cylinders",
         "Cattaneo (1938), Mindlin (1949); Johnson, Contact Mechanics (1985), 7.2",
         tuple({"h": 0.05, "adapt": cycles} for cycles in (0, 1, 2, 3)), (
             Check("half-width of the stick zone", lambda v: mindlin(v, cylinders)[2],
                   stick_width, 5e-3, ENDS),
             Check("shear in L1", 0.0, shear_error(cylinders), 5e-3, HALF_PLANE),
             Check("shear in L2", 0.0, shear_error(cylinders, power=2), 1e-2, ENDS)),
         {"steps": 3}, _drawn(cylinders),
         note="The indicator sees how far pressure and shear bend at each node; the scene's own "
              "mesh is even along the contact. Steps end at t = 1, 2 and 3."),
    Case("fretting", "Fretting under bulk tension", "verify/fretting",
         "Nowell, Hills (1987); Hills, Nowell, Mechanics of Fretting Fatigue (1994), 4",
         ({"h": 0.06}, {"h": 0.03}, {"h": 0.015}), (
             Check("middle of the stick zone", _moved, lambda v: stick_zone(v)[0], 3e-2,
                   HALF_PLANE + "; the half-width is eleven times as large"),
             Check("half-width of the stick zone", lambda v: mindlin(v, half_plane)[2],
                   stick_width, 1e-2, ENDS),
             Check("shear in L1", 0.0, shear_error(half_plane, _moved), 2e-2, HALF_PLANE)),
         {"steps": 10, "bulk": 0.7}, _drawn(half_plane, _moved),
         sizes=Sizes(tuple(map(_smaller, (1, 0.5, 0.25, 0.125))),
                     lambda v: mindlin(v, half_plane)[0] / half_plane(v), "a/R")),
)

def _to_and_fro(view: View) -> Peer:
    """The half-disc of `mindlin`, pressed on without friction, then moved by its top."""
    def top(x):
        return np.abs(x[:, 1] - 1) < 1e-9

    t = np.linspace(0, 5, view.result.summary["steps"] + 1)
    moved = np.interp(t, (0, 1, 3, 5), (0, 1, -1, 1)) * 1.2 * 0.02 * 0.0021
    return Peer(2000.0, 0.3, ((top, 0, moved), (top, 1, -0.0021)), 0.02, preload=True)


CYCLE = Case(
    "mindlin", "Half-disc on a rigid plane, pushed to and fro", "mindlin",
    "Mindlin, Deresiewicz (1953); Johnson, Contact Mechanics (1985), 7.4",
    ({"h": 0.004}, {"h": 0.002}, {"h": 0.001}), (
        Check("shear in L1", 0.0, shear_error(lambda _: 1.0, modulus=2 * EQUAL), 2e-2,
              "shear and pressure move each other's surface against a rigid plane: 2 beta F, 1 %"),
        Check("half-width of the stick zone", lambda v: mindlin(v, lambda _: 1.0, 2 * EQUAL)[2],
              stick_width, 1e-2, "as the shear")),
    {"friction": 0.02, "steps": 20}, peer=_to_and_fro,
    note="Where a whole cycle ends the shear is that of the first push; between, slip in both "
         "directions has passed over the surface.")

PUNCH = Case(
    "rough-punch", "Flat punch that sticks in its middle", "verify/indenter",
    "Spence, J. Elasticity 3 (1973) 273-287; strips on a half-plane "
    "([halfspace.py](../../driver/verify/halfspace.py))",
    ({"h": 0.08}, {"h": 0.04}, {"h": 0.02}), (
        Check("width that sticks over width", lambda _: halfspace.stick_ratio(F, 0.3, plane=True),
              lambda v: stick_end(v, 0.5), 1e-2, HALF_PLANE),),
    {"power": 0, "friction": F, "size": 400},
    others="Spence's closed form K(sqrt(1 - c^2/a^2))/K(c/a) = beta/F gives "
           f"{halfspace.spence(F, 0.3, plane=True):.4f}",
    note="The closed form leaves out that shear lifts the surface; strips of pressure and shear on "
         f"a half-plane give {halfspace.stick_ratio(F, 0.3, False, True):.4f} without and "
         f"{halfspace.stick_ratio(F, 0.3, True, True):.4f} with it. Contact does not grow, so that "
         "one step is enough.",
    sizes=Sizes(tuple({"size": size, "h": 0.04} for size in (400, 200, 100, 50)),
                lambda v: 1 / float(v.settings["size"]), "a/size"), peer=half_block)

CASES = (*EQUILIBRIUM, *PARTIAL, CYCLE, PUNCH)
