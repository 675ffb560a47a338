"""An alignment of the scan with the plan, as a picture: scanned wall over the faces."""

import textwrap

import numpy as np

from planfit.alignment import AlignmentHypothesis, WallSamples
from planfit.floorplan import Floorplan
from planfit.report.plots.drawing import (
    AFTER,
    FONT_PT,
    INK,
    PATH,
    Entry,
    add_axes,
    add_legend,
    new_figure,
    to_picture,
)
from planfit.report.plots.top_view import Crop, draw_faces, draw_scale, set_up_view

WIDTH_IN, MIN_WIDTH_IN = 9.0, 4.5
LEFT_IN, RIGHT_IN, BOTTOM_IN, TOP_IN = 0.6, 0.15, 0.65, 0.75
LETTERS_PER_IN = 13
"""Letters of the title that fit an inch."""
MARGIN = 0.04
"""Free space around the plan, as a share of its extent."""


def draw_alignment(
    floorplan: Floorplan, walls: WallSamples, hypothesis: AlignmentHypothesis, title: str
) -> bytes:
    """PNG of scanned wall, aligned, over the whole plan.

    Args:
        floorplan: in metres, at the scale of this hypothesis.
        walls: samples, level frame.
        hypothesis: where they go.
        title: a line or two above the picture.
    """
    plan_from_level = hypothesis.plan_from_level
    rotation, translation = plan_from_level[:2, :2], plan_from_level[:2, 3]
    xy = walls.xy @ rotation.T + translation
    everything = np.concatenate([floorplan.ends.reshape(-1, 2), xy])
    low, high = everything.min(axis=0), everything.max(axis=0)
    # A strip of a plan is widened, so that axes and legend have room.
    size = np.maximum(high - low, 0.25 * (high - low).max()) * (1 + 2 * MARGIN)
    crop = Crop((low + high - size) / 2, (low + high + size) / 2)
    axes_width = WIDTH_IN - LEFT_IN - RIGHT_IN
    if crop.height_per_width > 1.2:
        axes_width /= crop.height_per_width / 1.2
    axes_width = max(axes_width, MIN_WIDTH_IN)
    axes_height = axes_width * crop.height_per_width
    figure = new_figure(LEFT_IN + axes_width + RIGHT_IN, BOTTOM_IN + axes_height + TOP_IN)
    axes = add_axes(figure, LEFT_IN, BOTTOM_IN, axes_width, axes_height)
    set_up_view(axes, crop)
    draw_faces(axes, crop, floorplan.ends)
    # Samples are a decimetre apart: dots as wide as that at least, and wide enough to be seen.
    dot_pt = max(2.0, 72 * 0.1 * axes_width / float(crop.size[0]))
    axes.plot(xy[:, 0], xy[:, 1], "s", color=AFTER, markersize=dot_pt, mew=0, alpha=0.5, zorder=4)
    entries: list[Entry] = [("plan", INK, "-"), ("scanned wall", AFTER, "s")]
    if walls.seen_from is not None:
        eyes = walls.seen_from @ rotation.T + translation
        axes.plot(eyes[:, 0], eyes[:, 1], ".", color=PATH, markersize=2.0, zorder=5)
        entries.append(("cameras", PATH, "s"))
    draw_scale(axes, crop)
    add_legend(axes, entries)
    wrapped = textwrap.fill(title, int(axes_width * LETTERS_PER_IN))
    axes.text(
        0.0, 1.0 + 0.28 / axes_height, wrapped, transform=axes.transAxes, fontsize=FONT_PT,
        fontweight="bold", color=INK, va="bottom",
    )  # fmt: skip
    return to_picture(figure).png
