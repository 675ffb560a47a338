"""One job from its inputs to its results, in the process that is there for it."""

import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from filelock import FileLock

from planfit.batch import addresses
from planfit.batch.inputs import inputs_of
from planfit.batch.jobs import Job, Option, is_address, split_storey
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
