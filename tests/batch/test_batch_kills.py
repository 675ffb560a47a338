"""Processes that are killed: nothing is lost, nothing is done twice, no orphan goes on."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from batch_results import is_gone, until

from planfit.batch.jobs import Job, inputs_of
from planfit.batch.ledger import End
from planfit.batch.pool import LocalPool, Task
from planfit.batch.process import Errand, Launcher

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no signals")
LAUNCHER = Launcher("performed_job")
PARENT = """
import sys
from test_batch_kills import tasks_in
from planfit.batch.pool import LocalPool
from planfit.batch.process import Launcher
for task, state in LocalPool(Launcher("performed_job"), 2, None).run(tasks_in(sys.argv[1])):
    pass
"""


def jobs_in(out, waits=("now", "wait")):
    """Scans are files beside the folder of the batch."""
    jobs = []
    for i, when in enumerate(waits):
        scan = Path(out).parent / f"scan {i}"
        if not scan.exists():
            scan.write_text(f"{when} refined")
        jobs.append(Job(f"job {i}", str(scan)))
    return jobs


def tasks_in(out):
    return [Task(Errand(job, str(out)), None) for job in jobs_in(out)]


def marks(ledger, job, what):
    """How often a job was begun or finished."""
    return len(list(ledger.own.glob(f"{job.name}.*.{what}")))


def go(job):
    """Let a job end that waits."""
    Path(f"{job.scan}.go").touch()


def test_a_killed_job_is_tried_again_and_done_once(ledger):
    first, second = jobs_in(ledger.out)
    started = {}
    real = LAUNCHER.start

    class Watched:
        def start(self, errand, number=1):
            running = real(errand, number)
            started[errand.job.name, number] = running.process.pid
            return running

    pool = LocalPool(LAUNCHER, 2, None)
    pool.launcher = Watched()
    ends = {}
    for task, state in pool.run(tasks_in(ledger.out)):
        ends[task.errand.job.name] = state.end
        if task.errand.job.name == first.name:
            until(lambda: marks(ledger, second, "begun"))
            os.kill(started[second.name, 1], signal.SIGKILL)
            go(second)
    assert ends == {first.name: End.DONE, second.name: End.DONE}
    assert marks(ledger, second, "begun") == 2
    for job in (first, second):
        assert marks(ledger, job, "finished") == 1
        assert ledger.is_done(job.name, inputs_of(job).key)


def test_a_killed_batch_takes_its_jobs_along_and_goes_on_at_the_next_call(ledger):
    first, second = jobs_in(ledger.out)
    folder = str(Path(__file__).parent)
    path = os.pathsep.join([folder, os.environ["PYTHONPATH"]])
    parent = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(PARENT), str(ledger.out)],
        env=os.environ | {"PYTHONPATH": path},
    )
    until(lambda: marks(ledger, first, "finished") and marks(ledger, second, "begun"))
    parent.kill()
    parent.wait()
    (begun,) = ledger.own.glob(f"{second.name}.*.begun")
    until(lambda: is_gone(int(begun.read_text())))  # no orphan goes on
    go(second)
    before = ledger.folder(first.name).joinpath("run.json").stat().st_ino
    ends = {
        t.errand.job.name: s.end for t, s in LocalPool(LAUNCHER, 2, None).run(tasks_in(ledger.out))
    }
    assert set(ends.values()) == {End.DONE}
    assert marks(ledger, first, "finished") == marks(ledger, second, "finished") == 1
    assert marks(ledger, first, "begun") == 1
    assert ledger.folder(first.name).joinpath("run.json").stat().st_ino == before
