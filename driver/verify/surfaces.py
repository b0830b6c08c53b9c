"""Cases of what joins and supports bodies: wear, rough surfaces, ties, foundations."""

import numpy as np

from .case import Case, Check, Curve, View
from .plane import column, places, pressures

STATICS = "the law and equilibrium: exact but for the tolerances of the solver"
LOCKING = "linear triangles are too stiff in bending, like (element size / height)^2"


# ---- wear ----------------------------------------------------------------------------------------

WEAR, WAY = 1e-4, 4000.0  # of worn-pad: Archard's k [1/MPa], how far the disc slides [mm]


def _worn(view: View) -> float:
    """k times the sum of what each step slides under its normal force: implicit steps."""
    b = view.result.boundaries
    slid = WAY * np.diff(np.maximum(0.0, np.r_[0.0, b["time"]] - 1.0))
    return float(WEAR * (np.abs(b["normal_resultant"]) * slid).sum())


def _level(view: View) -> float:
    """Mean pressure of the lining, N/2a."""
    return view.P / 20


ARCHARD = Case(
    "archard", "Lining that slides until its pressure is level", "worn-pad",
    "Archard, J. Appl. Phys. 24 (1953) 981-988: volume k N S; Johnson, Contact Mechanics (1985), "
    "a flat punch wears towards p = N/2a",
    ({"cells": 3}, {"cells": 6}, {"cells": 12}), (
        Check("worn volume", _worn, column("worn_volume"), 1e-4,
              "the lining's shear takes 0.03 mm of a way of 4000 mm", "worn_volume"),
        Check("largest pressure", _level, lambda v: float(-v["sigma_n"].min()), 1e-3,
              "what pressure is left to level falls exponentially with the way", "peak_pressure")),
    {"steps": 12, "stroke": WAY},
    Curve("x [mm]", "pressure [MPa]", pressures,
          lambda view: (places(10.0, -10.0), np.full(25, _level(view)))))

# ---- rough surfaces ------------------------------------------------------------------------------

PRESSURE, STIFFNESS = 8.0, 1e3  # of edp/verify/asperities


def _closure(exponent: float) -> Case:
    name = "asperities" if exponent == 1 else f"asperities-{exponent:g}"
    return Case(
        name, f"Block on a rough floor that yields by the power {exponent:g}", "verify/asperities",
        "Oden, Martins, CMAME 52 (1985) 527-634: normal compliance",
        ({"cells": 4}, {"cells": 8}), (
            Check("closure", (PRESSURE / STIFFNESS) ** (1 / exponent),
                  lambda v: float((v["u_n"] - v["gap"]).max()), 1e-6, STATICS),
            Check("largest pressure", PRESSURE, lambda v: float(-v["sigma_n"].min()), 1e-6,
                  STATICS, "peak_pressure")),
        {"exponent": exponent}, fast=exponent != 0.5)


# ---- beams ---------------------------------------------------------------------------------------

def deflection(x: float, foundation: float, bending: float, shear: float, load: float,
               width: float) -> float:
    """Of an endless beam on a foundation under a load on `width`, at x from its middle.

    Hetenyi's (Beams on elastic foundation, 1946) with Timoshenko's shear: the Fourier transform of
    EI w'''' - (EI k/GA) w'' + k w = q - (EI/GA) q''; `bending` is EI, `shear` GA, infinite for
    Hetenyi's own. All per width of the beam.
    """
    from scipy.integrate import quad  # the pages of reports import this module

    soft = bending / shear

    def part(q):
        return (np.cos(q * x) * np.sinc(q * width / 2 / np.pi) * (1 + soft * q**2)
                / (bending * q**4 + soft * foundation * q**2 + foundation))

    scale = (foundation / bending) ** 0.25
    return load / np.pi * scale * quad(lambda z: part(scale * z), 0, 400, limit=2000)[0]


HEIGHT, YOUNG = 150.0, 210e3  # of rail
BENDING = YOUNG * HEIGHT**3 / 12
SHEAR = 10 * 1.3 / (12 + 11 * 0.3) * YOUNG / 2.6 * HEIGHT  # Cowper's factor at a ratio of 0.3
RAIL = Case(
    "rail", "Rail on ballast under a wheel", "rail",
    "Hetenyi, Beams on elastic foundation (1946); Timoshenko, Phil. Mag. 41 (1921) 744-746",
    ({"h": 75}, {"h": 37.5}, {"h": 18.75}), (
        Check("deflection under the wheel",
              deflection(0.0, 0.7, BENDING, SHEAR, 100.0, 100.0),
              lambda v: -v.probe("point1", "u_y"), 2e-2,
              LOCKING + ", 1.5 %; the wheel presses the rail flat by P/E, 0.5 %"),
        Check("deflection 1 m away", deflection(1000.0, 0.7, BENDING, SHEAR, 100.0, 100.0),
              lambda v: -v.probe("point2", "u_y"), 1.5e-2, LOCKING + ", of that under the wheel"),
        Check("reaction of the ballast", 100.0, lambda v: v.probe("label1", "force_y"), 1e-6,
              STATICS)))

RISE, RATIO = 50.0, 210 / 100  # of bimetal: heat [K], moduli of steel over brass
CURVATURE = 6 * 7e-6 * RISE * 4 / (2 * (3 * 4 + (1 + RATIO) * (1 + 1 / RATIO)))


def _curvature(view: View) -> float:
    """Of the strip's middle, from three probes 10 mm apart."""
    a, b, c = (-view.probe(f"point{k}", "u_y") for k in (1, 2, 3))
    return (a - 2 * b + c) / 10**2


BIMETAL = Case(
    "bimetal", "Strip of two metals, tied, that heat bends", "bimetal",
    "Timoshenko, J. Opt. Soc. Am. 11 (1925) 233-255",
    ({"h": 0.5}, {"h": 0.25}, {"h": 0.125}), (
        Check("curvature", CURVATURE, _curvature, 2e-2, LOCKING),))

CASES = (ARCHARD, *map(_closure, (0.5, 1.0, 2.0)), RAIL, BIMETAL)
