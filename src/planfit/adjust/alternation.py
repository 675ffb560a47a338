"""Association and solve in turns, from where poses start to where neither changes any more."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from planfit.adjust.association import PatchesOnPlan, PlanCorrespondences, associate_with_plan
from planfit.adjust.measurements import Measurements
from planfit.adjust.moved_walls import MIN_SIGMAS, find_moved
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import AdjustmentProblem, build_problem
from planfit.floorplan import Floorplan
from planfit.geometry.se3 import Poses
from planfit.lsq.solver import Solution
from planfit.lsq.term import Term

NARROWING = (1.0, 0.7, 0.4)
"""Powers of the widths of losses, one stage each; then the losses as they stand."""
MAX_SEARCHES = 3
"""Times that moved walls are looked for."""
STAGE_ITERATIONS = 5
"""Rounds of reweighting in a stage with wide losses: the next one goes on."""


@dataclass(frozen=True)
class PlanTask:
    """What is adjusted to what; all but where it starts."""

    measurements: Measurements
    floorplan: Floorplan
    options: AdjustOptions
    ceilings_m: Float[np.ndarray, " n"]
    """Height of the ceiling that each frame sees. Found once, like the paper's floor: what is sought is
    not moved by what it holds."""
    extra_terms: tuple[Term, ...] = ()
    moved_m: Float[np.ndarray, " f"] | None = None
    """Of faces that stand elsewhere than drawn; see `PlanCorrespondences`."""

    def associated(self, plan_from_cams: Poses, distance_m: float) -> PlanCorrespondences:
        """Correspondences at poses, within a distance (m)."""
        return associate_with_plan(
            self.measurements.structure,
            self.floorplan,
            plan_from_cams,
            distance_m,
            self.options.association,
            self.ceilings_m,
            self.moved_m,
        )

    def walls_at(self, plan_from_cams: Poses) -> PatchesOnPlan:
        """Patches of wall at poses."""
        structure, options = self.measurements.structure, self.options.association
        walls = structure.walls
        return PatchesOnPlan(walls, self.floorplan, plan_from_cams, options, structure.storeys)

    def problem(
        self, plan_from_cams: Poses, correspondences: PlanCorrespondences
    ) -> AdjustmentProblem:
        """The problem that begins at poses."""
        return build_problem(
            self.measurements, self.options, plan_from_cams, correspondences, self.extra_terms
        )


@dataclass(frozen=True)
class Alternation:
    """Where alternating association and solve has come to."""

    problem: AdjustmentProblem
    solution: Solution
    correspondences: PlanCorrespondences
    """At the solution's poses."""
    rounds: int
    iterations: int
    converged: bool

    @property
    def plan_from_cams(self) -> Poses:
        """Poses, without what stands behind them among the unknowns."""
        return self.solution.target_from_cams[: self.problem.n_cams]


def alternate(task: PlanTask, plan_from_cams: Poses, distances_m: Sequence[float]) -> Alternation:
    """Associate and solve at each distance until the association settles there."""
    rounds, iterations = 0, 0
    end: Alternation | None = None
    for distance_m in distances_m:
        correspondences = task.associated(plan_from_cams, distance_m)
        for _ in range(task.options.max_alternations):
            problem = task.problem(plan_from_cams, correspondences)
            solution = problem.solve()
            rounds, iterations = rounds + 1, iterations + solution.iterations
            plan_from_cams = solution.target_from_cams[: len(plan_from_cams)]
            again = task.associated(plan_from_cams, distance_m)
            converged = again.is_same(correspondences)
            correspondences = again
            end = Alternation(problem, solution, again, rounds, iterations, converged)
            if converged:
                break
    assert end is not None  # wall_distances_m is never empty
    return end


def narrow(task: PlanTask, plan_from_cams: Poses, widths: Float[np.ndarray, " k"]) -> Poses:
    """Poses after graduated non-convexity of the walls' loss, each patch from a width of its own.

    Each stage associates once, within twice the scale of the patch's loss, and takes some steps. What
    follows is to be solved with the losses as they stand.

    Args:
        widths: factor on the scale of each wall patch's loss at first, 1 or more.
    """
    walls, shortest_m = task.options.model("walls"), task.options.wall_distances_m[-1]
    scale_m = walls.sigma * walls.loss.scale
    few = replace(task.options.solver, max_iterations=STAGE_ITERATIONS)
    stage = replace(task, options=replace(task.options, solver=few))
    for power in NARROWING:
        at = widths**power
        reach_m = np.maximum(2 * scale_m * at, shortest_m)
        found = task.associated(plan_from_cams, float(reach_m.max(initial=shortest_m)))
        is_within = np.abs(np.nan_to_num(found.walls.distance_m, nan=np.inf)) < reach_m
        kept = replace(found, walls=found.walls.only(is_within), widths=at)
        problem = stage.problem(plan_from_cams, kept)
        plan_from_cams = problem.solve().target_from_cams[: len(plan_from_cams)]
    return plan_from_cams


def without_moved_walls(task: PlanTask, end: Alternation, known: Sequence[int] = ()) -> Alternation:
    """Go on from where an adjustment ended, with walls that stand elsewhere than drawn let go of.

    Poses change a little once a wall no longer pulls, so walls are looked for again.

    Args:
        known: faces of which other evidence says that they were moved: how sure their offset is by the
            sigmas that terms were given does not count.
    """
    options = task.options
    if options.wall_offset_sigma_m > 0 or not options.finds_moved_walls:
        return end
    for _ in range(MAX_SEARCHES):
        seen = task.walls_at(end.plan_from_cams)
        moved_m = find_moved(seen, end.correspondences.walls_as_drawn, known)
        if np.array_equal(np.isfinite(moved_m), _is_moved(end)):
            break
        again = go_on(task, end, moved_m)
        off_m, sigmas_m = again.problem.offsets(again.solution.target_from_cams)
        is_sure = np.abs(off_m) > MIN_SIGMAS * sigmas_m
        is_sure[list(known)] = True
        if is_sure[np.isfinite(moved_m)].all():
            end = again
            continue
        moved_m[~is_sure] = np.nan
        return go_on(task, end, moved_m) if np.isfinite(moved_m).any() else end
    return end


def _is_moved(end: Alternation) -> Bool[np.ndarray, " f"]:
    """Faces that a solve took for moved."""
    moved_m = end.correspondences.moved_m
    if moved_m is None:
        return np.zeros(len(end.correspondences.floorplan), dtype=bool)
    return np.isfinite(moved_m)


def go_on(task: PlanTask, end: Alternation, moved_m: Float[np.ndarray, " f"]) -> Alternation:
    """Adjust further, with other faces moved."""
    again = replace(task, moved_m=moved_m)
    more = alternate(again, end.plan_from_cams, task.options.wall_distances_m[-1:])
    rounds, iterations = end.rounds + more.rounds, end.iterations + more.iterations
    return replace(more, rounds=rounds, iterations=iterations)
