"""Runs a command: peak.py OUT COMMAND ..., and writes its wall seconds and peak memory (KiB).

A process counts what the one that started it had in memory as its own until it loads its program
(getrusage(2), ru_maxrss): so a small one starts it. Nothing else is imported here.
"""

import resource
import subprocess
import sys
import time

if __name__ == "__main__":
    out, *command = sys.argv[1:]
    clock = time.perf_counter()
    status = subprocess.call(command)
    wall = time.perf_counter() - clock
    with open(out, "w", encoding="ascii") as file:
        print(wall, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=file)
    sys.exit(status != 0)
