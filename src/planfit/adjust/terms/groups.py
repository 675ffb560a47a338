"""What terms over points hand to the engine: groups of points on planes, matched points of pairs.

A term says here what its points belong to and what each is worth; sums of them (`planfit.lsq.moments`) and
derivatives by the sensor's parameters (`planfit.adjust.calibration`) both start from it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.lsq.moments import PairMoments, PlaneMoments, pair_moments, plane_moments
from planfit.lsq.robust import Loss
from planfit.lsq.torch.moments import (
    GroupedPoints,
    TorchPairMoments,
    TorchPlaneMoments,
    pair_moments_on,
    plane_moments_on,
)


@dataclass(frozen=True)
class PlaneGroups:
    """Groups of points that belong on fixed planes."""

    points_cam: Float[np.ndarray, "m 3"]
    """m; group k is points start[k]:start[k + 1]."""
    start: Int[np.ndarray, " l"]
    """(k + 1,)."""
    pose_idx: Int[np.ndarray, " k"]
    """Camera of each group."""
    planes: Float[np.ndarray, "k 4"]
    """Of each group: (normal, -offset), target frame."""
    weight_per_point: Float[np.ndarray, " k"]
    """Factor on the robust cost of each point of a group."""
    sigma_m: float
    """Standard deviation of a point about its plane."""
    loss: Loss
    """Robust loss of distance / sigma."""

    def moments(
        self, target_from_cams: Float[np.ndarray, "n 4 4"], on: GroupedPoints | None = None
    ) -> tuple[PlaneMoments | TorchPlaneMoments, float]:
        """One pass over the points, on a device where they are `on` one; see `planfit.lsq.moments`."""
        rest = (self.pose_idx, self.planes, self.weight_per_point, target_from_cams)
        scale = (self.sigma_m, self.loss)
        if on is not None:
            return plane_moments_on(on, *rest, *scale)
        return plane_moments(self.points_cam, self.start, *rest, *scale)


@dataclass(frozen=True)
class PairGroups:
    """Matched points of pairs of cameras."""

    points_a: Float[np.ndarray, "m 3"]
    """m, camera frame; pair k is start[k]:start[k + 1]."""
    points_b: Float[np.ndarray, "m 3"]
    """m, camera frame."""
    sigma_m: Float[np.ndarray, " m"]
    """Standard deviation of their difference, each axis."""
    start: Int[np.ndarray, " l"]
    """(k + 1,)."""
    pairs: Int[np.ndarray, "k 2"]
    """First and second camera."""
    weight_per_point: Float[np.ndarray, " k"]
    """Factor on the robust cost of each match of a pair."""
    loss: Loss
    """Robust loss of distance / sigma."""

    def moments(
        self, target_from_cams: Float[np.ndarray, "n 4 4"], on: GroupedPoints | None = None
    ) -> tuple[PairMoments | TorchPairMoments, float]:
        """One pass over the matches, on a device where they are `on` one; see `planfit.lsq.moments`."""
        if on is not None:
            rest = (self.pairs, self.weight_per_point, target_from_cams, self.loss)
            return pair_moments_on(on, *rest)
        points = (self.points_a, self.points_b, self.sigma_m, self.start, self.pairs)
        return pair_moments(*points, self.weight_per_point, target_from_cams, self.loss)
