"""What was read of a plan, drawn over the plan itself, with coordinates at the rim to read points off it."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from planfit.floorplan import Floorplan
from planfit.floorplan.elements import are_glass, find_columns
from planfit.floorplan.formats.picture import load_picture
from planfit.geometry import segments
from planfit.report.plots import colors
from planfit.report.plots.axes import BOTTOM_PT, LEGEND_PT, RIGHT_PT, Axes, Entry, entry_pt
from planfit.report.plots.drawing import DPI, Box, Cells, Drawing, Shape, Words, to_png

_SIDE_PX, _LEFT_PT = 1600, 50.0
_MARGIN = 1 / 38
_GROW = 0.5
"""Line work is shown around the faces as far as this share of their longer side: a wing that was missed is,
a title block far off is not."""
_N_STEPS = 7
"""Between the numbers at the rim, at least: points are read off."""
_TICK_PT, _NUMBER_PT = 3.2, 4.2
_FACE, _OPENING, _UNORIENTED, _DROPPED = colors.BEFORE, colors.AFTER, "#009e73", "#c878c1"
_COLUMN, _GLASS, _DRAWN, _NUMBER = "#009e73", "#56b4e9", "#acacac", "#000096"


def draw_plan_picture(floorplan: Floorplan, path: Path, has_numbers: bool = False) -> bytes:
    """PNG: faces with ticks towards their free side, openings, and what was left out; at the rim, the
    coordinates in which points of the plan are given.

    Over the drawing, made pale, where the file is a picture; else over its line work in light grey.
    """
    return to_png(plan_axes(floorplan, path, has_numbers).drawing)


def plan_axes(floorplan: Floorplan, path: Path, has_numbers: bool = False) -> Axes:
    """What `draw_plan_picture` draws: axes in the coordinates at the rim, in their drawing."""
    source = floorplan.source
    drawn, left_out = (_in_rim(floorplan, v) for v in (source.drawn_lines, source.dropped_lines))
    ends = segments.moved(floorplan.ends, source.rim_from_plan)
    is_column, is_glass = find_columns(floorplan).face >= 0, are_glass(floorplan)
    openings = floorplan.openings if floorplan.openings is not None else np.zeros((0, 2, 2))
    layers = [
        ("line work", drawn, _DRAWN, 0.4),
        ("left out", left_out, _DROPPED, 0.4),
        ("face, tick to its free side", ends[floorplan.is_oriented & ~is_column], _FACE, 1.0),
        ("face, free side unknown", ends[~floorplan.is_oriented & ~is_column], _UNORIENTED, 1.0),
        ("column", ends[is_column], _COLUMN, 1.0),
        ("glass", ends[is_glass], _GLASS, 1.1),
        ("door or window", segments.moved(openings, source.rim_from_plan), _OPENING, 1.0),
    ]
    entries: list[Entry] = [(words, color, "-") for words, lines, color, _ in layers if len(lines)]
    if source.is_picture and source.file_from_plan is not None:
        cells, x, y = _pale(path)
    else:
        cells, (x, y) = None, _ranges(ends, np.concatenate([drawn, left_out]))
    axes = _new_axes(x, y, entries)
    if cells is not None:
        grey = np.round(255 - 0.45 * np.arange(255, -1, -1)[:, None] * [1, 1, 1, 0])
        axes.drawing.items.append(Cells(cells, grey.astype(np.uint8), axes.box))
    for _, lines, color, width_pt in layers:
        axes.lines(lines, color, width_pt)
    _draw_ticks(axes, floorplan, ~is_column)
    if has_numbers:
        for number, (u, v) in enumerate(axes.at(ends.mean(axis=1)).tolist()):
            axes.drawing.items.append(Words(str(number), (u, v), _NUMBER, size_pt=_NUMBER_PT))
    unit = "m" if floorplan.is_metric else "units of the drawing"
    names = f"plan frame, x ({unit})", f"y ({unit})"
    if source.is_picture:
        names = "pixels of the picture, u right", "v down"
    axes.rim(*names, n_steps=_N_STEPS)
    axes.legend(entries)
    return axes


def _new_axes(x: tuple[float, float], y: tuple[float, float], entries: list[Entry]) -> Axes:
    """Of ranges that are shown true to scale, with room for the key."""
    pt_per_unit = _SIDE_PX * 72 / DPI / max(abs(x[1] - x[0]), abs(y[1] - y[0]))
    width, height = (pt_per_unit * abs(high - low) for low, high in (x, y))
    key_pt = sum(entry_pt(words) for words, _, _ in entries)
    box = Box(_LEFT_PT, LEGEND_PT, _LEFT_PT + width, LEGEND_PT + height)
    drawing = Drawing(_LEFT_PT + max(width, key_pt) + RIGHT_PT, box.bottom + BOTTOM_PT)
    return Axes(drawing, box, x, y)


def _draw_ticks(axes: Axes, floorplan: Floorplan, has_tick: np.ndarray) -> None:
    """From the middles of faces towards their free side."""
    has_tick = has_tick & floorplan.is_oriented
    rim = floorplan.source.rim_from_plan
    ends, normals = floorplan.ends[has_tick], floorplan.normals[has_tick]
    long = segments.lengths(axes.at(segments.moved(ends, rim))) > _TICK_PT + 1
    middles = ends[long].mean(axis=1)
    from_middle = axes.at(segments.moved(np.stack([middles, middles + normals[long]], axis=1), rim))
    step = from_middle[:, 1] - from_middle[:, 0]
    step *= _TICK_PT / np.linalg.norm(step, axis=1, keepdims=True)
    from_middle[:, 1] = from_middle[:, 0] + step
    axes.drawing.items.append(Shape(list(from_middle), _FACE, 0.4))


def _pale(path: Path) -> tuple[np.ndarray, tuple[float, float], tuple[float, float]]:
    """The picture in grey, at a size for screens, and the pixels at its rims."""
    image, shrink = load_picture(path)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    zoom = _SIDE_PX / max(grey.shape)
    interpolation = cv2.INTER_AREA if zoom < 1 else cv2.INTER_CUBIC
    grey = cv2.resize(
        grey, (round(width * zoom), round(height * zoom)), interpolation=interpolation
    )
    # Pixel centres are integers.
    return grey, (-0.5, width * shrink - 0.5), (height * shrink - 0.5, -0.5)


def _in_rim(floorplan: Floorplan, lines_in_file: np.ndarray | None) -> np.ndarray:
    source = floorplan.source
    if lines_in_file is None or source.file_from_plan is None:
        return np.zeros((0, 2, 2))
    rim_from_file = source.rim_from_plan @ np.linalg.inv(source.file_from_plan)
    return segments.moved(lines_in_file, rim_from_file)


def _ranges(
    ends: Float[np.ndarray, "n 2 2"], lines: Float[np.ndarray, "k 2 2"]
) -> list[tuple[float, float]]:
    """Of both axes, with room for the faces and the lines about them."""
    xy = ends.reshape(-1, 2)
    low, high = xy.min(axis=0), xy.max(axis=0)
    if len(lines):
        reach = _GROW * float(max(high - low))
        around = lines.reshape(-1, 2)
        low = np.minimum(low, np.maximum(around.min(axis=0), low - reach))
        high = np.maximum(high, np.minimum(around.max(axis=0), high + reach))
    margin = _MARGIN * float(max(high - low))
    return [(float(a - margin), float(b + margin)) for a, b in zip(low, high, strict=True)]
