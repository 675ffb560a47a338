"""The pinhole camera."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from planfit.geometry.camera import Camera

CAMERA = Camera(640, 480, 500.0, 510.0, 321.0, 239.5)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.floats(-100, 800), st.floats(-100, 600), st.floats(0.1, 50))
def test_project_undoes_lift(u, v, depth):
    points = CAMERA.lift(np.array([[u, v]]), np.array([depth]))
    assert points[0, 2] == depth
    assert_allclose(CAMERA.project(points), [[u, v]], atol=1e-9)


def test_axes_are_right_down_forward():
    assert_allclose(CAMERA.rays(np.array([[321.0, 239.5]])), [[0, 0, 1]])
    right_below = CAMERA.rays(np.array([[821.0, 749.5]]))
    assert_allclose(right_below, [[1, 1, 1]])


def test_the_matrix_projects(rng):
    points = rng.uniform([-2, -2, 1], [2, 2, 5], (20, 3))
    pixels = points @ CAMERA.matrix.T
    assert_allclose(pixels[:, :2] / pixels[:, 2:], CAMERA.project(points))


def test_lifting_an_image_is_lifting_its_pixels(rng):
    depth = rng.uniform(1, 5, (480, 640)).astype(np.float32)
    depth[10, 20] = np.nan
    image = CAMERA.lift_image(depth)
    v, u = np.mgrid[:480, :640]
    points = CAMERA.lift(np.stack([u.ravel(), v.ravel()], axis=1).astype(float), depth.ravel())
    assert_allclose(image.reshape(-1, 3), points, rtol=1e-6, atol=1e-9)
    assert np.isnan(image[10, 20]).all()
    assert np.isnan(image).sum() == 3


def test_points_at_or_behind_the_camera_have_no_pixel():
    points = np.array([[0, 0, 0], [1, 1, -2], [0, 0, 2.0]])
    assert_array_equal(np.isnan(CAMERA.project(points)).all(axis=1), [True, True, False])


@pytest.mark.parametrize("size", [(320, 240), (1280, 960), (320, 480)])
def test_a_scaled_camera_sees_pixel_corners_where_the_image_ends(size):
    scaled = CAMERA.scaled(*size)
    for corner, full in (((-0.5, -0.5), (-0.5, -0.5)),
                         ((size[0] - 0.5, size[1] - 0.5), (639.5, 479.5))):  # fmt: skip
        assert_allclose(scaled.rays(np.array([corner])), CAMERA.rays(np.array([full])))


def test_scaling_there_and_back_changes_nothing():
    back = CAMERA.scaled(320, 240).scaled(640, 480)
    assert_allclose([back.fx, back.fy, back.cx, back.cy], [500, 510, 321, 239.5])


@pytest.mark.parametrize("values", [
    (0, 480, 1, 1, 0, 0), (640, -1, 1, 1, 0, 0), (640, 480, 0, 1, 0, 0), (640, 480, 1, -5, 0, 0),
    (640, 480, np.nan, 1, 0, 0), (640, 480, 1, np.inf, 0, 0), (640, 480, 1, 1, np.nan, 0),
])  # fmt: skip
def test_intrinsics_that_make_no_camera(values):
    with pytest.raises(ValueError, match=r"must be|finite|positive"):
        Camera(*values)
