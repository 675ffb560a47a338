"""One job: done from its inputs to its results in a process of its own, which is started, watched and
ended, and ends with who started it."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
import traceback
import uuid
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import IO, Any

from filelock import FileLock

from planfit.batch import addresses
from planfit.batch.jobs import Job, Option, inputs_of, is_address, split_storey
from planfit.batch.ledger import JOB_KEY, End, Ledger, State
from planfit.batch.memory import own_peak_bytes
from planfit.errors import MAX_REASON, PlanfitError
from planfit.runtime.run_folder import inputs_of_owner


@dataclass(frozen=True)
class Errand:
    """A job and all that its process must know beside; plain values, as it goes through a pipe."""

    job: Job
    out: str
    token: str = ""
    overwrite: bool = False
    staged: str = ""
    """Folder of the copies of remote files; by default inside `out`."""

    @property
    def ledger(self) -> Ledger:
        """Of the batch."""
        return Ledger(Path(self.out))

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @staticmethod
    def of_plain(values: dict[str, Any]) -> "Errand":
        """From JSON."""
        job = values["job"]
        options = tuple(Option(o["flag"], tuple(o["values"]), o["is_file"]) for o in job["options"])
        made = Job(**{**job, "plans": tuple(job["plans"]), "options": options})
        return Errand(**{**values, "job": made})


Refine = Callable[[list[str], dict[str, str]], None]
"""Refines by the words of the command line behind `planfit refine`; its second argument is put among the
inputs in `run.json`."""


def perform(errand: Errand, refine: Refine) -> State:
    """Do a job unless it is done, and keep how it ended.

    Raises:
        KeyboardInterrupt, SystemExit: somebody wants this process to end; nothing is kept then.
    """
    ledger, job = errand.ledger, errand.job
    begin = time.perf_counter()
    with FileLock(ledger.lock(job.name)):
        key = ""
        try:
            key = inputs_of(job).key
            if not ledger.is_done(job.name, key):
                _refine(errand, key, refine)
            elif (kept := ledger.state(job.name)) and (kept.end, kept.key) == (End.DONE, key):
                # Another process was faster; its time and memory are those of the job.
                ledger.keep_state(job.name, replace(kept, token=errand.token))
                return kept
            end, reason = End.DONE, ""
        except PlanfitError as error:
            end, reason = End.REFUSED, str(error)
        except Exception as error:
            end, reason = End.CRASHED, _in_one_line(error)
            traceback.print_exc()  # into the log
        state = State(end, key, reason, time.perf_counter() - begin, own_peak_bytes(), errand.token)
        ledger.keep_state(job.name, state)
    return state


def _refine(errand: Errand, key: str, refine: Refine) -> None:
    job, ledger = errand.job, errand.ledger
    cache = Path(errand.staged) if errand.staged else ledger.staged

    def local(place: str) -> str:
        return str(addresses.staged(place, cache)) if is_address(place) else place

    inputs = {JOB_KEY: key}
    words = [local(job.scan), "--out", str(ledger.folder(job.name))]
    for plan in job.plans:
        number, file = split_storey(plan)
        words += ["--plan", number + local(file)]
    for option in job.options:
        values = tuple(local(v) for v in option.values) if option.is_file else option.values
        words += replace(option, values=values).words
    if is_address(job.scan):
        inputs["scan_address"] = job.scan
    if any(is_address(split_storey(plan)[1]) for plan in job.plans):
        inputs["plan_address"] = " ".join(job.plans)
    # Another scan under this name is a change of the file of jobs; a folder of somebody else is not ours.
    if errand.overwrite or JOB_KEY in inputs_of_owner(ledger.folder(job.name)):
        words.append("--overwrite")
    refine(words, inputs)


def _in_one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        what = f"{error.filename}: " if error.filename is not None else ""
        return f"{what}{error.strerror}"
    words = str(error).strip().split("\n")[0][:MAX_REASON]
    return f"{type(error).__name__}: {words}" if words else type(error).__name__


_THREADS_OF = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
    "VECLIB_MAXIMUM_THREADS",
)
MAX_TRIES = 2


@dataclass(frozen=True)
class Launcher:
    """How a job's process is started."""

    module: str
    """Called as `python -m MODULE THREADS`; it calls `read_errand` first, then `perform`."""
    threads: int = 1

    def start(self, errand: Errand, number: int = 1) -> "Running":
        """Start a job, its output to its log; that of a second try goes behind that of the first.

        Raises:
            OSError: there can be no process or log.
        """
        errand = replace(errand, token=uuid.uuid4().hex)
        threads = {name: str(self.threads) for name in _THREADS_OF}
        with errand.ledger.log(errand.job.name).open("wb" if number == 1 else "ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", self.module, str(self.threads)],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=os.environ | threads | {"PYTHONIOENCODING": "utf-8"},
            )
        running = Running(errand, process)
        with contextlib.suppress(BrokenPipeError):  # it is dead already, which `poll` tells
            running.stdin.write(json.dumps(errand.plain()).encode() + b"\n")
            running.stdin.flush()
        return running


@dataclass(frozen=True)
class Running:
    """A job that was started."""

    errand: Errand
    process: "subprocess.Popen[bytes]"

    @property
    def stdin(self) -> IO[bytes]:
        """Open as long as the job shall go on."""
        assert self.process.stdin is not None
        return self.process.stdin

    def poll(self) -> State | None:
        """How it ended; None while it goes on."""
        code = self.process.poll()
        if code is None:
            return None
        self.close()
        name = self.errand.job.name
        state = self.errand.ledger.state(name)
        if state is not None and state.token == self.errand.token:
            return state
        state = State(End.CRASHED, reason=_death(code), token=self.errand.token)
        self.errand.ledger.keep_state(name, state)
        return state

    def stop(self) -> None:
        """End it; what it had finished is in its cache."""
        self.close()
        try:
            self.process.wait(10.0)  # s
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def close(self) -> None:
        """Let it end; `stop` waits for that."""
        with contextlib.suppress(BrokenPipeError):
            self.stdin.close()


def _death(code: int) -> str:
    if code >= 0:
        return f"its process ended with code {code}; its log tells more"
    killed = "; out of memory, perhaps" if code == -9 else ""
    return f"its process was ended by signal {-code}{killed}"


def read_errand(stdin: IO[bytes]) -> Errand:
    """The errand of this process, which ends from now on when `stdin` is closed, at once: nothing that it
    writes is half there.

    Args:
        stdin: one line of JSON, then nothing until it is closed.
    """
    errand = Errand.of_plain(json.loads(stdin.readline()))

    def watch() -> None:
        while stdin.read(1):
            pass
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    return errand
