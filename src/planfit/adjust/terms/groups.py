"""What terms over points hand to the engine: groups of points on planes, matched points of pairs.

A term says here what its points belong to and what each is worth; sums of them (`planfit.lsq.moments`) and
derivatives by the sensor's parameters (`planfit.adjust.calibration`) both start from it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import relative_poses
from planfit.lsq.moments import (
    PairMoments,
    PlaneMoments,
    pair_moments,
    plane_moments,
    planes_in_cam,
)
from planfit.lsq.robust import Loss
from planfit.lsq.torch_moments import (
    GroupedPoints,
    pair_moments_on,
    plane_moments_on,
)
from planfit.runtime import let_go

Groups = TypeVar("Groups", "PlaneGroups", "PairGroups")


@dataclass(frozen=True)
class Squares:
    """Of some of the points: all at once would take as much memory as the points, or twice that."""

    part: slice
    """Which."""
    in_sigmas: Float[np.ndarray, " p"]
    """Squared distances, in variances."""
    information: Float[np.ndarray, " p"]
    """Factor on the cost of each, its variance in it."""


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
        self, target_from_cams: Poses, on: GroupedPoints | None = None
    ) -> tuple[PlaneMoments, float]:
        """One pass over the points, on a device where they are `on` one; see `planfit.lsq.moments`."""
        rest = (self.pose_idx, self.planes, self.weight_per_point, target_from_cams)
        scale = (self.sigma_m, self.loss)
        if on is not None:
            return plane_moments_on(on, *rest, *scale)
        return plane_moments(self.points_cam, self.start, *rest, *scale)

    def in_parts(self) -> Iterator[tuple[slice, "PlaneGroups"]]:
        """Some groups at a time, and which."""
        return _in_parts(self, ("points_cam",), ("pose_idx", "planes", "weight_per_point"))

    def squares(self, target_from_cams: Poses) -> Iterator[Squares]:
        """Squared distances of the points from their planes."""
        planes_cam = planes_in_cam(self.planes, target_from_cams[self.pose_idx])
        for part, group in se3.points_in_parts(self.start):
            planes = planes_cam[group]
            points = self.points_cam[part]
            distances_m = np.einsum("mi,mi->m", planes[:, :3], points) + planes[:, 3]
            let_go(points)
            worth = self.weight_per_point[group] / self.sigma_m**2
            yield Squares(part, (distances_m / self.sigma_m) ** 2, worth)


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
        self, target_from_cams: Poses, on: GroupedPoints | None = None
    ) -> tuple[PairMoments, float]:
        """One pass over the matches, on a device where they are `on` one; see `planfit.lsq.moments`."""
        if on is not None:
            rest = (self.pairs, self.weight_per_point, target_from_cams, self.loss)
            return pair_moments_on(on, *rest)
        points = (self.points_a, self.points_b, self.sigma_m, self.start, self.pairs)
        return pair_moments(*points, self.weight_per_point, target_from_cams, self.loss)

    def in_parts(self) -> Iterator[tuple[slice, "PairGroups"]]:
        """Some pairs at a time, and which."""
        by_point = ("points_a", "points_b", "sigma_m")
        return _in_parts(self, by_point, ("pairs", "weight_per_point"))

    def squares(self, target_from_cams: Poses) -> Iterator[Squares]:
        """Squared distances between the points of each match, in the frame of the first camera."""
        a_from_b = relative_poses(target_from_cams, self.pairs)
        for part, pair in se3.points_in_parts(self.start):
            points_a, points_b = self.points_a[part], self.points_b[part]
            apart = points_a - se3.transform_each(a_from_b[pair], points_b)
            let_go(points_a)
            let_go(points_b)
            variance = self.sigma_m[part].astype(float) ** 2
            in_sigmas = np.sum(apart**2, axis=1) / variance
            yield Squares(part, in_sigmas, self.weight_per_point[pair] / variance)


def _in_parts(
    groups: Groups, by_point: tuple[str, ...], by_group: tuple[str, ...]
) -> Iterator[tuple[slice, Groups]]:
    """Some groups at a time, and which; fields that have a row a point, and those that have one a group."""
    for of in se3.groups_in_parts(groups.start):
        first, last = groups.start[of.start], groups.start[of.stop]
        cut = {name: getattr(groups, name)[first:last] for name in by_point}
        cut |= {name: getattr(groups, name)[of] for name in by_group}
        yield of, replace(groups, start=groups.start[of.start : of.stop + 1] - first, **cut)
