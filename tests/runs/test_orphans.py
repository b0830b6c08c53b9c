"""What a driver that is killed leaves running: nothing, also of a FreeFEM that catches SIGTERM."""

import os
import signal
import subprocess
import sys
import time

from driver.environment import ROOT

STUBBORN = "#!/bin/sh\ntrap '' TERM\necho $$ > {}\nexec sleep 60\n"
PARENT = "import sys; from driver import children; children.run_child([sys.argv[1]])"
PATIENCE = 20.0  # s, on a machine at work; it takes some hundredths


def wait_for(condition) -> bool:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


def ended(number: int) -> bool:
    """Whether a process is gone, or left to be reaped."""
    try:
        with open(f"/proc/{number}/stat", encoding="utf-8") as file:
            return file.read().rsplit(")", 1)[1].split()[0] == "Z"
    except FileNotFoundError:
        return True


def test_freefem_ends_with_a_driver_that_is_killed_whatever_it_catches(tmp_path):
    noted, program = tmp_path / "number", tmp_path / "FreeFem++"
    program.write_text(STUBBORN.format(noted))
    program.chmod(0o755)
    with subprocess.Popen([sys.executable, "-c", PARENT, str(program)], cwd=ROOT) as parent:
        assert wait_for(lambda: noted.is_file() and noted.read_text().strip())
        number = int(noted.read_text())
        time.sleep(0.1)  # until the shell has become what ignores the signal
        parent.kill()
    gone = wait_for(lambda: ended(number))
    if not gone:
        os.kill(number, signal.SIGKILL)
    assert gone
