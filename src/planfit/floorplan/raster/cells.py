"""Walls drawn as closed outlines, empty or hatched: the thin, long pieces of paper that lines shut in.

Where outlines are closed, a wall with all that hangs on it is one piece of paper, and every window, leaf of a
door and piece of furniture is another: they are told apart as wholes. Where a line is broken, the paper
inside runs into a room and is too fat for a wall; then the strips between lines tell more.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.floorplan.elements import ELONGATED
from planfit.floorplan.raster.line_work import LineWork, closed, of_labels, opened
from planfit.floorplan.raster.picture import Mask

_FATTEST = 1 / 14
"""Walls are thinner than this share of the drawing."""
_ALIKE_PX = 3
"""Two parts of a window begin and end at the same place, within this."""
_SMALL = 0.3
"""A closed ring smaller than this share of the drawing is a piece of furniture."""
_THIN, _THICK = 0.35, 1.5
"""Walls are thicker than this share of the median: leaves of doors are thinner; and thinner than this many
times what all but few are thinner than."""
_SHARES = np.array([0.5, 0.9])


@dataclass(frozen=True)
class _Hatching:
    """Walls found by filling gaps."""

    mask: Mask
    """1 where there is wall."""
    share: float
    """Of the inside of the mask, what oblique lines cover as evenly as hatching does."""
    grow_px: float
    """From the mask's edge to the middle of the outline."""


@dataclass(frozen=True)
class _Cells:
    """Pieces of paper by label."""

    low: Int[np.ndarray, "n 2"]
    """First column and row of the box."""
    side: Int[np.ndarray, "n 2"]
    """Width and height of the box, px."""
    area: Int[np.ndarray, " n"]
    outline: Float[np.ndarray, " n"]
    thickness: Float[np.ndarray, " n"]
    """At the thickest place: diameter of the largest circle inside."""


def find_wall_cells(lines: Mask, line_px: float, extent_px: float) -> Mask:
    """Mask of the paper inside the outlines of walls; 0 everywhere where there is none.

    Args:
        lines: 1 on everything dark, walls along rows and columns.
        line_px: usual width of a line.
        extent_px: larger side of the drawing.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(1 - lines, connectivity=4)
    labels = np.asarray(labels, dtype=np.int32)
    depth = cv2.distanceTransform(1 - lines, cv2.DIST_L2, 3)
    deepest = np.zeros(count, np.float32)
    np.maximum.at(deepest, labels.ravel(), depth.ravel())
    cells = _Cells(
        stats[:, :2], stats[:, 2:4], stats[:, 4], _outlines(labels, count), 2 * deepest - 1
    )
    thickness = cells.thickness
    is_wall = (thickness > 1.5) & (thickness < _FATTEST * extent_px)
    is_wall &= cells.outline / 2 > (ELONGATED + 1) * thickness
    # What runs along the rim of the picture, and does not only end there, is the paper around.
    rim = np.concatenate([labels[0], labels[-1], labels[1:-1, 0], labels[1:-1, -1]])
    is_wall &= np.bincount(rim, minlength=count) < cells.outline / 2
    is_wall &= ~_are_stacked(cells, 2 * line_px + 2)
    for i in np.flatnonzero(is_wall):
        is_wall[i] = not _is_small_ring(labels, cells, int(i), _SMALL * extent_px)
    if not is_wall.any():
        return np.zeros_like(lines)
    order = np.argsort(thickness[is_wall])
    # The network of walls outweighs many short cells, and rooms with much in them.
    reached = np.cumsum((cells.outline / np.maximum(thickness, 1.0))[is_wall][order] ** 2)
    usual, thick = thickness[is_wall][order][np.searchsorted(reached, reached[-1] * _SHARES)]
    is_wall &= (thickness > _THIN * usual) & (thickness < _THICK * thick)
    return is_wall.astype(np.uint8)[labels]


def _outlines(labels: Int[np.ndarray, "h w"], count: int) -> Float[np.ndarray, " count"]:
    """Length of the border of each label, in edges of pixels."""
    total = np.zeros(count)
    for one, other in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        is_border = one != other
        total += np.bincount(one[is_border], minlength=count)
        total += np.bincount(other[is_border], minlength=count)
    return total


def _are_stacked(cells: _Cells, gap_px: float) -> Bool[np.ndarray, " n"]:
    """Which rectangles stand beside others of the same length: parts of windows, stairs, lists."""
    result = np.zeros(len(cells.area), dtype=bool)
    is_box = cells.area > 0.9 * (cells.side - 1).prod(axis=1)  # a tilt adds a row
    is_box &= cells.side.max(axis=1) > 8
    low, high = cells.low, cells.low + cells.side
    for along in (0, 1):
        across = 1 - along
        idx = np.flatnonzero(is_box & (cells.side[:, along] > cells.side[:, across]))
        idx = idx[np.argsort(low[idx, across], kind="stable")]
        for k, i in enumerate(idx):
            later = idx[k + 1 :]
            later = later[: np.searchsorted(low[later, across], high[i, across] + gap_px)]
            alike = np.abs(low[later, along] - low[i, along]) <= _ALIKE_PX
            alike &= np.abs(high[later, along] - high[i, along]) <= _ALIKE_PX
            alike &= low[later, across] >= high[i, across]
            result[later[alike]] = True
            result[i] |= bool(alike.any())
    return result


def _is_small_ring(labels: Int[np.ndarray, "h w"], cells: _Cells, i: int, small_px: float) -> bool:
    """Whether a cell goes once round a piece of furniture: closed, with one hole, without branches."""
    if cells.side[i].max() >= small_px:
        return False
    (u, v), (w, h) = cells.low[i], cells.side[i]
    own = np.pad((labels[v : v + h, u : u + w] == i).astype(np.uint8), 1)
    contours, hierarchy = cv2.findContours(own, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    is_hole = hierarchy[0][:, 3] >= 0
    area = np.array([cv2.contourArea(contour) for contour in contours])
    inside = area[is_hole].sum()
    # Letters and the rims of lines leave small holes anywhere.
    return bool(inside > 0.15 * area[~is_hole].max(initial=1.0))


def fill_hatching(
    lines: Mask, line_work: LineWork, empty: Mask, size: int, least: int
) -> _Hatching:
    """Fill gaps narrower than `size` px and keep what is then at least `least` px thick.

    Long empty gaps between lines along the axes, as between furniture and its wall, are no hatching, and stay
    open. Where most of what is found is hatched with oblique lines, walls are the gaps between these alone,
    up to the outline: what is outlined beside them is not hatched.

    Args:
        lines: 1 on everything dark.
        line_work: lines along the axes.
        empty: 1 in empty strips between these.
        size: px.
        least: px.
    """
    oblique = lines & (1 - (line_work.along[0] | line_work.along[1]))
    filled = closed(lines, size)
    filled &= (1 - empty) | lines
    mask = opened(filled, least)
    share = _hatched_share(mask, oblique, size, line_work.line_px)
    if share < 0.5:  # else all walls of the drawing are taken to be hatched
        return _Hatching(mask, share, -line_work.line_px / 2)
    line_px = round(line_work.line_px)
    mask = closed(_hatched_cells(filled, lines, oblique), line_px + 3)
    mask = _outlined_alike(opened(mask, max(line_px + 1, size // 2)), line_work)
    return _Hatching(
        mask, _hatched_share(mask, oblique, size, line_work.line_px), line_work.line_px / 2
    )


def _hatched_share(mask: Mask, oblique: Mask, size: int, line_px: float) -> float:
    """Share of the inside of a mask that oblique lines cover evenly, at distances up to `size` px."""
    inside = cv2.erode(mask, np.ones((2 * round(line_px) + 1,) * 2, np.uint8)) > 0
    if not inside.any():
        return 0.0
    density = cv2.blur(oblique.astype(np.float32), (2 * size + 1, 2 * size + 1))[inside]
    return float(((density > 0.08) & (density < 0.8)).mean())


def _hatched_cells(filled: Mask, lines: Mask, oblique: Mask) -> Mask:
    """Filled gaps whose rim is hatching: those of windows and beside furniture have lines along the axes."""
    gaps = (filled & (1 - lines)).astype(np.uint8)
    count, labels = cv2.connectedComponents(gaps, connectivity=4)
    square = np.ones((3, 3), np.uint8)
    n_rim = np.bincount(labels[(gaps > 0) & (cv2.dilate(lines, square) > 0)], minlength=count)
    n_hatched = np.bincount(labels[(gaps > 0) & (cv2.dilate(oblique, square) > 0)], minlength=count)
    return of_labels(labels, n_hatched >= 0.25 * n_rim)


def _outlined_alike(mask: Mask, line_work: LineWork) -> Mask:
    """Where most walls have lines along their faces, all have: words, which close up too, have none."""
    count, labels = cv2.connectedComponents(mask, connectivity=4)
    rim = mask & (1 - cv2.erode(mask, np.ones((3, 3), np.uint8)))
    reach = 2 * round(line_work.line_px) + 3
    lined = cv2.dilate(np.bitwise_or(*line_work.along), np.ones((reach, reach), np.uint8))
    n_rim = np.bincount(labels[rim > 0], minlength=count)
    share = np.bincount(labels[(rim > 0) & (lined > 0)], minlength=count) / np.maximum(n_rim, 1)
    if n_rim[share > 0.75].sum() < 0.6 * n_rim.sum():
        return mask
    return of_labels(labels, share > 0.6)
