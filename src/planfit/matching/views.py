"""Distinct views among many frames: a camera that lingers counts once a visit."""

from dataclasses import dataclass

import numpy as np

CELL_M = 0.25
CELL_FORWARD = 0.18
"""Views in one cell of this size (a turn of 10 degrees) and of `CELL_M` are one."""
VISIT_WALKED_M = 3.0
"""Views in one cell are another visit once the camera has walked this much further."""


@dataclass(frozen=True)
class Views:
    """One frame for each view of each visit."""

    frame_idx: np.ndarray  # (v,) increasing
    centres: np.ndarray  # (v, 3) m
    forward: np.ndarray  # (v, 3) unit, viewing direction


def distinct_views(
    world_from_cams: np.ndarray, walked_m: np.ndarray, sharpness: np.ndarray | None = None
) -> Views:
    """Frames that stand for their like, the sharpest of them where `sharpness` (n,) is known.

    Frames of one cell of position and direction, within `VISIT_WALKED_M` of way, are alike: however
    long the camera stands there, one of them tells where it was.
    """
    n = len(world_from_cams)
    centres, forward = world_from_cams[:, :3, 3], world_from_cams[:, :3, 2]
    cells = np.column_stack(
        [
            np.floor(centres / CELL_M),
            np.floor(forward / CELL_FORWARD),
            np.floor(walked_m / VISIT_WALKED_M),
        ]
    ).astype(np.int64)
    _, group = np.unique(cells, axis=0, return_inverse=True)
    best_first = np.lexsort((np.arange(n), np.zeros(n) if sharpness is None else -sharpness))
    _, first = np.unique(group.ravel()[best_first], return_index=True)
    frame_idx = np.sort(best_first[first])
    return Views(frame_idx, centres[frame_idx], forward[frame_idx])
