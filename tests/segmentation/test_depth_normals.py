"""Normals and edges of depth images, with holes."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import CAMERA
from planfit.geometry.depth_normals import depth_normals
from planfit.segmentation.surfaces import depth_edges


def plane_depth(normal, distance_m=3.0):
    """Depth image (h, w) of the plane normal . p = -distance, seen from in front of it."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = CAMERA.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    return (-distance_m / (rays @ normal)).reshape(CAMERA.height, CAMERA.width)


def unit(*values):
    return np.array(values) / np.linalg.norm(values)


NORMALS = [unit(0, 0, -1), unit(0.5, 0, -1), unit(-0.3, 0.4, -1), unit(0, -0.8, -1)]


def angles_deg(normals, truth):
    good = np.isfinite(normals).all(axis=-1)
    return np.rad2deg(np.arccos(np.clip(normals[good] @ truth, -1, 1)))


@pytest.mark.parametrize("truth", NORMALS)
@pytest.mark.parametrize("step_px", [1, 3, 8])
def test_normals_of_a_plane_point_to_the_camera(truth, step_px):
    points = CAMERA.lift_image(plane_depth(truth))
    normals = depth_normals(points, 5, step_px)
    assert normals.shape == points[::step_px, ::step_px].shape
    assert angles_deg(normals, truth).max() < 0.2
    assert_allclose(np.nanmax(np.linalg.norm(normals, axis=-1)), 1.0, atol=1e-5)


def holed(rng):
    depth = plane_depth(NORMALS[3]) + rng.normal(0, 0.01, (CAMERA.height, CAMERA.width))
    depth[:, 50:] += 0.7
    depth[rng.random(depth.shape) < 0.3] = np.nan
    depth[20:40, 20:40] = np.nan
    return CAMERA.lift_image(depth)


@pytest.mark.parametrize("radius", [3, 6])
def test_normals_against_a_plain_computation(rng, radius):
    points = holed(rng)
    is_measured = np.isfinite(points[..., 2])
    share = cv2.blur(is_measured.astype(float), (radius, radius))[..., None]
    total = cv2.blur(np.where(is_measured[..., None], points, 0.0), (radius, radius))
    mean = total / np.where(share > 0.5 - 1e-9, share, np.nan)
    expected = np.full(points.shape, np.nan)
    r = slice(radius, -radius)
    across = mean[r, 2 * radius :] - mean[r, : -2 * radius]
    down = mean[2 * radius :, r] - mean[: -2 * radius, r]
    normal = np.cross(down, across)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    faces_away = np.sum(normal * np.nan_to_num(points[r, r]), axis=-1, keepdims=True) > 0
    expected[r, r] = np.where(faces_away, -normal, normal)
    found = depth_normals(points, radius)
    assert 0.3 < np.isfinite(expected).mean() < 0.9
    assert_allclose(found, expected, atol=2e-3)
    assert found.dtype == np.float32


@pytest.mark.parametrize(("step_px", "first_px"), [(3, 1), (8, 4), (2, 0)])
def test_normals_at_some_pixels_are_those_of_all(rng, step_px, first_px):
    points = holed(rng)
    some = depth_normals(points, 4, step_px, first_px)
    np.testing.assert_array_equal(
        some, depth_normals(points, 4)[first_px::step_px, first_px::step_px]
    )


def test_the_border_is_unsure_and_the_rest_is_not():
    normals = depth_normals(CAMERA.lift_image(plane_depth(NORMALS[1])), 5)
    good = np.isfinite(normals).all(axis=-1)
    assert not good[:5].any()
    assert not good[-5:].any()
    assert not good[:, :5].any()
    assert not good[:, -5:].any()
    assert good[7:-7, 7:-7].all()


def test_a_hole_spoils_its_surroundings_and_nothing_else():
    # OpenCV's running sums once carried a single NaN down to the foot of the image.
    depth = plane_depth(NORMALS[2])
    depth[40:52, 60:72] = np.nan
    normals = depth_normals(CAMERA.lift_image(depth), 5)
    good = np.isfinite(normals).all(axis=-1)
    far = np.ones_like(good)
    far[40 - 8 : 52 + 8, 60 - 8 : 72 + 8] = False
    assert good[7:-7, 7:-7][far[7:-7, 7:-7]].all()
    assert not good[44:48, 64:68].any()
    assert angles_deg(normals, NORMALS[2]).max() < 0.2


def test_scattered_holes_leave_good_normals(rng):
    depth = plane_depth(NORMALS[1])
    depth[rng.random(depth.shape) < 0.1] = np.nan
    normals = depth_normals(CAMERA.lift_image(depth), 5, 3)
    assert np.isfinite(normals).all(axis=-1).mean() > 0.7
    assert angles_deg(normals, NORMALS[1]).max() < 0.5


def test_no_depth_no_normals():
    depth = np.full((CAMERA.height, CAMERA.width), np.nan, np.float32)
    assert np.isnan(depth_normals(CAMERA.lift_image(depth), 5)).all()


def test_noise_falls_with_the_radius(rng):
    noisy = plane_depth(NORMALS[0]) + rng.normal(0, 0.01, (CAMERA.height, CAMERA.width))
    points = CAMERA.lift_image(noisy)
    errors = [np.median(angles_deg(depth_normals(points, r), NORMALS[0])) for r in (3, 5, 9)]
    assert errors[0] > 1.5 * errors[1] > 2 * errors[2]


def test_edges_are_jumps_and_holes_with_two_pixels_around():
    depth = np.full((40, 60), 2.0, np.float32)
    depth[:, 30:] = 3.0
    depth[20, 10] = np.nan
    edges = depth_edges(depth, 0.05)
    expected = np.zeros((40, 60), dtype=bool)
    expected[:, 28:32] = True
    expected[18:23, 8:13] = True
    assert np.array_equal(edges, expected)


@pytest.mark.parametrize(("jump_m", "is_edge"), [(0.12, False), (0.14, True)])
def test_a_jump_is_a_share_of_the_depth_and_a_little(jump_m, is_edge):
    depth = np.full((20, 20), 2.0, np.float32)
    depth[:, 10:] += jump_m
    assert depth_edges(depth, 0.05).any() == is_edge


def test_a_slanted_wall_is_no_edge():
    assert not depth_edges(plane_depth(unit(0.7, 0, -1)).astype(np.float32), 0.05).any()
