"""A scan from above before anything is done to it: what stands at eye height, the path, gaps and jumps."""

import numpy as np
from matplotlib.lines import Line2D
from scipy.spatial import KDTree

from planfit.geometry import se3
from planfit.report.drawing import (
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
from planfit.report.top_view import Crop, draw_points, draw_scale, set_up_view

LOW_M, HIGH_M = -1.1, 0.5
"""Heights against the camera between which points are drawn: walls and furniture, no floor and no ceiling."""
_MARGIN_M = 0.5
_TITLE_IN, _LEFT_IN, _BOTTOM_IN = 0.55, 0.5, 0.5


def draw_scan_view(
    title: str,
    world_from_cams: np.ndarray,
    points_world: np.ndarray,
    up_world: np.ndarray,
    gaps: np.ndarray,
    jumps: np.ndarray,
) -> bytes:
    """PNG of the scan seen from above, in metres.

    Args:
        title: a line above the picture.
        world_from_cams: (n, 4, 4) poses as recorded.
        points_world: (m, 3) m, a sample of the points seen.
        up_world: (3,) unit vector against gravity.
        gaps: frames after which the recording stops for a while.
        jumps: frames after which the camera is elsewhere at once.
    """
    level_from_world = se3.rotation_between(up_world, np.array([0.0, 0.0, 1.0]))
    places = world_from_cams[:, :3, 3] @ level_from_world.T
    points = points_world @ level_from_world.T
    # Heights against the path near in the plane, so that stairs and slopes stay at eye height.
    height = points[:, 2] - _path_height(places, points)
    xy = points[(height > LOW_M) & (height < HIGH_M), :2]
    crop = _crop(places, xy)
    width = 1.6 * PANEL_IN
    axes_width = width - _LEFT_IN - 0.1
    axes_height = axes_width * crop.height_per_width
    figure = new_figure(width, _BOTTOM_IN + axes_height + _TITLE_IN)
    axes = add_axes(figure, _LEFT_IN, _BOTTOM_IN, axes_width, axes_height)
    set_up_view(axes, crop, is_placed=False)
    draw_points(axes, crop, xy, AFTER)
    breaks = np.union1d(gaps, jumps)
    way = np.insert(places[:, :2], breaks + 1, np.nan, axis=0)
    axes.plot(way[:, 0], way[:, 1], color=PATH, linewidth=1.0, zorder=5)
    for where, color, style in ((gaps, PATH, (0, (1, 2))), (jumps, BEFORE, "-")):
        for i in where:
            x, y = places[i : i + 2, :2].T
            axes.plot(x, y, color=color, linewidth=1.4, linestyle=style, zorder=6)
    begin = places[0]
    axes.plot(begin[:1], begin[1:2], "o", color="white", mec=PATH, markersize=5, mew=1.3, zorder=7)
    draw_scale(axes, crop)
    entries = [
        Line2D(
            [],
            [],
            color=AFTER,
            marker="s",
            linestyle="",
            markersize=6,
            label="seen near camera height",
        ),
        Line2D([], [], color=PATH, marker="o", mfc="white", label="camera, from its start"),
    ]
    if len(gaps):
        entries.append(Line2D([], [], color=PATH, linestyle=(0, (1, 2)), label="gap in time"))
    if len(jumps):
        entries.append(Line2D([], [], color=BEFORE, label="jump"))
    figure.text(
        _LEFT_IN / width, 1 - 0.08 / figure.get_size_inches()[1], title, fontsize=FONT_PT + 1,
        color=INK, va="top",
    )  # fmt: skip
    figure.legend(
        handles=entries,
        loc="upper left",
        bbox_to_anchor=(_LEFT_IN / width, 1 - 0.24 / figure.get_size_inches()[1]),
        ncol=len(entries),
        frameon=False,
        fontsize=FONT_PT,
        borderaxespad=0,
        handletextpad=0.5,
        columnspacing=1.5,
    )
    return to_picture(figure).png


def _path_height(places: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Height (m,) of the camera where it was nearest to each point, in the plane."""
    few = places[:: max(1, len(places) // 500)]
    _, nearest = KDTree(few[:, :2]).query(points[:, :2])
    return few[nearest, 2]


def _crop(places: np.ndarray, xy: np.ndarray) -> Crop:
    parts = [places[:, :2]]
    if len(xy) > 20:
        parts.append(np.percentile(xy, [0.5, 99.5], axis=0))
    every = np.concatenate(parts)
    low, high = every.min(axis=0) - _MARGIN_M, every.max(axis=0) + _MARGIN_M
    size, middle = high - low, (low + high) / 2
    size = np.array([max(size[0], size[1] / 1.2), max(size[1], size[0] * 0.25)])
    return Crop(middle - size / 2, middle + size / 2)
