"""Resultants of loads, support reactions and contact forces, and their balance."""

import numpy as np

from ..contact.states import ContactField
from ..feti.operator import DualOperator
from ..march.step import Step
from ..scene import springs
from .contact_state import HELD


def resultants(operator: DualOperator, step: Step, displacements: list[np.ndarray],
               inner: list[np.ndarray], contact: dict) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Resultants (2,) of loads, reactions and obstacles' forces, which add up to zero; `size`.

    `displacements` less the travel and `inner` forces K u (dofs,) of the rank's subdomains;
    springs react as supports do. `contact` the quantities of the
    contact nodes. `size` (2,) is the sum of the absolute values of all these nodal forces: the
    measure of their balance, because resultants themselves may vanish. A support takes what K u
    leaves after load and contact forces, and the friction of contact nodes that it holds along the
    boundary. Collective.
    """
    structure, totals = operator.structure, np.zeros((len(inner), 3, 2))
    forces = operator.forces_on_supports(step.multipliers)
    for s in operator.acting:
        sub, force, total = structure.subdomains[s], inner[s], totals[s]
        load = step.weights[: structure.patterns] @ sub.loads
        reaction = (force - load)[structure.fixed[s]] + forces[s]
        component = sub.dof_component[structure.fixed[s]]
        total[0] += np.bincount(sub.dof_component, load, minlength=2)
        total[1] += np.bincount(component, reaction, minlength=2)
        total[2] += np.bincount(sub.dof_component, np.abs(load), minlength=2)
        total[2] += np.bincount(component, np.abs(reaction), minlength=2)
        if sub.springs is not None:
            sprung = springs.forces(sub, displacements[s])
            total[1] += np.bincount(sub.dof_component, sprung, minlength=2)
            total[2] += np.bincount(sub.dof_component, np.abs(sprung), minlength=2)
    # summed in the order of the subdomains on any number of ranks
    load, reaction, size = np.concatenate(operator.comm.allgather(totals)).sum(axis=0)
    b = structure.contact.declared
    weight = np.where(b.paired, 0.0, b.weight)  # forces between two bodies cancel
    force = ((contact[ContactField.SIGMA_N] * weight)[:, None] * b.normal
             + (contact[ContactField.SIGMA_T] * weight)[:, None] * b.tangent)
    rubs = np.where(b.paired, 0.0, contact[HELD])[:, None] * b.tangent
    reaction = reaction + rubs.sum(axis=0)
    forces = {"load": load, "reaction": reaction, "contact": force.sum(axis=0)}
    return forces, size + np.abs(force).sum(axis=0)
