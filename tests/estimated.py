"""Fixtures: estimates of a last step, meshes cut into finer ones, budgets without prices."""

import dataclasses

import pytest
from mpi4py import MPI

from bounds import SCENES, Recording, with_gap
from driver import environment
from driver.energy_norm.torn_body import Gather, gather_body
from driver.estimates import adjoint
from driver.estimates.companions import Companions, assess
from driver.estimates.levels import Levels
from driver.march.problem import assemble
from driver.options import Settings
from driver.results.contact_state import ContactState
from driver.scene import freefem


@pytest.fixture(scope="session")
def estimated(built, steps_of):
    """estimated(scene, settings, change, kind, gap, **parameters): problem, bound and estimate of
    the last step.

    `change`, if given, gets the last step and may spoil it before it is estimated; `gap`, if given,
    is the contact boundary of a coarser mesh, whose gaps between bodies shall be those of this one
    too, linear between its nodes.
    """
    made = {}

    def make(scene="model", settings=(), kind="equilibrated", change=None, gap=None, **parameters):
        key = (str(scene), tuple(settings), kind, change, id(gap),
               tuple(sorted(parameters.items())))
        if key not in made:
            problem = built(scene, **parameters)
            if gap is not None:
                problem = with_gap(problem, gap)
            solver, steps = steps_of(problem, **dict(settings))
            contact = ContactState(problem.operator, solver)
            estimator = Recording(problem.operator, problem.manifest, contact, kind)
            for step in steps:
                if change and step is steps[-1]:
                    change(step, solver)
                fields = problem.operator.displacements(step.multipliers, step.weights)
                estimator.consider(step, contact.evaluate(step, fields), step.index)
            estimate = dict((s.index, found) for s, found in estimator.estimates())[len(steps)]
            bound = estimator.bound or estimator
            bound.last = estimator.last
            made[key] = problem, bound, estimate
        return made[key]

    return make


@pytest.fixture(scope="session")
def split(tmp_path_factory):
    """split(scene, n): a scene whose mesh is that of `scene` with every side cut into n."""
    folder = tmp_path_factory.mktemp("split")

    def make(scene, n):
        def here(path):
            return path.read_text().replace("../meshes", str(environment.ROOT / "meshes"))

        text = here(SCENES / f"{scene}.edp")
        mesh = f"for (int k = 0; k < bodyCount; ++k) bodies[k] = trunc(bodies[k], 1, split = {n});"
        if "addBody" not in text and "addDiscs" not in text:
            mesh = f"body = trunc(body, 1, split = {n});"
        path = folder / f"{scene}-{n}.edp"
        path.write_text(text.replace('include "export.idp"', f'{mesh}\ninclude "export.idp"'))
        (folder / "two-discs.idp").write_text(here(SCENES / "lib" / "two-discs.idp"))
        return path

    return make


@pytest.fixture(scope="session")
def budget_of(exported, tmp_path_factory):
    """budget_of(scene, **options): entry `errors` of the summary of such a run, without the price
    list, whose companions take more than all others.
    """
    names = {field.name for field in dataclasses.fields(Settings)}
    made = {}

    def make(scene="model", **options) -> dict:
        key = str(scene), *sorted(options.items())
        if key not in made:
            settings = Settings(**{"uniqueness": "no"} | {
                name: value for name, value in options.items() if name in names})
            parameters = {name: str(value) for name, value in options.items() if name not in names}
            path = freefem.find_scene(str(scene))
            levels = Levels(path, parameters, tmp_path_factory.mktemp("levels"), MPI.COMM_SELF,
                            settings)
            problem = assemble(exported(scene, **parameters), MPI.COMM_SELF)
            levels.problems[()] = problem
            run, entry = levels.run(settings), {}
            adjoints = adjoint.assess(problem, run.record, run.steps[run.at], run.values,
                                      lambda: gather_body(Gather(problem.operator)))
            assess(entry, Companions(levels, problem, settings, run.record, (adjoints[0], {}),
                                     step=run.steps[run.at]))
            levels.close()
            made[key] = entry
        return made[key]

    return make
