"""Never make it worse: held-out matches, wall on the plan, and consistency, before and after."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.adjust import AdjustOptions, Measurements, PlanAdjustment, costs, follow_keyframes
from planfit.evaluation import NEAR_FACE_M, median_match_distance, wall_distances
from planfit.floorplan import Floorplan
from planfit.lsq import Term
from planfit.matching import Matches
from planfit.pipeline.align import ScanOnPlan
from planfit.pipeline.prepare import PreparedScan
from planfit.segmentation import Structure

MIN_HELD_OUT = 30
"""The median distance of fewer held-out matches tells too little."""
MAX_INCONSISTENCY = 1.25
"""Cost of matches, floor and odometry with the wall terms over that without. Measured on synthetic scans and
ConSLAM: right plans 1.00 to 1.05, plans of other buildings mostly 1.1 to 1.9."""


@dataclass(frozen=True)
class Check:
    """One number that should not get worse."""

    name: str
    before: float
    after: float
    unit: str
    is_worse: bool
    advice: str = "do not use these poses without looking at the report"
    """What to do where it got worse."""


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
    extra_terms: Sequence[Term] = (),
) -> Validation:
    """Compare poses before and after: held-out matches, wall on the plan, consistency.

    Args:
        prepared: the scan, loops closed.
        on_plan: where it was aligned.
        adjustment: the end of `adjust_to_plan`.
        structure: of all frames, not of keyframes alone.
        options: the terms that were on.
        extra_terms: the user's own among them.
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
        costs(measurements, poses, options, adjustment.correspondences, extra_terms)
        for poses in (before[keyframes.frame_idx], plan_from_keys)
    )
    return Validation(
        before,
        after,
        tuple(check for check in checks if check),
        {name: (cost_before[name], cost_after[name]) for name in cost_before},
    )


def match_check(
    held_out: Matches,
    before_from_cams: Float[np.ndarray, "n 4 4"],
    after_from_cams: Float[np.ndarray, "n 4 4"],
) -> Check | None:
    """Median distance between held-out matched points; None where there are too few to tell."""
    if held_out.n_matches < MIN_HELD_OUT:
        return None
    first = median_match_distance(held_out, before_from_cams)
    last = median_match_distance(held_out, after_from_cams)
    return Check("held-out matches, median distance", first, last, "m", last > 1.02 * first)


def wall_check(
    structure: Structure,
    floorplan: Floorplan | None,
    before_from_cams: Float[np.ndarray, "n 4 4"],
    after_from_cams: Float[np.ndarray, "n 4 4"],
    workers: int = 1,
) -> Check | None:
    """Share of wall points near a face of the plan; None without a plan, or where no flat wall was seen."""
    if floorplan is None or not structure.has_walls:
        return None
    before = wall_distances(structure, floorplan, before_from_cams, workers)
    after = wall_distances(structure, floorplan, after_from_cams, workers)
    if before is None or after is None:
        return None
    name = f"wall points within {NEAR_FACE_M:g} m of the plan"
    is_worse = after.near_share < before.near_share - 0.01
    return Check(name, before.near_share, after.near_share, "share", is_worse)


def consistency_check(cost_without: float, cost_with: float, n_frames: int) -> Check | None:
    """Whether plan and scan contradict each other; None where they do not.

    Args:
        cost_without: cost of the terms that need no plan, loops closed, solved without the wall terms.
        cost_with: the same, solved with the wall terms.
        n_frames: at least three a frame are allowed for `cost_without`, which is what correcting
            drift by walls costs a trajectory that nothing else corrects.
    """
    ratio = cost_with / max(cost_without, 3.0 * n_frames)
    if ratio <= MAX_INCONSISTENCY:
        return None
    return Check(
        "misfit of matches and odometry, without and with the walls of the plan,",
        1.0,
        ratio,
        "times",
        is_worse=True,
        advice="the plan may differ from the building where the report shows large distances, or "
        "be of another place",
    )


def _cost_without_plan(
    measurements: Measurements, poses: Float[np.ndarray, "k 4 4"], options: AdjustOptions
) -> float:
    """Robust cost of the terms that need no plan."""
    return sum(costs(measurements, poses, options).values())
