"""What a run must report: elements that lock, digits lost far from the origin, loads edges miss.

Locking. In a nearly incompressible material (Lame's lambda far above mu) P1 elements have more
volumes to keep than displacements to keep them with, and P2 elements hardly less. They answer with
displacements that are too small and with pressures that change from element to element without any
sense (Babuska, Suri, Numer. Math. 62 (1992) 439-463; Hughes, The Finite Element Method, 4.3), while
shear stresses stay smooth. So p = lambda div u and the deviatoric stress s = 2 mu dev(eps) are
compared with their averages over the elements round each vertex, linear in between; with the norms
over the nearly incompressible part,

    osc p = ||p - avg p||, osc s = ||s - avg s||, in energy osc p^2 / lambda and osc s^2 / (2 mu).

An element free of locking has both of like size for any ratio lambda / mu. It locks where osc p is
a noticeable part of all stress and either holds `DOMINANCE` times the energy of osc s or is larger
than s itself (on coarse meshes osc s cannot follow any more). On the model example with nu = 0.49,
0.499, 0.4999 its displacements are too small by 6 to 48% on meshes where nu = 0.3 errs by 0.7 to
16%. Quadratic elements, whose shear stresses are better, lock where a noticeable osc p is `TIMES`
as large as osc s: on the scene hard/block it is 3.3 times at nu = 0.49, 5 to 10 times beyond, where
contact pressures err by as much as osc p says, 25 to 50%; P2-mixed has 0.9 to 1.2 at any nu.
"""

import numpy as np

from ..energy_norm.recovery import vertex_sums
from ..scene import elements, kinematics
from ..text import percent

NEARLY_INCOMPRESSIBLE = 10.0  # lambda / mu: Poisson's ratio 0.4545; the loss grows like its root
DOMINANCE = 4.0
TIMES = 3.0
NOTICEABLE = 0.1
MIXED = "P2-mixed"  # the element that does not lock
UNSEEN = 1e-3  # part of a load by which quadrature may change it without a word
# of what it changes: the error of a resultant whose load jumps somewhere in an edge, 90 of 100
SOME_TIMES = 3.0
FAR = 1e3  # body lengths from the origin: three digits


def warnings(problem, step) -> list[str]:
    """Warnings about the solved `problem` and its finished `step`, if any; collective."""
    return [*problem.manifest.notes, *(locking(problem, step) if step else []),
            *lost_digits(problem), *unseen_loads(problem)]


def unseen_loads(problem) -> list[str]:
    """A line for every load that jumps, or bends much, between the quadrature points of edges.

    Five points an edge would find other nodal forces than three: the sizes of the differences, over
    those of the forces, tell that edges miss or double some of the load, and its order of size.
    """
    return [f"load{number} jumps inside an edge, or is too steep for the mesh: integration with "
            f"three and five points per edge differs by {percent(part)} of its forces, and the "
            "error of its resultant is that large or a few times larger; let the load end where a "
            "label ends, or refine the mesh there"
            for number, part in _unseen(problem)]


def lost(problem) -> float:
    """Part by which a load may err, as its edges miss or double some of it; collective."""
    return SOME_TIMES * max((part for _, part in _unseen(problem)), default=0.0)


def _unseen(problem) -> list[tuple[int, float]]:
    """Numbers of the loads that quadrature changes, and by what part of their forces."""
    subs, found = problem.structure.subdomains, []
    for k, pattern in enumerate(problem.manifest.patterns):
        if pattern["given_on"] != "edges":
            continue
        parts = [(float(sub.unseen[k]), float(np.abs(sub.loads[k]).sum())) for sub in subs]
        everywhere = problem.operator.comm.allgather(parts)
        unseen, force = np.sum([part for parts in everywhere for part in parts], axis=0)
        if unseen > UNSEEN * force:
            found.append((pattern["amplitude"], unseen / max(force, unseen)))
    return found


def locking(problem, step) -> list[str]:
    """One line if the elements lock in `step`; costs nothing where material or element cannot."""
    structure, manifest, comm = problem.structure, problem.manifest, problem.operator.comm
    if manifest.element == MIXED:
        return []
    isotropic = manifest.material == "isotropic" and manifest.plane == "strain"
    if not isotropic:
        return []
    soft = [sub.elasticity[:, 0, 1] >= NEARLY_INCOMPRESSIBLE * sub.elasticity[:, 2, 2]
            for sub in structure.subdomains]
    if not comm.allreduce(int(sum(map(np.count_nonzero, soft)))):
        return []
    problem.operator.follow(step)
    fields = problem.operator.deformations(step.multipliers, step.weights)
    parts = [_stresses(sub, some, u) for sub, some, u in zip(structure.subdomains, soft, fields)]
    linear = manifest.element == "P1"
    osc_p, osc_s, p, s, energy_p, energy_s = _oscillation(parts, manifest.nodes, linear, comm)
    noticeable = osc_p > NOTICEABLE**2 * (p + s) > 0
    larger = osc_p > TIMES**2 * osc_s
    if linear:
        larger = energy_p > DOMINANCE * energy_s or osc_p > s
    if not (noticeable and larger):
        return []
    change = 100 * np.sqrt(osc_p / (p + s))
    return [f"step {step.index}: {manifest.element} elements lock in the nearly incompressible "
            f"material: its pressure changes from element to element by {change:.0f} % of the "
            "stress; displacements are too small and contact pressures oscillate unless the mesh "
            f"is much finer; ELEMENT={MIXED} does not lock"]


def _stresses(sub, soft, u):
    """Vertices (n, 3), areas, lambda, mu (n,), p and s (n, 3 corners, 5) of triangles `soft`."""
    corner = sub.corner[soft]
    lam, mu = sub.elasticity[soft, 0, 1], sub.elasticity[soft, 2, 2]
    if sub.axisymmetric:
        strain = kinematics.linear_strains(sub, u)[soft]
        third = strain[..., 3]
        volume = strain[..., 0] + strain[..., 1] + third
    else:
        strain = elements.linear_strains(corner, u.reshape(-1, 2)[sub.elements[soft]])
        third, volume = 0.0, strain[..., 0] + strain[..., 1]
    # the shear stress times the root of two, so that squares add up to s : s
    s = np.stack([strain[..., 0] - volume / 3, strain[..., 1] - volume / 3, third - volume / 3,
                  strain[..., 2] / np.sqrt(2)], axis=-1)
    s = 2 * mu[:, None, None] * s
    stress = np.concatenate([(lam[:, None] * volume)[..., None], s], axis=-1)
    return sub.node_gid[sub.triangles[soft]], elements.areas(corner), lam, mu, stress


def _oscillation(parts, nodes: int, constant: bool, comm) -> np.ndarray:
    """(6,) squares of osc p, osc s, p, s and the energies of both oscillations in the body.

    Where stresses are `constant` on the elements, averages are compared with them at the centroids.
    """
    places, weights = elements.POINTS, elements.WEIGHTS
    if constant:
        places, weights = elements.CENTER, np.ones(1)
    sums = [vertex_sums(vertex, area, stress, nodes) for vertex, area, _, _, stress in parts]
    total = comm.allreduce(sum(sums, np.zeros((nodes, 6))))
    average = total[:, 1:] / np.where(total[:, :1] > 0, total[:, :1], 1)
    squares = np.zeros(6)
    for vertex, area, lam, mu, stress in parts:
        change, size = (np.einsum("t,m,tmi->ti", area, weights, (places @ values) ** 2)
                        for values in (stress - average[vertex], stress))
        squares += [change[:, 0].sum(), change[:, 1:].sum(), size[:, 0].sum(), size[:, 1:].sum(),
                    (change[:, 0] / lam).sum(), (change[:, 1:].sum(axis=1) / (2 * mu)).sum()]
    return comm.allreduce(squares)


def lost_digits(problem) -> list[str]:
    """One line if the body is too far from the origin for the digits of its coordinates."""
    subdomains, comm = problem.structure.subdomains, problem.operator.comm
    xy = np.concatenate([np.empty((0, 2)), *(sub.xy for sub in subdomains)])
    ends = np.array(comm.allgather([xy.min(axis=0, initial=np.inf),
                                    xy.max(axis=0, initial=-np.inf)]))
    low, high = ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)
    away = np.abs([low, high]).max(axis=0) / (high - low).max()
    distance = away.max()
    if distance < FAR:
        return []
    lost = np.log10(distance)
    its_radius = problem.manifest.axisymmetric and away[0] >= FAR
    remedy = ("such a ring is straight, take axisymmetric out" if its_radius
              else "move it to the origin")
    return [f"the body is {distance:.0e} times its length away from the origin: {lost:.0f} of the "
            f"16 digits of its coordinates describe its position instead of its shape; {remedy}"]
