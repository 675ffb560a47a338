"""The pass over the points in PyTorch, for GPUs.

The same sums as `planfit.lsq.moments`, which is the reference (and the tests hold this to it). Points
go to the device once a term; a round brings back 4x4 matrices of each group, and steps are made of
these on the CPU. Sums over groups run in a fixed order (`segment_reduce`), so that a result is the same
on every run.
"""

import importlib
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import relative_poses
from planfit.lsq.moments import PairMoments, PlaneMoments, planes_in_cam
from planfit.lsq.robust import Loss, LossKind

_PART_POINTS = 4_000_000
"""Points at a time: ten sums a point in float64 are 320 MB then."""


def _require_device(device: str) -> Any:
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
        self.torch = _require_device(device)
        self.device = device
        self.start = np.asarray(start)
        self.columns = tuple(self.real(column) for column in columns)

    def real(self, values: Float[np.ndarray, "..."]) -> Any:
        """An array on the device, float64."""
        return self.torch.as_tensor(np.asarray(values, dtype=float), device=self.device)

    def parts(self) -> list[tuple[slice, slice, Any, Any]]:
        """Groups and points that go through together, points a group (k,), group of each point (m,)."""
        made = []
        for groups in se3.groups_in_parts(self.start, _PART_POINTS):
            start = self.start[groups.start : groups.stop + 1]
            counts = self.torch.as_tensor(np.diff(start), device=self.device)
            each = self.torch.arange(len(start) - 1, device=self.device)
            group = self.torch.repeat_interleave(each, counts)
            made.append((groups, slice(int(start[0]), int(start[-1])), counts, group))
        return made


def plane_moments_on(
    points: GroupedPoints,
    pose_idx: Int[np.ndarray, " k"],
    planes: Float[np.ndarray, "k 4"],
    weight_per_point: Float[np.ndarray, " k"],
    target_from_cams: Poses,
    sigma: float,
    loss: Loss,
) -> tuple[PlaneMoments, float]:
    """As `planfit.lsq.moments.plane_moments`; `points` hold one column, the points (m, 3)."""
    weights_on = points.real(weight_per_point)
    planes_cam = points.real(planes_in_cam(planes, target_from_cams[pose_idx]))
    moments, cost = np.zeros((len(planes), 4, 4)), 0.0
    for groups, part, counts, group in points.parts():
        xyz = points.columns[0][part]
        plane = planes_cam[groups][group]
        distance = (xyz * plane[:, :3]).sum(1) + plane[:, 3]
        rho, weight = _weigh(points.torch, (distance / sigma) ** 2, loss)
        each = weights_on[groups][group]
        cost += 0.5 * float((each * rho).sum())
        moments[groups] = _second_moments(points, xyz, xyz, each * weight / sigma**2, counts)
    return PlaneMoments(pose_idx, planes, moments), cost


def pair_moments_on(
    points: GroupedPoints,
    pairs: Int[np.ndarray, "k 2"],
    weight_per_point: Float[np.ndarray, " k"],
    target_from_cams: Poses,
    loss: Loss,
) -> tuple[PairMoments, float]:
    """As `planfit.lsq.moments.pair_moments`; columns: points of each side (m, 3), and sigma (m,)."""
    torch, weights_on = points.torch, points.real(weight_per_point)
    a_from_b = points.real(relative_poses(target_from_cams, pairs))
    (aa, ab, bb), cost = (np.zeros((len(pairs), 4, 4)) for _ in range(3)), 0.0
    for groups, part, counts, group in points.parts():
        a, b, sigma = (column[part] for column in points.columns)
        there = a_from_b[groups][group]
        apart = a - torch.einsum("mij,mj->mi", there[:, :3, :3], b) - there[:, :3, 3]
        rho, weight = _weigh(torch, (apart**2).sum(1) / sigma**2, loss)
        each = weights_on[groups][group]
        cost += 0.5 * float((each * rho).sum())
        per_m2 = each * weight / sigma**2
        for moments, (p, q) in zip((aa, ab, bb), ((a, a), (a, b), (b, b)), strict=True):
            moments[groups] = _second_moments(points, p, q, per_m2, counts)
    return PairMoments(pairs, aa, ab, bb), cost


def _second_moments(
    points: GroupedPoints, p: Any, q: Any, weight: Any, counts: Any
) -> Float[np.ndarray, "k 4 4"]:
    """Sum of w p~ q~^T over each group of points (m, 3), brought back from the device."""
    torch = points.torch
    one = torch.ones((len(p), 1), dtype=torch.float64, device=p.device)
    p1, q1 = torch.cat([p, one], dim=1) * weight[:, None], torch.cat([q, one], dim=1)
    outer = (p1[:, :, None] * q1[:, None, :]).reshape(-1, 16)
    sums = torch.segment_reduce(outer, "sum", lengths=counts, axis=0, unsafe=True)
    return sums.reshape(-1, 4, 4).cpu().numpy()


def _weigh(torch: Any, s: Any, loss: Loss) -> tuple[Any, Any]:
    """Costs and weights (m,) of squared residuals (m,) in sigmas; as `moment_kernels.weigh`."""
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
