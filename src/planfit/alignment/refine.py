"""Refine one alignment of the scan with the plan: iterated closest faces with shrinking distance."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.alignment.visibility import is_occluded
from planfit.alignment.wall_samples import WallSamples
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import nearest_beside
from planfit.geometry import se3, segments
from planfit.geometry.se3 import wrap_angle
from planfit.priors import WALL_BEFORE_ADJUSTMENT_SIGMA_M
from planfit.runtime import short_repr

SCORE_SIGMA_M = WALL_BEFORE_ADJUSTMENT_SIGMA_M.value
"""A wall this far from its face scores 0.6. As built and as drawn differ by centimetres; leftover
drift before the walls act is about a decimetre."""
OCCLUDED_WEIGHT = 0.5
"""How much of a sample counts although a face occludes it: plans draw doors and
partitions that do not hide what is behind, so that an occlusion is a sign and no proof."""
OBSERVATION_M = 1.0
"""Wall of this length counts as one observation in the covariance: errors along a wall are shared (ADR 3)."""
START_SIGMA_M = 0.4
"""How far off wall of a start is, one standard deviation: leftover drift, and a cell of the search. In the
refinement it holds the scan along directions in which walls say next to nothing, where it slid by 9 m."""

N_SEGMENTS = 5
"""Trajectory segments that a walk is cut into, to see whether they agree."""


@dataclass(frozen=True)
class AlignmentHypothesis:
    """One alignment of the scan with the plan, refined or to begin with."""

    yaw: float
    """Rad, plan from level."""
    translation: Float[np.ndarray, " 2"]
    """Metres, plan from level."""
    score: float
    """Mean over wall samples of exp(-d^2 / 2 sigma^2), d the distance to the nearest face that
    looks the same way; less where another face occludes the sample."""
    scale_xy: tuple[float, float] = (1.0, 1.0)
    """Metres of one unit of the plan, along its x and its y."""
    occluded_share: float = 0.0
    """Share of samples that a face occludes: walls of the plan that the camera saw through."""
    covariance: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.zeros((4, 4)))
    """Of yaw (rad), x and y (m) of the scan's middle, and log scale; zero where not estimated."""

    __repr__ = short_repr

    @classmethod
    def from_transform(cls, plan_from_level: Float[np.ndarray, "4 4"]) -> "AlignmentHypothesis":
        """What a transform to a plan in metres says seen from above; not scored."""
        return cls(float(se3.yaw_of(plan_from_level)), plan_from_level[:2, 3], 0.0)

    @property
    def plan_from_level(self) -> Float[np.ndarray, "4 4"]:
        """To the plan in metres: its own coordinates times `scale_xy`."""
        return se3.yaw_transform(self.yaw, np.array([*self.translation, 0.0]))

    @property
    def metres_per_unit(self) -> float:
        """Geometric mean of both scales."""
        return float(np.sqrt(self.scale_xy[0] * self.scale_xy[1]))


@dataclass(frozen=True)
class RefineSteps:
    """How a hypothesis is refined."""

    distances_m: tuple[float, ...] = (1.5, 1.0, 0.7, 0.5, 0.35, 0.35, 0.35)
    """Samples correspond to faces within these, one after the other."""
    n_scales: int = 0
    """0: the scale is known; 1: one scale is refined; 2: one along each axis of the plan."""
    max_scale_step: float = 0.05
    """Largest change of a log scale at once."""


def refine_hypothesis(
    walls: WallSamples,
    floorplan: Floorplan,
    start: AlignmentHypothesis,
    steps: RefineSteps | None = None,
) -> AlignmentHypothesis:
    """Move a start so that wall samples lie on faces of the plan.

    Args:
        floorplan: in its own unit.
        start: where to begin; its score is not read.
    """
    steps = steps or RefineSteps()
    yaw, scale = start.yaw, np.array(start.scale_xy)
    centre, worth = walls.middle, walls.worth
    middle = rotation_2d(yaw) @ centre + start.translation
    columns, n_seen = free_columns(steps.n_scales), n_observations(walls)
    hessian, mad_sigma_m = np.zeros((5, 5)), 0.0
    for max_distance_m in steps.distances_m:
        ends, face_normals = scaled_faces(floorplan, scale)
        rotation = rotation_2d(yaw)
        lever = (walls.xy - centre) @ rotation.T
        distance, face = nearest_beside(
            lever + middle,
            walls.normals @ rotation.T,
            ends,
            face_normals,
            floorplan.is_oriented,
            max_distance_m,
        )
        ok = face >= 0
        if ok.sum() < 3:
            break
        normal, residual = face_normals[face[ok]], distance[ok]
        jacobian = _jacobian(lever[ok], normal, residual) @ columns
        weight = worth[ok] / (1.0 + (residual / (0.3 * max_distance_m)) ** 2)
        hessian = jacobian.T @ (jacobian * weight[:, None])
        # Levenberg's damping: a step costs by how far it moves the samples, squared.
        lever_sq = np.mean(lever**2, axis=0)
        moved_sq = np.array([lever_sq.sum(), 1.0, 1.0, *lever_sq])
        damping = columns.T @ (columns * moved_sq[:, None])
        damping *= weight.sum() / n_seen * (SCORE_SIGMA_M / START_SIGMA_M) ** 2
        step = np.linalg.solve(hessian + damping, -jacobian.T @ (weight * residual))
        mad_sigma_m = 1.4826 * float(np.median(np.abs(residual)))
        yaw = float(yaw + step[0])
        factor = np.ones(2)
        if steps.n_scales:
            factor = np.exp(np.clip(step[3:], -steps.max_scale_step, steps.max_scale_step))
        scale = scale * factor
        middle = factor * middle + step[1:3]
    translation = middle - rotation_2d(yaw) @ centre
    found = AlignmentHypothesis(yaw, translation, 0.0, (float(scale[0]), float(scale[1])))
    score, occluded_share = explained(walls, floorplan, found)
    covariance = _covariance(hessian, mad_sigma_m, walls)
    return replace(found, score=score, occluded_share=occluded_share, covariance=covariance)


def _jacobian(
    lever: Float[np.ndarray, "m 2"],
    normal: Float[np.ndarray, "m 2"],
    residual: Float[np.ndarray, " m"],
) -> Float[np.ndarray, "m 5"]:
    """Of distances to faces by (yaw, x, y, log scale x, log scale y).

    About the middle of the scan, so that yaw, translation and scale barely mix. A scale moves the
    face away from the middle, which itself stays where it is on the drawing.
    """
    on_face = lever - residual[:, None] * normal
    across = np.stack([-lever[:, 1], lever[:, 0]], axis=1)
    return np.column_stack([np.sum(across * normal, axis=1), normal, -normal * on_face])


def jackknife_covariance(
    walls: WallSamples,
    floorplan: Floorplan,
    hypothesis: AlignmentHypothesis,
    steps: RefineSteps,
) -> Float[np.ndarray, "4 4"]:
    """As `AlignmentHypothesis.covariance`, from how the alignment changes when parts are left out.

    What the walls leave unsure by their noise is small; what drift deforms is not, and is shared along the
    walk. Leaving out one of `N_SEGMENTS` trajectory segments at a time shows both (delete-a-group jackknife:
    Shao and Wu 1989).
    """
    segment, found = _segments(len(walls.xy)), []
    for k in range(N_SEGMENTS):
        kept = np.flatnonzero(segment != k)
        if len(kept) < 3:
            return np.zeros((4, 4))
        found.append(refine_hypothesis(walls.picked(kept), floorplan, hypothesis, steps))
    apart = differences(found, hypothesis, walls.middle)
    apart[:, 1:3] *= hypothesis.scale_xy
    apart -= apart.mean(axis=0)
    return (N_SEGMENTS - 1) / N_SEGMENTS * apart.T @ apart


def segment_scores(
    walls: WallSamples, floorplan: Floorplan, hypothesis: AlignmentHypothesis
) -> Float[np.ndarray, " segments"]:
    """Score of each trajectory segment by itself; segments without walls are left out."""
    segment = _segments(len(walls.xy))
    scores = [
        explained(walls.picked(kept), floorplan, hypothesis)[0]
        for kept in (np.flatnonzero(segment == k) for k in range(N_SEGMENTS))
        if len(kept)
    ]
    return np.array(scores)


def _segments(n: int) -> Int[np.ndarray, " n"]:
    """Number of the trajectory segment that each sample belongs to; samples are in the order of the walk."""
    return np.arange(n) * N_SEGMENTS // max(n, 1)


def differences(
    hypotheses: Sequence[AlignmentHypothesis],
    reference: AlignmentHypothesis,
    middle_level: Float[np.ndarray, " 2"],
) -> Float[np.ndarray, "h 4"]:
    """Yaw (rad), x and y of the scan's middle (units of the drawing) and log scale, from a reference to each.

    Args:
        middle_level: metres, level frame.
    """
    both = [*hypotheses, reference]
    yaw = np.array([each.yaw for each in both])
    scale_xy = np.array([each.scale_xy for each in both])
    log_scale = np.log(np.sqrt(scale_xy[:, 0] * scale_xy[:, 1]))  # of `metres_per_unit`
    c, s = np.cos(yaw), np.sin(yaw)
    rotations = np.array([[c, -s], [s, c]]).transpose(2, 0, 1)  # (h + 1, 2, 2)
    on_plan = rotations @ middle_level + np.array([each.translation for each in both])
    on_drawing = on_plan / scale_xy
    apart = np.column_stack([yaw, on_drawing, log_scale])
    apart = apart[:-1] - apart[-1]
    apart[:, 0] = wrap_angle(apart[:, 0])
    return apart


def explained(
    walls: WallSamples, floorplan: Floorplan, hypothesis: AlignmentHypothesis
) -> tuple[float, float]:
    """Score of an alignment, and the share of samples occluded by a face; see `AlignmentHypothesis`."""
    near, occluded = closeness(walls, floorplan, hypothesis)
    weights, total = walls.worth, walls.worth.sum()
    return float(weights @ near / total), float(weights @ occluded / total)


def closeness(
    walls: WallSamples, floorplan: Floorplan, hypothesis: AlignmentHypothesis
) -> tuple[Float[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """How well samples are explained, 0 to 1, and whether a face occludes them; see `AlignmentHypothesis`."""
    ends, face_normals = scaled_faces(floorplan, np.array(hypothesis.scale_xy))
    rotation, translation = rotation_2d(hypothesis.yaw), hypothesis.translation
    xy = walls.xy @ rotation.T + translation
    distance, face = nearest_beside(
        xy, walls.normals @ rotation.T, ends, face_normals, floorplan.is_oriented, 1.0
    )
    near = np.where(face >= 0, np.exp(-0.5 * (distance / SCORE_SIGMA_M) ** 2), 0.0)
    occluded = np.zeros(len(xy), dtype=bool)
    if walls.seen_from is not None:
        occluded = is_occluded(walls.seen_from @ rotation.T + translation, xy, ends)
    return near * (1.0 - (1.0 - OCCLUDED_WEIGHT) * occluded), occluded


def metric_plan(floorplan: Floorplan, scale_xy: tuple[float, float]) -> Floorplan:
    """The plan in metres, one unit being `scale_xy` long along its x and its y.

    The very same plan where that is what it is drawn in.
    """
    x, y = scale_xy
    if floorplan.is_metric and x == y == 1.0:
        return floorplan
    even = floorplan.scaled(float(np.sqrt(x * y)))
    if x == y:
        return even
    ends, normals = scaled_faces(floorplan, np.array(scale_xy))
    openings = None if floorplan.openings is None else floorplan.openings * np.array(scale_xy)
    source = floorplan.source
    if source.file_from_plan is not None:
        unscale = np.diag([1 / x, 1 / y, 1.0])
        source = replace(source, file_from_plan=source.file_from_plan @ unscale)
    drawn = None if floorplan.drawn is None else floorplan.drawn * np.array(scale_xy)
    return replace(even, ends=ends, normals=normals, openings=openings, source=source, drawn=drawn)


def scaled_faces(
    floorplan: Floorplan, scale_xy: Float[np.ndarray, " 2"]
) -> tuple[Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 2"]]:
    """Ends (m) and unit normals of the faces, x and y stretched to metres."""
    if scale_xy[0] == scale_xy[1]:
        return floorplan.ends * scale_xy, floorplan.normals
    ends = floorplan.ends * scale_xy
    normals = segments.left_normals(ends)
    side = np.sum(segments.left_normals(floorplan.ends) * floorplan.normals, axis=1)
    return ends, normals * np.sign(side)[:, None]


def n_observations(walls: WallSamples) -> int:
    """Independent observations of wall: cells of `OBSERVATION_M` with samples."""
    return len(np.unique(np.round(walls.xy / OBSERVATION_M).astype(int), axis=0))


def rotation_2d(yaw: float) -> Float[np.ndarray, "2 2"]:
    """Rotation by `yaw` rad, counter-clockwise seen from above."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s], [s, c]])


def free_columns(n_scales: int) -> Float[np.ndarray, "5 free"]:
    """From (yaw, x, y, log scale x, log scale y) to what is refined: 3 + n_scales columns."""
    columns = np.eye(5)
    if n_scales == 2:
        return columns
    if n_scales == 1:
        columns[:, 3] += columns[:, 4]
        return columns[:, :4]
    return columns[:, :3]


def _covariance(
    hessian: Float[np.ndarray, "k k"], mad_sigma_m: float, walls: WallSamples
) -> Float[np.ndarray, "4 4"]:
    """Of yaw, x, y and log scale (of x where there are two); zero where nothing was solved."""
    covariance = np.zeros((4, 4))
    n = min(len(hessian), 4)
    if len(walls.xy) == 0 or not hessian.any():
        return covariance
    per_observation = hessian[:n, :n] * (n_observations(walls) / walls.worth.sum())
    sigma_m = max(mad_sigma_m, 0.01)
    # What no wall holds gets a large sigma, not none.
    per_observation = per_observation + 1e-4 * np.eye(n)
    covariance[:n, :n] = sigma_m**2 * np.linalg.inv(per_observation)
    return covariance
