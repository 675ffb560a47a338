"""Maps of the scan: heights of the floor, loop closures; and how signed distances are shown by colour."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from planfit.floorplan import Floorplan
from planfit.report.measures import Measures
from planfit.report.plots import colors
from planfit.report.plots.axes import LEGEND_PT, Axes
from planfit.report.plots.drawing import Box, Cells, Drawing, Shape, Words, rgb_of
from planfit.report.plots.top_view import (
    Crop,
    draw_paths,
    finish_view,
    new_view,
)
from planfit.scan.joined import FramesOfScan

RANGE_M = 0.2
"""Distances (m) at which the colours end: of the floor from its plane, of a wall from where it is drawn."""
_MIN_CELL_M, _MAX_CELLS = 0.1, 160
KEY_PT = 54
"""Room for the key to these colours."""
_COLORS = "#053061 #2166ac #4393c3 #92c5de #d1e5f0 #f7f7f7 #fddbc7 #f4a582 #d6604d #b2182b #67001f"
"""Of equal steps, blue to red; of ColorBrewer."""
_NOTHING = "#e8ebee"


def floor_map(floorplan: Floorplan | None, side: Measures, crop: Crop, width_pt: float) -> Drawing:
    """Median height of the floor, from above; colours end at plus and minus `RANGE_M`."""
    drawing, axes = new_view(crop, width_pt, 7, KEY_PT)
    columns = int(np.clip(crop.size[0] / _MIN_CELL_M, 1, _MAX_CELLS))
    shape = max(1, round(columns * crop.height_per_width)), columns
    draw_medians(axes, side.floor_points[:, :2], side.floor_points[:, 2], shape)
    if floorplan is not None:
        axes.lines(floorplan.ends, colors.GREY, 0.5)
    finish_view(axes, floorplan is not None)
    draw_key(axes, "floor height (m)")
    drawing.clicks = axes.clicks("plan")
    return drawing


def draw_medians(
    axes: Axes,
    xy: Float[np.ndarray, "m 2"],
    values_m: Float[np.ndarray, " m"],
    shape: tuple[int, int],
) -> None:
    """Colour each cell of a grid of rows and columns by the median of the values of the points in it."""
    inside, cell = axes.cells_of(xy, shape)
    used, medians_m = _medians(cell, values_m[inside])
    idx = np.zeros(shape, np.uint8)
    idx.ravel()[used] = _color_idx(medians_m)
    axes.drawing.items.append(Cells(idx, _palette(), axes.box))


def _color_idx(values_m: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Of the palette, whose first colour is that of nothing."""
    share = np.clip(0.5 + 0.5 * values_m / RANGE_M, 0.0, 1.0)
    return 1 + np.round(254 * share).astype(int)


def _palette() -> np.ndarray:
    colors = np.array([rgb_of(color) for color in _COLORS.split()], dtype=float)
    at, steps = np.linspace(0, len(colors) - 1, 255), np.arange(len(colors))
    blended = np.stack([np.interp(at, steps, channel) for channel in colors.T], axis=1)
    rgb = np.concatenate([[rgb_of(_NOTHING)], np.round(blended)]).astype(np.uint8)
    return np.column_stack([rgb, np.full(len(rgb), 255, np.uint8)])


def draw_key(axes: Axes, name: str) -> None:
    """What the colours mean, right of the axes; the pointed ends go on."""
    items, left = axes.drawing.items, axes.box.right + 9
    middle, half = (axes.box.top + axes.box.bottom) / 2, min(axes.box.size[1], 187) / 2 - 8
    box = Box(left, middle - half, left + 7, middle + half)
    values_m = np.linspace(RANGE_M, -RANGE_M, 100)
    items.append(Cells(_color_idx(values_m).astype(np.uint8)[:, None], _palette(), box))
    low, *_, high = _COLORS.split()
    for y, tip, color in ((box.top, box.top - 8, high), (box.bottom, box.bottom + 8, low)):
        point = np.array([[box.left, y], [(box.left + box.right) / 2, tip], [box.right, y]])
        items.append(Shape([point], fill=color))
    for k, words in enumerate(("+0.2", "+0.1", "0", "−0.1", "−0.2")):
        y = box.top + k / 4 * box.size[1]
        items.append(Shape([np.array([[box.right, y], [box.right + 2.5, y]])], colors.GREY, 0.6))
        items.append(Words(words, (box.right + 4.5, y + 3), colors.GREY))
    at = axes.drawing.width_pt - 4, middle
    items.append(Words(name, at, colors.GREY, "middle", is_upright=True))


def loop_closure_map(
    plan_ends: Float[np.ndarray, "f 2 2"],
    trajectory: Float[np.ndarray, "n 3"],
    loop_closures: Int[np.ndarray, "c 2"],
    crop: Crop,
    width_pt: float,
    scans: Sequence[FramesOfScan] = (),
) -> Drawing:
    """A line for each loop closure, between the camera centres (m) of its two frames."""
    drawing, axes = new_view(crop, width_pt, LEGEND_PT)
    axes.lines(plan_ends, colors.LIGHT, 0.7)
    axes.lines(trajectory[loop_closures][:, :, :2], colors.AFTER, 0.8, opacity=0.6)
    draw_paths(axes, trajectory[:, :2], scans, 0.7)
    finish_view(axes, len(plan_ends) > 0, [("loop closure, verified", colors.AFTER, "-")])
    drawing.clicks = axes.clicks("plan")
    return drawing


def _medians(
    group: Int[np.ndarray, " m"], values: Float[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Groups, and the median of the values of each."""
    # Sorted by group and then by value, the median of a group is half of its size past its first.
    order = np.lexsort((values, group))
    found, start, counts = np.unique(group[order], return_index=True, return_counts=True)
    return found, values[order][start + counts // 2]
