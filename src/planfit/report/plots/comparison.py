"""Two sets of poses of one scan: both paths from above, what each sees, and their distance frame by frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.evaluation import PoseDifferences, Stretch
from planfit.report.plots.drawing import (
    AFTER,
    BEFORE,
    GREY,
    INK,
    LEGEND_IN,
    UNMATCHED,
    Entry,
    Picture,
    add_legend,
    label_axes,
    new_frame_charts,
    to_picture,
)
from planfit.report.plots.top_view import Crop, draw_faces, draw_points, draw_scale, view_figure

COLOR_A, COLOR_B = BEFORE, AFTER


@dataclass(frozen=True)
class SideView:
    """One set of poses from above, m."""

    path_xy: Float[np.ndarray, "n 2"]
    """Camera centres."""
    points_xy: Float[np.ndarray, "m 2"]
    """What was seen."""


def crop_to_both(a: SideView, b: SideView) -> Crop:
    """What both cover, plus a margin; stray points are left out."""
    parts = [a.path_xy, b.path_xy]
    parts += [np.percentile(s.points_xy, [0.5, 99.5], axis=0) for s in (a, b) if len(s.points_xy)]
    return Crop.around(np.concatenate(parts))


def draw_paths(
    a: SideView,
    b: SideView,
    plan_ends: Float[np.ndarray, "f 2 2"],
    stretches: Sequence[Stretch],
    crop: Crop,
    width_in: float,
) -> Picture:
    """Both paths over the plan; a thin line joins the two positions of a frame where they differ most."""
    figure, axes = view_figure(crop, width_in, LEGEND_IN, len(plan_ends) > 0)
    draw_faces(axes, crop, plan_ends, GREY, 0.6)
    for stretch in stretches:
        frames = np.arange(stretch.first, stretch.last + 1)
        joined = np.stack([a.path_xy[frames], b.path_xy[frames]], axis=1)
        draw_faces(axes, crop, joined, UNMATCHED, 0.8, 4)
    for side, color in ((a, COLOR_A), (b, COLOR_B)):
        axes.plot(*side.path_xy.T, color=color, linewidth=1.1, zorder=5)
        axes.plot(*side.path_xy[:1].T, "o", color="white", mec=color, markersize=4.5, zorder=6)
    entries: list[Entry] = [
        ("A (ring: start)", COLOR_A, "-"),
        ("B", COLOR_B, "-"),
    ]
    if stretches:
        entries.append(("differ most", UNMATCHED, "-"))
    if len(plan_ends):
        entries.append(("plan", GREY, "-"))
    draw_scale(axes, crop)
    add_legend(axes, entries)
    return to_picture(figure)


def draw_seen(
    side: SideView,
    is_b: bool,
    plan_ends: Float[np.ndarray, "f 2 2"],
    crop: Crop,
    width_in: float,
) -> Picture:
    """What was seen at one set of poses, over the plan."""
    figure, axes = view_figure(crop, width_in, 0.08, len(plan_ends) > 0)
    draw_points(axes, crop, side.points_xy, COLOR_B if is_b else COLOR_A)
    draw_faces(axes, crop, plan_ends, INK)
    draw_scale(axes, crop)
    return to_picture(figure)


def draw_distances(differences: PoseDifferences, stretches: Sequence[Stretch]) -> Picture:
    """Distance and angle between A and B, frame by frame; where they differ most is shaded."""
    n = len(differences.distance_m)
    figure, upper, lower = new_frame_charts(n)
    for axes, values, what, least in (
        (upper, differences.distance_m, "distance (m)", 0.05),
        (lower, differences.angle_deg, "angle (deg)", 0.5),
    ):
        for stretch in stretches:
            axes.axvspan(stretch.first - 0.5, stretch.last + 0.5, color=UNMATCHED, alpha=0.2, lw=0)
        axes.plot(np.arange(n), values, color=INK, linewidth=1.2, zorder=3)
        axes.set_ylim(0.0, max(1.05 * float(values.max()), least))
        label_axes(axes, "frame" if axes is lower else "", what)
    return to_picture(figure)
