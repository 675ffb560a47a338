"""The method on one screen: from a posed scan and a floorplan to poses that fit the plan."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from planfit.adjust import PlanAdjustment, adjust_to_plan, check_extra_terms, settle_walls
from planfit.adjust.calibration import Calibration
from planfit.corrections import NO_CORRECTIONS, Contradiction, Corrections
from planfit.errors import require
from planfit.floorplan import Floorplan
from planfit.lsq import Term
from planfit.pipeline.by_hand import (
    contradictions_among,
    contradictions_of_images,
    corrected_plan,
    look_by_hand,
    require_one_plan,
)
from planfit.pipeline.calibrate import (
    CalibratedScan,
    calibrate_alone,
    calibrate_on_plan,
    with_doubt_of_scale,
    with_priors_of,
)
from planfit.pipeline.contradicted import (
    ByHand,
    ContradictedError,
    by_hand_outcome,
    first_of_each,
    loops_against_motion,
    with_places,
)
from planfit.pipeline.fitted_thickness import with_fitted_thickness
from planfit.pipeline.folds import cut_into_stretches
from planfit.pipeline.given import require_given
from planfit.pipeline.jumps import align_with_jumps
from planfit.pipeline.observations import (
    Observations,
    corrected_observations,
    extract_observations,
)
from planfit.pipeline.on_plan import STANDS_ALONE, ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.places_and_walls import against_walls
from planfit.pipeline.predicted_error import error_model
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
    corrections: Corrections = NO_CORRECTIONS,
    without_contradicted: bool = False,
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
        corrections: by hand; see docs/corrections.md.
        without_contradicted: whether corrections that others or the scan contradict are left out, and all is
            solved again without them; else they are used, as far as they can be, and named.

    Raises:
        ScanError: a file of the scan cannot be used.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
            Or plans of storeys fit in another order than that of their numbers.
            Or a wall that is corrected is not there.
        OptionError: an option cannot work, an extra term meets frames that are no unknowns, or the survey
            cannot be right.
            Or a correction names what is not there, or others that contradict it prevent any solution.
    """
    require_given(scan, floorplan, options, runtime)
    chosen, own = options or RefineOptions(), tuple(extra_terms)
    _require_frames_for(own, scan, chosen, observations)
    if not corrections.entries:
        return _refined(scan, floorplan, chosen, runtime, observations, own, survey, NO_CORRECTIONS)
    solve = partial(_refined, scan, floorplan, chosen, runtime, observations, own, survey)
    require_one_plan(floorplan, corrections)
    corrections.require_frames(len(scan))
    require(
        not corrections.walls("exclude_wall") or chosen.adjust.wall_strategy == "fixed",
        f"{corrections.name}: exclude_wall: expected adjust.wall-strategy fixed, found "
        f"{chosen.adjust.wall_strategy}; erase_wall leaves a wall out of all of them",
    )
    return _settled(solve, corrections, without_contradicted)


def _settled(
    solve: Callable[[Corrections], RefineResult], corrections: Corrections, leave_out: bool
) -> RefineResult:
    """A result with corrections; where `leave_out`, solved again without what contradicts it until nothing
    does."""
    left_out: tuple[Contradiction, ...] = ()
    while True:  # ends, as each round leaves one out or is the last
        used = corrections.without(left_out)
        try:
            among = contradictions_among(used)
            if among:
                raise ContradictedError(corrections.name, among)
            result = solve(used)
        except ContradictedError as error:
            if not leave_out:
                raise
            left_out += error.contradictions
            continue
        told = result.by_hand
        if not leave_out or told is None or not told.contradictions:
            break
        left_out += told.contradictions
    told = result.by_hand or ByHand(used, (), ())
    told = replace(told, left_out=left_out)
    return replace(result, by_hand=told, findings=(*told.findings, *result.findings))


def _refined(
    scan: Scan,
    floorplan: Floorplan | Mapping[int, Floorplan] | None,
    chosen: RefineOptions,
    runtime: Runtime | None,
    observations: Observations | None,
    own: tuple[Term, ...],
    survey: Survey | None,
    corrections: Corrections,
) -> RefineResult:
    """One solve, with these corrections, whatever they come to."""
    given = floorplan
    if isinstance(floorplan, Floorplan):
        floorplan = corrected_plan(floorplan, corrections)
    timer = StageTimer(runtime or Runtime())
    surveyed = None
    if survey is not None:
        with timer.stage("survey"):
            surveyed = observe_survey(scan, survey, floorplan, chosen, runtime)
    # Gravity, floor and walls (paper, Sec. III-A and III-B), matches of keypoints.
    seen = observations or extract_observations(
        scan, chosen, runtime, timer=timer, corrections=corrections
    )
    if surveyed is not None:
        seen = replace(seen, control=surveyed.control)
    if corrections.entries and seen.by_hand is None:
        by_hand = look_by_hand(scan, corrections, chosen, runtime or Runtime())
        assert by_hand is not None
        seen = corrected_observations(seen, by_hand)
    against = () if seen.by_hand is None else contradictions_of_images(seen.by_hand)
    if any(each.prevents for each in against):
        prevented = tuple(each for each in against if each.prevents)
        raise ContradictedError(corrections.name, prevented)
    # Keyframes; loops closed by what needs no plan; the sensor, by the same; plan and sensor in turns.
    held = with_priors_of(chosen, seen)
    calibrated, on_plan, adjustment = _solve(scan, seen, floorplan, held, own, timer, surveyed)
    # Is it better, by solves that did without a part of the evidence?
    with timer.stage("validate"):
        prepared, structure = calibrated.prepared, calibrated.observations.structure
        found = calibrated.calibration
        validation = validate(prepared, on_plan, adjustment, structure, held, own, found)
    result = make_result(scan, calibrated, on_plan, adjustment, validation, chosen, timer, surveyed)
    made_of = MadeOf(scan, given, chosen)
    if seen.by_hand is None:
        return replace(result, made_of=made_of)
    told, more = by_hand_outcome(
        seen.by_hand,
        result.plan_from_cams,
        on_plan.plan_from_level @ prepared.level_from_world,
        on_plan,
        chosen.align.control_point_tolerance_m,
    )
    positions = result.initial_plan_from_cams[:, :3, 3]
    bent = loops_against_motion(corrections, result.evidence.disagreements, positions)
    found = first_of_each((*against, *more, *bent))
    return replace(result, made_of=made_of, by_hand=ByHand(corrections, told, found))


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
    held = with_priors_of(chosen, seen)
    return _solve(scan, seen, floorplan, held, (), timer)[0].calibration


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
    first = calibrated, on_plan
    for _ in range(MAX_CORRECTIONS):
        # Walls may show that the sensor is off: then all that follows from its points comes again.
        before = calibrated
        calibrated = calibrate_on_plan(scan, before, on_plan, adjustment, options, timer)
        if calibrated.prepared is before.prepared:
            break
        calibrated, on_plan, adjustment = place(calibrated)
    on_plan = with_doubt_of_scale(first, calibrated, on_plan)
    # A sensor that is off looks like walls that were moved: these come last.
    with timer.stage("adjust"):
        prepared = calibrated.prepared
        recorded = prepared.level_from_cams[prepared.keyframes.frame_idx]
        stretch = cut_into_stretches(recorded, options.verdict.folds)
        adjustment = settle_walls(
            prepared.measurements,
            on_plan.floorplan,
            adjustment,
            options.adjust,
            lambda problem: error_model(problem, stretch, np.random.default_rng(options.seed)),
            extra_terms,
        )
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
    placed = options
    if isinstance(floorplan, Floorplan):
        placed = with_places(options, calibrated.observations.by_hand, prepared, floorplan)
    if surveyed is not None and not isinstance(floorplan, Mapping):
        # Control points take drift out, and say where the scan is.
        prepared, on_plan = place_by_control(scan, prepared, surveyed, floorplan, placed, timer)
        calibrated = replace(calibrated, prepared=prepared)
    elif isinstance(floorplan, Floorplan):
        calibrated, on_plan = align_with_jumps(scan, calibrated, floorplan, placed, timer)
        prepared = calibrated.prepared
        with timer.stage("align"):
            on_plan = against_walls(on_plan, prepared, floorplan, placed)
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
        if plan is not None and plan.before_line is not None:
            on_plan, poses = with_fitted_thickness(
                on_plan, prepared, adjustment, options, extra_terms
            )
            adjustment = adjust_to_plan(
                measured, on_plan.floorplan, poses, options.adjust, extra_terms
            )
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
