"""Where on the plan the scan is: turn, shift and, where the plan has no unit, scale.

Every place is searched coarsely, the best are refined against the faces, and distinct ones compete, so
that a building which fits its plan in two ways is reported and not guessed (ADR 5).
"""

from dataclasses import dataclass, replace

import numpy as np

from planfit.align.control_points import ControlPoint, fit_control_points, parse_start
from planfit.align.likelihood_field import wrap_angle
from planfit.align.nonrigid import refine_bent
from planfit.align.options import AlignOptions
from planfit.align.refine import (
    AlignmentHypothesis,
    RefineSteps,
    explained,
    part_covariance,
    refine_hypothesis,
    rotation_2d,
    stretch_scores,
)
from planfit.align.scales import scale_range
from planfit.align.search import Region, search_hypotheses
from planfit.align.selection import Stretches, Verdict, is_distinct, judge, with_stretches
from planfit.align.turns import candidate_turns
from planfit.align.wall_samples import WallSamples, thin
from planfit.errors import FloorplanError, OptionError, ScanError
from planfit.floorplan import Floorplan

COARSE_SAMPLES, QUICK_SAMPLES, FULL_SAMPLES = 4000, 400, 2500
"""Samples of wall that the three stages look at."""
FULL_PLACES = 10
"""Places that are refined with all samples."""
FULL_DISTANCES_M = (1.0, 0.7, 0.5, 0.5, 0.5)
"""Distances of the last refinement. Narrower ones keep to the part of a bent scan that fits best, wider
ones take in walls that the plan has elsewhere (0.35 and 1.0 m were tried: more of the battery is off)."""
CLEAR_SCORE, CLEAR_MARGIN = 0.55, 0.25
"""From these on, a place is so clear that the mirrored scan cannot be clearly better, and is not tried."""


@dataclass(frozen=True)
class Alignment:
    """The place of the scan on the plan that was taken, what else fits, and how sure it is."""

    plan_from_level: np.ndarray  # (4, 4), to the plan in metres
    score: float
    """Share of seen wall that the plan explains."""
    runner_up: AlignmentHypothesis | None
    """The best place elsewhere."""
    is_as_recorded: bool = False
    """Whether it agrees with the place that the scan's format claims."""
    is_sure: bool = True
    """Whether enough wall lies on the plan, and clearly more than anywhere else."""
    warnings: tuple[str, ...] = ()
    """What a user should know, in words."""
    scale_xy: tuple[float, float] = (1.0, 1.0)
    """Metres of one unit of the plan, along its x and its y; 1 for a plan in metres."""
    covariance: np.ndarray | None = None
    """(4, 4) of turn (rad), x and y (m) of the scan's middle, and log scale."""
    candidates: tuple[AlignmentHypothesis, ...] = ()
    """Distinct places, best first, the taken one among them."""
    is_mirrored: bool = False
    """Whether the scan fits the plan clearly better when left and right are swapped."""

    @property
    def margin(self) -> float:
        """Score of the place taken less that of the best place elsewhere."""
        return self.score - (self.runner_up.score if self.runner_up else 0.0)

    @property
    def metres_per_unit(self) -> float:
        """Geometric mean of both scales."""
        return float(np.sqrt(self.scale_xy[0] * self.scale_xy[1]))

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the scale, as a share of it; 0 where it was known."""
        return 0.0 if self.covariance is None else float(np.sqrt(max(self.covariance[3, 3], 0.0)))

    def rescaled(self, factor: float, spread: float, middle_plan: np.ndarray) -> "Alignment":
        """The same place at a scale times `factor`, now known within `spread` (share) where finite.

        `middle_plan` (2,) m stays at its spot of the drawing.
        """
        moved = self.plan_from_level.copy()
        moved[:2, 3] += (factor - 1.0) * middle_plan
        covariance = self.covariance
        if covariance is not None and np.isfinite(spread):
            # What turn and shift shared with the old error of the scale is gone.
            covariance = covariance.copy()
            covariance[3, :] = covariance[:, 3] = 0.0
            covariance[3, 3] = spread**2
        scale_xy = (self.scale_xy[0] * factor, self.scale_xy[1] * factor)
        return replace(self, plan_from_level=moved, scale_xy=scale_xy, covariance=covariance)


def align(
    walls: WallSamples,
    floorplan: Floorplan,
    options: AlignOptions,
    recorded: np.ndarray | None = None,
    control_points: tuple[ControlPoint, ...] = (),
) -> Alignment:
    """Find the turn, shift and scale that bring most scanned wall onto faces that look the same way.

    Args:
        walls: samples, level frame.
        floorplan: in metres, or in a unit of its own.
        options: see there.
        recorded: plan_from_level (4, 4) that the scan's format claims, if it does; for plans in metres.
        pins: points of the scan whose places are known.

    Raises:
        ScanError: there is no wall.
        FloorplanError: the plan has too few faces to tell a place.
        OptionError: pins disagree, or there is no such candidate.
    """
    require_walls(walls, floorplan)
    scales, turns, regions = _narrowed(walls, floorplan, options, control_points)
    recorded = recorded if floorplan.is_metric else None
    starts = [] if recorded is None else [AlignmentHypothesis(_yaw(recorded), recorded[:2, 3], 0.0)]
    fits = _fits(walls, floorplan, scales, turns, regions, starts, options)
    mirrored = None
    if not _is_clear(fits, walls, options) and not regions:
        flipped = walls.mirrored()
        flipped_turns = candidate_turns(flipped, floorplan, options.max_turns)
        mirrored = _fits(flipped, floorplan, scales, flipped_turns, (), [], options)[0]
    verdict = judge(walls, fits, recorded, mirrored, floorplan, options)
    return _alignment(_settled(verdict, walls, floorplan, _n_scales(floorplan, scales, options)))


def _settled(verdict: Verdict, walls: WallSamples, floorplan: Floorplan, n_scales: int) -> Verdict:
    """The verdict with the taken place fitted as a bent scan, and judged by stretches of the walk."""
    samples, weights = thin(walls, FULL_SAMPLES)
    fit = verdict.taken
    place = refine_bent(samples, weights, floorplan, fit, n_scales)
    bent = replace(fit, yaw=place.yaw, shift=place.shift, scale_xy=place.scale_xy)
    score, crossed_share = explained(samples, weights, floorplan, bent)
    bent = replace(bent, score=score, crossed_share=crossed_share)
    spread = part_covariance(
        samples, weights, floorplan, fit, RefineSteps(FULL_DISTANCES_M, n_scales)
    )
    scores = stretch_scores(samples, weights, floorplan, bent)
    stretches = Stretches(spread, scores, place.bend_m, walls.extent_m)
    return with_stretches(verdict, bent, stretches)


def require_walls(walls: WallSamples, floorplan: Floorplan) -> None:
    """Raise unless there is wall on both sides to compare."""
    if len(walls.xy) < 2:
        raise ScanError(
            "the scan: expected pieces of wall to place it by, found none; give wall masks, or scan "
            "more of the walls"
        )
    if len(floorplan) < 3:
        raise FloorplanError(
            f"{floorplan.name}: expected at least 3 wall faces to place a scan by, "
            f"found {len(floorplan)}; is it the right layer, storey and page?"
        )


def _alignment(verdict: Verdict) -> Alignment:
    taken = verdict.taken
    return Alignment(
        plan_from_level=taken.plan_from_level,
        score=taken.score,
        runner_up=verdict.runner_up,
        is_as_recorded=verdict.is_as_recorded,
        is_sure=verdict.is_sure,
        warnings=verdict.warnings,
        scale_xy=taken.scale_xy,
        covariance=taken.covariance,
        candidates=verdict.candidates,
        is_mirrored=verdict.is_mirrored,
    )


def _narrowed(
    walls: WallSamples,
    floorplan: Floorplan,
    options: AlignOptions,
    control_points: tuple[ControlPoint, ...],
) -> tuple[tuple[float, float], np.ndarray, tuple[Region, ...]]:
    """Scales, turns and regions to search, after all that the user knows."""
    known = 1.0 if floorplan.is_metric else options.metres_per_unit or None
    if known is None:
        scales = scale_range(walls, floorplan)
    else:
        slack = 0.0 if floorplan.is_metric else options.scale_tolerance
        scales = (known / (1 + slack), known * (1 + slack))
    turns = candidate_turns(walls, floorplan, options.max_turns)
    regions = [
        Region(pin.level_xy, pin.plan_xy, options.control_point_tolerance_m)
        for pin in control_points
    ]
    if len(control_points) > 1:
        exact = known if scales[0] == scales[1] else None
        yaw, _, scale = fit_control_points(control_points, exact, options.control_point_tolerance_m)
        turns = np.array([yaw])
        scales = scales if exact else (scale / 1.02, scale * 1.02)
    if options.start:
        shift, yaw = parse_start(options.start)
        near = np.abs(np.rad2deg(wrap_angle(turns - yaw))) < options.near_recorded_deg
        turns = np.append(turns[near], yaw)
        centre = walls.xy.mean(axis=0)
        at_m = rotation_2d(yaw) @ centre + shift
        if scales[0] != scales[1]:
            raise OptionError(
                "align.start: expected a plan whose scale is known, found one without unit; "
                "give align.metres-per-unit too"
            )
        regions.append(Region(centre, at_m / scales[0], options.near_recorded_m))
    return scales, turns, tuple(regions)


def _fits(
    walls: WallSamples,
    floorplan: Floorplan,
    scales: tuple[float, float],
    turns: np.ndarray,
    regions: tuple[Region, ...],
    starts: list[AlignmentHypothesis],
    options: AlignOptions,
) -> list[AlignmentHypothesis]:
    """Refined places, best first; the given starts are refined beside those found."""
    coarse, _ = thin(walls, COARSE_SAMPLES)
    places = search_hypotheses(coarse, floorplan, scales, turns, options, regions) + starts
    n_scales = _n_scales(floorplan, scales, options)
    # The first look holds a scale common to both axes: few samples do not tell two.
    quick = RefineSteps((1.5, 1.0, 0.7, 0.5), min(n_scales, 1))
    full = RefineSteps(FULL_DISTANCES_M, n_scales)
    samples, weights = thin(walls, QUICK_SAMPLES)
    fits = [refine_hypothesis(samples, weights, floorplan, place, quick) for place in places]
    fits = [fit for fit in fits if _is_allowed(fit, scales, regions)] or fits[-1:]
    fits.sort(key=lambda fit: -fit.score)
    samples, weights = thin(walls, FULL_SAMPLES)
    best = _distinct(fits, samples, options)[:FULL_PLACES]
    refined = [refine_hypothesis(samples, weights, floorplan, fit, full) for fit in best]
    return sorted(refined, key=lambda fit: -fit.score)


def _n_scales(floorplan: Floorplan, scales: tuple[float, float], options: AlignOptions) -> int:
    """Scales to refine: none where it is known exactly."""
    if options.two_scales and not floorplan.is_metric:
        return 2
    return int(scales[0] < scales[1])


def _is_clear(fits: list[AlignmentHypothesis], walls: WallSamples, options: AlignOptions) -> bool:
    """Whether the best place stands alone."""
    rivals = (f.score for f in fits if is_distinct(f, fits[0], walls, options))
    return fits[0].score >= CLEAR_SCORE and fits[0].score - max(rivals, default=0.0) >= CLEAR_MARGIN


def _is_allowed(
    fit: AlignmentHypothesis, scales: tuple[float, float], regions: tuple[Region, ...]
) -> bool:
    """Whether refinement left the place within what the user knows, with some slack for drift."""
    if not 0.97 * scales[0] <= fit.metres_per_unit <= 1.03 * scales[1]:
        return False
    turn = rotation_2d(fit.yaw)
    return all(
        np.linalg.norm(turn @ r.level_xy + fit.shift - fit.metres_per_unit * r.plan_xy)
        <= 1.5 * r.radius_m
        for r in regions
    )


def _distinct(
    fits: list[AlignmentHypothesis], walls: WallSamples, options: AlignOptions
) -> list[AlignmentHypothesis]:
    """The first of each group of fits that ended at the same place."""
    slim = replace(options, distinct_m=0.3, distinct_deg=1.0, distinct_scale=0.005)
    kept: list[AlignmentHypothesis] = []
    for fit in fits:
        if all(is_distinct(fit, other, walls, slim) for other in kept):
            kept.append(fit)
    return kept


def _yaw(transform: np.ndarray) -> float:
    return float(np.arctan2(transform[1, 0], transform[0, 0]))
