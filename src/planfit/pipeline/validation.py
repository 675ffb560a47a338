"""Never make it worse: numbers before and after, and the verdict on the result."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planfit.adjust import PlanAdjustment, costs, follow_keyframes
from planfit.adjust.calibration import NOT_CALIBRATED, PRIORS, Calibration, CalibrationPriors
from planfit.evaluation import NEAR_FACE_M, near_share
from planfit.floorplan import Floorplan
from planfit.geometry.se3 import Poses
from planfit.lsq import Term
from planfit.pipeline.evidence import Evidence, gather_evidence
from planfit.pipeline.folds import N_FOLDS
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan
from planfit.pipeline.verdict import Verdict, is_apart, judge
from planfit.runtime import short_repr
from planfit.segmentation import Structure


@dataclass(frozen=True)
class Check:
    """One number that should not get worse."""

    name: str
    before: float
    after: float
    unit: str
    is_worse: bool


@dataclass(frozen=True)
class Validation:
    """Poses before and after, and whether they got better."""

    before: Poses
    """plan_from_cams of all frames as recorded, aligned as a whole."""
    after: Poses
    """plan_from_cams of all frames, refined."""
    checks: tuple[Check, ...]
    cost_by_term: dict[str, tuple[float, float]]
    """Robust cost of each term, before and after."""
    evidence: Evidence
    verdict: Verdict

    __repr__ = short_repr


def validate(
    prepared: PreparedScan,
    on_plan: ScanOnPlan,
    adjustment: PlanAdjustment,
    structure: Structure,
    options: RefineOptions,
    extra_terms: Sequence[Term] = (),
    calibration: Calibration = NOT_CALIBRATED,
    priors: CalibrationPriors = PRIORS,
) -> Validation:
    """Compare poses before and after, gather the evidence, and judge it.

    Args:
        prepared: the scan, loops closed.
        on_plan: where it was aligned.
        adjustment: the end of `adjust_to_plan`.
        structure: of all frames, not of keyframes alone.
        options: those of the run.
        extra_terms: the user's own among them.
        calibration: what was found of the sensor; the scan's points are corrected by it.
        priors: of what was not found.
    """
    measurements, keyframes = prepared.measurements, prepared.keyframes
    plan_from_keys = adjustment.solution.target_from_cams
    before = on_plan.recorded_plan_from_level @ prepared.level_from_cams
    after = follow_keyframes(plan_from_keys, keyframes)
    evidence = gather_evidence(
        prepared,
        on_plan,
        adjustment,
        options.adjust,
        options.align,
        N_FOLDS,
        np.random.default_rng(options.seed),
        extra_terms,
        calibration,
        priors if options.calibration.is_on else None,
    )
    checks = (visit_check(evidence), wall_check(structure, on_plan.floorplan, before, after))
    cost_before, cost_after = (
        costs(measurements, poses, options.adjust, adjustment.correspondences, extra_terms)
        for poses in (before[keyframes.frame_idx], plan_from_keys)
    )
    return Validation(
        before,
        after,
        tuple(check for check in checks if check),
        {name: (cost_before[name], cost_after[name]) for name in cost_before},
        evidence,
        judge(evidence, options.tolerance_m),
    )


def visit_check(evidence: Evidence) -> Check | None:
    """Distance between sightings of places seen again, by solves without them; None where there are none."""
    if evidence.visit_distances_m is None:
        return None
    before, after = evidence.visit_distances_m
    name = "places seen again, median distance in solves without them"
    return Check(name, before, after, "m", is_apart(before, after))


def wall_check(
    structure: Structure,
    floorplan: Floorplan | None,
    before_from_cams: Poses,
    after_from_cams: Poses,
) -> Check | None:
    """Share of wall points near a face of the plan; None without a plan, or where no flat wall was seen."""
    if floorplan is None or not structure.has_walls:
        return None
    before, after = (
        near_share(structure, floorplan, poses) for poses in (before_from_cams, after_from_cams)
    )
    name = f"wall points within {NEAR_FACE_M:g} m of the plan"
    return Check(name, before, after, "share", after < before - 0.01)
