"""The scan from above on the plan: crop, wall points as a density, faces, path, scale."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from planfit.report.measures import BeforeAfter
from planfit.report.plots.drawing import (
    BOTTOM_IN,
    DPI,
    FONT_PT,
    GREY,
    INK,
    LEFT_IN,
    PATH,
    PATHS,
    RIGHT_IN,
    add_axes,
    new_figure,
)
from planfit.scan.joined import FramesOfScan

_GAP_M = 2.0
"""A step from frame to frame above this, and above five usual ones, is a gap in the recording."""


@dataclass(frozen=True)
class Crop:
    """A rectangle of the plan, m."""

    low: Float[np.ndarray, "2"]
    high: Float[np.ndarray, "2"]

    @property
    def size(self) -> Float[np.ndarray, "2"]:
        """Width and height, m."""
        return self.high - self.low

    @property
    def height_per_width(self) -> float:
        """Shape."""
        return float(self.size[1] / self.size[0])

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top, m."""
        return float(self.low[0]), float(self.high[0]), float(self.low[1]), float(self.high[1])

    @staticmethod
    def around(
        points: Float[np.ndarray, "m 2"],
        margin_m: float = 1.0,
        shapes: tuple[float, float] = (0.2, 1.6),
    ) -> "Crop":
        """What holds all points (m) and a margin.

        Args:
            points: one or more.
            margin_m: to each side.
            shapes: least and largest height per width; a longer rectangle is widened.
        """
        low, high = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
        size, middle = high - low, (low + high) / 2
        size = np.array([max(size[0], size[1] / shapes[1]), max(size[1], size[0] * shapes[0])])
        return Crop(middle - size / 2, middle + size / 2)

    def cells_of(
        self, inside: Float[np.ndarray, "m 2"], columns: int, rows: int
    ) -> Int[np.ndarray, " m"]:
        """Cell of each point that lies within, row by row from the lower left, of a grid over the crop."""
        at = ((inside - self.low) / self.size * [columns, rows]).astype(int)
        at = np.minimum(at, [columns - 1, rows - 1])  # the upper border belongs to the last cell
        return at[:, 1] * columns + at[:, 0]

    def contains(self, xy: Float[np.ndarray, "m 2"]) -> Bool[np.ndarray, " m"]:
        """Whether points lie within."""
        return np.all((xy >= self.low) & (xy <= self.high), axis=1)

    def touches(self, ends: Float[np.ndarray, "f 2 2"]) -> Bool[np.ndarray, " f"]:
        """Whether the bounding boxes of segments meet this."""
        above, below = ends.max(axis=1) >= self.low, ends.min(axis=1) <= self.high
        return np.all(above & below, axis=1)


@dataclass(frozen=True)
class Mark:
    """A lettered window on a plot."""

    letter: str
    crop: Crop


def crop_to_scan(both: BeforeAfter, shapes: tuple[float, float] = (0.2, 1.6)) -> Crop:
    """What the scan covers before and after, plus a margin; stray points are left out.

    Args:
        both: the scan.
        shapes: least and largest height per width; a longer crop is widened.
    """
    parts = []
    for side in (both.before, both.after):
        for points in (side.wall_xy, side.floor_points[:, :2]):
            if len(points) > 20:
                parts.append(np.percentile(points, [0.3, 99.7], axis=0))
            elif len(points):
                parts.append(points)
        parts.append(side.trajectory[:, :2])
    return Crop.around(np.concatenate(parts), shapes=shapes)


def view_figure(
    crop: Crop,
    width_in: float,
    above_in: float,
    is_aligned: bool = True,
    right_in: float = RIGHT_IN,
) -> tuple[Figure, Axes]:
    """A figure with one view of a crop, set up and true to scale, and room above and right of it (inches)."""
    axes_width = width_in - LEFT_IN - right_in
    axes_height = axes_width * crop.height_per_width
    figure = new_figure(width_in, BOTTOM_IN + axes_height + above_in)
    axes = add_axes(figure, LEFT_IN, BOTTOM_IN, axes_width, axes_height)
    set_up_view(axes, crop, is_aligned)
    return figure, axes


def set_up_view(axes: Axes, crop: Crop, is_aligned: bool = True) -> None:
    """Metre axes of a crop, true to scale."""
    axes.set_xlim(crop.low[0], crop.high[0])
    axes.set_ylim(crop.low[1], crop.high[1])
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10], min_n_ticks=2))
    where = " in the plan" if is_aligned else ""
    axes.set_xlabel(f"x{where} (m)", fontsize=FONT_PT, color=GREY, labelpad=2)
    axes.set_ylabel(f"y{where} (m)", fontsize=FONT_PT, color=GREY, labelpad=2)


def draw_points(
    axes: Axes,
    crop: Crop,
    xy: Float[np.ndarray, "m 2"],
    color: str,
    extent: tuple[float, float, float, float] | None = None,
) -> None:
    """Points as a density image: every point counts, and none hides another.

    `extent` is where on the axes the crop is drawn (left, right, bottom, top), if not at itself.
    """
    width_px = axes.get_window_extent().width
    # In an overview of a building single pixels would not be seen.
    columns = max(1, int(width_px / (3.0 if crop.size.max() > 20.0 else 2.0)))
    cell_m = crop.size[0] / columns
    rows = max(1, round(crop.size[1] / cell_m))
    inside = xy[crop.contains(xy)]
    if len(inside) == 0:
        return
    counts = np.bincount(crop.cells_of(inside, columns, rows), minlength=rows * columns)
    full = max(float(np.percentile(counts[counts > 0], 90)), 1.0)
    image = np.ones((rows * columns, 4))
    image[:, :3] = to_rgb(color)
    image[:, 3] = np.where(counts > 0, 0.35 + 0.65 * np.minimum(counts / full, 1.0), 0.0)
    axes.imshow(
        image.reshape(rows, columns, 4),
        extent=extent or crop.extent,
        origin="lower",
        interpolation="nearest",
        aspect="auto" if extent else "equal",
        zorder=4,
    )


def draw_faces(
    axes: Axes,
    crop: Crop,
    ends: Float[np.ndarray, "f 2 2"],
    color: str = INK,
    width_pt: float = 0.7,
    zorder: float = 3,
) -> None:
    """Segments (m) that meet the crop."""
    lines = LineCollection(
        list(ends[crop.touches(ends)]), colors=color, linewidths=width_pt, zorder=zorder
    )
    axes.add_collection(lines, autolim=False)


def draw_paths(
    axes: Axes,
    xy: Float[np.ndarray, "n 2"],
    scans: Sequence[FramesOfScan],
    width_pt: float = 0.9,
) -> None:
    """The path of the camera (m), or, of several scans, that of each in a colour of its own."""
    if not scans:
        draw_path(axes, xy, width_pt)
    for own, color in zip(scans, cycle(PATHS)):
        draw_path(axes, xy[own.frames], width_pt, color)


def draw_path(
    axes: Axes, xy: Float[np.ndarray, "n 2"], width_pt: float = 0.9, color: str = PATH
) -> None:
    """The path of the camera, m, and where it began; dotted where the recording has a gap."""
    gaps = find_gaps(xy)
    # A line is broken at NaN.
    walked = np.insert(xy, gaps + 1, np.nan, axis=0)
    axes.plot(walked[:, 0], walked[:, 1], color=color, linewidth=width_pt, zorder=5)
    for gap in gaps:
        x, y = xy[gap : gap + 2].T
        axes.plot(x, y, color=color, linewidth=width_pt, linestyle=(0, (1, 2)), zorder=5)
    axes.plot(
        xy[:1, 0], xy[:1, 1], "o", color="white", mec=color, markersize=4.5, mew=1.2, zorder=6
    )


def find_gaps(positions: Float[np.ndarray, "n d"]) -> Int[np.ndarray, " g"]:
    """Frames after which the camera (m) is far off at once: frames are missing there."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    if len(steps) == 0:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(steps > max(_GAP_M, 5.0 * float(np.median(steps))))


def draw_mark(axes: Axes, mark: Mark) -> None:
    """A lettered frame around a window."""
    axes.add_patch(
        Rectangle(
            (float(mark.crop.low[0]), float(mark.crop.low[1])),
            *(float(v) for v in mark.crop.size),
            fill=False,
            edgecolor=INK,
            linewidth=1.0,
            linestyle=(0, (4, 2)),
            zorder=6,
        )
    )
    axes.annotate(
        mark.letter,
        (float(mark.crop.low[0]), float(mark.crop.high[1])),
        xytext=(3, -3),
        textcoords="offset points",
        va="top",
        fontsize=FONT_PT + 1,
        fontweight="bold",
        color="white",
        bbox={"boxstyle": "round,pad=0.2", "facecolor": INK, "edgecolor": "none"},
        zorder=7,
    )


def draw_scale(axes: Axes, crop: Crop) -> None:
    """A bar of a round number of metres, below the picture on the right."""
    wanted = 0.28 * float(crop.size[0])
    power = 10.0 ** np.floor(np.log10(wanted))
    bar_m = max(m * power for m in (1, 2, 5) if m * power <= wanted)
    right, bottom = float(crop.high[0]), -0.30 / _height_in(axes)
    below = axes.get_xaxis_transform()  # x in metres, y in heights of the axes
    axes.plot(
        [right - bar_m, right],
        [bottom, bottom],
        color=INK,
        linewidth=2.0,
        solid_capstyle="butt",
        transform=below,
        clip_on=False,
    )
    axes.annotate(
        f"{bar_m:g} m",
        (right - bar_m, bottom),
        xycoords=below,
        xytext=(-4, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        fontsize=FONT_PT,
        color=INK,
        annotation_clip=False,
    )


def _height_in(axes: Axes) -> float:
    return axes.get_window_extent().height / DPI
