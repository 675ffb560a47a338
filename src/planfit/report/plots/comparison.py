"""Two sets of poses of one scan: both paths from above, what each sees, and their distance frame by frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.evaluation import PoseDifferences, Stretch
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
