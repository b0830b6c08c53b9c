"""Meshes that would be too large are refused before FreeFEM makes them.

FreeFEM meshes until memory is full. Where H asks for elements far smaller than the scene's own it
stops first (meshSize in scene.idp); the scene's meshes with two larger sizes then show how the
number of triangles grows: with h^-2 where elements are equal, by less where they are graded.
"""

import math
import re

from ..errors import InputError

MOST = 2e7  # triangles, as of the rectangle in partition.idp: some 20 GB in FreeFEM alone
TRIALS = (1.0, 2.0)  # parts of the scene's own size
ASKED = re.compile(r"to be counted: (\S+)")
COUNT = re.compile(r"triangles: (\d+)")


def check(said: str, parameters: dict[str, str], trial) -> bool:
    """Whether the scene has stopped to be counted, as it `said`, and its mesh is not too large.

    `trial(parameters)` runs it with other `parameters` and returns what it says. Raises InputError
    where the mesh would be too large.
    """
    asked = ASKED.search(said)
    if not asked:
        return False
    own, size, counts = float(asked[1]), float(parameters["h"]), []
    for part in TRIALS:
        count = COUNT.search(trial({**parameters, "h": f"{own / part:.6g}", "counting": "1"}))
        if count is None:  # these meshes fail: so will the one asked for, in its own words
            return True
        counts.append(int(count[1]))
    order = math.log(counts[1] / counts[0]) / math.log(TRIALS[1] / TRIALS[0])
    expected = counts[1] * (own / TRIALS[1] / size) ** order
    if expected > MOST:
        raise InputError(f"H={parameters['h']} would make a mesh of about {expected:.0e} "
                         f"triangles, more than the {MOST:.0e} that can be dealt with; the "
                         f"scene's own size is H={own:g}")
    return True
