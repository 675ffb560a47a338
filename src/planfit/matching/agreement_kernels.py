"""Compiled loop of dense agreement: the cells of one view, seen in another.

As in `kernels.py`, shapes are in the docstrings: numba compiles types that nothing can wrap.
"""

import numba
import numpy as np

from planfit.matching.view_grids import COLUMNS, ROWS

UNKNOWN = 0.8
"""Likeness of views whose greys tell nothing."""
NOISE = 16.0
"""Variance of greys, in levels of 255, up to which their likeness counts half."""
FEW = 50
"""So does that of this many cells."""


@numba.njit(cache=True, nogil=True)
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
    block = ROWS // is_matched.shape[1] if len(pairs) else 1
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        fx, fy, cx, cy = cameras[i, 0], cameras[i, 1], cameras[i, 2], cameras[i, 3]
        gx, gy, hx, hy = cameras[j, 0], cameras[j, 1], cameras[j, 2], cameras[j, 3]
        r, t = a_from_b[k, :3, :3], a_from_b[k, :3, 3]
        n, sum_a, sum_b, sum_aa, sum_bb, sum_ab = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for row in range(ROWS):
            for column in range(COLUMNS):
                z = depth_m[i, row, column]
                if not z > 0:
                    continue
                # The cell's point in the first camera, less t; R^T takes it into the second.
                x, y = (column - cx) / fx * z, (row - cy) / fy * z
                dx, dy, dz = x - t[0], y - t[1], z - t[2]
                there = r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz
                if not there > 0.2:
                    continue
                u = gx * (r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz) / there + hx
                v = gy * (r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz) / there + hy
                if not (-0.5 <= u < COLUMNS - 0.5 and -0.5 <= v < ROWS - 0.5):
                    continue
                column_b, row_b = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
                nearest, farthest = _range(depth_m[j], row_b, column_b)
                if not nearest > 0:
                    continue
                lever = np.sqrt(
                    (x - middle_a[k, 0]) ** 2
                    + (y - middle_a[k, 1]) ** 2
                    + (z - middle_a[k, 2]) ** 2
                )
                allowed = tolerance[0] + tolerance[1] * max(z, there)
                allowed += tolerance[2] * sigma_rotation[k] * lever
                if there > farthest + allowed:
                    continue  # hidden by a nearer surface: says nothing
                if there < nearest - allowed:
                    result[k, 1] += 1
                    continue
                result[k, 0] += 1
                if is_matched[k, row // block, column // block]:
                    continue
                a, b = float(grey[i, row, column]), float(grey[j, row_b, column_b])
                n += 1
                sum_a, sum_b, sum_ab = sum_a + a, sum_b + b, sum_ab + a * b
                sum_aa, sum_bb = sum_aa + a * a, sum_bb + b * b
        mean_a, mean_b = sum_a / max(n, 1), sum_b / max(n, 1)
        contrast = np.sqrt(
            max(sum_aa / max(n, 1) - mean_a**2, 0.0) * max(sum_bb / max(n, 1) - mean_b**2, 0.0)
        )
        alike = sum_ab / max(n, 1) - mean_a * mean_b
        # Blank walls, and few cells, tell nothing either way.
        likeness = (alike + UNKNOWN * NOISE) / (contrast + NOISE)
        result[k, 2] = (n * likeness + FEW * UNKNOWN) / (n + FEW)
    return result


@numba.njit(cache=True, nogil=True)
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
