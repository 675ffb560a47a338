"""The scan from above on the plan: crop, wall points as a density, faces, path, scale."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.report.measures import BeforeAfter
from planfit.report.plots import colors
from planfit.report.plots.axes import BOTTOM_PT, RIGHT_PT, Axes, Entry, left_pt, round_number
from planfit.report.plots.drawing import (
    DASHED,
    DOTTED,
    FONT_PT,
    Box,
    Drawing,
    Shape,
    Words,
    width_of,
)
from planfit.scan.joined import FramesOfScan

_GAP_M = 2.0
"""A step from frame to frame above this, and above five usual ones, is a gap in the recording."""
_FEW, _STRAYS = 20, (0.3, 99.7)
"""Of clouds with more points than this, those outside of these percentiles are stray."""


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

    @staticmethod
    def around(
        paths: Sequence[Float[np.ndarray, "_ 2"]],
        clouds: Sequence[Float[np.ndarray, "_ 2"]],
        margin_m: float = 1.0,
        shapes: tuple[float, float] = (0.2, 1.6),
    ) -> "Crop":
        """What holds paths, clouds but for their stray points (m), and a margin, widened to a height per
        width between those of `shapes`."""
        parts = [*paths, *(c for c in clouds if 0 < len(c) <= _FEW)]
        parts += [np.percentile(c, _STRAYS, axis=0) for c in clouds if len(c) > _FEW]
        points = np.concatenate(parts)
        low, high = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
        size, middle = high - low, (low + high) / 2
        size = np.array([max(size[0], size[1] / shapes[1]), max(size[1], size[0] * shapes[0])])
        return Crop(middle - size / 2, middle + size / 2)

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


def crop_to_scan(both: BeforeAfter) -> Crop:
    """What the scan covers before and after."""
    sides = both.before, both.after
    clouds = [points for s in sides for points in (s.wall_xy, s.floor_points[:, :2])]
    return Crop.around([s.trajectory[:, :2] for s in sides], clouds)


def new_view(
    crop: Crop, width_pt: float, above_pt: float, right_pt: float = RIGHT_PT
) -> tuple[Drawing, Axes]:
    """A drawing with one view of a crop, true to scale, and room above and right of it."""
    (x0, y0), (x1, y1) = crop.low.tolist(), crop.high.tolist()
    left, right = left_pt((y0, y1)), width_pt - right_pt
    bottom = above_pt + (right - left) * crop.height_per_width
    drawing = Drawing(width_pt, bottom + BOTTOM_PT)
    return drawing, Axes(drawing, Box(left, above_pt, right, bottom), (x0, x1), (y0, y1))


def finish_view(axes: Axes, is_aligned: bool, entries: Sequence[Entry] = ()) -> None:
    """Draw the rim of a view, a bar of a round number of metres below it, and a legend above."""
    where = " in the plan" if is_aligned else ""
    axes.rim(f"x{where} (m)", f"y{where} (m)")
    draw_scale(axes)
    axes.legend(entries)


def draw_scale(axes: Axes) -> None:
    """A bar of a round number of metres, below a view on the right."""
    box, size_m = axes.box, axes.x[1] - axes.x[0]
    bar_m = round_number(0.28 * size_m)
    left, y = box.right - bar_m / size_m * box.size[0], box.bottom + 21
    bar = np.array([[left, y], [box.right, y]])
    axes.drawing.items.append(Shape([bar], colors.INK, 2.0))
    axes.drawing.items.append(Words(f"{bar_m:g} m", (left - 4, y + 3), colors.INK, "end"))


def draw_points(axes: Axes, xy: Float[np.ndarray, "m 2"], color: str) -> None:
    """Points as a density."""
    # In an overview of a building the finest cells would not be seen.
    is_overview = max(axes.x[1] - axes.x[0], axes.y[1] - axes.y[0]) > 20.0
    axes.density(xy, color, 1.08 if is_overview else 0.72)


def draw_paths(
    axes: Axes, xy: Float[np.ndarray, "n 2"], scans: Sequence[FramesOfScan], width_pt: float = 0.9
) -> None:
    """The path of the camera (m), or, of several scans, that of each in a colour of its own."""
    walks = [xy[own.frames] for own in scans] or [xy]
    for walk, color in zip(walks, cycle(colors.PATHS)):
        draw_path(axes, walk, color, find_gaps(walk), width_pt, np.zeros(0, dtype=int))


def draw_path(
    axes: Axes,
    xy: Float[np.ndarray, "n 2"],
    color: str,
    gaps: Int[np.ndarray, " g"],
    width_pt: float,
    jumps: Int[np.ndarray, " j"],
) -> None:
    """A path (m) and where it begins; dotted after frames with a gap, in another colour after those with a
    jump."""
    axes.lines(np.split(xy, np.union1d(gaps, jumps) + 1), color, width_pt)
    axes.lines([xy[i : i + 2] for i in gaps], color, width_pt, DOTTED)
    axes.lines([xy[i : i + 2] for i in jumps], colors.BEFORE, width_pt)
    placed = xy[np.isfinite(xy).all(axis=1)]  # of a storey, the frames that stand on it
    if len(placed):
        axes.ring(placed[0], color)


def find_gaps(positions: Float[np.ndarray, "n d"]) -> Int[np.ndarray, " g"]:
    """Frames after which the camera (m) is far off at once: frames are missing there."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    if len(steps) == 0:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(steps > max(_GAP_M, 5.0 * float(np.median(steps))))


def draw_mark(axes: Axes, mark: Mark) -> None:
    """A lettered frame around a window."""
    (x0, y0), (x1, y1) = mark.crop.low, mark.crop.high
    frame = np.array([[x0, y1], [x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    axes.lines([frame], colors.INK, 1.0, DASHED)
    left, top = axes.at(frame[0]).tolist()
    draw_label(axes, mark.letter, (left + 4, top + 12), colors.PAPER, colors.INK)


def draw_label(axes: Axes, words: str, at_pt: tuple[float, float], color: str, ground: str) -> None:
    """Bold words on a ground of their own."""
    left, bottom = at_pt[0] - 2, at_pt[1] + 2
    right, top = left + width_of(words) + 4.5, bottom - FONT_PT - 2
    back = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    axes.drawing.items.append(Shape([back], fill=ground))
    axes.drawing.items.append(Words(words, at_pt, color, is_bold=True))
