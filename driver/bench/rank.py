"""One rank of a timed run: -m driver.bench.rank EXPORT OUT.json REPEATS [SETTINGS as JSON]"""

import json
import sys
import traceback
from pathlib import Path

from .. import environment

environment.single_threaded()
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
from ..timing import Laps
from .workbench import march

CALLS = 20  # products timed at a time


def once(directory: Path, settings: dict, comm) -> dict:
    """Seconds of every stage (of the slowest rank), counts and message volume of one run."""
    comm.Barrier()
    lap = Laps(barrier=comm.Barrier)
    seconds = lap.seconds
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
    seconds["product"] /= CALLS
    operator.products = 0
    history = march(Problem(manifest, structure, operator), **settings)
    lap("steps")
    bytes_ = operator.message_bytes()
    return {"seconds": seconds, "counts": history.counts, "subdomains": structure.total,
            "coarse": structure.coarse_dofs,
            "bytes": {name: comm.allreduce(value) for name, value in bytes_.items()}}


def main(directory: str, out: str, repeats: str, settings: str = "") -> None:
    """Repeat the run, by default with the slides' stopping rules; rank 0 writes all of them."""
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
