"""Which ceiling each frame sees: heights at which many points lie, found once loops are closed.

Rooms have ceilings of different heights, with beams and ducts below them. A frame's ceiling points are
held to the height at which most of them lie, where enough of the scan lies there too.
"""

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.runtime import let_go
from planfit.segmentation import LevelPoints, Structure

_BIN_M = 0.02
TOLERANCE_M = 0.1
"""A frame belongs to a ceiling when the middle of its ceiling points is within this of it."""
_MIN_SHARE = 0.1
"""Share of the frames with ceiling that a height needs."""


def find_ceilings(
    structure: Structure, level_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, " n"]:
    """Height (m) of the ceiling that each frame sees, level frame; NaN where it is none of the common.

    Args:
        structure: the scan's.
        level_from_cams: poses with loops closed: heights must agree to a few centimetres.
    """
    middles = level_middles(structure.ceiling, level_from_cams)
    found, seen = np.full(len(level_from_cams), np.nan), np.flatnonzero(np.isfinite(middles))
    middle = middles[seen]
    if len(seen) == 0:
        return found
    for height in _common_heights(middle):
        is_near = np.abs(middle - height) < TOLERANCE_M
        is_near &= ~np.isfinite(found[seen])
        found[seen[is_near]] = np.median(middle[is_near])
    return found


def level_middles(
    level: LevelPoints, level_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, " n"]:
    """Height (m) of the middle of each frame's points of a floor or ceiling; NaN where it has none."""
    start = level.start
    middles = np.full(len(level_from_cams), np.nan)
    for i in np.flatnonzero(np.diff(start)):
        own = level.points_cam[start[i] : start[i + 1]]
        middles[i] = np.median(se3.transform(level_from_cams[i], own)[:, 2])
        let_go(own)
    return middles


def _common_heights(middle: np.ndarray) -> list[float]:
    """Heights m that many frames see, most frames first, apart by more than twice the tolerance."""
    edges = np.arange(middle.min() - _BIN_M, middle.max() + 2 * _BIN_M, _BIN_M)
    counts, _ = np.histogram(middle, edges)
    centres = 0.5 * (edges[:-1] + edges[1:])
    half = max(1, round(TOLERANCE_M / _BIN_M))
    wide = np.convolve(counts, np.ones(2 * half + 1))[half:-half]
    heights: list[float] = []
    while wide.max() >= max(_MIN_SHARE * len(middle), 3):
        centre = centres[int(np.argmax(wide))]
        # Most of a window may lie at its edge: its middle would miss them.
        within = np.abs(middle - centre) < (half + 0.5) * _BIN_M
        heights.append(float(np.median(middle[within])))
        wide[np.abs(centres - centre) < 2 * TOLERANCE_M] = 0
    return heights
