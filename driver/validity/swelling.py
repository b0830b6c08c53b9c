"""What bodies grow by as they turn, where contact holds them from two sides.

A rotation theta that is taken for small lengthens every distance, by theta^2/2 of it. A body that
may grow does so without a stress. One that is held between others, as a roller between two plates,
is squeezed by it: of steel, which bears strains of a thousandth, theta = 0.05 makes as much. Where
what presses it is free to give way, as a plate that rests on a roller, loads alone make the force.
What presses it is squeezed as well, and the more the softer it is: a part is of all of that.
"""

from dataclasses import dataclass

import numpy as np

from ..contact.states import OPEN, ContactField
from ..scene import elements
from ..scene.kinematics import mean_thermal
from ..vectors import turned_left

OPPOSED = 0.1  # of the forces from one side, up to which those from the other do not hold a body
ALONG = 0.1  # part of a rigid motion along a direction, above which it gives way there
JOINTS = {"tie", "periodic"}  # may hold a body that has no support


def holders(structure, manifest, member: np.ndarray,
            body: np.ndarray) -> tuple[dict[int, list[int]], dict[int, list]]:
    """`partners` and `free` of `of_bodies`; `member` (total,) and `body` (nodes,): numbers of the
    bodies of all subdomains and nodes.
    """
    edges, partners, free = structure.outer_edges, {}, {}
    for one, two in manifest.contact_pairs:
        partners.setdefault(one, []).extend(
            np.unique(body[edges[edges[:, 2] == two, 0]]).tolist())
    for mode in () if JOINTS & set(manifest.rooms) else structure.rigid_modes:
        free.setdefault(int(member[mode.members[0]]), []).append(mode)
    return partners, free


def expansions(problem, member: np.ndarray, weights: np.ndarray) -> np.ndarray | None:
    """(bodies,) by which part of their length bodies would grow by their temperature if nothing
    held them, on the mean, None without thermal strains; `member` as above, `weights` (patterns,)
    of the step. Collective.
    """
    if "thermal_strain" not in problem.manifest.rooms:
        return None
    structure, comm = problem.operator.structure, problem.operator.comm
    sums = np.zeros((2, structure.total))
    for sub in structure.subdomains:
        area = elements.areas(sub.corner)
        sums[0, sub.index] = area.sum()
        for pattern, suppressed in mean_thermal(sub).items():
            strain = np.linalg.solve(sub.elasticity, suppressed[..., None])[..., 0]
            sums[1, sub.index] += weights[pattern] * (area @ strain[:, :2].mean(axis=1))
    area, grown = (np.bincount(member, values) for values in comm.allreduce(sums))
    return grown / np.where(area > 0, area, 1.0)


def of_bodies(boundary, state: dict, moved: np.ndarray, body: np.ndarray, turns: np.ndarray,
              partners: dict[int, list[int]], free: dict[int, list] | None = None,
              grown: np.ndarray | None = None
              ) -> list[tuple[float, np.ndarray, dict, np.ndarray]]:
    """Of every body that contact holds: the part of its squeeze that comes of its turning, the
    contact nodes (k,) that hold it, by how much it turns, and where (2,) it is held.

    `boundary` and `state` of the contact nodes, `moved` (nodes, 2) displacements, `body` (nodes,)
    numbers of the nodes' bodies, `turns` (bodies,) their mean rotations, `partners` the bodies that
    each first label of pairs meets. Of a label that meets several bodies these are left out.
    `free`: of bodies without full support, the RigidModes that nothing but contact holds. `grown`
    (bodies,) as `expansions` has it.
    """
    closed = np.flatnonzero(state[ContactField.STATUS] != OPEN)
    own, label = body[boundary.gid[closed]], boundary.label[closed].tolist()
    met = [partners.get(name, []) if paired else []
           for name, paired in zip(label, boundary.paired[closed].tolist())]
    other = np.array([bodies[0] if len(bodies) == 1 else -1 for bodies in met], int)
    normal, u = boundary.normal[closed], moved[boundary.gid[closed]]
    force = (state[ContactField.SIGMA_N] * boundary.weight)[closed, None] * normal
    jump = (state[ContactField.U_N][closed, None] * normal
            + state[ContactField.U_T][closed, None] * turned_left(normal))
    sides = _Sides(own, other, boundary.xy[closed], force, free or {})
    count = np.maximum(np.bincount(body, minlength=len(turns)), 1)
    mean = np.column_stack([np.bincount(body, way, len(turns)) / count for way in moved.T])
    # what bodies are displaced by where they are pressed beyond what they are on the whole
    of_other = np.where(other[:, None] >= 0, u - jump - mean[other], 0.0)
    of_own, found = u - mean[own], []
    for k in np.unique(np.concatenate([own, other[other >= 0]])):
        first, second = np.flatnonzero(own == k), np.flatnonzero(other == k)
        xy, pressed, beside = sides.of(k)
        turned = np.abs(np.where(beside >= 0, turns[beside], 0.0)).min()
        part = share(xy, np.concatenate([u[first], (u - jump)[second]]), pressed, turns[k], turned,
                     np.concatenate([of_other[first], of_own[second]]),
                     0.0 if grown is None else grown[k])
        if part:
            direction = _direction(pressed)
            if sides.give_way(k, direction) or sides.give_way(k, -direction):
                part = 0.0
        nodes = closed[np.concatenate([first, second])]
        found.append((part, nodes, {"turn": abs(float(turns[k]))}, xy[0]))
    return found


@dataclass(frozen=True)
class _Sides:
    """Contact of bodies `own` with bodies `other` (n,), -1 for obstacles, at places `xy` (n, 2) by
    forces (n, 2) on `own`; `free` as above.
    """

    own: np.ndarray
    other: np.ndarray
    xy: np.ndarray
    force: np.ndarray
    free: dict[int, list]

    def of(self, body: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places (m, 2), forces on the body (m, 2) and what presses it there (m,)."""
        first, second = np.flatnonzero(self.own == body), np.flatnonzero(self.other == body)
        return (self.xy[np.concatenate([first, second])],
                np.concatenate([self.force[first], -self.force[second]]),
                np.concatenate([self.other[first], self.own[second]]))

    def give_way(self, body: int, direction: np.ndarray, beyond: tuple = ()) -> bool:
        """Whether all that presses a body along a direction (2,), but for those in `beyond`, gives
        way to it: bodies free to move back, which nothing else presses that does not.
        """
        xy, force, beside = self.of(body)
        along = np.where(np.isin(beside, beyond), 0.0, np.maximum(force @ direction, 0.0))
        held = 0.0
        for k in np.unique(beside[along > 0]).tolist():
            part = np.where(beside == k, along, 0.0)
            moves = [mode.displacement((part @ xy / part.sum())[None])[0]
                     for mode in self.free.get(k, ())]
            free = any(abs(u @ direction) > ALONG * np.linalg.norm(u) for u in moves)
            if not free or not self.give_way(k, direction, (*beyond, body)):
                held += part.sum()
        return held <= OPPOSED * along.sum()


def _direction(force: np.ndarray) -> np.ndarray:
    """(2,) along which most of the forces (n, 2) act."""
    return np.linalg.eigh(force.T @ force)[1][:, -1]


def share(xy: np.ndarray, u: np.ndarray, force: np.ndarray, turn: float, beside: float,
          given: np.ndarray, grown: float = 0.0) -> float:
    """Part of the squeeze between forces (n, 2) at places `xy` (n, 2) with displacements u (n, 2)
    that comes of the rotation `turn` of the body, where what holds it turns by `beside` at least
    and is deformed by `given` (n, 2) there, and its temperature lengthens it by the part `grown`.

    0 where the forces come from one side.
    """
    direction = _direction(force)
    along = force @ direction
    weights = [np.maximum(along, 0.0), np.maximum(-along, 0.0)]
    total = np.array([weight.sum() for weight in weights])
    if total.min() <= OPPOSED * total.max():
        return 0.0
    (place, other), (way, way_of_other), yielded = (
        [weight @ values / weight.sum() for weight in weights] for values in (xy, u, given))
    apart = other - place
    squeeze = abs((way_of_other - way - turn * turned_left(apart[None])[0]) @ direction)
    squeeze += abs(grown * (apart @ direction))
    squeeze += sum(abs(way @ direction) for way in yielded)
    growth = abs(apart @ direction) * max(turn**2 - beside**2, 0.0) / 2
    return float(growth / squeeze) if squeeze > 0 else 0.0
