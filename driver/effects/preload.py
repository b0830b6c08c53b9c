"""The body starts from its equilibrium without friction under the loads at time 0."""

import numpy as np

from ..errors import NotConverged
from . import initial_state


class Room(initial_state.Room):
    """Solves one step without friction, whose tangential displacement becomes u_0."""

    summary = {"initial": "preload"}

    def initial_displacement(self, contact) -> None:
        """Known before the first step only."""

    def before_first_step(self, solver) -> None:
        """Multipliers, motions and tangential displacements become those of the equilibrium.

        Raises NotConverged where bodies without support do not come to rest, Unfinished where the
        QP fails.
        """
        op, rows, settings = solver.operator, solver.rows, solver.settings
        x, without_friction = np.zeros(op.owned), np.zeros(len(rows.tangential))
        load = solver.load(0, solver.motion, np.zeros(op.owned))
        solver.scales.renew(d=load.extent)
        solver.qp.aim(1.0)
        for iteration in range(1, settings.max_fixed_point + 1):
            limits = rows.limits_at(op.owned, without_friction)
            result = solver.qp.solve(0, iteration, load.d, limits, np.clip(x, *limits), 0.0)
            x = result.x
            if solver.bodies.imbalance(load, x) > settings.friction_rtol:
                solver.bodies.follow(load, x)
            elif rows.corners is None or not rows.corners.switch(
                    x, result.gradient, None, solver.qp.scale, solver.qp.tol, op.comm):
                break
        else:
            raise NotConverged(
                f"preload: no equilibrium of the free bodies in {iteration} iterations")
        if rows.corners is not None:
            rows.corners.end_step(x, result.gradient, None, op.deformation(
                x, load.weights), op.comm)
        solver.multipliers, solver.motion = x, load.weights[op.structure.patterns :]
        gradient = result.gradient - solver.bodies.settle(load, x, result.gradient)
        solver.slip.advance(x, gradient, load.weights, solver.scales)
        u_t = np.zeros(len(solver.initial))
        u_t[rows.tangential_node] = solver.slip.u_t
        solver.initial[:] = np.sum(op.comm.allgather(u_t), axis=0)
        solver.initial_weights[:] = load.weights[: op.structure.patterns]
