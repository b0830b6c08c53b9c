"""Stage: the search for settings that reach an accuracy, and the results of its finest run."""

import dataclasses
import json
import time
from pathlib import Path

from ..errors import DriverError, error_of
from ..estimates.budget import share
from . import goal
from .request import Request


def run(directory: Path, request: Request, comm) -> tuple[int, str]:
    """Search and write the result into `directory`; exit status and reason, on every rank."""
    from ..estimates.levels import Levels
    from ..options import Settings

    clock = time.perf_counter()
    root = comm.rank == 0
    settings = Settings(**{"uniqueness": "no", **request.settings})
    levels = Levels(Path(request.script), {**request.parameters, "sampling": str(goal.SAMPLING)},
                    directory / "levels", comm, settings, without=request.without)

    def say(line: str) -> None:
        if root and not request.quiet:
            print(f"{request.scene}: {line}", flush=True)

    status, reason, search = 0, "", None
    try:
        search = goal.Search(levels, settings, *request.accuracy, say)
        search.run()
    except DriverError as problem:
        status, reason = problem.exit_status, str(problem)
    try:
        if search is not None and "mesh" in search.parts:
            _write(directory, request, search, status, reason, clock)
    finally:
        comm.barrier()
        levels.close()
    return status, reason


def _write(directory: Path, request: Request, search: goal.Search, status: int, reason: str,
           clock: float) -> None:
    """Results of the finest run, as an ordinary run leaves them."""
    from ..estimates import validity
    from ..results import summary
    from ..results.writer import Writer

    begun, size, levels = time.perf_counter(), {search.knob: search.sizes[-1]}, search.levels
    comm, level = levels.comm, search._level(search.sizes[-1])
    problem = _as_asked(search, levels.problem(**size))
    writer = Writer(directory, problem.manifest, problem.operator, level.solver, request.fields)
    states, energies = zip(*(writer.add(step) for step in level.steps))
    checked = {len(states) - 1, max(range(len(states)), key=energies.__getitem__)}
    valid = validity.assess(problem, writer.contact,
                            [(level.steps[k], states[k]) for k in sorted(checked)])
    writer.close()
    budget, chosen = search.budget(), search.chosen()
    entry = budget[search.name]
    settings = " ".join(f"{name}={value}" for name, value in chosen.items())
    advice = (f"{search.name.replace('_', ' ')} to {share(entry['total'], entry['value'])}, "
              f"asked for {100 * search.asked:g} %; the same settings by hand: {settings}")
    errors = {"quantities": budget, "notes": [], "advice": advice}
    accuracy = {"quantity": search.name, "asked": search.asked, "reached": entry["relative"],
                "settings": chosen, "levels": len(search.sizes), "products": levels.products}
    failure = error_of(status, reason) if status else None
    now = time.perf_counter()
    seconds = {"read": 0.0, **levels.seconds, "output": now - begun, "total": now - clock}
    summary.write(directory, summary.summarize(
        request, problem, level.solver, failure, search.scaled(search.settings, search.stride),
        writer, summary.largest_memory(comm), seconds, errors=errors, validity=valid,
        accuracy=accuracy), comm)
    if comm.rank == 0:
        (directory / "run.log").write_text(json.dumps(accuracy) + "\n")
        levels.place(**size).rename(directory / "export")


def _as_asked(search: goal.Search, problem):
    """The problem with the manifest of a run that has the chosen number of steps."""
    manifest = problem.manifest
    parameters = {name: value for name, value in manifest.parameters.items()
                  if name not in ("sampling", "coarsening")}
    return dataclasses.replace(problem, manifest=dataclasses.replace(
        manifest, steps=search.steps, parameters={**parameters, "steps": search.steps},
        amplitudes={name: values[:: search.stride]
                    for name, values in manifest.amplitudes.items()}))
