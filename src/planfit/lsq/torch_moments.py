"""The pass over the points and the blocks of a step in PyTorch, for GPUs.

The same sums as `planfit.lsq.moments`, which is the reference (and the tests hold this to it). Points
go to the device once a term; a round brings back one 4x4 matrix a group, or its 6x6 blocks. Sums over
groups run in a fixed order (`segment_reduce`), so that a result is the same on every run.
"""

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.lsq.blocks import NormalBlocks, blocks_of_rows
from planfit.lsq.robust import Loss, LossKind

_PART_POINTS = 4_000_000
"""Points at a time: ten sums a point in float64 are 320 MB then."""


def require_device(device: str) -> Any:
    """PyTorch, if it can compute on `device` ("cuda", or "cpu" to test).

    Raises:
        OptionError: PyTorch is absent, or sees no GPU.
    """
    try:
        torch = importlib.import_module("torch")
    except ImportError as error:
        raise OptionError(
            f"solver.device: expected PyTorch for {device!r}, found none; "
            "run `pip install 'planfit[torch]'`, or use --adjust.solver.device cpu"
        ) from error
    if device == "cuda" and not torch.cuda.is_available():
        raise OptionError(
            "solver.device: expected a GPU that PyTorch can use, found none; install a CUDA build of "
            "PyTorch, or use --adjust.solver.device cpu"
        )
    return torch


class GroupedPoints:
    """Points in groups, on a device."""

    def __init__(
        self, device: str, start: Int[np.ndarray, " l"], *columns: Float[np.ndarray, "m ..."]
    ) -> None:
        """Upload `columns`, each (m, ...) with group k in start[k]:start[k + 1]; kept in float64."""
        self.torch = require_device(device)
        self.device = device
        self.start = np.asarray(start)
        self.columns = tuple(self.real(column) for column in columns)

    def real(self, values: Float[np.ndarray, "..."]) -> Any:
        """An array on the device, float64."""
        return self.torch.as_tensor(np.asarray(values, dtype=float), device=self.device)

    def parts(self) -> list[tuple[slice, slice, Any, Any]]:
        """Groups and points that go through together, points a group (k,), group of each point (m,)."""
        made, first, n_groups = [], 0, len(self.start) - 1
        while first < n_groups:
            end = int(np.searchsorted(self.start, self.start[first] + _PART_POINTS, "right")) - 1
            last = min(max(end, first + 1), n_groups)
            counts = self.torch.as_tensor(np.diff(self.start[first : last + 1]), device=self.device)
            each = self.torch.arange(last - first, device=self.device)
            group = self.torch.repeat_interleave(each, counts)
            points = slice(int(self.start[first]), int(self.start[last]))
            made.append((slice(first, last), points, counts, group))
            first = last
        return made

    def sums(self, values: Any, counts: Any) -> Any:
        """Sum of values (m, c) over each group: (k, c)."""
        return self.torch.segment_reduce(values, "sum", lengths=counts, axis=0, unsafe=True)


@dataclass(frozen=True)
class TorchPlaneMoments:
    """As `planfit.lsq.moments.PlaneMoments`, on a device."""

    torch: Any
    pose_idx: Int[np.ndarray, " k"]
    planes: Any  # (k, 4) target frame
    moments: Any  # (k, 4, 4)

    def cost(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> float:
        """Half the weighted sum of squared distances."""
        planes_cam = self._in_cam(self._poses(target_from_cams))
        return 0.5 * float(self.torch.einsum("ki,kij,kj->", planes_cam, self.moments, planes_cam))

    def normal_blocks(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> NormalBlocks:
        """Gauss-Newton blocks; see there."""
        torch, poses = self.torch, self._poses(target_from_cams)
        normals = self.planes[:, :3]
        jacobian = torch.zeros((len(poses), 6, 4), dtype=torch.float64, device=poses.device)
        jacobian[:, :3, :3] = -_skew(torch, normals) @ poses[:, :3, :3]
        jacobian[:, 3:, 3] = normals
        half = jacobian @ self.moments
        gradients = torch.einsum("kaj,kj->ka", half, self._in_cam(poses)).cpu().numpy()
        hessians = (half @ jacobian.transpose(1, 2)).cpu().numpy()
        return blocks_of_rows(self.pose_idx[:, None], hessians, gradients, len(target_from_cams))

    def _poses(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> Any:
        poses = np.ascontiguousarray(target_from_cams[self.pose_idx])
        return self.torch.as_tensor(poses, device=self.moments.device)

    def _in_cam(self, poses: Any) -> Any:
        return self.torch.einsum("kji,kj->ki", poses, self.planes)


@dataclass(frozen=True)
class TorchPairMoments:
    """As `planfit.lsq.moments.PairMoments`, on a device."""

    torch: Any
    pairs: Int[np.ndarray, "k 2"]
    aa: Any  # (k, 4, 4)
    ab: Any  # (k, 4, 4)
    bb: Any  # (k, 4, 4)

    def cost(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> float:
        """Half the weighted sum of squared distances, in the frame of the first camera."""
        first, second = self._poses(target_from_cams)
        a_from_b = _relative(self.torch, first, second)
        einsum = self.torch.einsum
        crossed = einsum("kaj,kaj->", self.ab[:, :3], a_from_b)
        squared = einsum("kai,kij,kaj->", a_from_b, self.bb, a_from_b)
        own = einsum("kaa->", self.aa[:, :3, :3])
        return 0.5 * float(own - 2.0 * crossed + squared)

    def normal_blocks(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> NormalBlocks:
        """Gauss-Newton blocks; see there."""
        torch = self.torch
        first, second = self._poses(target_from_cams)
        rotation_i, rotation_j = first[:, :3, :3], second[:, :3, :3]
        between = first[:, :3, 3] - second[:, :3, 3]
        weight = self.aa[:, 3, 3]
        sum_u = torch.einsum("kab,kb->ka", rotation_i, self.aa[:, :3, 3])
        sum_v = torch.einsum("kab,kb->ka", rotation_j, self.bb[:, :3, 3])
        uu = rotation_i @ self.aa[:, :3, :3] @ rotation_i.transpose(1, 2)
        uv = rotation_i @ self.ab[:, :3, :3] @ rotation_j.transpose(1, 2)
        vv = rotation_j @ self.bb[:, :3, :3] @ rotation_j.transpose(1, 2)
        residual = sum_u - sum_v + weight[:, None] * between
        crossed = uv - uv.transpose(1, 2)
        cross_uv = torch.stack([crossed[:, 1, 2], crossed[:, 2, 0], crossed[:, 0, 1]], dim=1)
        rotation_part_i = torch.linalg.cross(sum_u, between) - cross_uv
        rotation_part_j = cross_uv - torch.linalg.cross(sum_v, between)
        parts = [rotation_part_i, residual, rotation_part_j, -residual]
        across = -_lever_block(torch, uv, sum_u, sum_v, weight)
        hessians = torch.cat(
            [
                torch.cat([_lever_block(torch, uu, sum_u, sum_u, weight), across], dim=2),
                # The lower half is not read.
                torch.cat([across, _lever_block(torch, vv, sum_v, sum_v, weight)], dim=2),
            ],
            dim=1,
        )
        gradients = torch.cat(parts, dim=1).cpu().numpy()
        return blocks_of_rows(self.pairs, hessians.cpu().numpy(), gradients, len(target_from_cams))

    def _poses(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> tuple[Any, Any]:
        poses = self.torch.as_tensor(np.ascontiguousarray(target_from_cams), device=self.aa.device)
        i, j = (self.torch.as_tensor(side.copy(), device=self.aa.device) for side in self.pairs.T)
        return poses[i], poses[j]


def plane_moments_on(
    points: GroupedPoints,
    pose_idx: Int[np.ndarray, " k"],
    planes: Float[np.ndarray, "k 4"],
    weight_per_point: Float[np.ndarray, " k"],
    target_from_cams: Float[np.ndarray, "n 4 4"],
    sigma: float,
    loss: Loss,
) -> tuple[TorchPlaneMoments, float]:
    """As `planfit.lsq.moments.plane_moments`; `points` hold one column, the points (m, 3)."""
    torch = points.torch
    planes_on, weights_on = points.real(planes), points.real(weight_per_point)
    poses = points.real(target_from_cams[pose_idx])
    planes_cam = torch.einsum("kji,kj->ki", poses, planes_on)
    found, cost = [], 0.0
    for groups, part, counts, group in points.parts():
        xyz = points.columns[0][part]
        plane = planes_cam[groups][group]
        distance = (xyz * plane[:, :3]).sum(1) + plane[:, 3]
        rho, weight = _weigh(torch, (distance / sigma) ** 2, loss)
        each = weights_on[groups][group]
        cost += 0.5 * float((each * rho).sum())
        found.append(_second_moments(points, xyz, xyz, each * weight / sigma**2, counts))
    moments = torch.cat(found) if found else points.real(np.zeros((0, 4, 4)))
    return TorchPlaneMoments(torch, pose_idx, planes_on, moments), cost


def pair_moments_on(
    points: GroupedPoints,
    pairs: Int[np.ndarray, "k 2"],
    weight_per_point: Float[np.ndarray, " k"],
    target_from_cams: Float[np.ndarray, "n 4 4"],
    loss: Loss,
) -> tuple[TorchPairMoments, float]:
    """As `planfit.lsq.moments.pair_moments`; columns: points of each side (m, 3), and sigma (m,)."""
    torch, weights_on = points.torch, points.real(weight_per_point)
    first, second = (points.real(target_from_cams[side]) for side in pairs.T)
    a_from_b = _relative(torch, first, second)
    found: list[list[Any]] = [[], [], []]
    cost = 0.0
    for groups, part, counts, group in points.parts():
        a, b, sigma = (column[part] for column in points.columns)
        there = a_from_b[groups][group]
        apart = a - torch.einsum("mij,mj->mi", there[:, :, :3], b) - there[:, :, 3]
        rho, weight = _weigh(torch, (apart**2).sum(1) / sigma**2, loss)
        each = weights_on[groups][group]
        cost += 0.5 * float((each * rho).sum())
        per_m2 = each * weight / sigma**2
        for kept, (p, q) in zip(found, ((a, a), (a, b), (b, b)), strict=True):
            kept.append(_second_moments(points, p, q, per_m2, counts))
    none = points.real(np.zeros((0, 4, 4)))
    aa, ab, bb = (torch.cat(kept) if kept else none for kept in found)
    return TorchPairMoments(torch, pairs, aa, ab, bb), cost


def _second_moments(points: GroupedPoints, p: Any, q: Any, weight: Any, counts: Any) -> Any:
    """Sum of w p~ q~^T (k, 4, 4) over each group of points (m, 3)."""
    torch = points.torch
    one = torch.ones((len(p), 1), dtype=torch.float64, device=p.device)
    p1, q1 = torch.cat([p, one], dim=1) * weight[:, None], torch.cat([q, one], dim=1)
    return points.sums((p1[:, :, None] * q1[:, None, :]).reshape(-1, 16), counts).reshape(-1, 4, 4)


def _weigh(torch: Any, s: Any, loss: Loss) -> tuple[Any, Any]:
    """Costs and weights (m,) of squared residuals (m,) in sigmas; as `kernels.weigh`."""
    c2 = loss.scale**2
    if loss.kind is LossKind.SQUARED:
        return s, torch.ones_like(s)
    if loss.kind is LossKind.HUBER:
        root = torch.sqrt(torch.clamp(s, min=c2))
        return torch.minimum(s, 2.0 * loss.scale * root - c2), loss.scale / root
    if loss.kind is LossKind.CAUCHY:
        return c2 * torch.log1p(s / c2), 1.0 / (1.0 + s / c2)
    if loss.kind is LossKind.NORM:
        root = torch.sqrt(s + c2)
        return 2.0 * (root - loss.scale), 1.0 / root
    share = c2 / (c2 + s)
    return s * share, share**2


def _relative(torch: Any, first: Any, second: Any) -> Any:
    """(k, 3, 4) transforms first^-1 second."""
    back = first[:, :3, :3].transpose(1, 2)
    translation = back @ (second[:, :3, 3] - first[:, :3, 3])[:, :, None]
    return torch.cat([back @ second[:, :3, :3], translation], dim=2)


def _skew(torch: Any, v: Any) -> Any:
    """Cross-product matrices (k, 3, 3) of vectors (k, 3)."""
    zero = torch.zeros_like(v[:, 0])
    x, y, z = v[:, 0], v[:, 1], v[:, 2]
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)


def _lever_block(torch: Any, outer: Any, sum_u: Any, sum_v: Any, weight: Any) -> Any:
    """Sum of J(u)^T J(v) (k, 6, 6); see `moments`."""
    eye = torch.eye(3, dtype=torch.float64, device=outer.device)
    trace = torch.einsum("kaa->k", outer)[:, None, None]
    top = torch.cat([trace * eye - outer.transpose(1, 2), _skew(torch, sum_u)], dim=2)
    bottom = torch.cat([-_skew(torch, sum_v), weight[:, None, None] * eye], dim=2)
    return torch.cat([top, bottom], dim=1)
