"""What became of each job, as one row: for the page, for jobs.csv, for the exit code."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any
from urllib.parse import quote

from planfit.batch.jobs import Job
from planfit.batch.ledger import End, Ledger, State, key_of
from planfit.batch.memory import GB
from planfit.pipeline.verdict import Outcome


class Result(StrEnum):
    """What is to be said of a job in a word; worse ones later."""

    REFINED = "refined"
    RESERVATIONS = "reservations"
    NO_BETTER = "no better"
    REFUSED = "refused"
    CRASHED = "crashed"
    OPEN = "not done yet"


_OF_OUTCOME = {
    Outcome.REFINED: Result.REFINED,
    Outcome.IMPROVED: Result.RESERVATIONS,
    Outcome.NO_BETTER: Result.NO_BETTER,
}
_WALL_CHECK = "wall points"
"""How the check begins that says which share of the wall lies on the plan."""


@dataclass(frozen=True)
class JobRow:
    """One job on the page."""

    job: Job
    result: Result
    reason: str
    predicted_m: float | None = None
    """Expected position error, RMS."""
    wall_before: float | None = None
    """Share of the wall points that lie on the plan."""
    wall_after: float | None = None
    frames: int | None = None
    seconds: float | None = None
    peak_gb: float | None = None
    report: str = ""
    """Relative path; empty where there is none."""
    log: str = ""
    thumbnail: str = ""


def row_of(job: Job, ledger: Ledger) -> JobRow:
    """A job as it stands in the folder of the batch.

    Results count when they are of the last try's key: those of other inputs are not what the job asks for.
    """
    state, record = ledger.state(job.name), ledger.record(job.name)
    log = _relative(ledger, ledger.log(job.name))
    if key_of(record) is None or (
        state is not None and (state.end is not End.DONE or state.key != key_of(record))
    ):
        if state is None or state.end is End.DONE:
            return JobRow(job, Result.OPEN, "no complete results yet", log=log)
        result = Result.REFUSED if state.end is End.REFUSED else Result.CRASHED
        seconds, peak_gb = _cost(state)
        return JobRow(job, result, state.reason, seconds=seconds, peak_gb=peak_gb, log=log)
    assert record is not None
    return _row_of_record(job, record, state, ledger, log)


def _row_of_record(
    job: Job, record: dict[str, Any], state: State | None, ledger: Ledger, log: str
) -> JobRow:
    verdict = record["verdict"]
    outcome = Outcome(verdict["outcome"])
    reasons = [each["words"] for each in verdict["reservations"]] or verdict["reasons"]
    if outcome is Outcome.NO_BETTER:
        reasons = verdict["reasons"]
    wall = next((c for c in record["checks"] if c["name"].startswith(_WALL_CHECK)), {})
    folder = ledger.folder(job.name)
    seconds, peak_gb = _cost(state)
    return JobRow(
        job,
        _OF_OUTCOME[outcome],
        reasons[0] if reasons else "",
        verdict["predicted_error_rms_m"],
        wall.get("before"),
        wall.get("after"),
        record["frames"],
        seconds=seconds,
        peak_gb=peak_gb,
        report=_relative(ledger, folder / "report.html"),
        log=log,
        thumbnail=_relative(ledger, ledger.thumbnail(job.name)),
    )


def _cost(state: State | None) -> tuple[float | None, float | None]:
    """Seconds and gigabytes."""
    if state is None:
        return None, None
    return state.seconds, None if state.peak_bytes is None else state.peak_bytes / GB


def _relative(ledger: Ledger, path: Path) -> str:
    """Address of a file from the page; empty where there is no file."""
    return quote(path.relative_to(ledger.out).as_posix()) if path.exists() else ""


def rows_as_csv(rows: Sequence[JobRow]) -> str:
    """The same as the page, a line a job."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        [
            "name", "verdict", "reason", "predicted_error_m", "wall_on_plan_before", "wall_on_plan_after",
            "frames", "seconds", "peak_memory_gb", "scan", "plan", "report",
        ]
    )  # fmt: skip
    for row in rows:
        numbers = (row.predicted_m, row.wall_before, row.wall_after)
        writer.writerow(
            [
                row.job.name, row.result.value, row.reason, *(_number(n, ".4f") for n in numbers),
                "" if row.frames is None else row.frames, _number(row.seconds, ".1f"),
                _number(row.peak_gb, ".2f"), row.job.scan, " ".join(row.job.plans), row.report,
            ]
        )  # fmt: skip
    return out.getvalue()


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)
