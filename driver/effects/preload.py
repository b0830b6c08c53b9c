"""The body starts from its equilibrium without friction under the loads at time 0."""

import numpy as np

from . import initial_state


class Room(initial_state.Room):
    """Solves one step without friction, whose tangential displacement becomes u_0."""

    summary = {"initial": "preload"}

    def initial_displacement(self, contact) -> None:
        """Known before the first step only."""

    def before_first_step(self, solver) -> None:
        """Multipliers, motions and tangential displacements become those of the equilibrium.

        Raises NoSolution where contact alone cannot hold a body, Unfinished where no equilibrium
        is come to.
        """
        op, rows = solver.operator, solver.rows
        x, gradient, load = solver.without_friction()
        if rows.corners is not None:
            deformation = op.deformation_by_level(x, load.weights)[op.row_level]
            rows.corners.end_step(x, gradient, None, deformation, op.comm)
        solver.multipliers, solver.motion = x, solver.bodies.place(load)
        solver.slip.advance(x, gradient, load.weights, solver.scales)
        u_t = np.zeros(len(solver.initial))
        u_t[rows.tangential_node] = solver.slip.u_t
        solver.initial[:] = np.sum(op.comm.allgather(u_t), axis=0)
        solver.initial_weights[:] = load.weights[: op.structure.patterns]
