"""Stage: the search for settings that reach an accuracy, and the results of its finest run."""

import dataclasses
import json
import time
from pathlib import Path

from ..errors import DriverError, NoSolution, error_of
from ..estimates import between_steps
from ..estimates.budget_words import share
from ..estimates.successive import mesh_parts
from ..results.summary import largest_memory
from . import goal, trials
from .request import Request
from .watch import Watch


def run(directory: Path, request: Request, comm) -> tuple[int, str]:
    """Search and write the result into `directory`; exit status and reason, on every rank."""
    from ..estimates.levels import Levels
    from ..options import Settings

    clock = time.perf_counter()
    root = comm.rank == 0
    settings = Settings(**{"uniqueness": "no", **request.settings})
    levels = Levels(Path(request.script), {**request.parameters, "sampling": str(trials.SAMPLING)},
                    directory / "levels", comm, settings, without=request.without,
                    watch=Watch(request.scene, request.quiet or not root, search=True))

    def say(line: str) -> None:
        if root and not request.quiet:
            print(f"{request.scene}: {line}", flush=True)

    status, reason, search, idle = 0, "", None, largest_memory(comm)
    try:
        search = goal.Search(levels, settings, *request.accuracy, say)
        search.run()
    except DriverError as problem:
        status, reason = problem.exit_status, str(problem)
    try:
        if search is not None and "mesh" in search.parts:
            _write(directory, request, search, status, reason, clock, idle)
    finally:
        comm.barrier()
        levels.close()
    return status, reason


class Tried:
    """The meshes that a search has tried, as companions of its finest run for the price list."""

    def __init__(self, search: goal.Search, problem):
        """`problem` of the finest run, with the steps that were chosen."""
        self.search, self.levels, self.manifest = search, search.levels, problem.manifest
        self.settings = search.scaled(search.settings, search.stride)
        self.effects, self.knob = search.effects, search.knob
        self.meshes = [search.mesh(size) for size in search.sizes[:-4:-1]]
        self.base, self.values = self.meshes[1], search.values(search.sizes[-1])
        self.levels.problems[()] = problem
        self.strides = between_steps.Strides(self.effects, self.manifest, search.motion)

    def level(self, mesh: dict, stride: int = 1, quiet: bool = True):
        """A run on a mesh at every `stride`-th of the chosen steps, None if it fails."""
        try:
            if mesh in self.meshes:
                return self.search.level(mesh[self.knob], self.search.stride * stride)
            return self.levels.run(self.settings, self.search.stride * stride, **mesh)
        except DriverError:
            return None


def _claim_others(search: goal.Search) -> None:
    """The mesh's parts of quantities that were not asked for, as of an ordinary run: with their
    adjoint problems. Collective.
    """
    asked = {search.name: search.parts["mesh"][search.name]}
    search.parts["mesh"] = mesh_parts(*search.compared(), others=True) | asked


def _prices(search: goal.Search, problem, output: float, idle: float) -> dict:
    """Entry `prices` of the errors; `output`: seconds that the results took; collective."""
    from ..estimates.alternatives import price_list
    from ..estimates.prices import Measured

    key = tuple(sorted(search.mesh(search.sizes[-1]).items()))
    seconds = {"export": 0.0, "setup": 0.0, **search.levels.spent.get(key, {}), "output": output,
               "solve": search.level(search.sizes[-1]).seconds}
    return price_list(Tried(search, problem), search.claimed, search.budget(), search.name,
                      Measured.of(seconds, problem.manifest), idle)


def _write(directory: Path, request: Request, search: goal.Search, status: int, reason: str,
           clock: float, idle: float) -> None:
    """Results of the finest run, as an ordinary run leaves them."""
    from ..validity import assumptions
    from ..results import summary
    from ..results.writer import Writer
    from .solve import doubts

    _claim_others(search)  # no part of what results take
    begun, size, levels = time.perf_counter(), search.mesh(search.sizes[-1]), search.levels
    comm, level = levels.comm, search.level(search.sizes[-1])
    problem = _as_asked(search, levels.problem(**size))
    writer = Writer(directory, problem.manifest, problem.operator, level.solver, request.fields)
    states, energies = zip(*(writer.add(step) for step in level.steps))
    most = max(range(len(states)), key=energies.__getitem__)
    checked = {len(states) - 1, most, level.at}
    valid = assumptions.assess(problem, writer.contact,
                            [(level.steps[k], states[k]) for k in sorted(checked)])
    writer.close()
    level.solver.history.warnings += doubts(request, problem, level.solver,
                                            level.steps[most], search.motion)
    budget, chosen = search.budget(), search.chosen()
    entry = budget[search.name]
    settings = " ".join(f"{name}={value}" for name, value in chosen.items())
    advice = (f"{search.name.replace('_', ' ')} to {share(entry['total'], entry['value'])}, "
              f"asked for {100 * search.asked:g} %; the same settings by hand: {settings}")
    notes = list(filter(None, [search.others() if not status else ""]))
    errors = {"quantities": budget, "notes": notes, "advice": advice}
    reached = None if status == NoSolution.exit_status else entry["relative"]
    accuracy = {"quantity": search.name, "asked": search.asked, "reached": reached,
                "settings": chosen, "levels": len(search.sizes), "products": levels.products}
    failure = error_of(status, reason) if status else None
    output = time.perf_counter() - begun
    if request.errors == "yes" and not status:
        errors["prices"] = _prices(search, problem, output, idle)
    now = time.perf_counter()
    seconds = {"read": 0.0, **levels.seconds, "output": output, "total": now - clock}
    summary.write(directory, summary.summarize(
        request, problem, level.solver, failure, search.scaled(search.settings, search.stride),
        writer, largest_memory(comm), seconds, errors=errors, validity=valid,
        accuracy=accuracy), comm)
    if comm.rank == 0:
        (directory / "run.log").write_text(json.dumps(accuracy) + "\n")
        levels.place(**size).rename(directory / "export")


def _as_asked(search: goal.Search, problem):
    """The problem with the manifest of a run that has the chosen number of steps."""
    manifest = problem.manifest
    parameters = {name: value for name, value in manifest.parameters.items()
                  if name not in ("sampling", "coarsening")}
    rooms = manifest.rooms
    if "cycles" in rooms:
        cycles = rooms["cycles"]
        rooms = {**rooms, "cycles": {**cycles, "start": cycles["start"] // search.stride}}
    return dataclasses.replace(problem, manifest=dataclasses.replace(
        manifest, rooms=rooms, steps=search.steps,
        parameters={**parameters, "steps": search.steps}, between=search.history.between,
        amplitudes={name: values[:: search.stride]
                    for name, values in manifest.amplitudes.items()}))
