"""Where a plan in metres does not fit as drawn: was it drawn so, or is the depth off?"""

from dataclasses import replace

import numpy as np
import pytest

from builders import room_plan
from planfit.adjust.calibration import PRIORS, SHARED, Calibration
from planfit.alignment import Alignment, OtherScale
from planfit.geometry.calibration import SensorCalibration
from planfit.pipeline.calibrate import UNKNOWN_SCALE_SIGMA, plan_prior, plan_vouches_for_depth
from planfit.pipeline.on_plan import ScanOnPlan

DEPTH = SHARED.index("depth_scale")


def on_plan_scaled(factor, is_taken=True):
    """Fitting at a scale that was taken, or as drawn, that scale told of."""
    alignment = Alignment(np.eye(4), 0.9, None)
    if is_taken:
        scale_xy = (factor, factor)
        alignment = replace(alignment, scale_xy=scale_xy, is_plan_rescaled=factor != 1.0)
    elif factor != 1.0:
        alignment = replace(alignment, other_scale=OtherScale(factor, 0.002, 50.0))
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
@pytest.mark.parametrize("is_taken", [True, False])
def test_a_plan_is_believed_where_depth_may_explain_its_scale(
    factor, depth, sigma, is_kept, is_believed, is_taken
):
    priors = PRIORS
    asked = asked_of_depth(depth, sigma, is_kept)
    found = plan_prior(on_plan_scaled(factor, is_taken), asked, priors)
    # A plan is taken at another scale only where the user allows it, who does not know its own then.
    if is_believed and not is_taken:
        assert found.plan_scale_sigma == 0.0
        assert found.min_sigmas < priors.min_sigmas  # something is off: depth rather than the plan
    else:
        assert found.plan_scale_sigma == UNKNOWN_SCALE_SIGMA
        assert found.min_sigmas == priors.min_sigmas


def test_a_plan_that_fits_as_drawn_is_right_within_what_plans_are_off_by():
    """A flat drawn 1 % large: right depth was corrected by 1.3 %, with a sigma of 0.25 %."""
    found = plan_prior(on_plan_scaled(1.0), asked_of_depth(0.0, 0.01), PRIORS)
    assert found.plan_scale_sigma == PRIORS.plan_scale_sigma > 0
    assert found.min_sigmas == PRIORS.min_sigmas


@pytest.mark.parametrize(
    ("corrected_by", "factor", "is_vouched_for"),
    [
        (0.918, 0.9183, True),  # the plan fits depth as measured: motion alone says otherwise
        (0.918, 1.0, False),  # it fits the corrected depth
        (0.95, 1.05, False),  # it fits neither
        (0.985, 0.99, False),  # within what plans are off by
    ],
)
@pytest.mark.parametrize("is_taken", [True, False])
def test_depth_that_the_plan_vouches_for_is_right(corrected_by, factor, is_vouched_for, is_taken):
    """A real site with a tracker 2 % long: 0.33 m off, the plan doubted, for 0.09 m."""
    asked = asked_of_depth(np.log(corrected_by), 0.018, is_kept=True)
    asked = replace(asked, sensor=SensorCalibration(depth_scale=corrected_by))
    on_plan = on_plan_scaled(factor, is_taken)
    assert plan_vouches_for_depth(on_plan, asked, PRIORS) == is_vouched_for


def test_depth_that_was_not_corrected_needs_nobody_to_vouch_for_it():
    asked = asked_of_depth(-0.08, 0.018)
    assert not plan_vouches_for_depth(on_plan_scaled(0.92), asked, PRIORS)


def test_depth_is_doubted_earlier_where_the_plan_has_no_unit():
    """Else an error of depth becomes one of the plan's scale, and of all positions."""
    priors = PRIORS
    alignment = Alignment(np.eye(4), 0.9, None, scale_xy=(0.02, 0.02))
    on_plan = ScanOnPlan(room_plan(), np.eye(4), alignment, None)
    found = plan_prior(on_plan, asked_of_depth(0.0, 0.006), priors)
    assert found.plan_scale_sigma > priors.plan_scale_sigma
    assert found.min_sigmas < priors.min_sigmas
