"""A depth camera's corrections: points, depths and cameras agree with each other, and refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from planfit.geometry.calibration import NOMINAL, PARAMETERS, SensorCalibration
from planfit.geometry.camera import Camera

CAMERA = Camera(64, 48, 60.0, 58.0, 31.0, 23.5)
numbers = st.floats(-1, 1)


@given(st.lists(numbers, min_size=7, max_size=7))
def test_corrected_points_are_those_of_the_corrected_depth_lifted_by_the_corrected_camera(shares):
    largest = np.array([0.1, 0.05, 0.01, 0.1, 0.1, 0.05, 0.05])
    sensor = NOMINAL.with_vector(NOMINAL.vector + np.array(shares) * largest)
    rng = np.random.default_rng(3)
    pixels = rng.uniform(0, 48, (30, 2))
    depths = rng.uniform(0.4, 6, 30)
    as_lifted = CAMERA.rays(pixels) * depths[:, None]
    again = sensor.camera(CAMERA).rays(pixels) * sensor.depths(depths)[:, None]
    assert_allclose(sensor.points(as_lifted), again, atol=1e-9)


def test_the_vector_is_in_the_order_of_the_names():
    vector = NOMINAL.vector + np.arange(7) * 0.01
    sensor = NOMINAL.with_vector(vector)
    assert [getattr(sensor, name) for name in PARAMETERS] == vector.tolist()
    assert_allclose(sensor.vector, vector)


def test_nothing_is_copied_where_nothing_is_corrected():
    points = np.ones((3, 3), dtype=np.float32)
    assert NOMINAL.points(points) is points
    assert NOMINAL.camera(CAMERA) == CAMERA


def test_points_keep_their_precision_and_unmeasured_ones_stay_so():
    sensor = SensorCalibration(depth_scale=1.02, principal_x=0.01)
    points = np.array([[0, 0, 0], [np.nan] * 3, [1, 1, 2]], dtype=np.float32)
    found = sensor.points(points)
    assert found.dtype == np.float32
    assert np.isnan(found[1]).all()
    assert np.isfinite(found[[0, 2]]).all()
    assert np.isnan(sensor.depths(np.array([np.nan]))).all()


def test_points_of_many_shapes_are_corrected():
    sensor = SensorCalibration(depth_scale=1.02)
    points = np.random.default_rng(0).uniform(1, 2, (4, 2, 3))
    assert_allclose(sensor.points(points).reshape(-1, 3), sensor.points(points.reshape(-1, 3)))
    assert sensor.points(np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none_are_refused(name, value):
    with pytest.raises(ValueError, match="must be finite"):
        SensorCalibration(**{name: value})


@pytest.mark.parametrize("name", ["depth_scale", "focal_scale", "focal_aspect"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_scales_must_be_above_zero(name, value):
    with pytest.raises(ValueError, match="must be above 0"):
        SensorCalibration(**{name: value})
