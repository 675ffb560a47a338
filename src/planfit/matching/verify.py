"""Which matches between two frames agree with one rigid motion, by their depths."""

from dataclasses import dataclass

import numpy as np

from planfit.errors import require_positive, require_share
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.matching.verify_kernels import agreeing, best_motion, rigid_triples


@dataclass(frozen=True)
class VerifyOptions:
    """When matches are believed."""

    sigma_base_m: float = 0.02
    """Spread of a lifted keypoint at no distance, each axis."""
    sigma_per_m: float = 0.01
    """Growth of that spread with depth."""
    max_sigmas: float = 3.0
    """Distance between two lifted keypoints, in spreads, up to which they are one point."""
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
    """Matches of one pair that agree, and the motion they agree on."""

    a_from_b: np.ndarray  # (4, 4)
    is_inlier: np.ndarray  # (m,) bool


def point_sigma(depth: np.ndarray, options: VerifyOptions) -> np.ndarray:
    """Spread of a lifted keypoint (m), each axis, at a depth (m)."""
    return options.sigma_base_m + options.sigma_per_m * depth


def verify(
    points_a: np.ndarray,
    points_b: np.ndarray,
    uv_a: np.ndarray,
    uv_b: np.ndarray,
    camera_a: Camera,
    camera_b: Camera,
    options: VerifyOptions,
    rng: np.random.Generator,
) -> RelativePose | None:
    """RANSAC (Fischler and Bolles 1981) over rigid motions from triples of lifted matches.

    Args:
        points_a, points_b: (m, 3) m, camera frames.
        uv_a, uv_b: (m, 2) px.

    Returns None where too few agree.
    """
    m = len(points_a)
    if m < max(options.min_inliers, 3):
        return None
    tolerance = options.max_sigmas * np.hypot(
        point_sigma(points_a[:, 2], options), point_sigma(points_b[:, 2], options)
    )
    # Most wrong triples fall before any fit; four times the rounds are drawn for that reason.
    drawn = rng.integers(m, size=(4 * options.rounds, 3))
    triples = drawn[rigid_triples(drawn, points_a, points_b, tolerance, options.rounds)]
    if len(triples) == 0:
        return None
    candidates = _fit_triples(points_a[triples], points_b[triples])
    a_from_b = candidates[best_motion(candidates, points_a, points_b, tolerance)]
    cameras = np.array([[c.fx, c.fy, c.cx, c.cy] for c in (camera_a, camera_b)])
    is_inlier = np.zeros(m, dtype=bool)
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


def _fit_triples(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Rigid a_from_b (r, 4, 4) of triples (r, 3, 3), all at once (Kabsch)."""
    mean_a, mean_b = a.mean(axis=1), b.mean(axis=1)
    covariance = np.swapaxes(a - mean_a[:, None], 1, 2) @ (b - mean_b[:, None])
    rotation = se3.project_to_so3(covariance)
    return se3.make_transform(rotation, mean_a - (rotation @ mean_b[..., None])[..., 0])
