"""The order of the adjustment: loops first, then walls with shrinking distances, until nothing changes.

Pulling walls at once locks onto wrong walls where drift exceeds the spacing of walls. Once matches
have closed the loops and the whole is placed on the plan, what is left is small, and a shrinking
association distance lets go of the pieces that still belong elsewhere.
"""

from dataclasses import dataclass, replace

import numpy as np

from planfit.adjust.association import Association
from planfit.adjust.ceilings import find_ceilings
from planfit.adjust.correspondences import PlanCorrespondences, associate_with_plan
from planfit.adjust.measurements import Measurements
from planfit.adjust.observability import describe_observability
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import PlanProblem, make_problem, solve_problem
from planfit.floorplan import Floorplan
from planfit.lsq.covariance import covariances
from planfit.lsq.problem import Problem
from planfit.lsq.solver import Solution


def close_loops(
    measurements: Measurements, level_from_cams: np.ndarray, options: AdjustOptions
) -> Solution:
    """Make the scan agree with itself: matches, floor and odometry, the first frame held.

    The loss of the matches narrows by `options.gnc_schedule` (graduated non-convexity). The floor, where
    seen, gives height and tilt; of the first frame only the rest is held.
    """
    pose_prior = measurements.pose_prior(level_from_cams, options)
    problem = Problem([*measurements.terms(options), pose_prior], level_from_cams)
    return problem.solve_gnc(options.gnc_schedule, options.solver)


@dataclass(frozen=True)
class PlanAdjustment:
    """Poses on the plan, and what the walls were associated with in the end."""

    solution: Solution
    correspondences: PlanCorrespondences
    """What the poses were held to in the plan, at the end."""
    offsets_m: np.ndarray
    """(f,) how far each face of the plan was found to stand off where it is drawn, along its normal;
    zero where no wall was seen, or where offsets were not asked for."""
    offset_sigmas_m: np.ndarray
    """(f,) standard deviation of that; NaN where the face has no offset of its own."""
    rounds: int
    """Associations made."""
    settled: bool
    """Whether the last association did not change any more."""
    iterations: int
    """Rounds of reweighting, or steps of a descent, of all solves together."""
    weakly_constrained: tuple[str, ...] = ()
    """What nothing but the recorded motion, or nothing at all, holds: a sentence each."""
    covariances: np.ndarray | None = None
    """(n, 6, 6) of the poses (rad, m; plan axes), where asked for."""

    @property
    def association(self) -> Association:
        """The face of each piece of wall."""
        return self.correspondences.walls


def adjust_to_plan(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: np.ndarray,
    options: AdjustOptions,
) -> PlanAdjustment:
    """Alternate association and solve (paper, Sec. III-D), with association distances that shrink.

    Args:
        measurements: what the scan says.
        floorplan: the plan.
        plan_from_cams: (n, 4, 4) poses placed on the plan, loops closed.
        options: see there.
    """
    n = len(plan_from_cams)
    rounds, settled, iterations = 0, False, 0
    problem: PlanProblem | None = None
    solution: Solution | None = None
    correspondences: PlanCorrespondences | None = None
    # Ceilings are found once, like the paper's floor: what is sought is not moved by what it pulls.
    ceilings_m = find_ceilings(measurements.structure, plan_from_cams, options.ceiling_heights)
    for distance_m in options.wall_distances_m:
        correspondences = associate_with_plan(
            measurements, floorplan, plan_from_cams, distance_m, options, ceilings_m
        )
        for _ in range(options.max_alternations):
            rounds += 1
            problem = make_problem(measurements, correspondences, plan_from_cams, options)
            solution = solve_problem(problem, options)
            iterations += solution.iterations
            plan_from_cams = solution.target_from_cams[:n]
            again = associate_with_plan(
                measurements, floorplan, plan_from_cams, distance_m, options, ceilings_m
            )
            settled = again.is_same(correspondences)
            correspondences = again
            if settled:
                break
    assert problem is not None  # wall_distances_m is never empty
    assert solution is not None
    assert correspondences is not None
    unknowns = solution.target_from_cams
    offsets_m, offset_sigmas_m = problem.offsets(unknowns)
    every = np.arange(n)
    return PlanAdjustment(
        replace(solution, target_from_cams=plan_from_cams),
        correspondences,
        offsets_m,
        offset_sigmas_m,
        rounds,
        settled,
        iterations,
        describe_observability(measurements, correspondences, plan_from_cams, options),
        covariances(problem.terms, unknowns, every) if options.covariances else None,
    )
