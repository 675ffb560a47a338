"""Derivatives of terms by what all frames share: sensor, scales of odometry and plan, thickness of walls."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.calibration.sensor_kernels import K, sum_pairs_by_sensor, sum_planes_by_sensor
from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.terms.between import OdometryTerm, PointTerm, SurfaceTerm
from planfit.adjust.terms.groups import PairGroups, PlaneGroups
from planfit.adjust.terms.levels import LevelTerm
from planfit.adjust.terms.wall_offsets import OffsetWallTerm
from planfit.adjust.terms.walls import WallTerm
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, PARAMETERS, SensorCalibration
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import relative_pose_jacobians, relative_poses, sum_by_pose
from planfit.lsq.moments import planes_in_cam
from planfit.lsq.robust import loss_value
from planfit.runtime import let_go

SHARED = (*PARAMETERS, "odometry_scale", "plan_scale", "half_thickness_m")
"""What all frames share, in the order of vectors and matrices here."""
ODOMETRY, PLAN, HALF = (len(PARAMETERS) + k for k in range(3))
NUISANCES = (ODOMETRY, PLAN, HALF)
"""Free within their priors, and no sensor's: half the thickness is of walls drawn by centre lines."""
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
    problem: AdjustmentProblem, target_from_cams: Poses, sensor: SensorCalibration = NOMINAL
) -> SharedBlocks:
    """Of the terms that know the shared parameters: points, surfaces, levels, walls, odometry.

    Args:
        problem: built from points that `sensor` corrects.
        target_from_cams: where derivatives are taken.
    """
    n, depth = len(target_from_cams), sensor.vector[:3]
    parts = []
    for term in problem.terms:
        if isinstance(term, PointTerm):
            parts.append(_of_pairs(term.groups, target_from_cams, depth))
        elif isinstance(term, LevelTerm):
            parts.append(_of_levels(term.groups, target_from_cams, depth))
        elif isinstance(term, WallTerm):
            parts.append(_of_walls(term, target_from_cams, depth))
        elif isinstance(term, OffsetWallTerm):
            parts.append(_of_offset_walls(term, target_from_cams, depth))
        elif isinstance(term, OdometryTerm):
            parts.append(_of_steps(term, target_from_cams))
        elif isinstance(term, SurfaceTerm):
            parts.append(_of_surfaces(term, target_from_cams))
    return SharedBlocks(
        sum((part.by_pose for part in parts), np.zeros((n, 6, S))),
        sum((part.by_self for part in parts), np.zeros((S, S))),
        sum((part.gradient for part in parts), np.zeros(S)),
    )


def _of_levels(
    groups: PlaneGroups, target_from_cams: Poses, depth: Float[np.ndarray, "3"]
) -> SharedBlocks:
    """Points on level surfaces, whose sigma grows with the points (see `sensor_kernels`)."""
    by_group, by_self, gradient = _by_sensor(groups, target_from_cams, depth, does_grow=True)
    by_pose = sum_by_pose(groups.pose_idx, by_group, len(target_from_cams))
    return SharedBlocks(by_pose, by_self, gradient)


def _by_sensor(
    groups: PlaneGroups, target_from_cams: Poses, depth: Float[np.ndarray, "3"], does_grow: bool
) -> tuple[Float[np.ndarray, "k 6 s"], Float[np.ndarray, "s s"], Float[np.ndarray, " s"]]:
    """Of points on planes: J_pose^T J_shared group by group, J_shared^T J_shared and J_shared^T r, of the
    sensor's parameters alone."""
    k = len(groups.pose_idx)
    poses = target_from_cams[groups.pose_idx]
    planes_cam = planes_in_cam(groups.planes, poses)
    by_group, by_self, gradient = np.zeros((k, 6, S)), np.zeros((S, S)), np.zeros(S)
    of_sensor = np.zeros((k, 6, K)), np.zeros((K, K)), np.zeros(K)
    for of, part in groups.in_parts():
        weight = _robust_weights(part, target_from_cams)
        points, sums = part.points_cam.astype(float, copy=False), (of_sensor[0][of], *of_sensor[1:])
        sum_planes_by_sensor(points, part.start, planes_cam[of], weight, depth, does_grow, *sums)
        let_go(part.points_cam)
    rotations = poses[:, :3, :3]
    by_group[:, :3, :K] = rotations @ of_sensor[0][:, :3]
    by_group[:, 3:, :K] = rotations @ of_sensor[0][:, 3:]
    by_self[:K, :K], gradient[:K] = of_sensor[1], of_sensor[2]
    return by_group, by_self, gradient


def _of_walls(
    term: WallTerm, target_from_cams: Poses, depth: Float[np.ndarray, "3"]
) -> SharedBlocks:
    """Points on faces, which grow with the plan and stand before their lines where walls are drawn by these.

    The sigma of walls is mostly how they were drawn and built: it does not grow with the points.
    """
    by_group, by_self, gradient = _by_walls(term, target_from_cams, depth)
    by_pose = sum_by_pose(term.patches.frame_idx, by_group, len(target_from_cams))
    return SharedBlocks(by_pose, by_self, gradient)


def _of_offset_walls(
    term: OffsetWallTerm, unknowns: Float[np.ndarray, "u 4 4"], depth: Float[np.ndarray, "3"]
) -> SharedBlocks:
    """The same of faces with offsets of their own, which are unknowns behind the cameras.

    A face moves along its normal n, and the residual against it: of translations J_face = -n, J_pose = n.
    """
    as_they_stand, face = term.displaced(unknowns), term.association.face_idx
    by_group, by_self, gradient = _by_walls(as_they_stand, unknowns[: term.n_cams], depth)
    by_face = np.zeros_like(by_group)
    by_face[:, 3:] = -by_group[:, 3:]
    n, is_near = len(unknowns), face >= 0
    by_pose = sum_by_pose(term.patches.frame_idx, by_group, n)
    by_pose += sum_by_pose(term.n_cams + face[is_near], by_face[is_near], n)
    return SharedBlocks(by_pose, by_self, gradient)


def _by_walls(
    term: WallTerm, target_from_cams: Poses, depth: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "k 6 s"], Float[np.ndarray, "s s"], Float[np.ndarray, " s"]]:
    """Of points on faces: J_pose^T J_shared group by group, J_shared^T J_shared and J_shared^T r."""
    groups = term.groups
    by_group, by_self, gradient = _by_sensor(groups, target_from_cams, depth, does_grow=False)
    poses = target_from_cams[groups.pose_idx]
    planes_cam = planes_in_cam(groups.planes, poses)
    moments, _ = groups.moments(target_from_cams)
    sums = np.asarray(moments.moments)  # of w p~ p~^T
    of_one, of_r = sums[:, :, 3], np.einsum("kij,kj->ki", sums, planes_cam)
    levers = np.zeros((len(poses), 6, 4))  # J_pose is levers p~
    levers[:, :3, :3] = -se3.skew(groups.planes[:, :3]) @ poses[:, :3, :3]
    levers[:, 3:, 3] = groups.planes[:, :3]
    # A face at offset c stands at s c, and its sigma grows with it: the residual's derivative is -c - r.
    drawn = groups.planes[:, 3]  # -c
    by_plan = drawn[:, None] * of_one - of_r
    # A face stands half a thickness before its line: the derivative by that is -1.
    of_lines = _are_of_lines(term)
    by_half = -of_lines[:, None] * of_one
    squares = np.einsum("ki,ki->k", planes_cam, of_r)  # sums of w r^2
    by_group[:, :, PLAN] = np.einsum("kij,kj->ki", levers, by_plan)
    by_group[:, :, HALF] = np.einsum("kij,kj->ki", levers, by_half)
    gradient[PLAN] = drawn @ of_r[:, 3] - squares.sum()
    gradient[HALF] = -of_lines @ of_r[:, 3]
    by_self[PLAN, PLAN] = drawn**2 @ of_one[:, 3] - 2 * drawn @ of_r[:, 3] + squares.sum()
    by_self[HALF, HALF] = -by_half[:, 3].sum()
    by_self[PLAN, HALF] = by_self[HALF, PLAN] = drawn @ by_half[:, 3] - gradient[HALF]
    # Rows of translation are n sum w J_s, and n is a unit vector.
    summed = np.einsum("ki,kis->ks", groups.planes[:, :3], by_group[:, 3:, :K])
    by_self[PLAN, :K] = by_self[:K, PLAN] = drawn @ summed - gradient[:K]
    by_self[HALF, :K] = by_self[:K, HALF] = -of_lines @ summed
    return by_group, by_self, gradient


def _are_of_lines(term: WallTerm) -> Float[np.ndarray, " k"]:
    """1 for groups on faces that were made of a wall's centre line, else 0."""
    before, face = term.floorplan.before_line, term.association.face_idx
    if before is None:
        return np.zeros(len(face))
    return np.where((face >= 0) & (before[face] > 0), 1.0, 0.0)


def _of_pairs(
    groups: PairGroups, target_from_cams: Poses, depth: Float[np.ndarray, "3"]
) -> SharedBlocks:
    """Matched points, which know the sensor alone."""
    n, pairs = len(target_from_cams), groups.pairs
    of_sensor = np.zeros((len(pairs), 6, K)), np.zeros((K, K)), np.zeros(K)
    a_from_b = relative_poses(target_from_cams, pairs)
    for of, part in groups.in_parts():
        points_a, points_b = (p.astype(float, copy=False) for p in (part.points_a, part.points_b))
        weight = _robust_weights(part, target_from_cams)
        sums = (of_sensor[0][of], *of_sensor[1:])
        sum_pairs_by_sensor(points_a, points_b, part.start, a_from_b[of], weight, depth, *sums)
        let_go(part.points_a)
        let_go(part.points_b)
    by_ends = np.swapaxes(relative_pose_jacobians(target_from_cams[pairs]), 1, 2) @ of_sensor[0]
    by_pose, by_self, gradient = np.zeros((n, 6, S)), np.zeros((S, S)), np.zeros(S)
    by_pose[:, :, :K] = _by_both_ends(pairs, by_ends, n)
    by_self[:K, :K], gradient[:K] = of_sensor[1], of_sensor[2]
    return SharedBlocks(by_pose, by_self, gradient)


def _robust_weights(
    groups: PlaneGroups | PairGroups, target_from_cams: Poses
) -> Float[np.ndarray, " m"]:
    """Weight of each point, its variance in it."""
    weight = np.zeros(int(groups.start[-1]))
    for squares in groups.squares(target_from_cams):
        weight[squares.part] = loss_value(squares.in_sigmas, groups.loss)[1] * squares.information
    return weight


def _of_steps(term: OdometryTerm, target_from_cams: Poses) -> SharedBlocks:
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


def _of_surfaces(term: SurfaceTerm, target_from_cams: Poses) -> SharedBlocks:
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
