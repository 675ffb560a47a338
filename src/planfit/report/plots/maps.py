"""Maps of the scan: heights of the floor, walls of the plan by agreement, loop closures; and walls cut
across: distance from where they are drawn against height, before and after."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import wall_patches_in_plan
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.report.measures import Measures
from planfit.report.plots import colors
from planfit.report.plots.axes import BOTTOM_PT, LEGEND_PT, RIGHT_PT, Axes, left_pt
from planfit.report.plots.drawing import PANEL_PT, Box, Cells, Drawing, Shape, Words, rgb_of
from planfit.report.plots.top_view import (
    Crop,
    draw_label,
    draw_paths,
    draw_points,
    finish_view,
    new_view,
)
from planfit.report.walls import FEW_PATCHES, SeenFace
from planfit.scan.joined import FramesOfScan

FLOOR_RANGE_M = 0.2
"""Heights (m) at which the colours of the floor end."""
_MIN_CELL_M, _MAX_CELLS = 0.1, 160
_KEY_PT = 54
"""Room for the key to these colours."""
_FLOOR_COLORS = (
    "#053061 #2166ac #4393c3 #92c5de #d1e5f0 #f7f7f7 #fddbc7 #f4a582 #d6604d #b2182b #67001f"
)
"""Of equal steps of height, blue to red; of ColorBrewer."""
_NOTHING = "#e8ebee"


def floor_map(floorplan: Floorplan | None, side: Measures, crop: Crop, width_pt: float) -> Drawing:
    """Median height of the floor, from above; colours end at plus and minus `FLOOR_RANGE_M`."""
    drawing, axes = new_view(crop, width_pt, 7, _KEY_PT)
    columns = int(np.clip(crop.size[0] / _MIN_CELL_M, 1, _MAX_CELLS))
    shape = max(1, round(columns * crop.height_per_width)), columns
    inside, cell = axes.cells_of(side.floor_points[:, :2], shape)
    used, medians_m = _medians(cell, side.floor_points[inside, 2])
    idx = np.zeros(shape, np.uint8)
    idx.ravel()[used] = _color_idx(medians_m)
    drawing.items.append(Cells(idx, _palette(), axes.box))
    if floorplan is not None:
        axes.lines(floorplan.ends, colors.GREY, 0.5)
    finish_view(axes, floorplan is not None)
    _draw_key(axes)
    drawing.clicks = axes.clicks("plan")
    return drawing


def _color_idx(heights_m: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Of the palette, whose first colour is that of nothing."""
    share = np.clip(0.5 + 0.5 * heights_m / FLOOR_RANGE_M, 0.0, 1.0)
    return 1 + np.round(254 * share).astype(int)


def _palette() -> np.ndarray:
    colors = np.array([rgb_of(color) for color in _FLOOR_COLORS.split()], dtype=float)
    at, steps = np.linspace(0, len(colors) - 1, 255), np.arange(len(colors))
    blended = np.stack([np.interp(at, steps, channel) for channel in colors.T], axis=1)
    rgb = np.concatenate([[rgb_of(_NOTHING)], np.round(blended)]).astype(np.uint8)
    return np.column_stack([rgb, np.full(len(rgb), 255, np.uint8)])


def _draw_key(axes: Axes) -> None:
    """What the colours of the floor mean, right of its map; the pointed ends go on."""
    items, left = axes.drawing.items, axes.box.right + 9
    middle, half = (axes.box.top + axes.box.bottom) / 2, min(axes.box.size[1], 187) / 2 - 8
    box = Box(left, middle - half, left + 7, middle + half)
    heights_m = np.linspace(FLOOR_RANGE_M, -FLOOR_RANGE_M, 100)
    items.append(Cells(_color_idx(heights_m).astype(np.uint8)[:, None], _palette(), box))
    low, *_, high = _FLOOR_COLORS.split()
    for y, tip, color in ((box.top, box.top - 8, high), (box.bottom, box.bottom + 8, low)):
        point = np.array([[box.left, y], [(box.left + box.right) / 2, tip], [box.right, y]])
        items.append(Shape([point], fill=color))
    for k, words in enumerate(("+0.2", "+0.1", "0", "−0.1", "−0.2")):
        y = box.top + k / 4 * box.size[1]
        items.append(Shape([np.array([[box.right, y], [box.right + 2.5, y]])], colors.GREY, 0.6))
        items.append(Words(words, (box.right + 4.5, y + 3), colors.GREY))
    at = axes.drawing.width_pt - 4, middle
    items.append(Words("floor height (m)", at, colors.GREY, "middle", is_upright=True))


def wall_map(
    floorplan: Floorplan, result: RefineResult, faces: list[SeenFace], crop: Crop, width_pt: float
) -> Drawing:
    """Faces of the plan by what the scan says of them; numbers as in the table of walls."""
    drawing, axes = new_view(crop, width_pt, 6)
    _, ends = wall_patches_in_plan(result.structure.walls, result.plan_from_cams)
    axes.lines(floorplan.ends, colors.NOT_SEEN, 0.7)
    axes.lines(ends[result.adjustment.association.face_idx < 0], colors.UNMATCHED, 1.2)
    for is_moved, color, line_pt in ((False, colors.AGREES, 1.8), (True, colors.MOVED, 2.2)):
        chosen = [face.face_idx for face in faces if face.is_moved == is_moved]
        axes.lines(floorplan.ends[chosen], color, line_pt)
    for face in faces:
        if face.is_moved and crop.contains(np.array([face.middle_xy]))[0]:
            x, y = axes.at(np.array(face.middle_xy)).tolist()
            draw_label(axes, str(face.number), (x + 5, y - 5), colors.MOVED, colors.PAPER, 0.85)
    finish_view(axes, True)
    drawing.clicks = axes.clicks("walls")
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


_HEIGHT_PT = 260
_LEAST_RANGE_M, _LARGEST_RANGE_M = 0.1, 3.0
_MAX_POINTS = 40_000


@dataclass(frozen=True)
class CrossSection:
    """The scanned points of one drawn wall, seen along it."""

    face: SeenFace
    before: Float[np.ndarray, "m 2"]
    """m: distance from the drawn face along its normal, and height above the floor."""
    after: Float[np.ndarray, "m 2"]


def cut_walls(
    floorplan: Floorplan, result: RefineResult, faces: list[SeenFace], max_count: int = 2
) -> list[CrossSection]:
    """The walls whose scanned points changed most, each by all points of its patches.

    A wall counts by its mean change of distance times the root of its points: a long wall that came
    together says more than a stub.
    """
    association, patches = result.adjustment.association, result.structure.walls
    scored = []
    for face in faces:
        if face.n_patches < FEW_PATCHES:
            continue
        own = np.flatnonzero(association.face_idx == face.face_idx)
        points = np.concatenate([np.arange(*patches.start[k : k + 2]) for k in own])
        points = points[:: max(1, len(points) // _MAX_POINTS)]
        frames = patches.point_frame_idx[points]
        before, after = (
            _across(floorplan, face.face_idx, poses[frames], patches.points_cam[points])
            for poses in (result.initial_plan_from_cams, result.plan_from_cams)
        )
        change = float(np.abs(np.minimum(np.abs(before[:, 0]), 1.0) - np.abs(after[:, 0])).mean())
        scored.append((change * np.sqrt(len(points)), CrossSection(face, before, after)))
    scored.sort(key=lambda s: -s[0])
    return [section for _, section in scored[:max_count]]


def draw_section(section: CrossSection) -> Drawing:
    """Before and after beside each other; the drawn face is the dark upright line."""
    distances = np.concatenate([section.before[:, 0], section.after[:, 0]])
    low_m, high_m = np.clip(
        np.percentile(distances, [1.5, 98.5]), -_LARGEST_RANGE_M, _LARGEST_RANGE_M
    )
    low_m = 1.1 * min(float(low_m), -_LEAST_RANGE_M)
    high_m = 1.1 * max(float(high_m), _LEAST_RANGE_M)
    top_m = max(1.0, float(np.percentile(section.after[:, 1], 99.5))) + 0.15
    # Distances are stretched: centimetres matter across a wall, metres along it.
    drawing, x, y = Drawing(PANEL_PT, _HEIGHT_PT), (low_m, high_m), (0.0, top_m)
    between_pt = 18
    width_pt = (PANEL_PT - left_pt(y) - RIGHT_PT - between_pt) / 2
    for k, (name, color, points) in enumerate(
        (("before", colors.BEFORE, section.before), ("after", colors.AFTER, section.after))
    ):
        left = left_pt(y) + k * (width_pt + between_pt)
        box = Box(left, LEGEND_PT, left + width_pt, _HEIGHT_PT - BOTTOM_PT)
        axes = Axes(drawing, box, x, y)
        draw_points(axes, points, color)
        axes.upright(np.zeros(1), colors.INK, 1.0)
        at = left + width_pt / 2, LEGEND_PT - 6
        drawing.items.append(Words(name, at, color, "middle", is_bold=True))
        axes.rim("from the drawn wall (m)", "" if k else "height (m)", has_numbers=(True, not k))
    return drawing


def _across(
    floorplan: Floorplan,
    face: int,
    plan_from_cams: Float[np.ndarray, "m 4 4"],
    points_cam: Float[np.ndarray, "m 3"],
) -> Float[np.ndarray, "m 2"]:
    """Distance from a face and height (m) of points, each with its own pose."""
    points = se3.transform_each(plan_from_cams, points_cam)
    distance = points[:, :2] @ floorplan.normals[face] - floorplan.offsets[face]
    return np.column_stack([distance, points[:, 2]])
