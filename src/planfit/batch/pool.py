"""Jobs side by side: by processes of this machine, as many as its memory holds, or by the workers of a
dask.distributed cluster (https://distributed.dask.org)."""

import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from planfit.batch.jobs import Stamp
from planfit.batch.ledger import End, State
from planfit.batch.memory import GB, Expectation, free_bytes
from planfit.batch.process import MAX_TRIES, Errand, Launcher, Running
from planfit.errors import OptionError, OutputError

_POLL_S = 0.05
_SETTLING_S = 30.0
"""For so long a process takes up memory: what it was given is still counted as taken in what is free."""


@dataclass(frozen=True)
class Task:
    """A job to be done, and what is known of it."""

    errand: Errand
    scan: Stamp | None
    """Of its scan; None where that cannot be looked at, and it will be refused."""

    @property
    def measured_bytes(self) -> int | None:
        """Its peak when it was done another time, with whatever options."""
        state = self.errand.ledger.state(self.errand.job.name)
        return state.peak_bytes if state is not None and state.end is End.DONE else None


@dataclass
class _Try:
    task: Task
    measured: int | None
    number: int = 1
    need: int = 0
    begin: float = 0.0
    running: Running | None = None


@dataclass
class LocalPool:
    """Runs tasks side by side."""

    launcher: Launcher
    workers: int
    """Processes at a time."""
    allowed_bytes: int | None
    """All of them together; None: nobody knows, and only their number counts."""
    on_start: Callable[[Task, int], None] = lambda _task, _number: None
    """Told of each try, 1 or 2."""
    free: Callable[[], int | None] = free_bytes
    """Memory that can be had now."""
    _expected: Expectation = field(default_factory=Expectation, init=False)

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, State]]:
        """Each task with how it ended, as they end. Leaving the loop stops those that go on."""
        waiting = [_Try(task, task.measured_bytes) for task in tasks]
        going: list[_Try] = []
        try:
            while waiting or going:
                for one in [one for one in waiting if self._never_fits(one)]:
                    waiting.remove(one)
                    yield one.task, self._refusal(one)
                while (one := self._next(waiting, going)) is not None:
                    waiting.remove(one)
                    self.on_start(one.task, one.number)
                    one.begin = time.monotonic()
                    one.running = self.launcher.start(one.task.errand, one.number)
                    going.append(one)
                polled = [(one, one.running.poll()) for one in going if one.running is not None]
                ended = [(one, state) for one, state in polled if state is not None]
                for one, state in ended:
                    going.remove(one)
                    self._expected.learn(one.task.scan, state.peak_bytes)
                    if state.end is End.CRASHED and one.number < MAX_TRIES:
                        waiting.append(_Try(one.task, one.measured, one.number + 1))
                    else:
                        yield one.task, state
                if not ended:
                    time.sleep(_POLL_S)
        finally:
            for one in going:
                if one.running is not None:
                    one.running.close()  # all at once, then wait for each
            for one in going:
                if one.running is not None:
                    one.running.stop()

    def _need(self, one: _Try) -> int:
        task = one.task
        need = self._expected.of(task.scan, task.errand.job.memory_gb, one.measured)
        if one.number > 1 and task.errand.job.memory_gb is None:
            need *= 2  # perhaps the system ended it, for want of memory
            need = need if self.allowed_bytes is None else min(need, self.allowed_bytes)
        return need

    def _never_fits(self, one: _Try) -> bool:
        return self.allowed_bytes is not None and self._need(one) > self.allowed_bytes

    def _refusal(self, one: _Try) -> State:
        assert self.allowed_bytes is not None
        need, allowed = (value / GB for value in (self._need(one), self.allowed_bytes))
        state = State(
            End.REFUSED,
            reason=f"not started: it is expected to need {need:.1f} GB of memory, and {allowed:.1f} GB are "
            "allowed; give more with --memory-gb, or say what it needs in the column memory-gb",
        )
        errand = one.task.errand
        errand.ledger.keep_state(errand.job.name, state)
        return state

    def _next(self, waiting: Sequence[_Try], going: Sequence[_Try]) -> _Try | None:
        """The first that fits beside those that go on. A second try waits for the first ones."""
        if len(going) >= self.workers:
            return None
        taken = sum(one.need for one in going)
        now = time.monotonic()
        # What young processes will take is not yet missing in what is free.
        coming = sum(one.need for one in going if now - one.begin < _SETTLING_S)
        free = self.free()
        for one in waiting:
            need = self._need(one)
            is_allowed = self.allowed_bytes is None or taken + need <= self.allowed_bytes
            if is_allowed and (free is None or coming + need <= free):
                one.need = need
                return one
        return None


MEMORY = "MEMORY"
"""Resource that workers may declare (`dask worker --resources MEMORY=16e9`): jobs then wait for it."""
_CONNECT_S = 20
_WAIT_S = 120.0
"""For the first worker."""


def run_on_cluster(
    address: str, launcher: Launcher, tasks: Sequence[Task]
) -> Iterator[tuple[Task, State]]:
    """Each task with how it ended, as they end. Leaving the loop stops those that go on.

    A worker that dies takes its job's process with it; the scheduler hands the job to another worker, which
    goes on from the stages that are in the cache.

    Raises:
        OptionError: there is no scheduler, or no worker.
        OutputError: a worker does not see the folder of the batch.
    """
    if not tasks:
        return
    from distributed import as_completed  # pyright: ignore[reportMissingImports]

    client = _connected(address)
    ledger = tasks[0].errand.ledger
    lease = ledger.own / f"{uuid.uuid4().hex}.lease"
    try:
        lease.touch()
        declared = _workers_declare_memory(client, address, lease)
        futures = []
        of_key: dict[str, Task] = {}
        for task in tasks:
            job = task.errand.job
            need = Expectation().of(task.scan, job.memory_gb, task.measured_bytes)
            future = client.submit(
                run_in_process,
                launcher,
                task.errand,
                str(lease),
                key=f"planfit-{job.name}-{lease.stem}",
                pure=False,
                resources={MEMORY: need} if declared else None,
            )
            of_key[future.key] = task
            futures.append(future)
        for future in as_completed(futures, loop=client.loop):
            yield of_key[future.key], _ended(of_key[future.key], future)
    finally:
        lease.unlink(missing_ok=True)  # what still goes on stops
        client.close()


def require_distributed() -> None:
    """Raise `OptionError` where the library is missing."""
    try:
        import distributed  # noqa: F401  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise OptionError(
            "--scheduler: expected dask.distributed, found no such library; install it with "
            "pip install 'planfit[cluster]', or leave out --scheduler"
        ) from error


def _connected(address: str) -> Any:
    """A client of the scheduler."""
    from distributed import Client  # pyright: ignore[reportMissingImports]

    try:
        return Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"--scheduler {address}: expected a dask scheduler, found none that answers "
            f"({str(error).splitlines()[0]}); start one with: dask scheduler"
        ) from error


def _ended(task: Task, future: Any) -> State:
    """What the worker said, or that there is none that could say it."""
    if future.status == "finished":
        return future.result()
    error = future.exception() if future.status == "error" else None
    words = f"{type(error).__name__}: {error}".split("\n")[0] if error else future.status
    state = State(End.CRASHED, reason=f"no worker finished it ({words})")
    task.errand.ledger.keep_state(task.errand.job.name, state)
    return state


def _workers_declare_memory(client: Any, address: str, lease: Path) -> bool:
    """Whether all workers declare their memory; they must be there and see the folder."""
    try:
        client.wait_for_workers(1, timeout=_WAIT_S)
    except TimeoutError as error:
        raise OptionError(
            f"--scheduler {address}: expected workers, found none within {_WAIT_S:.0f} s; start some with: "
            f"dask worker {address}"
        ) from error
    blind = [worker for worker, sees in client.run(_sees, str(lease)).items() if not sees]
    if blind:
        raise OutputError(
            f"{lease.parent}: expected a folder that all workers of the cluster see, found "
            f"{len(blind)} that do not ({blind[0]}); choose one on a shared disk with -o"
        )
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    return all(MEMORY in worker.get("resources", {}) for worker in workers)


def _sees(path: str) -> bool:
    return Path(path).exists()


def run_in_process(launcher: Launcher, errand: Errand, lease: str) -> State:
    """A job on a worker: as long as there is the lease, and once more where it crashes."""
    state = State(End.CRASHED, reason="the batch was stopped")
    for number in range(1, MAX_TRIES + 1):
        running = launcher.start(errand, number)
        try:
            while (ended := running.poll()) is None:
                if not Path(lease).exists():
                    return State(End.CRASHED, reason="the batch was stopped")
                time.sleep(_POLL_S)
        finally:
            running.stop()
        state = ended
        if state.end is not End.CRASHED:
            break
    return state
