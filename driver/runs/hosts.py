"""Ranks on several hosts: which ones, how many ranks each takes, whether they can do the work.

The hosts are those of HOSTS=file or of the batch system's allocation. Open MPI starts its daemons
on them, by ssh or by Slurm, and is told of them by its own settings in the environment, so that
FreeFEM and the solver start there alike. What the ranks read and write is a directory that all
hosts share.
"""

import os
import re
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from .. import children, environment
from ..errors import InputError, file_error
from ..options import CORES, RANKS_PER_CORE

ENTRY = re.compile(r"(?P<name>\S+?)((\s+slots\s*=\s*|:)(?P<slots>[1-9]\d{0,4}))?")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*|[0-9A-Fa-f:]+")
TOKEN = "hosts"  # file in the shared directory that every host is to see
# a daemon that answers no longer is missed after about 20 s; ssh asks nobody and gives up, too
PATIENT = {"OMPI_MCA_oob_tcp_keepalive_time": "10", "OMPI_MCA_oob_tcp_keepalive_intvl": "5",
           "OMPI_MCA_oob_tcp_keepalive_probes": "2",
           "OMPI_MCA_plm_rsh_args": "-o BatchMode=yes -o ConnectTimeout=10"}
LOOK = """
if ! test -e "$1/{token}"; then echo "error: host $(hostname) does not see $1:" \\
    "OUT has to be in a directory that all hosts share"; exit 2; fi
for needed in "$@"; do
    if ! test -e "$needed"; then echo "error: host $(hostname) has no $needed: install the suite" \\
        "and its packages in the same places on all hosts"; exit 2; fi
done
""".format(token=TOKEN)


@dataclass(frozen=True)
class Hosts:
    """The hosts of a run: the ranks that they take without sharing cores, and who names them."""

    slots: int
    source: str


def use(file: Path | None, ranks: int | None) -> int | None:
    """Let Open MPI start ranks on the hosts of `file` or of an allocation; the number of ranks.

    That is `ranks`, by default one for each slot of the hosts, and None on this host alone. Raises
    InputError for a file that names no hosts and for more ranks than could start.
    """
    hosts = _given(file) or _allotted()
    if not hosts:
        most = RANKS_PER_CORE * CORES
        if ranks and ranks > most:
            raise InputError(f"NP expects a number of ranks from 1 to {most} on this machine, "
                             f"not '{ranks}'")
        return ranks
    if ranks and ranks > RANKS_PER_CORE * hosts.slots:
        raise InputError(f"NP={ranks} ranks on the {hosts.slots} slots of {hosts.source}: at most "
                         f"{RANKS_PER_CORE} a slot can start")
    return ranks or hosts.slots


def _given(file: Path | None) -> Hosts | None:
    """The hosts of a file of Open MPI's form, ``name slots=n`` in a line."""
    if file is None:
        return None
    return _named(read(file, f"HOSTS={file}"), file, str(file))


def _named(entries: list[tuple[str, int]], file: Path, source: str) -> Hosts:
    """Tell Open MPI of the file with these entries."""
    os.environ[children.HOST_FILE] = str(file.absolute())
    for name, value in PATIENT.items():
        if name != "OMPI_MCA_plm_rsh_args" or "OMPI_MCA_plm_rsh_agent" not in os.environ:
            os.environ.setdefault(name, value)
    return Hosts(sum(slots for _, slots in entries), source)


def _allotted() -> Hosts | None:
    """The hosts that Slurm or PBS has allotted; Open MPI asks Slurm itself."""
    if file := os.environ.get("PBS_NODEFILE"):
        entries = read(Path(file), f"PBS_NODEFILE={file}")
        if {name for name, _ in entries} == {socket.gethostname()}:
            return Hosts(sum(slots for _, slots in entries), "PBS's allocation")
        return _named(entries, Path(file), "PBS's allocation")
    if "SLURM_JOB_ID" not in os.environ:
        return None
    slots = os.environ.get("SLURM_NTASKS") or os.environ.get("SLURM_JOB_NUM_NODES", "1")
    if not re.fullmatch(r"[1-9]\d{0,6}", slots):
        raise InputError(f"SLURM_NTASKS={slots} is no number of tasks")
    return Hosts(int(slots), "Slurm's allocation")


def read(file: Path, name: str) -> list[tuple[str, int]]:
    """Hosts and slots of a file, a host in a line; `name` is how messages call it.

    Raises InputError if it cannot be read, names none, or has another line, with its number.
    """
    try:
        lines = file.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as problem:
        reason = getattr(problem, "strerror", None) or "is no text"
        raise file_error(problem, f"{name}: {reason}") from None
    entries = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].strip()
        entry = ENTRY.fullmatch(words)
        if words and not (entry and NAME.fullmatch(entry["name"])):
            raise InputError(f"{name}, line {number}: expects 'name' or 'name slots=n', "
                             f"not '{words}'")
        if words:
            entries.append((entry["name"], int(entry["slots"] or 1)))
    if not entries:
        raise InputError(f"{name} names no host")
    return entries


def check(directory: Path, ranks: int) -> None:
    """See that all hosts can be reached, see `directory` and have what the ranks run.

    A directory of one host alone would end in errors of missing files. Raises InputError.
    """
    if ranks == 1 or not children.several_hosts():
        return
    token = directory / TOKEN
    token.touch()
    needed = [environment.ROOT / "driver" / "cli.py", Path(sys.executable),
              Path(children.program("FreeFem++-mpi")), Path(children.program("setpriv"))]
    command = [children.program("mpirun"), "--npernode", "1", "sh", "-c", LOOK, "sh",
               str(directory), *map(str, needed)]
    done = children.run_child(command, env=children.child_environment(), text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, errors="replace")
    token.unlink()
    if done.returncode:
        raise InputError(unreachable(done.stdout, done.stderr))


def unreachable(output: str, errors: str) -> str:
    """Why ranks did not start, of what mpirun has printed."""
    for line in output.splitlines():
        if line.startswith("error: "):
            return line.removeprefix("error: ")
    told = [line.strip() for line in errors.splitlines()
            if line.strip(" -") and "Warning" not in line]
    return f"the hosts cannot all be reached: {told[0] if told else 'mpirun says nothing'}"


def lost(errors: str) -> str:
    """Which host's ranks have ended, of what mpirun has printed when they did."""
    found = re.search(r"Remote daemon:\s+\S+ on node (\S+)|on node (\S+) exited on signal|"
                      r"Peer host:\s+(\S+)", errors)
    return f"host {next(filter(None, found.groups()))}" if found else "one of the hosts"
