"""Derivatives of terms by what all frames share: the sensor, the odometry's and the plan's scale."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.calibration.kernels import K, sum_pairs_by_sensor, sum_planes_by_sensor
from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.terms.groups import PairGroups, PlaneGroups
from planfit.adjust.terms.levels import LevelTerm
from planfit.adjust.terms.odometry import OdometryTerm
from planfit.adjust.terms.points import PointTerm
from planfit.adjust.terms.surfaces import SurfaceTerm
from planfit.adjust.terms.walls import WallTerm
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, PARAMETERS, SensorCalibration
from planfit.lsq.blocks import relative_pose_jacobians, relative_poses, sum_by_pose
from planfit.lsq.moments import planes_in_cam
from planfit.lsq.robust import loss_value

SHARED = (*PARAMETERS, "odometry_scale", "plan_scale")
"""What all frames share, in the order of vectors and matrices here."""
ODOMETRY, PLAN = len(PARAMETERS), len(PARAMETERS) + 1
S = len(SHARED)


@dataclass(frozen=True)
class SharedBlocks:
    """Normal equations' parts of the shared parameters, robust weights frozen."""

    by_pose: Float[np.ndarray, "n 6 s"]
    """J_pose^T J_shared, tangents as in `planfit.geometry.se3`."""
    by_self: Float[np.ndarray, "s s"]
    """J_shared^T J_shared."""
    gradient: Float[np.ndarray, " s"]
    """J_shared^T r."""


def shared_blocks(
    problem: AdjustmentProblem,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    sensor: SensorCalibration = NOMINAL,
) -> SharedBlocks:
    """Of the terms that know the shared parameters: points, surfaces, levels, walls, odometry.

    Args:
        problem: built from points that `sensor` corrects.
        target_from_cams: where derivatives are taken.
        sensor: likewise.
    """
    n, depth = len(target_from_cams), sensor.vector[:3]
    parts = []
    for term in problem.terms:
        if isinstance(term, PointTerm):
            parts.append(_of_pairs(term.groups, target_from_cams, depth))
        elif isinstance(term, LevelTerm):
            parts.append(_of_planes(term.groups, target_from_cams, depth, is_drawn=False))
        elif isinstance(term, WallTerm):
            parts.append(_of_planes(term.groups, target_from_cams, depth, is_drawn=True))
        elif isinstance(term, OdometryTerm):
            parts.append(_of_steps(term, target_from_cams))
        elif isinstance(term, SurfaceTerm):
            parts.append(_of_surfaces(term, target_from_cams))
    return SharedBlocks(
        sum((part.by_pose for part in parts), np.zeros((n, 6, S))),
        sum((part.by_self for part in parts), np.zeros((S, S))),
        sum((part.gradient for part in parts), np.zeros(S)),
    )


def _of_planes(
    groups: PlaneGroups,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    depth: Float[np.ndarray, "3"],
    is_drawn: bool,
) -> SharedBlocks:
    """Points on planes: walls, whose planes grow with the plan, or level surfaces, which do not.

    The sigma of level surfaces grows with the points (see `kernels`); that of walls is mostly how they were
    drawn and built.
    """
    n, k = len(target_from_cams), len(groups.pose_idx)
    poses = target_from_cams[groups.pose_idx]
    planes_cam = planes_in_cam(groups.planes, poses)
    by_group, by_self, gradient = np.zeros((k, 6, S)), np.zeros((S, S)), np.zeros(S)
    of_sensor = np.zeros((k, 6, K)), np.zeros((K, K)), np.zeros(K)
    weight = _robust_weights(groups, target_from_cams)
    points = np.asarray(groups.points_cam, dtype=float)
    sum_planes_by_sensor(points, groups.start, planes_cam, weight, depth, not is_drawn, *of_sensor)
    rotations = poses[:, :3, :3]
    by_group[:, :3, :K] = rotations @ of_sensor[0][:, :3]
    by_group[:, 3:, :K] = rotations @ of_sensor[0][:, 3:]
    by_self[:K, :K], gradient[:K] = of_sensor[1], of_sensor[2]
    if is_drawn:
        # A face at offset c stands at s c, and its sigma grows with it: the residual's derivative is -c - r.
        moments, _ = groups.moments(target_from_cams)
        sums = np.asarray(moments.moments)  # of w p~ p~^T
        levers = np.zeros((k, 6, 4))  # J_pose is levers p~
        levers[:, :3, :3] = -se3.skew(groups.planes[:, :3]) @ rotations
        levers[:, 3:, 3] = groups.planes[:, :3]
        drawn = groups.planes[:, 3]  # -c
        of_one, of_r = sums[:, :, 3], np.einsum("kij,kj->ki", sums, planes_cam)
        by_plan = drawn[:, None] * of_one - of_r
        by_group[:, :, PLAN] = np.einsum("kij,kj->ki", levers, by_plan)
        squares = np.einsum("ki,ki->k", planes_cam, of_r)  # sums of w r^2
        gradient[PLAN] = drawn @ of_r[:, 3] - squares.sum()
        by_self[PLAN, PLAN] = drawn**2 @ of_one[:, 3] - 2 * drawn @ of_r[:, 3] + squares.sum()
        # Rows of translation are n sum w J_s, and n is a unit vector.
        summed = np.einsum("ki,kis->ks", groups.planes[:, :3], by_group[:, 3:, :K])
        by_self[PLAN, :K] = by_self[:K, PLAN] = drawn @ summed - gradient[:K]
    return SharedBlocks(sum_by_pose(groups.pose_idx, by_group, n), by_self, gradient)


def _of_pairs(
    groups: PairGroups,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    depth: Float[np.ndarray, "3"],
) -> SharedBlocks:
    """Matched points, which know the sensor alone."""
    n, pairs = len(target_from_cams), groups.pairs
    of_sensor = np.zeros((len(pairs), 6, K)), np.zeros((K, K)), np.zeros(K)
    a_from_b = relative_poses(target_from_cams, pairs)
    points_a, points_b = (np.asarray(p, dtype=float) for p in (groups.points_a, groups.points_b))
    weight = _robust_weights(groups, target_from_cams)
    sum_pairs_by_sensor(points_a, points_b, groups.start, a_from_b, weight, depth, *of_sensor)
    by_ends = np.swapaxes(relative_pose_jacobians(target_from_cams[pairs]), 1, 2) @ of_sensor[0]
    by_pose, by_self, gradient = np.zeros((n, 6, S)), np.zeros((S, S)), np.zeros(S)
    by_pose[:, :, :K] = _by_both_ends(pairs, by_ends, n)
    by_self[:K, :K], gradient[:K] = of_sensor[1], of_sensor[2]
    return SharedBlocks(by_pose, by_self, gradient)


def _robust_weights(
    groups: PlaneGroups | PairGroups, target_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, " m"]:
    """Weight of each point, its variance in it."""
    weight = np.zeros(int(groups.start[-1]))
    for squares in groups.squares(target_from_cams):
        weight[squares.part] = loss_value(squares.in_sigmas, groups.loss)[1] * squares.information
    return weight


def _of_steps(term: OdometryTerm, target_from_cams: Float[np.ndarray, "n 4 4"]) -> SharedBlocks:
    """Recorded steps, whose translations grow with the odometry's scale."""
    n, between = len(target_from_cams), term.between
    weighted, _ = term.reweight(target_from_cams)
    recorded = between.first_from_second
    information = weighted.information  # diagonals (k, 6)
    residuals = between.rows.residuals(target_from_cams)
    # The residual's translation is r = R_m^T (apart - s t_m), its sigma grows with s: -R_m^T t_m - r.
    by_scale = np.zeros((len(recorded), 6))
    by_scale[:, 3:] = -np.einsum("kji,kj->ki", recorded[:, :3, :3], recorded[:, :3, 3])
    by_scale[:, 3:] -= residuals[:, 3:]
    jacobians = between.rows.jacobians(target_from_cams)
    by_ends = np.einsum("kdc,kd->kc", jacobians, information * by_scale)
    by_pose, by_self, gradient = np.zeros((n, 6, S)), np.zeros((S, S)), np.zeros(S)
    by_pose[:, :, ODOMETRY] = _by_both_ends(between.pairs, by_ends, n)
    by_self[ODOMETRY, ODOMETRY] = np.sum(information * by_scale**2)
    gradient[ODOMETRY] = np.sum(information * by_scale * residuals)
    return SharedBlocks(by_pose, by_self, gradient)


def _of_surfaces(term: SurfaceTerm, target_from_cams: Float[np.ndarray, "n 4 4"]) -> SharedBlocks:
    """Motions by surfaces, which follow the sensor as they were measured with it."""
    n, between = len(target_from_cams), term.between
    weighted, _ = term.reweight(target_from_cams)
    by_sensor = term.by_sensor(target_from_cams)
    scaled = weighted.information @ by_sensor  # (k, 6, K)
    residuals = between.rows.residuals(target_from_cams)
    by_ends = np.swapaxes(between.rows.jacobians(target_from_cams), 1, 2) @ scaled
    by_pose, by_self, gradient = np.zeros((n, 6, S)), np.zeros((S, S)), np.zeros(S)
    by_pose[:, :, :K] = _by_both_ends(between.pairs, by_ends, n)
    by_self[:K, :K] = np.einsum("kds,kdt->st", by_sensor, scaled)
    gradient[:K] = np.einsum("kds,kd->s", scaled, residuals)
    return SharedBlocks(by_pose, by_self, gradient)


def _by_both_ends(
    pairs: Int[np.ndarray, "k 2"], by_ends: Float[np.ndarray, "k 12 ..."], n: int
) -> Float[np.ndarray, "n 6 ..."]:
    """Rows of the first pose's tangent, then of the second's, summed over the pairs of each pose."""
    first, second = pairs.T
    return sum_by_pose(first, by_ends[:, :6], n) + sum_by_pose(second, by_ends[:, 6:], n)
