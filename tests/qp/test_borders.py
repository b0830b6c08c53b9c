"""Solutions on the border between sticking and sliding, of a thin belt round half of a drum."""

import numpy as np

from driver.qp.coulomb import CoulombProblem
from driver.qp.one_solution import only_solution

NODES = 60
RADIUS, YOUNG, THICKNESS, FRICTION = 50.0, 200.0, 1.0, 0.2


def bar_in_bending(along: np.ndarray) -> np.ndarray:
    """(6, 6) stiffness of a straight bar of the belt, for (u_x, u_y, turn) at both ends."""
    length = np.hypot(*along)
    c, s = along / length
    a, b = YOUNG * THICKNESS / length, YOUNG * THICKNESS**3 / 12 / length**3
    local = np.zeros((6, 6))
    local[np.ix_([0, 3], [0, 3])] = a * np.array([[1, -1], [-1, 1]])
    local[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = b * np.array(
        [[12, 6 * length, -12, 6 * length],
         [6 * length, 4 * length**2, -6 * length, 2 * length**2],
         [-12, -6 * length, 12, -6 * length],
         [6 * length, 2 * length**2, -6 * length, 4 * length**2]])
    turned = np.kron(np.eye(2), [[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return turned.T @ local @ turned


def belt() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compliance (2n, 2n) at the drum, movements (2n,) by a unit pull at the slack end, which is
    free, and by a unit way of the other one, which is clamped.
    """
    angle = np.linspace(np.pi, 0, NODES + 1)
    place = RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    stiffness = np.zeros((3 * NODES + 3,) * 2)
    for first in range(NODES):
        dofs = 3 * first + np.arange(6)
        stiffness[np.ix_(dofs, dofs)] += bar_in_bending(place[first + 1] - place[first])
    free = slice(0, 3 * NODES)
    normal = -place[:-1] / RADIUS
    rows = np.zeros((2 * NODES, 3 * NODES))
    for node in range(NODES):
        rows[node, 3 * node : 3 * node + 2] = normal[node]
        rows[NODES + node, 3 * node : 3 * node + 2] = -normal[node, 1], normal[node, 0]
    pull, way = np.zeros(3 * NODES), np.zeros(3 * NODES + 3)
    pull[1], way[-2] = -1.0, -1.0
    moved = np.linalg.solve(stiffness[free, free],
                            np.column_stack([rows.T, pull, -(stiffness @ way)[free]]))
    moved = rows @ moved
    compliance = moved[:, :-2]
    return (compliance + compliance.T) / 2, moved[:, -2], moved[:, -1]


def test_what_comes_to_a_halt_stays_on_its_bound():
    """A belt that has slid towards its slack end begins to slide back: behind the front of that
    nodes stick with the friction that they slid with, in every step exactly at its bound.
    """
    compliance, pull, way = belt()
    x, before, friction = np.zeros(2 * NODES), np.zeros(NODES), np.full(NODES, FRICTION)
    for length in (0.0, 0.02, 0.04, 0.06):
        load = pull + length * way
        load[NODES:] -= before
        problem = CoulombProblem(compliance, load, friction, np.arange(NODES))
        x = only_solution(problem, x)
        movement = problem.movement(x)
        before = before + movement[NODES:]
        # sums of 2n terms, relative to what the bounds are; by movements that round off 1e-11 they
        # would be missed by 3e-9, which is 2e-6 of a bound
        bound = problem.bounds(x)
        assert (np.abs(x[NODES:]) <= (1 + 1e-12) * bound).all(), length
        # slip of the wrong sign is at most what nodes within 1e-4 of their bounds, all those of a
        # front, would slide more if they did: 1e-4 of what its tractions stretch the belt by
        stretch = 1e-4 * bound.sum() * np.pi * RADIUS / (YOUNG * THICKNESS)
        against = np.where(np.abs(x[NODES:]) < bound, np.abs(movement[NODES:]),
                           -np.sign(x[NODES:]) * movement[NODES:])
        assert against.max() <= stretch
