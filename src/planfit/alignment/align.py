"""Where on the plan the scan is: yaw, translation and, where the plan has no unit, scale.

Every alignment is searched coarsely, the best are refined against the faces, and distinct ones compete, so
that a building which fits its plan in two ways is reported and not guessed (ADR 5).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.alignment.evidence import PlanEvidence, evidence_findings, plan_evidence, with_way
from planfit.alignment.nonrigid import refine_nonrigid
from planfit.alignment.options import AlignOptions, ControlPoint, fit_control_points, parse_start
from planfit.alignment.refine import (
    AlignmentHypothesis,
    RefineSteps,
    explained,
    jackknife_covariance,
    refine_hypothesis,
    rotation_2d,
    segment_scores,
)
from planfit.alignment.search import Region, candidate_yaws, scale_range, search_hypotheses
from planfit.alignment.selection import (
    PRIOR_TRANSLATION_M,
    PRIOR_YAW_DEG,
    SameWithin,
    SegmentAgreement,
    Selection,
    apart,
    is_same,
    keep_distinct,
    mirrored_from,
    outweighs,
    select_hypothesis,
    with_segments,
)
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.errors import FloorplanError, OptionError, ScanError
from planfit.findings import Finding, PlanKind, sentences_of
from planfit.floorplan import Floorplan
from planfit.geometry.se3 import wrap_angle
from planfit.runtime import short_repr

COARSE_SAMPLES, QUICK_SAMPLES = 4000, 400
"""Samples of wall that the first two stages look at."""
FULL_HYPOTHESES = 10
"""Hypotheses that are refined with all samples."""
RUN_TOGETHER = SameWithin(translation_m=0.3, yaw_deg=1.0, scale=0.005)
"""Hypotheses that the quick refinement brought this near to each other are one."""
FULL_DISTANCES_M = (1.0, 0.7, 0.5, 0.5, 0.5)
"""Distances of the last refinement. Narrower ones keep to the part of a deformed scan that fits best, wider
ones take in walls that the plan has elsewhere (0.35 and 1.0 m were tried: more of the battery is off)."""


@dataclass(frozen=True)
class HalfThickness:
    """Half the thickness of walls that a plan draws by their centre lines: the median of what was seen."""

    half_m: float
    sigma_m: float
    drawn_m: float
    """The same as drawn: 0 of lines."""
    score: float
    """Share of seen wall that the plan explains with it."""
    metres_per_unit: float = 1.0
    """Of the plan, where that was found."""


@dataclass(frozen=True)
class OtherScale:
    """A scale at which a plan in metres, taken as drawn, fits the scan clearly better."""

    metres_per_unit: float
    """What the plan's coordinates would be multiplied by."""
    sigma: float
    """Standard deviation of that, as a share."""
    cost_gain: float
    """Full cost of all measurements with the walls as drawn, less that at this scale; squared sigmas."""


@dataclass(frozen=True)
class Alignment:
    """The alignment of the scan with the plan that was taken, what else fits, and how sure it is."""

    plan_from_level: Float[np.ndarray, "4 4"]
    """To the plan in metres."""
    score: float
    """Share of seen wall that the plan explains."""
    runner_up: AlignmentHypothesis | None
    """The best alignment elsewhere."""
    is_as_recorded: bool = False
    """Whether it agrees with the alignment that the scan's format claims."""
    is_sure: bool = True
    """Whether enough wall lies on the plan, and clearly more than anywhere else."""
    findings: tuple[Finding, ...] = ()
    """What a user should know."""
    scale_xy: tuple[float, float] = (1.0, 1.0)
    """Metres of one unit of the plan, along its x and its y: for a plan in metres 1, or what its coordinates
    are to be multiplied by where it is off in scale."""
    covariance: Float[np.ndarray, "4 4"] | None = None
    """Of yaw (rad), x and y (m) of the scan's middle, and log scale."""
    candidates: tuple[AlignmentHypothesis, ...] = ()
    """Distinct alignments, best first, the taken one among them."""
    is_mirrored: bool = False
    """Whether the scan fits the plan clearly better when left and right are swapped."""
    is_plan_rescaled: bool = False
    """Whether a plan in metres was taken at another scale than it is drawn at."""
    other_scale: OtherScale | None = None
    """Where a plan in metres was taken as drawn and fits clearly better at another scale: that one."""
    evidence: PlanEvidence | None = None
    """What the camera walked and saw through, where that was looked at."""
    half_thickness: HalfThickness | None = None
    """Half the thickness that was given to walls drawn by their centre lines; None where none was."""
    is_surveyed: bool = False
    """Whether surveyed points say that the scan is here: other places that fit as well are no rivals then."""

    __repr__ = short_repr

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """The findings, and the scale where that of the plan was off."""
        if not self.is_plan_rescaled:
            return self.findings
        facts = {"scale_ratio": self.metres_per_unit, "sigma_share": self.scale_sigma}
        return (*self.findings, Finding(PlanKind.PLAN_RESCALED, facts))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know, in words."""
        return sentences_of(self.findings)

    @property
    def is_plan_doubted(self) -> bool:
        """Whether a plan in metres fits clearly better at another scale than drawn, taken or not."""
        return self.is_plan_rescaled or self.other_scale is not None

    @property
    def fitting_scale(self) -> float:
        """Metres of one unit of the plan at which it fits best, whether or not that was taken."""
        other = self.other_scale
        return self.metres_per_unit if other is None else other.metres_per_unit

    @property
    def margin(self) -> float:
        """Score of the alignment taken less that of the best one elsewhere."""
        return self.score - (self.runner_up.score if self.runner_up else 0.0)

    @property
    def metres_per_unit(self) -> float:
        """Geometric mean of both scales."""
        return float(np.sqrt(self.scale_xy[0] * self.scale_xy[1]))

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the scale, as a share of it; 0 where it was known."""
        return 0.0 if self.covariance is None else float(np.sqrt(max(self.covariance[3, 3], 0.0)))

    @property
    def hypothesis(self) -> AlignmentHypothesis:
        """What was taken, with its score."""
        taken = AlignmentHypothesis.from_transform(self.plan_from_level)
        return replace(taken, score=self.score, scale_xy=self.scale_xy)

    def rescaled(
        self, factor: float, sigma: float, middle_plan: Float[np.ndarray, " 2"]
    ) -> "Alignment":
        """The same alignment at a scale times `factor`, now known to `sigma` (share) where finite.

        `middle_plan` (m) stays at its spot of the drawing.
        """
        moved = self.plan_from_level.copy()
        moved[:2, 3] += (factor - 1.0) * middle_plan
        covariance = self.covariance
        if covariance is not None and np.isfinite(sigma):
            # What yaw and translation shared with the old error of the scale is gone.
            covariance = covariance.copy()
            covariance[3, :] = covariance[:, 3] = 0.0
            covariance[3, 3] = sigma**2
        scale_xy = (self.scale_xy[0] * factor, self.scale_xy[1] * factor)
        return replace(self, plan_from_level=moved, scale_xy=scale_xy, covariance=covariance)


def align(
    walls: WallSamples,
    floorplan: Floorplan,
    options: AlignOptions | None = None,
    recorded: Float[np.ndarray, "4 4"] | None = None,
    control_points: Sequence[ControlPoint] = (),
) -> Alignment:
    """Find the yaw, translation and scale that bring most scanned wall onto faces that look the same way.

    Args:
        walls: points (m, 2) and normals (m, 2) of scanned wall seen from above, metres, in axes whose z is
            up (the level frame): `WallSamples`, or `sample_walls` of the ends (k, 2, 2) of wall patches.
        floorplan: in metres, or in a unit of its own, which is then found.
        options: defaults to a search of everything.
        recorded: plan_from_level that the scan's format claims, if it does; for plans in metres.
        control_points: points of the scan whose location on the plan is known.

    Raises:
        ScanError: there is no wall.
        FloorplanError: the plan has too few faces to tell an alignment.
        OptionError: control points disagree, or there is no such candidate.
    """
    return align_within(walls, floorplan, options or AlignOptions(), 0.0, recorded, control_points)


def is_clearly_better(
    found: Alignment, other: Alignment, walls: WallSamples
) -> tuple[float, float] | None:
    """How far apart (m, deg) two alignments of a scan are, where the first is at another place and explains
    clearly more of the walls; else None."""
    here, there = other.hypothesis, found.hypothesis
    within = SameWithin.surveyed() if other.is_surveyed else SameWithin.distinct()
    if is_same([there], here, walls, within)[0]:
        return None
    if found.is_mirrored or not outweighs(found.score, other.score):
        return None
    return apart(there, here, walls)


def align_within(
    walls: WallSamples,
    floorplan: Floorplan,
    options: AlignOptions,
    metric_slack: float,
    recorded: Float[np.ndarray, "4 4"] | None = None,
    control_points: Sequence[ControlPoint] = (),
) -> Alignment:
    """As `align`, with the scale of a plan in metres searched too, within a share `metric_slack` of 1."""
    require_walls(walls, floorplan)
    scales, yaws, regions = _narrowed(walls, floorplan, options, metric_slack, control_points)
    claimed = None
    if recorded is not None and floorplan.is_metric:
        claimed = AlignmentHypothesis.from_transform(recorded)
    starts = [claimed] if claimed else []
    hypotheses = _refined(walls, floorplan, scales, yaws, regions, starts, options)
    mirrored = None
    if mirrored_from(hypotheses[0].score) < 1.0 and not regions:
        flipped = walls.mirrored()
        flipped_yaws = candidate_yaws(flipped, floorplan)
        mirrored = _refined(flipped, floorplan, scales, flipped_yaws, (), [], options)[0]
    selection = select_hypothesis(walls, hypotheses, claimed, mirrored, floorplan, options)
    n_scales = _n_scales(floorplan, scales, options)
    return _alignment(_with_nonrigid(selection, walls, floorplan, n_scales), walls, floorplan)


def _with_nonrigid(
    selection: Selection, walls: WallSamples, floorplan: Floorplan, n_scales: int
) -> Selection:
    """The selection with the taken hypothesis refined non-rigidly, and judged by segments of the walk."""
    samples, rigid = thin(walls), selection.taken
    nonrigid = refine_nonrigid(samples, floorplan, rigid, n_scales)
    taken = replace(
        rigid, yaw=nonrigid.yaw, translation=nonrigid.translation, scale_xy=nonrigid.scale_xy
    )
    score, occluded_share = explained(samples, floorplan, taken)
    taken = replace(taken, score=score, occluded_share=occluded_share)
    taken = with_way(walls, floorplan, taken)
    steps = RefineSteps(FULL_DISTANCES_M, n_scales)
    covariance = jackknife_covariance(samples, floorplan, rigid, steps)
    scores = segment_scores(samples, floorplan, taken)
    agreement = SegmentAgreement(covariance, scores, nonrigid.deformation_m, walls.extent_m)
    return with_segments(selection, taken, agreement)


def require_walls(walls: WallSamples, floorplan: Floorplan) -> None:
    """Raise unless there is wall on both sides to compare."""
    if len(walls.xy) < 2:
        raise ScanError(
            "the scan: expected wall patches to align it by, found none; give wall masks, or scan "
            "more of the walls"
        )
    if len(floorplan) < 3:
        raise FloorplanError(
            f"{floorplan.name}: expected at least 3 wall faces to align a scan with, "
            f"found {len(floorplan)}; is it the right layer, storey and page?"
        )


def _alignment(selection: Selection, walls: WallSamples, floorplan: Floorplan) -> Alignment:
    taken = selection.taken
    evidence = plan_evidence(walls, floorplan, taken)
    against, besides = evidence_findings(evidence)
    return Alignment(
        plan_from_level=taken.plan_from_level,
        score=taken.score,
        runner_up=selection.runner_up,
        is_as_recorded=selection.is_as_recorded,
        is_sure=selection.is_sure and not against,
        findings=(*selection.findings, *against, *besides),
        scale_xy=taken.scale_xy,
        covariance=taken.covariance,
        candidates=selection.candidates,
        is_mirrored=selection.is_mirrored,
        evidence=evidence,
    )


def _narrowed(
    walls: WallSamples,
    floorplan: Floorplan,
    options: AlignOptions,
    metric_slack: float,
    control_points: Sequence[ControlPoint],
) -> tuple[tuple[float, float], Float[np.ndarray, " t"], tuple[Region, ...]]:
    """Scales, yaws and regions to search, after all that the user knows."""
    known = 1.0 if floorplan.is_metric else options.metres_per_unit or None
    if known is None:
        scales = scale_range(walls, floorplan)
    else:
        slack = metric_slack if floorplan.is_metric else options.scale_tolerance
        scales = (known / (1 + slack), known * (1 + slack))
    yaws = candidate_yaws(walls, floorplan)
    tolerance_m = options.control_point_tolerance_m
    regions = [Region(point.level_xy, point.plan_xy, tolerance_m) for point in control_points]
    if len(control_points) > 1:
        exact = known if scales[0] == scales[1] else None
        yaw, _, scale = fit_control_points(control_points, exact, tolerance_m)
        yaws = np.array([yaw])
        scales = scales if exact else (scale / 1.02, scale * 1.02)
    if options.start:
        translation, yaw = parse_start(options.start)
        near = np.abs(np.rad2deg(wrap_angle(yaws - yaw))) < PRIOR_YAW_DEG
        yaws = np.append(yaws[near], yaw)
        centre = walls.xy.mean(axis=0)
        at_m = rotation_2d(yaw) @ centre + translation
        if scales[0] != scales[1]:
            raise OptionError(
                "align.start: expected a plan whose scale is known, found one without unit; "
                "give align.metres-per-unit too"
            )
        regions.append(Region(centre, at_m / scales[0], PRIOR_TRANSLATION_M))
    return scales, yaws, tuple(regions)


def _refined(
    walls: WallSamples,
    floorplan: Floorplan,
    scales: tuple[float, float],
    yaws: Float[np.ndarray, " t"],
    regions: tuple[Region, ...],
    starts: Sequence[AlignmentHypothesis],
    options: AlignOptions,
) -> list[AlignmentHypothesis]:
    """Refined hypotheses, best first; the given starts are refined beside those found."""
    coarse = thin(walls, COARSE_SAMPLES)
    found = [*search_hypotheses(coarse, floorplan, scales, yaws, regions), *starts]
    n_scales = _n_scales(floorplan, scales, options)
    # The first look holds a scale common to both axes: few samples do not tell two.
    quick = RefineSteps((1.5, 1.0, 0.7, 0.5), min(n_scales, 1))
    full = RefineSteps(FULL_DISTANCES_M, n_scales)
    samples = thin(walls, QUICK_SAMPLES)
    refined = [refine_hypothesis(samples, floorplan, each, quick) for each in found]
    refined = [each for each in refined if _is_allowed(each, scales, regions)] or refined[-1:]
    samples = thin(walls)
    best = keep_distinct(_best_first(refined), samples, RUN_TOGETHER, FULL_HYPOTHESES)
    found = [refine_hypothesis(samples, floorplan, each, full) for each in best]
    return _best_first([with_way(walls, floorplan, each) for each in found])


def _best_first(hypotheses: Sequence[AlignmentHypothesis]) -> list[AlignmentHypothesis]:
    return sorted(hypotheses, key=lambda hypothesis: -hypothesis.score)


def _n_scales(floorplan: Floorplan, scales: tuple[float, float], options: AlignOptions) -> int:
    """Scales to refine: none where it is known exactly."""
    if options.two_scales and not floorplan.is_metric:
        return 2
    return int(scales[0] < scales[1])


def _is_allowed(
    hypothesis: AlignmentHypothesis, scales: tuple[float, float], regions: tuple[Region, ...]
) -> bool:
    """Whether refinement left the hypothesis within what the user knows, with some slack for drift."""
    scale = hypothesis.metres_per_unit
    if not 0.97 * scales[0] <= scale <= 1.03 * scales[1]:
        return False
    rotation = rotation_2d(hypothesis.yaw)
    return all(
        np.linalg.norm(rotation @ r.level_xy + hypothesis.translation - scale * r.plan_xy)
        <= 1.5 * r.radius_m
        for r in regions
    )
