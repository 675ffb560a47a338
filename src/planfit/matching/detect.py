"""Keypoints with depth: found in the image (SIFT, ORB), lifted to 3D where the depth can be trusted."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, Real, UInt8

from planfit.errors import require_choice, require_positive
from planfit.geometry.camera import Camera
from planfit.matching.types import Detections, Detector, Keypoints
from planfit.priors import DEPTH_EDGE_SHARE

MIN_REDUCED = 200
"""Keypoints that SIFT must find in a reduced image; with fewer it looks at the whole one."""
EDGE_STEP = DEPTH_EDGE_SHARE.value
"""Depth may change by this share of itself within 2 px of a keypoint; more is a depth edge, where the
measured depth may belong to either side."""


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
    max_side_px: int = 320
    """SIFT looks at larger images reduced to this. At 640 x 480 it takes 0.3 of the time and finds 0.4 of
    the keypoints; the error of a place in the image stays far below that of its depth. Over 41 runs of two
    real scans the mean error is 0.062 m (400 px: 0.066; 240 px: 0.062, two right results more refused)."""
    max_depth_m: float = 15.0
    """Keypoints further away are dropped: depth noise there says little about the pose."""
    weights: str = "magic-leap-community/superpoint"
    """Hub name or folder of SuperPoint's weights."""

    def __post_init__(self) -> None:
        require_choice(self, "kind", "sift", "orb", "superpoint")
        require_positive(self, "max_per_frame", "contrast_threshold", "max_side_px", "max_depth_m")


def make_detector(options: KeypointOptions, device: str = "cpu") -> Detector:
    """The detector that the options ask for; a learned one runs on the device.

    Raises:
        OptionError: its library or weights cannot be had.
    """
    if options.kind == "sift":
        whole = sift(options.max_per_frame, options.contrast_threshold)
        return reduced(whole, options.max_side_px)
    if options.kind == "orb":
        return orb(options.max_per_frame)
    from planfit.matching.learned import superpoint  # torch is loaded only where it is asked for

    return superpoint(options.weights, device, options.max_per_frame)


def sift(max_per_frame: int, contrast_threshold: float) -> Detector:
    """SIFT (Lowe 2004) with RootSIFT descriptors (Arandjelovic and Zisserman 2012).

    The Euclidean distance of RootSIFT is the Hellinger distance of the histograms. Descriptors are
    (k, 128) uint8, scaled by 512.
    """

    def detect(
        grey: UInt8[np.ndarray, "h w"], useful: UInt8[np.ndarray, "h w"] | None
    ) -> Detections:
        # Without the precise upscale every place is off by 0.25 px in u and in v.
        detector = cv2.SIFT.create(
            nfeatures=max_per_frame,
            contrastThreshold=contrast_threshold,
            enable_precise_upscale=True,
        )
        # OpenCV heeds the mask after it has chosen the strongest, before it describes them.
        found, raw = detector.detectAndCompute(grey, np.array([]) if useful is None else useful)
        if not found:
            return _no_detections(128)
        normalised = raw / np.maximum(raw.sum(axis=1, keepdims=True), 1e-6)
        descriptors = np.minimum(np.sqrt(normalised) * 512.0, 255.0).astype(np.uint8)
        return Detections(*_locations(found), descriptors)

    return detect


def reduced(whole: Detector, max_side_px: int) -> Detector:
    """A detector that looks at images reduced to `max_side_px`, at whole ones where it finds too few there.

    Descriptors of both can be matched with each other where the detector's do not depend on scale.
    """

    def detect(
        grey: UInt8[np.ndarray, "h w"], useful: UInt8[np.ndarray, "h w"] | None
    ) -> Detections:
        height, width = grey.shape
        share = max_side_px / max(height, width)
        if share >= 1:
            return whole(grey, useful)
        size = (max(1, round(width * share)), max(1, round(height * share)))
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        useful_small = None
        if useful is not None:
            useful_small = cv2.resize(useful, size, interpolation=cv2.INTER_NEAREST)
        found = whole(small, useful_small)
        if len(found.uv) < MIN_REDUCED:
            return whole(grey, useful)
        # Pixels are numbered by their centres: the corner of the image lies at -0.5 in both.
        scale = np.array([width / size[0], height / size[1]], dtype=np.float32)
        uv = (found.uv + np.float32(0.5)) * scale - np.float32(0.5)
        return Detections(uv, found.scores, found.descriptors)

    return detect


def orb(max_per_frame: int) -> Detector:
    """ORB (Rublee et al. 2011): a quarter of SIFT's time, fewer and less exact matches.

    Descriptors are their bits apart, (k, 256) uint8 of 0 and 1: the squared Euclidean distance is then
    the Hamming distance, and all that follows need not know which kind it is given.
    """

    # With a mask OpenCV's ORB would choose other keypoints; describing them takes little time anyway.
    def detect(grey: UInt8[np.ndarray, "h w"], _: object) -> Detections:
        found, raw = cv2.ORB.create(nfeatures=max_per_frame, fastThreshold=8).detectAndCompute(
            grey, np.array([])
        )
        if not found:
            return _no_detections(256)
        return Detections(*_locations(found), np.unpackbits(raw.astype(np.uint8), axis=1))

    return detect


def detect(
    color: UInt8[np.ndarray, "h w 3"],
    depth: Float[np.ndarray, "h w"],
    camera: Camera,
    options: KeypointOptions,
    detector: Detector | None = None,
) -> Keypoints:
    """Keypoints of a colour image with its depth (m); `detector` saves making one a frame."""
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    useful = may_have_depth(depth)
    found = (detector or make_detector(options))(grey, useful)
    return lift(color, depth, camera, options, found)[0]


def lift(
    color: UInt8[np.ndarray, "h w 3"] | None,
    depth: Float[np.ndarray, "h w"],
    camera: Camera,
    options: KeypointOptions,
    found: Detections,
) -> tuple[Keypoints, Int[np.ndarray, " k"]]:
    """Those detections whose depth can be trusted, and their indices; without colour, sharpness is 0."""
    depth_at = sample_depth(depth, found.uv)
    # A keypoint with several orientations is listed once for each; the same uv twice is no new measurement
    # for the pose, but a match may need either descriptor, so all stay here.
    kept = np.flatnonzero(np.isfinite(depth_at) & (depth_at < options.max_depth_m))
    points_cam = camera.lift(found.uv[kept], depth_at[kept]).astype(np.float32)
    keypoints = Keypoints(
        found.uv[kept],
        points_cam,
        found.scores[kept],
        found.descriptors[kept],
        np.float32(0) if color is None else sharpness(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)),
    )
    return keypoints, kept


def no_keypoints(kind: str) -> Keypoints:
    """Of a frame without colour: none, with descriptors as long as those of `KeypointOptions.kind`."""
    found = _no_detections(128 if kind == "sift" else 256)
    none = np.zeros((0, 3), np.float32)
    return Keypoints(found.uv, none, found.scores, found.descriptors, np.float32(0))


def sharpness(grey: UInt8[np.ndarray, "h w"]) -> np.float32:
    """How sharp an image is: standard deviation of its Laplacian over that of its grey.

    Dividing makes a dark frame of a scene no less sharp than a bright one.
    """
    # At half size: noise of single pixels, and the blocks of JPEG, are no sharpness.
    half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    edges = cv2.Laplacian(half, cv2.CV_32F)
    return np.float32(edges.std() / max(float(half.std()), 1.0))


def may_have_depth(depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Where keypoints may have a depth: 0 where `sample_depth` gives NaN all about.

    The 5x5 pixels about the nearest one are part of the 6x6 that it looks at.
    """
    filled = np.where(np.isfinite(depth), depth, np.float32(0.0))
    window = np.ones((5, 5), np.uint8)
    # Erosion and dilation are the minimum and the maximum over the window.
    low, high = cv2.erode(filled, window), cv2.dilate(filled, window)
    return ((low > 0) & (high - low <= EDGE_STEP * low)).astype(np.uint8)


def sample_depth(
    depth: Float[np.ndarray, "h w"], uv: Real[np.ndarray, "k 2"]
) -> Float[np.ndarray, " k"]:
    """Depth (m) at sub-pixel locations, bilinear; NaN off the image, at holes and at depth edges."""
    height, width = depth.shape
    u, v = uv[:, 0], uv[:, 1]
    inside = (u >= 2) & (v >= 2) & (u < width - 3) & (v < height - 3)
    column, row = np.floor(u[inside]).astype(int), np.floor(v[inside]).astype(int)
    # The 6x6 window reaches 2 px beyond the four pixels that are interpolated; one gather takes (k, 6, 6).
    offsets = np.arange(-2, 4)
    window = depth[row[:, None, None] + offsets[:, None], column[:, None, None] + offsets[None, :]]
    low, high = window.min(axis=(1, 2)), window.max(axis=(1, 2))  # NaN if any is missing
    # A plane seen at a slant changes steadily; the tolerance is on top of nothing, so it bounds the
    # slant too: 4 % over 6 px is 70 degrees off the axis at a focal length of 500 px.
    smooth = (high - low) <= EDGE_STEP * low
    fu, fv = u[inside] - column, v[inside] - row
    corner = window[:, 2:4, 2:4]
    value = (
        corner[:, 0, 0] * (1 - fu) * (1 - fv)
        + corner[:, 0, 1] * fu * (1 - fv)
        + corner[:, 1, 0] * (1 - fu) * fv
        + corner[:, 1, 1] * fu * fv
    )
    result = np.full(len(uv), np.nan)
    result[inside] = np.where(smooth, value, np.nan)
    return result


def without_descriptors(uv: Float32[np.ndarray, "k 2"]) -> Detections:
    """Keypoints (px) that came from elsewhere, with their matches."""
    k = len(uv)
    return Detections(uv, np.ones(k, np.float32), np.zeros((k, 0), np.uint8))


def _locations(
    found: Sequence[cv2.KeyPoint],
) -> tuple[Float32[np.ndarray, "k 2"], Float32[np.ndarray, " k"]]:
    """Where OpenCV's keypoints lie (px), and how strong they are."""
    uv = np.array([k.pt for k in found], dtype=np.float32)
    return uv, np.array([k.response for k in found], dtype=np.float32)


def _no_detections(dims: int) -> Detections:
    return Detections(
        np.zeros((0, 2), np.float32), np.zeros(0, np.float32), np.zeros((0, dims), np.uint8)
    )
