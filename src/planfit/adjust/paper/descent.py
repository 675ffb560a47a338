"""The paper's solver: gradient descent with momentum, gradients by automatic differentiation (PyTorch).

Here to compare with: `planfit.lsq.solver` finds lower costs in a small share of the time. PyTorch is
an optional extra (`pip install planfit[torch]`). The cost is that of `planfit.adjust.paper.preset`;
its variables are one tangent vector a frame, in the chart of `planfit.geometry.se3.retract` about the
initial poses.
"""

import importlib
import time
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import Association
from planfit.adjust.terms.levels import level_planes
from planfit.adjust.terms.observation_models import PAPER_ROUNDING_M
from planfit.adjust.terms.walls import face_planes
from planfit.errors import OptionError, require_positive
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching import Matches
from planfit.segmentation import Structure

_SMALL_ANGLE_SQ = 1e-8
_BLOCK = 16
LATE_LEARNING_RATE = 1e-4
"""Metres or radians a step for a slope of one, once `DescentSchedule.drop_after_steps` are taken."""
MOMENTUM = 0.9
"""Share of the last step that the next one keeps, from the code of the paper's authors."""


@dataclass(frozen=True)
class PaperWeights:
    """Weights of the paper's terms; the 3D point error has weight 1."""

    lambda_floor: float = 10.0
    """Factor on the mean distance to the floor; 0 switches the term off."""
    lambda_walls: float = 0.5
    """Factor on the mean distance to the walls: 0.5 for phone scans, 0.6 for Redwood; 0: off."""


@dataclass(frozen=True)
class DescentSchedule:
    """The paper's schedule: so many steps at the first learning rate, then on at the late one until the loss
    no longer changes. Momentum and the longest run are from its authors' code."""

    learning_rate: float = 1e-3
    """Metres or radians a step for a slope of one."""
    drop_after_steps: int = 20_000
    """Steps at the first learning rate, before `LATE_LEARNING_RATE`. Until they are taken, a loss that no
    longer changes ends nothing."""
    tolerance: float = 1e-5
    """Ends when a step at the late learning rate changes the loss by less than this (m); 0 never ends it."""
    max_steps: int = 25_000
    """Steps at most."""
    record_every_steps: int = 100
    """Steps between records of loss and time."""
    dtype: Literal["float32", "float64"] = "float64"
    """Precision of the descent."""

    def __post_init__(self) -> None:
        require_positive(self, "learning_rate", "record_every_steps")


PAPER_SCHEDULE = DescentSchedule()


class DescentStop(Enum):
    """Why a descent ended."""

    TOLERANCE = "the loss no longer changes"
    LIMIT = "the step limit was reached; the loss was still changing"
    DIVERGED = "the loss is no longer finite; lower the learning rate"


@dataclass(frozen=True)
class Descent:
    """Poses that a descent ended with, and how it got there."""

    target_from_cams: Poses
    """The initial ones where it diverged."""
    stop: DescentStop
    steps: Int[np.ndarray, " k"]
    """Steps taken when each record was made; the first is 0."""
    loss_m: Float[np.ndarray, " k"]
    """The paper's L at those steps; the last is that of the poses."""
    elapsed_s: Float[np.ndarray, " k"]
    """Since the descent began."""


def descend(
    matches: Matches,
    structure: Structure,
    floorplan: Floorplan,
    association: Association,
    initial_target_from_cams: Poses,
    weights: PaperWeights,
    schedule: DescentSchedule = PAPER_SCHEDULE,
) -> Descent:
    """Minimise the paper's cost as the paper does, association kept.

    Args:
        matches: matched points, metres, camera frames; their sigmas are not used.
        structure: floor points and wall patches, metres, camera frames.
        initial_target_from_cams: the target is the plan.

    Raises:
        OptionError: PyTorch is not installed.
    """
    torch = _torch()
    watch, step = _Watch(schedule), 0
    inputs = (matches, structure, floorplan, association)
    cost = _PaperCost(torch, inputs, initial_target_from_cams, weights, schedule.dtype)
    n = len(initial_target_from_cams)
    delta = torch.zeros((n, 6), dtype=cost.dtype, requires_grad=True)
    optimiser = torch.optim.SGD([delta], lr=schedule.learning_rate, momentum=MOMENTUM)
    while True:
        optimiser.zero_grad()
        loss = cost.loss(delta)
        stop = watch.look(step, float(loss.detach()))
        if stop is not None:
            break
        if step == schedule.drop_after_steps:
            optimiser.param_groups[0]["lr"] = LATE_LEARNING_RATE
        loss.backward()
        optimiser.step()
        step += 1
    poses = initial_target_from_cams
    if stop is not DescentStop.DIVERGED:
        moved = delta.detach().double().numpy()
        poses = se3.retract(initial_target_from_cams, moved)
    steps, loss_m, elapsed_s = (np.array(column) for column in zip(*watch.records, strict=True))
    return Descent(poses, stop, steps, loss_m, elapsed_s)


class _Watch:
    """Decides when a descent ends, and keeps a record of it."""

    def __init__(self, schedule: DescentSchedule) -> None:
        self._schedule = schedule
        self._begin = time.perf_counter()
        self._checked = np.inf
        self.records: list[tuple[int, float, float]] = []
        """(step, loss, seconds since the beginning); the last is where it ended."""

    def look(self, step: int, value: float) -> DescentStop | None:
        """Why the descent ends at this step and loss, if it does."""
        schedule, stop = self._schedule, None
        if not np.isfinite(value):
            stop = DescentStop.DIVERGED
        else:
            # The first losses compared are those before and after the first step at the late rate.
            if step >= schedule.drop_after_steps:
                stop = (
                    DescentStop.TOLERANCE
                    if abs(self._checked - value) < schedule.tolerance
                    else None
                )
                self._checked = value
        if stop is None and step >= schedule.max_steps:
            stop = DescentStop.LIMIT
        if stop is not None or step % schedule.record_every_steps == 0:
            self.records.append((step, value, time.perf_counter() - self._begin))
        return stop


def loss_and_gradient(
    matches: Matches,
    structure: Structure,
    floorplan: Floorplan,
    association: Association,
    target_from_cams: Poses,
    weights: PaperWeights,
) -> tuple[float, Float[np.ndarray, "n 6"]]:
    """The paper's L (m) at poses, and its slope by each pose's tangent vector."""
    torch = _torch()
    inputs = (matches, structure, floorplan, association)
    cost = _PaperCost(torch, inputs, target_from_cams, weights, "float64")
    delta = torch.zeros((len(target_from_cams), 6), dtype=cost.dtype, requires_grad=True)
    loss = cost.loss(delta)
    loss.backward()
    return float(loss.detach()), delta.grad.numpy()


class _PaperCost:
    """The paper's cost as a function of tangent vectors, in PyTorch.

    Points of one group (a pair of frames, a frame and a plane) go through in blocks of a fixed number,
    so that a step is a few batched matrix products: four times faster than a product a point.
    """

    def __init__(
        self,
        torch: Any,
        inputs: tuple[Matches, Structure, Floorplan, Association],
        initial_target_from_cams: np.ndarray,
        weights: PaperWeights,
        dtype: str,
    ) -> None:
        matches, structure, floorplan, association = inputs
        self._torch = torch
        self.dtype = getattr(torch, dtype)
        self._rotation = self._real(initial_target_from_cams[:, :3, :3])
        self._translation = self._real(initial_target_from_cams[:, :3, 3])
        self._planes = [
            self._on_planes(
                structure.floor.points_cam,
                structure.floor.start,
                np.arange(len(structure.floor.start) - 1),
                level_planes(structure.floor_heights_m),
                np.where(np.isfinite(structure.floor_heights_m), weights.lambda_floor, 0.0),
            ),
            self._on_planes(
                structure.walls.points_cam,
                structure.walls.start,
                structure.walls.frame_idx,
                face_planes(floorplan, association.face_idx),
                np.where(association.face_idx >= 0, weights.lambda_walls, 0.0),
            ),
        ]
        group, rows, filled = _blocks(matches.start)
        self._pairs = torch.as_tensor(matches.pairs[group], dtype=torch.int64)
        self._points_a = self._in_blocks(matches.points_a, rows, filled)[:, :3]
        self._points_b = self._in_blocks(matches.points_b, rows, filled)
        self._match_weights = self._real(filled / max(matches.n_matches, 1))

    def loss(self, delta: Any) -> Any:
        """L (scalar tensor, m) at tangent vectors (n, 6) about the initial poses."""
        torch = self._torch
        rotation = _exp_so3(torch, delta[:, :3]) @ self._rotation
        translation = self._translation + delta[:, 3:]
        i, j = self._pairs[:, 0], self._pairs[:, 1]
        to_i = rotation[i].transpose(1, 2)
        between = to_i @ (translation[j] - translation[i])[:, :, None]
        a_from_b = torch.cat([to_i @ rotation[j], between], dim=2)
        apart = self._points_a - a_from_b @ self._points_b
        total = (self._match_weights * self._norm((apart**2).sum(1))).sum()
        for frames, planes, points, weights in self._planes:
            normals = planes[:, None, :3]
            offsets = normals @ translation[frames][:, :, None] + planes[:, 3:, None]
            in_cam = torch.cat([normals @ rotation[frames], offsets], dim=2)
            distance = (in_cam @ points)[:, 0]
            total = total + (weights * self._norm(distance**2)).sum()
        return total

    def _norm(self, squared: Any) -> Any:
        """Rounded off near zero, where a plain root has no slope (NaN)."""
        return (squared + PAPER_ROUNDING_M**2).sqrt() - PAPER_ROUNDING_M

    def _on_planes(
        self,
        points_cam: np.ndarray,
        start: np.ndarray,
        frame_idx: np.ndarray,
        planes: np.ndarray,
        factors: np.ndarray,
    ) -> tuple[Any, Any, Any, Any]:
        """Frames, planes, points and weights of blocks; groups (k,) without a factor are left out."""
        n_points = int(np.diff(start)[factors > 0].sum())
        group, rows, filled = _blocks(start)
        used = factors[group] > 0
        group, rows, filled = group[used], rows[used], filled[used]
        return (
            self._torch.as_tensor(frame_idx[group], dtype=self._torch.int64),
            self._real(planes[group]),
            self._in_blocks(points_cam, rows, filled),
            self._real(filled * factors[group, None] / max(n_points, 1)),
        )

    def _in_blocks(self, points: np.ndarray, rows: np.ndarray, filled: np.ndarray) -> Any:
        """Homogeneous points (b, 4, BLOCK), zero where a block is not filled."""
        blocks = np.zeros((*rows.shape, 4))
        blocks[filled, :3] = points[rows[filled]]
        blocks[filled, 3] = 1.0
        return self._real(np.ascontiguousarray(np.swapaxes(blocks, 1, 2)))

    def _real(self, values: np.ndarray) -> Any:
        return self._torch.as_tensor(np.asarray(values, dtype=float)).to(self.dtype)


def _blocks(start: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Groups of points cut into blocks: group (b,), rows of points (b, BLOCK), which exist."""
    counts = np.diff(start)
    per_group = -(-counts // _BLOCK)  # rounded up
    group = np.repeat(np.arange(len(counts)), per_group)
    # Number of the block within its group: the running number less that of the group's first block.
    nth = np.arange(len(group)) - np.repeat(np.cumsum(per_group) - per_group, per_group)
    rows = start[group][:, None] + nth[:, None] * _BLOCK + np.arange(_BLOCK)
    return group, rows, rows < start[group + 1][:, None]


def _exp_so3(torch: Any, vectors: Any) -> Any:
    """Rotations (n, 3, 3) of rotation vectors (n, 3) in radians; its slope is safe at zero."""
    angle_sq = (vectors**2).sum(1)[:, None, None]
    small = angle_sq < _SMALL_ANGLE_SQ
    # Safe first: a NaN in the branch not taken would still poison the gradient.
    angle = torch.where(small, torch.ones_like(angle_sq), angle_sq).sqrt()
    a = torch.where(small, 1.0 - angle_sq / 6.0, torch.sin(angle) / angle)
    b = torch.where(small, 0.5 - angle_sq / 24.0, (1.0 - torch.cos(angle)) / angle**2)
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    zero = torch.zeros_like(x)
    skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
    return torch.eye(3, dtype=vectors.dtype) + a * skew + b * (skew @ skew)


def _torch() -> Any:
    try:
        return importlib.import_module("torch")
    except ImportError as error:
        raise OptionError(
            "gradient descent: expected PyTorch, found none; "
            "run `pip install 'planfit[torch]'`, or use the default solver"
        ) from error
