"""Jobs on a cluster of dask: a real scheduler, two workers, one of them killed in the middle."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from planfit.batch.cluster import run_on_cluster
from planfit.batch.inputs import inputs_of
from planfit.batch.jobs import Job
from planfit.batch.ledger import End
from planfit.batch.perform import Errand
from planfit.batch.pool import Task
from planfit.batch.process import Launcher
from planfit.errors import OptionError

pytest.importorskip("distributed", reason="planfit[cluster] is not installed")
pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="no signals"),
    pytest.mark.filterwarnings("ignore"),  # of the library, about its own threads and sockets
]
LAUNCHER = Launcher("performed_job")


@pytest.fixture
def cluster(ledger, tmp_path):
    """Address of a scheduler with two workers, and their processes."""
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
        subprocess.Popen([sys.executable, "-m", *words], stdout=log, stderr=log) for words in commands
    ]
    yield address, processes[1:]
    for process in processes:
        process.kill()
        process.wait()
    log.close()


def tasks(ledger, tmp_path, scans):
    for name, text in scans.items():
        (tmp_path / name).write_text(text)
    return [Task(Errand(Job(name, str(tmp_path / name)), str(ledger.out)), None) for name in scans]


def test_one_of_two_workers_is_killed_and_all_is_done_once(ledger, tmp_path, cluster):
    address, workers = cluster
    scans = {  # the first two begin first
        "a": "now refined", "slow 1": "wait refined", "b": "now refuse", "c": "now crash", "slow 2": "wait refined",
    }
    todo = tasks(ledger, tmp_path, scans)
    ends, is_killed = {}, False
    for task, state in run_on_cluster(address, LAUNCHER, todo):
        ends[task.errand.job.name] = state
        if not is_killed:
            end = time.monotonic() + 60
            while not (begun := list(ledger.own.glob("slow*.begun"))) and time.monotonic() < end:
                time.sleep(0.05)
            assert begun
            name = begun[0].name.split(".")[0]
            os.kill(worker_of(workers, name), signal.SIGKILL)
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


def worker_of(workers, name):
    """Process id of the worker that runs a job, by the parents of the job's process."""
    for worker in workers:
        for line in subprocess.run(
            ["ps", "--no-headers", "-o", "pid", "--ppid", str(worker.pid)],
            capture_output=True, text=True, check=False,
        ).stdout.split():  # fmt: skip
            with open(f"/proc/{line}/cmdline") as command:  # noqa: PTH123
                if "performed_job" in command.read():
                    return worker.pid
    raise AssertionError(f"no worker runs {name}")


def test_no_scheduler_is_one_sentence(ledger, tmp_path, monkeypatch):
    monkeypatch.setattr("planfit.batch.cluster._CONNECT_S", 1)
    todo = tasks(ledger, tmp_path, {"a": "now refined"})
    with pytest.raises(OptionError, match="expected a dask scheduler, found none that answers"):
        list(run_on_cluster("tcp://127.0.0.1:9", LAUNCHER, todo))
