"""The method on one screen: from a posed scan and a floorplan to poses that fit the plan."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from planfit.adjust.calibration import Calibration
from planfit.corrections import NO_CORRECTIONS, Corrections
from planfit.floorplan import Floorplan
from planfit.lsq import Term
from planfit.pipeline.align import observed_in_metres
from planfit.pipeline.calibrate import with_priors_of_poses
from planfit.pipeline.corrected import (
    judge_by_hand,
    observe_by_hand,
    solve_corrected,
    with_corrected_plan,
)
from planfit.pipeline.depth_unit import AS_READ, in_unit
from planfit.pipeline.given import Given, require_given, running
from planfit.pipeline.observations import Observations, extract_observations
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.result import MadeOf, RefineResult, make_result
from planfit.pipeline.solve import solve
from planfit.pipeline.survey import observe_survey
from planfit.pipeline.validation import validate
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.survey import Survey


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
    *,
    cache: str | Path | None = None,
    progress: bool = True,
) -> RefineResult:
    """Refine the camera poses of a scan so that its reconstruction agrees with the floorplan.

    Args:
        scan: posed RGB-D frames.
        floorplan: wall faces, in metres or in a unit that is found here. Of a walk through several storeys,
            the plan of each by its number: of two storeys the higher one has the higher number. None: the
            scan has to agree with itself alone, by closed loops, floors and ceilings; what is called the plan
            frame is then the level frame: the scan's own axes, turned upright, floor at 0.
        options: defaults to what works best.
        runtime: threads, cache and progress, in place of the last two arguments.
        observations: what `extract_observations` saw in this scan, or a user's own.
        extra_terms: terms of one's own over plan_from_cams of all frames, in the adjustment on the plan.
        survey: control points, which hold the poses, and check points, which only judge them.
        corrections: by hand; see docs/corrections.md.
        without_contradicted: whether corrections that others or the scan contradict are left out, and all is
            solved again without them; else they are used, as far as they can be, and named.
        cache: folder that keeps finished stages, so that another call with this scan goes on from them.
        progress: whether terminals and notebooks show how far it is.

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
    with running(runtime, cache, progress) as runs:
        given = Given(
            scan=scan,
            floorplan=floorplan,
            options=options or RefineOptions(),
            runtime=runs,
            observations=observations,
            extra_terms=tuple(extra_terms),
            survey=survey,
            corrections=corrections,
        )
        given.require_frames_of_terms()
        if not corrections.entries:
            return refine_given(given)
        return solve_corrected(refine_given, given, without_contradicted)


def refine_given(given: Given) -> RefineResult:
    """One refinement, with all corrections that are given, whatever they come to.

    Raises:
        ContradictedError: with these corrections nothing can be solved.
        And as `refine`.
    """
    timer, asked = StageTimer(given.runtime), given
    given = with_corrected_plan(given)
    surveyed = observe_survey(given, timer)
    # Gravity, floor and walls (paper, Sec. III-A and III-B), matches of keypoints.
    seen = given.observations or extract_observations(
        given.scan,
        given.options,
        given.runtime,
        timer=timer,
        corrections=given.corrections,
    )
    seen = observed_in_metres(given, seen, timer)
    if seen.depth_unit != AS_READ:
        given = replace(given, scan=in_unit(given.scan, seen.depth_unit))
        surveyed = observe_survey(given, timer)
    if surveyed is not None:
        seen = replace(seen, control=surveyed.control)
    seen = observe_by_hand(seen, given)
    # Alignment of the whole, then each pose (paper, Sec. III-A, III-D and III-E); the sensor in between.
    seen = with_priors_of_poses(seen)
    solved = solve(given, seen, timer, surveyed)
    # Is it better, by solves that did without a part of the evidence?
    with timer.stage("validate"):
        validation = validate(
            solved.prepared,
            solved.on_plan,
            solved.adjustment,
            solved.calibrated.observations.structure,
            given.options,
            given.extra_terms,
            solved.calibrated.calibration,
            seen.priors,
        )
    made_of = MadeOf(asked.scan, asked.floorplan, asked.options)
    result = make_result(given, solved, validation)
    result = replace(result, made_of=made_of, seconds_by_stage=timer.all_seconds())
    return judge_by_hand(result, given, seen, solved)


def calibrate(
    scan: Scan,
    floorplan: Floorplan | None = None,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
) -> Calibration:
    """Find what the scan's sensor gets wrong: `refine` without its judgement of the poses.

    Arguments and errors are those of `refine`; without a plan, matches, floor and recorded motion tell.
    """
    given = Given(scan, floorplan, options or RefineOptions(), runtime or Runtime())
    timer = StageTimer(given.runtime)
    seen = extract_observations(scan, given.options, given.runtime, timer=timer)
    seen = observed_in_metres(given, seen, timer)
    given = replace(given, scan=in_unit(scan, seen.depth_unit))
    seen = with_priors_of_poses(seen)
    found = solve(given, seen, timer).calibrated.calibration
    return replace(found, sensor=found.sensor.after(seen.depth_unit.factor))
