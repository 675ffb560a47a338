"""Jobs on a cluster of dask: a real scheduler, two workers, one of them killed in the middle."""

import os
import signal
import socket
import subprocess
import sys

import pytest
from batch_results import is_gone, until

from planfit.batch.jobs import Job, inputs_of
from planfit.batch.ledger import End
from planfit.batch.pool import Task, run_on_cluster
from planfit.batch.process import Errand, Launcher
from planfit.errors import OptionError

pytest.importorskip("distributed", reason="planfit[cluster] is not installed")
pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="no signals"),
    pytest.mark.filterwarnings("ignore"),  # of the library, about its own threads and sockets
]
LAUNCHER = Launcher("performed_job")


@pytest.fixture
def cluster(ledger, tmp_path):
    """Address of a scheduler with two workers."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    where = ["--host", "127.0.0.1"]
    commands = [["distributed.cli.dask_scheduler", *where, "--port", str(port), "--no-dashboard"]]
    commands += [
        [
            "distributed.cli.dask_worker", address, *where, "--no-nanny", "--nthreads", "1", "--no-dashboard",
            "--name", f"w{i}", "--local-directory", str(tmp_path), "--resources", "MEMORY=1e9",
        ]
        for i in range(2)
    ]  # fmt: skip
    log = (tmp_path / "cluster.log").open("w")
    processes = [
        subprocess.Popen([sys.executable, "-m", *words], stdout=log, stderr=log)
        for words in commands
    ]
    yield address
    for process in processes:
        process.kill()
        process.wait()
    log.close()


def tasks(ledger, tmp_path, scans):
    for name, text in scans.items():
        (tmp_path / name).write_text(text)
    return [Task(Errand(Job(name, str(tmp_path / name)), str(ledger.out)), None) for name in scans]


@pytest.mark.slow
def test_one_of_two_workers_is_killed_and_all_is_done_once(ledger, tmp_path, cluster):
    address = cluster
    scans = {  # the first two begin first
        "a": "now refined",
        "slow 1": "wait refined",
        "b": "now refuse",
        "c": "now crash",
        "slow 2": "wait refined",
    }
    todo = tasks(ledger, tmp_path, scans)
    ends, is_killed = {}, False
    for task, state in run_on_cluster(address, LAUNCHER, todo):
        ends[task.errand.job.name] = state
        if not is_killed:
            kill_a_worker(ledger)
            is_killed = True
            for slow in ("slow 1", "slow 2"):
                (tmp_path / f"{slow}.go").touch()
    assert {name: state.end for name, state in ends.items()} == {
        "a": End.DONE, "slow 1": End.DONE, "b": End.REFUSED, "c": End.CRASHED, "slow 2": End.DONE,
    }  # fmt: skip
    assert ends["b"].reason == "this scan is none"
    for name in ("a", "slow 1", "slow 2"):
        assert ledger.is_done(name, inputs_of(Job(name, str(tmp_path / name))).key)
        assert len(list(ledger.own.glob(f"{name}.*.finished"))) == 1
    assert len(list(ledger.own.glob("c.*.begun"))) >= 2  # tried once more
    assert len(list(ledger.own.glob("slow*.begun"))) >= 3  # the killed one began again
    assert not list(ledger.own.glob("*.lease"))


def kill_a_worker(ledger):
    """That of a job which waits."""
    until(lambda: any(mark.read_text() for mark in ledger.own.glob("slow*.begun")))
    pid = next(int(t) for mark in ledger.own.glob("slow*.begun") if (t := mark.read_text()))
    os.kill(parent_of(pid), signal.SIGKILL)
    until(lambda: is_gone(pid))  # the job's process ends with its worker


def parent_of(pid):
    """Process id of the worker that started a job."""
    shown = subprocess.run(["ps", "-o", "ppid=", "-p", str(pid)], capture_output=True, check=True)
    return int(shown.stdout)


def test_no_scheduler_is_one_sentence(ledger, tmp_path, monkeypatch):
    monkeypatch.setattr("planfit.batch.pool._CONNECT_S", 1)
    todo = tasks(ledger, tmp_path, {"a": "now refined"})
    with pytest.raises(OptionError, match="expected a dask scheduler, found none that answers"):
        list(run_on_cluster("tcp://127.0.0.1:9", LAUNCHER, todo))
