"""The method on one screen: from a posed scan and a floorplan to poses that fit the plan."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from planfit.adjust import (
    AdjustOptions,
    Measurements,
    PlanAdjustment,
    adjust_to_plan,
    costs,
    follow_keyframes,
    refit_scale,
)
from planfit.align import Alignment, metric_plan
from planfit.errors import require_plain_numbers
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.pipeline import validation as checks
from planfit.pipeline.align import claimed_alignment, place
from planfit.pipeline.diagnostics import alignment_warnings, scan_warnings
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import Observations, extract_observations, prepare
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.segmentation import Gravity, Structure


@dataclass(frozen=True)
class RefineResult:
    """Refined poses, and all that is needed to judge them."""

    floorplan: Floorplan
    """The plan in metres, at the scale that was found where it had no unit."""
    plan_from_cams: np.ndarray  # (n, 4, 4) refined
    initial_plan_from_cams: np.ndarray  # (n, 4, 4) recorded poses, placed on the plan as a whole
    world_from_plan: np.ndarray  # (4, 4) back to the scan's own axes and height
    gravity: Gravity
    structure: Structure
    matches: Matches
    alignment: Alignment | None
    """None where no wall was seen, so that the scan could not be placed by its walls."""
    walls: PlanAdjustment
    solved_frame_idx: np.ndarray  # (k,) frames that were unknowns; the others followed
    cost_by_term: dict[str, tuple[float, float]]
    """Robust cost of each term, before and after."""
    checks: tuple[checks.Check, ...]
    warnings: tuple[str, ...]
    """What a user should know before trusting the result, in plain words."""
    seconds_by_stage: dict[str, float]

    @property
    def world_from_cams(self) -> np.ndarray:
        """(n, 4, 4) refined poses in the scan's own axes."""
        return self.world_from_plan @ self.plan_from_cams

    @property
    def is_better(self) -> bool:
        """Whether the scan was surely placed on the plan and no check got worse."""
        is_placed = self.alignment is not None and self.alignment.is_sure
        return is_placed and not any(check.is_worse for check in self.checks)


def refine(
    scan: Scan,
    floorplan: Floorplan,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    seen: Observations | None = None,
) -> RefineResult:
    """Refine the camera poses of a scan so that its reconstruction agrees with the floorplan.

    Args:
        scan: posed RGB-D frames.
        floorplan: wall faces, in metres or in a unit that is found here.
        options: defaults to what works best.
        runtime: threads, cache and progress; by default nothing is kept and nothing is said.
        seen: what `extract_observations` saw in this scan with the same options of structure and
            matching, where one scan is refined in many ways.

    Raises:
        ScanError: a file of the scan cannot be used.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
        OptionError: an option has a value that cannot work.
    """
    options, runtime = options or RefineOptions(), runtime or Runtime()
    require_plain_numbers(options)
    if not scan.fingerprint:
        runtime = dataclasses.replace(
            runtime, cache_dir=None
        )  # nothing tells one such scan from another
    timer = StageTimer(runtime)

    seen = seen or extract_observations(scan, options, runtime, timer)
    gravity, structure, matches = seen.gravity, seen.structure, seen.matches
    prepared = prepare(scan, seen, options, timer)
    held_out, keyframes, measurements = prepared.held_out, prepared.keyframes, prepared.measurements
    level, level_from_keys = prepared.level_from_world, prepared.level_from_keys
    recorded = level @ scan.world_from_cams
    with timer.stage("place on the plan"):
        claimed = claimed_alignment(scan, floorplan, level)
        alignment = place(prepared, floorplan, options.align, claimed)
        plan_from_level = alignment.plan_from_level if alignment else claimed
        if not floorplan.is_metric and alignment:
            floorplan = metric_plan(floorplan, alignment.scale_xy)
    if alignment is not None and alignment.is_sure and alignment.scale_sigma > 0:
        with timer.stage("refit scale"):
            on_plan = alignment.plan_from_level @ level_from_keys
            refit = refit_scale(measurements, floorplan, on_plan, options.adjust)
            floorplan = floorplan.scaled(refit.factor)
            alignment = alignment.rescaled(
                refit.factor, refit.spread, on_plan[:, :2, 3].mean(axis=0)
            )
            plan_from_level = alignment.plan_from_level
    with timer.stage("pull walls"):
        start = np.eye(4) if plan_from_level is None else plan_from_level
        plan_adjustment = adjust_to_plan(
            measurements, floorplan, start @ level_from_keys, options.adjust
        )

    if claimed is not None and (alignment is None or alignment.is_as_recorded):
        start = claimed
    plan_from_keys = plan_adjustment.solution.target_from_cams
    before, after = start @ recorded, follow_keyframes(plan_from_keys, keyframes)
    with timer.stage("check"):
        found = (
            checks.match_check(held_out, before, after),
            checks.wall_check(structure, floorplan, before, after),
            checks.consistency_check(
                _total_cost(measurements, level_from_keys, options.adjust),
                _total_cost(measurements, plan_from_keys, options.adjust),
                len(scan),
            ),
        )
        cost_before, cost_after = (
            costs(measurements, poses, options.adjust, plan_adjustment.correspondences)
            for poses in (before[keyframes.frame_idx], plan_from_keys)
        )
    judged = tuple(check for check in found if check)
    return RefineResult(
        floorplan=floorplan,
        plan_from_cams=after,
        initial_plan_from_cams=before,
        world_from_plan=_world_from_plan(start @ level, before, after),
        gravity=gravity,
        structure=structure,
        matches=matches,
        alignment=alignment,
        walls=plan_adjustment,
        solved_frame_idx=keyframes.frame_idx,
        cost_by_term={name: (cost_before[name], cost_after[name]) for name in cost_before},
        checks=judged,
        warnings=(
            *scan_warnings(scan, gravity, structure, matches, options.matching.pairs.neighbours),
            *alignment_warnings(alignment, claimed is not None, plan_adjustment, structure, judged),
        ),
        seconds_by_stage=timer.seconds,
    )


def _total_cost(measurements: Measurements, poses: np.ndarray, options: AdjustOptions) -> float:
    """Robust cost of the terms that need no plan."""
    return sum(costs(measurements, poses, options).values())


def _world_from_plan(
    plan_from_world: np.ndarray, before: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """Back to the recorded axes. The height is that of the first frame as recorded: later ones have
    drifted, and the plan says nothing of heights."""
    lift = np.array([0.0, 0.0, before[0, 2, 3] - after[0, 2, 3]])
    return se3.inverse(plan_from_world) @ se3.make_transform(np.eye(3), lift)
