"""Which displacements of the whole body supports fix, and by how much."""

import numpy as np

from ..scene.loader import Subdomain
from ..scene.manifest import Manifest
from .gathering import gather, joined

ALONG = 1e-12  # component of a direction that is none


def fixed_dofs(manifest: Manifest, subdomains: list[Subdomain],
               comm) -> tuple[np.ndarray, np.ndarray]:
    """Sorted keys 2 gid + component of all fixed dofs of the body, and their values (n, patterns).

    Gathered, as a subdomain that touches a support in a vertex may not know of it. Where boundaries
    meet, one may fix a dof and the other displace it: subdomains that know the first alone have
    zeros, so the larger value is what the untorn body has.
    """
    keys, values = [np.empty(0, np.int64)], [np.empty((0, len(manifest.patterns)))]
    for sub in subdomains:
        keys.append(2 * sub.node_gid[sub.dof_node[sub.fixed]] + sub.dof_component[sub.fixed])
        values.append(sub.fixed_values.T)
    keys, values = gather(comm, np.concatenate(keys)), gather(comm, np.concatenate(values))
    order = np.argsort(keys, kind="stable")
    keys, first = np.unique(keys[order], return_index=True)
    if not len(keys):
        return keys, values
    low, high = (extreme.reduceat(values[order], first) for extreme in (np.minimum, np.maximum))
    return keys, np.where(high >= -low, high, low)


def constrained_keys(structure) -> np.ndarray:
    """(n,) keys 2 gid + component of the rank's displacements that a support constrains."""
    return joined((2 * sub.node_gid[sub.dof_node[fixed]] + sub.dof_component[fixed]
                   for sub, fixed in zip(structure.subdomains, structure.fixed)), np.int64)


def free_keys(gids: np.ndarray, fixed_keys: np.ndarray) -> np.ndarray:
    """Keys 2 gid + component of the dofs of vertices (n,) that no support fixes."""
    keys = (2 * gids[:, None] + [0, 1]).ravel()
    return keys[~np.isin(keys, fixed_keys)]


def free_along(gid: np.ndarray, direction: np.ndarray, fixed_keys: np.ndarray) -> np.ndarray:
    """(n,) whether supports, of `fixed_keys` 2 gid + component, leave a direction (n, 2) free."""
    free = np.column_stack([~np.isin(2 * gid + c, fixed_keys) for c in (0, 1)])
    return np.abs(direction * free).max(axis=1, initial=0) > ALONG


def held_nodes(gid: np.ndarray, fixed_keys: np.ndarray) -> np.ndarray:
    """(n,) whether supports fix both displacement components of vertices (n,)."""
    return np.isin(2 * gid, fixed_keys) & np.isin(2 * gid + 1, fixed_keys)
