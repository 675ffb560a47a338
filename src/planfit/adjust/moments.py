"""Sums over points, collapsed: a step's cost does not depend on how many points there are.

A point-to-plane or point-to-point cost is quadratic in the entries of the transforms. With homogeneous
points p~ = (p, 1) in the camera frame and weights w:

- camera i against a fixed plane pi = (n, -d): sum w (pi^T T_i p~)^2 = pi^T T_i M T_i^T pi, with
  M = sum w p~ p~^T, one 4x4 matrix a (camera, plane);
- cameras i and j: sum w |T_i p~ - T_j q~|^2 needs sum w p~p~^T, sum w p~q~^T and sum w q~q~^T.

The same idea: BALM2 (arXiv 2209.08854), Eigen-Factors (2304.01055), Zhou et al. (2211.11542).
Robust weights change the sums, so each reweighting takes one pass over the points, compiled here.
"""

from dataclasses import dataclass

import numba
import numpy as np

from planfit.adjust.normal_equations import NormalBlocks, sum_by_pose
from planfit.adjust.robust import Loss, rho_and_weight
from planfit.geometry import se3


@dataclass(frozen=True)
class PlaneMoments:
    """Weighted second moments of points seen by a camera that belong on a fixed plane."""

    pose_idx: np.ndarray  # (k,)
    planes: np.ndarray  # (k, 4): (normal, -offset), target frame, unit normal
    moments: np.ndarray  # (k, 4, 4)

    def cost(self, target_from_cams: np.ndarray) -> float:
        """Half the weighted sum of squared distances."""
        planes_cam = _planes_in_cam(self.planes, target_from_cams[self.pose_idx])
        return 0.5 * float(np.einsum("ki,kij,kj->", planes_cam, self.moments, planes_cam))

    def normal_blocks(self, target_from_cams: np.ndarray) -> NormalBlocks:
        """Gauss-Newton blocks: with u = R p, d distance = (u x n) . turn + n . shift."""
        poses = target_from_cams[self.pose_idx]
        normals = self.planes[:, :3]
        # J = A p~ with rows: turn, (u x n) = -[n]x R p; shift, n.
        jacobian = np.zeros((len(poses), 6, 4))
        jacobian[:, :3, :3] = -se3.skew(normals) @ poses[:, :3, :3]
        jacobian[:, 3:, 3] = normals
        planes_cam = _planes_in_cam(self.planes, poses)
        half = jacobian @ self.moments
        gradient = np.einsum("kaj,kj->ka", half, planes_cam)
        n = len(target_from_cams)
        blocks = sum_by_pose(self.pose_idx, half @ np.swapaxes(jacobian, 1, 2), n)
        idx = np.arange(n)
        return NormalBlocks(idx, idx, blocks, sum_by_pose(self.pose_idx, gradient, n))


@dataclass(frozen=True)
class PairMoments:
    """Weighted second moments of matched points of two cameras that belong together."""

    pairs: np.ndarray  # (k, 2)
    aa: np.ndarray  # (k, 4, 4) sum w p~ p~^T
    ab: np.ndarray  # (k, 4, 4) sum w p~ q~^T
    bb: np.ndarray  # (k, 4, 4) sum w q~ q~^T

    def cost(self, target_from_cams: np.ndarray) -> float:
        """Half the weighted sum of squared distances, in the frame of the first camera."""
        # Relative, so that squares of a building's extent do not cancel.
        a_from_b = _relative(target_from_cams, self.pairs)[:, :3]
        eye = np.eye(4)[:3]
        return 0.5 * float(
            np.einsum("ai,kij,aj->", eye, self.aa, eye)
            - 2.0 * np.einsum("ai,kij,kaj->", eye, self.ab, a_from_b)
            + np.einsum("kai,kij,kaj->", a_from_b, self.bb, a_from_b)
        )

    def normal_blocks(self, target_from_cams: np.ndarray) -> NormalBlocks:
        """Gauss-Newton blocks of r = u + s - v, u = R_i p, v = R_j q, s = t_i - t_j."""
        i, j = self.pairs[:, 0], self.pairs[:, 1]
        rotation_i, rotation_j = target_from_cams[i, :3, :3], target_from_cams[j, :3, :3]
        between = target_from_cams[i, :3, 3] - target_from_cams[j, :3, 3]
        weight = self.aa[:, 3, 3]
        sum_u = np.einsum("kab,kb->ka", rotation_i, self.aa[:, :3, 3])
        sum_v = np.einsum("kab,kb->ka", rotation_j, self.bb[:, :3, 3])
        uu = rotation_i @ self.aa[:, :3, :3] @ np.swapaxes(rotation_i, 1, 2)
        uv = rotation_i @ self.ab[:, :3, :3] @ np.swapaxes(rotation_j, 1, 2)
        vv = rotation_j @ self.bb[:, :3, :3] @ np.swapaxes(rotation_j, 1, 2)
        residual = sum_u - sum_v + weight[:, None] * between
        cross_uv = _cross_of_outer(uv)  # sum w u x v
        turn_i = -cross_uv + np.cross(sum_u, between)
        turn_j = -cross_uv + np.cross(sum_v, between)
        n = len(target_from_cams)
        gradient = sum_by_pose(i, np.concatenate([turn_i, residual], axis=1), n)
        gradient += sum_by_pose(j, -np.concatenate([turn_j, residual], axis=1), n)
        diagonal = sum_by_pose(i, _lever_block(uu, sum_u, sum_u, weight), n)
        diagonal += sum_by_pose(j, _lever_block(vv, sum_v, sum_v, weight), n)
        off = -_lever_block(uv, sum_u, sum_v, weight)
        swap = i > j
        off = np.where(swap[:, None, None], np.swapaxes(off, 1, 2), off)
        idx = np.arange(n)
        return NormalBlocks(
            np.concatenate([idx, np.minimum(i, j)]),
            np.concatenate([idx, np.maximum(i, j)]),
            np.concatenate([diagonal, off]),
            gradient,
        )


def plane_moments(
    points_cam: np.ndarray,
    start: np.ndarray,
    pose_idx: np.ndarray,
    planes: np.ndarray,
    information: np.ndarray,
    target_from_cams: np.ndarray,
    sigma: float,
    loss: Loss,
) -> tuple[PlaneMoments, float]:
    """Reweight points (m, 3) in groups and sum them; also the robust cost.

    Args:
        points_cam: (m, 3) m; group k is points start[k]:start[k + 1].
        start: (k + 1,).
        pose_idx: (k,) camera of each group.
        planes: (k, 4) plane of each group, target frame.
        information: (k,) how many independent readings each point of a group is worth.
        target_from_cams: (n, 4, 4).
        sigma: spread of a point about its plane, m.
        loss: robust loss of distance / sigma.
    """
    planes_cam = _planes_in_cam(planes, target_from_cams[pose_idx])
    moments, cost = _sum_plane_moments(
        points_cam, start, planes_cam, information, 1.0 / sigma**2,
        int(loss.kind), float(loss.scale),
    )  # fmt: skip
    return PlaneMoments(pose_idx, planes, moments / sigma**2), cost


def pair_moments(
    points_a: np.ndarray,
    points_b: np.ndarray,
    sigma: np.ndarray,
    start: np.ndarray,
    pairs: np.ndarray,
    information: np.ndarray,
    target_from_cams: np.ndarray,
    loss: Loss,
) -> tuple[PairMoments, float]:
    """Reweight matched points (m, 3) of pairs (k, 2) and sum them; also the robust cost.

    Args:
        points_a, points_b: (m, 3) m, camera frames; pair k is start[k]:start[k + 1].
        sigma: (m,) m, spread of their difference, each axis.
        start: (k + 1,).
        pairs: (k, 2).
        information: (k,) how many independent readings each match of a pair is worth.
        target_from_cams: (n, 4, 4).
        loss: robust loss of distance / sigma.
    """
    a_from_b = np.ascontiguousarray(_relative(target_from_cams, pairs))
    aa, ab, bb, cost = _sum_pair_moments(
        points_a, points_b, sigma, start, a_from_b, information, int(loss.kind), float(loss.scale)
    )
    return PairMoments(pairs, aa, ab, bb), cost


def _planes_in_cam(planes: np.ndarray, target_from_cams: np.ndarray) -> np.ndarray:
    """Planes (k, 4) seen from cameras (k, 4, 4): T^T pi."""
    return np.einsum("kji,kj->ki", target_from_cams, planes)


def _relative(target_from_cams: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    return se3.inverse(target_from_cams[pairs[:, 0]]) @ target_from_cams[pairs[:, 1]]


def _cross_of_outer(outer: np.ndarray) -> np.ndarray:
    """Sum of u x v (k, 3) from the sum of u v^T (k, 3, 3)."""
    return np.stack(
        [
            outer[:, 1, 2] - outer[:, 2, 1],
            outer[:, 2, 0] - outer[:, 0, 2],
            outer[:, 0, 1] - outer[:, 1, 0],
        ],
        axis=1,
    )


def _lever_block(
    outer: np.ndarray, sum_u: np.ndarray, sum_v: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """Sum of J(u)^T J(v) (k, 6, 6), J(u) = [-[u]x, I], from the sums of u v^T, u, v and 1.

    [u]x^T-free form: [u]x [v]x = v u^T - (u . v) I, so -[u]x[v]x = (u . v) I - v u^T.
    """
    block = np.zeros((len(outer), 6, 6))
    trace = np.trace(outer, axis1=1, axis2=2)
    block[:, :3, :3] = trace[:, None, None] * np.eye(3) - np.swapaxes(outer, 1, 2)
    block[:, :3, 3:] = se3.skew(sum_u)
    block[:, 3:, :3] = -se3.skew(sum_v)
    block[:, 3:, 3:] = weight[:, None, None] * np.eye(3)
    return block


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def _sum_plane_moments(
    points, start, planes, factor, inv_sigma_sq, kind, scale
):  # pragma: no cover
    moments = np.zeros((len(planes), 4, 4))
    cost = 0.0
    for k in range(len(planes)):
        a, b, c, d = planes[k]
        xx = xy = xz = yy = yz = zz = sx = sy = sz = total = group_cost = 0.0
        for m in range(start[k], start[k + 1]):
            x, y, z = points[m, 0], points[m, 1], points[m, 2]
            distance = a * x + b * y + c * z + d
            rho, w = rho_and_weight(distance * distance * inv_sigma_sq, kind, scale)
            group_cost += rho
            wx, wy, wz = w * x, w * y, w * z
            xx += wx * x
            xy += wx * y
            xz += wx * z
            yy += wy * y
            yz += wy * z
            zz += wz * z
            sx += wx
            sy += wy
            sz += wz
            total += w
        f = factor[k]
        cost += 0.5 * f * group_cost
        moments[k, 0, 0], moments[k, 1, 1], moments[k, 2, 2] = f * xx, f * yy, f * zz
        moments[k, 0, 1] = moments[k, 1, 0] = f * xy
        moments[k, 0, 2] = moments[k, 2, 0] = f * xz
        moments[k, 1, 2] = moments[k, 2, 1] = f * yz
        moments[k, 0, 3] = moments[k, 3, 0] = f * sx
        moments[k, 1, 3] = moments[k, 3, 1] = f * sy
        moments[k, 2, 3] = moments[k, 3, 2] = f * sz
        moments[k, 3, 3] = f * total
    return moments, cost


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def _sum_pair_moments(a, b, sigma, start, a_from_b, information, kind, scale):  # pragma: no cover
    n = len(a_from_b)
    aa, ab, bb = np.zeros((n, 4, 4)), np.zeros((n, 4, 4)), np.zeros((n, 4, 4))
    cost = 0.0
    p, q = np.ones(4), np.ones(4)
    for k in range(n):
        t = a_from_b[k]
        for m in range(start[k], start[k + 1]):
            distance_sq = 0.0
            for r in range(3):
                p[r], q[r] = a[m, r], b[m, r]
            for r in range(3):
                e = p[r] - (t[r, 0] * q[0] + t[r, 1] * q[1] + t[r, 2] * q[2] + t[r, 3])
                distance_sq += e * e
            inv = 1.0 / (sigma[m] * sigma[m])
            rho, w = rho_and_weight(distance_sq * inv, kind, scale)
            cost += 0.5 * information[k] * rho
            w *= information[k] * inv
            for r in range(4):
                for c in range(4):
                    aa[k, r, c] += w * p[r] * p[c]
                    ab[k, r, c] += w * p[r] * q[c]
                    bb[k, r, c] += w * q[r] * q[c]
    return aa, ab, bb, cost
