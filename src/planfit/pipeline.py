"""The method on one screen: from a posed scan and a floorplan to poses that fit the plan."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from planfit import checks
from planfit.adjust import (
    AdjustOptions,
    Evidence,
    WallsPulled,
    costs,
    follow_keyframes,
    pull_walls,
    refit_scale,
)
from planfit.align import Alignment, metric_plan
from planfit.doubts import fit_doubts, scan_doubts
from planfit.errors import require_plain_numbers
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.options import RefineOptions
from planfit.place import claimed_place, place
from planfit.prepare import Clock, Seen, look_through, prepare
from planfit.scan import Scan
from planfit.structure import Gravity, Structure
from planfit.work import Work


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
    walls: WallsPulled
    solved_frame_idx: np.ndarray  # (k,) frames that were unknowns; the others followed
    cost_by_term: dict[str, tuple[float, float]]
    """Robust cost of each term, before and after."""
    checks: tuple[checks.Check, ...]
    doubts: tuple[str, ...]
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
    work: Work | None = None,
    seen: Seen | None = None,
) -> RefineResult:
    """Refine the camera poses of a scan so that its reconstruction agrees with the floorplan.

    Args:
        scan: posed RGB-D frames.
        floorplan: wall faces, in metres or in a unit that is found here.
        options: defaults to what works best.
        work: threads, cache and progress; by default nothing is kept and nothing is said.
        seen: what `look_through` saw in this scan with the same options of structure and matching, where
            one scan is refined in many ways.

    Raises:
        ScanError: a file of the scan cannot be used.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
        OptionError: an option has a value that cannot work.
    """
    options, work = options or RefineOptions(), work or Work()
    require_plain_numbers(options)
    if not scan.fingerprint:
        work = dataclasses.replace(work, cache_dir=None)  # nothing tells one such scan from another
    clock = Clock(work)

    seen = seen or look_through(scan, options, work, clock)
    gravity, structure, matches = seen.gravity, seen.structure, seen.matches
    prepared = prepare(scan, seen, options, clock)
    held_out, keyframes, evidence = prepared.held_out, prepared.keyframes, prepared.evidence
    level, level_from_keys = prepared.level_from_world, prepared.level_from_keys
    recorded = level @ scan.world_from_cams
    with clock.stage("place on the plan"):
        claimed = claimed_place(scan, floorplan, level)
        alignment = place(prepared, floorplan, options.align, claimed)
        plan_from_level = alignment.plan_from_level if alignment else claimed
        if not floorplan.is_metric and alignment:
            floorplan = metric_plan(floorplan, alignment.scale_xy)
    if alignment is not None and alignment.is_sure and alignment.scale_spread > 0:
        with clock.stage("refit scale"):
            on_plan = alignment.plan_from_level @ level_from_keys
            refit = refit_scale(evidence, floorplan, on_plan, options.adjust)
            floorplan = floorplan.scaled(refit.factor)
            alignment = alignment.rescaled(
                refit.factor, refit.spread, on_plan[:, :2, 3].mean(axis=0)
            )
            plan_from_level = alignment.plan_from_level
    with clock.stage("pull walls"):
        start = np.eye(4) if plan_from_level is None else plan_from_level
        pulled = pull_walls(evidence, floorplan, start @ level_from_keys, options.adjust)

    if claimed is not None and (alignment is None or alignment.is_as_recorded):
        start = claimed
    plan_from_keys = pulled.solution.target_from_cams
    before, after = start @ recorded, follow_keyframes(plan_from_keys, keyframes)
    with clock.stage("check"):
        found = (
            checks.match_check(held_out, before, after),
            checks.wall_check(structure, floorplan, before, after),
            checks.tension_check(
                _total_cost(evidence, level_from_keys, options.adjust),
                _total_cost(evidence, plan_from_keys, options.adjust),
                len(scan),
            ),
        )
        cost_before, cost_after = (
            costs(evidence, poses, options.adjust, pulled.ties)
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
        walls=pulled,
        solved_frame_idx=keyframes.frame_idx,
        cost_by_term={name: (cost_before[name], cost_after[name]) for name in cost_before},
        checks=judged,
        doubts=(
            *scan_doubts(scan, gravity, structure, matches, options.matching.pairs.neighbours),
            *fit_doubts(alignment, claimed is not None, pulled, structure, judged),
        ),
        seconds_by_stage=clock.seconds,
    )


def _total_cost(evidence: Evidence, poses: np.ndarray, options: AdjustOptions) -> float:
    """Robust cost of the terms that need no plan."""
    return sum(costs(evidence, poses, options).values())


def _world_from_plan(
    plan_from_world: np.ndarray, before: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """Back to the recorded axes. The height is that of the first frame as recorded: later ones have
    drifted, and the plan says nothing of heights."""
    lift = np.array([0.0, 0.0, before[0, 2, 3] - after[0, 2, 3]])
    return se3.inverse(plan_from_world) @ se3.make_transform(np.eye(3), lift)
