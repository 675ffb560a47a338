"""The order of the adjustment: loops first, then walls with shrinking distances, until nothing changes.

Walls that hold poses at once lock onto wrong walls where drift exceeds the spacing of walls. Once matches
have closed the loops and the whole is aligned with the plan, what is left is small, and a shrinking
association distance lets go of the patches that still belong elsewhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust.association import Association, PlanCorrespondences, associate_with_plan
from planfit.adjust.ceilings import find_ceilings
from planfit.adjust.measurements import Measurements
from planfit.adjust.observability import describe_observability
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import AdjustmentProblem, build_problem, ceiling_term
from planfit.floorplan import Floorplan
from planfit.lsq.covariance import covariances
from planfit.lsq.problem import Problem
from planfit.lsq.solver import Solution
from planfit.lsq.term import Term


def close_loops(
    measurements: Measurements,
    level_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
) -> Solution:
    """Make the scan agree with itself: matches, floor and odometry, the first frame held.

    The loss of the matches narrows by `options.gnc_schedule` (graduated non-convexity). The floor, where
    seen, gives height and tilt; of the first frame only the rest is held.
    """
    problem = build_problem(measurements, options, level_from_cams)
    return Problem(problem.terms, problem.unknowns).solve_gnc(options.gnc_schedule, options.solver)


_NO_WALLS = Association(np.zeros(0, dtype=int), np.zeros(0))


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
    weakly_constrained: tuple[str, ...] = ()
    """What nothing but the recorded motion, or nothing at all, holds: a sentence each."""
    covariances: Float[np.ndarray, "n 6 6"] | None = None
    """Of the poses (rad, m; plan axes), where asked for."""

    @property
    def association(self) -> Association:
        """The face of each wall patch; of no patch where there is no plan."""
        return _NO_WALLS if self.correspondences is None else self.correspondences.walls


@dataclass(frozen=True)
class _Alternation:
    """Where alternating association and solve has come to."""

    problem: AdjustmentProblem
    solution: Solution
    correspondences: PlanCorrespondences
    """At the solution's poses."""
    rounds: int
    iterations: int
    converged: bool


def adjust_to_plan(
    measurements: Measurements,
    floorplan: Floorplan | None,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
    extra_terms: Sequence[Term] = (),
) -> PlanAdjustment:
    """Alternate association and solve (paper, Sec. III-D), with association distances that shrink.

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
    n = len(plan_from_cams)
    end = _alternate(measurements, floorplan, plan_from_cams, options, extra_terms)
    unknowns = end.solution.target_from_cams
    plan_from_cams = unknowns[:n]
    offsets_m, offset_sigmas_m = end.problem.offsets(unknowns)
    # The last association may differ from the one that was solved with, where it did not settle.
    found = build_problem(measurements, options, plan_from_cams, end.correspondences, extra_terms)
    every = np.arange(n)
    return PlanAdjustment(
        replace(end.solution, target_from_cams=plan_from_cams),
        end.correspondences,
        offsets_m,
        offset_sigmas_m,
        end.rounds,
        end.converged,
        end.iterations,
        describe_observability(found, plan_from_cams),
        covariances(end.problem.terms, unknowns, every) if options.covariances else None,
    )


def _adjust_alone(
    measurements: Measurements,
    level_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
    extra_terms: Sequence[Term],
) -> PlanAdjustment:
    """Matches, floor, ceilings and odometry in one solve; the first frame is held, as by `close_loops`."""
    heights = options.ceiling_heights
    ceilings_m = find_ceilings(measurements.structure, level_from_cams, heights)
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
        weakly_constrained=describe_observability(problem, poses),
        covariances=covariances(problem.terms, poses, np.arange(len(poses)))
        if options.covariances
        else None,
    )


def _alternate(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
    extra_terms: Sequence[Term],
) -> _Alternation:
    """Associate and solve at each distance until the association settles there."""
    n, structure = len(plan_from_cams), measurements.structure
    rounds, iterations = 0, 0
    end: _Alternation | None = None
    # Ceilings are found once, like the paper's floor: what is sought is not moved by what it holds.
    ceilings_m = find_ceilings(structure, plan_from_cams, options.ceiling_heights)

    def associated(poses: Float[np.ndarray, "n 4 4"], distance_m: float) -> PlanCorrespondences:
        chosen = options.association
        return associate_with_plan(structure, floorplan, poses, distance_m, chosen, ceilings_m)

    for distance_m in options.wall_distances_m:
        correspondences = associated(plan_from_cams, distance_m)
        for _ in range(options.max_alternations):
            problem = build_problem(
                measurements, options, plan_from_cams, correspondences, extra_terms
            )
            solution = problem.solve()
            rounds, iterations = rounds + 1, iterations + solution.iterations
            plan_from_cams = solution.target_from_cams[:n]
            again = associated(plan_from_cams, distance_m)
            converged = again.is_same(correspondences)
            correspondences = again
            end = _Alternation(problem, solution, again, rounds, iterations, converged)
            if converged:
                break
    assert end is not None  # wall_distances_m is never empty
    return end
