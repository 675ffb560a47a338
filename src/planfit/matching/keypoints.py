"""Keypoints with depth: found in the image, lifted to 3D where the depth can be trusted."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from planfit.errors import require_choice, require_positive
from planfit.geometry.camera import Camera
from planfit.matching.detectors import Detections, Detector, orb, sift


@dataclass(frozen=True)
class KeypointOptions:
    """Which keypoints are kept."""

    kind: Literal["sift", "orb", "superpoint"] = "sift"
    """SIFT; ORB, which is faster and finds less; SuperPoint as in the paper, which is learned
    (`planfit[learned]`; its own weights may not be used commercially)."""
    max_per_frame: int = 1500
    """Strongest keypoints kept a frame; more cost matching time as their square."""
    contrast_threshold: float = 0.02
    """SIFT's contrast threshold; half of OpenCV's default, because walls and floors are faint."""
    max_depth_m: float = 15.0
    """Keypoints further away are dropped: depth noise there says little about the pose."""
    edge_step: float = 0.04
    """Depth may change by this share of itself within 2 px of a keypoint; more is a depth edge, where
    the reading may belong to either side."""
    weights: str = "magic-leap-community/superpoint"
    """Hub name or folder of SuperPoint's weights."""
    device: str = "cpu"
    """Where SuperPoint runs: `cpu`, `cuda`, `cuda:1` and so on; `auto` takes a GPU where there is one."""

    def __post_init__(self) -> None:
        require_choice(self, "kind", "sift", "orb", "superpoint")
        require_positive(self, "max_per_frame", "contrast_threshold", "max_depth_m", "edge_step")


@dataclass(frozen=True)
class Keypoints:
    """Keypoints of one frame that have a depth."""

    uv: np.ndarray  # (k, 2) float32 px, sub-pixel
    points_cam: np.ndarray  # (k, 3) float32 m
    scores: np.ndarray  # (k,) float32, how strong each is
    descriptors: np.ndarray  # (k, d), compared by Euclidean distance
    sharpness: np.ndarray | np.float32  # () float32, of the image

    def __len__(self) -> int:
        return len(self.uv)


def make_detector(options: KeypointOptions) -> Detector:
    """The detector that the options ask for.

    Raises:
        OptionError: its library or weights cannot be had.
    """
    if options.kind == "sift":
        return sift(options.max_per_frame, options.contrast_threshold)
    if options.kind == "orb":
        return orb(options.max_per_frame)
    from planfit.matching.learned import superpoint  # torch is loaded only where it is asked for

    return superpoint(options.weights, options.device, options.max_per_frame)


def detect(
    color: np.ndarray,
    depth: np.ndarray,
    camera: Camera,
    options: KeypointOptions,
    detector: Detector | None = None,
) -> Keypoints:
    """Keypoints of a colour image (h, w, 3) with depth (h, w) m; `detector` saves making one a frame."""
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    useful = may_have_depth(depth, options.edge_step)
    found = (detector or make_detector(options))(grey, useful)
    return lift(color, depth, camera, options, found)[0]


def lift(
    color: np.ndarray,
    depth: np.ndarray,
    camera: Camera,
    options: KeypointOptions,
    found: Detections,
) -> tuple[Keypoints, np.ndarray]:
    """Those detections whose depth can be trusted, and their indices (k,)."""
    depth_at = sample_depth(depth, found.uv, options.edge_step)
    # A keypoint with several orientations is listed once for each; the same uv twice is no new evidence
    # for the pose, but a match may need either descriptor, so all stay here.
    kept = np.flatnonzero(np.isfinite(depth_at) & (depth_at < options.max_depth_m))
    points_cam = camera.lift(found.uv[kept], depth_at[kept]).astype(np.float32)
    keypoints = Keypoints(
        found.uv[kept],
        points_cam,
        found.scores[kept],
        found.descriptors[kept],
        sharpness(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)),
    )
    return keypoints, kept


def sharpness(grey: np.ndarray) -> np.float32:
    """How sharp an image (h, w) uint8 is, () float32: spread of its Laplacian over that of its grey.

    Dividing makes a dark frame of a scene no less sharp than a bright one.
    """
    # At half size: noise of single pixels, and the blocks of JPEG, are no sharpness.
    half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    edges = cv2.Laplacian(half, cv2.CV_32F)
    return np.float32(edges.std() / max(float(half.std()), 1.0))


def may_have_depth(depth: np.ndarray, edge_step: float) -> np.ndarray:
    """Where (h, w) uint8 keypoints may have a depth: 0 where `sample_depth` gives NaN all about.

    The 5x5 pixels about the nearest one are part of the 6x6 that it looks at.
    """
    filled = np.where(np.isfinite(depth), depth, np.float32(0.0))
    window = np.ones((5, 5), np.uint8)
    low, high = cv2.erode(filled, window), cv2.dilate(filled, window)
    return ((low > 0) & (high - low <= edge_step * low)).astype(np.uint8)


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
