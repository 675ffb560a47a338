"""An alignment of the scan with the plan, as a picture: scanned wall over the faces."""

import textwrap

import numpy as np

from planfit.alignment import AlignmentHypothesis, WallSamples
from planfit.floorplan import Floorplan
from planfit.report.plots import colors
from planfit.report.plots.axes import LEGEND_PT, Entry
from planfit.report.plots.drawing import Words
from planfit.report.plots.raster import to_png
from planfit.report.plots.top_view import Crop, finish_view, new_view

WIDTH_PT, MIN_WIDTH_PT = 648, 320
MARGIN = 0.04
"""Free space around the plan, as a share of its extent."""
_LINE_PT, _LETTER_PT = 12, 5.5


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
    margin_m = MARGIN * float(np.ptp(everything, axis=0).max())
    # A strip of a plan is widened, so that axes and legend have room.
    crop = Crop.around([everything], [], margin_m, (0.25, 4.0))
    width = float(np.clip(WIDTH_PT / crop.height_per_width, MIN_WIDTH_PT, WIDTH_PT))
    lines = textwrap.wrap(title, int(width / _LETTER_PT))
    drawing, axes = new_view(crop, width, _LINE_PT * len(lines) + LEGEND_PT + 6)
    axes.lines(floorplan.ends, colors.INK, 0.7)
    # Samples are a decimetre apart: dots as wide as that at least, and wide enough to be seen.
    dot_pt = max(2.0, 0.1 * axes.box.size[0] / float(crop.size[0]))
    axes.squares(xy, colors.AFTER, dot_pt, opacity=0.75)
    entries: list[Entry] = [("plan", colors.INK, "-"), ("scanned wall", colors.AFTER, "s")]
    if walls.seen_from is not None:
        axes.squares(walls.seen_from @ rotation.T + translation, colors.PATH, 2.0)
        entries.append(("cameras", colors.PATH, "s"))
    finish_view(axes, True, entries)
    for k, line in enumerate(lines, start=1):
        drawing.items.append(Words(line, (axes.box.left, _LINE_PT * k), colors.INK, is_bold=True))
    return to_png(drawing)
