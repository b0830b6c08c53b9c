"""Commands of the driver in processes of their own, as a user starts them."""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from .. import environment

LOOK_AGAIN = 0.05  # seconds between two looks at what a process has said
UNSEEN = {"figures": "no", "fields": "no", "quiet": "yes"}  # options of runs of studies


def run_alone(pairs: dict) -> tuple[int, dict | str]:
    """A run with options `pairs`, among them `out`: status 0 and its summary, else another exit
    status and what it says.

    It ends with this process. Raises InputError if it cannot be started.
    """
    done = environment.run_child(stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                 **_process("run", pairs))
    if done.returncode:
        return done.returncode, done.stderr.strip() or f"exit status {done.returncode}"
    return 0, json.loads((Path(pairs["out"]) / "summary.json").read_text())


@contextlib.contextmanager
def run_beside(pairs: dict):
    """A run with options `pairs` while a block does something else; what it says comes afterwards.

    It ends with this process, and without a word where an error ends the block. Raises InputError
    if it cannot be started, SystemExit with its exit status if it fails.
    """
    with tempfile.TemporaryDirectory(prefix="driver-run-") as folder, contextlib.ExitStack() as own:
        places = Path(folder) / "stdout", Path(folder) / "stderr"
        out, err, said, told = (own.enter_context(open(place, mode))
                                for mode in "wr" for place in places)
        child = own.enter_context(environment.started(
            stdin=subprocess.DEVNULL, stdout=out, stderr=err, **_process("run", pairs)))
        yield
        ended = False
        while not ended:
            ended = child.poll() is not None
            print(told.read(), end="", file=sys.stderr, flush=True)
            print(said.read(), end="", flush=True)
            time.sleep(0 if ended else LOOK_AGAIN)
    if child.returncode:
        raise SystemExit(child.returncode)


def _process(command: str, pairs: dict) -> dict:
    """Command line and environment of a process."""
    words = [f"{name.upper()}={value}" for name, value in pairs.items()]
    return {"command": [sys.executable, "-m", "driver", command, *words],
            "env": {**os.environ, "PYTHONPATH": environment.python_path()}}
