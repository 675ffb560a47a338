"""The order of the adjustment: loops first, then walls with shrinking distances, until nothing changes.

Pulling walls at once locks onto wrong walls where drift exceeds the spacing of walls. Once matches
have closed the loops and the whole is placed on the plan, what is left is small, and a shrinking
association distance lets go of the pieces that still belong elsewhere.
"""

from dataclasses import dataclass, replace

import numpy as np

from planfit.adjust.association import Association, associate
from planfit.adjust.evidence import Evidence
from planfit.adjust.options import AdjustOptions
from planfit.adjust.solver import Solution, solve
from planfit.adjust.terms.anchor import AnchorTerm
from planfit.adjust.terms.wall_offsets import (
    OffsetWallTerm,
    offset_prior,
    read_offsets,
    with_offsets,
)
from planfit.adjust.terms.walls import WallTerm
from planfit.floorplan import Floorplan


def close_loops(
    evidence: Evidence, level_from_cams: np.ndarray, options: AdjustOptions
) -> Solution:
    """Make the scan agree with itself: matches, floor and trajectory, the first frame held.

    The loss of the matches narrows by `options.graduation` (graduated non-convexity: Blake and
    Zisserman 1987; Yang et al. 2020). The floor, where seen, gives height and tilt; of the first
    frame only the rest is held.
    """
    has_floor = bool(options.floor.weight > 0 and len(evidence.structure.floor_points_cam))
    free = np.inf if has_floor else 1e-3
    sigma = np.array([free, free, 1e-3, 1e-3, 1e-3, free])
    anchor = AnchorTerm(np.array([0]), level_from_cams[:1], sigma)
    solution: Solution | None = None
    for factor in options.graduation:
        terms = evidence.terms(_with_wider_loss(options, factor))
        solution = solve([*terms, anchor], level_from_cams, options.solver)
        level_from_cams = solution.target_from_cams
    assert solution is not None  # graduation is never empty
    return solution


def _with_wider_loss(options: AdjustOptions, factor: float) -> AdjustOptions:
    """The same options with the scale of the matches' loss times a factor."""
    loss = options.points.loss
    wider = replace(options.points, loss=replace(loss, scale=factor * loss.scale))
    return replace(options, points=wider)


@dataclass(frozen=True)
class WallsPulled:
    """Poses on the plan, and what the walls were associated with in the end."""

    solution: Solution
    association: Association
    offsets_m: np.ndarray
    """(f,) how far each face of the plan was found to stand off where it is drawn, along its normal;
    zero where no wall was seen, or where offsets were not asked for."""
    rounds: int
    """Associations made."""
    settled: bool
    """Whether the last association did not change any more."""


def pull_walls(
    evidence: Evidence,
    floorplan: Floorplan,
    plan_from_cams: np.ndarray,
    options: AdjustOptions,
) -> WallsPulled:
    """Alternate association and solve (paper, Sec. III-D), with association distances that shrink.

    Args:
        evidence: what the scan says.
        floorplan: the plan.
        plan_from_cams: (n, 4, 4) poses placed on the plan, loops closed.
        options: see there.
    """
    structure, rounds, settled = evidence.structure, 0, False
    solution: Solution | None = None
    association = Association(np.zeros(0, dtype=int), np.zeros(0))
    offsets_m = np.zeros(len(floorplan))
    for max_distance_m in options.wall_distances_m:
        association = associate(
            structure, floorplan, plan_from_cams, max_distance_m, options.association
        )
        for _ in range(options.max_alternations):
            rounds += 1
            solution, offsets_m = _solve_on_plan(
                evidence, floorplan, association, plan_from_cams, options
            )
            plan_from_cams = solution.target_from_cams
            again = associate(
                structure, floorplan, plan_from_cams, max_distance_m, options.association
            )
            settled = bool(np.array_equal(again.face_idx, association.face_idx))
            association = again
            if settled:
                break
    assert solution is not None  # wall_distances_m is never empty
    return WallsPulled(solution, association, offsets_m, rounds, settled)


def _solve_on_plan(
    evidence: Evidence,
    floorplan: Floorplan,
    association: Association,
    plan_from_cams: np.ndarray,
    options: AdjustOptions,
) -> tuple[Solution, np.ndarray]:
    """One solve with the walls held to their faces; also the faces' offsets (f,) m."""
    terms = evidence.terms(options)
    n, none = len(plan_from_cams), np.zeros(len(floorplan))
    if association.n_associated == 0 or options.walls.weight == 0:
        # Nothing ties the scan to the plan: the place that was found holds it.
        anchor = AnchorTerm(np.array([0]), plan_from_cams[:1], np.full(6, 1e-3))
        return solve([*terms, anchor], plan_from_cams, options.solver), none
    if options.walls.offset_sigma_m == 0:
        walls = WallTerm(evidence.structure, floorplan, association, options.walls)
        return solve([*terms, walls], plan_from_cams, options.solver), none
    walls = OffsetWallTerm(evidence.structure, floorplan, association, options.walls, n)
    terms += [offset_prior(n, floorplan, options.walls.offset_sigma_m)]
    unknowns = with_offsets(plan_from_cams, floorplan)
    solution = solve([*terms, walls], unknowns, options.solver)
    found = solution.target_from_cams
    return replace(solution, target_from_cams=found[:n]), read_offsets(found, n, floorplan)
