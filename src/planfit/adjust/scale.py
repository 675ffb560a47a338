"""The scale of a plan without unit, by all measurements: at the right one the walls strain the rest least.

The alignment finds the scale from walls alone, and a scan that drift has deformed is a little too large or
too small as a whole. What depth, matches and odometry say of lengths is not deformed: a wrong scale makes the
walls force the poses apart or together everywhere. So the total cost after an adjustment to the plan, as a
function of the scale, is a bowl (`docs/adr/0005-alignment-search.md` has the numbers).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust.competition import best_of_starts, full_cost
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import costs
from planfit.adjust.schedule import PlanAdjustment, adjust_to_plan, plan_task
from planfit.floorplan import Floorplan
from planfit.lsq.term import Term

STEP = 0.003
"""Scales are tried this far apart, as a share: several sigmas of the answer, and little enough that the
same wall patches find the same faces."""
FLAT = 1e-9
"""Of costs, whose bowl has no bottom where it bends by less."""
MAX_MOVES = 3
"""Windows that are tried where the bowl's bottom lies outside."""


@dataclass(frozen=True)
class ScaleRefit:
    """A better scale, as a factor on the one that was tried."""

    factor: float
    sigma: float
    """Standard deviation of the factor, as a share; infinite where no bottom was found."""
    n_adjustments: int
    """Adjustments to the plan it took."""


def refit_scale(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
    extra_terms: Sequence[Term] = (),
) -> ScaleRefit:
    """Factor on the scale of a plan at which the walls strain everything else least.

    Args:
        measurements: what the scan says.
        floorplan: in metres, at the scale that the alignment found.
        plan_from_cams: poses aligned with it, loops closed.
        options: of the adjustment.
        extra_terms: of the adjustment.
    """
    cost_at: dict[int, float] = {}
    # Costs at several scales compare where all start alike and walls stand as drawn.
    quick = replace(options, starts=("aligned",), moved_wall_sigma_m=0.0)

    def cost(step: int) -> float:
        if step not in cost_at:
            factor = float(np.exp(step * STEP))
            poses = about_middle(plan_from_cams, factor)
            adjusted = adjust_to_plan(
                measurements, floorplan.scaled(factor), poses, quick, extra_terms
            )
            cost_at[step] = _cost(measurements, adjusted, options, extra_terms)
        return cost_at[step]

    centre = 0
    for _ in range(MAX_MOVES):
        low, here, high = (cost(centre + k) for k in (-1, 0, 1))
        if here <= min(low, high):
            break
        centre += 1 if high < low else -1
    low, here, high = (cost(centre + k) for k in (-1, 0, 1))
    curvature = low + high - 2 * here
    if here > min(low, high) or curvature <= FLAT:
        return ScaleRefit(1.0, float("inf"), len(cost_at))
    bottom = centre + 0.5 * (low - high) / curvature
    # A robust cost is a sum of squares, near enough: it rises by one at one sigma from the bottom.
    sigma = STEP * float(np.sqrt(2.0 / curvature))
    return ScaleRefit(float(np.exp(bottom * STEP)), sigma, len(cost_at))


def cost_on_plan(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
) -> float:
    """Full cost (squared sigmas) of all measurements adjusted to a plan whose walls stand as drawn.

    Of two scales of one plan, that of the lower cost is the likelier: walls that may be moved would explain
    either. Arguments are those of `adjust_to_plan`.
    """
    as_drawn = replace(options, moved_wall_sigma_m=0.0)
    task, poses = plan_task(measurements, floorplan, plan_from_cams, as_drawn)
    return full_cost(task, best_of_starts(task, poses).best)


def about_middle(
    plan_from_cams: Float[np.ndarray, "n 4 4"], factor: float
) -> Float[np.ndarray, "n 4 4"]:
    """Poses translated as a whole so that their middle stays at the same spot of a scaled drawing."""
    moved = plan_from_cams.copy()
    moved[:, :2, 3] += (factor - 1.0) * plan_from_cams[:, :2, 3].mean(axis=0)
    return moved


def _cost(
    measurements: Measurements,
    adjusted: PlanAdjustment,
    options: AdjustOptions,
    extra_terms: Sequence[Term],
) -> float:
    """Robust cost of all terms after an adjustment; a patch without face costs like the mean one."""
    poses = adjusted.solution.target_from_cams
    found = costs(measurements, poses, options, adjusted.correspondences, extra_terms)
    n_found = adjusted.association.n_associated
    n_lost = len(measurements.structure.walls) - n_found
    return sum(found.values()) + found.get("walls", 0.0) / max(n_found, 1) * n_lost
