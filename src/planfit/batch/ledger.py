"""Where a batch keeps what, and what it remembers of each job beside the job's results."""

import json
import os
import uuid
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from planfit.errors import OutputError
from planfit.runtime.run_folder import finished_record

JOB_KEY = "job"
"""Of `inputs` in `run.json`."""


class End(StrEnum):
    """How the last try of a job ended."""

    DONE = "done"
    """Its run folder is complete; the verdict is in there."""
    REFUSED = "refused"
    """planfit cannot use its input."""
    CRASHED = "crashed"
    """It died, or failed for a reason that may pass."""


@dataclass(frozen=True)
class State:
    """What is remembered of the last try of a job."""

    end: End
    key: str = ""
    reason: str = ""
    """One line, where it is not done."""
    seconds: float | None = None
    """Of the last try; less where stages were in the cache."""
    peak_bytes: int | None = None
    token: str = ""
    """Of the try, given by who started it."""


@dataclass(frozen=True)
class Ledger:
    """The folder of a batch."""

    out: Path

    @property
    def own(self) -> Path:
        """Everything but results and pages; may be deleted."""
        return self.out / "batch"

    def folder(self, name: str) -> Path:
        """Of the results of a job."""
        return self.out / name

    def log(self, name: str) -> Path:
        """What a job said."""
        return self.own / f"{name}.log"

    def lock(self, name: str) -> Path:
        """Held by the process that works on a job."""
        return self.own / f"{name}.lock"

    def thumbnail(self, name: str) -> Path:
        """Small picture of the overlay."""
        return self.own / f"{name}.jpg"

    @property
    def staged(self) -> Path:
        """Copies of what lies at addresses."""
        return self.own / "staged"

    def open(self) -> None:
        """Make the folder.

        Raises:
            OutputError: it cannot be made or written.
        """
        try:
            self.own.mkdir(parents=True, exist_ok=True)
            probe = self.own / f".{uuid.uuid4().hex}"
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise OutputError(
                f"{self.own}: cannot be written ({error.strerror}); choose another folder with -o"
            ) from error

    def state(self, name: str) -> State | None:
        """Of the last try; None where there was none, or it left nothing that can be read."""
        try:
            values = json.loads((self.own / f"{name}.json").read_text(encoding="utf-8"))
            return State(**{**values, "end": End(values["end"])})
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def keep_state(self, name: str, state: State) -> None:
        """Whole or not at all."""
        replace_text(self.own / f"{name}.json", json.dumps(asdict(state), indent=1))

    def close(self, name: str, key: str) -> None:
        """Remember that results of this key are complete, where that is not known: their process was killed
        between the two, or the inputs are again what they were before."""
        state = self.state(name)
        if state is None or (state.end, state.key) != (End.DONE, key):
            self.keep_state(name, State(End.DONE, key))

    def record(self, name: str) -> dict[str, Any] | None:
        """`run.json` of the job's results, whatever key they have; None where there are none, or they are
        just being written."""
        try:
            return finished_record(self.folder(name))
        except OutputError:
            return None

    def is_done(self, name: str, key: str) -> bool:
        """Whether the results of a job are complete and of this key."""
        return key_of(self.record(name)) == key


def key_of(record: dict[str, Any] | None) -> str | None:
    """The key of the job that made a record; None where it was no job of a batch."""
    inputs = (record or {}).get("inputs")
    return inputs.get(JOB_KEY) if isinstance(inputs, dict) else None


def replace_text(path: Path, text: str) -> None:
    """Write a file whole or not at all; several processes may do so."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
