"""Jumps that only the plan can place: hypotheses of where the tracker jumped, and what the walls say of each.

Closing loops tore the walk, and several steps that nothing measured could be where the tracker jumped. With
the jump at the wrong one, the frames between stand beside their walls however well the loops close: on
ConSLAM with a jump of 3 m the plan explained 0.74 of the adjusted wall with it at the right step, and 0.54
to 0.63 at others (before the adjustment it explained as much at some wrong ones). A jump that no loop spans
shows by walls alone (`pipeline/parts.py`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from planfit.adjust import adjust_to_plan
from planfit.alignment import judge_adjusted
from planfit.alignment.plan_scale import CLEAR_GAIN
from planfit.alignment.selection import MIN_SCORE
from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan
from planfit.pipeline.align import align_to_plan, wall_samples
from planfit.pipeline.calibrate import CalibratedScan
from planfit.pipeline.observations import Observations
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.parts import matched_elsewhere, placed_by_parts
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.tracking import JumpHypothesis, Tracking, jump_hypotheses

MAX_JUMPS = 3
"""Jumps that revisits and walls place together, one after the other."""
SAME_SCORE = 0.02
"""Shares of explained wall that differ by less tell nothing: a jump at the next step, two frames apart."""
PARTS_GAIN = CLEAR_GAIN
"""By how much more of the wall has to be explained with parts of the walk placed one by one: each of them
is free to go where it fits best."""


@dataclass(frozen=True)
class _Tried:
    """A walk with a jump at some step, or as it is."""

    tracking: Tracking
    prepared: PreparedScan
    on_plan: ScanOnPlan
    times_usual: float = float("inf")
    """How unusual the step with the jump would truly be."""
    is_against: Bool[np.ndarray, " p"] | None = None
    """Pairs by surfaces that contradict it, and that it was prepared without; None: none."""


def align_with_jumps(
    scan: Scan,
    calibrated: CalibratedScan,
    floorplan: Floorplan,
    options: RefineOptions,
    timer: StageTimer,
) -> tuple[CalibratedScan, ScanOnPlan]:
    """Align as `align_to_plan` does, with jumps where walls fit the plan best, if the walk jumps somewhere.

    Args:
        scan: as recorded.
        calibrated: with loops closed.
        floorplan: as given.
        options: those of the run.
        timer: told of the stages; what is tried is not told one by one.

    Raises:
        FloorplanError: as `align_to_plan`, where no jump explains why.
    """
    for _ in range(MAX_JUMPS):
        seen = calibrated.observations
        if seen.tracking is None or not _is_in_question(calibrated.prepared, seen.tracking):
            break
        with timer.stage("jumps"):
            best = _best_by_revisits(scan, calibrated, floorplan, options)
        if best is None:
            break
        calibrated = _with_jump(calibrated, best)
    on_plan = align_to_plan(scan, calibrated.prepared, floorplan, options, timer)
    tracking = calibrated.observations.tracking
    if tracking is None:
        return calibrated, on_plan
    with timer.stage("jumps"):
        aligned = _Tried(tracking, calibrated.prepared, on_plan)
        by_parts = _better_by_parts(scan, calibrated, aligned, floorplan, options)
    if by_parts is None:
        return calibrated, on_plan
    return _with_jump(calibrated, by_parts), by_parts.on_plan


def _with_jump(calibrated: CalibratedScan, tried: _Tried) -> CalibratedScan:
    def changed(seen: Observations) -> Observations:
        if tried.is_against is not None:
            seen = replace(seen, surfaces=seen.surfaces[~tried.is_against])
        return replace(seen, tracking=tried.tracking)

    return replace(
        calibrated,
        as_lifted=changed(calibrated.as_lifted),
        observations=changed(calibrated.observations),
        prepared=tried.prepared,
    )


def _is_in_question(prepared: PreparedScan, tracking: Tracking) -> bool:
    """Whether the walk jumps somewhere, by all that is known, and nobody knows where."""
    is_torn = len(prepared.torn_steps) > 0 or len(tracking.contradicted_steps) > 0
    return is_torn and len(tracking.undecided_steps) > 0


def _best_by_revisits(
    scan: Scan, calibrated: CalibratedScan, floorplan: Floorplan, options: RefineOptions
) -> _Tried | None:
    """The hypothesis that the walls are in favour of; None where they are not surely in favour of any."""
    tracking = calibrated.observations.tracking
    assert tracking is not None
    tried = list(_tried_with_jumps(scan, calibrated, floorplan, options))
    if not tried:
        return None
    scores = [_adjusted_score(each, options) for each in tried]
    recorded = _aligned(scan, tracking, calibrated.prepared, floorplan, options)
    as_recorded = 0.0 if recorded is None else _adjusted_score(recorded, options)
    highest = max(scores)
    if highest < max(as_recorded - SAME_SCORE, MIN_SCORE):
        return None
    level = [t for t, score in zip(tried, scores, strict=True) if score > highest - SAME_SCORE]
    return min(level, key=lambda each: each.times_usual)


def _tried_with_jumps(
    scan: Scan, calibrated: CalibratedScan, floorplan: Floorplan, options: RefineOptions
) -> Iterator[_Tried]:
    """The walk with the jump at each undecided step where it lets loops close, aligned."""
    seen, torn = calibrated.observations, len(calibrated.prepared.torn_steps)
    assert seen.tracking is not None
    hypotheses: tuple[JumpHypothesis, ...] = jump_hypotheses(seen.tracking, seen.matches)
    for each in hypotheses:
        prepared = _prepared(scan, calibrated, each.tracking, options)
        if len(prepared.torn_steps) > max(torn - 1, 0):
            continue
        found = _aligned(scan, each.tracking, prepared, floorplan, options)
        if found is not None:
            yield replace(found, times_usual=each.times_usual)


def _better_by_parts(
    scan: Scan,
    calibrated: CalibratedScan,
    aligned: _Tried,
    floorplan: Floorplan,
    options: RefineOptions,
) -> _Tried | None:
    """The walk with its parts placed one by one, if much more of its walls is explained so."""
    tracking = placed_by_parts(aligned.prepared, aligned.tracking, aligned.on_plan, options)
    if tracking is None:
        return None
    known = calibrated.observations.surfaces
    is_elsewhere = matched_elsewhere(known, aligned.tracking, tracking)
    prepared = _prepared(scan, calibrated, tracking, options, is_elsewhere)
    found = _aligned(scan, tracking, prepared, floorplan, options)
    least = max(_adjusted_score(aligned, options) + PARTS_GAIN, MIN_SCORE)
    if found is None or _adjusted_score(found, options) < least:
        return None
    return replace(found, is_against=is_elsewhere)


def _prepared(
    scan: Scan,
    calibrated: CalibratedScan,
    tracking: Tracking,
    options: RefineOptions,
    without: Bool[np.ndarray, " p"] | None = None,
) -> PreparedScan:
    """With another tracking, and without some pairs by surfaces."""
    seen = replace(calibrated.observations, tracking=tracking)
    if without is not None:
        seen = replace(seen, surfaces=seen.surfaces[~without])
    return prepare(scan, seen, options, StageTimer(Runtime()))


def _aligned(
    scan: Scan,
    tracking: Tracking,
    prepared: PreparedScan,
    floorplan: Floorplan,
    options: RefineOptions,
) -> _Tried | None:
    """Where a walk lies on the plan; None where it cannot lie there."""
    try:
        on_plan = align_to_plan(scan, prepared, floorplan, options, StageTimer(Runtime()))
    except FloorplanError:  # a torn walk may seem to fit in another unit: no witness for itself
        return None
    return _Tried(tracking, prepared, on_plan)


def _adjusted_score(tried: _Tried, options: RefineOptions) -> float:
    """Share of wall that the plan explains once it has pulled."""
    on_plan, measured = tried.on_plan, tried.prepared.measurements
    if on_plan.alignment is None or on_plan.floorplan is None:
        return 0.0
    start = on_plan.plan_from_level @ tried.prepared.level_from_keys
    quick = replace(options.adjust, starts=options.adjust.starts[:1])
    adjusted = adjust_to_plan(measured, on_plan.floorplan, start, quick)
    walls = wall_samples(measured.structure, adjusted.solution.target_from_cams[: len(start)])
    return judge_adjusted(walls, on_plan.floorplan, on_plan.alignment, options.align).score
