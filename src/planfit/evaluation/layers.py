"""Share of walls that the scan shows as two layers: what drift leaves where the camera comes back.

No plan is needed. Walls are looked at through square windows. In each, every frame that shows the wall gives
a few measurements: how far its points lie before the window's plane. A window is double where these fall into
two groups with a gap between them, and almost no frame sees both: a niche, a radiator or the edge of a
door is seen with the wall behind it in the same frame, a wall doubled by drift never is.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from planfit.geometry import se3
from planfit.segmentation import WallPatches

_PARALLEL = np.cos(np.deg2rad(15.0))


WINDOW_M = 0.5
"""Side of the square window, m, along the wall and up."""
MIN_GAP_M = 0.03
"""Layers nearer than this, m, are one: depth cameras are off by as much from frame to frame."""
MAX_GAP_M = 0.3
"""Layers further apart, m, are two walls."""
GAP_TO_SIGMA = 2.0
"""The gap is at least this many times the standard deviation of either layer; else the wall is thick, not
double."""
MIN_FRAMES = 2
"""Each layer is seen by this many frames or more; windows seen by fewer than twice as many are not judged."""
MIN_POINTS = 5
"""Points that a frame's measurement of a window takes."""
MAX_BOTH_SHARE = 0.1
"""Share of frames that may see both layers; where more do, they are two surfaces."""


@dataclass(frozen=True)
class Layers:
    """What the windows show."""

    double_share: float
    """Windows that are double over windows judged; NaN where none could be judged."""
    n_windows: int
    """Windows judged: seen by enough frames."""
    gap_median_m: float
    """Median distance of the two layers where double; NaN where none is."""
    windows: Float[np.ndarray, "w 3"]
    """Centres, m, target frame."""
    is_double: Bool[np.ndarray, " w"]


def wall_layers(
    walls: WallPatches,
    target_from_cams: Float[np.ndarray, "n 4 4"],
) -> Layers:
    """Judge the wall patches of a scan at poses with z up."""
    positions, normals, frame_idx = _measurements(walls, target_from_cams)
    centres, gaps = [], []
    is_open = np.ones(len(positions), dtype=bool)
    tree = cKDTree(positions) if len(positions) else None
    for i in range(len(positions)):
        if tree is None or not is_open[i]:
            continue
        inside, before = _in_window(tree, positions, normals, i)
        is_open[inside] = False  # each bit of wall is judged through one window
        if len(np.unique(frame_idx[inside])) >= 2 * MIN_FRAMES:
            centres.append(positions[i])
            gaps.append(_gap(before, frame_idx[inside]))
    gap = np.array(gaps)
    is_double = gap > 0
    return Layers(
        double_share=float(is_double.mean()) if len(gap) else np.nan,
        n_windows=len(gap),
        gap_median_m=float(np.median(gap[is_double])) if is_double.any() else np.nan,
        windows=np.array(centres).reshape(-1, 3),
        is_double=is_double.reshape(-1),
    )


def _in_window(
    tree: cKDTree, positions: np.ndarray, normals: np.ndarray, i: int
) -> tuple[np.ndarray, np.ndarray]:
    """Measurements (k,) of the same side in the window about measurement i, and m before it."""
    # A ball about the window, a box of its side along and up and of the largest gap to both sides.
    near = np.array(tree.query_ball_point(positions[i], np.hypot(WINDOW_M / np.sqrt(2), MAX_GAP_M)))
    near = near[normals[near] @ normals[i] > _PARALLEL]
    step = positions[near] - positions[i]
    before = step @ normals[i]
    along = step @ np.array([-normals[i, 1], normals[i, 0], 0.0])
    inside = np.maximum(np.abs(along), np.abs(step[:, 2])) <= WINDOW_M / 2
    inside &= np.abs(before) <= MAX_GAP_M
    return near[inside], before[inside]


def _gap(before: np.ndarray, frame_idx: np.ndarray) -> float:
    """Distance (m) of the two layers among measurements (m,) of frames (m,); 0 where there are not two."""
    order = np.argsort(before)
    before, frame_idx = before[order], frame_idx[order]
    cut = int(np.argmax(np.diff(before))) + 1
    low, high = before[:cut], before[cut:]
    gap = float(high[0] - low[-1])
    sigma = max(float(np.std(low)), float(np.std(high)))
    if gap < max(MIN_GAP_M, GAP_TO_SIGMA * sigma):
        return 0.0
    frames_low, frames_high = set(frame_idx[:cut].tolist()), set(frame_idx[cut:].tolist())
    both = frames_low & frames_high
    if len(both) > MAX_BOTH_SHARE * len(frames_low | frames_high):
        return 0.0
    if min(len(frames_low - both), len(frames_high - both)) < MIN_FRAMES:
        return 0.0
    return float(np.median(high) - np.median(low))


def _measurements(
    walls: WallPatches, target_from_cams: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean position (m, 3) m, level normal (m, 3) and frame (m,) of the points of each patch in each square.

    Squares are half a window wide, so that every window holds measurements of every frame that shows it.
    """
    patch = np.repeat(np.arange(len(walls)), np.diff(walls.start))
    normals = np.einsum(
        "kij,kj->ki", target_from_cams[walls.frame_idx][:, :3, :3], walls.normals_cam
    )
    normals[:, 2] = 0.0
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    points = se3.transform_indexed(target_from_cams, walls.frame_idx[patch], walls.points_cam)
    side = WINDOW_M / 2
    along = points[:, 1] * normals[patch, 0] - points[:, 0] * normals[patch, 1]
    square = np.stack(
        [patch, np.floor(along / side).astype(int), np.floor(points[:, 2] / side).astype(int)],
        axis=1,
    )
    # Sorted by patch, then square, the points of a square follow each other and reduceat adds them.
    order = np.lexsort(square.T[::-1])
    square = square[order]
    is_first = np.concatenate([[True], (np.diff(square, axis=0) != 0).any(axis=1)])[: len(square)]
    start = np.flatnonzero(is_first)
    if len(start) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=int)
    sizes = np.diff(np.concatenate([start, [len(square)]]))
    positions = np.add.reduceat(points[order], start, axis=0) / sizes[:, None]
    kept = sizes >= MIN_POINTS
    of_patch = square[start, 0][kept]
    return positions[kept], normals[of_patch], walls.frame_idx[of_patch]
