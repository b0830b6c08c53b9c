"""Contact between bodies linearized again, about the problem's own solution.

The distance of two boundaries, the normals and the parts that face each other depend on the
displacements. The first linearization takes them from the initial geometry. What it neglects is of
second order: a boundary of radius R that slides by s along the other moves away from its tangent by
s^2/2R, and its normals turn by s/R. Here a first run of the load history gives displacements w; the
distance and its derivative at w make the conditions of a second one,

    n_w . ([u] - [w]) <= g_w,     [u] = u - u* o pi_w,

with normals n_w, projection pi_w and distance g_w of the boundaries displaced by w (see Wriggers,
Computational Contact Mechanics (2006), 4.1, 6.3; Laursen (2002)). What is left is of second order
in the distance of the two solutions. Stresses stay those of small strains and refer to the initial
geometry, lengths included.
"""

import dataclasses

from ..errors import InputError, error_of
from ..feti.operator import DualOperator
from ..march.problem import Problem
from ..march.step import StepFailed
from ..march.tearing import build
from ..options import Settings
from .record import Record


def linearized(problem: Problem, settings: Settings, comm) -> Problem:
    """The problem with pairs linearized as `settings.linearization` says; collective.

    "updated": about the displacements of a run about the initial geometry, at the step that its
    quantities of interest belong to (the last one, or where contact is lost by then that in which
    it carries most). Raises InputError where no bodies meet, DriverError of that run.
    """
    manifest, structure = problem.manifest, problem.structure
    if settings.linearization == "initial":
        return problem
    if structure.contact.following is not None:
        raise InputError("LINEARIZATION=updated and largeSliding: contact follows the motion "
                         "already; leave LINEARIZATION out")
    if not manifest.contact_pairs:
        raise InputError("LINEARIZATION=updated is about contact between bodies: "
                         "the scene declares no contactPair")
    solver = problem.solver(dataclasses.replace(settings, uniqueness="no"))
    record, steps = Record(problem.operator, solver), []
    try:
        for step in solver.steps():
            record.add(step)
            steps.append(step)
    except StepFailed as failure:
        reason = f"with contact as in the initial geometry: {failure}"
        raise error_of(failure.exit_status, reason) from None
    step = steps[record.quantities()[1]]
    moved = problem.operator.displacements(step.multipliers, step.weights)
    structure = build(manifest, structure.subdomains, structure.first, comm, moved)
    return Problem(manifest, structure, DualOperator(structure, comm))
