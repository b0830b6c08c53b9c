"""Whether a step has a solution, by one mixed-integer program over the states of the contact nodes.

Complementarity as alternatives that binary variables choose (J. Fortuny-Amat, B. McCarl, J. Oper.
Res. Soc. 32 (1981) 783-792): a node is open or closed, it sticks or slides one way or the other.
Alternatives need bounds, so forces and ways are limited to `MOST` times those that loads and gaps
make, which the search of states.py does without; but limits let the program cut whole regions off,
and it comes to an end where that search does not.
"""

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_matrix

from ..environment import PLAIN_PROGRAM, silenced
from .states import States

MOST = 100.0  # with the program's own tolerance of 1e-6 a binary leaves 1e-4 of the loads' forces
INFEASIBLE = 2  # status of scipy's programs


class _Program:
    """Rows and limits of a program whose variables come in named blocks."""

    def __init__(self, **sizes: int):
        first = np.cumsum([0, *sizes.values()])
        self.place = dict(zip(sizes, first))
        self.size, self.rows, self.low, self.high = first[-1], [], [], []

    def add(self, low: float, high: float, *terms: tuple[str, int | slice, float]) -> None:
        """low <= sum of the terms <= high; a term is a block, which of it and the factors."""
        row = np.zeros(self.size)
        for block, which, factor in terms:
            here = slice(self.place[block], self.place[block] + np.size(factor)) if isinstance(
                which, slice) else self.place[block] + which
            row[here] += factor
        self.rows.append(row)
        self.low.append(low)
        self.high.append(high)


def none_within(states: States, nodes: int) -> bool:
    """Whether no states solve the step with forces and ways of at most MOST.

    False if unknown: it does, or `nodes` nodes of the program's tree do not decide.
    """
    n, m = len(states.room), len(states.load)
    program = _Program(force=n, along=n, motion=m, pull=n, closed=n, forth=n, back=n, rests=n,
                       pulling=n)
    for node in range(n):
        _contact(program, states, node)
        _friction(program, states, node)
    for motion, load in zip(states.balance, states.load):
        program.add(-load, -load, ("force", slice(None), -motion[:n]),
                    ("pull", slice(None), motion[:n]), ("along", slice(None), motion[n:]))
    count, binary = 3 * n + m, 5 * n
    least, most = np.zeros(program.size), np.ones(program.size)
    most[:count] = MOST
    least[n : 2 * n + m], most[n : 2 * n + m] = -np.inf, np.inf
    most[program.place["pull"] : count][~states.pulls] = 0.0
    with silenced():
        answer = milp(np.zeros(program.size), bounds=Bounds(least, most),
                      integrality=np.repeat([0, 1], [count, binary]),
                      constraints=LinearConstraint(csr_matrix(np.array(program.rows)),
                                                   program.low, program.high),
                      options={**PLAIN_PROGRAM, "node_limit": nodes})
    return answer.status == INFEASIBLE


def _moved(states: States, row: int) -> list:
    """Terms of a row of movement: presses are forces along -n, pulls along n."""
    n, line = len(states.room), states.movement[row]
    return [("force", slice(None), -line[:n]), ("pull", slice(None), line[:n]),
            ("along", slice(None), line[n : 2 * n]), ("motion", slice(None), line[2 * n :])]


def _way(states: States, row: int) -> float:
    """Limit of a row's way: a stiff node in its own units goes far with soft ones."""
    given = np.append(states.room, states.start)[row]
    return MOST * max(1.0, np.abs(states.movement[row]).max(), np.nan_to_num(abs(given), posinf=0))


def _contact(program: _Program, states: States, node: int) -> None:
    """Nothing overlaps; what presses is closed, what pulls by the law of the node."""
    room, moved, way = states.room[node], _moved(states, node), _way(states, node)
    if states.pulls[node]:
        if np.isfinite(room):
            program.add(room, room, *moved)
        program.add(-np.inf, 0.0, ("pull", node, 1.0), ("pulling", node, -MOST))
        program.add(-np.inf, MOST, ("force", node, 1.0), ("pulling", node, MOST))
        return
    program.add(-np.inf, 0.0, ("force", node, 1.0), ("closed", node, -MOST))
    if np.isfinite(room):
        program.add(-np.inf, room, *moved)
        program.add(room - way, np.inf, *moved, ("closed", node, -way))


def _friction(program: _Program, states: States, node: int) -> None:
    """Inside the cone; slip only forth against the least force, back likewise, or at rest."""
    inf, offset = np.inf, states.offset[node]
    for sign in (1.0, -1.0):
        program.add(-inf, offset, ("along", node, sign), ("force", node, -states.most[node]),
                    ("pull", node, -states.most[node]))
    row, start = len(states.room) + node, states.start[node]
    slip, way = _moved(states, row), _way(states, row)
    program.add(-inf, start, *slip, ("forth", node, -way), ("rests", node, -way))
    program.add(start, inf, *slip, ("back", node, way), ("rests", node, way))
    program.add(-inf, 1.0, ("forth", node, 1.0), ("back", node, 1.0), ("rests", node, 1.0))
    least, large = states.least[node], 2 * (states.most[node] * MOST + offset)
    for way, sign in (("forth", 1.0), ("back", -1.0)):
        program.add(-inf, large - offset, ("along", node, sign), ("force", node, least),
                    ("pull", node, least), (way, node, large))
    others = states.corners[node]
    if not others.any():
        program.add(0.0, 0.0, ("rests", node, 1.0))
    elif offset == 0:
        for other in np.flatnonzero(others | (np.arange(len(others)) == node)):
            if not states.pulls[other]:
                program.add(-inf, 0.0, ("rests", node, 1.0), ("closed", other, -1.0))
