"""One adjustment on the plan, faces fixed: its terms and unknowns, and the solver that was chosen."""

from dataclasses import dataclass

import numpy as np

from planfit.adjust.correspondences import PlanCorrespondences, level_and_column_terms, wall_terms
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.adjust.paper.descent import PaperWeights, descend
from planfit.adjust.terms.wall_offsets import (
    OffsetWallTerm,
    offset_prior,
    offset_sigmas,
    read_offsets,
    with_offsets,
)
from planfit.lsq.bounded import solve_bounded
from planfit.lsq.problem import Problem
from planfit.lsq.solver import Cost, Solution
from planfit.lsq.term import Term


@dataclass(frozen=True)
class PlanProblem:
    """Terms, and unknowns to begin with."""

    measurements: Measurements
    correspondences: PlanCorrespondences
    geometric: list[Term]
    others: list[Term]
    unknowns: np.ndarray
    """(n, 4, 4) plan_from_cams; behind them, with wall offsets, the faces' (f, 4, 4)."""
    n_cams: int

    @property
    def terms(self) -> list[Term]:
        """All of them."""
        return [*self.geometric, *self.others]

    def offsets(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offset of each face (f,) m where a solve ended, and its standard deviation (f,) m.

        Zero and NaN for faces without an offset of their own.
        """
        floorplan = self.correspondences.floorplan
        offsets_m, sigmas_m = np.zeros(len(floorplan)), np.full(len(floorplan), np.nan)
        if len(unknowns) > self.n_cams:
            seen = np.unique(
                self.correspondences.walls.face_idx[self.correspondences.walls.face_idx >= 0]
            )
            offsets_m = read_offsets(unknowns, self.n_cams, floorplan)
            sigmas_m[seen] = offset_sigmas(
                self.terms, unknowns, self.n_cams + seen, floorplan.normals[seen]
            )
        return offsets_m, sigmas_m


def make_problem(
    measurements: Measurements,
    correspondences: PlanCorrespondences,
    plan_from_cams: np.ndarray,
    options: AdjustOptions,
) -> PlanProblem:
    """The terms of one solve; where nothing is tied to the plan, the place that was found is held."""
    n, walls, unknowns = len(plan_from_cams), measurements.structure.walls, plan_from_cams
    geometric = measurements.geometric_terms(options)
    others = measurements.terms(options)[len(geometric) :]
    others += level_and_column_terms(measurements, correspondences, options)
    on_walls = wall_terms(measurements, correspondences, options)
    if on_walls and options.wall_strategy == "fixed" and options.walls.offset_sigma_m > 0:
        on_walls = [
            OffsetWallTerm(
                walls, correspondences.floorplan, correspondences.walls, options.walls, n
            )
        ]
        on_walls += [offset_prior(n, correspondences.floorplan, options.walls.offset_sigma_m)]
        unknowns = with_offsets(plan_from_cams, correspondences.floorplan)
    if not on_walls and not correspondences.columns.n_associated:
        on_walls = [measurements.pose_prior(plan_from_cams, options)]
    return PlanProblem(measurements, correspondences, geometric, [*others, *on_walls], unknowns, n)


def solve_problem(problem: PlanProblem, options: AdjustOptions) -> Solution:
    """Solve by the method of the options.

    Raises:
        OptionError: PyTorch is needed and absent.
    """
    if options.method == "sgd":
        return _descend(problem, options)
    if options.is_bounded and problem.geometric:
        others, start = problem.others, problem.unknowns
        bounded = solve_bounded(problem.geometric, others, start, options.bounded, options.solver)
        return bounded.solution
    return Problem(problem.terms, problem.unknowns).solve(options.solver)


def _descend(problem: PlanProblem, options: AdjustOptions) -> Solution:
    """The paper's gradient descent on its own cost."""
    measurements, start = problem.measurements, problem.unknowns
    weights = PaperWeights(options.floor.weight, options.walls.weight, options.points.loss.scale)
    descent = descend(
        measurements.matches,
        measurements.structure,
        problem.correspondences.floorplan,
        problem.correspondences.walls,
        start,
        weights,
        options.descent,
    )
    costs = {
        term.name: Cost(term.reweight(start)[1], term.reweight(descent.target_from_cams)[1])
        for term in problem.terms
    }
    return Solution(descent.target_from_cams, descent.stop, int(descent.steps[-1]), costs)
