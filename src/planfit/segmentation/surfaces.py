"""Surfaces of a depth image: edges, and a frame turned upright at a working size."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from planfit.geometry.camera import Camera
from planfit.geometry.depth_normals import depth_normals

_WORKING_WIDTH_PX = 320
"""Images are thinned to about this width: labels of twice as many pixels were no better, at four times the
time."""
FAR_M = 2.5
"""Beyond, normals are taken over twice the window: the noise of depth grows with its square."""


@dataclass(frozen=True)
class Surfaces:
    """Points and normals of a thinned depth image, z up, seen from the origin; NaN where there is none."""

    points: Float32[np.ndarray, "h w 3"]
    """m."""
    normals: Float32[np.ndarray, "h w 3"]
    """Unit, towards the camera."""
    depth: Float[np.ndarray, "h w"]
    """m along the optical axis."""
    step_px: int
    """One pixel of the depth image in this many, each way, was kept."""


def find_surfaces(
    depth: Float[np.ndarray, "h w"],
    camera: Camera,
    upright_from_cam: Float[np.ndarray, "4 4"],
    radius_px: int,
    width_px: int = _WORKING_WIDTH_PX,
) -> Surfaces:
    """Points and normals of a depth image, turned upright by `upright_from_cam`.

    Args:
        depth: m, NaN where none was measured.
        camera: of the depth image.
        upright_from_cam: its rotation is used.
        radius_px: half the baseline of a normal, in pixels of an image 320 px wide.
        width_px: about as many points are kept of a row; normals are as at the working size.

    Raises:
        OptionError: the window does not fit the image.
    """
    # Every step-th pixel, from the middle of the first step on, so that the rest lies evenly at both ends.
    step = max(1, round(depth.shape[1] / _WORKING_WIDTH_PX))
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
    rotation = upright_from_cam[:3, :3].astype(np.float32)
    points_upright = cv2.transform(np.ascontiguousarray(points[kept]), rotation)
    return Surfaces(points_upright, cv2.transform(near, rotation), thin[kept], step * keep)


def depth_edges(
    depth: Float[np.ndarray, "h w"], step_share: float, step_m: float = 0.03
) -> Bool[np.ndarray, "h w"]:
    """Pixels within 2 px of a jump of depth (m), or of a hole.

    A jump is more than `step_share` of the depth plus `step_m`.
    """
    filled = np.nan_to_num(depth, nan=1e3)  # a hole is a jump to a kilometre
    window = np.ones((5, 5), np.uint8)
    depth_range = cv2.dilate(filled, window) - cv2.erode(filled, window)  # maximum less minimum
    return depth_range > step_share * filled + step_m
