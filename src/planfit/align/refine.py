"""Refine one place of the scan on the plan: iterated closest faces with shrinking distance."""

from dataclasses import dataclass, field

import numpy as np

from planfit.align.visibility import is_occluded
from planfit.align.wall_samples import WallSamples
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import nearest_beside
from planfit.geometry import se3, segments

SCORE_SIGMA_M = 0.15
"""A wall this far from its face scores 0.6. As built and as drawn differ by centimetres; leftover
drift before the walls pull is about a decimetre."""
CROSSED_WEIGHT = 0.5
"""How much of a sample counts although a face stands in its line of sight: plans draw doors and
partitions that do not hide what is behind, so that a crossing is a doubt and no proof."""
READING_M = 1.0
"""Wall of this length counts as one reading in the covariance: errors along a wall are shared (ADR 3)."""

N_STRETCHES = 5
"""Parts that a walk is cut into, to see whether they agree."""


@dataclass(frozen=True)
class AlignmentHypothesis:
    """One place of the scan on the plan."""

    yaw: float  # rad
    shift: np.ndarray  # (2,) m
    score: float
    """Mean over wall samples of exp(-d^2 / 2 sigma^2), d the distance to the nearest face that
    looks the same way; less where the line of sight to the sample crosses another face."""
    scale_xy: tuple[float, float] = (1.0, 1.0)
    """Metres of one unit of the plan, along its x and its y."""
    crossed_share: float = 0.0
    """Share of samples whose line of sight crosses a face: walls of the plan that the camera saw through."""
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((4, 4)))
    """(4, 4) of turn (rad), x and y (m) of the scan's middle, and log scale; zero where not estimated."""

    @property
    def plan_from_level(self) -> np.ndarray:
        """(4, 4), to the plan in metres: its own coordinates times `scale_xy`."""
        return se3.yaw_transform(self.yaw, np.array([*self.shift, 0.0]))

    @property
    def metres_per_unit(self) -> float:
        """Geometric mean of both scales."""
        return float(np.sqrt(self.scale_xy[0] * self.scale_xy[1]))


@dataclass(frozen=True)
class RefineSteps:
    """How a place is refined."""

    distances_m: tuple[float, ...] = (1.5, 1.0, 0.7, 0.5, 0.35, 0.35, 0.35)
    """Faces within these of a sample pull it, in this order."""
    n_scales: int = 0
    """0: the scale is known; 1: one scale is refined; 2: one along each axis of the plan."""
    max_scale_step: float = 0.05
    """Largest change of a log scale at once."""


def refine_hypothesis(
    walls: WallSamples,
    weights: np.ndarray,
    floorplan: Floorplan,
    start: AlignmentHypothesis,
    steps: RefineSteps | None = None,
) -> AlignmentHypothesis:
    """Move a start so that wall samples lie on faces of the plan.

    Args:
        walls: (m) samples, level frame.
        weights: (m,) how much each counts.
        floorplan: in its own unit.
        start: where to begin; its score is not read.
        steps: see there.
    """
    steps = steps or RefineSteps()
    yaw, scale = start.yaw, np.array(start.scale_xy)
    centre = weights @ walls.xy / weights.sum()
    middle = rotation_2d(yaw) @ centre + start.shift
    hessian, spread = np.zeros((5, 5)), 0.0
    for max_distance_m in steps.distances_m:
        ends, face_normals = scaled_faces(floorplan, scale)
        turn = rotation_2d(yaw)
        lever = (walls.xy - centre) @ turn.T
        distance, face = nearest_beside(
            lever + middle, walls.normals @ turn.T, ends, face_normals, floorplan.is_oriented,
            max_distance_m,
        )  # fmt: skip
        ok = face >= 0
        if ok.sum() < 3:
            break
        normal, residual = face_normals[face[ok]], distance[ok]
        on_face = lever[ok] - residual[:, None] * normal
        # About the middle of the scan, so that turn, shift and scale barely mix. A scale moves the
        # face away from the middle, which itself stays where it is on the drawing.
        across = np.stack([-lever[ok, 1], lever[ok, 0]], axis=1)
        jacobian = np.column_stack([np.sum(across * normal, axis=1), normal, -normal * on_face])
        jacobian = jacobian @ free_columns(steps.n_scales)
        weight = weights[ok] / (1.0 + (residual / (0.3 * max_distance_m)) ** 2)
        hessian = jacobian.T @ (jacobian * weight[:, None])
        damping = 1e-6 * weight.sum() * np.eye(len(hessian))
        step = np.linalg.solve(hessian + damping, -jacobian.T @ (weight * residual))
        spread = 1.4826 * float(np.median(np.abs(residual)))
        yaw = float(yaw + step[0])
        factor = np.ones(2)
        if steps.n_scales:
            factor = np.exp(np.clip(step[3:], -steps.max_scale_step, steps.max_scale_step))
        scale = scale * factor
        middle = factor * middle + step[1:3]
    shift = middle - rotation_2d(yaw) @ centre
    place = AlignmentHypothesis(yaw, shift, 0.0, (float(scale[0]), float(scale[1])))
    score, crossed_share = explained(walls, weights, floorplan, place)
    covariance = _covariance(hessian, spread, weights, walls.xy)
    return AlignmentHypothesis(yaw, shift, score, place.scale_xy, crossed_share, covariance)


def part_covariance(
    walls: WallSamples,
    weights: np.ndarray,
    floorplan: Floorplan,
    fit: AlignmentHypothesis,
    steps: RefineSteps,
) -> np.ndarray:
    """(4, 4) as `Fit.covariance`, from how the fit changes when parts of the walk are left out.

    What the walls leave unsure by their noise is small; what drift bends is not, and is shared along the
    walk. Leaving out one of `N_STRETCHES` stretches of it at a time shows both (delete-a-group jackknife:
    Shao and Wu 1989).
    """
    part = _stretches(len(walls.xy))
    middle = weights @ walls.xy / weights.sum()
    found = []
    for k in range(N_STRETCHES):
        kept = np.flatnonzero(part != k)
        if len(kept) < 3:
            return np.zeros((4, 4))
        other = refine_hypothesis(walls.picked(kept), weights[kept], floorplan, fit, steps)
        found.append(_apart(other, fit, middle))
    apart = np.array(found) - np.mean(found, axis=0)
    return (N_STRETCHES - 1) / N_STRETCHES * apart.T @ apart


def stretch_scores(
    walls: WallSamples, weights: np.ndarray, floorplan: Floorplan, place: AlignmentHypothesis
) -> np.ndarray:
    """Score (N_STRETCHES,) of each stretch of the walk by itself."""
    part = _stretches(len(walls.xy))
    scores = [
        explained(walls.picked(kept), weights[kept], floorplan, place)[0]
        for kept in (np.flatnonzero(part == k) for k in range(N_STRETCHES))
        if len(kept)
    ]
    return np.array(scores)


def _stretches(n: int) -> np.ndarray:
    """Number (n,) of the stretch that each sample belongs to."""
    return np.arange(n) * N_STRETCHES // max(n, 1)


def _apart(a: AlignmentHypothesis, b: AlignmentHypothesis, middle: np.ndarray) -> np.ndarray:
    """Turn (rad), shift (2,) m of the scan's middle on the drawing, and log scale from b to a."""
    places = [(rotation_2d(f.yaw) @ middle + f.shift) / np.array(f.scale_xy) for f in (a, b)]
    turn = (a.yaw - b.yaw + np.pi) % (2 * np.pi) - np.pi
    shift = (places[0] - places[1]) * np.array(b.scale_xy)
    return np.array([turn, *shift, np.log(a.metres_per_unit / b.metres_per_unit)])


def explained(
    walls: WallSamples, weights: np.ndarray, floorplan: Floorplan, place: AlignmentHypothesis
) -> tuple[float, float]:
    """Score of a place, and the share of samples seen through a face; see `AlignmentHypothesis`."""
    ends, face_normals = scaled_faces(floorplan, np.array(place.scale_xy))
    turn = rotation_2d(place.yaw)
    xy = walls.xy @ turn.T + place.shift
    distance, face = nearest_beside(
        xy, walls.normals @ turn.T, ends, face_normals, floorplan.is_oriented, 1.0
    )
    closeness = np.where(face >= 0, np.exp(-0.5 * (distance / SCORE_SIGMA_M) ** 2), 0.0)
    crossed = np.zeros(len(xy), dtype=bool)
    if walls.seen_from is not None:
        crossed = is_occluded(walls.seen_from @ turn.T + place.shift, xy, ends)
    closeness *= 1.0 - (1.0 - CROSSED_WEIGHT) * crossed
    total = weights.sum()
    return float(weights @ closeness / total), float(weights @ crossed / total)


def scaled_faces(floorplan: Floorplan, scale_xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (n, 2, 2) m and unit normals (n, 2) of the faces, x and y stretched to metres."""
    if scale_xy[0] == scale_xy[1]:
        return floorplan.ends * scale_xy, floorplan.normals
    ends = floorplan.ends * scale_xy
    normals = segments.left_normals(ends)
    side = np.sum(segments.left_normals(floorplan.ends) * floorplan.normals, axis=1)
    return ends, normals * np.sign(side)[:, None]


def rotation_2d(yaw: float) -> np.ndarray:
    """Turn (2, 2) by `yaw` rad, counter-clockwise seen from above."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s], [s, c]])


def free_columns(n_scales: int) -> np.ndarray:
    """From (turn, x, y, scale x, scale y) to what is refined: (5, 3 + n_scales)."""
    columns = np.eye(5)
    if n_scales == 2:
        return columns
    if n_scales == 1:
        columns[:, 3] += columns[:, 4]
        return columns[:, :4]
    return columns[:, :3]


def _covariance(
    hessian: np.ndarray, spread_m: float, weights: np.ndarray, xy: np.ndarray
) -> np.ndarray:
    """(4, 4) of turn, x, y and log scale (of x where there are two); zero where nothing was solved."""
    covariance = np.zeros((4, 4))
    n = min(len(hessian), 4)
    if len(weights) == 0 or not hessian.any():
        return covariance
    cells = np.unique(np.round(xy / READING_M).astype(int), axis=0)
    per_reading = hessian[:n, :n] * (len(cells) / weights.sum())
    sigma_m = max(spread_m, 0.01)
    # What no wall holds gets a wide spread, not none.
    per_reading = per_reading + 1e-4 * np.eye(n)
    covariance[:n, :n] = sigma_m**2 * np.linalg.inv(per_reading)
    return covariance
