"""Rows as they are kept, and as a page: totals, a column a building, then every row."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from buildings.cases import Case
from buildings.failures import Comparison, failures_of, median
from buildings.rows import SILENT, Row
from planfit.errors import OutputError

KEPT = Path(__file__).parents[1] / "results" / "buildings.json"
NOT_KEPT = ("digest", "convention", "is_recognised", "moved_seen", "moved_named", "within_predicted",
            "cost", "cost_from_truth", "true_error_m", "seconds")  # fmt: skip
"""Fields of the battery's rows that say nothing here, or differ in every run."""


def read_kept(path: Path = KEPT) -> list[Row]:
    """The rows that were kept last; none where there is no file.

    Raises:
        OutputError: the file is another.
    """
    if not path.exists():
        return []
    names = {field.name for field in fields(Row)}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))["rows"]
        return [
            Row(digest="", **{k: _tupled(k, v) for k, v in row.items() if k in names})
            for row in found
        ]
    except (ValueError, KeyError, TypeError) as error:
        raise OutputError(
            f"{path}: expected rows of 'benchmarks/buildings run --keep', found another text ({error})"
        ) from error


def _tupled(name: str, value: Any) -> Any:
    return tuple(value) if name == "warnings" and isinstance(value, list) else value


def write_kept(rows: Sequence[Row], conditions: dict[str, str | float], path: Path = KEPT) -> None:
    """Keep rows, one a line, so that changes are seen line by line."""
    lines = [json.dumps(_plain(row), ensure_ascii=False) for row in rows]
    text = ",\n".join(lines)
    head = json.dumps(conditions, ensure_ascii=False)
    path.write_text(f'{{"conditions": {head}, "rows": [\n{text}\n]}}\n', encoding="utf-8")


def _plain(row: Row) -> dict:
    values = {
        k: v
        for k, v in asdict(row).items()
        if k not in NOT_KEPT and v not in ("", None, [], {}, ())
    }
    return {k: _rounded(v) for k, v in values.items()}


def _rounded(value: Any) -> Any:
    """Metres to a tenth of a millimetre."""
    if isinstance(value, float):
        return round(value, 4)
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    return value


@dataclass(frozen=True)
class Column:
    """A building in the totals."""

    name: str
    kind: str
    chosen_on: str
    rows: tuple[Row, ...]

    @property
    def cells(self) -> list[str]:
        """As the totals show it."""
        poses = [row for row in self.rows if not row.reading and row.error_m is not None]
        failed = [failures_of(row) for row in self.rows]
        kinds = [each.kind for failures in failed for each in failures]
        vouched = sum(row.exit_code == 0 for row in self.rows)
        return [
            self.name,
            self.kind,
            self.chosen_on or "-",
            str(len(self.rows)),
            str(sum(bool(failures) for failures in failed)),
            str(kinds.count(SILENT)),
            str(sum(kind.startswith("false") for kind in kinds)),
            str(sum(kind.startswith(("flipped", "unsteady")) for kind in kinds)),
            f"{vouched}",
            _m(median(row.before_m for row in poses)),
            _m(median(row.error_m for row in poses)),
            _m(max((row.error_m or 0.0 for row in poses), default=None)),
            _m(median(row.height_m for row in poses)),
            _number(median(row.sigmas for row in poses)),
            f"{sum(row.cpu_s for row in self.rows):.0f}",
            f"{max((row.peak_gb for row in self.rows), default=0.0):.2f}",
        ]


HEAD = ["building", "kind", "chosen on it", "rows", "fail", "silent wrong", "false", "unsteady", "exit 0",
        "before, m", "error, m", "worst, m", "heights, m", "sigmas", "CPU s", "peak GB"]  # fmt: skip
"""Errors, heights and sigmas are medians."""


def columns(rows: Sequence[Row], cases: Sequence[Case]) -> list[Column]:
    """A column a building, in the order of the cases."""
    by_building: dict[str, list[Row]] = {}
    for row in rows:
        by_building.setdefault(row.building, []).append(row)
    known = {case.scan: case.building for case in cases}
    found = []
    for name, own in by_building.items():
        building = known.get(name)
        kind, chosen_on = ("read", "") if building is None else (building.kind, building.chosen_on)
        found.append(Column(name, kind, chosen_on, tuple(own)))
    return found


def totals(found: Sequence[Column], leave_out: Sequence[str] = ()) -> list[list[str]]:
    """Rows of cells: each building, then all of them, those left out aside."""
    kept = [column for column in found if column.name not in leave_out]
    rows = [column.cells for column in kept]
    groups = {
        "all": kept,
        "all but those chosen on": [column for column in kept if not column.chosen_on],
    }
    for name, some in groups.items():
        cells = Column(name, "", "", tuple(row for column in some for row in column.rows)).cells
        rows.append(cells)
    rows += [column.cells for column in found if column.name in leave_out]
    return rows


def make_page(
    rows: Sequence[Row], cases: Sequence[Case], conditions: dict[str, str | float]
) -> str:
    """The page as Markdown."""
    told = ", ".join(f"{name} {value}" for name, value in conditions.items())
    found = columns(rows, cases)
    failing = [(row.name, failures_of(row)) for row in rows]
    fails = [[name, "; ".join(each.words for each in found)] for name, found in failing if found]
    parts = [
        _HEAD_OF_PAGE.format(conditions=told),
        "## Totals", _markdown(HEAD, totals(found)),
        "## What fails", _markdown(["case", "what"], fails),
        "## Every scan", _markdown(POSE_HEAD, [_pose_cells(row) for row in rows if not row.reading]),
        "## Every file that is read", _markdown(
            ["file", "outcome", "facts right", "CPU s"],
            [_reading_cells(row) for row in rows if row.reading],
        ),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


POSE_HEAD = ["case", "before, m", "error, m", "aligned, m", "largest, m", "heights before, m",
             "heights, m", "metre off", "exit", "predicted, m", "sigmas", "announced (truth): verdict",
             "CPU s", "peak GB"]  # fmt: skip


def _pose_cells(row: Row) -> list[str]:
    claims = [f"{kind} {_said(said)} ({_said(truth)}): {verdict}"
              for kind, (said, truth, verdict) in row.corrections.items()]  # fmt: skip
    scale = "" if row.is_metric or row.scale_error is None else f"{row.scale_error:+.2%}"
    return [row.name, _m(row.before_m), _m(row.error_m), _m(row.aligned_m), _m(row.largest_m),
            _m(row.height_before_m), _m(row.height_m), scale, str(row.exit_code), _m(row.predicted_m),
            _number(row.sigmas), "; ".join(claims), f"{row.cpu_s:.0f}", f"{row.peak_gb:.2f}"]  # fmt: skip


def _reading_cells(row: Row) -> list[str]:
    right = sum(bool(is_right) for *_, is_right in row.facts)
    return [row.name, row.reading, f"{right} of {len(row.facts)}", f"{row.cpu_s:.1f}"]


def _said(value: object) -> str:
    if isinstance(value, list):
        return "none" if not value else " ".join(_said(each) for each in value[:4])
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def comparison_words(found: Comparison, n_kept: int) -> list[str]:
    """Regressions first, then progress, then rows that are new."""
    lines = [f"worse: {words}" for words in found.worse]
    lines += [f"better: {words}" for words in found.better]
    if found.new and n_kept:
        lines.append(f"new: {', '.join(found.new)}")
    if not found.worse and n_kept:
        lines.insert(0, "no regression against the rows kept")
    return lines


def plain_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a screen, columns as wide as they need."""
    cells = [list(head), *map(list, rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    return [
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(head)} |", f"| {' | '.join(['---'] * len(head))} |"]
    lines += [f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows]
    return "\n".join(lines)


def _m(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


_HEAD_OF_PAGE = """# Real buildings

From `make buildings` ({conditions}). Every real scan and plan that is at hand: scans that were recorded
(*real*), real walls and walks rendered as depth (*semi-real*), rooms that are no boxes (*rendered*), and
plans and recordings of others that are only read. Recorded poses are drawn afresh from a seed: a slow turn,
a slow shift, a tracker 1 and 2 % off, a jump. *Left out* is a tenth of the frames, or of the plan's walls.
Errors are RMS of positions in the plan's frame, without alignment to the truth, in metres; of a plan
without unit those on the plan, and how far the metre is off beside. Heights are less their mean. *Sigmas*:
that error over the predicted one. Of totals, errors, heights and sigmas are medians.

A row fails where exit 0 is said of more than 0.15 m or of more than 2.5 sigmas (*silent wrong*), where a
result within 0.08 m is not vouched for, poses or heights are made worse, a correction is announced that is
not to be made (*false*), or a decision flips or frames move beyond twice their predicted error when a tenth
is left out (*unsteady*). What was chosen on a building says so: figures count on the others."""
