"""From refined hypotheses to an answer: which is taken, how sure it is, and what a user must know."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from planfit.alignment.options import AlignOptions
from planfit.alignment.refine import AlignmentHypothesis, differences
from planfit.alignment.wall_samples import WallSamples
from planfit.errors import OptionError
from planfit.findings import Finding, PlanKind
from planfit.floorplan import Floorplan

MAX_CANDIDATES = 4
"""Distinct alignments that are named."""
OPEN_M = 0.5
"""A translation that the walls leave this unsure (one standard deviation) is not determined by them."""
AS_RECORDED_SHARE = 0.8
"""The alignment that the scan's format records is taken where it explains this much of what the best does."""

DISAGREEMENT_DEG, DISAGREEMENT_M, DISAGREEMENT_SCALE = 0.7, 0.3, 0.01
"""Parts of the walk that disagree by more (one standard deviation) leave the alignment weak."""
DEFORMATION_SHARE = 0.005
"""A scan deformed by more of its size has no alignment within a degree: this is a degree over its half."""
MIN_SEGMENT_SCORE = 0.35
"""A fifth of the walk that the plan explains less of leaves the alignment weak: half of what right alignments
of undeformed scans have."""

MENDED_BY_WALLS = frozenset(
    (
        PlanKind.LITTLE_WALL_ON_PLAN,
        PlanKind.PARTS_DISAGREE,
        PlanKind.PART_OFF_PLAN,
        PlanKind.SCAN_DEFORMED,
    )
)
"""What a deformed scan gives rise to: the adjustment may mend it."""
SETTLED_BY_POINTS = frozenset(
    (PlanKind.AMBIGUOUS_PLACE, PlanKind.DIRECTION_OPEN, PlanKind.SCALE_OPEN)
)
"""What says that walls leave the place open: known points may settle it."""

MARGIN_WORTH, MIN_EVIDENCE = 2.0, 0.9
"""Score, and margin times the first, must add up to the second: what fits little must stand out more. Wrong
places that were sure by score and margin apart had 0.76 to 0.95 (quarters of walks, plans of other
buildings); right ones 0.77 to 1.47, one of 15 below 0.9 (`benchmarks/wrong_plans.py --part 0.25`)."""


MIN_SCORE = 0.5
"""Below this share of seen wall that the plan explains, an alignment is not accepted as sure."""
NULL_SCORE = 0.4
"""Where less of a part of the scan is explained, it is elsewhere: any plan of the same building may explain
so much, by what stands over each other."""
MIN_MARGIN = 0.05
"""The best alignment must beat the next by this share of wall, else the answer is ambiguous."""
DISTINCT_TRANSLATION_M = 1.0
"""Alignments nearer than this, with yaws within 5 degrees and scales within 3 %, are one."""
PRIOR_TRANSLATION_M = 5.0
"""Where the recorded poses are in the plan's axes, an alignment within this of them is
preferred as long as it explains 0.8 of what the best one does."""
PRIOR_YAW_DEG = 20.0
"""See `PRIOR_TRANSLATION_M`. Without it, a building that fits when turned about its middle would count
as being where the format says."""


@dataclass(frozen=True)
class SameWithin:
    """How near two alignments are to count as one. All of it must hold."""

    translation_m: float
    """Between where the two put the middle of the scan on the drawing, in metres of the later one."""
    yaw_deg: float
    scale: float
    """Difference of the logarithms of the scales."""

    @classmethod
    def distinct(cls) -> "SameWithin":
        """What a user would call two alignments."""
        return cls(DISTINCT_TRANSLATION_M, 5.0, 0.03)

    @classmethod
    def surveyed(cls) -> "SameWithin":
        """What surveyed points tell apart, and walls still do: points of another datum, by decimetres."""
        return cls(0.2, 1.0, 0.01)


@dataclass(frozen=True)
class Selection:
    """What is taken, and why not more."""

    taken: AlignmentHypothesis
    runner_up: AlignmentHypothesis | None
    candidates: tuple[AlignmentHypothesis, ...]
    is_as_recorded: bool
    is_mirrored: bool
    is_sure: bool
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class SegmentAgreement:
    """How far segments of the walk agree with the alignment of the whole."""

    covariance: Float[np.ndarray, "4 4"]
    """As `AlignmentHypothesis.covariance`, of leaving out segments."""
    scores: Float[np.ndarray, " segments"]
    deformation_m: float
    """RMS distance of the walls from where they lie when the scan may deform."""
    extent_m: float
    """Size of the scan."""


def is_same(
    hypotheses: Sequence[AlignmentHypothesis],
    reference: AlignmentHypothesis,
    walls: WallSamples,
    within: SameWithin,
) -> Bool[np.ndarray, " h"]:
    """Which of some hypotheses are the same alignment as a reference, judged at the middle of the walls.

    The one rule for this: the search drops repetitions by it, the refinement what has run together, and the
    selection tells candidates apart.
    """
    yaw, x, y, log_scale = differences(hypotheses, reference, walls.xy.mean(axis=0)).T
    scale_x, scale_y = np.array([each.scale_xy for each in hypotheses]).T
    return (
        (np.abs(yaw) <= np.deg2rad(within.yaw_deg))
        & (np.hypot(x * scale_x, y * scale_y) <= within.translation_m)
        & (np.abs(log_scale) <= within.scale)
    )


def keep_distinct(
    hypotheses: Sequence[AlignmentHypothesis],
    walls: WallSamples,
    within: SameWithin,
    max_count: int,
) -> list[AlignmentHypothesis]:
    """The first of each group that is one alignment, in their order; not more than `max_count`."""
    rest, kept = list(hypotheses), []
    while rest and len(kept) < max_count:
        kept.append(rest[0])
        repeats = is_same(rest, rest[0], walls, within)
        repeats[0] = True
        rest = [other for other, is_repeat in zip(rest, repeats, strict=True) if not is_repeat]
    return kept


def best_elsewhere(
    hypotheses: Sequence[AlignmentHypothesis],
    taken: AlignmentHypothesis,
    walls: WallSamples,
    within: SameWithin,
) -> AlignmentHypothesis | None:
    """The first hypothesis that is another alignment than the one taken."""
    same = is_same(hypotheses, taken, walls, within)
    return next((other for other, is_it in zip(hypotheses, same, strict=True) if not is_it), None)


def mirrored_from(as_drawn: float) -> float:
    """What the scan with left and right swapped must explain, so that the plan is mirrored, by what the plan
    explains as drawn at most."""
    return as_drawn + max(MIN_MARGIN, 0.25 * (1.0 - as_drawn))


def select_hypothesis(
    walls: WallSamples,
    hypotheses: Sequence[AlignmentHypothesis],
    recorded: AlignmentHypothesis | None,
    mirrored: AlignmentHypothesis | None,
    floorplan: Floorplan,
    options: AlignOptions,
) -> Selection:
    """Choose among refined hypotheses.

    Args:
        hypotheses: at least one, best first.
        recorded: what the scan's format claims, if it does.
        mirrored: best alignment of the scan with left and right swapped, if that was tried.

    Raises:
        OptionError: there are fewer distinct alignments than the candidate asked for.
    """
    within = SameWithin.distinct()
    candidates = tuple(keep_distinct(hypotheses, walls, within, MAX_CANDIDATES))
    taken, is_as_recorded = _taken(walls, hypotheses, candidates, recorded, options)
    runner_up = best_elsewhere(hypotheses, taken, walls, within)
    # The best as drawn, whichever the user takes: a worse one is no sign of a mirror.
    as_drawn = max(each.score for each in hypotheses)
    is_mirrored = mirrored is not None and mirrored.score > mirrored_from(as_drawn)
    is_weak = taken.score < MIN_SCORE
    margin = taken.score - (runner_up.score if runner_up else 0.0)
    is_close = runner_up is not None and margin < MIN_MARGIN
    is_outdone = margin < -MIN_MARGIN and options.candidate > 1
    is_ambiguous = is_close and not is_as_recorded and options.candidate == 1
    is_thin = _is_thin(taken.score, margin) and not is_as_recorded and options.candidate == 1
    found: list[Finding] = []
    if recorded is not None and options.candidate == 1 and not is_as_recorded:
        apart_m, apart_deg = apart(taken, recorded, walls)
        found.append(
            Finding(PlanKind.NOT_AS_RECORDED, {"apart_m": apart_m, "apart_deg": apart_deg})
        )
    if is_mirrored and mirrored is not None:
        facts = {"mirrored_wall_share": mirrored.score, "wall_share": as_drawn}
        facts |= {"was_mirrored": floorplan.source.is_mirrored}
        found.append(Finding(PlanKind.PLAN_MIRRORED, facts))
    elif is_weak and not (is_outdone and as_drawn >= MIN_SCORE):
        # That another place fits better says enough: the plan is that of the building.
        facts = {"wall_share": taken.score, "min_wall_share": MIN_SCORE}
        facts |= {"is_plan_metric": floorplan.is_metric}
        found.append(Finding(PlanKind.LITTLE_WALL_ON_PLAN, facts))
    left_open = _left_open(taken)
    if runner_up is not None and is_close and not is_mirrored:
        kind = PlanKind.OTHER_PLACE_THAN_ASKED
        if is_outdone:
            kind = PlanKind.OTHER_PLACE_BETTER
        elif is_as_recorded:
            kind = PlanKind.OTHER_PLACE_THAN_RECORDED
        elif is_ambiguous:
            kind = PlanKind.AMBIGUOUS_PLACE
        found.append(Finding(kind, _rival_facts(taken, runner_up, walls)))
    elif runner_up is not None and is_thin and not (is_mirrored or is_weak):
        shares = {"wall_share": taken.score, "other_wall_share": runner_up.score}
        found.append(Finding(PlanKind.LITTLE_MARGIN, shares))
    return Selection(
        taken,
        runner_up,
        candidates,
        is_as_recorded,
        is_mirrored,
        is_sure=not (is_weak or is_ambiguous or is_thin or is_mirrored or left_open),
        findings=(*found, *left_open),
    )


def with_segments(
    selection: Selection, taken: AlignmentHypothesis, agreement: SegmentAgreement
) -> Selection:
    """The selection with its last refinement, weak where segments of the walk do not agree with it."""
    covariance, scores = agreement.covariance, agreement.scores
    larger = np.trace(covariance) > np.trace(taken.covariance)
    taken = replace(taken, covariance=covariance if larger else taken.covariance)
    yaw, x, y, scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    yaw_deg, translation_m = np.rad2deg(yaw), float(np.hypot(x, y))
    found = []
    if yaw_deg > DISAGREEMENT_DEG or translation_m > DISAGREEMENT_M or scale > DISAGREEMENT_SCALE:
        facts = {"sigma_yaw_deg": float(yaw_deg), "sigma_m": translation_m}
        found.append(Finding(PlanKind.PARTS_DISAGREE, facts | {"sigma_scale_share": float(scale)}))
    if len(scores) and scores.min() < MIN_SEGMENT_SCORE and not selection.is_mirrored:
        k, n = int(np.argmin(scores)), len(scores)
        facts = {"from_share": k / n, "to_share": (k + 1) / n, "wall_share": float(scores[k])}
        found.append(Finding(PlanKind.PART_OFF_PLAN, facts))
    if agreement.deformation_m > DEFORMATION_SHARE * agreement.extent_m and not found:
        facts = {"deformation_m": agreement.deformation_m, "extent_m": agreement.extent_m}
        found.append(Finding(PlanKind.SCAN_DEFORMED, facts))
    candidates = tuple(taken if each is selection.taken else each for each in selection.candidates)
    return replace(
        selection,
        taken=taken,
        candidates=candidates,
        is_sure=selection.is_sure and not found,
        findings=(*selection.findings, *found),
    )


def _taken(
    walls: WallSamples,
    hypotheses: Sequence[AlignmentHypothesis],
    candidates: tuple[AlignmentHypothesis, ...],
    recorded: AlignmentHypothesis | None,
    options: AlignOptions,
) -> tuple[AlignmentHypothesis, bool]:
    """The candidate asked for, the recorded alignment if good enough, or the best; and whether recorded."""
    if options.candidate > len(candidates):
        raise OptionError(
            f"align.candidate: expected 1 to {len(candidates)}, the alignments that were found, "
            f"found {options.candidate}"
        )
    best = candidates[options.candidate - 1]
    if options.candidate > 1 or recorded is None:
        return best, False
    any_scale = SameWithin(PRIOR_TRANSLATION_M, PRIOR_YAW_DEG, np.inf)
    is_near = is_same(hypotheses, recorded, walls, any_scale)
    near = next((each for each, is_it in zip(hypotheses, is_near, strict=True) if is_it), None)
    if near is not None and near.score >= AS_RECORDED_SHARE * best.score:
        return near, True
    return best, False


def _rival_facts(
    taken: AlignmentHypothesis, other: AlignmentHypothesis, walls: WallSamples
) -> dict[str, float]:
    apart_m, apart_deg = apart(taken, other, walls)
    return {
        "wall_share": taken.score,
        "other_wall_share": other.score,
        "apart_m": apart_m,
        "apart_deg": apart_deg,
        "metres_per_unit": taken.metres_per_unit,
        "other_metres_per_unit": other.metres_per_unit,
    }


def outweighs(score: float, other_score: float) -> bool:
    """Whether so much more of the wall is explained that the other alignment is no rival."""
    margin = score - other_score
    is_enough = score >= MIN_SCORE and margin >= MIN_MARGIN
    return is_enough and not _is_thin(score, margin)


def apart(
    a: AlignmentHypothesis, b: AlignmentHypothesis, walls: WallSamples
) -> tuple[float, float]:
    """How far apart two alignments put the middle of the scan (m, of the first), and their yaws (deg)."""
    yaw, x, y, _ = differences([a], b, walls.xy.mean(axis=0))[0]
    return float(np.hypot(*(np.array([x, y]) * a.scale_xy))), float(np.rad2deg(abs(yaw)))


def _is_thin(score: float, margin: float) -> bool:
    """Whether so little wall fits, by so small a margin, that another building's plan may do as well."""
    return score + MARGIN_WORTH * margin < MIN_EVIDENCE


def _left_open(taken: AlignmentHypothesis) -> list[Finding]:
    """Where walls leave a direction or the scale open: a bare corridor, walls of one direction."""
    sigma_m = float(np.sqrt(max(np.linalg.eigvalsh(taken.covariance[1:3, 1:3])[-1], 0.0)))
    if sigma_m > OPEN_M:
        return [Finding(PlanKind.DIRECTION_OPEN, {"sigma_m": sigma_m})]
    variance = float(taken.covariance[3, 3])
    if variance > 0.05**2:
        return [Finding(PlanKind.SCALE_OPEN, {"sigma_share": float(np.sqrt(variance))})]
    return []
