"""One frame as points and normals turned upright, at a working size: what the geometry back end looks at."""

from dataclasses import dataclass

import cv2
import numpy as np

from planfit.geometry.camera import Camera
from planfit.segmentation.normals import depth_normals

WORKING_WIDTH_PX = 320
"""Images are thinned to about this width: labels of twice as many pixels were no better, at four times the
time."""
FAR_M = 2.5
"""Beyond, normals are taken over twice the window: the noise of depth grows with its square."""


@dataclass(frozen=True)
class Surfaces:
    """Points and normals (h', w', 3) of a thinned depth image, z up, seen from the origin; NaN: none."""

    points: np.ndarray  # float32 m
    normals: np.ndarray  # float32 unit, towards the camera
    depth: np.ndarray  # (h', w') float32 m along the optical axis
    step_px: int
    """One pixel of the depth image in this many, each way, was kept."""


def find_surfaces(
    depth: np.ndarray,
    camera: Camera,
    upright_from_cam: np.ndarray,
    radius_px: int,
    width_px: int = WORKING_WIDTH_PX,
) -> Surfaces:
    """Points and normals of a depth image (h, w) m, turned upright by `upright_from_cam` (4, 4).

    Args:
        depth: m, NaN where there is no reading.
        camera: of the depth image.
        upright_from_cam: turns it upright.
        radius_px: half the baseline of a normal, in pixels of an image 320 px wide.
        width_px: about as many points are kept of a row; normals are as at the working size.

    Raises:
        OptionError: the window does not fit the image.
    """
    step = max(1, round(depth.shape[1] / WORKING_WIDTH_PX))
    thin = depth[step // 2 :: step, step // 2 :: step]
    x = ((np.arange(step // 2, depth.shape[1], step) - camera.cx) / camera.fx).astype(np.float32)
    y = ((np.arange(step // 2, depth.shape[0], step) - camera.cy) / camera.fy).astype(np.float32)
    points = np.stack([x[None, :] * thin, y[:, None] * thin, thin], axis=-1)
    keep = max(1, thin.shape[1] // width_px)
    near = depth_normals(points, radius_px, keep, keep // 2)
    far = depth_normals(points, min(2 * radius_px, min(thin.shape) // 4), keep, keep // 2)
    kept = (slice(keep // 2, None, keep),) * 2
    with np.errstate(invalid="ignore"):
        is_far = (thin[kept] > FAR_M) & np.isfinite(far[..., 2])
    np.copyto(near, far, where=is_far[..., None])
    # OpenCV's product: NumPy's takes five times as long for matrices this narrow.
    turn = upright_from_cam[:3, :3].astype(np.float32)
    points_upright = cv2.transform(np.ascontiguousarray(points[kept]), turn)
    return Surfaces(points_upright, cv2.transform(near, turn), thin[kept], step * keep)
