"""Tables and figures of a page."""

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import Literal

import numpy as np

from planfit.matching.pairs import PairOptions
from planfit.pipeline.evidence import Evidence
from planfit.pipeline.result import RefineResult
from planfit.report import formatting
from planfit.report.measures import BeforeAfter, KeyMetric, Measures
from planfit.report.plots.drawing import PANEL_PT, Drawing, to_svg
from planfit.report.plots.overlay import WIDE_PT, is_wide
from planfit.report.plots.top_view import Crop

LOOP_MIN_FRAMES = PairOptions.neighbours
"""Pairs of frames further apart than this are loop closures."""
_TERMS = {
    "points": "matched points",
    "reprojection": "matched points, seen again",
    "rays": "viewing rays of matched points",
    "floor": "floor",
    "walls": "walls",
    "ceiling": "ceiling",
    "columns": "columns",
    "odometry": "recorded motion",
}
_CLASSES = {"w": "", "n": ' class="num"'}
"""Of columns of words and of numbers."""
_Side = Literal["before", "after"]
"""Of the refinement."""


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], kinds: str) -> str:
    """An HTML table.

    Args:
        heads: column titles, plain text.
        rows: cells, HTML.
        kinds: for each column w (words) or n (numbers, aligned to the right).
    """
    styles = [_CLASSES[kind] for kind in kinds]
    head = "".join(_head(escape(h), style) for h, style in zip(heads, styles, strict=True))
    body = []
    for row in rows:
        cells = "".join(f"<td{style}>{cell}</td>" for cell, style in zip(row, styles, strict=True))
        body.append(f"<tr>{cells}</tr>")
    top = f"<thead><tr>{head}</tr></thead>" if any(heads) else ""
    return (
        f'<div class="scroll" tabindex="0"><table>{top}<tbody>{"".join(body)}</tbody></table></div>'
    )


def _head(words: str, style: str) -> str:
    # A head without words is no head to a screen reader.
    return f'<th scope="col"{style}>{words}</th>' if words else "<td></td>"


def stretch_table(evidence: Evidence) -> str:
    """What the evidence says of each stretch of the walk."""
    n_visits = Counter(
        frames for visit in evidence.visits for frames in (visit.first_frames, visit.last_frames)
    )
    rows = [
        (
            " to ".join(f'<span data-frame="{i}">{i}</span>' for i in stretch.frames),
            formatting.length(stretch.predicted_m),
            str(stretch.n_patches),
            formatting.share(stretch.near_kept_out) if stretch.n_patches else "",
            formatting.share(stretch.beside) if stretch.n_patches else "",
            str(n_visits[stretch.frames]),
        )
        for stretch in evidence.stretches
    ]
    heads = ("frames", "predicted error", "wall patches", "on the plan", "beside it", "seen again")
    return table(heads, rows, "nnnnnn")


def key_metric_table(metrics: Sequence[KeyMetric]) -> str:
    """Before, after and change of the numbers that matter."""
    rows = []
    for metric in metrics:
        state = "worse" if metric.is_worse else "better" if metric.is_improved else ""
        rows.append(
            (
                f"<strong>{escape(metric.name)}</strong><br><small>{escape(metric.meaning)}</small>",
                f'<span class="before">{formatting.quantity(metric.before, metric.unit)}</span>',
                f'<span class="after">{formatting.quantity(metric.after, metric.unit)}</span>',
                f'<span class="{state}">'
                f"{formatting.change(metric.before, metric.after, metric.unit)}</span>"
                + (f"<br><small>{state}</small>" if state else ""),
            )
        )
    return f'<div class="keys">{table(("", "before", "after", "change"), rows, "wnnn")}</div>'


def cost_table(result: RefineResult) -> str:
    """Robust cost of each term."""
    rows = [
        (
            escape(_TERMS.get(name, name)),
            f'<span class="before">{_cost(before)}</span>',
            f'<span class="after">{_cost(after)}</span>',
            formatting.change(before, after, ""),
        )
        for name, (before, after) in result.cost_by_term.items()
    ]
    total = [sum(cost[k] for cost in result.cost_by_term.values()) for k in (0, 1)]
    rows.append(
        (
            "<strong>sum</strong>",
            _cost(total[0]),
            _cost(total[1]),
            formatting.change(total[0], total[1], ""),
        )
    )
    return table(("term", "before", "after", "change"), rows, "wnnn")


def time_table(result: RefineResult) -> str:
    """Seconds of each stage."""
    by_stage = result.seconds_by_stage
    rows = [(escape(stage), formatting.seconds(value)) for stage, value in by_stage.items()]
    rows.append(("<strong>sum</strong>", formatting.seconds(sum(by_stage.values()))))
    return table(("stage", "time"), rows, "wn")


def statistics_table(result: RefineResult, path_length: float) -> str:
    """What was seen, and what became of it."""
    matches, structure, adjustment = result.matches, result.structure, result.adjustment
    n_wall, surfaces = structure.n_wall_points, result.surfaces
    rows = [
        ("frames", formatting.count(len(result.plan_from_cams))),
        ("keyframes, whose images were looked at", formatting.count(len(result.solved_frame_idx))),
        ("path length, as recorded", formatting.length(path_length, ".0f")),
        ("keypoints with depth", formatting.count(matches.n_keypoints)),
        ("pairs of frames tried", formatting.count(matches.n_tried)),
        ("pairs verified", formatting.count(len(matches.pairs))),
        (
            f"of these, loop closures (more than {LOOP_MIN_FRAMES} keyframes apart)",
            formatting.count(matches.n_loops(LOOP_MIN_FRAMES, result.solved_frame_idx)),
        ),
        ("matched points", formatting.count(matches.n_matches)),
        ("pairs matched by geometry", formatting.count(len(surfaces))),
        (
            "of these, pairs that leave a direction free",
            formatting.count(int((surfaces.n_free > 0).sum())),
        ),
        ("wall points", formatting.count(n_wall)),
        ("wall patches", formatting.count(len(structure.walls))),
        *_plan_rows(result),
        ("floor points", formatting.count(len(structure.floor.points_cam))),
        ("floor and walls labelled by", escape(structure.back_end)),
        ("direction of gravity", escape(result.gravity.source)),
        ("last solve ended because", escape(adjustment.solution.stop.value)),
    ]
    return table(("", ""), rows, "ww")


def _plan_rows(result: RefineResult) -> list[tuple[str, str]]:
    """Walls found on the plan, and the alignment with it; nothing without a plan."""
    if result.floorplan is None:
        return []
    adjustment, n_patches = result.adjustment, len(result.structure.walls)
    found = adjustment.association.n_associated
    share = f" ({formatting.share(found / n_patches)})" if n_patches else ""
    return [
        ("of these, found on the plan", formatting.count(found) + share),
        *_alignment_rows(result),
        (
            "rounds of wall association",
            f"{adjustment.rounds}, {'converged' if adjustment.converged else 'not converged'}",
        ),
    ]


def _alignment_rows(result: RefineResult) -> list[tuple[str, str]]:
    alignment = result.alignment
    if alignment is None:
        return [("alignment with the plan", "not found: no wall patch was seen")]
    other = alignment.runner_up
    rows = [
        ("alignment with the plan: scanned wall that fits", formatting.share(alignment.score)),
        ("second-best alignment elsewhere", formatting.share(other.score) if other else "none"),
        (
            "margin between the two",
            f"{100 * alignment.margin:.0f}{formatting.SPACE}percentage points",
        ),
    ]
    if alignment.scale_xy != (1.0, 1.0):
        sigma = f", sigma {alignment.scale_sigma:.2%}" if alignment.scale_sigma > 0 else ""
        rows.append(
            ("one unit of the plan", f"{alignment.metres_per_unit:.5g}{formatting.SPACE}m{sigma}")
        )
    if alignment.is_as_recorded:
        rows.append(("alignment recorded by the scan's format", "agrees with the one found"))
    return rows


def _cost(value: float) -> str:
    if abs(value) < formatting.NOTHING:
        return "0"
    return formatting.count(round(value)) if abs(value) >= 100 else f"{value:.3g}"


@dataclass(frozen=True)
class Cell:
    """What is shown, and what it is sorted by."""

    html: str
    key: float | str

    @staticmethod
    def empty() -> "Cell":
        """Last when sorted."""
        return Cell("", float("inf"))


def sortable_table(
    heads: Sequence[str], rows: Sequence[tuple[str, str, tuple[Cell, ...]]], what: str = "walls"
) -> str:
    """A table whose heads sort it (`page.js`), of class, more attributes (HTML), and cells of each row; the
    second column is words, the others are numbers."""
    kinds = "nw" + "n" * (len(heads) - 2)
    body = "".join(
        f'<tr class="{style}"{f" {more}" if more else ""}>'
        + "".join(_td(c, _CLASSES[k]) for c, k in zip(row, kinds, strict=True))
        + "</tr>"
        for style, more, row in rows
    )
    return (
        f'<p class="on-paper">On paper, only {what} that are not as drawn are listed.</p>'
        f'<div class="walls"><table class="sortable">{sortable_head(heads, kinds)}'
        f"<tbody>{body}</tbody></table></div>"
    )


def sortable_head(heads: Sequence[str], kinds: str) -> str:
    """The heads of a table that `page.js` sorts: a button each, where it has a name; kinds as of `table`."""
    buttons = (f'<button type="button">{escape(head)}</button>' if head else "" for head in heads)
    cells = (_head(b, _CLASSES[k]) for k, b in zip(kinds, buttons, strict=True))
    return f"<thead><tr>{''.join(cells)}</tr></thead>"


def _td(cell: Cell, kind: str) -> str:
    if isinstance(cell.key, str):
        return f'<td{kind} data-key="{escape(cell.key)}">{cell.html}</td>'
    key = "" if np.isinf(cell.key) else f"{cell.key:.6g}"
    return f'<td{kind} data-key="{key}">{cell.html}</td>'


def color_keys(entries: Iterable[tuple[str, str]]) -> str:
    """What colours mean: each, and words (HTML)."""
    return " ".join(
        f'<span class="entry"><span class="key" style="background:{color}"></span>{words}</span>'
        for color, words in entries
    )


def plural(count: int, one: str, many: str) -> str:
    """The word that goes with a count."""
    return one if count == 1 else many


def width_pt(crop: Crop) -> float:
    """Width of a picture of a crop: the whole page for wide ones."""
    return WIDE_PT if is_wide(crop) else PANEL_PT


def sides(both: BeforeAfter) -> tuple[tuple[_Side, Measures], tuple[_Side, Measures]]:
    """Before and after, each with its name."""
    return ("before", both.before), ("after", both.after)


def side_by_side(pictures: Sequence[str], crop: Crop) -> str:
    """Before and after beside each other, or one above the other where both are wide."""
    return f'<div class="{"stack" if is_wide(crop) else "pair"}">{"".join(pictures)}</div>'


def captioned(picture: Drawing, caption_html: str, alt: str, side: _Side = "after") -> str:
    """A picture inside the page, its caption above it; pressed, it shows frames as they are on that side."""
    attributes = f'aria-label="{escape(alt)}"'
    if picture.clicks is not None:
        clicks = json.dumps(asdict(picture.clicks) | {"side": side})
        attributes += f' data-clicks="{escape(clicks)}"'
    # On a phone wide ones are scrolled, by the keyboard too.
    style = 'class="plot wide" tabindex="0"' if picture.width_pt > PANEL_PT else 'class="plot"'
    return (
        f"<figure><figcaption>{caption_html}</figcaption>"
        f"<div {style}>{to_svg(picture, attributes)}</div></figure>"
    )
