"""The report's curve of depth error: what was measured too long is above, and what is left is nothing."""

import numpy as np
from numpy.testing import assert_allclose

from planfit.adjust.calibration import NOT_CALIBRATED, SHARED, Calibration
from planfit.geometry.calibration import SensorCalibration
from planfit.report.plots.charts import depth_errors_m

DEPTHS_M = np.array([1.0, 2.0, 4.0])


def test_depth_that_was_long_is_above_before_and_nothing_is_left():
    sigmas, is_kept = np.zeros(9), np.zeros(9, dtype=bool)
    for name, sigma in (("depth_scale", 0.003), ("depth_offset_m", 0.004)):
        sigmas[SHARED.index(name)], is_kept[SHARED.index(name)] = sigma, True
    found = Calibration(SensorCalibration(0.98, -0.01), is_kept, np.zeros(9), sigmas)
    before, after, sigma = depth_errors_m(found, DEPTHS_M)
    assert_allclose(before, [0.03, 0.05, 0.09])
    assert_allclose(after, 0.0)
    assert_allclose(sigma[0], 0.005)


def test_where_nothing_is_corrected_both_are_nothing():
    before, after, _ = depth_errors_m(NOT_CALIBRATED, DEPTHS_M)
    assert_allclose(before, after)
