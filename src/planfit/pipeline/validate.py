"""A run before and after, by what took no part in the adjustment, and by what each term costs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.adjust import AdjustOptions, Measurements, PlanAdjustment, costs, follow_keyframes
from planfit.pipeline.align import ScanOnPlan
from planfit.pipeline.prepare import PreparedScan
from planfit.pipeline.validation import Check, consistency_check, match_check, wall_check
from planfit.segmentation import Structure


@dataclass(frozen=True)
class Validation:
    """Poses before and after, and whether they got better."""

    before: Float[np.ndarray, "n 4 4"]
    """plan_from_cams of all frames as recorded, aligned as a whole."""
    after: Float[np.ndarray, "n 4 4"]
    """plan_from_cams of all frames, refined."""
    checks: tuple[Check, ...]
    cost_by_term: dict[str, tuple[float, float]]
    """Robust cost of each term, before and after."""


def validate(
    prepared: PreparedScan,
    on_plan: ScanOnPlan,
    adjustment: PlanAdjustment,
    structure: Structure,
    options: AdjustOptions,
) -> Validation:
    """Compare poses before and after: held-out matches, wall on the plan, consistency.

    Args:
        prepared: the scan, loops closed.
        on_plan: where it was aligned.
        adjustment: the end of `adjust_to_plan`.
        structure: of all frames, not of keyframes alone.
        options: the terms that were on.
    """
    measurements, keyframes = prepared.measurements, prepared.keyframes
    plan_from_keys = adjustment.solution.target_from_cams
    before = on_plan.recorded_plan_from_level @ prepared.level_from_cams
    after = follow_keyframes(plan_from_keys, keyframes)
    checks = (
        match_check(prepared.held_out, before, after),
        wall_check(structure, on_plan.floorplan, before, after),
        consistency_check(
            _cost_without_plan(measurements, prepared.level_from_keys, options),
            _cost_without_plan(measurements, plan_from_keys, options),
            len(before),
        ),
    )
    cost_before, cost_after = (
        costs(measurements, poses, options, adjustment.correspondences)
        for poses in (before[keyframes.frame_idx], plan_from_keys)
    )
    return Validation(
        before,
        after,
        tuple(check for check in checks if check),
        {name: (cost_before[name], cost_after[name]) for name in cost_before},
    )


def _cost_without_plan(
    measurements: Measurements, poses: Float[np.ndarray, "k 4 4"], options: AdjustOptions
) -> float:
    """Robust cost of the terms that need no plan."""
    return sum(costs(measurements, poses, options).values())
