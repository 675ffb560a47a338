"""Where a plan in metres does not fit as drawn: was it drawn so, or is the depth off?"""

import numpy as np
import pytest

from builders import room_plan
from planfit.adjust.calibration import SHARED, Calibration, CalibrationOptions
from planfit.alignment import Alignment
from planfit.pipeline.calibrate import UNKNOWN_SCALE_SIGMA, plan_prior
from planfit.pipeline.on_plan import ScanOnPlan

DEPTH = SHARED.index("depth_scale")


def on_plan_scaled(factor):
    alignment = Alignment(
        np.eye(4), 0.9, None, scale_xy=(factor, factor), is_plan_rescaled=factor != 1.0
    )
    return ScanOnPlan(room_plan(), np.eye(4), alignment, None)


def asked_of_depth(departure, sigma, is_kept=False):
    departures, sigmas = np.zeros(len(SHARED)), np.zeros(len(SHARED))
    departures[DEPTH], sigmas[DEPTH] = departure, sigma
    kept = np.zeros(len(SHARED), dtype=bool)
    kept[DEPTH] = is_kept
    return Calibration(is_kept=kept, departures=departures, sigmas=sigmas)


@pytest.mark.parametrize(
    ("factor", "depth", "sigma", "is_kept", "is_believed"),
    [
        (1.02, 0.0, 0.003, False, True),  # within what plans and scans are off by
        (1.05, -0.018, 0.014, False, True),  # matches and motion already ask for part of it
        (1.05, 0.018, 0.014, False, False),  # they ask for the contrary
        (
            1.05,
            -0.018,
            0.014,
            True,
            False,
        ),  # they asked, and it was corrected: the rest is the plan's
        (1.05, 0.0, 0.003, False, False),  # matches and motion know the metre
        (0.95, 0.018, 0.014, False, True),
    ],
)
def test_a_plan_is_believed_where_depth_may_explain_its_scale(
    factor, depth, sigma, is_kept, is_believed
):
    priors = CalibrationOptions()
    found, departure = plan_prior(
        on_plan_scaled(factor), asked_of_depth(depth, sigma, is_kept), priors
    )
    if is_believed:
        assert departure == pytest.approx(np.log(factor))
        assert found.plan_scale_sigma == priors.plan_scale_sigma
        assert found.min_sigmas < priors.min_sigmas  # something is off: depth rather than the plan
    else:
        assert departure == 0.0
        assert found.plan_scale_sigma == UNKNOWN_SCALE_SIGMA
        assert found.min_sigmas == priors.min_sigmas


def test_a_plan_that_fits_as_drawn_is_right():
    found, departure = plan_prior(
        on_plan_scaled(1.0), asked_of_depth(0.0, 0.01), CalibrationOptions()
    )
    assert (found.plan_scale_sigma, departure) == (0.0, 0.0)
