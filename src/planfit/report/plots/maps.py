"""Maps of the scan: heights of the floor, walls from the front by how far each spot is from where the wall is
drawn, loop closures."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import wall_patches_in_plan
from planfit.as_built import AsBuilt, AsBuiltWall, Verdict
from planfit.findings.finding import FEW_NAMED
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.priors import PATCH_TURN_MOST_DEG, WALL_AS_DRAWN_M
from planfit.report.measures import Measures
from planfit.report.plots import colors
from planfit.report.plots.axes import BOTTOM_PT, LEGEND_PT, Axes, left_pt
from planfit.report.plots.drawing import PANEL_PT, Box, Cells, Drawing, Shape, Words, rgb_of
from planfit.report.plots.top_view import (
    Crop,
    draw_paths,
    finish_view,
    new_view,
)
from planfit.scan.joined import FramesOfScan
from planfit.tracking.types import MIN_WITNESSES

RANGE_M = 0.2
"""Distances (m) at which the colours end: of the floor from its plane, of a wall from where it is drawn."""
_MIN_CELL_M, _MAX_CELLS = 0.1, 160
_FRONT_HEIGHT_PT = 130
_KEY_PT = 54
"""Room for the key to these colours."""
_COLORS = "#053061 #2166ac #4393c3 #92c5de #d1e5f0 #f7f7f7 #fddbc7 #f4a582 #d6604d #b2182b #67001f"
"""Of equal steps, blue to red; of ColorBrewer."""
_NOTHING = "#e8ebee"


def floor_map(floorplan: Floorplan | None, side: Measures, crop: Crop, width_pt: float) -> Drawing:
    """Median height of the floor, from above; colours end at plus and minus `RANGE_M`."""
    drawing, axes = new_view(crop, width_pt, 7, _KEY_PT)
    columns = int(np.clip(crop.size[0] / _MIN_CELL_M, 1, _MAX_CELLS))
    shape = max(1, round(columns * crop.height_per_width)), columns
    _draw_medians(axes, side.floor_points[:, :2], side.floor_points[:, 2], shape)
    if floorplan is not None:
        axes.lines(floorplan.ends, colors.GREY, 0.5)
    finish_view(axes, floorplan is not None)
    _draw_key(axes, "floor height (m)")
    drawing.clicks = axes.clicks("plan")
    return drawing


def _draw_medians(
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


def _draw_key(axes: Axes, name: str) -> None:
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


@dataclass(frozen=True)
class ScannedWall:
    """A drawn face and the scanned points that show it."""

    number: int
    """As in the table of walls."""
    wall: AsBuiltWall
    verdict: Verdict
    points: Float[np.ndarray, "m 3"]
    """m: along the face from its left end as who stands before it sees it, from it along its normal, and
    above the floor."""


def walls_to_show(result: RefineResult, as_built: AsBuilt) -> list[ScannedWall]:
    """Faces of the plan that stand elsewhere than drawn and of which enough patches were seen, the furthest
    first; where none does, the longest that was seen."""
    drawn = [(n, w) for n, w in enumerate(as_built.walls, 1) if w.face_idx >= 0 and w.is_standing]
    moved = [each for each in drawn if as_built.verdict(each[1]) is Verdict.MOVED]
    moved.sort(key=lambda each: -abs(each[1].offset_m))
    drawn.sort(key=lambda each: -each[1].length_m)
    shown = list(islice(_scanned(moved, result, as_built), FEW_NAMED))
    return shown or list(islice(_scanned(drawn, result, as_built), 1))


def _scanned(
    walls: Sequence[tuple[int, AsBuiltWall]], result: RefineResult, as_built: AsBuilt
) -> Iterator[ScannedWall]:
    """Those of which enough patches were seen."""
    patches = result.structure.walls
    normals, ends = wall_patches_in_plan(patches, result.plan_from_cams)
    for number, wall in walls:
        right = np.array([-wall.normal[1], wall.normal[0]])
        corner = wall.ends[np.argmin(wall.ends @ right)]
        axes = np.stack([right, wall.normal], axis=1)
        along, off_m = ((ends.mean(axis=1) - corner) @ axes).T
        facing = normals @ wall.normal if wall.is_oriented else np.abs(normals @ wall.normal)
        own = facing > np.cos(np.deg2rad(PATCH_TURN_MOST_DEG.value))
        own &= np.abs(off_m - wall.offset_m) < WALL_AS_DRAWN_M.value
        own &= (along > 0) & (along < wall.length_m)
        if own.sum() < MIN_WITNESSES:
            continue
        shown = patches.of(own)
        poses = result.plan_from_cams[shown.point_frame_idx]
        points = se3.transform_each(poses, shown.points_cam)
        points = np.column_stack([(points[:, :2] - corner) @ axes, points[:, 2]])
        yield ScannedWall(number, wall, as_built.verdict(wall), points)


def wall_front(shown: ScannedWall) -> Drawing:
    """A wall as who stands before it sees it: median distance from where it is drawn, cell by cell."""
    length_m, top_m = shown.wall.length_m, float(np.percentile(shown.points[:, 2], 99.5)) + 0.15
    drawing, y = Drawing(PANEL_PT, _FRONT_HEIGHT_PT), (0.0, max(1.0, top_m))
    box = Box(left_pt(y), 8, PANEL_PT - _KEY_PT, _FRONT_HEIGHT_PT - BOTTOM_PT)
    axes = Axes(drawing, box, (0.0, length_m), y)
    rows, columns = (max(1, round(size_m / _MIN_CELL_M)) for size_m in (y[1], length_m))
    _draw_medians(axes, shown.points[:, [0, 2]], shown.points[:, 1], (rows, columns))
    axes.rim("along the wall (m)", "height (m)", n_steps=2)
    _draw_key(axes, "from the drawn wall (m)")
    return drawing


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
