"""The method on one screen: from a posed scan and a floorplan to poses that fit the plan."""

from collections.abc import Iterable

from planfit.adjust import adjust_to_plan
from planfit.floorplan import Floorplan
from planfit.lsq import Term
from planfit.pipeline.align import align_to_plan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import Observations, extract_observations, prepare
from planfit.pipeline.result import RefineResult, make_result
from planfit.pipeline.validation import validate
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan


def refine(
    scan: Scan,
    floorplan: Floorplan,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    observations: Observations | None = None,
    extra_terms: Iterable[Term] = (),
) -> RefineResult:
    """Refine the camera poses of a scan so that its reconstruction agrees with the floorplan.

    Args:
        scan: posed RGB-D frames.
        floorplan: wall faces, in metres or in a unit that is found here.
        options: defaults to what works best.
        runtime: threads, cache and progress; by default nothing is kept and nothing is said.
        observations: what `extract_observations` saw in this scan, or a user's own.
        extra_terms: terms of one's own over plan_from_cams of all frames, in the adjustment on the plan.

    Raises:
        ScanError: a file of the scan cannot be used.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
        OptionError: an option cannot work, or an extra term meets frames that are no unknowns.
    """
    chosen, own = options or RefineOptions(), tuple(extra_terms)
    timer = StageTimer(runtime or Runtime())
    # Gravity, floor and walls (paper, Sec. III-A and III-B), matches of keypoints.
    seen = observations or extract_observations(scan, chosen, runtime, timer=timer)
    # Keyframes; loops closed by what needs no plan.
    prepared = prepare(scan, seen, chosen, timer)
    # Rotation, translation and scale of the whole (paper, Sec. III-A).
    on_plan = align_to_plan(scan, prepared, floorplan, chosen, timer)
    # Walls associated with faces and all terms adjusted, in turns (paper, Sec. III-D and III-E).
    with timer.stage("adjust"):
        start = on_plan.plan_from_level @ prepared.level_from_keys
        measured, plan = prepared.measurements, on_plan.floorplan
        adjustment = adjust_to_plan(measured, plan, start, chosen.adjust, own)
    # Is it better, by solves that did without a part of the evidence?
    with timer.stage("validate"):
        validation = validate(prepared, on_plan, adjustment, seen.structure, chosen, own)
    return make_result(scan, seen, prepared, on_plan, adjustment, validation, chosen, timer)
