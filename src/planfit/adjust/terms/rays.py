"""Least distance of viewing rays (paper, Sec. V-B, ablation; Schinstock 2009; Hess-Flores 2011).

The lines through the two camera centres along the rays of a match, a and e (unit vectors), are
|s . n| / |n| apart, with n = a x e and s from one centre to the other. Where the rays are parallel,
n vanishes and the expression has no limit: its value depends on how they got there. We take

    r = s . n / sqrt(|n|^2 + sin(parallel)^2),

the distance times a factor that is 1 for rays which meet at an angle and fades to 0 for parallel ones.
It is zero wherever the rays meet, smooth for all directions, opposite ones included, and |r| never
exceeds the distance. The limit that suggests itself, the distance of one centre to the other ray, would
draw cameras together that truly are a short step apart.

Depth enters only through the ray's direction, so nothing here holds the scale: centres that all
coincide have no distance at all, and along a straight walk each step's length is free. Walls, floor, an
odometry term or pose priors must hold it, the more so where there are wrong matches: these cost
least where the centres meet, and with a tenth of them wrong, rows of free cameras collapsed.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.terms.match_kernels import ray_distances, sum_ray_distances
from planfit.adjust.terms.observation_models import ObservationModel
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks, blocks_of_relative_poses, relative_poses
from planfit.lsq.robust import loss_value
from planfit.matching import Matches

PARALLEL_DEG = 0.3
"""Angle between rays at which half the squared distance counts; well above it all, below it
nothing: directions are known to about a pixel, 0.1 deg."""


@dataclass(frozen=True)
class RayPairs:
    """Viewing rays of matches."""

    pairs: Int[np.ndarray, "k 2"]
    """Frames."""
    start: Int[np.ndarray, " k_and_one"]
    """Matches of pair k are start[k]:start[k + 1]."""
    rays_first: Float[np.ndarray, "m 3"]
    """Unit, camera frame of the first of the pair."""
    rays_second: Float[np.ndarray, "m 3"]
    """Unit, camera frame of the second."""
    parallel_sq: float
    """Squared sine of the angle at which rays begin to count."""

    def distances(self, target_from_cams: Poses) -> Float[np.ndarray, " m"]:
        """Signed, faded distances (m)."""
        distance = np.zeros(len(self.rays_first))
        ray_distances(*self._arguments(target_from_cams), distance)
        return distance

    def normal_blocks(
        self, weight: Float[np.ndarray, " m"], target_from_cams: Poses
    ) -> NormalBlocks:
        """Gauss-Newton blocks of distances with weights (1/m^2)."""
        k = len(self.pairs)
        hessians, gradients = np.zeros((k, 6, 6)), np.zeros((k, 6))
        sum_ray_distances(*self._arguments(target_from_cams), weight, hessians, gradients)
        return blocks_of_relative_poses(self.pairs, hessians, gradients, target_from_cams)

    def _arguments(
        self, target_from_cams: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
        relative = relative_poses(target_from_cams, self.pairs)
        return self.rays_first, self.rays_second, self.start, relative, self.parallel_sq


@dataclass(frozen=True)
class RayTerm:
    """Sum over matches of rho(faded distance of the two rays / sigma)."""

    matches: Matches
    model: ObservationModel
    name: str = "rays"

    @cached_property
    def ray_pairs(self) -> RayPairs:
        """Directions of the matches."""
        m = self.matches
        rays = [_unit(points) for points in (m.points_a, m.points_b)]
        parallel_sq = float(np.sin(np.deg2rad(PARALLEL_DEG)) ** 2)
        return RayPairs(m.pairs, m.start, rays[0], rays[1], parallel_sq)

    def with_wider_loss(self, factor: float) -> "RayTerm":
        """The same term with the scale of its loss times `factor`, for graduated non-convexity."""
        return replace(self, model=self.model.widened(factor))

    def reweight(self, target_from_cams: Poses) -> tuple["RayQuadratic", float]:
        """Weights of the matches at poses."""
        distance, sigma_sq = self.ray_pairs.distances(target_from_cams), self.matches.sigma**2
        rho, weight = loss_value(distance**2 / sigma_sq, self.model.loss)
        counts = np.diff(self.matches.start)
        observations = self.model.weight_per_point(counts)
        information = np.repeat(self.model.weight * observations, counts)
        quadratic = RayQuadratic(self.ray_pairs, information * weight / sigma_sq)
        return quadratic, 0.5 * float(information @ rho)


@dataclass(frozen=True)
class RayQuadratic:
    """Ray distance with frozen weights."""

    ray_pairs: RayPairs
    weight: Float[np.ndarray, " m"]
    """1/m^2."""

    def cost(self, target_from_cams: Poses) -> float:
        """Half the weighted sum of squares."""
        return 0.5 * float(self.weight @ self.ray_pairs.distances(target_from_cams) ** 2)

    def normal_blocks(self, target_from_cams: Poses) -> NormalBlocks:
        """Gauss-Newton blocks of the distances."""
        return self.ray_pairs.normal_blocks(self.weight, target_from_cams)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors (m, 3), float64; a zero vector stays zero and its distance is zero."""
    vectors = np.asarray(vectors, dtype=float)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
