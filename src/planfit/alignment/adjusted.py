"""The alignment judged again once the walls have pulled.

Before the adjustment, a scan that drift has bent fits nowhere well, and what holds of the bent scan need not
hold of the adjusted one. So the walls are scored again where the adjusted poses put them, against the same
competitors."""

from dataclasses import dataclass, replace

import numpy as np

from planfit.alignment.align import Alignment, OtherScale
from planfit.alignment.evidence import NOTHING_JUDGED, PlanEvidence, plan_evidence
from planfit.alignment.options import AlignOptions
from planfit.alignment.plan_scale import is_of_lines
from planfit.alignment.refine import (
    AlignmentHypothesis,
    RefineSteps,
    explained,
    refine_hypothesis,
)
from planfit.alignment.selection import (
    MARGIN_WORTH,
    MIN_EVIDENCE,
    MIN_MARGIN,
    MIN_SCORE,
    SameWithin,
    is_same,
)
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.findings import Finding, PlanKind
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.runtime import short_repr

WEAK_SCORE, CLEAR_RATIO, GIVEN_RATIO, SEEN_THROUGH = 0.25, 1.5, 1.25, 0.05
"""With half of the plan's walls missing, it explains 0.27 to 0.5 of what is seen. A place is sure
nevertheless that explains so many times as much as any other (less is asked where the place was given), or a
given one where the camera looked through so few of the walls drawn. Plans of other buildings explain up to
0.5, as much or more elsewhere, and a fifth to a third of the wall is seen through theirs."""

RESCALED_EVIDENCE, RESCALED_SCORE = 1.2, 0.9
"""What score and margin together, or the score alone, must come to where a plan in metres was taken at
another scale: plans are seldom off, and with the scale free the plans of other buildings fit better (to 0.94
and 0.69; right ones from 1.12 and, on a building site, 0.74)."""

OTHER_PLACE_SCORE = MIN_SCORE
"""Where the camera saw through most of the plan's wall and less of what it saw than this lies on the plan, it
is another place's, even where the scan was given its place. Measured with adjusted walls: plans of other
buildings 0.26 to 0.37 of the wall on the plan and 0.63 to 0.71 seen through; half of the walls missing 0.30
and 0.21, a wing rebuilt 0.49 and 0.50, half as many added 0.65 and 0.50."""

TIE, TIE_SCORE = 0.05, 0.75
"""Where so much is explained, a place that explains this little more is a tie: symmetric rooms, corridors."""


@dataclass(frozen=True)
class AdjustedAlignment:
    """How well adjusted walls lie on the plan, and how well they would lie elsewhere."""

    score: float
    """Share of seen wall that the plan explains."""
    runner_up_score: float
    """Of the best alignment elsewhere, refined with the adjusted walls; 0 where there is none."""
    seen_through: float
    """Share of seen wall that a wall of the plan hides from the camera."""
    doubt: Finding | None = None
    """Why this may be the wrong place; None where it is surely the right one."""
    other_scale: OtherScale | None = None
    """At which a plan in metres would fit clearly better than as drawn, as it was taken."""
    evidence: PlanEvidence = NOTHING_JUDGED
    """The plan's walls against the camera's way and lines of sight."""

    __repr__ = short_repr

    @property
    def is_tie(self) -> bool:
        """Whether the plan explains most of the wall here, and about as much elsewhere, as in symmetric
        rooms: the shape is right then, whichever of the places is."""
        doubt, elsewhere = self.doubt, self.runner_up_score
        if doubt is None or doubt.kind is not PlanKind.ADJUSTED_FITS_ELSEWHERE:
            return False
        return min(self.score, elsewhere) >= TIE_SCORE and elsewhere <= self.score + TIE


def judge_adjusted(
    walls: WallSamples, floorplan: Floorplan, alignment: Alignment, options: AlignOptions
) -> AdjustedAlignment:
    """Score adjusted walls on the plan, and at the other candidates of the alignment.

    Args:
        walls: where the adjusted poses put them, in the plan frame (m).
        floorplan: in metres, at the scale that was taken.
        alignment: that the adjustment began with.
        options: whether a person chose the alignment.
    """
    samples = thin(walls)
    here = AlignmentHypothesis(0.0, np.zeros(2), 0.0)
    score, seen_through = explained(samples, floorplan, here)
    # Surveyed points are sure of their place until walls clearly put the scan beside it.
    is_doubted = alignment.is_surveyed and not alignment.is_sure
    within = SameWithin.surveyed() if is_doubted else SameWithin.distinct()
    others = []
    for candidate in alignment.candidates:
        start = _relative(candidate, alignment)
        if is_same([start], here, samples, within)[0]:
            continue
        other = refine_hypothesis(samples, floorplan, start, RefineSteps())
        if not is_same([other], here, samples, within)[0]:
            others.append(other.score)
    judged = AdjustedAlignment(
        score,
        max(others, default=0.0),
        seen_through,
        other_scale=alignment.other_scale,
        evidence=plan_evidence(walls, floorplan, here),
    )
    if alignment.is_plan_rescaled and is_of_lines(floorplan):
        return replace(judged, doubt=Finding(PlanKind.ADJUSTED_SINGLE_LINES))
    return replace(judged, doubt=_doubt(judged, alignment, options))


def _doubt(
    judged: AdjustedAlignment, alignment: Alignment, options: AlignOptions
) -> Finding | None:
    score, elsewhere = judged.score, judged.runner_up_score
    both = {"wall_share": score, "other_wall_share": elsewhere}
    if alignment.is_mirrored:
        return Finding(PlanKind.ADJUSTED_MIRRORED)
    is_pinned = bool(options.control_points) or alignment.is_surveyed
    is_given = alignment.is_as_recorded or options.candidate > 1 or is_pinned
    # The walls were adjusted to this place and to no other: that one explains more is a strong sign. In a
    # symmetric room that was seen whole, both explain all.
    is_beaten = elsewhere > (score + TIE if score >= TIE_SCORE else score)
    is_close = is_beaten or not (is_given or score - elsewhere >= MIN_MARGIN)
    if is_close and score >= WEAK_SCORE:
        return Finding(PlanKind.ADJUSTED_FITS_ELSEWHERE, both)
    is_clear = score >= (GIVEN_RATIO if is_given else CLEAR_RATIO) * elsewhere
    is_open = is_given and judged.seen_through <= SEEN_THROUGH
    worth = score + MARGIN_WORTH * (score - elsewhere)
    if alignment.is_plan_rescaled and worth < RESCALED_EVIDENCE and score < RESCALED_SCORE:
        return Finding(PlanKind.ADJUSTED_AT_OTHER_SCALE, both)
    if score >= MIN_SCORE and worth < MIN_EVIDENCE and not (is_given or is_clear):
        return Finding(PlanKind.ADJUSTED_LITTLE_MARGIN, both)
    if score < MIN_SCORE and not (score >= WEAK_SCORE and (is_clear or is_open)):
        return Finding(PlanKind.ADJUSTED_LITTLE_WALL, {"wall_share": score})
    evidence = judged.evidence
    if evidence.is_seen_through and score < OTHER_PLACE_SCORE and not alignment.is_surveyed:
        facts = {"wall_share": score, "seen_through_share": evidence.seen_through_share}
        return Finding(PlanKind.ADJUSTED_SEEN_THROUGH, facts)
    return None


def _relative(candidate: AlignmentHypothesis, alignment: Alignment) -> AlignmentHypothesis:
    """A candidate as a motion of the plan in metres, at the scale that was taken."""
    motion = candidate.plan_from_level @ se3.inverse(alignment.plan_from_level)
    ratio_x, ratio_y = (
        theirs / taken for theirs, taken in zip(candidate.scale_xy, alignment.scale_xy, strict=True)
    )
    start = AlignmentHypothesis.from_transform(motion)
    return replace(start, scale_xy=(ratio_x, ratio_y))
