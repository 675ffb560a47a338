"""Jumps that only the plan can place: hypotheses of where the tracker jumped, and what the walls say of each.

Closing loops tore the walk, and several steps that nothing measured could be where the tracker jumped. With
the jump at the wrong one, the frames between stand beside their walls however well the loops close: on
ConSLAM with a jump of 3 m the plan explained 0.74 of the adjusted wall with it at the right step, and 0.54
to 0.63 at others (before the adjustment it explained as much at some wrong ones). A jump that no loop spans
shows by walls alone (`pipeline/parts.py`).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from planfit.adjust import adjust_to_plan
from planfit.alignment import judge_adjusted
from planfit.alignment.plan_scale import CLEAR_GAIN, SAME_SCORE
from planfit.alignment.selection import MIN_SCORE
from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching import Matches
from planfit.pipeline.align import align_to_plan, wall_samples
from planfit.pipeline.calibrate import CalibratedScan
from planfit.pipeline.observations import Observations
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.parts import matched_elsewhere, opened_by_walls, placed_by_parts
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.scan.odometry import unusualness, usual_step
from planfit.tracking import Tracking
from planfit.tracking.breaks import consensus, is_large, isotropic, votes_on
from planfit.tracking.motions import MAX_SIGMAS, expected_covariance
from planfit.tracking.submaps import motions_between
from planfit.tracking.types import MIN_WITNESSES, describe_jump

MAX_JUMPS = 3
"""Jumps that revisits and walls place together, one after the other."""
PARTS_GAIN = CLEAR_GAIN
"""By how much more of the wall has to be explained with parts of the walk placed one by one: each of them
is free to go where it fits best."""


@dataclass(frozen=True)
class JumpHypothesis:
    """The walk with a jump at one step that nothing else decides."""

    step: int
    """Frame before the jump."""
    tracking: Tracking
    """With the frames after it where revisits put them."""
    cost: float
    """By how much less like a walk the step is so than as recorded, squared sigmas (`unusualness`)."""


@dataclass(frozen=True)
class _Tried:
    """A walk with a jump at some step, or as it is."""

    tracking: Tracking
    prepared: PreparedScan
    on_plan: ScanOnPlan
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

    Raises:
        FloorplanError: as `align_to_plan`, where no jump explains why.
    """
    for _ in range(MAX_JUMPS):
        seen = calibrated.observations
        if seen.tracking is None or not _is_in_question(calibrated.prepared, seen.tracking):
            break
        with timer.stage("jumps"):
            best = _Walk(scan, calibrated, floorplan, options).best_by_revisits(seen.tracking)
        if best is None:
            break
        calibrated = _with_jump(calibrated, best)
    on_plan = align_to_plan(scan, calibrated.prepared, floorplan, options, timer)
    tracking = calibrated.observations.tracking
    if tracking is None:
        return calibrated, on_plan
    with timer.stage("jumps"):
        aligned = _Tried(tracking, calibrated.prepared, on_plan)
        walk = _Walk(scan, calibrated, floorplan, options)
        by_parts = walk.better_by_parts(aligned)
        opened = walk.opened(by_parts or aligned)
    best = opened or by_parts
    if best is None:
        return calibrated, on_plan
    return _with_jump(calibrated, best), best.on_plan


def _with_jump(calibrated: CalibratedScan, tried: _Tried) -> CalibratedScan:
    as_lifted, observations = (
        _tracked(seen, tried.tracking, tried.is_against)
        for seen in (calibrated.as_lifted, calibrated.observations)
    )
    return replace(
        calibrated, as_lifted=as_lifted, observations=observations, prepared=tried.prepared
    )


def _tracked(
    seen: Observations, tracking: Tracking, without: Bool[np.ndarray, " p"] | None
) -> Observations:
    """With another tracking, and without some pairs by surfaces."""
    surfaces = seen.surfaces if without is None else seen.surfaces[~without]
    return replace(seen, tracking=tracking, surfaces=surfaces)


def _is_in_question(prepared: PreparedScan, tracking: Tracking) -> bool:
    """Whether the walk jumps somewhere, by all that is known, and nobody knows where."""
    is_torn = len(prepared.torn_steps) > 0 or len(tracking.contradicted_steps) > 0
    return is_torn and len(tracking.undecided_steps) > 0


@dataclass(frozen=True)
class _Walk:
    """A walk with loops closed, and the plan that hypotheses of jumps are aligned to."""

    scan: Scan
    calibrated: CalibratedScan
    floorplan: Floorplan
    options: RefineOptions

    def best_by_revisits(self, tracking: Tracking) -> _Tried | None:
        """The hypothesis that the walls are in favour of; None where they are not surely in favour of any."""
        tried = self.tried_with_jumps(tracking)
        if not tried:
            return None
        scores = [self.adjusted_score(each) for each in tried]
        recorded = self.aligned(tracking, self.calibrated.prepared)
        as_recorded = 0.0 if recorded is None else self.adjusted_score(recorded)
        highest = max(scores)
        if highest < max(as_recorded - SAME_SCORE, MIN_SCORE):
            return None
        return next(
            t for t, score in zip(tried, scores, strict=True) if score > highest - SAME_SCORE
        )

    def tried_with_jumps(self, tracking: Tracking) -> list[_Tried]:
        """The walk with the jump at each undecided step where it lets loops close, the likeliest jump first;
        all are where that one lies.

        With loops closed from the same first frame, hypotheses differ by few frames: one alignment serves
        all. Twelve of ConSLAM took 180 CPU s with one for each.
        """
        most_torn = max(len(self.calibrated.prepared.torn_steps) - 1, 0)
        found = jump_hypotheses(tracking, self.calibrated.observations.matches)
        walks = [
            (each, prepared)
            for each in sorted(found, key=lambda each: each.cost)
            for prepared in [self.prepared(each.tracking)]
            if len(prepared.torn_steps) <= most_torn
        ]
        aligned = (self.aligned(each.tracking, prepared) for each, prepared in walks)
        first = next((each for each in aligned if each is not None), None)
        if first is None:
            return []
        return [_Tried(each.tracking, p, first.on_plan) for each, p in walks]

    def better_by_parts(self, as_is: _Tried) -> _Tried | None:
        """The walk with its parts placed one by one, if much more of its walls is explained so."""
        tracking = placed_by_parts(as_is.prepared, as_is.tracking, as_is.on_plan, self.options)
        if tracking is None:
            return None
        known = self.calibrated.observations.surfaces
        is_elsewhere = matched_elsewhere(known, as_is.tracking, tracking)
        found = self.aligned(tracking, self.prepared(tracking, is_elsewhere))
        least = max(self.adjusted_score(as_is) + PARTS_GAIN, MIN_SCORE)
        if found is None or self.adjusted_score(found) < least:
            return None
        return replace(found, is_against=is_elsewhere)

    def opened(self, as_is: _Tried) -> _Tried | None:
        """The walk with steps open beyond which its walls are nowhere on the plan, if there are any.

        Neither where the whole was aligned nor once its walls have pulled: drift of 0.3 m is no jump.
        """
        on_plan, walk = as_is.on_plan, (as_is.prepared, as_is.tracking, as_is.on_plan, self.options)
        tracking = opened_by_walls(*walk, on_plan.plan_from_level @ as_is.prepared.level_from_keys)
        if tracking is not None and on_plan.floorplan is not None:
            tracking = opened_by_walls(*walk, self.adjusted(as_is, on_plan.floorplan))
        if tracking is None:
            return None
        prepared = self.prepared(tracking, as_is.is_against)
        found = self.aligned(tracking, prepared) or _Tried(tracking, prepared, as_is.on_plan)
        return replace(found, is_against=as_is.is_against)

    def prepared(
        self, tracking: Tracking, without: Bool[np.ndarray, " p"] | None = None
    ) -> PreparedScan:
        """The walk with another tracking, and without some pairs by surfaces."""
        seen = _tracked(self.calibrated.observations, tracking, without)
        return prepare(self.scan, seen, self.options, StageTimer(Runtime()))

    def aligned(self, tracking: Tracking, prepared: PreparedScan) -> _Tried | None:
        """Where a walk lies on the plan; None where it cannot lie there."""
        quiet = StageTimer(Runtime())
        try:
            on_plan = align_to_plan(self.scan, prepared, self.floorplan, self.options, quiet)
        except FloorplanError:  # a torn walk may seem to fit in another unit: no witness for itself
            return None
        return _Tried(tracking, prepared, on_plan)

    def adjusted_score(self, tried: _Tried) -> float:
        """Share of wall that the plan explains once it has pulled."""
        on_plan, structure = tried.on_plan, tried.prepared.measurements.structure
        if on_plan.alignment is None or on_plan.floorplan is None:
            return 0.0
        walls = wall_samples(structure, self.adjusted(tried, on_plan.floorplan))
        return judge_adjusted(walls, on_plan.floorplan, on_plan.alignment, self.options.align).score

    def adjusted(self, tried: _Tried, plan: Floorplan) -> Poses:
        """Keyframes on the plan once it has pulled, plan_from_cams."""
        start = tried.on_plan.plan_from_level @ tried.prepared.level_from_keys
        quick = replace(self.options.adjust, starts=self.options.adjust.starts[:1])
        solution = adjust_to_plan(tried.prepared.measurements, plan, start, quick).solution
        return solution.target_from_cams[: len(start)]


def jump_hypotheses(tracking: Tracking, matches: Matches) -> tuple[JumpHypothesis, ...]:
    """One hypothesis for each undecided step over which revisits ask for a jump.

    Args:
        tracking: as judged, undecided steps as recorded.
    """
    usual = usual_step(tracking.odometry.cam_from_next)
    found = (
        _with_jump_at(int(step), tracking, matches, usual) for step in tracking.undecided_steps
    )
    return tuple(each for each in found if each is not None)


def _with_jump_at(
    step: int,
    tracking: Tracking,
    matches: Matches,
    usual: tuple[float, float],
) -> JumpHypothesis | None:
    poses, odometry = tracking.world_from_cams, tracking.odometry
    is_after = np.arange(len(poses)) > step
    motions = motions_between(matches, is_after.astype(int))
    if len(motions) < MIN_WITNESSES:
        return None
    votes = votes_on(poses, motions, expected_covariance(motions, odometry), is_after)
    agreed = consensus(votes, np.arange(len(motions)), MAX_SIGMAS)
    if agreed is None or not is_large(agreed[0], votes.pivot):
        return None
    displaced, covariance = agreed
    moved = poses.copy()
    moved[is_after] = displaced @ poses[is_after]
    steps = odometry.cam_from_next.copy()
    steps[step] = se3.inverse(moved[step]) @ moved[step + 1]
    # The revisits that say how far the jump went are among the matches, which are to hold the step.
    sigmas = odometry.sigma_rotation.copy(), odometry.sigma_translation.copy()
    rotation, translation = isotropic(covariance)
    size = se3.inverse(odometry.cam_from_next[step]) @ steps[step]
    sigmas[0][step] = max(rotation, float(se3.rotation_angle(size[:3, :3])))
    sigmas[1][step] = max(translation, float(np.linalg.norm(size[:3, 3])))
    agrees = votes.cost(displaced) < MAX_SIGMAS**2
    told = describe_jump(
        tracking.recorded_world_from_cams, moved, step, int(agrees.sum()), "revisits and the plan"
    )
    # What said that the walk jumps somewhere is answered.
    breaks = [b for b in tracking.breaks if b.kind != "jump" or b.n_motions > 0]
    jumped = replace(
        tracking,
        world_from_cams=moved,
        odometry=replace(
            odometry, cam_from_next=steps, sigma_rotation=sigmas[0], sigma_translation=sigmas[1]
        ),
        breaks=tuple(sorted((*breaks, told), key=lambda b: b.first_frame)),
        undecided_steps=np.setdiff1d(tracking.undecided_steps, [step]),
        contradicted_steps=np.zeros(0, dtype=int),
    )
    told, recorded = unusualness(np.stack([steps[step], odometry.cam_from_next[step]]), usual)
    return JumpHypothesis(step, jumped, float(told - recorded))
