"""One rank of a timed run: -m driver.bench.rank EXPORT OUT.json REPEATS [SETTINGS as JSON]"""

import json
import sys
import time
import traceback
from pathlib import Path

from .. import environment

environment.prepare_libraries()
environment.start_petsc()

import numpy as np
from mpi4py import MPI

from ..feti.operator import DualOperator
from ..feti.structure import partition
from ..march.problem import Problem
from ..march.tearing import build
from ..scene.loader import read_subdomains
from ..scene.manifest import read_manifest
from ..studies.table import method_settings
from ..timing import Laps, memory_used
from .workbench import march

CALLS = 20  # products timed at a time


def once(directory: Path, settings: dict | None, comm) -> dict:
    """Seconds of every stage (of the slowest rank), counts and message volume of one run.

    `processor` are the largest processor seconds of a rank, `load` the largest and the sum over the
    ranks of what a product takes of each, of what they receive in it, and of MiB from before
    reading on. Without `settings` there are no steps.
    """
    comm.Barrier()
    before = memory_used()
    clock, processor, lasts = Laps(barrier=comm.Barrier), {}, [time.process_time()]
    seconds = clock.seconds

    def lap(stage: str) -> None:
        """`stage` ends now; the processor's seconds are those before waiting for other ranks."""
        processor[stage] = time.process_time() - lasts[-1]
        clock(stage)
        lasts.append(time.process_time())

    manifest = read_manifest(directory)
    first, last = partition(manifest.subdomains, comm)
    subdomains = read_subdomains(manifest, first, last, comm)
    lap("read")
    structure = build(manifest, subdomains, first, comm)
    lap("skeleton")
    operator = DualOperator(structure, comm)
    lap("reduction")
    x = np.ones(operator.owned)
    operator.apply(x)
    lap("warm")
    for _ in range(CALLS):
        operator.apply(x)
    lap("product")
    for spent in (seconds, processor):
        spent["product"] /= CALLS
    operator.products, counts = 0, {}
    bytes_ = operator.message_bytes()
    memory = memory_used() - before
    load = {**operator.load(), "kB": (bytes_["rows"] + bytes_["coarse"]) / 1e3, "MiB": memory}
    if settings is not None:
        counts = march(Problem(manifest, structure, operator), **settings).counts
        lap("steps")
    return {"seconds": seconds, "counts": counts, "subdomains": structure.total,
            "coarse": structure.coarse_dofs,
            "processor": {stage: comm.allreduce(spent, op=MPI.MAX)
                          for stage, spent in processor.items()},
            "load": {name: (comm.allreduce(value, op=MPI.MAX), comm.allreduce(value))
                     for name, value in load.items()},
            "bytes": {name: comm.allreduce(value) for name, value in bytes_.items()}}


def main(directory: str, out: str, repeats: str, settings: str = "") -> None:
    """Repeat the run, by default with the slides' stopping rules; rank 0 writes all of them.

    `settings` "null" is a run without steps.
    """
    comm, chosen = MPI.COMM_WORLD, json.loads(settings) if settings else method_settings("default")
    runs = [once(Path(directory), chosen, comm) for _ in range(int(repeats))]
    if comm.rank == 0:
        Path(out).write_text(json.dumps(runs))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception:  # the other ranks know nothing of it and wait for this one: end them
        traceback.print_exc()
        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(1)
