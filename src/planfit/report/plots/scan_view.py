"""A scan from above before anything is done to it: what stands at eye height, the path, gaps and jumps."""

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import KDTree

from planfit.geometry import se3
from planfit.report.plots.drawing import (
    AFTER,
    BEFORE,
    FONT_PT,
    INK,
    PANEL_IN,
    PATH,
    add_axes,
    new_figure,
    to_picture,
)
from planfit.report.plots.top_view import Crop, draw_points, draw_scale, set_up_view

LOW_M, HIGH_M = -1.1, 0.5
"""Heights against the camera between which points are drawn: walls and furniture, no floor and no ceiling."""
_LEVEL_COSINE = 0.9998
"""Axes within 1 deg of level: 50 m away, points are then a metre off at most."""
_MARGIN_M = 0.5
_DOTTED = (0, (1, 2))
_TITLE_IN, _LEFT_IN, _BOTTOM_IN = 0.55, 0.5, 0.5


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
    crop = _crop(centres, xy)
    width = 1.6 * PANEL_IN
    axes_width = width - _LEFT_IN - 0.1
    axes_height = axes_width * crop.height_per_width
    figure = new_figure(width, _BOTTOM_IN + axes_height + _TITLE_IN)
    axes = add_axes(figure, _LEFT_IN, _BOTTOM_IN, axes_width, axes_height)
    set_up_view(axes, crop, is_aligned=False)
    _name_axes(axes, level_from_world)
    draw_points(axes, crop, xy, AFTER)
    _draw_path(axes, centres, gaps, jumps)
    draw_scale(axes, crop)
    _add_title_and_legend(figure, title, len(gaps) > 0, len(jumps) > 0)
    return to_picture(figure).png


def _name_axes(axes: Axes, level_from_world: Float[np.ndarray, "3 3"]) -> None:
    """Numbers in the scan's own axes, in which points of the scan are given, where these stand level."""
    for row, axis in ((level_from_world[0], axes.xaxis), (level_from_world[1], axes.yaxis)):
        k = int(np.argmax(np.abs(row)))
        if abs(row[k]) < _LEVEL_COSINE:
            axis.set_label_text(f"{axis.get_label_text()}, turned level: not the scan's own axes")
            continue
        sign = float(np.sign(row[k]))
        axis.set_major_formatter(lambda value, _, sign=sign: f"{sign * value + 0.0:g}")
        axis.set_label_text(f"{'xyz'[k]} of the scan (m)")


def at_camera_height(
    centres: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "m 3"]
) -> Bool[np.ndarray, " m"]:
    """Which points (m, z up) are neither floor nor ceiling, by the path of the camera (m) near them."""
    # Heights against the path near in the plane, so that stairs and slopes stay at eye height.
    height = points[:, 2] - _path_height(centres, points)
    return (height > LOW_M) & (height < HIGH_M)


def _draw_path(axes: Axes, centres: np.ndarray, gaps: np.ndarray, jumps: np.ndarray) -> None:
    """Camera centres (n, 3) m as a line that breaks at gaps and jumps, each drawn in its own style."""
    breaks = np.union1d(gaps, jumps)
    walked = np.insert(centres[:, :2], breaks + 1, np.nan, axis=0)  # a line is broken at NaN
    axes.plot(walked[:, 0], walked[:, 1], color=PATH, linewidth=1.0, zorder=5)
    for where, color, style in ((gaps, PATH, _DOTTED), (jumps, BEFORE, "-")):
        for i in where:
            x, y = centres[i : i + 2, :2].T
            axes.plot(x, y, color=color, linewidth=1.4, linestyle=style, zorder=6)
    begin = centres[0]
    axes.plot(begin[:1], begin[1:2], "o", color="white", mec=PATH, markersize=5, mew=1.3, zorder=7)


def _add_title_and_legend(figure: Figure, title: str, has_gaps: bool, has_jumps: bool) -> None:
    """Above the axes; at a distance in inches from the upper edge, whatever the height."""
    seen = "seen near camera height"
    entries = [
        Line2D([], [], color=AFTER, marker="s", linestyle="", markersize=6, label=seen),
        Line2D([], [], color=PATH, marker="o", mfc="white", label="camera, from its start"),
    ]
    if has_gaps:
        entries.append(Line2D([], [], color=PATH, linestyle=_DOTTED, label="gap in time"))
    if has_jumps:
        entries.append(Line2D([], [], color=BEFORE, label="jump"))
    width, height = figure.get_size_inches()
    left = _LEFT_IN / width
    figure.text(left, 1 - 0.08 / height, title, fontsize=FONT_PT + 1, color=INK, va="top")
    figure.legend(
        handles=entries,
        loc="upper left",
        bbox_to_anchor=(left, 1 - 0.24 / height),
        ncol=len(entries),
        frameon=False,
        fontsize=FONT_PT,
        borderaxespad=0,
        handletextpad=0.5,
        columnspacing=1.5,
    )


def _path_height(centres: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Height (m,) of the camera where it was nearest to each point, in the plane."""
    few = centres[:: max(1, len(centres) // 500)]
    _, nearest = KDTree(few[:, :2]).query(points[:, :2])
    return few[nearest, 2]


def _crop(centres: np.ndarray, xy: np.ndarray) -> Crop:
    parts = [centres[:, :2]]
    if len(xy) > 20:
        parts.append(np.percentile(xy, [0.5, 99.5], axis=0))
    return Crop.around(np.concatenate(parts), _MARGIN_M, (0.25, 1.2))
