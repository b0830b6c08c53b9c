"""Units as engineers spell them: a stress times a length is N/m, times an area J/m.

Forces and energies are per thickness, the thickness in the scene's unit of length: MPa and mm make
N/mm. Those of bodies of revolution are of the whole body; `units` then has an entry "forces".
Values are in the scene's own units and stay as they are; only the names are spelt here.
"""

import re

# powers of ten of SI prefixes; mu is spelt u as well
PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
BASES = ("Pa", "N/m", "N/mm", "J/m", "N", "J", "m")
NONE = ("", "1", "-")  # of a scene without units
OTHERS = {"length": ("psi", "ksi", "bar"), "stress": ("cm", "in", "inch", "ft")}  # no such units
REVOLUTION = "forces"  # entry of the units of bodies of revolution


def split_unit(unit: str) -> tuple[int, str | None]:
    """Exponent and base of a unit with an SI prefix, (6, "Pa") of MPa; base None of any other.

    Stresses may be spelt as forces over areas, N/mm^2.
    """
    if stress := re.fullmatch(r"(.?)N/(m|mm)(?:\^?2|²)", unit):
        exponents = {prefix: exponent for exponent, prefix in PREFIXES.items()}
        if stress[1] in exponents:
            return exponents[stress[1]] + (6 if stress[2] == "mm" else 0), "Pa"
    for base in BASES:
        for exponent, prefix in PREFIXES.items():
            if unit in (prefix + base, prefix.replace("µ", "u") + base):
                return exponent, base
    return 0, None


def fault(length: str, stress: str, **_) -> str:
    """Why these can be no names of a scene's units of length and stress; "" if they can."""
    for name, kind, others in ((length, "length", ("Pa", "N", "J")),
                               (stress, "stress", ("m", "N", "J"))):
        if re.fullmatch(r"[+-]?[\d.,]+([eE][+-]?\d+)?", name) and name not in NONE:
            return f'"{name}" is a number, no name of a unit of {kind}'
        if split_unit(name)[1] in others or name in OTHERS[kind]:
            return f'"{name}" is no unit of {kind}: length comes first, then stress'
    return ""


def spelt(stress: int, length: int, units: dict[str, str]) -> str:
    """The unit stress^`stress` length^`length` in the scene's `units`; "1" where it has none.

    Stress times lengths are forces and energies, for which bodies of revolution have a length more.
    Where that is no SI unit, as of psi, the names stand side by side.
    """
    a, pascal = split_unit(units["stress"])
    b, metre = split_unit(units["length"])
    if stress == 1 and length in (1, 2) and (pascal, metre) == ("Pa", "m"):
        if REVOLUTION in units and PREFIXES.get(a + (length + 1) * b) is not None:
            return PREFIXES[a + (length + 1) * b] + ("N" if length == 1 else "J")
        prefix = PREFIXES.get(a + 2 * b)  # of stress length^2: N, or energy in J over m
        if prefix is not None and REVOLUTION not in units:
            return f"{prefix}N/{units['length']}" if length == 1 else f"{prefix}J/m"
    # volumes and forces are those of the whole revolution
    length += int((stress == 1 and length > 0 or length == 2) and REVOLUTION in units)
    parts = [units["stress"]] if stress and units["stress"] not in NONE else []
    if length and units["length"] not in NONE:
        parts.append(units["length"] + {1: "", 2: "²", 3: "³"}[length])
    return "·".join(parts) or "1"


def generic(unit: str, units: dict[str, str]) -> str:
    """The unit of a column ("stress length", see results/tables.py) in the scene's `units`."""
    powers = {"stress": (1, 0), "length": (0, 1), "stress length": (1, 1),
              "stress length^2": (1, 2)}
    return spelt(*powers[unit], units) if unit in powers else ""


def assumed(units: dict[str, str]) -> list[str]:
    """A sentence where the scene names no units, and tables say metre and pascal all the same."""
    if "assumed" not in units:
        return []
    return [f'the scene names no units, {units["length"]} and {units["stress"]} are assumed: '
            'units("mm", "MPa");  names others']
