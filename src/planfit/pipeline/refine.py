"""The method on one screen: from a posed scan and a floorplan to poses that fit the plan."""

from collections.abc import Iterable, Mapping

from planfit.adjust import adjust_to_plan, check_extra_terms, choose_keyframes
from planfit.floorplan import Floorplan
from planfit.lsq import Term
from planfit.pipeline.align import align_to_plan
from planfit.pipeline.on_plan import STANDS_ALONE
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import Observations, extract_observations, prepare
from planfit.pipeline.result import RefineResult, make_result
from planfit.pipeline.storeys import place_on_storeys
from planfit.pipeline.validation import validate
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan


def refine(
    scan: Scan,
    floorplan: Floorplan | Mapping[int, Floorplan] | None,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    observations: Observations | None = None,
    extra_terms: Iterable[Term] = (),
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

    Raises:
        ScanError: a file of the scan cannot be used.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
            Or plans of storeys fit in another order than that of their numbers.
        OptionError: an option cannot work, or an extra term meets frames that are no unknowns.
    """
    chosen, own = options or RefineOptions(), tuple(extra_terms)
    _require_frames_for(own, scan, chosen)
    timer = StageTimer(runtime or Runtime())
    # Gravity, floor and walls (paper, Sec. III-A and III-B), matches of keypoints.
    seen = observations or extract_observations(scan, chosen, runtime, timer=timer)
    # Keyframes; loops closed by what needs no plan.
    prepared = prepare(scan, seen, chosen, timer)
    # Rotation, translation and scale of the whole (paper, Sec. III-A).
    on_plan = STANDS_ALONE
    if isinstance(floorplan, Floorplan):
        on_plan = align_to_plan(scan, prepared, floorplan, chosen, timer)
    elif floorplan is not None:
        # Each storey alone, then all in one frame (docs/adr/0011-several-storeys.md).
        placed = place_on_storeys(scan, seen, prepared, floorplan, chosen, timer)
        seen, prepared, on_plan = placed.observations, placed.prepared, placed.on_plan
    # Walls associated with faces and all terms adjusted, in turns (paper, Sec. III-D and III-E); without a
    # plan all terms but walls.
    with timer.stage("adjust"):
        start = on_plan.plan_from_level @ prepared.level_from_keys
        measured, plan = prepared.measurements, on_plan.floorplan
        adjustment = adjust_to_plan(measured, plan, start, chosen.adjust, own)
    # Is it better, by solves that did without a part of the evidence?
    with timer.stage("validate"):
        validation = validate(prepared, on_plan, adjustment, seen.structure, chosen, own)
    return make_result(scan, seen, prepared, on_plan, adjustment, validation, chosen, timer)


def _require_frames_for(extra_terms: tuple[Term, ...], scan: Scan, options: RefineOptions) -> None:
    """Refuse now, not after matching, what the adjustment would refuse of extra terms."""
    if extra_terms:
        keyframes = choose_keyframes(scan.world_from_cams, options.adjust.keyframes)
        n_keyframes = len(keyframes.frame_idx)
        n_reduced = None if n_keyframes == len(scan) else n_keyframes
        check_extra_terms(extra_terms, options.adjust, n_reduced)
