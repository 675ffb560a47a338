"""Jobs by the workers of a dask.distributed cluster (https://distributed.dask.org)."""

import time
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from planfit.batch.ledger import End, State
from planfit.batch.memory import Expectation
from planfit.batch.pool import Task
from planfit.batch.process import MAX_TRIES, Errand, Launcher
from planfit.errors import OptionError, OutputError

MEMORY = "MEMORY"
"""Resource that workers may declare (`dask worker --resources MEMORY=16e9`): jobs then wait for it."""
_CONNECT_S = 20
_POLL_S = 0.2
_WAIT_S = 120.0
"""For the first worker."""


def run_on_cluster(
    address: str, launcher: Launcher, tasks: Sequence[Task]
) -> Iterator[tuple[Task, State]]:
    """Each task with how it ended, as they end. Leaving the loop stops those that go on.

    A worker that dies takes its job's process with it; the scheduler hands the job to another worker, which
    goes on from the stages that are in the cache.

    Args:
        address: of the scheduler, `tcp://host:8786`.
        launcher: how a worker starts a job.
        tasks: the jobs.

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
