"""The place of a scan that drift has bent: fit it with a few bends allowed, then take the whole.

A rigid fit of a bent scan keeps to the stretch that fits best. Here each stretch of the walk may turn and
shift a little against its neighbours, so that all of its walls find their faces; the place is then the one
rigid motion that is nearest to where they all lie.
"""

from dataclasses import dataclass

import numpy as np

from planfit.align.refine import AlignmentHypothesis, free_columns, rotation_2d, scaled_faces
from planfit.align.wall_samples import WallSamples
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import nearest_beside

N_KNOTS = 6
"""Places along the walk that move; between them the motion is interpolated."""
BEND_M, BEND_RAD = 0.2, np.deg2rad(1.0)
"""Spread of the motion from one knot to the next: what closing loops leaves of two per cent drift."""
SIGMA_M = 0.15
"""Spread of wall about its face."""
DISTANCES_M = (0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.3, 0.3)


@dataclass(frozen=True)
class BentPlace:
    """The place of a bent scan as a whole."""

    yaw: float  # rad
    shift: np.ndarray  # (2,) m
    scale_xy: tuple[float, float]
    """Metres of one unit of the plan, along its x and its y."""
    bend_m: float
    """RMS distance of the scan's walls from where they lie when it may bend."""


def refine_bent(
    walls: WallSamples,
    weights: np.ndarray,
    floorplan: Floorplan,
    fit: AlignmentHypothesis,
    n_scales: int,
) -> BentPlace:
    """The place nearest to a scan that was allowed to bend.

    Args:
        walls: (m) samples in the order they were seen, level frame.
        weights: (m,) how much each counts.
        floorplan: in its own unit.
        fit: a place nearby.
        n_scales: 0: the scale is known; 1: one; 2: one along each axis of the plan.
    """
    m = len(walls.xy)
    hats = _hats(m)
    scale = np.array(fit.scale_xy)
    centre = weights @ walls.xy / weights.sum()
    start = rotation_2d(fit.yaw)
    middle = start @ centre + fit.shift
    knots = np.zeros((N_KNOTS, 3))  # turn (rad), shift (2,) m of each knot
    # Readings a metre apart are independent; the prior is weighed against so many of them.
    cells = len(np.unique(np.round(walls.xy).astype(int), axis=0))
    per_reading = cells / weights.sum() / SIGMA_M**2
    for max_distance_m in DISTANCES_M:
        motion = hats @ knots
        xy, lever, angle = _bent(walls.xy, centre, fit.yaw, middle, motion)
        ends, face_normals = scaled_faces(floorplan, scale)
        c, s = np.cos(angle), np.sin(angle)
        normals = np.column_stack(
            [c * walls.normals[:, 0] - s * walls.normals[:, 1],
             s * walls.normals[:, 0] + c * walls.normals[:, 1]]
        )  # fmt: skip
        distance, face = nearest_beside(
            xy, normals, ends, face_normals, floorplan.is_oriented, max_distance_m
        )
        ok = face >= 0
        if ok.sum() < 3 * N_KNOTS:
            break
        normal, residual = face_normals[face[ok]], distance[ok]
        across = np.stack([-lever[ok, 1], lever[ok, 0]], axis=1)
        basis = np.column_stack([np.sum(across * normal, axis=1), normal])
        of_knots = (hats[ok][:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
        of_scale = -normal * (xy[ok] - residual[:, None] * normal - middle)
        jacobian = np.column_stack([of_knots, of_scale @ free_columns(n_scales)[3:, 3:]])
        weight = per_reading * weights[ok] / (1.0 + (residual / (0.3 * max_distance_m)) ** 2)
        hessian = jacobian.T @ (jacobian * weight[:, None])
        gradient = jacobian.T @ (weight * residual)
        stiffness = _stiffness()
        size = 3 * N_KNOTS
        hessian[:size, :size] += stiffness
        gradient[:size] += stiffness @ knots.ravel()
        step = np.linalg.solve(hessian + 1e-6 * np.eye(len(hessian)), -gradient)
        knots += step[:size].reshape(N_KNOTS, 3)
        if n_scales:
            # The spot on the drawing that the middle lies on stays; it moves in metres.
            factor = np.exp(np.clip(step[size:], -0.02, 0.02)) * np.ones(2)
            scale, middle = scale * factor, middle * factor
    xy, _, _ = _bent(walls.xy, centre, fit.yaw, middle, hats @ knots)
    yaw, shift = _nearest_rigid(walls.xy, xy, weights)
    off = np.sum((xy - walls.xy @ rotation_2d(yaw).T - shift) ** 2, axis=1)
    bend_m = float(np.sqrt(weights @ off / weights.sum()))
    return BentPlace(yaw, shift, (float(scale[0]), float(scale[1])), bend_m)


def _hats(m: int) -> np.ndarray:
    """(m, N_KNOTS) share of each knot in the motion of each sample, in time."""
    at = np.linspace(0.0, N_KNOTS - 1, m)
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - np.arange(N_KNOTS)))


def _stiffness() -> np.ndarray:
    """(3 N_KNOTS, 3 N_KNOTS) quadratic form of the steps from knot to knot."""
    steps = np.diff(np.eye(N_KNOTS), axis=0)
    return np.kron(steps.T @ steps, np.diag([BEND_RAD**-2, BEND_M**-2, BEND_M**-2]))


def _bent(
    xy: np.ndarray, centre: np.ndarray, yaw: float, middle: np.ndarray, motion: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (m, 2) m on the plan, levers (m, 2) about the middle, and turns (m,) rad of the samples."""
    angle = yaw + motion[:, 0]
    c, s = np.cos(angle), np.sin(angle)
    d = xy - centre
    lever = np.column_stack([c * d[:, 0] - s * d[:, 1], s * d[:, 0] + c * d[:, 1]])
    return lever + middle + motion[:, 1:], lever, angle


def _nearest_rigid(
    xy: np.ndarray, target: np.ndarray, weights: np.ndarray
) -> tuple[float, np.ndarray]:
    """Turn (rad) and shift (2,) that bring points (m, 2) nearest to their targets."""
    share = weights / weights.sum()
    mean, target_mean = share @ xy, share @ target
    a, b = (xy - mean) @ [1, 1j], (target - target_mean) @ [1, 1j]
    yaw = float(np.angle(np.sum(share * np.conj(a) * b)))
    return yaw, target_mean - rotation_2d(yaw) @ mean
