"""The largest displacement at a place that neither contact nor a support prescribes.

Where an obstacle or a support prescribes the largest displacement of a body, it is the same on all
meshes, and they tell nothing of others that may exceed it. Such others are peaks of their own:
nodes with displacements that no neighbour exceeds. Beside a prescribed displacement all are lower,
and come the nearer to it the finer the mesh is: they are none.
"""

import numpy as np


def free_peak(operator, step) -> float:
    """Size of the largest such displacement at the end of `step`; zero if there is none.

    Collective over the ranks of `operator`, which have the same number.
    """
    structure, comm = operator.structure, operator.comm
    placed = np.unique(structure.contact.declared.term_gid)
    fields = operator.displacements(step.multipliers, step.weights)
    tops, lower = [(np.empty(0, int), np.empty(0))], [np.empty(0, int)]
    for sub, fixed, u in zip(structure.subdomains, structure.fixed, fields):
        size = np.linalg.norm(u.reshape(-1, 2), axis=1)
        around = size[sub.elements]
        exceeded = np.zeros(len(size), bool)
        exceeded[sub.elements[around < around.max(axis=1, keepdims=True)]] = True
        free = ~np.isin(sub.node_gid, placed) & ~exceeded
        free[sub.dof_node[fixed]] = False
        tops.append((sub.node_gid[free], size[free]))
        lower.append(sub.node_gid[exceeded])
    gids, sizes = (np.concatenate(parts) for parts in zip(*tops))
    everywhere = comm.allgather((gids, sizes))
    gids, sizes = (np.concatenate(parts) for parts in zip(*everywhere))
    # of a node on an interface the other subdomains have neighbours, too
    beside = np.any(comm.allgather(np.isin(gids, np.concatenate(lower))), axis=0)
    return float(sizes.max(initial=0.0, where=~beside))
