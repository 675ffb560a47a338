"""Processes side by side: what ends how, what is tried again, and that memory holds them all."""

import contextlib

import pytest

from planfit.batch.jobs import Job, Stamp
from planfit.batch.ledger import End
from planfit.batch.memory import GB
from planfit.batch.pool import LocalPool, Task
from planfit.batch.process import Errand, Launcher

SMALL = Stamp("", 10, 1)


def task(ledger, name, memory_gb=None):
    return Task(Errand(Job(name, "scan", memory_gb=memory_gb), str(ledger.out)), SMALL)


def run(ledger, *tasks, workers=2, allowed_gb=100.0, free=lambda: 100 * GB, started=None):
    allowed = None if allowed_gb is None else int(allowed_gb * GB)
    starts = [] if started is None else started
    pool = LocalPool(
        Launcher("fake_job"),
        workers,
        allowed,
        lambda t, n: starts.append((t.errand.job.name, n)),
        free,
    )
    return {one.errand.job.name: state for one, state in pool.run(tasks)}


def most_at_once(ledger):
    """From what the jobs wrote."""
    most = now = 0
    for line in (ledger.own / "order.txt").read_text().splitlines():
        now += 1 if line.startswith("start") else -1
        most = max(most, now)
    return most


def test_one_failure_stops_no_other(ledger):
    names = ("killed-1", "a", "refused-1", "b", "killedonce-1")
    started = []
    states = run(ledger, *(task(ledger, name) for name in names), started=started)
    assert set(states) == set(names)
    assert {name for name, state in states.items() if state.end is End.DONE} == {
        "a",
        "b",
        "killedonce-1",
    }
    assert states["refused-1"].end is End.REFUSED
    assert states["killed-1"].end is End.CRASHED
    assert "signal 9" in states["killed-1"].reason
    assert ledger.state("killed-1") == states["killed-1"]
    tries = {name: max(n for other, n in started if other == name) for name in names}
    assert tries == {"killed-1": 2, "a": 1, "refused-1": 1, "b": 1, "killedonce-1": 2}


@pytest.mark.parametrize("workers", [1, 3])
def test_no_more_than_the_workers(ledger, workers):
    run(ledger, *(task(ledger, f"j{i}") for i in range(4)), workers=workers)
    assert most_at_once(ledger) in range(min(workers, 2), workers + 1)


def test_jobs_wait_until_memory_holds_them(ledger):
    tasks = [task(ledger, f"j{i}", memory_gb=2.0) for i in range(3)]
    states = run(ledger, *tasks, workers=3, allowed_gb=3.9)
    assert len(states) == 3
    assert most_at_once(ledger) == 1


def test_a_small_job_passes_a_large_one_that_waits(ledger):
    tasks = [task(ledger, "a", 2.0), task(ledger, "large", 3.0), task(ledger, "small", 1.0)]
    started = []
    run(ledger, *tasks, workers=2, allowed_gb=3.5, started=started)
    assert [name for name, _ in started] == ["a", "small", "large"]


def test_what_is_free_counts_too(ledger):
    tasks = [task(ledger, f"j{i}", memory_gb=2.0) for i in range(2)]
    run(ledger, *tasks, allowed_gb=None, free=lambda: int(3.9 * GB))
    assert most_at_once(ledger) == 1


def test_a_job_that_never_fits_is_not_started(ledger):
    states = run(ledger, task(ledger, "a"), task(ledger, "huge", 8.0), allowed_gb=4.0)
    assert states["a"].end is End.DONE
    assert states["huge"].end is End.REFUSED
    assert "expected to need 8.0 GB of memory, and 4.0 GB are allowed" in states["huge"].reason
    assert "start huge" not in (ledger.own / "order.txt").read_text()


def test_leaving_stops_the_processes(ledger):
    tasks = [task(ledger, "a"), task(ledger, "waits-1"), task(ledger, "b")]
    pool = LocalPool(Launcher("fake_job"), 2, None)
    with contextlib.closing(pool.run(tasks)) as ended:
        assert next(ended)[0].errand.job.name == "a"
    assert (ledger.own / "waits-1.left").exists()


def test_threads_are_those_of_the_launcher(ledger, monkeypatch):
    """Two processes with as many threads each as there are processors would fight over them."""
    seen = {}
    real = __import__("subprocess").Popen

    def popen(*args, **kwargs):
        seen.update(kwargs["env"])
        return real(*args, **kwargs)

    monkeypatch.setattr("subprocess.Popen", popen)
    running = Launcher("fake_job", threads=3).start(task(ledger, "a").errand)
    running.process.wait(20)
    running.stop()
    for name in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
        assert seen[f"{name}_NUM_THREADS"] == "3"
