"""The method on one screen: from a posed scan and a floorplan to poses that fit the plan."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial

from planfit.adjust import PlanAdjustment, adjust_to_plan, check_extra_terms
from planfit.adjust.calibration import Calibration
from planfit.floorplan import Floorplan
from planfit.lsq import Term
from planfit.pipeline.align import align_to_plan
from planfit.pipeline.calibrate import CalibratedScan, calibrate_alone, calibrate_on_plan
from planfit.pipeline.observations import Observations, extract_observations
from planfit.pipeline.on_plan import STANDS_ALONE, ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.result import MadeOf, RefineResult, make_result
from planfit.pipeline.storeys import place_on_storeys
from planfit.pipeline.survey import SurveyedScan, observe_survey, place_by_control
from planfit.pipeline.validation import validate
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.survey import Survey
from planfit.tracking import choose_keyframes

MAX_CORRECTIONS = 2
"""Times that walls may correct the sensor; most scans need none, others one."""


def refine(
    scan: Scan,
    floorplan: Floorplan | Mapping[int, Floorplan] | None,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    observations: Observations | None = None,
    extra_terms: Iterable[Term] = (),
    survey: Survey | None = None,
) -> RefineResult:
    """Refine the camera poses of a scan so that its reconstruction agrees with the floorplan.

    Args:
        scan: posed RGB-D frames.
        floorplan: wall faces, in metres or in a unit that is found here. Of a walk through several storeys,
            the plan of each by its number: of two storeys the higher one has the higher number. None: the
            scan has to agree with itself alone, by closed loops, floors and ceilings; what is called the plan
            frame is then the level frame: the scan's own axes, turned upright, floor at 0.
        options: defaults to what works best.
        runtime: threads, cache and progress; by default nothing is kept and nothing is said.
        observations: what `extract_observations` saw in this scan, or a user's own.
        extra_terms: terms of one's own over plan_from_cams of all frames, in the adjustment on the plan.
        survey: control points, which hold the poses, and check points, which only judge them.

    Raises:
        ScanError: a file of the scan cannot be used.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
            Or plans of storeys fit in another order than that of their numbers.
        OptionError: an option cannot work, an extra term meets frames that are no unknowns, or the survey
            cannot be right.
    """
    chosen, own = options or RefineOptions(), tuple(extra_terms)
    _require_frames_for(own, scan, chosen, observations)
    timer = StageTimer(runtime or Runtime())
    surveyed = None
    if survey is not None:
        with timer.stage("survey"):
            surveyed = observe_survey(scan, survey, floorplan, chosen, runtime)
    # Gravity, floor and walls (paper, Sec. III-A and III-B), matches of keypoints.
    seen = observations or extract_observations(scan, chosen, runtime, timer=timer)
    if surveyed is not None:
        seen = replace(seen, control=surveyed.control)
    # Keyframes; loops closed by what needs no plan; the sensor, by the same; plan and sensor in turns.
    calibrated, on_plan, adjustment = _solve(scan, seen, floorplan, chosen, own, timer, surveyed)
    # Is it better, by solves that did without a part of the evidence?
    with timer.stage("validate"):
        prepared, structure = calibrated.prepared, calibrated.observations.structure
        found = calibrated.calibration
        validation = validate(prepared, on_plan, adjustment, structure, chosen, own, found)
    result = make_result(scan, calibrated, on_plan, adjustment, validation, chosen, timer, surveyed)
    return replace(result, made_of=MadeOf(scan, floorplan, chosen))


def calibrate(
    scan: Scan,
    floorplan: Floorplan | None = None,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
) -> Calibration:
    """Find what the scan's sensor gets wrong: `refine` without its judgement of the poses.

    Arguments and errors are those of `refine`; without a plan, matches, floor and recorded motion tell.
    """
    chosen = options or RefineOptions()
    timer = StageTimer(runtime or Runtime())
    seen = extract_observations(scan, chosen, runtime, timer=timer)
    return _solve(scan, seen, floorplan, chosen, (), timer)[0].calibration


def _solve(
    scan: Scan,
    seen: Observations,
    floorplan: Floorplan | Mapping[int, Floorplan] | None,
    options: RefineOptions,
    extra_terms: tuple[Term, ...],
    timer: StageTimer,
    surveyed: SurveyedScan | None = None,
) -> tuple[CalibratedScan, ScanOnPlan, PlanAdjustment]:
    """The sensor by what needs no plan, the scan on the plan; both again while walls correct the sensor."""
    place = partial(_place, scan, floorplan, options, extra_terms, timer, surveyed)
    calibrated, on_plan, adjustment = place(calibrate_alone(scan, seen, options, timer))
    for _ in range(MAX_CORRECTIONS):
        # Walls may show that the sensor is off: then all that follows from its points comes again.
        before = calibrated
        calibrated = calibrate_on_plan(scan, before, on_plan, adjustment, options, timer)
        if calibrated.prepared is before.prepared:
            break
        calibrated, on_plan, adjustment = place(calibrated)
    return calibrated, on_plan, adjustment


def _place(
    scan: Scan,
    floorplan: Floorplan | Mapping[int, Floorplan] | None,
    options: RefineOptions,
    extra_terms: tuple[Term, ...],
    timer: StageTimer,
    surveyed: SurveyedScan | None,
    calibrated: CalibratedScan,
) -> tuple[CalibratedScan, ScanOnPlan, PlanAdjustment]:
    """Bring a scan onto its plan, as a whole, then each pose; with storeys, the scan learns its own."""
    # Rotation, translation and scale of the whole (paper, Sec. III-A).
    on_plan = STANDS_ALONE
    prepared = calibrated.prepared
    if surveyed is not None and not isinstance(floorplan, Mapping):
        # Control points take drift out, and say where the scan is.
        prepared, on_plan = place_by_control(scan, prepared, surveyed, floorplan, options, timer)
        calibrated = replace(calibrated, prepared=prepared)
    elif isinstance(floorplan, Floorplan):
        on_plan = align_to_plan(scan, prepared, floorplan, options, timer)
    elif floorplan is not None:
        # Each storey alone, then all in one frame (docs/adr/0011-several-storeys.md).
        seen = calibrated.observations
        placed = place_on_storeys(scan, seen, prepared, floorplan, options, timer)
        prepared, on_plan = placed.prepared, placed.on_plan
        calibrated = replace(calibrated, observations=placed.observations, prepared=prepared)
    # Walls associated with faces and all terms adjusted, in turns (paper, Sec. III-D and III-E); without a
    # plan all terms but walls.
    with timer.stage("adjust"):
        start = on_plan.plan_from_level @ prepared.level_from_keys
        measured, plan = prepared.measurements, on_plan.floorplan
        adjustment = adjust_to_plan(measured, plan, start, options.adjust, extra_terms)
    return calibrated, on_plan, adjustment


def _require_frames_for(
    extra_terms: tuple[Term, ...],
    scan: Scan,
    options: RefineOptions,
    observations: Observations | None,
) -> None:
    """Refuse now, not after matching, what the adjustment would refuse of extra terms."""
    if not extra_terms:
        return
    if observations is None:
        keyframe_idx = choose_keyframes(scan.world_from_cams, scan.timestamps, options.keyframes)
    else:
        keyframe_idx = observations.keyframe_idx
    n_keyframes = len(scan) if keyframe_idx is None else len(keyframe_idx)
    n_reduced = None if n_keyframes == len(scan) else n_keyframes
    check_extra_terms(extra_terms, options.adjust, n_reduced)
