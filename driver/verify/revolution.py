"""Bodies of revolution: Hertz's and Spence's contact of spheres, the round punch of NAFEMS."""

import numpy as np

from . import halfspace
from .case import Case, Check, Curve, View
from .friction import stick_end
from .plane import column, places, pressures, profile_error
from .sizes import Sizes

MODULUS = 2000 / (1 - 0.3**2)  # of edp/sphere.edp, whose radius is 1
HALF_SPACE = "of what the formula of half-spaces leaves on a body of this size"


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
              HALF_SPACE + "; a node's pressure is a mean over its surroundings",
              "peak_pressure"),
        Check("contact_length", lambda view: hertz(view)[0], column("contact_length"), 1.5e-2,
              HALF_SPACE + "; the edge of contact is known to a part of an element",
              "contact_length"),
        Check("pressure in L1", 0.0, profile_error(_pressure), 2e-2, HALF_SPACE)),
    {"friction": 0, "steps": 1},
    Curve("radius [mm]", "pressure [MPa]", pressures,
          lambda view: (places(hertz(view)[0]), _pressure(view, places(hertz(view)[0])))),
    sizes=Sizes(tuple({"approach": 0.0009 * n**2, "h": 0.002 * n} for n in (1, 2, 4, 6)),
                lambda view: hertz(view)[0], "a/R"))


APPROACH = 2.5e-5  # contact of a two hundredth of the radius
def stick_ratio(view: View) -> float:
    """Radius of the disc that sticks over that of contact, which friction makes less than Hertz's.
    """
    return stick_end(view, 1.5) / view.quantities["contact_length"]


def _rough(friction: float, **more) -> Case:
    wanted, without = halfspace.stick_ratio(friction, 0.3), halfspace.spence(friction, 0.3)
    return Case(
        f"spence-{friction:g}", f"Sphere on a rough plane, friction {friction:g}", "sphere",
        "Spence, J. Elasticity 5 (1975) 297-319; Johnson, Contact Mechanics (1985), 5.4; rings on "
        "a half-space ([halfspace.py](../../driver/verify/halfspace.py))",
        ({"h": 4e-4}, {"h": 2e-4}, {"h": 1e-4}), (
            Check("radius that sticks over radius of contact", lambda _: wanted, stick_ratio, 2e-2,
                  HALF_SPACE + "; shear comes to its bound with a slope of zero"),),
        {"friction": friction, "approach": APPROACH, "steps": 20},
        sizes=Sizes(tuple({"approach": APPROACH * n**2, "h": 1.5e-4 * n} for n in (1, 2, 4, 6)),
                    lambda view: hertz(view)[0], "a/R"),
        others=f"Spence's closed form (a/2c) ln((a + c)/(a - c)) = F/beta K(sqrt(1 - c^2/a^2)) "
               f"gives {without:.4f}",
        note="The closed form leaves out that shear lifts the surface. Rings of pressure and shear "
             f"on a half-space give {halfspace.stick_ratio(friction, 0.3, False):.4f} without and "
             f"{wanted:.4f} with it, which is the reference. On a sphere of finite radius the disc "
             "that sticks is larger, to first order in a/R: with a/R = 0.03 the two nearly cancel, "
             "and the closed form seems right. Contact grows, and what touches late has moved "
             "before, so that it sticks in another place: a single step, which knows only where "
             "material was at the start, gives about half of the ratio with friction 0.2. That "
             "the load is proportional and the process similar to itself does not make it a "
             "single step; from ten on their number matters no more.", **more)


# ---- two hemispheres, and the punch --------------------------------------------------------------

def _pressed(view: View) -> tuple[float, float]:
    """Hertz's radius and peak for the approach: a^2 = R* 2 press, p0 = 2 E* a/(pi R*)."""
    a = float(np.sqrt(25.0 * 2 * float(view.settings.get("press", 2.0))))
    return a, 2 * (20e3 / 0.91 / 2) * a / (np.pi * 25.0)


HEMISPHERES = Case(
    "hemispheres", "Two hemispheres pressed by their flat faces", "verify/hemispheres",
    "Code_Aster V6.04.104 (SSNV104)", ({"h": 2}, {"h": 1}, {"h": 0.5}), (
        Check("peak_pressure", lambda view: _pressed(view)[1], column("peak_pressure"), 1.5e-2,
              HALF_SPACE, "peak_pressure"),
        Check("contact_length", lambda view: _pressed(view)[0], column("contact_length"), 2e-2,
              HALF_SPACE + "; the edge of contact is known to a part of an element",
              "contact_length")),
    sizes=Sizes(tuple({"press": 2 * n**2, "h": 0.25 * n} for n in (0.25, 0.5, 0.75, 1, 1.25)),
                lambda view: _pressed(view)[0] / 50, "a/R"),
    note="Half-spaces reach far, these bodies end at their flat faces: driven so deep the peak is "
         "6 % above Hertz's 2798.33, the others' reference. With smaller approaches it falls to "
         "Hertz's, as the runs under the table show.")


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
