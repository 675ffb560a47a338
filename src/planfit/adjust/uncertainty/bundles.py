"""What each bundle says as one: the points of a wall patch, a frame's floor, the matches of a pair; a step.

The points of a bundle share most of their error (docs/adr/0003-effective-observations.md), so how they
scatter about their own mean says little of it. Their mean does, beside those of other bundles.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from planfit.adjust.terms.groups import PairGroups, PlaneGroups
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.moments import PairMoments, PlaneMoments, planes_in_cam
from planfit.lsq.robust import loss_curvature, loss_value

MIN_CURVATURE = 0.2
"""Curvature of a term's loss by its weights, at least: where most points lie beyond the scale of a loss that
levels off, the poses are held by what the sum does not show."""


@dataclass(frozen=True)
class Bundles:
    """Mean residuals of b bundles of a term, d numbers each, as if they were least squares: the product of
    residual and weight is the pull on the poses."""

    residuals: Float[np.ndarray, "b d"]
    """m, target axes; of recorded steps in sigmas."""
    weights: Float[np.ndarray, " b"]
    """One over their squares, the stated sigmas and effective observations in them."""
    jacobian: sparse.csr_array
    """(b d, 6 n): of the residuals by the tangents of n poses."""
    cluster: Int[np.ndarray, " b"]
    """Numbers without gaps of what errors are shared by: a wall, a visit, a stretch of the walk."""
    labels: Int[np.ndarray, " c"]
    """What each cluster was called before."""

    @property
    def n_clusters(self) -> int:
        """How many there are."""
        return len(self.labels)


@dataclass(frozen=True)
class PointBundles(Bundles):
    """Bundles of points; weights and residuals are those of the robust loss's own curvature."""

    moments: PlaneMoments | PairMoments
    """Of all points, by the curvature."""


def plane_bundles(
    groups: PlaneGroups, target_from_cams: Poses, cluster: Int[np.ndarray, " k"]
) -> PointBundles:
    """Of groups of points on planes; groups of no weight are left out."""
    moments = groups.moments(target_from_cams)[0]
    assert isinstance(moments, PlaneMoments)  # summed on the CPU
    curvature = _curvature(groups, target_from_cams, 1)
    moments = replace(moments, moments=curvature * moments.moments)
    weights = moments.moments[:, 3, 3]
    seen = np.flatnonzero(weights > 0)
    poses = target_from_cams[moments.pose_idx[seen]]
    means = moments.moments[seen, :, 3] / weights[seen, None]
    planes = moments.planes[seen]
    residuals = np.einsum("ki,ki->k", planes_in_cam(planes, poses), means) / curvature
    levers = np.einsum("kij,kj->ki", poses[:, :3, :3], means[:, :3])
    rows = np.concatenate([np.cross(levers, planes[:, :3]), planes[:, :3]], axis=1)
    jacobian = sparse_rows(rows[:, None, None], moments.pose_idx[seen, None], len(target_from_cams))
    labels, without_gaps = np.unique(cluster[seen], return_inverse=True)
    return PointBundles(residuals[:, None], weights[seen], jacobian, without_gaps, labels, moments)


def pair_bundles(
    groups: PairGroups, target_from_cams: Poses, cluster: Int[np.ndarray, " k"]
) -> PointBundles:
    """Of the matches of pairs; pairs of no weight are left out."""
    moments = groups.moments(target_from_cams)[0]
    assert isinstance(moments, PairMoments)
    curvature = _curvature(groups, target_from_cams, 3)
    moments = replace(
        moments, aa=curvature * moments.aa, ab=curvature * moments.ab, bb=curvature * moments.bb
    )
    seen = np.flatnonzero(moments.aa[:, 3, 3] > 0)
    pairs, weights = moments.pairs[seen], moments.aa[seen, 3, 3]
    first, second = target_from_cams[pairs[:, 0]], target_from_cams[pairs[:, 1]]
    mean_a = np.einsum("kij,kj->ki", first[:, :3, :3], moments.aa[seen, :3, 3]) / weights[:, None]
    mean_b = np.einsum("kij,kj->ki", second[:, :3, :3], moments.bb[seen, :3, 3]) / weights[:, None]
    residuals = (mean_a - mean_b + first[:, :3, 3] - second[:, :3, 3]) / curvature
    one = np.broadcast_to(np.eye(3), (len(pairs), 3, 3))
    of_a = np.concatenate([-se3.skew(mean_a), one], axis=2)
    of_b = np.concatenate([se3.skew(mean_b), -one], axis=2)
    jacobian = sparse_rows(np.stack([of_a, of_b], axis=1), pairs, len(target_from_cams))
    labels, without_gaps = np.unique(cluster[seen], return_inverse=True)
    return PointBundles(residuals, weights, jacobian, without_gaps, labels, moments)


def _curvature(groups: PlaneGroups | PairGroups, target_from_cams: Poses, dims: int) -> float:
    """Of a term's loss, by the weights that its points have: one where the loss is a parabola there."""
    weight = curvature = 0.0
    for squares in groups.squares(target_from_cams):
        s, each = squares.in_sigmas, squares.information
        weight += each @ loss_value(s, groups.loss)[1]
        curvature += each @ loss_curvature(s, groups.loss, dims)
    if weight <= 0:
        return 1.0
    return float(max(curvature / weight, MIN_CURVATURE))


def sparse_rows(
    rows: Float[np.ndarray, "b a d 6"], pose_idx: Int[np.ndarray, "b a"], n_poses: int
) -> sparse.csr_array:
    """Jacobian (b d, 6 n) of b bundles that name `a` poses each."""
    b, a, d, _ = rows.shape
    columns = (6 * pose_idx[:, :, None] + np.arange(6)).astype(np.int32).reshape(b, 6 * a)
    entries = rows.transpose(0, 2, 1, 3).reshape(b, d, 6 * a)
    begin = 6 * a * np.arange(b * d + 1, dtype=np.int32)
    made = (entries.ravel(), np.repeat(columns, d, axis=0).ravel(), begin)
    return sparse.csr_array(made, shape=(b * d, 6 * n_poses))
