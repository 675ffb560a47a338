"""The page of a batch: a row a job, in a table of all scans that sorts, with pictures and links; and the
same as jobs.csv."""

import csv
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from filelock import FileLock
from PIL import Image

from planfit import __version__
from planfit.batch.jobs import Job
from planfit.batch.ledger import End, Ledger, State, key_of, replace_text
from planfit.batch.memory import GB
from planfit.pipeline.verdict import Outcome
from planfit.report import formatting
from planfit.report.html.page import page_of
from planfit.report.html.tables import sortable_head


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
                row.job.name, row.result.value, row.reason, *(_formatted(n, ".4f") for n in numbers),
                "" if row.frames is None else row.frames, _formatted(row.seconds, ".1f"),
                _formatted(row.peak_gb, ".2f"), row.job.scan, " ".join(row.job.plans), row.report,
            ]
        )  # fmt: skip
    return out.getvalue()


def _formatted(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


_THUMBNAIL_PX = (360, 130)
_HEADS = (
    "scan", "verdict", "", "predicted error", "wall on plan before", "after", "frames", "time", "memory",
)  # fmt: skip
_COLOR = {
    Result.REFINED: "good", Result.RESERVATIONS: "fair", Result.NO_BETTER: "bad", Result.REFUSED: "bad",
    Result.CRASHED: "bad", Result.OPEN: "",
}  # fmt: skip
_WORDS = {result: result.value for result in Result} | {Result.RESERVATIONS: "with reservations"}
_STYLE = """<style>
body { max-width: 90rem; }
td.words { min-width: 11rem; max-width: 30rem; overflow-wrap: anywhere; }
td.words small { display: block; }
td.picture { width: 15rem; min-width: 9rem; }
td.picture img { width: 100%; max-width: 15rem; border: 1px solid var(--line); }
.mark { white-space: nowrap; font-weight: 600; border-left: 4px solid var(--line); padding-left: .5em; }
.mark.good { border-color: #0072b2; }
.mark.fair { border-color: #d99100; }
.mark.bad { border-color: #b91c1c; }
.jobs { overflow-x: auto; }
.jobs th button { all: unset; cursor: pointer; }
.jobs th button:focus-visible { outline: 2px solid var(--after); }
.jobs th[aria-sort] button::after { content: " \\2191"; }
.jobs th[aria-sort="descending"] button::after { content: " \\2193"; }
@media print { .jobs { overflow: visible; } .jobs tr { break-inside: avoid; } }
</style>"""


def write_page(jobs: Sequence[Job], ledger: Ledger, title: str) -> list[JobRow]:
    """Write OUT/index.html and OUT/jobs.csv from what lies in OUT, and give what they show.

    Batches over the same OUT, shards of an array say, write one after the other, each after it looked: the
    last to end leaves a page that knows all.
    """
    with FileLock(ledger.own / ".page.lock"):
        for job in jobs:
            _make_thumbnail(ledger.folder(job.name), ledger.thumbnail(job.name))
        rows = [row_of(job, ledger) for job in jobs]
        replace_text(ledger.out / "jobs.csv", rows_as_csv(rows))
        replace_text(ledger.out / "index.html", page_of_rows(rows, title))
    return rows


def page_of_rows(rows: Sequence[JobRow], title: str) -> str:
    """The page; pictures and reports are linked, nothing is fetched from elsewhere."""
    head = sortable_head(_HEADS, "wwwnnnnnn")
    body = "".join(f"<tr>{_cells(row)}</tr>\n" for row in sorted(rows, key=_from_worst))
    return page_of(
        f"{title}: planfit batch",
        [
            _STYLE,
            f"<h1>{escape(title)}</h1>",
            f'<p class="under">{len(rows)} scans refined by planfit {escape(__version__)}</p>',
            f'<p class="verdict {_worst(rows)}">{escape(counts_in_words(rows))}</p>',
            "<p>What needs a look comes first; a head sorts by its column. The predicted error is that of "
            "camera positions (RMS); wall on plan is the share of wall points within 0.1 m of it.</p>",
            f'<div class="jobs"><table class="sortable">{head}<tbody>\n{body}</tbody></table></div>',
            '<footer>The same as a table: <a href="jobs.csv">jobs.csv</a>.</footer>',
        ],
    )


def counts_in_words(rows: Sequence[JobRow]) -> str:
    """How many ended how: `48 refined, 1 no better, 1 crashed`."""
    found = Counter(row.result for row in rows)
    return ", ".join(f"{found[result]} {_WORDS[result]}" for result in Result if found[result])


def _from_worst(row: JobRow) -> int:
    return len(Result) - list(Result).index(row.result)


def _worst(rows: Sequence[JobRow]) -> str:
    found = {_COLOR[row.result] for row in rows}
    return next((color for color in ("bad", "fair") if color in found), "good")


def _cells(row: JobRow) -> str:
    name = escape(row.job.name)
    linked = f'<a href="{row.report}">{name}</a>' if row.report else name
    log = f' <small><a href="{row.log}">log</a></small>' if row.log and not row.report else ""
    picture = (
        f'<a href="{row.report}"><img src="{row.thumbnail}" loading="lazy" alt="Walls over the plan, before '
        f'and after: {name}"></a>'
        if row.thumbnail
        else ""
    )
    words = (
        f'<span class="mark {_COLOR[row.result]}">{_WORDS[row.result]}</span>'
        f"<small>{escape(row.reason)}</small>{log}"
    )
    peak = "" if row.peak_gb is None else f"{row.peak_gb:.1f}{formatting.SPACE}GB"
    return "".join(
        [
            _td("words", row.job.name, linked),
            _td("words", f"{_from_worst(row)} {row.reason}", words),
            _td("picture", "", picture),
            _shown(row.predicted_m, formatting.length(row.predicted_m)),
            _shown(row.wall_before, formatting.share(row.wall_before)),
            _shown(row.wall_after, formatting.share(row.wall_after)),
            _shown(row.frames, formatting.count(row.frames or 0)),
            _shown(row.seconds, formatting.seconds(row.seconds or 0.0)),
            _shown(row.peak_gb, peak),
        ]
    )


def _shown(value: float | None, text: str) -> str:
    return _td("num", "", "") if value is None else _td("num", f"{value:.6g}", text)


def _td(style: str, key: str, html: str) -> str:
    return f'<td class="{style}" data-key="{escape(key)}">{html}</td>'


def _make_thumbnail(folder: Path, target: Path) -> None:
    """A small copy of the overlay, where it is newer; none where there is none."""
    try:
        overlay = min(folder.glob("overlay*.png"), default=None)  # of several storeys: the lowest
        if overlay is None:
            target.unlink(missing_ok=True)
            return
        if target.exists() and target.stat().st_mtime_ns >= overlay.stat().st_mtime_ns:
            return
        with Image.open(overlay) as picture:
            small = picture.convert("RGB")
            small.thumbnail(_THUMBNAIL_PX, Image.Resampling.LANCZOS)
            part = target.with_name(f".{target.name}.part")
            small.save(part, "JPEG", quality=80)
        part.replace(target)
    except OSError:
        target.unlink(missing_ok=True)  # a page without a picture is better than none
