"""Reprojection error (paper, Sec. V-B, ablation): keypoints, lifted, are seen where they matched.

Both ways: the first camera's point in the second image, and the second's in the first. The keypoint
itself is not stored: a match was lifted along its own pixel's ray, so projecting it by its own camera
gives that pixel back exactly, and the principal point drops out of the difference.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.terms.match_kernels import reproject, sum_reprojections
from planfit.adjust.terms.observation_models import ObservationModel
from planfit.geometry.camera import Camera
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks, blocks_of_relative_poses, relative_poses
from planfit.lsq.robust import loss_value
from planfit.matching import Matches

MIN_DEPTH_M = 0.1
"""A point nearer to the other image's plane, or behind it, has no weight until weights are renewed:
its projection is meaningless. It costs as much as one that is off by the image's diagonal, so that
nothing is gained by turning away."""


@dataclass(frozen=True)
class ReprojectedMatches:
    """Matches both ways: the second camera of each pair lifts, the first one sees."""

    pairs: Int[np.ndarray, "k 2"]
    """Frames."""
    start: Int[np.ndarray, " k_and_one"]
    """Matches of pair k are start[k]:start[k + 1]."""
    points_first: Float[np.ndarray, "m 3"]
    """Metres, camera frame of the one that sees; gives the pixel."""
    points_second: Float[np.ndarray, "m 3"]
    """Metres, camera frame of the one that lifts."""
    focals: Float[np.ndarray, "k 2"]
    """Pixels, fx and fy of the one that sees."""
    diagonals: Float[np.ndarray, " k"]
    """Pixels, of the one that sees."""
    min_depth_m: float

    def squared(
        self, target_from_cams: Poses
    ) -> tuple[Float[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
        """Squared errors (px^2), and which points lie before the camera.

        For the others the depth is taken as the least one, so that no step gains by bringing a point
        behind a camera.
        """
        squared = np.zeros(len(self.points_first))
        is_on = np.zeros(len(squared), dtype=bool)
        reproject(*self._arguments(target_from_cams), squared, is_on)
        return squared, is_on

    def normal_blocks(
        self, weight: Float[np.ndarray, " m"], target_from_cams: Poses
    ) -> NormalBlocks:
        """Gauss-Newton blocks of errors with weights (1/px^2)."""
        k = len(self.pairs)
        hessians, gradients = np.zeros((k, 6, 6)), np.zeros((k, 6))
        sum_reprojections(*self._arguments(target_from_cams), weight, hessians, gradients)
        return blocks_of_relative_poses(self.pairs, hessians, gradients, target_from_cams)

    def _arguments(
        self, target_from_cams: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
        relative = relative_poses(target_from_cams, self.pairs)
        points = (self.points_second, self.points_first)
        return (*points, self.start, relative, self.focals, float(self.min_depth_m))


@dataclass(frozen=True)
class ReprojectionTerm:
    """Sum over matches, both ways, of rho(|project(T_i^-1 T_j p') - uv| / sigma) / 2."""

    matches: Matches
    cameras: tuple[Camera, ...]
    """Camera of each frame, the one that its matches were lifted with."""
    model: ObservationModel
    name: str = "reprojection"

    @cached_property
    def reprojected(self) -> ReprojectedMatches:
        """The matches, each way."""
        m = self.matches
        pairs = np.concatenate([m.pairs, m.pairs[:, ::-1]])
        seeing = [self.cameras[i] for i in pairs[:, 0]]
        focals = [(camera.fx, camera.fy) for camera in seeing]
        diagonals = [np.hypot(camera.width, camera.height) for camera in seeing]
        return ReprojectedMatches(
            pairs,
            np.concatenate([m.start, m.start[-1] + m.start[1:]]),
            np.concatenate([m.points_a, m.points_b]).astype(float),
            np.concatenate([m.points_b, m.points_a]).astype(float),
            np.array(focals, dtype=float).reshape(-1, 2),
            np.array(diagonals, dtype=float),
            MIN_DEPTH_M,
        )

    def with_wider_loss(self, factor: float) -> "ReprojectionTerm":
        """The same term with the scale of its loss times `factor`, for graduated non-convexity."""
        return replace(self, model=self.model.widened(factor))

    def reweight(self, target_from_cams: Poses) -> tuple["ReprojectionQuadratic", float]:
        """Weights of the reprojected matches at poses; those behind the camera have none."""
        model, reprojected = self.model, self.reprojected
        squared, is_on = reprojected.squared(target_from_cams)
        counts = np.diff(reprojected.start)
        squared = np.where(is_on, squared, np.repeat(reprojected.diagonals**2, counts))
        rho, weight = loss_value(squared / model.sigma**2, model.loss)
        observations = model.weight_per_point(counts)
        information = np.repeat(0.5 * model.weight * observations, counts)
        quadratic = ReprojectionQuadratic(
            reprojected, information * weight * is_on / model.sigma**2
        )
        return quadratic, 0.5 * float(information @ rho)


@dataclass(frozen=True)
class ReprojectionQuadratic:
    """Reprojection error with frozen weights."""

    reprojected: ReprojectedMatches
    weight: Float[np.ndarray, " m"]
    """1/px^2."""

    def cost(self, target_from_cams: Poses) -> float:
        """Half the weighted sum of squares."""
        return 0.5 * float(self.weight @ self.reprojected.squared(target_from_cams)[0])

    def normal_blocks(self, target_from_cams: Poses) -> NormalBlocks:
        """Gauss-Newton blocks of the errors."""
        return self.reprojected.normal_blocks(self.weight, target_from_cams)
