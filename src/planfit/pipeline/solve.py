"""Sensor and poses in turns: a scan aligned with its plan and adjusted to it, which tells of its sensor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from planfit.adjust import PlanAdjustment, adjust_to_plan, fit_thickness, settle_walls
from planfit.adjust.calibration import SHARED
from planfit.adjust.scale import about_middle
from planfit.alignment import is_off, may_be_rescaled
from planfit.alignment.plan_scale import OFF_SHARE
from planfit.floorplan import Floorplan
from planfit.geometry.se3 import Poses
from planfit.lsq import Term
from planfit.pipeline.align import UNKNOWN_SCALE_SIGMA
from planfit.pipeline.calibrate import (
    CalibratedScan,
    calibrate_alone,
    calibrate_on_plan,
    with_doubt_of_scale,
    with_motion_to_scale,
)
from planfit.pipeline.contradicted import with_places
from planfit.pipeline.folds import N_FOLDS, cut_into_stretches
from planfit.pipeline.given import Given
from planfit.pipeline.jumps import align_with_jumps
from planfit.pipeline.observations import Observations
from planfit.pipeline.on_plan import STANDS_ALONE, ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.places_and_walls import against_walls
from planfit.pipeline.predicted_error import error_model
from planfit.pipeline.prepare import PreparedScan
from planfit.pipeline.storeys import place_on_storeys
from planfit.pipeline.survey import SurveyedScan, place_by_control
from planfit.runtime import StageTimer, short_repr

MAX_CORRECTIONS = 2
"""Times that walls may correct the sensor; most scans need none, others one."""


@dataclass(frozen=True)
class Solved:
    """A scan whose poses are adjusted."""

    calibrated: CalibratedScan
    on_plan: ScanOnPlan
    adjustment: PlanAdjustment
    surveyed: SurveyedScan | None = None
    """The survey, where one was given, and where the scan sees it."""

    __repr__ = short_repr

    @property
    def prepared(self) -> PreparedScan:
        """The scan, its sensor corrected, loops closed."""
        return self.calibrated.prepared


def solve(
    given: Given, seen: Observations, timer: StageTimer, surveyed: SurveyedScan | None = None
) -> Solved:
    """The sensor by what needs no plan, the scan on the plan; both again while walls correct the sensor.

    Args:
        given: scan, plan, options and extra terms.
        seen: what the scan shows.
        timer: times the stages.
        surveyed: control points that it shows, if there are any.
    """
    options, adjust = given.options, partial(_adjusted, given, timer, surveyed)
    alone = calibrate_alone(given.scan, seen, options, timer)
    solved = first = adjust(alone)
    for _ in range(MAX_CORRECTIONS):
        # Walls may show that the sensor is off: then all that follows from its points comes again.
        calibrated = calibrate_on_plan(
            given.scan, solved.calibrated, solved.on_plan, solved.adjustment, options, timer
        )
        if calibrated.prepared is solved.prepared:
            solved = replace(solved, calibrated=calibrated)
            tracking = alone.observations.tracking
            calibrated = with_motion_to_scale(
                given, tracking, calibrated, solved.on_plan, solved.adjustment, timer
            )
        if calibrated is solved.calibrated:
            break
        solved = adjust(calibrated)
    before = first.calibrated, first.on_plan
    on_plan = with_doubt_of_scale(before, solved.calibrated, solved.on_plan)
    # A sensor that is off looks like walls that were moved: these come last.
    return _with_walls_settled(given, replace(solved, on_plan=on_plan), timer)


def _adjusted(
    given: Given, timer: StageTimer, surveyed: SurveyedScan | None, calibrated: CalibratedScan
) -> Solved:
    """The scan brought onto its plan as a whole, then each pose."""
    options, terms = given.options, given.extra_terms
    # Rotation, translation and scale of the whole (paper, Sec. III-A).
    calibrated, on_plan = _aligned(given, timer, surveyed, calibrated)
    prepared = calibrated.prepared
    # Walls associated with faces and all terms adjusted, in turns (paper, Sec. III-D and III-E); without a
    # plan all terms but walls.
    with timer.stage("adjust"):
        start = on_plan.plan_from_level @ prepared.level_from_keys
        measured, plan = prepared.measurements, on_plan.floorplan
        adjustment = adjust_to_plan(measured, plan, start, options.adjust, terms)
        if plan is not None and plan.before_line is not None:
            on_plan, poses = _with_fitted_thickness(
                on_plan,
                prepared,
                adjustment,
                options,
                calibrated.observations.priors.odometry_scale_sigma,
                calibrated.calibration.sigmas[SHARED.index("depth_scale")],
                terms,
            )
            adjustment = adjust_to_plan(measured, on_plan.floorplan, poses, options.adjust, terms)
    return Solved(calibrated, on_plan, adjustment, surveyed)


def _with_walls_settled(given: Given, solved: Solved, timer: StageTimer) -> Solved:
    """Adjusted again, with walls that stand elsewhere than drawn, or are not there."""
    options, prepared = given.options, solved.prepared
    with timer.stage("adjust"):
        recorded = prepared.level_from_cams[prepared.keyframes.frame_idx]
        stretch = cut_into_stretches(recorded, N_FOLDS)
        adjustment = settle_walls(
            prepared.measurements,
            solved.on_plan.floorplan,
            solved.adjustment,
            options.adjust,
            lambda problem: error_model(problem, stretch, np.random.default_rng(options.seed)),
            given.extra_terms,
        )
    return replace(solved, adjustment=adjustment)


def _aligned(
    given: Given, timer: StageTimer, surveyed: SurveyedScan | None, calibrated: CalibratedScan
) -> tuple[CalibratedScan, ScanOnPlan]:
    """Where the whole scan is: by control points, on one plan, on a plan for each storey, or standing alone.

    Control points, jumps and storeys change the scan, too.
    """
    scan, plan, options, prepared = given.scan, given.floorplan, given.options, calibrated.prepared
    if isinstance(plan, Floorplan):
        options = with_places(options, calibrated.observations.by_hand, prepared, plan)
    if isinstance(plan, Mapping):
        # Each storey alone, then all in one frame (docs/adr/0011-several-storeys.md).
        seen = calibrated.observations
        found = place_on_storeys(scan, seen, prepared, plan, options, timer)
        storeyed = replace(calibrated, observations=found.observations, prepared=found.prepared)
        return storeyed, found.on_plan
    if surveyed is not None:
        # Control points take drift out, and say where the scan is.
        prepared, on_plan = place_by_control(scan, prepared, surveyed, plan, options, timer)
        return replace(calibrated, prepared=prepared), on_plan
    if plan is None:
        return calibrated, STANDS_ALONE
    calibrated, on_plan = align_with_jumps(scan, calibrated, plan, options, timer)
    with timer.stage("align"):
        return calibrated, against_walls(on_plan, calibrated.prepared, plan, options)


def _with_fitted_thickness(
    on_plan: ScanOnPlan,
    prepared: PreparedScan,
    adjustment: PlanAdjustment,
    options: RefineOptions,
    odometry_scale_sigma: float,
    depth_scale_sigma: float,
    extra_terms: Sequence[Term] = (),
) -> tuple[ScanOnPlan, Poses]:
    """The plan with each wall of a line as thick as it was seen, at the scale that goes with it, and poses.

    Args:
        on_plan: with one thickness for all walls.
        odometry_scale_sigma: how far recorded steps may be off, as a share.
        depth_scale_sigma: how far depth may be off, as a share; a plan's scale is off with it.
    """
    plan, found = on_plan.floorplan, on_plan.alignment
    assert plan is not None
    poses = adjustment.solution.target_from_cams
    fit = partial(
        fit_thickness,
        prepared.measurements,
        options=options.adjust,
        odometry_scale_sigma=odometry_scale_sigma,
        extra_terms=extra_terms,
    )
    is_found = found is not None and found.scale_sigma > 0  # the scale was searched, or found off
    # A plan in metres may be off as well: walls of one thickness did not show it.
    is_as_drawn = found is not None and found.scale_xy == (1.0, 1.0)
    is_free = is_found or (is_as_drawn and may_be_rescaled(options.align))
    fitted = fit(plan, poses, plan_scale_sigma=UNKNOWN_SCALE_SIGMA if is_free else 0.0)
    if found is None or fitted.scale_sigma == 0:
        return replace(on_plan, floorplan=fitted.floorplan), fitted.plan_from_cams
    middle = poses[:, :2, 3].mean(axis=0)
    sigma = float(np.hypot(fitted.scale_sigma, depth_scale_sigma))
    rescaled = found.rescaled(fitted.scale_factor, sigma, middle)
    off = abs(np.log(rescaled.metres_per_unit))
    if (is_as_drawn and not is_off(rescaled)) or (found.is_plan_rescaled and off <= OFF_SHARE):
        drawn = 1.0 / found.metres_per_unit
        fitted = fit(plan.scaled(drawn), about_middle(poses, drawn))
        rescaled = replace(
            found.rescaled(drawn, 0.0, middle), scale_xy=(1.0, 1.0), is_plan_rescaled=False
        )
    elif is_as_drawn:
        rescaled = replace(rescaled, is_plan_rescaled=True)
    on_plan = replace(
        on_plan,
        alignment=rescaled,
        plan_from_level=rescaled.plan_from_level,
        floorplan=fitted.floorplan,
    )
    return on_plan, fitted.plan_from_cams
