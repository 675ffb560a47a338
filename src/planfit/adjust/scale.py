"""What the scan says of its plan: its scale where it has no unit, and how thick its lines stand for.

One thickness for all lines is found with the alignment; partitions are thinner than outer walls, though. Once
poses are adjusted, the faces may leave their common thickness, together with the poses and, where the plan
has no unit, with its scale: thick walls leave rooms too small, and so does a wrong scale.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Float

from planfit.adjust.calibration.blocks import HALF, ODOMETRY, PLAN, SHARED
from planfit.adjust.calibration.reduced import SharedStep, shared_step
from planfit.adjust.competition import best_of_starts, full_cost
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import build_problem, costs
from planfit.adjust.schedule import PlanAdjustment, adjust_to_plan, plan_task
from planfit.floorplan import Floorplan
from planfit.floorplan.centre_lines import with_offsets
from planfit.geometry.se3 import Poses
from planfit.lsq.term import Term
from planfit.priors import WALL_FACES_APART_M, WALL_THICKNESS_SIGMA_M

STEP = 0.003
"""Scales are tried this far apart, as a share: several sigmas of the answer, and little enough that the
same wall patches find the same faces."""
FLAT = 1e-9
"""Of costs, whose bowl has no bottom where it bends by less."""
MAX_MOVES = 5
"""Windows that are tried where the bowl's bottom lies outside."""
_HALF_SIGMA_M = WALL_THICKNESS_SIGMA_M.value / 2
"""Of half the thickness of walls of one building."""
_LEAST_HALF_M = WALL_FACES_APART_M.low / 2
"""No face comes nearer to its line."""
_SETTLED, _MAX_ROUNDS = 0.2, 4
"""A scale that moves by less than this share of its standard deviation has settled."""


@dataclass(frozen=True)
class _FittedThickness:
    """A plan whose walls are as thick as they were seen."""

    floorplan: Floorplan
    """In metres."""
    plan_from_cams: Poses
    """Adjusted to it."""
    scale_factor: float = 1.0
    """On the scale of the plan that was given."""
    scale_sigma: float = 0.0
    """Standard deviation of that, as a share; 0 where the scale was held."""


@dataclass(frozen=True)
class ScaleRefit:
    """A better scale, as a factor on the one that was tried."""

    factor: float
    sigma: float
    """Standard deviation of the factor, as a share; infinite where no bottom was found."""


def refit_scale(
    measurements: Measurements, floorplan: Floorplan, plan_from_cams: Poses, options: AdjustOptions
) -> ScaleRefit:
    """Factor on the scale of a plan at which the walls strain everything else least.

    Args:
        floorplan: in metres, at the scale that the alignment found.
        plan_from_cams: poses aligned with it, loops closed.
    """
    # Costs at several scales compare where all start alike and walls stand as drawn.
    quick = replace(options, starts=("aligned",), finds_moved_walls=False)

    def cost(step: int) -> float:
        factor = float(np.exp(step * STEP))
        poses = about_middle(plan_from_cams, factor)
        adjusted = adjust_to_plan(measurements, floorplan.scaled(factor), poses, quick)
        return _cost(measurements, adjusted, options)

    bottom, curvature = bottom_of_bowl(cost)
    if curvature == 0.0:
        return ScaleRefit(1.0, float("inf"))
    # A robust cost is a sum of squares, near enough: it rises by one at one sigma from the bottom.
    return ScaleRefit(float(np.exp(bottom * STEP)), STEP * float(np.sqrt(2.0 / curvature)))


def bottom_of_bowl(cost: Callable[[int], float]) -> tuple[float, float]:
    """Where a cost that is known at whole steps is least, by the parabola through the three lowest, and how
    it bends there: both 0 where no bottom is found."""
    cost_at, centre = cache(cost), 0
    for _ in range(MAX_MOVES + 1):
        low, here, high = (cost_at(centre + k) for k in (-1, 0, 1))
        curvature = low + high - 2 * here
        if here <= min(low, high):
            is_bent = curvature > FLAT
            return (centre + 0.5 * (low - high) / curvature, curvature) if is_bent else (0.0, 0.0)
        centre += 1 if high < low else -1
    return 0.0, 0.0


def cost_on_plan(
    measurements: Measurements, floorplan: Floorplan, plan_from_cams: Poses, options: AdjustOptions
) -> float:
    """Full cost (squared sigmas) of all measurements adjusted to a plan whose walls stand as drawn.

    Of two scales of one plan, that of the lower cost is the likelier: walls that may be moved would explain
    either. Arguments are those of `adjust_to_plan`.
    """
    as_drawn = replace(options, finds_moved_walls=False)
    task, poses = plan_task(measurements, floorplan, plan_from_cams, as_drawn)
    return full_cost(task, best_of_starts(task, poses).best)


def about_middle(plan_from_cams: Poses, factor: float) -> Poses:
    """Poses translated as a whole so that their middle stays at the same spot of a scaled drawing."""
    moved = plan_from_cams.copy()
    moved[:, :2, 3] += (factor - 1.0) * plan_from_cams[:, :2, 3].mean(axis=0)
    return moved


def _cost(measurements: Measurements, adjusted: PlanAdjustment, options: AdjustOptions) -> float:
    """Robust cost of all terms after an adjustment; a patch without face costs like the mean one."""
    poses = adjusted.solution.target_from_cams
    found = costs(measurements, poses, options, adjusted.correspondences)
    n_found = adjusted.association.n_associated
    n_lost = len(measurements.structure.walls) - n_found
    return sum(found.values()) + found.get("walls", 0.0) / max(n_found, 1) * n_lost


def fit_thickness(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: Poses,
    options: AdjustOptions,
    odometry_scale_sigma: float,
    plan_scale_sigma: float = 0.0,
    extra_terms: Sequence[Term] = (),
) -> _FittedThickness:
    """Put each face of a line as far before it as it was seen, within `_HALF_SIGMA_M` of the rest.

    The plan is the very same where no face was made of a line, or walls are no single planes to the method.

    Args:
        floorplan: in metres, with both faces of lines (`planfit.floorplan.centre_lines`).
        plan_from_cams: adjusted to it.
        odometry_scale_sigma: how far recorded steps may be off, as a share.
        plan_scale_sigma: how far the plan's scale may be off, as a share; 0 holds it.
    """
    is_possible = options.has_several_starts and options.wall_offset_sigma_m == 0
    if floorplan.before_line is None or not is_possible:
        return _FittedThickness(floorplan, plan_from_cams)
    free = replace(options, wall_offset_sigma_m=_HALF_SIGMA_M, starts=("aligned",))
    sigmas = np.zeros(len(SHARED))
    sigmas[[ODOMETRY, PLAN, HALF]] = odometry_scale_sigma, plan_scale_sigma, _HALF_SIGMA_M
    plan, total, sigma = floorplan, 1.0, 0.0
    found = adjust_to_plan(measurements, plan, plan_from_cams, free, extra_terms)
    for _ in range(_MAX_ROUNDS if plan_scale_sigma > 0 else 0):
        step = _step(measurements, found, free, sigmas, extra_terms)
        sigma = float(np.sqrt(step.covariance[PLAN, PLAN]))
        if abs(step.change[PLAN]) < _SETTLED * sigma:
            break
        factor = float(np.exp(step.change[PLAN]))
        total *= factor
        thicker = np.full(len(plan), step.change[HALF])
        plan = _with_offsets(plan.scaled(factor), thicker)
        poses = about_middle(found.solution.target_from_cams, factor)
        found = adjust_to_plan(measurements, plan, poses, free, extra_terms)
    is_seen = np.isfinite(found.offset_sigmas_m)
    plan = _with_offsets(plan, np.where(is_seen, found.offsets_m, 0.0))
    return _FittedThickness(plan, found.solution.target_from_cams, total, sigma)


def _step(
    measurements: Measurements,
    found: PlanAdjustment,
    options: AdjustOptions,
    sigmas: Float[np.ndarray, " s"],
    extra_terms: Sequence[Term],
) -> SharedStep:
    """Where poses, offsets of faces, scales and thickness want to go together."""
    poses, plan = found.solution.target_from_cams, found.correspondences
    problem = build_problem(measurements, options, poses, plan, extra_terms)
    # Heights of ceilings say nothing of a plan.
    problem = replace(problem, ceiling=None)
    unknowns = problem.unknowns.copy()
    assert plan is not None
    unknowns[problem.n_cams :, :2, 3] = found.offsets_m[:, None] * plan.floorplan.normals
    return shared_step(problem, unknowns, np.zeros(len(SHARED)), sigmas)


def _with_offsets(floorplan: Floorplan, offsets_m: Float[np.ndarray, " f"]) -> Floorplan:
    assert floorplan.before_line is not None
    return with_offsets(floorplan, np.maximum(offsets_m, _LEAST_HALF_M - floorplan.before_line))
