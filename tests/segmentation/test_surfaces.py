"""Frames as upright points and normals: what is kept of them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import CAMERA, look, room_scan
from planfit.geometry import se3
from planfit.geometry.depth_normals import depth_normals
from planfit.segmentation.surfaces import FAR_M, find_surfaces

POSE = look([1.0, 2.0, 1.5], 10, 20)


@pytest.fixture
def depth(rng):
    depth = room_scan(POSE[None]).files.depth(0)
    depth += rng.normal(0, 0.005, depth.shape).astype(np.float32)
    depth[rng.random(depth.shape) < 0.05] = np.nan
    return depth


def test_points_and_normals_are_turned_upright(depth):
    found = find_surfaces(depth, CAMERA, POSE, 3)
    points = CAMERA.lift_image(depth)
    assert_allclose(found.points, points @ POSE[:3, :3].T, atol=1e-5)
    near, far = depth_normals(points, 3), depth_normals(points, 6)
    is_far = (depth > FAR_M) & np.isfinite(far[..., 2])
    assert 0.1 < is_far.mean() < 0.9
    normals = np.where(is_far[..., None], far, near)
    # Points of find_surfaces are float32: their differences are off by 1e-7 over some centimetres.
    assert_allclose(found.normals, normals @ POSE[:3, :3].T, atol=2e-3)


def test_a_glance_keeps_some_of_the_same(depth):
    every = find_surfaces(depth, CAMERA, POSE, 3)
    few = find_surfaces(depth, CAMERA, POSE, 3, width_px=40)
    step = depth.shape[1] // 40
    assert few.step_px == step > 1
    assert few.points.shape[1] == pytest.approx(40, abs=1)
    kept = (slice(step // 2, None, step),) * 2
    for name in ("points", "normals", "depth"):
        assert_allclose(getattr(few, name), getattr(every, name)[kept], atol=1e-6)


def test_turned_by_the_identity_nothing_moves(depth):
    found = find_surfaces(depth, CAMERA, se3.make_transform(np.eye(3), np.ones(3)), 3)
    assert_allclose(found.points, CAMERA.lift_image(depth), atol=1e-5)
