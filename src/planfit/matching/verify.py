"""Which matches between two frames agree with one rigid motion, by their depths."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.matching.verify_kernels import agreeing, best_motion, fit_triples, rigid_triples
from planfit.priors import SURE_SIGMAS

SIGMA_BASE_M = 0.02
"""Standard deviation of a lifted keypoint at no distance, m, each axis."""
SIGMA_PER_M = 0.01
"""Growth of that sigma with depth."""
MAX_SIGMAS = SURE_SIGMAS.value
"""Distance between two lifted keypoints, in sigmas, up to which they are one point."""
MAX_REPROJECTION_PX = 4.0
"""Distance in either image up to which they are one point: 4 px, as in COLMAP."""
MIN_INLIERS = 15
"""Matches that must agree, 15 as in COLMAP; fewer do so by chance among look-alike textures."""
MIN_INLIER_RATIO = 0.2
"""Share of the tentative matches that must agree."""
ROUNDS = 300
"""Random triples tried."""


@dataclass(frozen=True)
class RelativePose:
    """The motion between two frames that matches agree on, and which of them do."""

    a_from_b: Float[np.ndarray, "4 4"]
    is_inlier: Bool[np.ndarray, " m"]


def point_sigma(depth: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Standard deviation of a lifted keypoint (m), each axis, at a depth (m)."""
    return SIGMA_BASE_M + SIGMA_PER_M * depth


def match_sigma(
    points_a: Float[np.ndarray, "m 3"], points_b: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, " m"]:
    """Standard deviation (m) of the difference of two lifted keypoints, camera frames, each axis; float64."""
    depth_a, depth_b = (points[:, 2].astype(float) for points in (points_a, points_b))
    return np.hypot(point_sigma(depth_a), point_sigma(depth_b))


def verify(
    points_a: Float[np.ndarray, "m 3"],
    points_b: Float[np.ndarray, "m 3"],
    uv_a: Float[np.ndarray, "m 2"],
    uv_b: Float[np.ndarray, "m 2"],
    camera_a: Camera,
    camera_b: Camera,
    rng: np.random.Generator,
) -> RelativePose | None:
    """RANSAC (Fischler and Bolles 1981) over rigid motions from triples of lifted matches.

    Args:
        points_a, points_b: m, camera frames.
        uv_a, uv_b: px.
        camera_a, camera_b: of the two frames.
        rng: draws the triples.

    Returns None where too few agree.
    """
    m = len(points_a)
    if m < max(MIN_INLIERS, 3):
        return None
    tolerance = MAX_SIGMAS * match_sigma(points_a, points_b)
    # Most wrong triples fall before any fit; four times the rounds are drawn for that reason.
    drawn = rng.integers(m, size=(4 * ROUNDS, 3))
    triples = drawn[rigid_triples(drawn, points_a, points_b, tolerance, ROUNDS)]
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
            MAX_REPROJECTION_PX,
        )
        if is_inlier.sum() < max(MIN_INLIERS, MIN_INLIER_RATIO * m):
            return None
        a_from_b = se3.fit_rigid(
            points_b[is_inlier], points_a[is_inlier], 1.0 / tolerance[is_inlier] ** 2
        )
    return RelativePose(a_from_b, is_inlier)
