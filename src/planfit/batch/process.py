"""The process of a job: started, watched, ended; and what it does to end with who started it."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import IO, Any

from planfit.batch.ledger import End, State
from planfit.batch.perform import Errand

EXIT_LEFT = 3
"""Of a process whose starter went away."""
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

    def stop(self, wait_s: float = 10.0) -> None:
        """End it; what it had finished is in its cache."""
        self.close()
        try:
            self.process.wait(wait_s)
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


def read_errand(stdin: IO[bytes], leave: Callable[[], Any] | None = None) -> Errand:
    """The errand of this process, which ends from now on when `stdin` is closed.

    Args:
        stdin: one line of JSON, then nothing until it is closed.
        leave: ends the process; by default at once: nothing that it writes is half there.
    """
    errand = Errand.of_plain(json.loads(stdin.readline()))

    def watch() -> None:
        while stdin.read(1):
            pass
        (leave or (lambda: os._exit(EXIT_LEFT)))()

    threading.Thread(target=watch, daemon=True).start()
    return errand
