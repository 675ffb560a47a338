"""The depth buffer against rays and rectangles asked one by one."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.synth.plan_walls import _first_ahead
from planfit.synth.render import first_rectangles

CAMERA = Camera(64, 48, 40.0, 42.0, 30.5, 24.25)


def rectangles(n, rng, reach_m=6.0):
    """Of random place, direction and size, all around the origin."""
    turns = se3.exp_so3(rng.normal(scale=2.0, size=(n, 3)))
    size = rng.uniform(0.2, 3.0, (n, 2))
    centre = rng.uniform(-reach_m, reach_m, (n, 3))
    u, v = turns[:, :, 0], turns[:, :, 1]
    return centre - u * size[:, :1] / 2 - v * size[:, 1:] / 2, u, v, size


def by_rays(camera, plan_from_cam, origin, u, v, size):
    """Every rectangle on the ray of every pixel; and how near the ray of each pixel comes to an edge, m."""
    hit = np.full((camera.height, camera.width), -1)
    to_edge = np.full(hit.shape, np.inf)
    normal, eye = np.cross(u, v), plan_from_cam[:3, 3]
    for row, column in np.ndindex(hit.shape):
        ray = plan_from_cam[:3, :3] @ camera.rays(np.array([[column, row]]))[0]
        distance = np.sum(normal * (origin - eye), axis=1) / (normal @ ray)
        point = eye + distance[:, None] * ray - origin
        at = np.column_stack([np.sum(u * point, axis=1), np.sum(v * point, axis=1)])
        inside = np.hstack([at, size - at])[distance > 0.0]
        to_edge[row, column] = np.abs(inside).min()
        distance = np.where(
            (at >= 0).all(axis=1) & (at <= size).all(axis=1) & (distance > 0), distance, np.inf
        )
        if np.isfinite(distance).any():
            hit[row, column] = distance.argmin()
    return hit, to_edge


@pytest.mark.parametrize("seed", range(6))
def test_each_pixel_sees_what_its_ray_meets_first(seed):
    rng = np.random.default_rng(seed)
    scene = rectangles(60, rng)
    pose = se3.make_transform(se3.exp_so3(rng.normal(size=3)), rng.normal(scale=0.5, size=3))
    hit, to_edge = by_rays(CAMERA, pose, *scene)
    assert (hit >= 0).sum() > 300
    assert len(np.unique(hit)) >= 4
    seen = first_rectangles(CAMERA, pose, *scene)
    assert_array_equal(seen[to_edge > 1e-6], hit[to_edge > 1e-6])


def test_no_pixel_falls_between_rectangles_that_share_an_edge():
    """The inside of a box of 4 x 4 tiles a side, from a camera whose pixels look exactly along the seams."""
    axes = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
    origin, u, v = [], [], []
    for flat, one, other in axes:
        for side in (-2.0, 2.0):
            for i, j in np.ndindex(4, 4):
                corner = np.zeros(3)
                corner[[flat, one, other]] = side, i - 2.0, j - 2.0
                origin.append(corner)
                u.append(np.eye(3)[one])
                v.append(np.eye(3)[other])
    size = np.ones((len(origin), 2))
    camera = Camera(41, 41, 10.0, 10.0, 20.0, 20.0)
    rng = np.random.default_rng(3)
    turns = [
        np.eye(3),
        se3.exp_so3(np.array([0.0, np.pi / 4, 0.0])),
        *se3.exp_so3(rng.normal(size=(9, 3))),
    ]
    for turn in turns:
        pose = se3.make_transform(turn, np.zeros(3))
        seen = first_rectangles(camera, pose, np.array(origin), np.array(u), np.array(v), size)
        assert (seen >= 0).all()


def test_what_lies_behind_or_edge_on_is_not_seen_and_what_passes_the_camera_is():
    u, v = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 1.0, 0.0]])

    def share(x, first_z, last_z):
        """Of the image that a wall along the line of sight takes, 2 m high."""
        corner, size = np.array([[x, -1.0, first_z]]), np.array([[last_z - first_z, 2.0]])
        return (first_rectangles(CAMERA, np.eye(4), corner, u, v, size) == 0).mean()

    assert share(0.5, -7.0, -1.0) == 0.0
    assert share(0.0, -3.0, 3.0) == 0.0
    assert share(0.5, -3.0, 3.0) > 0.05
    assert share(0.5, -3.0, 3.0) == share(0.5, 0.01, 3.0)


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def test_the_first_segment_ahead_is_that_of_all_segments():
    rng = np.random.default_rng(5)
    ends = rng.uniform(-5, 5, (40, 1, 2)) + rng.normal(size=(40, 2, 2))
    xy = rng.uniform(-5, 5, (300, 2))
    for angle in (0.0, 0.7, 2.0, 4.5):
        direction = np.array([np.cos(angle), np.sin(angle)])
        along, start = ends[:, 1] - ends[:, 0], ends[:, 0] - xy[:, None]
        across = cross(direction, along)
        distance = cross(start, along) / across
        share = cross(start, direction) / across
        distance[(share < 0) | (share > 1) | (distance < 0)] = np.inf
        expected = np.where(np.isfinite(distance.min(axis=1)), distance.argmin(axis=1), -1)
        assert (expected >= 0).mean() > 0.5
        assert (expected < 0).any()
        assert_array_equal(_first_ahead(xy, direction, ends), expected)
