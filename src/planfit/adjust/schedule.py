"""The order of the adjustment: loops first, then walls from several starts, then what the plan has wrong.

Walls that hold poses at once lock onto wrong walls where drift exceeds the spacing of walls. Once matches
have closed the loops and the whole is aligned with the plan, what is left is small; where it is not, several
starts compete. Walls that stand elsewhere than drawn are told last, when poses are consistent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from planfit.adjust.alternation import Alternation, PlanTask, alternate
from planfit.adjust.association import Association, PlanCorrespondences
from planfit.adjust.ceilings import settle_ceilings
from planfit.adjust.competition import Rival, best_of_starts
from planfit.adjust.contradicted_walls import Errors, without_contradicted_walls
from planfit.adjust.measurements import Measurements
from planfit.adjust.moved_walls import MovedWall
from planfit.adjust.observability import observability_findings
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import build_problem, ceiling_term
from planfit.adjust.torn_steps import (
    DroppedVisit,
    TornStep,
    find_torn_steps,
    visits_that_tear,
)
from planfit.findings import Finding
from planfit.floorplan import Floorplan
from planfit.geometry.se3 import Poses
from planfit.lsq.problem import Problem
from planfit.lsq.solver import Solution
from planfit.lsq.term import Term
from planfit.runtime import short_repr


def close_loops(
    measurements: Measurements, level_from_cams: Poses, options: AdjustOptions
) -> Solution:
    """Make the scan agree with itself: matches, floor and odometry, the first frame held.

    The loss of the matches narrows by `options.gnc_schedule` (graduated non-convexity). The floor, where
    seen, gives height and tilt; of the first frame only the rest is held.
    """
    problem = build_problem(measurements, options, level_from_cams)
    return Problem(problem.terms, problem.unknowns).solve_gnc(options.gnc_schedule, options.solver)


_NO_WALLS = Association(np.zeros(0, dtype=int), np.zeros(0))


@dataclass(frozen=True)
class ClosedLoops:
    """Poses that agree with each other, and the revisits that could not be right."""

    solution: Solution
    measurements: Measurements
    """Those solved with: without the matches of dropped visits."""
    is_dropped: Bool[np.ndarray, " p"]
    """Pairs of the measurements given whose visit was dropped."""
    dropped: tuple[DroppedVisit, ...]
    torn_steps: tuple[TornStep, ...]
    """Steps still torn, the worst first: no revisit is the cause."""

    __repr__ = short_repr


def close_loops_untorn(
    measurements: Measurements, level_from_cams: Poses, options: AdjustOptions
) -> ClosedLoops:
    """Close loops, give up the visits that tear a recorded step, and again, until no step is torn by one.

    Args:
        level_from_cams: poses as recorded, levelled.
    """
    is_dropped = np.zeros(len(measurements.matches.pairs), dtype=bool)
    left, dropped = measurements, []
    while True:  # ends, as each round drops a visit or is the last
        solution = close_loops(left, level_from_cams, options)
        torn = find_torn_steps(left, solution.target_from_cams, options.odometry)
        if not torn:
            break
        is_false, visits = visits_that_tear(left, level_from_cams, torn)
        if not visits:
            break
        dropped += visits
        is_dropped[np.flatnonzero(~is_dropped)[is_false]] = True
        left = replace(measurements, matches=measurements.matches.of_pairs(~is_dropped))
    return ClosedLoops(solution, left, is_dropped, tuple(dropped), torn)


@dataclass(frozen=True)
class PlanAdjustment:
    """Poses on the plan, and what the walls were associated with in the end."""

    solution: Solution
    correspondences: PlanCorrespondences | None
    """What the poses were held to in the plan, at the end; None without a plan."""
    offsets_m: Float[np.ndarray, " f"]
    """How far each face of the plan was found to stand off where it is drawn, along its normal;
    zero where no wall was seen, or where offsets were not asked for."""
    offset_sigmas_m: Float[np.ndarray, " f"]
    """Standard deviation of that; NaN where the face has no offset of its own."""
    rounds: int
    """Associations made."""
    converged: bool
    """Whether the last association did not change any more."""
    iterations: int
    """Rounds of reweighting, or steps of a descent, of all solves together."""
    weakly_constrained: tuple[Finding, ...] = ()
    """What nothing but the recorded motion, or nothing at all, holds."""
    moved_walls: tuple[MovedWall, ...] = ()
    """Faces that stand elsewhere than drawn, the furthest first; they do not hold the poses to the plan."""
    torn_steps: tuple[TornStep, ...] = ()
    """Recorded steps that were not kept, the worst first."""
    rivals: tuple[Rival, ...] = ()
    """Where other starts ended, if not in the same place."""

    __repr__ = short_repr

    @property
    def association(self) -> Association:
        """The face of each wall patch; of no patch where there is no plan."""
        return _NO_WALLS if self.correspondences is None else self.correspondences.walls


def adjust_to_plan(
    measurements: Measurements,
    floorplan: Floorplan | None,
    plan_from_cams: Poses,
    options: AdjustOptions,
    extra_terms: Sequence[Term] = (),
) -> PlanAdjustment:
    """Alternate association and solve (paper, Sec. III-D), from several starts; let go of moved walls.

    Args:
        measurements: what the scan says.
        floorplan: the plan. None adjusts what needs none: matches, floor and ceilings, the first frame held.
        plan_from_cams: poses aligned with the plan (without one, levelled), loops closed.
        options: see there.
        extra_terms: the user's own, over the poses of the solved frames; see `build_problem`.

    Raises:
        OptionError: PyTorch is needed and absent, or extra terms cannot be used.
    """
    if floorplan is None:
        return _adjust_alone(measurements, plan_from_cams, options, extra_terms)
    task, plan_from_cams = plan_task(measurements, floorplan, plan_from_cams, options, extra_terms)
    rivals: tuple[Rival, ...] = ()
    if options.has_several_starts:
        competition = best_of_starts(task, plan_from_cams)
        end, rivals = competition.best, competition.rivals
    else:
        end = alternate(task, plan_from_cams, options.wall_distances_m)
    return _as_adjustment(task, end, rivals)


def plan_task(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: Poses,
    options: AdjustOptions,
    extra_terms: Sequence[Term] = (),
) -> tuple[PlanTask, Poses]:
    """What is adjusted to what, and the poses to begin with, at the heights that floors and ceilings give."""
    ceilings_m, cameras_m = settle_ceilings(measurements, plan_from_cams, options)
    plan_from_cams = plan_from_cams.copy()
    plan_from_cams[:, 2, 3] = cameras_m
    task = PlanTask(measurements, floorplan, options, ceilings_m, tuple(extra_terms))
    return task, plan_from_cams


def settle_walls(
    measurements: Measurements,
    floorplan: Floorplan | None,
    adjustment: PlanAdjustment,
    options: AdjustOptions,
    errors: Errors,
    extra_terms: Sequence[Term] = (),
) -> PlanAdjustment:
    """Go on from an adjustment without the walls that all other evidence contradicts.

    Args:
        floorplan: the plan; without one nothing changes.
        options: of the adjustment; where walls may not have been moved, nothing changes.
    """
    held = adjustment.correspondences
    is_asked = options.has_several_starts and options.finds_moved_walls
    # Offsets of all walls are an own strategy; sums of means are no likelihoods.
    is_other = options.wall_offset_sigma_m > 0 or options.cost == "paper"
    if floorplan is None or held is None or not is_asked or is_other:
        return adjustment
    ceilings_m, poses = held.ceiling_heights_m, adjustment.solution.target_from_cams
    task = PlanTask(measurements, floorplan, options, ceilings_m, tuple(extra_terms))
    task = replace(task, moved_m=held.moved_m)
    begin = Alternation(
        task.problem(poses, held),
        adjustment.solution,
        held,
        adjustment.rounds,
        adjustment.iterations,
        adjustment.converged,
    )
    if begin.problem.odometry is None:
        return adjustment
    end, rivals = without_contradicted_walls(task, begin, errors)
    rivals = (*adjustment.rivals, *rivals)
    if end is begin:
        return replace(adjustment, rivals=rivals)
    return _as_adjustment(task, end, rivals)


def _as_adjustment(task: PlanTask, end: Alternation, rivals: tuple[Rival, ...]) -> PlanAdjustment:
    """Where it ended, and what is to be said of that."""
    measurements, options, extra_terms = task.measurements, task.options, task.extra_terms
    unknowns, plan_from_cams = end.solution.target_from_cams, end.plan_from_cams
    offsets_m, offset_sigmas_m = end.problem.offsets(unknowns)
    # The last association may differ from the one that was solved with, where it did not settle.
    found = build_problem(measurements, options, plan_from_cams, end.correspondences, extra_terms)
    return PlanAdjustment(
        replace(end.solution, target_from_cams=plan_from_cams),
        end.correspondences,
        offsets_m,
        offset_sigmas_m,
        end.rounds,
        end.converged,
        end.iterations,
        observability_findings(found, plan_from_cams),
        _moved_walls(end.correspondences, offsets_m, offset_sigmas_m),
        find_torn_steps(measurements, plan_from_cams, options.odometry),
        rivals,
    )


def _moved_walls(
    correspondences: PlanCorrespondences,
    offsets_m: Float[np.ndarray, " f"],
    sigmas_m: Float[np.ndarray, " f"],
) -> tuple[MovedWall, ...]:
    """Faces found elsewhere than drawn, the furthest first."""
    of_patches = correspondences.walls.face_idx[correspondences.is_moved]
    faces, counts = np.unique(of_patches, return_counts=True)
    moved = [
        MovedWall(int(face), float(offsets_m[face]), float(sigmas_m[face]), int(count))
        for face, count in zip(faces, counts, strict=True)
        if np.isfinite(sigmas_m[face])
    ]
    return tuple(sorted(moved, key=lambda wall: -abs(wall.offset_m)))


def _adjust_alone(
    measurements: Measurements,
    level_from_cams: Poses,
    options: AdjustOptions,
    extra_terms: Sequence[Term],
) -> PlanAdjustment:
    """Matches, floor, ceilings and odometry in one solve; the first frame is held, as by `close_loops`."""
    ceilings_m, _ = settle_ceilings(measurements, level_from_cams, options)
    problem = replace(
        build_problem(measurements, options, level_from_cams, extra_terms=extra_terms),
        ceiling=ceiling_term(measurements, ceilings_m, options),
    )
    solution = problem.solve()
    poses = solution.target_from_cams
    return PlanAdjustment(
        solution,
        None,
        offsets_m=np.zeros(0),
        offset_sigmas_m=np.zeros(0),
        rounds=0,
        converged=True,
        iterations=solution.iterations,
        weakly_constrained=observability_findings(problem, poses),
    )
