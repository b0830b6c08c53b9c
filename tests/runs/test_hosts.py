"""Ranks on several hosts: network namespaces of this machine, each with a name and an address.

The hosts and the network between them live in a namespace of their own, from which nothing else
can be reached. A script in the place of ssh starts Open MPI's daemons in them, with as little of
this process's environment as ssh would hand on.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from driver import children, environment
from driver.errors import InputError
from driver.runs import hosts

NETWORK = r"""
set -e
count=$1; shift
ip link set lo up
mount -t tmpfs hosts /run
mkdir /run/netns
hostname front
ip link add net type bridge
ip addr add 10.99.0.1/24 dev net
ip link set net up
for k in $(seq $count); do
    ip netns add host$k
    ip link add port$k type veth peer name eth0 netns host$k
    ip link set port$k master net up
    ip -n host$k addr add 10.99.0.1$k/24 dev eth0
    ip -n host$k link set eth0 up
    ip -n host$k link set lo up
done
exec "$@"
"""
AGENT = r"""#!/bin/sh
host=$1; shift
echo $$ > "$(dirname $0)/$host.pid"
exec env -i PATH=/usr/bin:/bin:/usr/sbin:/sbin SLURM_NODEID=$SLURM_NODEID SLURM_JOBID=$SLURM_JOBID \
    ip netns exec $host unshare --uts --mount sh -c "hostname $host; $BEFORE $*"
"""
SRUN = r"""#!/bin/sh
# starts what follows its own options once on every host of the job, as Slurm's srun does
while expr "$1" : "--" > /dev/null; do shift; done
k=0
for host in $JOB; do
    SLURM_NODEID=$k SLURM_PROCID=$k agent $host "$@" &
    k=$((k + 1))
    sleep 0.3  # two that enter namespaces at once can fail
done
wait
"""
OPTIONS = ("SCENE=model", "SUBDOMAINS=3x2", "CELLS=4", "STEPS=40", "LOADING=nonmonotone",
           "FIGURES=no", "ERRORS=no")


def _isolated() -> str:
    """Why there can be no network namespaces here; empty if there can."""
    for name in ("ip", "unshare", "mount"):
        if not shutil.which(name):
            return f"{name} is not installed"
    tried = subprocess.run(["unshare", "--net", "--uts", "--mount", "ip", "netns", "list"],
                           capture_output=True, text=True, check=False)
    return f"network namespaces are not permitted: {tried.stderr}" if tried.returncode else ""


isolated = pytest.mark.skipif(bool(_isolated()), reason=_isolated() or "-")


class Cluster:
    """Hosts host1 ... and this one, which they call front, to run the driver from."""

    def __init__(self, folder: Path, count: int):
        self.folder, self.count = folder, count
        self.file = folder / "hosts.txt"
        self.file.write_text("".join(f"host{k + 1}  # a comment\n" for k in range(count)))
        for name, text in (("network", NETWORK), ("agent", AGENT), ("srun", SRUN)):
            (folder / name).write_text(text)
            (folder / name).chmod(0o755)

    def start(self, *words, **environ) -> subprocess.Popen:
        """The driver with these words on the front."""
        env = {**os.environ, "PATH": f"{self.folder}{os.pathsep}{os.environ['PATH']}",
               "OMPI_MCA_plm_rsh_agent": str(self.folder / "agent"), "BEFORE": "", **environ}
        command = [sys.executable, "-m", "driver", *map(str, words)]
        return subprocess.Popen(
            ["unshare", "--net", "--uts", "--mount", "sh", str(self.folder / "network"),
             str(self.count), *command], env=env, cwd=environment.ROOT, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def run(self, *words, status: int = 0, **environ) -> str:
        """What the driver says as it ends with this exit status."""
        child = self.start("run", *OPTIONS, *words, **environ)
        try:
            output, errors = child.communicate(timeout=120)
        finally:
            child.kill()  # where it hangs; the rest ends with it
        assert child.returncode == status, errors
        return errors if status else output


@pytest.fixture
def cluster(tmp_path):
    return Cluster(tmp_path, 3)


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> str:
    """contact.csv of one rank on this host."""
    out = tmp_path_factory.mktemp("alone") / "out"
    subprocess.run([sys.executable, "-m", "driver", "run", *OPTIONS, f"OUT={out}"], check=True,
                   capture_output=True, cwd=environment.ROOT)
    return (out / "contact.csv").read_text()


def ranks(out: Path) -> int:
    return json.loads((out / "summary.json").read_text())["ranks"]


@pytest.mark.slow
@isolated
def test_three_hosts_find_the_same_bits(cluster, alone):
    out = cluster.folder / "out"
    cluster.run(f"HOSTS={cluster.file}", f"OUT={out}")
    assert ranks(out) == 3
    assert (out / "contact.csv").read_text() == alone


@isolated
@pytest.mark.slow
def test_slurms_allocation_is_taken(cluster, alone):
    out = cluster.folder / "out"
    cluster.run(f"OUT={out}", JOB="host1 host2", SLURM_JOB_ID="1", SLURM_JOBID="1",
                SLURM_NODELIST="host[1-2]", SLURM_TASKS_PER_NODE="1(x2)", SLURM_NNODES="2",
                SLURM_JOB_NUM_NODES="2", SLURM_NTASKS="2")
    assert ranks(out) == 2
    assert (out / "contact.csv").read_text() == alone


@isolated
@pytest.mark.slow
def test_pbs_allocation_is_taken(cluster, alone):
    out, nodes = cluster.folder / "out", cluster.folder / "nodes"
    nodes.write_text("host1\nhost1\nhost2\n")
    cluster.run(f"OUT={out}", PBS_NODEFILE=str(nodes))
    assert ranks(out) == 3
    assert (out / "contact.csv").read_text() == alone


@isolated
@pytest.mark.slow
def test_a_host_that_dies_ends_the_run_and_a_resume_finishes_it(cluster, alone):
    """Its processes are killed at once; the run goes on without that host from its checkpoint."""
    out = cluster.folder / "out"
    words = [f"HOSTS={cluster.file}", f"OUT={out}"]
    child = cluster.start("run", *OPTIONS, *words, DRIVER_EVERY_STEP="1")
    for line in child.stdout:
        if "step 3/" in line:
            break
    for process in _with(int((cluster.folder / "host2.pid").read_text())):
        os.kill(process, 9)
    _, errors = child.communicate(timeout=120)
    assert child.returncode == 2, errors
    # mpirun does not always say which: the next run sees which one it cannot reach
    assert errors.count("\n") == 1 and re.search("(host host2|one of the hosts) was lost", errors)
    assert "the same command goes on after step" in errors
    cluster.file.write_text("host1\nhost3\n")
    assert "goes on after step" in cluster.run(*words)
    assert ranks(out) == 2
    assert (out / "contact.csv").read_text() == alone


def _with(process: int) -> list[int]:
    """Processes on the host of this one, the eldest before those that it has started."""
    def network(number) -> str:
        try:
            return os.readlink(f"/proc/{number}/ns/net")
        except OSError:  # it has ended
            return ""

    there = network(process)
    numbers = sorted(map(int, filter(str.isdigit, os.listdir("/proc"))))
    return [number for number in numbers if there and network(number) == there]


@isolated
@pytest.mark.slow
def test_a_directory_that_a_host_does_not_see_is_said_before_work_begins(cluster):
    seen = cluster.folder / "seen"
    seen.mkdir()
    errors = cluster.run(f"HOSTS={cluster.file}", f"OUT={seen / 'out'}", status=2,
                         BEFORE=f"mount -t tmpfs other {seen};")
    assert errors.count("\n") == 1 and "does not see" in errors
    assert "a directory that all hosts share" in errors
    assert not list(seen.iterdir())


@isolated
@pytest.mark.slow
def test_a_host_that_cannot_be_reached_is_said(cluster):
    cluster.file.write_text("host1\nhost9\n")
    started = time.monotonic()
    errors = cluster.run(f"HOSTS={cluster.file}", f"OUT={cluster.folder / 'out'}", status=2)
    assert errors.count("\n") == 1 and "the hosts cannot all be reached" in errors
    assert "host9" in errors and time.monotonic() - started < 60


# ---- files of hosts ------------------------------------------------------------------------------

@pytest.fixture(autouse=True)
def _own_environment(monkeypatch):
    """What is told to Open MPI is forgotten after the test, and no batch system has allotted."""
    for name in (children.HOST_FILE, "PBS_NODEFILE", "SLURM_JOB_ID", *hosts.PATIENT):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)


def test_the_slots_of_a_file_are_the_ranks(tmp_path):
    file = tmp_path / "hosts"
    file.write_text("# all of them\nnode-1.cluster slots=4\n\nnode-2  slots = 2 # half\n10.0.0.7\n")
    assert hosts.use(file, None) == 7
    assert hosts.use(file, 3) == 3
    assert os.environ[children.HOST_FILE] == str(file)
    assert children.several_hosts()
    prefix = children.mpirun(3, {"FF_LOADPATH": "a;b", "HOME": "/"})
    assert prefix[prefix.index("-x") + 1] == "FF_LOADPATH" and "HOME" not in prefix


def test_this_host_alone_has_one_rank_and_keeps_its_settings():
    assert hosts.use(None, None) is None and hosts.use(None, 2) == 2
    assert children.HOST_FILE not in os.environ
    assert children.child_environment()["OMPI_MCA_pml"] == "ob1"
    assert "-x" not in children.mpirun(2, dict(os.environ))


@pytest.mark.parametrize("text, message", [
    ("", "names no host"), ("# none\n", "names no host"),
    ("good\nbad slots=x\n", "line 2: expects 'name' or 'name slots=n', not 'bad slots=x'"),
    ("a b\n", "line 1"), ("node slots=0\n", "line 1"), ("-o evil\n", "line 1"),
    ("; touch x\n", "line 1"), ("$(touch\n", "line 1"),
])
def test_a_file_that_names_no_hosts_is_refused(tmp_path, text, message):
    file = tmp_path / "hosts"
    file.write_text(text)
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        hosts.use(file, None)


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match="HOSTS=.*nothing: No such file"):
        hosts.use(tmp_path / "nothing", None)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is no text"):
        hosts.use(tmp_path / "binary", None)


def test_more_ranks_than_could_start_are_refused(tmp_path):
    file = tmp_path / "hosts"
    file.write_text("a slots=2\n")
    with pytest.raises(InputError, match="NP=1000 ranks on the 2 slots"):
        hosts.use(file, 1000)
    with pytest.raises(InputError, match="NP expects a number of ranks from 1 to"):
        hosts.use(None, 10**6)


def test_slurms_tasks_are_the_ranks(monkeypatch):
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    monkeypatch.setenv("SLURM_NTASKS", "5")
    assert hosts.use(None, None) == 5 and children.several_hosts()
    monkeypatch.setenv("SLURM_NTASKS", "many")
    with pytest.raises(InputError, match="SLURM_NTASKS=many"):
        hosts.use(None, None)
