"""The error of measured depth over distance, as a calibration has it, before and after its correction."""

import numpy as np
from jaxtyping import Float

from planfit.adjust.calibration import SHARED, Calibration
from planfit.report.plots.drawing import (
    AFTER,
    BEFORE,
    LIGHT,
    PANEL_IN,
    Picture,
    add_axes,
    label_axes,
    new_figure,
    to_picture,
)
from planfit.report.plots.overlay import LEGEND_IN, add_legend

NEAR_M, FAR_M = 0.5, 8.0
"""The plot is drawn between these: nearer, few cameras measure; further, points take no part."""
_LEAST_CM = 2.0
"""Of the axis to either side, so that millimetres do not look like a fault."""
_DEPTH = ("depth_scale", "depth_offset_m", "depth_quadratic_per_m")


def depth_errors_m(
    calibration: Calibration, depths_m: Float[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Error of measured depths before, after, and one standard deviation of both.

    Before: measured less corrected. After: what is left by the calibration's own account, nothing. The
    standard deviation takes the parameters that were kept as independent; where none was, the largest of each
    alone.
    """
    before = depths_m - calibration.sensor.depths(depths_m)
    idx = [SHARED.index(name) for name in _DEPTH]
    powers = np.stack([depths_m, np.ones_like(depths_m), depths_m**2])
    spread = powers * calibration.sigmas[idx][:, None]
    is_kept = calibration.is_kept[idx]
    kept = np.sqrt(np.sum(spread[is_kept] ** 2, axis=0))
    return before, np.zeros_like(before), kept if is_kept.any() else spread.max(axis=0)


def depth_error_plot(calibration: Calibration, farthest_m: float) -> Picture:
    """Error (cm) over distance (m), from `NEAR_M` to the farthest point seen."""
    depths_m = np.linspace(NEAR_M, farthest_m, 100)
    before, after, sigma = (100 * e for e in depth_errors_m(calibration, depths_m))
    figure = new_figure(PANEL_IN, 2.9)
    axes = add_axes(figure, 0.55, 0.42, PANEL_IN - 0.75, 2.9 - 0.42 - LEGEND_IN)
    axes.axhline(0.0, color=LIGHT, linewidth=0.8, zorder=1)
    axes.fill_between(depths_m, after - sigma, after + sigma, color=AFTER, alpha=0.18, linewidth=0)
    axes.plot(depths_m, before, color=BEFORE, linewidth=1.5, zorder=3)
    axes.plot(depths_m, after, color=AFTER, linewidth=1.5, zorder=2)
    axes.set_xlim(NEAR_M, farthest_m)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -_LEAST_CM), max(high, _LEAST_CM))
    label_axes(axes, "distance (m)", "measured less true depth (cm)")
    add_legend(axes, [("before", BEFORE, "-"), ("after", AFTER, "-")])
    return to_picture(figure)
