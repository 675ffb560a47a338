"""Lines of text in a picture of a plan: titles, names of rooms, notes, however bold.

Connected marks of like height, one close behind the other, are the letters of a line, as in L. A. Fletcher
and R. Kasturi, "A robust algorithm for text string separation from mixed text/graphics images", PAMI 1988.
Pieces of wall stand in rows too, between doors and windows: they are bars, alike, thin for their height, or
together more than any one mark.
"""

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from planfit.floorplan.faces import connected_groups
from planfit.floorplan.raster.sheet_marks import marks_of

_LEAST = 3
"""Letters of a line: fewer may be anything."""
_HIGHEST = 0.15
"""Of what is drawn, height of the letters of a title."""
_ALIKE = 2.2
"""A capital is at most so many times as high as the letter beside it."""
_APART = 1.2
"""Of their height, the gap between two letters, that of two words among them."""
_SOLID = 0.85
"""Of its box, what of a bar is dark; of letters, less."""
_SLIM = 10.0
"""Heights of letters over their thickness: 5 of bold ones, 9 of regular ones. Walls between two rooms are 0.1
to 0.3 m thick, and longer than 3 m."""
_MOST_INK = 3.0
"""Times that of most letters of a line, what one has: two that touch; a piece of wall in line has more."""
_VARIED = 0.05
"""Variation of the letters' widths and inks, of their means: pieces of wall in a row are alike."""


def without_text(darkness: Float[np.ndarray, "h w"]) -> tuple[Float[np.ndarray, "h w"], int]:
    """The picture with lines of text blanked, and how many letters these had."""
    labels, stats, low, high = marks_of(darkness)
    strokes = (labels > 0).astype(np.uint8)
    inner = cv2.erode(strokes, np.ones((3, 3), np.uint8))
    n_edge = np.bincount(labels[strokes > inner], minlength=len(stats))
    thickness = 2 * stats[:, 4] / np.maximum(n_edge, 1)
    is_letter = _are_letters(stats, thickness, float((high - low).max()))
    if not is_letter.any():
        return darkness, 0
    return np.where(is_letter[labels], np.float32(0.0), darkness), int(is_letter.sum())


def _are_letters(
    marks: Int[np.ndarray, "n 5"], thickness: Float[np.ndarray, " n"], extent_px: float
) -> Bool[np.ndarray, " n"]:
    """Which marks, each (u, v, width, height, pixels) of its box, are letters; the first is the paper."""
    result = np.zeros(len(marks), dtype=bool)
    may_be = marks[:, 2:4].max(axis=1) < _HIGHEST * extent_px
    may_be[0] = False
    most_ink = marks[1:, 4].max(initial=0)
    idx = np.flatnonzero(may_be)
    for axes in ((0, 1), (1, 0)):  # lines along rows, and text turned by a quarter
        boxes = marks[idx][:, [*axes, *(2 + axis for axis in axes), 4]]
        slim = boxes[:, 3] / thickness[idx]
        group = _lines(boxes.astype(float))
        lines = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
        for own in filter(len, lines):
            own = own[boxes[own, 4] < _MOST_INK * np.median(boxes[own, 4])]
            # Walls of a building hang together; what has more ink than any mark is one in pieces.
            is_line = len(own) >= _LEAST and boxes[own, 4].sum() < most_ink
            if is_line and np.median(slim[own]) < _SLIM and _is_text(boxes[own]):
                result[idx[own]] = True
    return result


def _lines(boxes: Float[np.ndarray, "n 5"]) -> Int[np.ndarray, " n"]:
    """Line of each box (along, across, length, height, pixels): close behind one another and as high."""
    along, across, length, height = boxes[:, :4].T
    reach = _APART * height
    ahead = shapely.box(along, across, along + length + reach, across + height)
    own = shapely.box(along, across, along + length, across + height)
    a, b = shapely.STRtree(own).query(ahead, predicate="intersects")
    common = np.minimum((across + height)[a], (across + height)[b]) - np.maximum(
        across[a], across[b]
    )
    lower = np.minimum(height[a], height[b])
    is_next = (
        (a != b) & (common > 0.5 * lower) & (np.maximum(height[a], height[b]) < _ALIKE * lower)
    )
    return connected_groups(a[is_next], b[is_next], len(boxes))


def _is_text(boxes: Int[np.ndarray, "k 5"]) -> bool:
    """Whether most marks of a line are no bars, and they differ as letters do."""
    ink = boxes[:, 4] / (boxes[:, 2] * boxes[:, 3])
    varied = np.hypot(np.std(boxes[:, 2]) / np.mean(boxes[:, 2]), np.std(ink) / np.mean(ink))
    return bool(np.median(ink) < _SOLID and varied > _VARIED)
