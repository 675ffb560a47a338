"""Walls of lines, each as thick as it was seen, once poses are adjusted; and the scale that goes with it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from planfit.adjust import PlanAdjustment, fit_thickness
from planfit.adjust.scale import about_middle
from planfit.alignment import is_off, may_be_rescaled
from planfit.alignment.plan_scale import OFF_SHARE
from planfit.lsq import Term
from planfit.pipeline.align import UNKNOWN_SCALE_SIGMA
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan


def with_fitted_thickness(
    on_plan: ScanOnPlan,
    prepared: PreparedScan,
    adjustment: PlanAdjustment,
    options: RefineOptions,
    odometry_scale_sigma: float,
    depth_scale_sigma: float,
    extra_terms: Sequence[Term] = (),
) -> tuple[ScanOnPlan, Float[np.ndarray, "n 4 4"]]:
    """The plan with each wall of a line as thick as it was seen, at the scale that goes with it, and poses.

    Args:
        on_plan: with one thickness for all walls.
        prepared: the scan.
        adjustment: to that plan.
        options: of the adjustment.
        odometry_scale_sigma: how far recorded steps may be off, as a share.
        depth_scale_sigma: how far depth may be off, as a share; a plan's scale is off with it.
        extra_terms: of the adjustment.
    """
    plan, found = on_plan.floorplan, on_plan.alignment
    assert plan is not None
    poses = adjustment.solution.target_from_cams
    fit = partial(
        fit_thickness,
        prepared.measurements,
        options=options.adjust,
        odometry_scale_sigma=odometry_scale_sigma,
        extra_terms=extra_terms,
    )
    is_found = found is not None and found.scale_sigma > 0  # the scale was searched, or found off
    # A plan in metres may be off as well: walls of one thickness did not show it.
    is_as_drawn = found is not None and found.scale_xy == (1.0, 1.0)
    is_free = is_found or (is_as_drawn and may_be_rescaled(options.align))
    fitted = fit(plan, poses, plan_scale_sigma=UNKNOWN_SCALE_SIGMA if is_free else 0.0)
    if found is None or fitted.scale_sigma == 0:
        return replace(on_plan, floorplan=fitted.floorplan), fitted.plan_from_cams
    middle = poses[:, :2, 3].mean(axis=0)
    sigma = float(np.hypot(fitted.scale_sigma, depth_scale_sigma))
    rescaled = found.rescaled(fitted.scale_factor, sigma, middle)
    off = abs(np.log(rescaled.metres_per_unit))
    if (is_as_drawn and not is_off(rescaled)) or (found.is_plan_rescaled and off <= OFF_SHARE):
        drawn = 1.0 / found.metres_per_unit
        fitted = fit(plan.scaled(drawn), about_middle(poses, drawn))
        rescaled = replace(
            found.rescaled(drawn, 0.0, middle), scale_xy=(1.0, 1.0), is_plan_rescaled=False
        )
    elif is_as_drawn:
        rescaled = replace(rescaled, is_plan_rescaled=True)
    on_plan = replace(
        on_plan,
        alignment=rescaled,
        plan_from_level=rescaled.plan_from_level,
        floorplan=fitted.floorplan,
    )
    return on_plan, fitted.plan_from_cams
