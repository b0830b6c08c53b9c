"""What the quantities of a scene are: closed forms, else runs fine in space and in time."""

import math
from dataclasses import dataclass

from ...estimates.budget import extrapolate, formal_order, main_quantity
from .trial import Trial

RUN = "reference run"


@dataclass
class Reference:
    """What a quantity is, how much that may err, both in its unit, and where it comes from."""

    value: float
    own: float
    source: str

    @property
    def uncertainty(self) -> float:
        """Relative error of the reference."""
        return self.own / abs(self.value)

    def relative(self, difference: float) -> float:
        """A difference relative to the reference."""
        return abs(difference) / abs(self.value)


def hertz(known: dict[str, Reference]) -> dict[str, Reference]:
    """edp/hertz.edp: Johnson, Contact Mechanics (1985), 4.2(c), at the reference runs' resultant.

    Half-planes are a disc but for (a/R)^2, of which peak and width lack twice as much
    (tests/scenes/test_scenes_hertz.py); the resultant's error counts half.
    """
    E, nu, R = 2000.0, 0.3, 1.0
    P = known["normal_resultant"]
    a = math.sqrt(4 * P.value * R * (1 - nu**2) / (math.pi * E))
    own = 2 * (a / R) ** 2 + P.uncertainty / 2
    return {name: Reference(value, own * value, "Hertz") for name, value in
            (("peak_pressure", 2 * P.value / (math.pi * a)), ("contact_length", 2 * a))}


CLOSED_FORMS = {"hertz": hertz}


def references(runs: dict[str, Trial], closed_form=None, element: str = "P1") -> dict[str,
                                                                                      Reference]:
    """Reference of every quantity that converges and differs between runs by more than rounding.

    Its own error follows from the approach of adaptive meshes, whose cycles lessen the error like a
    halved size, and of doubled steps (budget.extrapolate), plus the product of both corrections.
    """
    known = {}
    for name, base in runs["base"].values.items():
        value = {key: trial.values[name] for key, trial in runs.items()}
        finest, most = value.get("finest", base), value.get("most", base)
        total = finest + most - base
        own = abs((finest - base) * (most - base) / base) if base else 0.0
        for keys, source, limit in ((("finest", "finer", "coarser"), "mesh", False),
                                    (("most", "more", "fewer"), "time", True)):
            if keys[0] in value:
                last, middle, first = (value[key] for key in keys)
                part = extrapolate([last - middle, middle - first],
                                   [2.0, 2.0], formal_order(source, element, name), total,
                                   limit).error
                own = None if part is None or own is None else own + part
        spread = max(abs(v - base) for v in value.values())
        if own is not None and total and spread > 1e-9 * abs(total):
            known[name] = Reference(total, own, RUN)
    return known | (closed_form(known) if closed_form else {})


def most_sensitive(known: dict[str, Reference]) -> str:
    """The quantity to show: what friction dissipates feels every setting.

    Else one with a closed form, else the scene's main one, else one that is known well, else any.
    """
    closed = [name for name, reference in known.items() if reference.source != RUN]
    well = [name for name, reference in known.items() if reference.uncertainty < 0.02]
    return next(name for name in ("dissipated_energy", *closed, main_quantity(known), *well, *known)
                if name in known)
