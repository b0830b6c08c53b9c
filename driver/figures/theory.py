"""Closed forms drawn beside the contact stresses of shipped scenes that have one.

Each takes what the run itself carries, forces and length in contact, so that a curve shows the form
of the solution and stays right when a user changes loads or material. Source of all: Johnson,
Contact Mechanics, Cambridge University Press 1985.
"""

import numpy as np

from .reading import Run, select

STEADY = 0.01  # relative change of the pressing force that counts as constant


def hertz(rows: dict) -> np.ndarray:
    """(n,) sigma_n of Hertz's line contact (4.2(c)), p = p_0 sqrt(1 - (s/a)^2), with the force P of
    the boundary's nodes and their length in contact 2a: p_0 = 2 P / (pi a).
    """
    force, closed = -rows["sigma_n"] * rows["weight"], rows["status"] != "open"
    if not closed.any():
        return np.zeros(len(force))
    half = rows["weight"][closed].sum() / 2
    return -2 * force.sum() / (np.pi * half) * _root(_from_middle(rows) / half)


def hertz_of_spheres(rows: dict) -> np.ndarray:
    """(n,) sigma_n of Hertz's point contact around the axis (4.2(a)), p = p_0 sqrt(1 - (r/a)^2),
    with the force P of the boundary's nodes and the radius a that they touch: p_0 = 3 P/(2 pi a^2).
    """
    force, closed = -rows["sigma_n"] * rows["weight"], rows["status"] != "open"
    if not closed.any():
        return np.zeros(len(force))
    radius = rows["length"][closed].sum()
    return -1.5 * force.sum() / (np.pi * radius**2) * _root(rows["x"] / radius)


def flat_punch(rows: dict) -> np.ndarray:
    """(n,) sigma_n under the right half, s > 0, of a rigid punch with a flat base 2a without
    friction (2.8(a)), p = 2 P / (pi sqrt(a^2 - s^2)), P the force on that half; infinite at its
    edge, where it is cut off half a dual segment inside.
    """
    force, half = -(rows["sigma_n"] @ rows["weight"]), rows["weight"].sum()
    s = np.minimum(rows["arc"] - rows["arc"][0], half - rows["weight"][-1] / 2)
    return -2 * force / (np.pi * np.sqrt(half**2 - s**2))


def uniform(rows: dict) -> np.ndarray:
    """(n,) sigma_n that is the same everywhere, as of a ring on a round shaft (Lame)."""
    return np.full(len(rows["arc"]), rows["sigma_n"] @ rows["weight"] / rows["weight"].sum())


def parabola(rows: dict) -> np.ndarray:
    """(n,) sigma_n of the manufactured problem of scene zones, p ~ (1.5 - x)^2 up to x = 1.5."""
    shape = np.maximum(0.0, 1.5 - rows["x"])**2
    return shape * (rows["sigma_n"] @ rows["weight"]) / (shape @ rows["weight"])


def westergaard(rows: dict) -> np.ndarray:
    """(n,) sigma_n of a wavy surface on a flat one (13.2), of which the boundary is a wave length.

    p = 2 P cos(s) sqrt(A - sin^2(s)) / A, A = sin^2(a), where s = pi is a wave length and 2 a the
    length in contact. P is the mean pressure of the boundary's nodes; their spread gives A, as the
    mean of cos(2 s) is 1 - A/2 under p. Contact may go on from one end at the other.
    """
    force = -rows["sigma_n"] * rows["weight"]
    if not force.any():
        return np.zeros(len(force))
    whole = rows["weight"].sum()
    turn = 2 * np.pi * (rows["arc"] - rows["arc"][0]) / whole
    wave = force @ np.exp(1j * turn)
    s, edge = (turn - np.angle(wave)) / 2, 2 * (1 - np.abs(wave) / force.sum())
    shape = np.abs(np.cos(s)) * np.sqrt(np.maximum(0.0, edge - np.sin(s) ** 2)) / edge
    return -2 * force.sum() / whole * shape


def mindlin(run: Run, rows: dict) -> np.ndarray | None:
    """(n,) sigma_t of Cattaneo and Mindlin (7.2) after a history of the shearing force Q.

    Increasing Q slips from the edges inwards up to c = a sqrt(1 - Q / F P); after every turn of Q
    the same happens with twice the bound on top of what was there. None where P changes while Q
    acts, or where everything slides.
    """
    steps = np.unique(run.contact["step"])
    steps = steps[steps <= rows["step"][0]]
    each = [select(run.contact, (run.contact["step"] == step)
                   & np.isin(run.contact["node"], rows["node"])) for step in steps]
    pressing = np.array([-(step["sigma_n"] @ step["weight"]) for step in each])
    shear = np.array([step["sigma_t"] @ step["weight"] for step in each])
    closed = rows["sigma_n"] < 0
    if not closed.any() or np.ptp(pressing) > STEADY * pressing[-1]:
        return None
    friction = np.median(rows["bound"][closed] / -rows["sigma_n"][closed])
    most = friction * pressing[-1]
    if np.abs(shear).max() >= (1 - STEADY) * most:
        return None
    peak, half = -friction * hertz(rows).min(), rows["weight"][rows["status"] != "open"].sum() / 2
    s = _from_middle(rows) / half

    def loaded(force: float) -> np.ndarray:
        """sigma_t by a force that grows from zero."""
        inner = np.sqrt(1 - abs(force) / most)
        return np.sign(force) * peak * (_root(s) - inner * _root(s / inner))

    ends = turns(shear)
    total = loaded(ends[0])
    for before, after in zip(ends, ends[1:]):
        total = total + 2 * loaded((after - before) / 2)
    return total


def turns(history: np.ndarray) -> list[float]:
    """What is remembered of a force that starts from zero: its turns and its last value.

    A stretch that goes beyond an earlier turn wipes out the loop that began there.
    """
    points: list[float] = []
    for value in history.tolist():
        points.append(value)
        while len(points) > 1:
            before = points[-3] if len(points) > 2 else 0.0
            last = points[-1]
            if (points[-2] - before) * (last - points[-2]) >= 0:
                del points[-2]  # goes on in the same direction
            elif len(points) > 3 and abs(last - points[-2]) >= abs(points[-2] - points[-3]):
                del points[-3:-1]  # a loop that is closed
            elif len(points) == 3 and abs(last) >= abs(points[0]) and last * points[0] > 0:
                del points[:2]  # beyond the first turn
            elif len(points) == 2 and abs(last) >= abs(points[0]):
                del points[0]  # beyond its mirror image
            else:
                break
    return points


def _from_middle(rows: dict) -> np.ndarray:
    """(n,) arc from the middle of the pressure."""
    force = -rows["sigma_n"] * rows["weight"]
    return rows["arc"] - force @ rows["arc"] / force.sum()


def _root(s: np.ndarray) -> np.ndarray:
    """sqrt(1 - s^2), zero outside."""
    return np.sqrt(np.maximum(0.0, 1 - s**2))


LINE_CONTACT = ("Hertz, same force and length", hertz)
NORMAL = {"hertz": LINE_CONTACT, "hertz-bodies": LINE_CONTACT, "mindlin": LINE_CONTACT,
          "mindlin-bodies": LINE_CONTACT,
          "sphere": ("Hertz, same force and radius", hertz_of_spheres),
          "punch": ("flat punch without friction, same force", flat_punch),
          "zones": ("manufactured, same force", parabola),
          "ripple": ("Westergaard, same force and spread", westergaard),
          "bar": ("uniform, same force", uniform), "thermal": ("uniform, same force", uniform),
          "patch": ("uniform, same force", uniform),
          "patch-bodies": ("uniform, same force", uniform),
          "pressfit": ("Lam\N{LATIN SMALL LETTER E WITH ACUTE}, same mean", uniform)}
TANGENTIAL = ("mindlin", "mindlin-bodies")


def curves(run: Run, rows: dict) -> dict[str, tuple[str, np.ndarray]]:
    """Label and values (n,) of closed forms by the column they belong to; rows as for a panel."""
    found = {}
    if run.scene in NORMAL:
        label, form = NORMAL[run.scene]
        found["sigma_n"] = label, form(rows)
    if run.scene in TANGENTIAL and run.friction and (shear := mindlin(run, rows)) is not None:
        found["sigma_t"] = "Cattaneo and Mindlin, same forces", shear
    return found
