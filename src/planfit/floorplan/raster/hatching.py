"""Hatched walls: what becomes solid when the gaps between the lines of the hatching are filled."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import UInt8

from planfit.floorplan.raster.line_work import LineWork, closed, opened

_MOSTLY = 0.5
"""From this share of hatched inside on, all walls of the drawing are taken to be hatched."""


@dataclass(frozen=True)
class Hatching:
    """Walls found by filling gaps."""

    mask: UInt8[np.ndarray, "h w"]
    """1 where there is wall."""
    share: float
    """Of the inside of the mask, what oblique lines cover as evenly as hatching does."""
    grow_px: float
    """From the mask's edge to the middle of the outline."""


def fill_hatching(
    lines: UInt8[np.ndarray, "h w"],
    line_work: LineWork,
    empty: UInt8[np.ndarray, "h w"],
    size: int,
    least: int,
) -> Hatching:
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
    if share < _MOSTLY:
        return Hatching(mask, share, -line_work.line_px / 2)
    line_px = round(line_work.line_px)
    mask = closed(_hatched_cells(filled, lines, oblique), line_px + 3)
    mask = _outlined_alike(opened(mask, max(line_px + 1, size // 2)), line_work)
    return Hatching(
        mask, _hatched_share(mask, oblique, size, line_work.line_px), line_work.line_px / 2
    )


def _hatched_share(
    mask: UInt8[np.ndarray, "h w"], oblique: UInt8[np.ndarray, "h w"], size: int, line_px: float
) -> float:
    """Share of the inside of a mask that oblique lines cover evenly, at distances up to `size` px."""
    inside = cv2.erode(mask, np.ones((2 * round(line_px) + 1,) * 2, np.uint8)) > 0
    if not inside.any():
        return 0.0
    density = cv2.blur(oblique.astype(np.float32), (2 * size + 1, 2 * size + 1))[inside]
    return float(((density > 0.08) & (density < 0.8)).mean())


def _hatched_cells(
    filled: UInt8[np.ndarray, "h w"],
    lines: UInt8[np.ndarray, "h w"],
    oblique: UInt8[np.ndarray, "h w"],
) -> UInt8[np.ndarray, "h w"]:
    """Filled gaps whose rim is hatching: those of windows and beside furniture have lines along the axes."""
    gaps = (filled & (1 - lines)).astype(np.uint8)
    count, labels = cv2.connectedComponents(gaps, connectivity=4)
    square = np.ones((3, 3), np.uint8)
    n_rim = np.bincount(labels[(gaps > 0) & (cv2.dilate(lines, square) > 0)], minlength=count)
    n_hatched = np.bincount(labels[(gaps > 0) & (cv2.dilate(oblique, square) > 0)], minlength=count)
    is_hatched = (n_hatched >= 0.25 * n_rim).astype(np.uint8)
    is_hatched[0] = 0
    return is_hatched[np.asarray(labels, dtype=int)]


def _outlined_alike(
    mask: UInt8[np.ndarray, "h w"], line_work: LineWork
) -> UInt8[np.ndarray, "h w"]:
    """Where most walls have lines along their faces, all have: words, which close up too, have none."""
    count, labels = cv2.connectedComponents(mask, connectivity=4)
    rim = mask & (1 - cv2.erode(mask, np.ones((3, 3), np.uint8)))
    reach = 2 * round(line_work.line_px) + 3
    lined = cv2.dilate(np.bitwise_or(*line_work.along), np.ones((reach, reach), np.uint8))
    n_rim = np.bincount(labels[rim > 0], minlength=count)
    share = np.bincount(labels[(rim > 0) & (lined > 0)], minlength=count) / np.maximum(n_rim, 1)
    if n_rim[share > 0.75].sum() < 0.6 * n_rim.sum():
        return mask
    is_kept = (share > 0.6).astype(np.uint8)
    is_kept[0] = 0
    return is_kept[np.asarray(labels, dtype=int)]
