"""Loads and springs at points of the bodies, for the picture of the scene."""

import numpy as np

from ..march.problem import Problem
from ..scene.subdomain import Subdomain


def at_points(problem: Problem) -> list[dict]:
    """Entry `points` of summary.json; collective."""
    manifest = problem.manifest
    if not {"point_load", "springs"} & set(manifest.rooms):
        return []
    springs = manifest.rooms.get("springs", {})
    own = []
    for sub in problem.structure.subdomains:
        for k, pattern in enumerate(manifest.patterns):
            if pattern["kind"] == "point_load":
                own += _entries("point_load", pattern["amplitude"], sub,
                                sub.loads[k].reshape(-1, 2))
        if sub.springs is not None and springs["at_points"]:
            own += _entries("springs", 0, sub, _apart(sub, springs.get("labels", [])))
    return sum(problem.operator.comm.allgather(own), [])


def _entries(effect: str, number: int, sub: Subdomain, values: np.ndarray) -> list[dict]:
    """An entry for every node whose values (n_v, 2) are not zero."""
    return [{"effect": effect, "number": number, "place": sub.xy[node].tolist(),
             "value": values[node].tolist()} for node in np.flatnonzero(values.any(axis=1))]


def _apart(sub: Subdomain, founded: list[int]) -> np.ndarray:
    """(n_v, 2) stiffness xx and yy of the springs at vertices that no foundation holds."""
    alone = np.zeros(len(sub.xy), bool)
    alone[sub.elements[:, :3]] = True
    alone[sub.edges[np.isin(sub.edge_label, founded)]] = False
    return np.where(alone[:, None], sub.springs[:, [0, 2]], 0.0)
