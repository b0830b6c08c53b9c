"""Cases of ties, of periodic bodies, and of cycles."""

import numpy as np

from .case import Case, Check, Curve, View
from .plane import ROUNDING, column, places, pressures

# ---- ties, periodicity --------------------------------------------------------------------------

WAVE, FULL = 1 / 6, np.pi / (1 - 0.3**2) * 1e-4  # half-width at a quarter of the full pressure


def _wavy(x) -> np.ndarray:
    """Westergaard's pressure at a quarter of the pressure that flattens the surface."""
    inside = np.maximum(0.0, np.sin(np.pi * WAVE)**2 - np.sin(np.pi * np.asarray(x))**2)
    return 2 * 0.25 * FULL * np.cos(np.pi * np.asarray(x)) / 0.25 * np.sqrt(inside)


JOINED = (
    Case("patch-tied", "Two blocks tied across meshes that do not match", "verify/tied",
         "Taylor's patch test; numbers of Code_Aster SSNP170", ({"h": 0.2}, {"h": 0.1}), (
             Check("u_y of the top", -2 * 25 * (1 - 0.3**2) / 2000,
                   lambda v: v.probe("label3", "u_y"), 1e-8, ROUNDING),
             Check("u_x of the free sides", 25 * 0.3 * 1.3 / 2000,
                   lambda v: v.probe("label2", "u_x"), 1e-8, ROUNDING),
             Check("force through the tie", 25.0, lambda v: v.probe("label6", "force_y"), 1e-8,
                   ROUNDING)), fast=True),
    Case("westergaard-periodic", "Wavy surface between periodic sides that are curved", "ripple",
         "Westergaard (1939); Johnson, Contact Mechanics (1985), 13.2",
         ({"h": 0.01}, {"h": 0.005}, {"h": 0.0025}), (
             Check("contact_length", 2 * WAVE, column("contact_length"), 5e-3,
                   "the end of contact is known to a part of an element", "contact_length"),
             Check("peak_pressure", float(_wavy(0.0)), column("peak_pressure"), 5e-3,
                   "a node's pressure is a mean over its surroundings", "peak_pressure")),
         {}, Curve("x / wave length", "pressure / E", pressures,
                   lambda _: (places(WAVE, -WAVE), _wavy(places(WAVE, -WAVE))))),
)

# ---- cycles --------------------------------------------------------------------------------------

YIELD = 0.4 * 4.0 / (1000 / 2.6)  # F p H/G of the strip


def _last(name: str):
    """A number of the last cycle."""
    return lambda view: float(view.result.summary["cycles"]["last"][name])


def _is(kind: str):
    """Whether that is what the cycles have settled into, as 1 or 0."""
    def judged(view: View) -> float:
        found = view.result.summary["cycles"]
        return float(found["last"]["kind"] == kind and found["settled_after"] is not None)
    return judged


def _loop(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of the top and shear traction, over the whole history."""
    probes = view.result.probes
    return probes["u_x"], probes["force_x"] / 2


def _along(*corners: tuple[float, float]):
    """Curve.reference: three places on every side of a polygon, off its corners, which steps cut.
    """
    ends = np.array(corners)
    inside = [start + part * (end - start) for start, end in zip(ends, ends[1:])
              for part in (0.2, 0.5, 0.8)]
    return lambda _: tuple(np.array(inside).T)


def _parallelogram(amount: float, mean: float):
    """The loop of the strip."""
    high, low, turn = mean + amount, mean - amount, 2 * YIELD
    return _along((low, -1.6), (low + turn, 1.6), (high, 1.6), (high - turn, -1.6), (low, -1.6))


def loop_area(P: float, Q: float, F: float, modulus: float) -> float:
    """Work lost in a cycle between -Q and Q by two cylinders under P (Mindlin; Masing).

    d delta/dP = (const - ln P)/(pi E*) and delta_t(Q) = F (delta(P) - delta(P - Q/F)) make
    4 F^2 int_0^S (2s - S) (-ln(P - s))/(pi E*) ds, S = Q/F.
    """
    from scipy.integrate import quad  # the pages of reports import this module

    S = Q / F
    return -4 * F**2 / (np.pi * modulus) * quad(lambda s: (2 * s - S) * np.log(P - s), 0, S)[0]


def _mindlin_loop(view: View) -> float:
    history = view.result.history
    shear, normal = np.abs(history["resultant_t"]).max(), -history["resultant_n"].mean()
    return loop_area(normal, shear, 0.02, 2000 / (1 - 0.45**2))


STRIP = "a Jenkins element at every place"
STEPS = "Steps cut the corners of the loop in the picture; what they end in is exact."
MELAN = "Melan's theorem for contact without coupling: Klarbring, Ciavarella, Barber, IJSS 44 " \
        "(2007) 8355"
CYCLES = (
    Case("shakedown", "Strip sheared by 99 % of what can shake down, about three times as much",
         "verify/strip", MELAN, ({"cells": 2}, {"cells": 4}), (
             Check("shakes down", 1.0, _is("shakedown"), 1e-9, "the theorem"),
             Check("slip", 3.99 * YIELD - YIELD, column("slip"), 1e-6, ROUNDING, "slip"),
             Check("dissipated_energy", 1.6 * 2 * 2.99 * YIELD, column("dissipated_energy"), 1e-6,
                   ROUNDING, "dissipated_energy")),
         {"amount": 0.99 * YIELD, "mean": 3 * YIELD}, Curve(
             "displacement of the top [mm]", "shear traction [MPa]", _loop,
             _along((0, 0), (YIELD, 1.6), (3.99 * YIELD, 1.6), (2.01 * YIELD, -0.98 * 1.6))),
         note=STEPS),
    Case("alternating-slip", "The same strip, sheared by more than can shake down", "verify/strip",
         f"{STRIP}; {MELAN}", ({"cells": 2}, {"cells": 4}), (
             Check("slides to and fro", 1.0, _is("alternating slip"), 1e-9, "the theorem"),
             Check("work of friction in a cycle", 2 * 1.6 * 4 * (0.02 - YIELD), _last("dissipated"),
                   1e-6, ROUNDING),
             Check("slip in a cycle", 4 * (0.02 - YIELD), _last("slip"), 1e-6, ROUNDING)),
         {"amount": 0.02, "mean": 0.01}, Curve(
             "displacement of the top [mm]", "shear traction [MPa]", _loop,
             _parallelogram(0.02, 0.01)), note=STEPS),
    Case("fretting-wear", "A thousand cycles of wear, most of them jumped over", "verify/strip",
         f"{STRIP}; Archard: k p s", ({"cells": 2}, {"cells": 4}), (
             Check("worn_volume", 2 * 1e-4 * 4 * (
                 3 * (0.02 - YIELD) + 0.02 - 2 * YIELD + 999 * 4 * (0.02 - YIELD)),
                   column("worn_volume"), 1e-6, "what jumps state as their error, and tolerances",
                   "worn_volume"),
             Check("cycles jumped over", 1.0,
                   lambda v: float(v.result.summary["cycles"]["skipped"] > 900), 1e-9,
                   "growth is the same in every cycle")),
         {"amount": 0.02, "wears": 1e-4, "cycles": "1000 jump"}),
    Case("mindlin-cycles", "Half-disc pushed to and fro, cycle by cycle", "mindlin",
         "Mindlin, Deresiewicz (1953); Johnson, Contact Mechanics (1985), 7.4",
         ({"h": 0.004}, {"h": 0.002}, {"h": 0.001}), (
             Check("work of friction in a cycle", _mindlin_loop, _last("dissipated"), 3e-2,
                   "shear and pressure move each other's surface: 1.7 beta^2, 1.4 %"),
             Check("slides to and fro", 1.0, _is("alternating slip"), 1e-9, "a closed loop")),
         {"nu": 0.45, "steps": 20, "cycles": 3}, elements=("P1",)),
)

CASES = (*JOINED, *CYCLES)
