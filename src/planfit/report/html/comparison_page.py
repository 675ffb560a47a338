"""Two sets of poses side by side: one HTML file that needs nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from planfit import __version__
from planfit.evaluation import Comparison, Metric, wall_points
from planfit.report import comparison_words as words
from planfit.report import formatting
from planfit.report.html.page import page_of
from planfit.report.html.tables import captioned, table, width_pt
from planfit.report.measures import CloudXY
from planfit.report.plots.comparison import (
    SideView,
    crop_to_both,
    draw_distances,
    draw_paths,
    draw_seen,
)
from planfit.report.plots.overlay import is_wide

_SIDES = {"a": "A", "b": "B", "neither": "neither"}
_UNITS = {"1": "", "cm^2": "cm²"}


@dataclass(frozen=True)
class Compared:
    """What is compared, by name."""

    scan: str
    a: str
    b: str
    plan: str = ""


def make_comparison(
    what: Compared, comparison: Comparison, cloud: CloudXY | None = None, notes: Sequence[str] = ()
) -> str:
    """A comparison as one self-contained HTML page.

    Args:
        what: names, for the head.
        comparison: of `planfit.compare`.
        cloud: what was seen, from above, at A and B (m, axes of `comparison.poses.plan_from_cams`); without,
            the points of walls.
        notes: more than the comparison's own.
    """
    every_note = "".join(f"<li>{escape(note)}</li>" for note in (*notes, *comparison.notes))
    under = f"planfit {__version__} compares A, {what.a}, with B, {what.b}"
    body = [
        f"<h1>{escape(what.scan)}: A and B</h1>",
        f'<p class="under">{escape(under)}</p>',
        f'<p class="verdict good">{escape(words.conclusion(comparison))}</p>',
        f'<div class="warnings"><h2>Notes</h2><ul>{every_note}</ul></div>' if every_note else "",
        "<h2>What the evidence says</h2>",
        "<p>Each kind of evidence decides by one number; a difference too small to tell prefers neither. "
        "Lower is better.</p>",
        witness_table(comparison),
        _where(comparison, what, cloud),
        "<h2>All metrics</h2><p>Lower is better; 'planfit help metrics' defines each.</p>",
        metric_table(list(comparison.metrics.values())),
        f"<footer>Made by planfit {escape(__version__)}.</footer>",
    ]
    return page_of(f"{what.scan}: A and B compared by planfit", body)


def witness_table(comparison: Comparison) -> str:
    """What each witness prefers, and by how much."""
    rows = [
        (
            f"<strong>{escape(w.name)}</strong><br><small>{escape(w.deciding.meaning)}</small>",
            _amount(w.deciding.before, w.deciding.unit),
            _amount(w.deciding.after, w.deciding.unit),
            f"<strong>{_SIDES[w.prefers]}</strong>",
        )
        for w in comparison.witnesses
    ]
    if not rows:
        return "<p>Too little was seen to judge by.</p>"
    return f'<div class="keys">{table(("", "A", "B", "prefers"), rows, "wnnn")}</div>'


def metric_table(metrics: Sequence[Metric]) -> str:
    """Every metric of both."""
    rows = [
        (
            escape(m.meaning.strip()),
            _amount(m.before, m.unit),
            _amount(m.after, m.unit),
            _amount(m.difference, m.unit, signed=True),
        )
        for m in metrics
    ]
    return table(("", "A", "B", "B minus A"), rows, "wnnn")


def _where(comparison: Comparison, what: Compared, cloud: CloudXY | None) -> str:
    """Where they differ: in words, as a table, and in pictures."""
    a, b = _views(comparison, cloud)
    crop = crop_to_both(a, b)
    stretches = [local.stretch for local in comparison.stretches]
    plan_ends = np.zeros((0, 2, 2))
    if comparison.poses.floorplan is not None:
        plan_ends = comparison.poses.floorplan.ends
    width = width_pt(crop)
    paths = captioned(
        draw_paths(a, b, plan_ends, stretches, crop, width),
        "<strong>Both paths from above.</strong> Lines join the two positions of a frame where A and B "
        "differ most.",
        "The paths of A and B from above",
    )
    distances = captioned(
        draw_distances(comparison.differences, stretches),
        "<strong>Distance between A and B,</strong> frame by frame; where they differ most is shaded.",
        "Distance and angle between A and B of each frame",
    )
    seen = [
        captioned(
            draw_seen(side, name == "B", plan_ends, crop, width),
            f"<strong>{name}:</strong> {escape(of)}",
            f"What was seen at the poses of {name}, from above",
        )
        for name, side, of in (("A", a, what.a), ("B", b, what.b))
    ]
    on = (
        f"in the plan's axes ({what.plan})"
        if comparison.axes == "plan"
        else "in the scan's own axes"
    )
    style = "stack" if is_wide(crop) else "pair"
    return (
        f"<h2>Where they differ</h2><p>{escape(words.difference_in_words(comparison))} Distances are {on}. "
        f"{escape(words.whole_in_words(comparison))}</p>{_stretch_table(comparison)}"
        f'<div class="{style}">{paths}{distances}</div>'
        f"<h2>What each makes of the scan</h2><p>{_seen_words(comparison, cloud)}</p>"
        f'<div class="{style}">{"".join(seen)}</div>'
    )


def _stretch_table(comparison: Comparison) -> str:
    rows = []
    for local in comparison.stretches:
        stretch = local.stretch
        rows.append(
            (
                f"{stretch.first}-{stretch.last}",
                formatting.length(stretch.max_distance_m),
                f"{stretch.max_angle_deg:.1f}{formatting.SPACE}deg",
                *words.local_in_words(local),
            )
        )
    heads = ("frames", "apart by", "turned by", "matches there, A / B", "wall on plan, A / B")
    return table(heads, rows, "wnnnn") if rows else ""


def _seen_words(comparison: Comparison, cloud: CloudXY | None) -> str:
    dots = "a scanned point of a wall" if cloud is None else "a point at about the camera's height"
    lines = "; dark lines are the plan" if comparison.poses.floorplan is not None else ""
    return (
        f"Seen from above; each dot is {dots}{lines}. Where poses are right, one wall makes one line of "
        "dots."
    )


def _views(comparison: Comparison, cloud: CloudXY | None) -> tuple[SideView, SideView]:
    a, b = comparison.poses.plan_from_cams
    structure = comparison.poses.structure
    shown = cloud or (wall_points(structure, a)[:, :2], wall_points(structure, b)[:, :2])
    return SideView(a[:, :2, 3], shown[0]), SideView(b[:, :2, 3], shown[1])


def _amount(value: float, unit: str, signed: bool = False) -> str:
    sign = "+" if signed and value > 0 else ""
    text = f"{sign}{value:.3g}{formatting.SPACE}{_UNITS.get(unit, unit)}".rstrip()
    return text.replace("-", formatting.MINUS)
