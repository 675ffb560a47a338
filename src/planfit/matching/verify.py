"""Which matches between two frames agree with one rigid motion, by their depths."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.errors import require_positive, require_share
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.matching.verify_kernels import agreeing, best_motion, fit_triples, rigid_triples


@dataclass(frozen=True)
class VerifyOptions:
    """When matches of a pair are accepted."""

    sigma_base_m: float = 0.02
    """Standard deviation of a lifted keypoint at no distance, each axis."""
    sigma_per_m: float = 0.01
    """Growth of that sigma with depth."""
    max_sigmas: float = 3.0
    """Distance between two lifted keypoints, in sigmas, up to which they are one point."""
    max_reprojection_px: float = 4.0
    """Distance in either image up to which they are one point."""
    min_inliers: int = 15
    """Matches that must agree; fewer do so by chance among look-alike textures."""
    min_inlier_ratio: float = 0.2
    """Share of the tentative matches that must agree."""
    rounds: int = 300
    """Random triples tried."""

    def __post_init__(self) -> None:
        require_positive(self, "max_sigmas", "max_reprojection_px", "rounds")
        require_share(self, "min_inlier_ratio")


@dataclass(frozen=True)
class RelativePose:
    """The motion between two frames that matches agree on, and which of them do."""

    a_from_b: Float[np.ndarray, "4 4"]
    is_inlier: Bool[np.ndarray, " m"]


def point_sigma(depth: Float[np.ndarray, " m"], options: VerifyOptions) -> Float[np.ndarray, " m"]:
    """Standard deviation of a lifted keypoint (m), each axis, at a depth (m)."""
    return options.sigma_base_m + options.sigma_per_m * depth


def match_sigma(
    points_a: Float[np.ndarray, "m 3"], points_b: Float[np.ndarray, "m 3"], options: VerifyOptions
) -> Float[np.ndarray, " m"]:
    """Standard deviation (m) of the difference of two lifted keypoints, camera frames, each axis; float64."""
    depth_a, depth_b = (points[:, 2].astype(float) for points in (points_a, points_b))
    return np.hypot(point_sigma(depth_a, options), point_sigma(depth_b, options))


def verify(
    points_a: Float[np.ndarray, "m 3"],
    points_b: Float[np.ndarray, "m 3"],
    uv_a: Float[np.ndarray, "m 2"],
    uv_b: Float[np.ndarray, "m 2"],
    camera_a: Camera,
    camera_b: Camera,
    options: VerifyOptions,
    rng: np.random.Generator,
) -> RelativePose | None:
    """RANSAC (Fischler and Bolles 1981) over rigid motions from triples of lifted matches.

    Args:
        points_a, points_b: m, camera frames.
        uv_a, uv_b: px.
        camera_a, camera_b: of the two frames.
        options: see there.
        rng: draws the triples.

    Returns None where too few agree.
    """
    m = len(points_a)
    if m < max(options.min_inliers, 3):
        return None
    tolerance = options.max_sigmas * match_sigma(points_a, points_b, options)
    # Most wrong triples fall before any fit; four times the rounds are drawn for that reason.
    drawn = rng.integers(m, size=(4 * options.rounds, 3))
    triples = drawn[rigid_triples(drawn, points_a, points_b, tolerance, options.rounds)]
    if len(triples) == 0:
        return None
    candidates = fit_triples(triples, points_a, points_b)
    a_from_b = candidates[best_motion(candidates, points_a, points_b, tolerance)]
    cameras = np.array([[c.fx, c.fy, c.cx, c.cy] for c in (camera_a, camera_b)])
    is_inlier = np.zeros(m, dtype=bool)
    # Fitted to all that agree, the motion is surer than that of its triple, and others come to agree.
    for _ in range(4):
        is_inlier = agreeing(
            a_from_b,
            points_a,
            points_b,
            uv_a,
            uv_b,
            cameras,
            tolerance,
            options.max_reprojection_px,
        )
        if is_inlier.sum() < max(options.min_inliers, options.min_inlier_ratio * m):
            return None
        a_from_b = se3.fit_rigid(
            points_b[is_inlier], points_a[is_inlier], 1.0 / tolerance[is_inlier] ** 2
        )
    return RelativePose(a_from_b, is_inlier)
