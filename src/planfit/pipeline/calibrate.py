"""The sensor found from the scan itself: before a plan is looked at, and again on the plan."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import (
    AdjustmentProblem,
    Measurements,
    PlanAdjustment,
    adjust_to_plan,
    build_problem,
)
from planfit.adjust.calibration import (
    NOT_CALIBRATED,
    ODOMETRY,
    PLAN,
    SHARED,
    Calibration,
    CalibrationPriors,
    corrected_matches,
    corrected_structure,
    estimate,
    estimate_without_plan,
    shared_step,
)
from planfit.adjust.uncertainty import SharedError
from planfit.geometry.calibration import SensorCalibration
from planfit.geometry.se3 import Poses
from planfit.pipeline.align import UNKNOWN_SCALE_SIGMA
from planfit.pipeline.given import Given
from planfit.pipeline.observations import Observations
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.pipeline.storey_heights import settle_floors
from planfit.priors import SURE_SIGMAS
from planfit.runtime import StageTimer
from planfit.scan import Scan
from planfit.tracking import Tracking, with_longer_steps

PLAN_OFF_SIGMAS = SURE_SIGMAS.value
"""A metric plan that is off by more of its and the scan's standard deviations was drawn so."""
MIN_SIGMAS_WITH_PLAN = 2.0
"""Where the plan is believed and the scan does not fit it, depth or recorded motion is corrected from so
many standard deviations on: depth left as it is would call the plan wrong, which is the more unusual of the
two. And where the plan has no unit, so that depth and recorded motion alone tell the metre: an error of
depth that is left then becomes one of all positions."""


@dataclass(frozen=True)
class CalibratedScan:
    """What a scan says, as its sensor should have measured it."""

    as_lifted: Observations
    """By the nominal sensor."""
    observations: Observations
    """Corrected."""
    prepared: PreparedScan
    """Of the corrected observations."""
    calibration: Calibration = NOT_CALIBRATED


def with_priors_of_poses(observations: Observations) -> Observations:
    """Their priors as their poses are: what has a unit of its own tells nothing of the metre."""
    tracking, priors = observations.tracking, observations.priors
    if tracking is None or tracking.metres_per_unit == 1.0:
        return observations
    sigma = max(priors.odometry_scale_sigma, UNKNOWN_SCALE_SIGMA)
    return replace(observations, priors=replace(priors, odometry_scale_sigma=sigma))


def corrected(observations: Observations, sensor: SensorCalibration) -> Observations:
    """Observations with every lifted point corrected."""
    by_hand = observations.by_hand
    if by_hand is not None:
        found = by_hand.matches
        found = replace(found, matches=corrected_matches(found.matches, sensor))
        by_hand = replace(by_hand, matches=found)
    return replace(
        observations,
        structure=corrected_structure(observations.structure, sensor),
        matches=corrected_matches(observations.matches, sensor),
        surfaces=observations.surfaces.corrected(sensor),
        control=observations.control.corrected(sensor),
        by_hand=by_hand,
    )


def calibrate_alone(
    scan: Scan, observations: Observations, options: RefineOptions, timer: StageTimer
) -> CalibratedScan:
    """Prepare a scan, its sensor corrected by what matches, floor and recorded motion ask for.

    Gross errors (5 % of depth, a wrong focal length) have to be mended before they mislead the alignment.
    """
    observations, prepared = settle_floors(scan, observations, options, timer)
    if not _is_possible(options):
        return CalibratedScan(observations, observations, prepared)
    measured, poses = prepared.measurements, prepared.level_from_keys
    with timer.stage("calibrate"):
        found = estimate_without_plan(measured, poses, options.adjust, observations.priors)
    if found.sensor.is_nominal:
        return CalibratedScan(observations, observations, prepared, found)
    seen = corrected(observations, found.sensor)
    return CalibratedScan(observations, seen, prepare(scan, seen, options, timer), found)


def calibrate_on_plan(
    scan: Scan,
    calibrated: CalibratedScan,
    on_plan: ScanOnPlan,
    adjustment: PlanAdjustment,
    options: RefineOptions,
    timer: StageTimer,
) -> CalibratedScan:
    """The same with the plan's walls among the evidence; the very same where they change nothing.

    Not of several storeys: each plan has a scale of its own there.
    """
    plan, correspondences = on_plan.floorplan, adjustment.correspondences
    is_possible = _is_possible(options) and on_plan.storeys is None
    if plan is None or correspondences is None or not is_possible:
        return calibrated
    if plan_vouches_for_depth(on_plan, calibrated.calibration, calibrated.observations.priors):
        nominal = _with_nominal_depth(calibrated.calibration)
        return _recalibrated(scan, calibrated, nominal, options, timer)
    measured = prepare_nominal(scan, calibrated, options)
    quick = replace(options.adjust, starts=("aligned",))

    def solve(
        again: Measurements, start: Poses
    ) -> tuple[AdjustmentProblem, Float[np.ndarray, "u 4 4"]]:
        return _solved(again, adjust_to_plan(again, plan, start, quick), options)

    with timer.stage("calibrate"):
        problem, unknowns = _solved(calibrated.prepared.measurements, adjustment, options)
        sensor = calibrated.calibration.sensor
        priors = plan_prior(on_plan, calibrated.calibration, calibrated.observations.priors)
        found = estimate(measured, problem, unknowns, solve, priors, sensor)
        known = calibrated.calibration
        found = _with_motion(found, known.departures[ODOMETRY], known.sigmas[ODOMETRY])
    if found.sensor == sensor:
        return replace(calibrated, calibration=found)
    return _recalibrated(scan, calibrated, found, options, timer)


def with_motion_to_scale(
    given: Given,
    tracking: Tracking | None,
    calibrated: CalibratedScan,
    on_plan: ScanOnPlan,
    adjustment: PlanAdjustment,
    timer: StageTimer,
) -> CalibratedScan:
    """The same with recorded motion as long as all evidence says, by one factor for the whole walk; the very
    same where that is within `MIN_SIGMAS_WITH_PLAN` of its standard deviations of how it was taken.

    Steps err independently of each other in the odometry's sigmas, so that 2 % of all of them are beyond
    what these allow over a room. Only a plan whose metre is believed tells that from depth.

    Args:
        tracking: before a plan was looked at: what walls say of its steps they say again, at its scale.
        calibrated: with the plan's walls among the evidence.
    """
    correspondences, options = adjustment.correspondences, given.options
    is_possible = _is_possible(options) and on_plan.storeys is None
    if tracking is None or correspondences is None or not is_possible:
        return calibrated
    calibration, priors = calibrated.calibration, calibrated.observations.priors
    of_plan = plan_prior(on_plan, calibration, priors).plan_scale_sigma
    if of_plan > priors.plan_scale_sigma:
        return calibrated
    with timer.stage("calibrate"):
        problem, unknowns = _solved(calibrated.prepared.measurements, adjustment, options)
        sigmas = np.zeros(len(SHARED))
        sigmas[ODOMETRY], sigmas[PLAN] = priors.odometry_scale_sigma, of_plan
        before = _used(calibration)
        step = shared_step(problem, unknowns, before, sigmas)
    change, sigma = (
        float(step.change[ODOMETRY]),
        float(np.sqrt(step.covariance[ODOMETRY, ODOMETRY])),
    )
    if abs(change) <= MIN_SIGMAS_WITH_PLAN * sigma:
        return calibrated
    after = float(before[ODOMETRY]) + change
    tracking = with_longer_steps(tracking, 1.0 + after)
    as_lifted, seen = (
        replace(each, tracking=tracking) for each in (calibrated.as_lifted, calibrated.observations)
    )
    return CalibratedScan(
        as_lifted,
        seen,
        prepare(given.scan, seen, options, timer),
        _with_motion(calibration, after, sigma),
    )


def _with_motion(calibration: Calibration, departure: float, sigma: float) -> Calibration:
    """The same, with what is found of the length of recorded motion."""
    departures, sigmas = calibration.departures.copy(), calibration.sigmas.copy()
    departures[ODOMETRY], sigmas[ODOMETRY] = departure, sigma
    return replace(calibration, departures=departures, sigmas=sigmas)


def _used(calibration: Calibration) -> Float[np.ndarray, " s"]:
    """Departures that measurements are corrected by: what is kept of the sensor, and of recorded motion."""
    used = np.where(calibration.is_kept, calibration.departures, 0.0)
    used[ODOMETRY] = calibration.departures[ODOMETRY]
    return used


def _is_possible(options: RefineOptions) -> bool:
    """Whether the sensor is asked for, and matches are points that it lifted."""
    return options.calibration.is_on and options.adjust.geometric == "points"


def plan_vouches_for_depth(
    on_plan: ScanOnPlan, calibration: Calibration, priors: CalibrationPriors
) -> bool:
    """Whether depth as measured and the plan as drawn have one metre, and recorded motion alone another.

    Then it is the tracker's that is off: that depth and plan erred by the same factor would be a coincidence.
    """
    found, k = on_plan.alignment, SHARED.index("depth_scale")
    if found is None or not found.is_plan_doubted or not calibration.is_kept[k]:
        return False
    sigma = PLAN_OFF_SIGMAS * priors.plan_scale_sigma
    of_plan = float(np.log(found.fitting_scale))
    of_depth = float(np.log(calibration.sensor.depth_scale))
    return abs(of_plan) > sigma > abs(of_plan - of_depth)


def with_doubt_of_scale(
    first: tuple[CalibratedScan, ScanOnPlan], calibrated: CalibratedScan, on_plan: ScanOnPlan
) -> ScanOnPlan:
    """The scan on its plan, whose scale is doubted as before depth was corrected to fit it: either is off.

    Where matches and motion had corrected depth by themselves, there was no doubt to begin with. A synthetic
    plan 2 % too large: depth was found 1.8 % short, and the result vouched for, 0.16 m off.
    """
    before, placed = first
    doubt = None if placed.alignment is None else placed.alignment.other_scale
    now, depth_scale = on_plan.alignment, calibrated.calibration.sensor.depth_scale
    if doubt is None or now is None or now.other_scale is not None:
        return on_plan
    if depth_scale in (1.0, before.calibration.sensor.depth_scale):
        return on_plan
    return replace(on_plan, alignment=replace(now, other_scale=doubt))


def _with_nominal_depth(calibration: Calibration) -> Calibration:
    """The same, the scale of depth as measured; what it was asked to be remains told."""
    is_kept = calibration.is_kept.copy()
    is_kept[SHARED.index("depth_scale")] = False
    return replace(
        calibration, sensor=replace(calibration.sensor, depth_scale=1.0), is_kept=is_kept
    )


def _recalibrated(
    scan: Scan,
    calibrated: CalibratedScan,
    found: Calibration,
    options: RefineOptions,
    timer: StageTimer,
) -> CalibratedScan:
    """The scan as another calibration corrects it, prepared anew."""
    seen = corrected(calibrated.as_lifted, found.sensor)
    return replace(
        calibrated,
        observations=seen,
        prepared=prepare(scan, seen, options, timer),
        calibration=found,
    )


def plan_prior(
    on_plan: ScanOnPlan, calibration: Calibration, priors: CalibrationPriors
) -> CalibrationPriors:
    """Priors of a run, with those of its plan.

    A metric plan that fits as drawn is right within what plans are off by. One that fits a little too large
    or small may be right, and the scan's depth be corrected not quite enough: depth alone is asked. One that
    is further off was drawn so, and who allows a plan another scale does not know its own: its scale is free
    then, as that of a plan without unit; what the sensor measured is not bent to it.
    """
    found, plan = on_plan.alignment, on_plan.floorplan
    if plan is None or plan.before_line is None:
        priors = replace(priors, half_thickness_sigma_m=0.0)
    if found is None:
        return replace(priors, plan_scale_sigma=0.0)
    if found.scale_xy == (1.0, 1.0) and not found.is_plan_doubted:
        return priors
    departure = float(np.log(found.fitting_scale))
    # Whether or not it was kept: where the odometry tells little of the metre, depth is doubted first. What
    # the scan alone asks of depth, and was not corrected, is not the plan's.
    k = SHARED.index("depth_scale")
    of_depth = 0.0 if calibration.is_kept[k] else float(calibration.departures[k])
    sigma = float(np.hypot(priors.plan_scale_sigma, calibration.sigmas[k]))
    free = replace(priors, plan_scale_sigma=UNKNOWN_SCALE_SIGMA)
    least = min(priors.min_sigmas, MIN_SIGMAS_WITH_PLAN)
    if not found.is_plan_doubted:
        return replace(free, min_sigmas=least)
    if found.is_plan_rescaled or abs(departure + of_depth) >= PLAN_OFF_SIGMAS * sigma:
        return free
    return replace(priors, plan_scale_sigma=0.0, min_sigmas=least)


def shared_error(
    problem: AdjustmentProblem,
    on_plan: ScanOnPlan,
    calibration: Calibration,
    priors: CalibrationPriors,
) -> SharedError | None:
    """What is not known of sensor, odometry and plan where an adjustment ended, and how poses follow it.

    Poses are told on the plan: where its scale was found, an error of that stretches plan and poses alike
    and is none. None where nothing is looked for: points are no matches, or each storey has a plan of its
    own.
    """
    is_possible = problem.options.geometric == "points" and on_plan.storeys is None
    if not is_possible:
        return None
    priors = plan_prior(on_plan, calibration, priors)
    unknowns = problem.unknowns
    step = shared_step(replace(problem, ceiling=None), unknowns, _used(calibration), priors.sigmas)
    follow = step.pose_by_shared
    if priors.plan_scale_sigma > 0:
        follow[:, 3:5, PLAN] -= unknowns[:, :2, 3]
    # What the evidence asks for and was not kept may be right: its square adds to the variance. So does that
    # by which no sensor should be off, as far as it may be the sensor's.
    p_sensor = (calibration.p_sensor or 0.0) if calibration.implausible else 1.0
    unkept = p_sensor * np.outer(step.change, step.change)
    return SharedError(step.covariance + unkept, follow)


def prepare_nominal(scan: Scan, calibrated: CalibratedScan, options: RefineOptions) -> Measurements:
    """Measurements of the keyframes as the nominal sensor lifted them."""
    if calibrated.calibration.sensor.is_nominal:
        return calibrated.prepared.measurements
    loose = replace(options, adjust=replace(options.adjust, loops_first=False))
    measured = prepare(scan, calibrated.as_lifted, loose).measurements
    # Where control points are does not depend on the sensor, but for what it bends.
    targets = calibrated.prepared.measurements.control.targets
    return replace(measured, control=replace(measured.control, targets=targets))


def _solved(
    measurements: Measurements, adjustment: PlanAdjustment, options: RefineOptions
) -> tuple[AdjustmentProblem, Float[np.ndarray, "u 4 4"]]:
    """The problem that an adjustment to the plan ended with, but for ceilings, and its unknowns.

    Heights of ceilings were measured by the very depth that is in question: held where they are, they would
    say that it is right.
    """
    poses = adjustment.solution.target_from_cams
    problem = build_problem(measurements, options.adjust, poses, adjustment.correspondences)
    return replace(problem, ceiling=None), problem.unknowns
