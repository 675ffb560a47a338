"""Normals of a depth image's surfaces.

Numba compiles types that nothing can wrap: shapes of compiled loops are in their docstrings.
"""

import cv2
import numpy as np
from jaxtyping import Float, Float32

from planfit.compiled import kernel
from planfit.errors import OptionError


def depth_normals(
    points: Float[np.ndarray, "h w 3"], radius_px: int, step_px: int = 1, first_px: int = 0
) -> Float32[np.ndarray, "h2 w2 3"]:
    """Unit normals of lifted depth, towards the camera, at every `step_px`-th pixel each way.

    Returns the shape of `points[first_px::step_px, first_px::step_px]`; NaN where unsure. Central
    differences over `radius_px` of box-smoothed points: the noise of a normal falls with the baseline. A
    window that is mostly hole, or over a border, gives NaN.

    Raises:
        OptionError: the window does not fit the image.
    """
    if 4 * radius_px > min(points.shape[:2]):
        raise OptionError(
            f"normal_radius_px: expected at most a quarter of the image "
            f"({min(points.shape[:2])} px), found {radius_px}"
        )
    # Holes are left out of sum and count: OpenCV's running sums would carry one NaN across the image.
    # A mean of points of a plane is on that plane, whichever of them are missing.
    total = cv2.blur(measured_points(points), (radius_px, radius_px))
    return window_normals(points, total, radius_px, step_px, first_px)


@kernel
def measured_points(points: np.ndarray) -> np.ndarray:
    """Points (h, w, 3) with a one beside each, (h, w, 4) float32; zeros where none was measured."""
    h, w = points.shape[:2]
    measured = np.zeros((h, w, 4), dtype=np.float32)
    for r in range(h):
        for c in range(w):
            if np.isfinite(points[r, c, 2]):
                for k in range(3):
                    measured[r, c, k] = points[r, c, k]
                measured[r, c, 3] = 1.0
    return measured


@kernel
def window_normals(
    points: np.ndarray, total: np.ndarray, radius: int, step: int, first: int
) -> np.ndarray:
    """Unit normals (h', w', 3) float32, towards the camera, from window means `total` (h, w, 4).

    Those of `measured_points`: three means of coordinates, and the share of the window that was measured,
    which they are divided by. It must be half or more. The normal is the cross product of the differences
    between windows `radius` to the left and right, above and below.
    """
    h, w = points.shape[:2]
    rows, columns = range(first, h, step), range(first, w, step)
    normals = np.full((len(rows), len(columns), 3), np.float32(np.nan))
    half = np.float32(0.5)
    for i, r in enumerate(rows):
        if r < radius or r >= h - radius:
            continue
        for j, c in enumerate(columns):
            if c < radius or c >= w - radius:
                continue
            left, right = total[r, c - radius], total[r, c + radius]
            above, below = total[r - radius, c], total[r + radius, c]
            if not (left[3] >= half and right[3] >= half and above[3] >= half and below[3] >= half):
                continue
            ax = right[0] / right[3] - left[0] / left[3]
            ay = right[1] / right[3] - left[1] / left[3]
            az = right[2] / right[3] - left[2] / left[3]
            dx = below[0] / below[3] - above[0] / above[3]
            dy = below[1] / below[3] - above[1] / above[3]
            dz = below[2] / below[3] - above[2] / above[3]
            nx, ny, nz = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            if not length > 0:
                continue
            p = points[r, c]
            if nx * p[0] + ny * p[1] + nz * p[2] > 0:
                length = -length
            normals[i, j, 0], normals[i, j, 1], normals[i, j, 2] = (
                nx / length,
                ny / length,
                nz / length,
            )
    return normals
