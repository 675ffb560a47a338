"""Which ceiling each frame sees: heights at which many points lie, found once loops are closed.

Rooms have ceilings of different heights, with beams and ducts below them. A frame's ceiling points are
held to the height at which most of them lie, where enough of the scan lies there too.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.errors import require_positive, require_share
from planfit.geometry import se3
from planfit.segmentation import Structure

_BIN_M = 0.02


@dataclass(frozen=True)
class CeilingOptions:
    """When points make a ceiling."""

    tolerance_m: float = 0.1
    """A frame belongs to a ceiling when the middle of its ceiling points is within this of it."""
    min_share: float = 0.1
    """Share of the frames with ceiling that a height needs."""

    def __post_init__(self) -> None:
        require_positive(self, "tolerance_m")
        require_share(self, "min_share")


def find_ceilings(
    structure: Structure, level_from_cams: Float[np.ndarray, "n 4 4"], options: CeilingOptions
) -> Float[np.ndarray, " n"]:
    """Height (m) of the ceiling that each frame sees, level frame; NaN where it is none of the common.

    Args:
        structure: the scan's.
        level_from_cams: poses with loops closed: heights must agree to a few centimetres.
        options: see there.
    """
    start = structure.ceiling.start
    found = np.full(len(level_from_cams), np.nan)
    seen = np.flatnonzero(np.diff(start))
    if len(seen) == 0:
        return found
    middle = np.array(
        [
            np.median(
                se3.transform(
                    level_from_cams[i], structure.ceiling.points_cam[start[i] : start[i + 1]]
                )[:, 2]
            )
            for i in seen
        ]
    )
    for height in _common_heights(middle, options):
        is_near = np.abs(middle - height) < options.tolerance_m
        is_near &= ~np.isfinite(found[seen])
        found[seen[is_near]] = np.median(middle[is_near])
    return found


def _common_heights(middle: np.ndarray, options: CeilingOptions) -> list[float]:
    """Heights m that many frames see, most frames first, apart by more than twice the tolerance."""
    edges = np.arange(middle.min() - _BIN_M, middle.max() + 2 * _BIN_M, _BIN_M)
    counts, _ = np.histogram(middle, edges)
    centres = 0.5 * (edges[:-1] + edges[1:])
    half = max(1, round(options.tolerance_m / _BIN_M))
    wide = np.convolve(counts, np.ones(2 * half + 1))[half:-half]
    heights: list[float] = []
    while wide.max() >= max(options.min_share * len(middle), 3):
        k = int(np.argmax(wide))
        heights.append(float(centres[k]))
        wide[np.abs(centres - centres[k]) < 2 * options.tolerance_m] = 0
    return heights
