"""Runs in processes of their own, as a user starts them."""

import json
import os
import subprocess
import sys
from pathlib import Path

from .. import children

BARE = {"figures": "no", "fields": "no", "quiet": "yes"}  # options of runs of studies


def run_alone(pairs: dict) -> tuple[int, dict | str]:
    """A run with options `pairs`, among them `out`: status 0 and its summary, else another exit
    status and what it says.

    It ends with this process. Raises InputError if it cannot be started.
    """
    done = children.run_child(
        [sys.executable, "-m", "driver", "run",
         *(f"{name.upper()}={value}" for name, value in pairs.items())],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": children.python_path()})
    if done.returncode:
        return done.returncode, done.stderr.strip() or f"exit status {done.returncode}"
    return 0, json.loads((Path(pairs["out"]) / "summary.json").read_text())
