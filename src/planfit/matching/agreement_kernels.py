"""Compiled loop of dense agreement: the cells of one view, seen in another.

As in `matching.pair_kernels`, shapes are in the docstrings: numba compiles types that nothing can wrap.
"""

import numpy as np

from planfit.compiled import kernel
from planfit.matching.view_grids import COLUMNS, ROWS

UNKNOWN = 0.8
"""Likeness of views whose greys tell nothing."""
NOISE = 16.0
"""Variance of greys, in levels of 255, up to which their likeness counts half."""
FEW = 50
"""So does that of this many cells."""


@kernel
def compare_views(
    pairs: np.ndarray,
    a_from_b: np.ndarray,
    sigma_rotation: np.ndarray,
    middle_a: np.ndarray,
    is_matched: np.ndarray,
    depth_m: np.ndarray,
    grey: np.ndarray,
    cameras: np.ndarray,
    tolerance: np.ndarray,
) -> np.ndarray:
    """Cells of the first view of each pair that are seen in the second one, or looked past (p, 3).

    Args:
        pairs: (p, 2) frames.
        a_from_b: (p, 4, 4) m, motion between them.
        sigma_rotation: (p,) rad, of that motion, about `middle_a`.
        middle_a: (p, 3) m, camera frame of the first: where the motion is known best.
        is_matched: (p, ROWS / n, COLUMNS / n), blocks of n x n cells of the first view with a match.
        depth_m, grey, cameras: of `ViewGrids`.
        tolerance: base (m), growth with depth, sigmas of the rotation.

    Returns:
        Cells where the second view shows a surface at the place; cells where it looks past the place;
        likeness (correlation) of the greys of the former, without the matched blocks.
    """
    result = np.zeros((len(pairs), 3))
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        views = (depth_m[i], grey[i], cameras[i], depth_m[j], grey[j], cameras[j])
        turning = tolerance[2] * sigma_rotation[k]
        n_seen, n_past, likeness = _compare_pair(
            views, a_from_b[k], middle_a[k], is_matched[k], tolerance[0], tolerance[1], turning
        )
        result[k, 0], result[k, 1], result[k, 2] = n_seen, n_past, likeness
    return result


@kernel
def _compare_pair(
    views: tuple,
    a_from_b: np.ndarray,
    middle_a: np.ndarray,
    is_matched: np.ndarray,
    base_m: float,
    per_m: float,
    turning: float,
) -> tuple:
    """The three numbers of one pair; departures of `base_m`, and so much more with depth and with the
    distance from `middle_a`, are allowed."""
    depth_a, grey_a, camera_a, depth_b, grey_b, camera_b = views
    block, r, t = ROWS // is_matched.shape[0], a_from_b[:3, :3], a_from_b[:3, 3]
    n_seen, n_past, sums = 0, 0, np.zeros(6)
    for row in range(ROWS):
        for column in range(COLUMNS):
            z = depth_a[row, column]
            if not z > 0:
                continue
            x = (column - camera_a[2]) / camera_a[0] * z
            y = (row - camera_a[3]) / camera_a[1] * z
            # The cell's point in the first camera, less t; R^T takes it into the second.
            dx, dy, dz = x - t[0], y - t[1], z - t[2]
            there = r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz
            if not there > 0.2:
                continue
            u = camera_b[0] * (r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz) / there + camera_b[2]
            v = camera_b[1] * (r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz) / there + camera_b[3]
            if not (-0.5 <= u < COLUMNS - 0.5 and -0.5 <= v < ROWS - 0.5):
                continue
            column_b, row_b = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
            nearest, farthest = _range(depth_b, row_b, column_b)
            if not nearest > 0:
                continue
            dx, dy, dz = x - middle_a[0], y - middle_a[1], z - middle_a[2]
            lever = np.sqrt(dx**2 + dy**2 + dz**2)
            allowed = base_m + per_m * max(z, there) + turning * lever
            if there > farthest + allowed:
                continue  # hidden by a nearer surface: says nothing
            if there < nearest - allowed:
                n_past += 1
                continue
            n_seen += 1
            if not is_matched[row // block, column // block]:
                a, b = float(grey_a[row, column]), float(grey_b[row_b, column_b])
                sums[0] += 1.0
                sums[1] += a
                sums[2] += b
                sums[3] += a * a
                sums[4] += b * b
                sums[5] += a * b
    return n_seen, n_past, _likeness(sums)


@kernel
def _likeness(sums: np.ndarray) -> float:
    """Correlation of greys a and b, from the sums (6,) of 1, a, b, a^2, b^2, ab."""
    n, mean = sums[0], sums / max(sums[0], 1.0)
    contrast = np.sqrt(max(mean[3] - mean[1] ** 2, 0.0) * max(mean[4] - mean[2] ** 2, 0.0))
    alike = mean[5] - mean[1] * mean[2]
    # Blank walls, and few cells, tell nothing either way.
    likeness = (alike + UNKNOWN * NOISE) / (contrast + NOISE)
    return (n * likeness + FEW * UNKNOWN) / (n + FEW)


@kernel
def _range(depth_m: np.ndarray, row: int, column: int) -> tuple:
    """Least and largest depth (m) of a cell and the eight about it; 0 and 0 where the cell has none."""
    if not depth_m[row, column] > 0:
        return 0.0, 0.0
    low = high = float(depth_m[row, column])
    for r in range(max(row - 1, 0), min(row + 2, ROWS)):
        for c in range(max(column - 1, 0), min(column + 2, COLUMNS)):
            z = depth_m[r, c]
            if z > 0:
                low, high = min(low, z), max(high, z)
    return low, high
