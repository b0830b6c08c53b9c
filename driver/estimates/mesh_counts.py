"""How much coarser meshes are than each other, by what they have of triangles and contact sides."""

import numpy as np

# of the ratio of sizes: where fewer sides of the contact boundary are joined than that, the scene
# limits their number, as by max(12, ...); rounding leaves three of four where there are few
LIMITED = 0.75


def elements(problem) -> np.ndarray:
    """(2,) numbers of triangles, and of their sides with contact labels; collective."""
    subs, labels = problem.structure.subdomains, problem.manifest.contact_labels
    own = [(len(sub.triangles), np.isin(sub.edge_label, labels).sum()) for sub in subs]
    counts = [count for part in problem.operator.comm.allgather(own) for count in part]
    return np.array(counts, int).reshape(-1, 2).sum(axis=0)


def contact_ratios(problems: list, ratios: list[float]) -> list[float]:
    """The `ratios` of sizes of the `problems`, finest first, or those of the numbers of contact
    sides where the scene limits these: what meshes tell is told by sides that are that much longer.
    Collective.
    """
    sides = [elements(problem)[1] for problem in problems]
    found = [fine / coarse if coarse else np.inf for fine, coarse in zip(sides, sides[1:])]
    return [float(counted) if 1 < counted < LIMITED * ratio else ratio
            for counted, ratio in zip(found, ratios)]
