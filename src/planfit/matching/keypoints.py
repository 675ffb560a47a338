"""Keypoints with depth: SIFT on the image, lifted to 3D where the depth can be trusted."""

from dataclasses import dataclass

import cv2
import numpy as np

from planfit.errors import require_positive
from planfit.geometry.camera import Camera


@dataclass(frozen=True)
class KeypointOptions:
    """Which keypoints are kept."""

    max_per_frame: int = 1500
    """Strongest keypoints kept a frame; more cost matching time as their square."""
    contrast_threshold: float = 0.02
    """SIFT's contrast threshold; half of OpenCV's default, because walls and floors are faint."""
    max_depth_m: float = 15.0
    """Keypoints further away are dropped: depth noise there says little about the pose."""
    edge_step: float = 0.04
    """Depth may change by this share of itself within 2 px of a keypoint; more is a depth edge, where
    the reading may belong to either side."""

    def __post_init__(self) -> None:
        require_positive(self, "max_per_frame", "contrast_threshold", "max_depth_m", "edge_step")


@dataclass(frozen=True)
class Keypoints:
    """Keypoints of one frame that have a depth."""

    uv: np.ndarray  # (k, 2) float32 px, sub-pixel
    points_cam: np.ndarray  # (k, 3) float32 m
    descriptors: np.ndarray  # (k, 128) uint8, RootSIFT scaled by 512

    def __len__(self) -> int:
        return len(self.uv)


def detect(
    color: np.ndarray, depth: np.ndarray, camera: Camera, options: KeypointOptions
) -> Keypoints:
    """SIFT keypoints (Lowe 2004) of a colour image (h, w, 3) with depth (h, w) m.

    Descriptors are RootSIFT (Arandjelovic and Zisserman 2012): their Euclidean distance is the
    Hellinger distance of the SIFT histograms.
    """
    sift = cv2.SIFT.create(
        nfeatures=options.max_per_frame, contrastThreshold=options.contrast_threshold
    )
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    found, raw = sift.detectAndCompute(grey, np.array([]))
    if not found:
        return Keypoints(
            np.zeros((0, 2), np.float32), np.zeros((0, 3), np.float32), np.zeros((0, 128), np.uint8)
        )
    uv = np.array([k.pt for k in found], dtype=np.float32)
    depth_at = sample_depth(depth, uv, options.edge_step)
    keep = np.isfinite(depth_at) & (depth_at < options.max_depth_m)
    # A keypoint with several orientations is listed once for each; the same uv twice is no new evidence
    # for the pose, but a match may need either descriptor, so all stay here.
    normalised = raw[keep] / np.maximum(raw[keep].sum(axis=1, keepdims=True), 1e-6)
    descriptors = np.minimum(np.sqrt(normalised) * 512.0, 255.0).astype(np.uint8)
    points_cam = camera.lift(uv[keep], depth_at[keep]).astype(np.float32)
    return Keypoints(uv[keep], points_cam, descriptors)


def sample_depth(depth: np.ndarray, uv: np.ndarray, edge_step: float) -> np.ndarray:
    """Depth (k,) m at sub-pixel uv (k, 2), bilinear; NaN off the image, at holes and at depth edges."""
    height, width = depth.shape
    u, v = uv[:, 0], uv[:, 1]
    inside = (u >= 2) & (v >= 2) & (u < width - 3) & (v < height - 3)
    column, row = np.floor(u[inside]).astype(int), np.floor(v[inside]).astype(int)
    # The 6x6 patch reaches 2 px beyond the four pixels that are interpolated.
    offsets = np.arange(-2, 4)
    patch = depth[row[:, None, None] + offsets[:, None], column[:, None, None] + offsets[None, :]]
    low, high = patch.min(axis=(1, 2)), patch.max(axis=(1, 2))  # NaN if any reading is missing
    # A plane seen at a slant changes steadily; the tolerance is on top of nothing, so it bounds the
    # slant too: 4 % over 6 px is 70 degrees off the axis at a focal length of 500 px.
    smooth = (high - low) <= edge_step * low
    fu, fv = u[inside] - column, v[inside] - row
    corner = patch[:, 2:4, 2:4]
    value = (
        corner[:, 0, 0] * (1 - fu) * (1 - fv)
        + corner[:, 0, 1] * fu * (1 - fv)
        + corner[:, 1, 0] * (1 - fu) * fv
        + corner[:, 1, 1] * fu * fv
    )
    result = np.full(len(uv), np.nan)
    result[inside] = np.where(smooth, value, np.nan)
    return result
