"""Normals of a depth image."""

import cv2
import numpy as np

from planfit.errors import OptionError


def depth_normals(points: np.ndarray, radius_px: int, step_px: int = 1) -> np.ndarray:
    """Unit normals of lifted depth (h, w, 3) at every `step_px`-th pixel each way, towards the camera.

    Returns (h', w', 3), the shape of `points[::step_px, ::step_px]`; NaN where unsure. Central
    differences over `radius_px` of box-smoothed points: the noise of a normal falls with the baseline.
    A window that is mostly hole, or over a border, gives NaN.

    Raises:
        OptionError: the window does not fit the image.
    """
    if 4 * radius_px > min(points.shape[:2]):
        raise OptionError(
            f"normal_radius_px: expected at most a quarter of the image "
            f"({min(points.shape[:2])} px), found {radius_px}"
        )
    smooth = _smoothed(points, radius_px)
    height, width = points.shape[:2]
    rows, columns = np.arange(0, height, step_px), np.arange(0, width, step_px)
    r = radius_px
    left, right = smooth[::step_px][:, columns - r], smooth[::step_px][:, (columns + r) % width]
    above, below = smooth[rows - r][:, ::step_px], smooth[(rows + r) % height][:, ::step_px]
    across, down = right - left, below - above
    normal = _cross(down, across)
    # einsum: sums of NumPy over an axis of three are five times as slow.
    length = np.sqrt(np.einsum("ijk,ijk->ij", normal, normal))
    facing = np.einsum("ijk,ijk->ij", normal, points[::step_px, ::step_px])
    scale = np.where(facing > 0, -1.0, 1.0) / np.where(length > 0, length, np.nan)
    normal *= scale.astype(np.float32)[..., None]
    normal[(rows < r) | (rows >= height - r)] = np.nan
    normal[:, (columns < r) | (columns >= width - r)] = np.nan
    return normal


def _smoothed(points: np.ndarray, size_px: int) -> np.ndarray:
    """Mean of the readings in a window around each pixel; NaN where fewer than half are readings.

    Holes are left out of sum and count: OpenCV's running sums would carry one NaN across the image.
    A mean of points of a plane is on that plane, whichever of them are missing.
    """
    is_reading = np.isfinite(points[..., 2])
    total = cv2.blur(
        np.where(is_reading[..., None], points, 0.0).astype(np.float32), (size_px, size_px)
    )
    share = cv2.blur(is_reading.astype(np.float32), (size_px, size_px))
    return total / np.where(share >= 0.5, share, np.nan)[..., None]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis; three times as fast as `numpy.cross` on images."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def depth_edges(depth: np.ndarray, step_share: float, step_m: float = 0.03) -> np.ndarray:
    """Pixels (h, w) bool within 2 px of a jump of depth, or of a hole.

    A jump is more than `step_share` of the depth plus `step_m`.
    """
    filled = np.nan_to_num(depth, nan=1e3)
    window = np.ones((5, 5), np.uint8)
    spread = cv2.dilate(filled, window) - cv2.erode(filled, window)
    return spread > step_share * filled + step_m
