"""Pictures from above before anything is adjusted: what stands at eye height of a scan, with its path, gaps
and jumps; and an alignment of the scan with the plan, scanned wall over the faces."""

import textwrap

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from planfit.alignment import AlignmentHypothesis, WallSamples
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.priors import TRACKER_TILT_SIGMA_DEG
from planfit.report.plots import colors
from planfit.report.plots.axes import LEGEND_PT, TITLE_PT, Entry
from planfit.report.plots.drawing import PANEL_PT, Words, to_png
from planfit.report.plots.top_view import (
    Crop,
    draw_path,
    draw_points,
    draw_scale,
    finish_view,
    new_view,
)

LOW_M, HIGH_M = -1.1, 0.5
"""Heights against the camera between which points are drawn: walls and furniture, no floor and no ceiling."""
_LEVEL_COSINE = np.cos(np.deg2rad(TRACKER_TILT_SIGMA_DEG.value))
"""Axes of a tracker that knows gravity: 50 m away, points are then a metre off at most."""


def draw_scan_view(
    title: str,
    world_from_cams: Float[np.ndarray, "n 4 4"],
    points_world: Float[np.ndarray, "m 3"],
    up_world: Float[np.ndarray, "3"],
    gaps: Int[np.ndarray, " g"],
    jumps: Int[np.ndarray, " j"],
) -> bytes:
    """PNG of the scan seen from above, in metres; the numbers at its rim are those of the scan's own axes
    where these are level.

    Args:
        title: a line above the picture.
        world_from_cams: poses as recorded.
        points_world: m, a sample of the points seen.
        up_world: unit vector against gravity.
        gaps: frames after which the recording stops for a while.
        jumps: frames after which the camera is elsewhere at once.
    """
    level_from_world = se3.rotation_between(up_world, np.array([0.0, 0.0, 1.0]))
    centres = world_from_cams[:, :3, 3] @ level_from_world.T
    points = points_world @ level_from_world.T
    xy = points[at_camera_height(centres, points), :2]
    crop = Crop.around([centres[:, :2]], [xy], 0.5, (0.25, 1.2))
    drawing, axes = new_view(crop, 1.6 * PANEL_PT, TITLE_PT + LEGEND_PT)
    draw_points(axes, xy, colors.AFTER)
    draw_path(axes, centres[:, :2], colors.PATH, gaps, 1.2, jumps)
    (x_name, x_sign), (y_name, y_sign) = (
        _axis_of(name, row) for name, row in zip("xy", level_from_world, strict=False)
    )
    axes.rim(x_name, y_name, signs=(x_sign, y_sign))
    draw_scale(axes)
    entries: list[Entry] = [
        ("seen near camera height", colors.AFTER, "s"),
        ("camera path (ring: start)", colors.PATH, "-"),
    ]
    if len(gaps):
        entries.append(("gap in time", colors.PATH, ":"))
    if len(jumps):
        entries.append(("jump", colors.BEFORE, "-"))
    axes.legend(entries)
    drawing.items.append(Words(title, (axes.box.left, 14), colors.INK))
    return to_png(drawing)


def _axis_of(name: str, row: Float[np.ndarray, "3"]) -> tuple[str, int]:
    """Name and sign of the numbers along an axis of the level frame, a row of level_from_world: those of the
    scan's own axes, in which points of the scan are given, where these stand level."""
    k = int(np.argmax(np.abs(row)))
    if abs(row[k]) < _LEVEL_COSINE:
        return f"{name} (m), turned level: not the scan's own axes", 1
    return f"{'xyz'[k]} of the scan (m)", int(np.sign(row[k]))


def at_camera_height(
    centres: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "m 3"]
) -> Bool[np.ndarray, " m"]:
    """Which points (m, z up) are neither floor nor ceiling, by the path of the camera (m) near them."""
    # Heights against the camera where it was nearest in the plane: stairs and slopes stay at eye height.
    few = centres[:: max(1, len(centres) // 500)]
    _, nearest = KDTree(few[:, :2]).query(points[:, :2])
    height = points[:, 2] - few[nearest, 2]
    return (height > LOW_M) & (height < HIGH_M)


WIDTH_PT, MIN_WIDTH_PT = 648, 320
MARGIN = 0.04
"""Free space around the plan, as a share of its extent."""
_LINE_PT, _LETTER_PT = 12, 5.5


def draw_alignment(
    floorplan: Floorplan, walls: WallSamples, hypothesis: AlignmentHypothesis, title: str
) -> bytes:
    """PNG of scanned wall, aligned, over the whole plan."""
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
