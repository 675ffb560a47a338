"""Matches between frames: loop closures from above, and matched points of each frame."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.collections import LineCollection
from matplotlib.ticker import MaxNLocator

from planfit.matching import Matches
from planfit.report.plots.drawing import (
    AFTER,
    LIGHT,
    PANEL_IN,
    UNMATCHED,
    Picture,
    add_axes,
    clicks_of,
    label_axes,
    new_figure,
    to_picture,
)
from planfit.report.plots.overlay import LEGEND_IN, Entry, add_legend, view_figure
from planfit.report.plots.top_view import Crop, draw_faces, draw_paths, draw_scale, set_up_view
from planfit.scan.joined import FramesOfScan

_HEIGHT_IN = 2.4


def loop_closures_of(
    matches: Matches, min_frames: int, keyframe_idx: Int[np.ndarray, " k"]
) -> Int[np.ndarray, "c 2"]:
    """Verified pairs of frames that are more than `min_frames` keyframes apart."""
    apart = np.diff(np.searchsorted(keyframe_idx, matches.pairs), axis=1)[:, 0]
    return matches.pairs[apart > min_frames]


def matches_by_frame(matches: Matches, n_frames: int) -> Int[np.ndarray, " n"]:
    """Matched points that each frame takes part in."""
    counts = np.diff(matches.start)
    by_frame = np.zeros(n_frames)
    for side in (0, 1):
        by_frame += np.bincount(matches.pairs[:, side], counts, n_frames)
    return by_frame.astype(int)


def loop_closure_map(
    plan_ends: Float[np.ndarray, "f 2 2"],
    trajectory: Float[np.ndarray, "n 3"],
    loop_closures: Int[np.ndarray, "c 2"],
    crop: Crop,
    width_in: float,
    scans: Sequence[FramesOfScan] = (),
) -> Picture:
    """A line for each loop closure, between the camera centres (m) of its two frames."""
    figure, axes = view_figure(crop, width_in, LEGEND_IN)
    set_up_view(axes, crop, len(plan_ends) > 0)
    draw_faces(axes, crop, plan_ends, LIGHT)
    draw_paths(axes, trajectory[:, :2], scans, 0.7)
    lines = LineCollection(
        list(trajectory[loop_closures][:, :, :2]), colors=AFTER, linewidths=0.8, alpha=0.6, zorder=4
    )
    axes.add_collection(lines, autolim=False)
    draw_scale(axes, crop)
    entries: list[Entry] = [("loop closure, verified", AFTER, "-")]
    add_legend(axes, entries)
    return to_picture(figure, clicks_of("plan", axes))


def matches_plot(keyframe_idx: Int[np.ndarray, " k"], by_frame: Int[np.ndarray, " k"]) -> Picture:
    """Matched points of each keyframe; those without any are marked."""
    figure = new_figure(PANEL_IN, _HEIGHT_IN)
    axes = add_axes(figure, 0.6, 0.42, PANEL_IN - 0.75, _HEIGHT_IN - 0.42 - LEGEND_IN)
    axes.fill_between(keyframe_idx, by_frame, step="mid", color=AFTER, alpha=0.25, linewidth=0)
    axes.plot(keyframe_idx, by_frame, color=AFTER, linewidth=1.0, drawstyle="steps-mid")
    none = keyframe_idx[by_frame == 0]
    axes.plot(none, np.zeros(len(none)), "s", color=UNMATCHED, markersize=4, clip_on=False)
    axes.set_xlim(0, max(int(keyframe_idx[-1]), 1))
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    label_axes(axes, "frame", "matched points")
    entries: list[Entry] = [("matched points", AFTER, "-")]
    if len(none):
        entries.append(("none", UNMATCHED, "s"))
    add_legend(axes, entries)
    return to_picture(figure, clicks_of("frames", axes))
