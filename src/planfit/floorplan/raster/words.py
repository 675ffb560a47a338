"""Words and numbers in a picture: not read, but seen, so that it can be said where lengths may be written."""

import cv2
import numpy as np
import scipy.sparse
import scipy.spatial
from jaxtyping import Float, Int, UInt8

_LARGEST = 1 / 25
"""Letters are smaller than this share of the drawing."""
_LEAST_PX = 5
_FULL = 0.8
"""Letters cover less of their box: columns and blots cover more."""
_SLIM = 4.0
"""Nor are they so many times higher than wide, or wider than high."""
_ALIKE = 1.5
"""Heights of letters of a word differ by this factor at most."""
_GAP, _OFF = 1.2, 0.4
"""They are apart by at most so many of their heights, and no further off their line."""
_LETTERS = 3


def count_words(lines: UInt8[np.ndarray, "h w"], extent_px: float) -> int:
    """Number of rows of three and more small marks of one height, along rows or columns of a picture.

    Args:
        lines: 1 on everything dark.
        extent_px: of the drawing.
    """
    _, _, stats, middles = cv2.connectedComponentsWithStats(lines, connectivity=8)
    width, height = stats[1:, cv2.CC_STAT_WIDTH], stats[1:, cv2.CC_STAT_HEIGHT]
    side, least = np.maximum(width, height), np.minimum(width, height)
    fits = (side >= _LEAST_PX) & (side < _LARGEST * extent_px) & (side < _SLIM * least)
    fits &= stats[1:, cv2.CC_STAT_AREA] < _FULL * width * height
    at, boxes = middles[1:][fits], np.stack([width, height], axis=1)[fits]
    return max(_rows(at, boxes), _rows(at[:, ::-1], boxes[:, ::-1]))


def _rows(at: Float[np.ndarray, "n 2"], boxes: Int[np.ndarray, "n 2"]) -> int:
    """Rows along the first axis; boxes are wide along it and high along the other."""
    n = len(at)
    if n < _LETTERS:
        return 0
    height = boxes[:, 1].astype(float)
    reach = (_GAP + 1.0) * float(height.max())
    a, b = scipy.spatial.cKDTree(at).query_pairs(reach, output_type="ndarray").T
    tall = np.maximum(height[a], height[b])
    gap = np.abs(at[a, 0] - at[b, 0]) - (boxes[a, 0] + boxes[b, 0]) / 2
    is_next = (gap < _GAP * tall) & (np.abs(at[a, 1] - at[b, 1]) < _OFF * tall)
    is_next &= tall < _ALIKE * np.minimum(height[a], height[b])
    a, b = a[is_next], b[is_next]
    graph = scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n))
    _, group = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return int((np.bincount(group) >= _LETTERS).sum())
