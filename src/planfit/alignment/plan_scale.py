"""Whether a plan that claims metres is in metres: off by some per cent, or in another unit altogether.

A drawing that was printed, traced or scaled by hand is a few per cent too large or too small, and a scan of
50 m then ends a metre off its walls. Another unit is a slip of the export, and is refused with its name.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.alignment.align import (
    FULL_DISTANCES_M,
    Alignment,
    OtherScale,
    align,
    align_within,
)
from planfit.alignment.options import AlignOptions, ControlPoint
from planfit.alignment.refine import AlignmentHypothesis, RefineSteps, refine_hypothesis
from planfit.alignment.selection import MIN_MARGIN, MIN_SCORE
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.findings import Finding, PlanKind
from planfit.floorplan import Floorplan
from planfit.floorplan.centre_lines import with_thickness
from planfit.priors import CLEAR_ODDS, SURE_SIGMAS
from planfit.units import FOOT_M, INCH_M

LOOK_WITHIN = 0.12
"""Share by which the scale of a plan in metres that keeps its scale is looked beside it: prints, tracings and
drawings scaled by hand are off by less; a plan further off is in another unit."""
OFF_SHARE = 0.006
"""A scale nearer to 1 than this, as a share, is as drawn: plans in metres are right within half a per cent,
and depth, odometry and the bend that drift leaves are not surer."""
OFF_SIGMAS = SURE_SIGMAS.value
"""A scale must be off by so many of its standard deviations too."""
FAR_SHARE = 0.02
"""A scale further off must explain more wall by `MIN_MARGIN`: at a nearer one, the walls of a small scan lie
nearly as well on the plan as drawn. So near to a unit, it is that unit."""
CLEAR_GAIN = 0.1
"""What another scale must explain beyond the plan as drawn where neither place is sure."""
SAME_SCORE = 0.03
"""Shares of explained wall that differ by less tell nothing: of another scale and centre lines of walls, of
jumps at neighbouring steps, of storeys that are alike."""
HALF_THICKNESS_M = (0.04, 0.07, 0.1, 0.15)
"""Of walls that may be drawn by their centre lines."""
METRES_PER_UNIT = {
    "millimetres": 0.001,
    "centimetres": 0.01,
    "inches": INCH_M,
    "feet": FOOT_M,
    "metres on paper at 1:50": 50.0,
    "metres on paper at 1:100": 100.0,
    "metres on paper at 1:200": 200.0,
}
BETTER_SCORE = 2 * CLEAR_GAIN
"""What another unit must explain beyond what metres do."""


def find_plan_scale(
    walls: WallSamples,
    floorplan: Floorplan,
    drawn: Alignment,
    options: AlignOptions,
    slack: float,
    recorded: Float[np.ndarray, "4 4"] | None = None,
    control_points: Sequence[ControlPoint] = (),
) -> Alignment | None:
    """The alignment with a metric plan at another scale, where the walls ask for one; else None.

    Walls alone judge here, so the scale is that of a scan that drift may have bent: `is_off` decides once
    all measurements have refitted it (`planfit.adjust.refit_scale`).

    Args:
        floorplan: in metres, as drawn.
        drawn: the alignment with it as drawn.
        slack: share by which the scale may differ from the drawn one; 0 looks at none.
        recorded: plan_from_level that the scan's format claims, if it does.
        control_points: points of the scan whose location on the plan is known.
    """
    if not floorplan.is_metric or slack == 0 or _is_told(options):
        return None
    is_clear = drawn.is_sure and drawn.score >= MIN_SCORE
    if is_clear and abs(np.log(_preferred_scale(walls, floorplan, drawn))) < OFF_SHARE:
        return None
    found = align_within(walls, floorplan, options, slack, recorded, control_points)
    off = abs(np.log(found.metres_per_unit))
    gain = MIN_MARGIN if off > FAR_SHARE else 0.0
    # In a building that repeats itself no place is sure, and every place asks for the same scale.
    is_plain = found.score >= max(MIN_SCORE, drawn.score + CLEAR_GAIN) and not drawn.is_sure
    if not OFF_SHARE <= off <= np.log1p(slack):
        return None
    if not (found.is_sure or is_plain) or found.score <= drawn.score + gain:
        return None
    found = replace(found, is_plan_rescaled=True)
    if not is_of_lines(floorplan):
        return found
    if found.score < score_of_centre_lines(walls, floorplan, drawn) + SAME_SCORE:
        return None
    return replace(found, is_sure=False, findings=(*found.findings, Finding(PlanKind.SINGLE_LINES)))


def may_be_rescaled(options: AlignOptions, metres_per_unit: float = 1.0) -> bool:
    """Whether the options let a plan in metres be taken at another scale than drawn, and at this one."""
    slack = options.metric_scale_tolerance
    is_within = bool(abs(np.log(metres_per_unit)) <= np.log1p(slack))
    return slack > 0 and not _is_told(options) and is_within


def _is_told(options: AlignOptions) -> bool:
    """Whether the user says which alignment to take."""
    return options.candidate != 1 or bool(options.start)


def is_off(scaled: Alignment) -> bool:
    """Whether the scale of a metric plan is off by more than plans usually are, and surely so."""
    off = abs(np.log(scaled.metres_per_unit))
    return bool(off > max(OFF_SHARE, OFF_SIGMAS * scaled.scale_sigma))


def is_clearly_likelier(cost_gain: float) -> bool:
    """Whether a scale whose full cost is lower by this much is clearly likelier by all measurements.

    Synthetic plans 1 to 10 % off, and ConSLAM's: exp(13) to exp(124); right ones are not asked, as no other
    scale is surely off.
    """
    # Costs are sums of squared sigmas: twice a negative log likelihood.
    return bool(cost_gain > 2.0 * np.log(CLEAR_ODDS.value))


def other_scale_finding(other: OtherScale) -> Finding:
    """A plan in metres that was taken as drawn and fits better at another scale."""
    # Costs are sums of squared sigmas: twice a negative log likelihood.
    facts = {"scale_ratio": other.metres_per_unit, "sigma_share": other.sigma}
    facts |= {"log_odds": other.cost_gain / 2.0, "tolerance_share": LOOK_WITHIN}
    return Finding(PlanKind.OTHER_SCALE, facts)


def find_unit(
    walls: WallSamples, floorplan: Floorplan, alignment: Alignment, options: AlignOptions
) -> tuple[str, float] | None:
    """The unit, in words, and its metres, in which a plan that claims metres fits although it does not
    in metres. None where the plan fits as it is, has no unit, fits in none clearly better, or about as it is
    drawn: then it fits elsewhere than the user said.
    """
    if not floorplan.is_metric or alignment.score >= MIN_SCORE:
        return None
    unknown = replace(floorplan, is_metric=False)
    free = replace(options, metres_per_unit=0.0, candidate=1, start="", control_points=())
    found = align(walls, unknown, free)
    if not found.is_sure or found.score < alignment.score + BETTER_SCORE:
        return None
    scale = found.metres_per_unit
    if abs(np.log(scale)) <= np.log1p(LOOK_WITHIN):
        return None
    unit = min(METRES_PER_UNIT, key=lambda name: abs(np.log(scale / METRES_PER_UNIT[name])))
    if abs(np.log(scale / METRES_PER_UNIT[unit])) < FAR_SHARE:
        return unit, METRES_PER_UNIT[unit]
    return f"units of {scale:.4g} m", float(f"{scale:.4g}")


def score_of_centre_lines(walls: WallSamples, floorplan: Floorplan, drawn: Alignment) -> float:
    """Share of wall that the plan as drawn explains if its lines are the middles of walls.

    Rooms that are drawn up to the centre lines of their walls look like rooms of a plan that is too large.
    """
    samples = thin(walls)
    start = AlignmentHypothesis.from_transform(drawn.plan_from_level)
    steps = RefineSteps(FULL_DISTANCES_M)
    return max(
        refine_hypothesis(samples, with_thickness(floorplan, half_m), start, steps).score
        for half_m in HALF_THICKNESS_M
    )


def is_of_lines(floorplan: Floorplan) -> bool:
    """Whether most of the plan is lines whose free side is not known."""
    return bool(floorplan.lengths @ floorplan.is_oriented < 0.5 * floorplan.lengths.sum())


def _preferred_scale(walls: WallSamples, floorplan: Floorplan, drawn: Alignment) -> float:
    """The scale that the walls prefer near the alignment as drawn."""
    samples = thin(walls)
    start = AlignmentHypothesis.from_transform(drawn.plan_from_level)
    steps = RefineSteps(FULL_DISTANCES_M, n_scales=1)
    return refine_hypothesis(samples, floorplan, start, steps).metres_per_unit
