"""Contact that follows the motion and starts inside the obstacle as a whole: not solved at all.

Where contact is linear such a start is a load, if a questionable one (`gap` in assumptions.py).
Where it follows the motion a body is pushed out to the next place of the obstacle's surface,
wherever that is. Of a boundary all of whose nodes are inside, one of them by half of the body, the
sign of the distance is wrong. Press fits are less deep, and of a body that an obstacle is pressed
into some nodes are outside.
"""

import numpy as np

from ..errors import InputError
from ..feti.gathering import largest
from .limits import QUESTIONABLE


def check(problem, first: float | None = None) -> None:
    """Raise InputError for such a boundary of a march.Problem; collective.

    `first`: end of the first step, by default that of the problem's own steps.
    """
    following, structure = problem.structure.contact.following, problem.structure
    if following is None:
        return
    start = structure.contact.start.declared
    deep, size = -start.gap, _sizes(problem)[start.gid]
    if following.motion is not None:  # unless the first step takes the obstacle away
        first = first or problem.manifest.t_end / problem.manifest.steps
        deep = np.minimum(deep, -following.about(np.zeros((len(following.gids), 2)),
                                                 first).declared.gap)
    for label in np.unique(start.label[~start.paired]):
        here = np.flatnonzero((start.label == label) & ~start.paired)
        k = here[deep[here].argmax()]
        if deep[here].min() <= 0 or deep[k] <= QUESTIONABLE["gap"] * size[k]:
            continue
        what, outside = "gap()", "where bodies are apart"
        if "obstacle" in problem.effects:
            what, outside = "obstacle(x, y)", "outside of the obstacle"
        x, y = start.xy[k]
        raise InputError(
            f"{what} has all of contact label {label} inside the obstacle at the start, by up to "
            f"{deep[k]:.3g} at ({x:.3g}, {y:.3g}), {deep[k] / size[k]:.2g} of the body's size: is "
            f"its sign right? It is positive {outside}")


def _sizes(problem) -> np.ndarray:
    """(nodes,) the larger of length and height of the body of every node."""
    bodies, sizes = problem.structure.travel.bodies, np.zeros(problem.manifest.nodes)
    for sub in problem.structure.subdomains:
        sizes[sub.node_gid] = bodies.size[bodies.number[sub.index]]
    return largest(problem.operator.comm, sizes)
