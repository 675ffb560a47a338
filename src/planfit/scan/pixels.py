"""Points that single pixels of a scan show: picked on a page, or marked in a table."""

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.types import Scan

NEAR_PX = 3
"""Depth is the median of the pixels this near, rows and columns: what is picked is set on something flat, and
single pixels are noisy, or have none."""
SAME_SURFACE_SHARE = 0.03
"""Pixels near whose depth differs by more from the nearest one's, as a share, show something else."""


def lift_pixel(scan: Scan, frame_idx: int, uv: tuple[float, float]) -> Float[np.ndarray, "3"]:
    """The point (m, camera frame) that a pixel of a frame shows.

    Raises:
        ScanError: the pixel is outside of the image, or no depth was measured near it.
    """
    camera, (u, v) = scan.cameras[frame_idx], uv
    if not (-0.5 <= u <= camera.width - 0.5 and -0.5 <= v <= camera.height - 0.5):
        raise ScanError(
            f"frame {frame_idx}: expected a pixel within {camera.width} x {camera.height}, found "
            f"({u:g}, {v:g}); u counts columns and v rows, from 0, in the images as planfit reads them, "
            "which may be smaller than as recorded"
        )
    depth_m = depth_at(scan.files.depth(frame_idx), u, v)
    if depth_m is None:
        raise ScanError(
            f"frame {frame_idx}: expected a pixel with depth, found none at ({u:g}, {v:g}) nor within "
            f"{NEAR_PX} px; take another point, or another frame that is nearer or less slanted"
        )
    return camera.lift(np.array([[u, v]], dtype=float), np.array([depth_m]))[0]


def depth_at(depth_m: Float[np.ndarray, "h w"], u: float, v: float) -> float | None:
    """Depth (m) of the surface at a pixel: the median of those near that show the same; None without any."""
    row, column = round(v), round(u)
    top, left = max(row - NEAR_PX, 0), max(column - NEAR_PX, 0)
    window = depth_m[top : row + NEAR_PX + 1, left : column + NEAR_PX + 1].astype(float)
    rows, columns = np.nonzero(np.isfinite(window) & (window > 0))
    if len(rows) == 0:
        return None
    values = window[rows, columns]
    nearest = np.argmin((rows + top - v) ** 2 + (columns + left - u) ** 2)
    same = np.abs(values - values[nearest]) <= SAME_SURFACE_SHARE * values[nearest]
    return float(np.median(values[same]))
