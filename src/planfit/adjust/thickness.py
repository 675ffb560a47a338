"""Walls that a plan draws by their centre lines, each as thick as the scan shows it.

One thickness for all of them is found with the alignment; partitions are thinner than outer walls, though.
Once poses are adjusted, the faces may leave their common thickness, together with the poses and, where the
plan has no unit, with its scale: thick walls leave rooms too small, and so does a wrong scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust.calibration.blocks import HALF, ODOMETRY, PLAN, SHARED
from planfit.adjust.calibration.reduced import SharedStep, shared_step
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import build_problem
from planfit.adjust.scale import about_middle
from planfit.adjust.schedule import PlanAdjustment, adjust_to_plan
from planfit.floorplan import Floorplan
from planfit.floorplan.centre_lines import with_offsets
from planfit.lsq.term import Term
from planfit.priors import WALL_FACES_APART_M, WALL_THICKNESS_SIGMA_M

HALF_SIGMA_M = WALL_THICKNESS_SIGMA_M.value / 2
"""Of half the thickness of walls of one building."""
LEAST_HALF_M = WALL_FACES_APART_M.low / 2
"""No face comes nearer to its line."""
SETTLED, MAX_ROUNDS = 0.2, 4
"""A scale that moves by less than this share of its standard deviation has settled."""


@dataclass(frozen=True)
class FittedThickness:
    """A plan whose walls are as thick as they were seen."""

    floorplan: Floorplan
    """In metres."""
    plan_from_cams: Float[np.ndarray, "n 4 4"]
    """Adjusted to it."""
    scale_factor: float = 1.0
    """On the scale of the plan that was given."""
    scale_sigma: float = 0.0
    """Standard deviation of that, as a share; 0 where the scale was held."""


def fit_thickness(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
    odometry_scale_sigma: float,
    plan_scale_sigma: float = 0.0,
    extra_terms: Sequence[Term] = (),
) -> FittedThickness:
    """Put each face of a line as far before it as it was seen, within `HALF_SIGMA_M` of the rest.

    The plan is the very same where no face was made of a line, or walls are no single planes to the method.

    Args:
        measurements: what the scan says.
        floorplan: in metres, with both faces of lines (`planfit.floorplan.centre_lines`).
        plan_from_cams: adjusted to it.
        options: of that adjustment.
        odometry_scale_sigma: how far recorded steps may be off, as a share.
        plan_scale_sigma: how far the plan's scale may be off, as a share; 0 holds it.
        extra_terms: as for `adjust_to_plan`.
    """
    is_possible = options.has_several_starts and options.walls.offset_sigma_m == 0
    if floorplan.before_line is None or not is_possible:
        return FittedThickness(floorplan, plan_from_cams)
    loose = replace(options.walls, offset_sigma_m=HALF_SIGMA_M)
    free = replace(options, walls=loose, starts=("aligned",))
    sigmas = np.zeros(len(SHARED))
    sigmas[[ODOMETRY, PLAN, HALF]] = odometry_scale_sigma, plan_scale_sigma, HALF_SIGMA_M
    plan, total, sigma = floorplan, 1.0, 0.0
    found = adjust_to_plan(measurements, plan, plan_from_cams, free, extra_terms)
    for _ in range(MAX_ROUNDS if plan_scale_sigma > 0 else 0):
        step = _step(measurements, found, free, sigmas, extra_terms)
        sigma = float(np.sqrt(step.covariance[PLAN, PLAN]))
        if abs(step.change[PLAN]) < SETTLED * sigma:
            break
        factor = float(np.exp(step.change[PLAN]))
        total *= factor
        thicker = np.full(len(plan), step.change[HALF])
        plan = _with_offsets(plan.scaled(factor), thicker)
        poses = about_middle(found.solution.target_from_cams, factor)
        found = adjust_to_plan(measurements, plan, poses, free, extra_terms)
    is_seen = np.isfinite(found.offset_sigmas_m)
    plan = _with_offsets(plan, np.where(is_seen, found.offsets_m, 0.0))
    return FittedThickness(plan, found.solution.target_from_cams, total, sigma)


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
    return with_offsets(floorplan, np.maximum(offsets_m, LEAST_HALF_M - floorplan.before_line))
