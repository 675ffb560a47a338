"""Two sets of poses side by side: what a comparison comes to, in plain sentences, and one HTML file that
needs nothing else."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Float

from planfit import __version__, units
from planfit.evaluation import (
    NEAR_FACE_M,
    Comparison,
    LocalEvidence,
    Metric,
    PoseDifferences,
    Stretch,
    Witness,
    wall_points,
)
from planfit.report import formatting
from planfit.report.html.page import page_of
from planfit.report.html.tables import captioned, side_by_side, table, width_pt
from planfit.report.measures import CloudXY
from planfit.report.plots import colors
from planfit.report.plots.axes import LEGEND_PT, Entry, new_chart
from planfit.report.plots.drawing import Drawing
from planfit.report.plots.top_view import Crop, draw_points, finish_view, new_view

COLOR_A, COLOR_B = colors.BEFORE, colors.AFTER


@dataclass(frozen=True)
class SideView:
    """One set of poses from above, m."""

    path_xy: Float[np.ndarray, "n 2"]
    """Camera centres."""
    points_xy: Float[np.ndarray, "m 2"]
    """What was seen."""


def crop_to_both(a: SideView, b: SideView) -> Crop:
    """What both cover."""
    return Crop.around([a.path_xy, b.path_xy], [a.points_xy, b.points_xy])


def draw_paths(
    a: SideView,
    b: SideView,
    plan_ends: Float[np.ndarray, "f 2 2"],
    stretches: Sequence[Stretch],
    crop: Crop,
    width_pt: float,
) -> Drawing:
    """Both paths over the plan; a thin line joins the two positions of a frame where they differ most."""
    drawing, axes = new_view(crop, width_pt, LEGEND_PT)
    axes.lines(plan_ends, colors.GREY, 0.6)
    for stretch in stretches:
        frames = np.arange(stretch.first, stretch.last + 1)
        axes.lines(np.stack([a.path_xy[frames], b.path_xy[frames]], axis=1), colors.UNMATCHED, 0.8)
    for side, color in ((a, COLOR_A), (b, COLOR_B)):
        axes.lines([side.path_xy], color, 1.1)
        axes.ring(side.path_xy[0], color)
    entries: list[Entry] = [("A (ring: start)", COLOR_A, "-"), ("B", COLOR_B, "-")]
    if stretches:
        entries.append(("differ most", colors.UNMATCHED, "-"))
    if len(plan_ends):
        entries.append(("plan", colors.GREY, "-"))
    finish_view(axes, len(plan_ends) > 0, entries)
    return drawing


def draw_seen(
    side: SideView, is_b: bool, plan_ends: Float[np.ndarray, "f 2 2"], crop: Crop, width_pt: float
) -> Drawing:
    """What was seen at one set of poses, over the plan."""
    drawing, axes = new_view(crop, width_pt, 6)
    axes.lines(plan_ends, colors.INK, 0.7)
    draw_points(axes, side.points_xy, COLOR_B if is_b else COLOR_A)
    finish_view(axes, len(plan_ends) > 0)
    return drawing


def draw_distances(differences: PoseDifferences, stretches: Sequence[Stretch]) -> Drawing:
    """Distance and angle between A and B, frame by frame; where they differ most is shaded."""
    frames = np.arange(len(differences.distance_m))
    of_both = (
        (differences.distance_m, "distance (m)", 0.05),
        (differences.angle_deg, "angle (deg)", 0.5),
    )
    limits = [(0.0, max(1.05 * float(values.max()), least)) for values, _, least in of_both]
    drawing, axes = new_chart(260, (0.0, max(len(frames) - 1.0, 1.0)), *limits)
    for one, (values, name, _), is_last in zip(axes, of_both, (False, True), strict=True):
        one.spans([(s.first - 0.5, s.last + 0.5) for s in stretches], colors.UNMATCHED)
        one.series(frames, values, colors.INK, 1.2)
        one.rim("frame" if is_last else "", name, False, (is_last, True), least_step=1)
    return drawing


_OTHER = {"a": "b", "b": "a"}


def conclusion(comparison: Comparison) -> str:
    """Which of the two the evidence prefers, by what, and where they differ most."""
    said = {side: [] for side in ("a", "b", "neither")}
    for witness in comparison.witnesses:
        said[witness.prefers].append(witness_in_words(witness))
    preferred = comparison.preferred
    if not comparison.witnesses:
        words = "There is no evidence that could prefer one of them."
    elif preferred != "neither":
        words = f"The evidence prefers {preferred.upper()}: {_joined(said[preferred])}."
        if against := said[_OTHER[preferred]]:
            words += f" But {_joined(against)}."
    elif said["a"]:
        words = f"The evidence is divided: {_joined(said['a'])}; but {_joined(said['b'])}."
    else:
        words = f"The evidence prefers neither: {_joined(said['neither'])}."
    return f"{words} {difference_in_words(comparison)}"


def witness_in_words(witness: Witness) -> str:
    """What one witness says: "B fits the plan better (91 % against 84 % of the wall within 0.10 m)"."""
    metric, side = witness.deciding, witness.prefers
    who = "B" if side == "b" else "A"
    first, second = (metric.after, metric.before) if side == "b" else (metric.before, metric.after)

    def both(text: str, shown: Callable[[float], str], end: str) -> str:
        between = "and" if side == "neither" else "against"
        return f"{text} ({shown(first)} {between} {shown(second)}{end})"

    if witness.name == "matches":
        text = f"{who}'s matches lie closer" if side != "neither" else "matches lie equally close"
        return both(text, lambda v: formatting.length(v / 100), " apart")
    if witness.name == "plan":
        text = f"{who} fits the plan better" if side != "neither" else "both fit the plan alike"
        end = f" of the wall within {formatting.length(NEAR_FACE_M, '.2f')}"
        return both(text, lambda v: formatting.share(1 - v / 100), end)
    if witness.name == "map":
        text = f"{who}'s map is sharper" if side != "neither" else "the maps are equally sharp"
        unit = metric.unit.replace("cm^2", "cm²")
        end = f" of {metric.meaning}"
        return both(text, lambda v: units.quantity(v, unit, ".3g", formatting.SPACE), end)
    text = f"in {who} fewer views contradict each other"
    if side == "neither":
        text = "views contradict each other as often"
    end = " of points looked through"
    return both(text, lambda v: f"{v:.1f}{formatting.SPACE}%", end)


def difference_in_words(comparison: Comparison) -> str:
    """Where they differ most."""
    differences = comparison.differences
    if not comparison.stretches:
        return "Their poses are the same within two centimetres."
    first = comparison.stretches[0].stretch
    where = (
        f"at frame {first.first}"
        if first.first == first.last
        else f"at frames {first.first}-{first.last}"
    )
    aligned = ", once brought together as a whole" if differences.is_aligned else ""
    return (
        f"They differ most {where}, by {formatting.length(first.max_distance_m)} and "
        f"{first.max_angle_deg:.1f}{formatting.SPACE}deg{aligned}; over all frames by "
        f"{formatting.length(differences.rms_m)} RMS."
    )


def whole_in_words(comparison: Comparison) -> str:
    """How much of the difference is one motion of the whole."""
    differences = comparison.differences
    distance_m, angle_deg = differences.whole
    was = "was" if differences.is_aligned else "would be"
    return (
        f"As a whole, B {was} moved by {formatting.length(distance_m)} and {angle_deg:.2f}"
        f"{formatting.SPACE}deg to lie on A best; {formatting.length(differences.aligned_rms_m)} RMS "
        "are left then."
    )


def local_in_words(local: LocalEvidence) -> tuple[str, str]:
    """Matches and wall of a stretch, A against B; a dash where there is too little."""
    matches = " / ".join(_or_dash(formatting.length(v)) for v in local.match_m)
    walls = " / ".join(_or_dash(formatting.share(v)) for v in local.near_share)
    return matches, walls


def _or_dash(text: str) -> str:
    return "–" if text == "n/a" else text


def _joined(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


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
        f'<p class="verdict good">{escape(conclusion(comparison))}</p>',
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
    return (
        f"<h2>Where they differ</h2><p>{escape(difference_in_words(comparison))} Distances are {on}. "
        f"{escape(whole_in_words(comparison))}</p>{_stretch_table(comparison)}"
        f"{side_by_side([paths, distances], crop)}"
        f"<h2>What each makes of the scan</h2><p>{_seen_words(comparison, cloud)}</p>"
        f"{side_by_side(seen, crop)}"
    )


def _stretch_table(comparison: Comparison) -> str:
    rows = [
        (
            f"{local.stretch.first}-{local.stretch.last}",
            formatting.length(local.stretch.max_distance_m),
            f"{local.stretch.max_angle_deg:.1f}{formatting.SPACE}deg",
            *local_in_words(local),
        )
        for local in comparison.stretches
    ]
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
    text = sign + units.quantity(value, _UNITS.get(unit, unit), ".3g", formatting.SPACE).rstrip()
    return text.replace("-", formatting.MINUS)
