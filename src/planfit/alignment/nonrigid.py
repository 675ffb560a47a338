"""Non-rigid refinement: align a deformed scan with a few deformations allowed, then take the whole.

A rigid refinement of a scan that drift has deformed keeps to the segment that fits best. Here each segment of
the walk may rotate and move a little against its neighbours, so that all of its walls find their faces; the
alignment is then the one rigid motion that is nearest to where they all lie.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.alignment.refine import (
    START_SIGMA_M,
    AlignmentHypothesis,
    free_columns,
    n_observations,
    rotation_2d,
    scaled_faces,
)
from planfit.alignment.wall_samples import WallSamples
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import nearest_beside
from planfit.priors import WALL_BEFORE_ADJUSTMENT_SIGMA_M

N_KNOTS = 6
"""Knots along the walk that move; between them the motion is interpolated."""
KNOT_SIGMA_M, KNOT_SIGMA_RAD = 0.2, np.deg2rad(1.0)
"""Sigma of the motion from one knot to the next: what closing loops leaves of two per cent drift."""
WALL_SIGMA_M = WALL_BEFORE_ADJUSTMENT_SIGMA_M.value
"""Sigma of wall about its face."""
DISTANCES_M = (0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.3, 0.3)


@dataclass(frozen=True)
class NonrigidAlignment:
    """The alignment of a deformed scan as a whole."""

    yaw: float
    """Rad."""
    translation: Float[np.ndarray, " 2"]
    """Metres."""
    scale_xy: tuple[float, float]
    """Metres of one unit of the plan, along its x and its y."""
    deformation_m: float
    """RMS distance of the scan's walls from where they lie when it may deform."""


@dataclass(frozen=True)
class _Deformed:
    """Wall samples on the plan, each moved by its own part of the deformation."""

    xy: Float[np.ndarray, "m 2"]
    lever: Float[np.ndarray, "m 2"]
    """From the scan's middle."""
    normals: Float[np.ndarray, "m 2"]


def refine_nonrigid(
    walls: WallSamples,
    floorplan: Floorplan,
    hypothesis: AlignmentHypothesis,
    n_scales: int,
) -> NonrigidAlignment:
    """The rigid alignment nearest to a scan that was allowed to deform.

    Args:
        walls: samples in the order they were seen, level frame.
        floorplan: in its own unit.
        n_scales: 0: the scale is known; 1: one; 2: one along each axis of the plan.
    """
    yaw, scale = hypothesis.yaw, np.array(hypothesis.scale_xy)
    weights, centre = walls.worth, walls.middle
    middle = rotation_2d(yaw) @ centre + hypothesis.translation
    shares, stiffness = _knot_shares(len(walls.xy)), _stiffness()
    lever_sq = weights @ np.sum((walls.xy - centre) ** 2, axis=1) / weights.sum()
    damping = _damping(float(lever_sq))
    knots = np.zeros((N_KNOTS, 3))  # yaw (rad), translation (2,) m of each knot
    information = n_observations(walls) / weights.sum() / WALL_SIGMA_M**2 * weights
    for max_distance_m in DISTANCES_M:
        deformed = _deform(walls, centre, yaw, middle, shares @ knots)
        equations = _normal_equations(
            deformed, information, shares, floorplan, (scale, middle), n_scales, max_distance_m
        )
        if equations is None:
            break
        hessian, gradient = equations
        size = knots.size
        hessian[:size, :size] += stiffness + damping
        gradient[:size] += stiffness @ knots.ravel()
        step = np.linalg.solve(hessian + 1e-6 * np.eye(len(hessian)), -gradient)
        knots += step[:size].reshape(N_KNOTS, 3)
        if n_scales:
            # The spot on the drawing that the middle lies on stays; it moves in metres.
            factor = np.exp(np.clip(step[size:], -0.02, 0.02)) * np.ones(2)
            scale, middle = scale * factor, middle * factor
    xy = _deform(walls, centre, yaw, middle, shares @ knots).xy
    yaw, translation = _nearest_rigid(walls.xy, xy, weights)
    off = np.sum((xy - walls.xy @ rotation_2d(yaw).T - translation) ** 2, axis=1)
    deformation_m = float(np.sqrt(weights @ off / weights.sum()))
    return NonrigidAlignment(yaw, translation, (float(scale[0]), float(scale[1])), deformation_m)


def _normal_equations(
    deformed: _Deformed,
    information: Float[np.ndarray, " m"],
    shares: Float[np.ndarray, "m knots"],
    floorplan: Floorplan,
    scale_and_middle: tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]],
    n_scales: int,
    max_distance_m: float,
) -> tuple[Float[np.ndarray, "u u"], Float[np.ndarray, " u"]] | None:
    """Gauss-Newton matrix and gradient by knots and log scales; None where too few samples have a face."""
    scale, middle = scale_and_middle
    ends, face_normals = scaled_faces(floorplan, scale)
    distance, face = nearest_beside(
        deformed.xy, deformed.normals, ends, face_normals, floorplan.is_oriented, max_distance_m
    )
    ok = face >= 0
    if ok.sum() < 3 * N_KNOTS:
        return None
    normal, residual = face_normals[face[ok]], distance[ok]
    lever = deformed.lever[ok]
    across = np.stack([-lever[:, 1], lever[:, 0]], axis=1)
    by_motion = np.column_stack([np.sum(across * normal, axis=1), normal])  # yaw, x, y
    # A sample moves by its shares of the knots' motions: an outer product a sample, knots outermost.
    by_knots = (shares[ok][:, :, None] * by_motion[:, None, :]).reshape(len(by_motion), -1)
    by_scale = -normal * (deformed.xy[ok] - residual[:, None] * normal - middle)
    jacobian = np.column_stack([by_knots, by_scale @ free_columns(n_scales)[3:, 3:]])
    weight = information[ok] / (1.0 + (residual / (0.3 * max_distance_m)) ** 2)
    return jacobian.T @ (jacobian * weight[:, None]), jacobian.T @ (weight * residual)


def _knot_shares(m: int) -> Float[np.ndarray, "m knots"]:
    """Share of each knot in the motion of each sample, in time: hat functions, linear between knots."""
    at = np.linspace(0.0, N_KNOTS - 1, m)
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - np.arange(N_KNOTS)))


def _stiffness() -> Float[np.ndarray, "u u"]:
    """Quadratic form of the steps from knot to knot, over all knots' (yaw, x, y)."""
    steps = np.diff(np.eye(N_KNOTS), axis=0)
    return np.kron(
        steps.T @ steps, np.diag([KNOT_SIGMA_RAD**-2, KNOT_SIGMA_M**-2, KNOT_SIGMA_M**-2])
    )


def _damping(lever_sq_m2: float) -> Float[np.ndarray, "u u"]:
    """Quadratic form of the mean motion of all knots: as far as starts are off, as in `refine_hypothesis`."""
    mean = np.full((N_KNOTS, N_KNOTS), N_KNOTS**-2.0)
    return np.kron(mean, np.diag([lever_sq_m2, 1.0, 1.0]) / START_SIGMA_M**2)


def _deform(
    walls: WallSamples,
    centre: Float[np.ndarray, " 2"],
    yaw: float,
    middle: Float[np.ndarray, " 2"],
    motion: Float[np.ndarray, "m 3"],
) -> _Deformed:
    """Samples on the plan, each by yaw about the scan's middle and its own (yaw, x, y)."""
    angle = yaw + motion[:, 0]
    c, s = np.cos(angle), np.sin(angle)

    def rotated(vectors: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2"]:
        x, y = vectors.T
        return np.column_stack([c * x - s * y, s * x + c * y])

    lever = rotated(walls.xy - centre)
    return _Deformed(lever + middle + motion[:, 1:], lever, rotated(walls.normals))


def _nearest_rigid(
    xy: Float[np.ndarray, "m 2"],
    target: Float[np.ndarray, "m 2"],
    weights: Float[np.ndarray, " m"],
) -> tuple[float, Float[np.ndarray, " 2"]]:
    """Yaw (rad) and translation (m) that bring points nearest to their targets."""
    share = weights / weights.sum()
    mean, target_mean = share @ xy, share @ target
    # As complex numbers, the rotation that best takes a to b is the angle of sum of conj(a) b.
    a, b = (xy - mean) @ [1, 1j], (target - target_mean) @ [1, 1j]
    yaw = float(np.angle(np.sum(share * np.conj(a) * b)))
    return yaw, target_mean - rotation_2d(yaw) @ mean
