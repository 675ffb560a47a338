"""Sums over points, collapsed: a step's cost does not depend on how many points there are.

A point-to-plane or point-to-point cost is quadratic in the entries of the transforms. With homogeneous
points p~ = (p, 1) in the camera frame and weights w:

- camera i against a fixed plane pi = (n, -d): sum w (pi^T T_i p~)^2 = pi^T T_i M T_i^T pi, with
  M = sum w p~ p~^T, one 4x4 matrix a (camera, plane);
- cameras i and j: sum w |T_i p~ - T_j q~|^2 needs sum w p~p~^T, sum w p~q~^T and sum w q~q~^T.

The same idea: BALM2 (arXiv 2209.08854), Eigen-Factors (2304.01055), Zhou et al. (2211.11542).
Robust weights change the sums, so each reweighting takes one pass over the points (`moment_kernels`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks, relative_poses
from planfit.lsq.moment_kernels import add_pair_blocks, add_plane_blocks, sum_pairs, sum_planes
from planfit.lsq.robust import Loss
from planfit.runtime.mapped import for_kernels, let_go
from planfit.runtime.threads import in_threads

_PART_POINTS = 100_000
"""Points a thread takes at a time: 0.5 ms of work, against 0.05 ms to hand it over."""
_MAX_PARTS = 64


@dataclass(frozen=True)
class PlaneMoments:
    """Weighted second moments of points seen by a camera that belong on a fixed plane."""

    pose_idx: Int[np.ndarray, " k"]
    planes: Float[np.ndarray, "k 4"]
    """(normal, -offset), target frame, unit normal."""
    moments: Float[np.ndarray, "k 4 4"]
    """Sums of w p~ p~^T, sigma in the weights."""

    def cost(self, target_from_cams: Poses) -> float:
        """Half the weighted sum of squared distances."""
        planes_cam = planes_in_cam(self.planes, target_from_cams[self.pose_idx])
        return 0.5 * float(np.einsum("ki,kij,kj->", planes_cam, self.moments, planes_cam))

    def normal_blocks(self, target_from_cams: Poses) -> NormalBlocks:
        """Gauss-Newton blocks of the distances; see `moment_kernels`."""
        every = np.arange(len(target_from_cams))
        blocks, gradient = np.zeros((len(every), 6, 6)), np.zeros((len(every), 6))
        add_plane_blocks(
            self.pose_idx,
            self.planes,
            self.moments,
            np.ascontiguousarray(target_from_cams),
            blocks,
            gradient,
        )
        return NormalBlocks(every, every, blocks, gradient)


@dataclass(frozen=True)
class PairMoments:
    """Weighted second moments of matched points of two cameras that belong together."""

    pairs: Int[np.ndarray, "k 2"]
    aa: Float[np.ndarray, "k 4 4"]
    """Sums of w p~ p~^T."""
    ab: Float[np.ndarray, "k 4 4"]
    """Sums of w p~ q~^T."""
    bb: Float[np.ndarray, "k 4 4"]
    """Sums of w q~ q~^T."""

    def __getitem__(self, which: Bool[np.ndarray, " k"] | slice) -> "PairMoments":
        """Those of some pairs."""
        return PairMoments(self.pairs[which], self.aa[which], self.ab[which], self.bb[which])

    def cost(self, target_from_cams: Poses) -> float:
        """Half the weighted sum of squared distances, in the frame of the first camera."""
        # Relative, so that squares of a building's extent do not cancel.
        a_from_b = relative_poses(target_from_cams, self.pairs)[:, :3]
        eye = np.eye(4)[:3]
        return 0.5 * float(
            np.einsum("ai,kij,aj->", eye, self.aa, eye)
            - 2.0 * np.einsum("ai,kij,kaj->", eye, self.ab, a_from_b)
            + np.einsum("kai,kij,kaj->", a_from_b, self.bb, a_from_b)
        )

    def normal_blocks(self, target_from_cams: Poses) -> NormalBlocks:
        """Gauss-Newton blocks of the distances; see `moment_kernels`."""
        n_poses, n_pairs = len(target_from_cams), len(self.pairs)
        every = np.arange(n_poses)
        rows, columns = (np.concatenate([every, np.zeros(n_pairs, dtype=int)]) for _ in range(2))
        blocks, gradient = np.zeros((n_poses + n_pairs, 6, 6)), np.zeros((n_poses, 6))
        add_pair_blocks(
            self.pairs,
            self.aa,
            self.ab,
            self.bb,
            np.ascontiguousarray(target_from_cams),
            blocks[:n_poses],
            gradient,
            rows[n_poses:],
            columns[n_poses:],
            blocks[n_poses:],
        )
        return NormalBlocks(rows, columns, blocks, gradient)


def plane_moments(
    points_cam: Float[np.ndarray, "m 3"],
    start: Int[np.ndarray, " l"],
    pose_idx: Int[np.ndarray, " k"],
    planes: Float[np.ndarray, "k 4"],
    weight_per_point: Float[np.ndarray, " k"],
    target_from_cams: Poses,
    sigma: float,
    loss: Loss,
) -> tuple[PlaneMoments, float]:
    """Reweight points in groups and sum them; also the robust cost.

    Args:
        points_cam: m; group k is points start[k]:start[k + 1].
        start: (k + 1,).
        pose_idx: camera of each group.
        planes: plane of each group, target frame.
        weight_per_point: factor on the robust cost of each point of a group.
        target_from_cams: the poses.
        sigma: standard deviation of a point about its plane, m.
        loss: robust loss of distance / sigma.
    """
    planes_cam = planes_in_cam(planes, target_from_cams[pose_idx])
    moments = np.zeros((len(planes), 4, 4))
    shape = (int(loss.kind), float(loss.scale))
    args = (for_kernels(points_cam), start, planes_cam, weight_per_point, float(sigma), *shape)

    def sum_groups(first: int, last: int) -> float:
        cost = sum_planes(*args, first, last, moments)
        let_go(points_cam[start[first] : start[last]])
        return cost

    cost = _in_parts(start, sum_groups)
    return PlaneMoments(pose_idx, planes, moments), cost


def pair_moments(
    points_a: Float[np.ndarray, "m 3"],
    points_b: Float[np.ndarray, "m 3"],
    sigma: Float[np.ndarray, " m"],
    start: Int[np.ndarray, " l"],
    pairs: Int[np.ndarray, "k 2"],
    weight_per_point: Float[np.ndarray, " k"],
    target_from_cams: Poses,
    loss: Loss,
) -> tuple[PairMoments, float]:
    """Reweight matched points of pairs and sum them; also the robust cost.

    Args:
        points_a, points_b: m, camera frames; pair k is start[k]:start[k + 1].
        sigma: m, standard deviation of their difference, each axis.
        start: (k + 1,).
        pairs: first and second camera.
        weight_per_point: factor on the robust cost of each match of a pair.
        target_from_cams: the poses.
        loss: robust loss of distance / sigma.
    """
    a_from_b = relative_poses(target_from_cams, pairs)
    aa, ab, bb = (np.zeros((len(pairs), 4, 4)) for _ in range(3))
    shape = (int(loss.kind), float(loss.scale))
    ends = (for_kernels(points_a), for_kernels(points_b))
    args = (*ends, sigma, start, a_from_b, weight_per_point, *shape)

    def sum_groups(first: int, last: int) -> float:
        cost = sum_pairs(*args, first, last, aa, ab, bb)
        let_go(points_a[start[first] : start[last]])
        let_go(points_b[start[first] : start[last]])
        return cost

    cost = _in_parts(start, sum_groups)
    return PairMoments(pairs, aa, ab, bb), cost


def _in_parts(start: np.ndarray, sum_groups: Callable[[int, int], float]) -> float:
    """Sum groups in parts of about as many points each, a thread a part; returns the cost.

    Parts depend on the points alone, not on the number of cores, so results are the same bit for bit
    wherever they run.
    """
    n_groups, n_points = len(start) - 1, int(start[-1]) if len(start) else 0
    if n_points < _PART_POINTS:
        return sum_groups(0, n_groups)
    n_parts = min(_MAX_PARTS, n_points // _PART_POINTS + 1)
    borders = np.searchsorted(start, np.linspace(0, n_points, n_parts + 1)).clip(0, n_groups)
    borders[-1] = n_groups
    return float(sum(in_threads(sum_groups, borders[:-1].tolist(), borders[1:].tolist())))


def planes_in_cam(planes: np.ndarray, target_from_cams: np.ndarray) -> np.ndarray:
    """Planes (k, 4) seen from cameras (k, 4, 4): T^T pi."""
    return np.einsum("kji,kj->ki", target_from_cams, planes)
