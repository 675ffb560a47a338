"""Up: recorded, or found from the most common normal."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import NoFiles, look, room_scan
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.segmentation import Gravity, find_gravity, level_from_world, most_common_upright
from planfit.segmentation import gravity as gravity_module

VIEWS = np.stack(
    [look([2 + 0.2 * i, 1.5 + 0.1 * i, 1.4], 40 * i, 25 if i % 3 else -10, 4 * (i % 3 - 1))
     for i in range(9)]
)  # fmt: skip


def angle_deg(a, b):
    return np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


@pytest.mark.parametrize(
    "rotation_vector", [[0.3, -0.4, 0.0], [0.0, 0.0, 0.0], [-np.pi / 2, 0, 0], [2.0, 2, 0]]
)
def test_up_of_a_tilted_world_is_found(rotation_vector):
    room_from_world = se3.make_transform(
        se3.exp_so3(np.array(rotation_vector)), np.array([1.0, 2, 3])
    )
    scan = room_scan(VIEWS, room_from_world, noise_m=0.005, boxes=[((4, 0, 0), (5, 1, 0.8))])
    gravity = find_gravity(scan, Runtime(2))
    assert angle_deg(gravity.up_world, room_from_world[2, :3]) < 0.3
    assert gravity.confidence > 0.5
    assert np.linalg.norm(gravity.up_world) == pytest.approx(1.0)
    level = level_from_world(gravity, 0.0) @ se3.inverse(room_from_world)
    assert_allclose(level[2, :3], [0, 0, 1], atol=np.deg2rad(0.3))


@pytest.mark.parametrize("roll_deg", [-90, -75, 90, 100])
def test_images_that_lie_on_their_side_are_told_by_what_keeps_its_direction(roll_deg):
    # A phone held upright whose images are stored along its longer side.
    roll = se3.make_transform(se3.exp_so3(np.array([0, 0, np.deg2rad(roll_deg)])), np.zeros(3))
    scan = room_scan(VIEWS @ roll, noise_m=0.005, boxes=[((4, 0, 0), (5, 1, 0.8))])
    assert angle_deg(find_gravity(scan, Runtime(1)).up_world, [0, 0, 1]) < 0.3


def test_what_the_format_records_is_taken_as_it_is():
    scan = replace(room_scan(VIEWS), up_world=np.array([0.0, 1.0, 0.0]))
    gravity = find_gravity(scan, Runtime(1))
    assert_allclose(gravity.up_world, [0, 1, 0])
    assert gravity.confidence == 1.0
    assert "recorded" in gravity.source


def test_without_level_surfaces_the_cameras_say_and_a_warning_is_given():
    class Blind(NoFiles):
        def depth(self, _):
            return np.full((120, 160), np.nan, np.float32)

    scan = replace(room_scan([look([3, 2, 1.4], 10)] * 3), files=Blind())
    gravity = find_gravity(scan, Runtime(1))
    assert gravity.confidence == 0.0
    assert angle_deg(gravity.up_world, [0, 0, 1]) < 1e-6
    assert "too few" in gravity.source


def test_a_ceiling_counts_with_the_floor():
    up = np.tile([0, 0, 1.0], (60, 1))
    gravity = most_common_upright(np.concatenate([up, -up]), np.array([0, 0.3, 0.95]))
    assert angle_deg(gravity.up_world, [0, 0, 1]) < 1e-6
    assert gravity.confidence == 1.0


def test_the_sign_comes_from_the_cameras():
    normals = np.tile([0, 0, 1.0], (200, 1))
    gravity = most_common_upright(normals, np.array([0, 0.1, -0.99]))
    assert angle_deg(gravity.up_world, [0, 0, -1]) < 1e-6


def mixed(rng, n_floor, n_slope, slope_deg):
    slope = np.deg2rad(slope_deg)
    normals = np.concatenate(
        [np.tile([0, 0, 1.0], (n_floor, 1)),
         np.tile([np.sin(slope), 0, np.cos(slope)], (n_slope, 1))]
    )  # fmt: skip
    normals += rng.normal(0, 0.01, normals.shape)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_a_smaller_slope_has_no_weight(rng):
    gravity = most_common_upright(mixed(rng, 600, 300, 20), np.array([0, 0, 1.0]))
    assert angle_deg(gravity.up_world, [0, 0, 1]) < 0.3
    assert gravity.confidence == pytest.approx(2 / 3, abs=0.02)


def test_max_tilt_deg_tells_floor_from_wall(rng):
    normals, near = mixed(rng, 300, 600, 60), np.array([0, 0, 1.0])
    assert angle_deg(most_common_upright(normals, near).up_world, near) < 0.3
    with patch.object(gravity_module, "_MAX_TILT_DEG", 80.0):
        wide = most_common_upright(normals, near)
    assert angle_deg(wide.up_world, near) > 50


def test_cluster_deg_is_what_takes_part(rng):
    normals, near = mixed(rng, 600, 300, 8), np.array([0, 0, 1.0])
    found = []
    for cluster_deg in (3, 12):
        with patch.object(gravity_module, "_CLUSTER_DEG", cluster_deg):
            found.append(most_common_upright(normals, near))
    narrow, wide = found
    assert narrow.confidence == pytest.approx(2 / 3, abs=0.05)
    assert wide.confidence > 0.99
    # A slope within it counts a little: its weight has fallen to a thousandth.
    for gravity in (narrow, wide):
        assert angle_deg(gravity.up_world, near) < 0.2


def walls(rng, n):
    yaw = rng.choice([0.3, 0.3 + np.pi / 2], n)
    normals = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(n)])
    normals += rng.normal(0, 0.01, normals.shape)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_walls_mend_a_floor_that_is_off(rng):
    floor = mixed(rng, 300, 0, 0) @ se3.exp_so3(np.array([np.deg2rad(1.0), 0, 0])).T
    near = np.array([0, 0, 1.0])
    alone = most_common_upright(floor, near)
    assert angle_deg(alone.up_world, near) > 0.9
    both = most_common_upright(np.concatenate([floor, walls(rng, 3000)]), near)
    assert angle_deg(both.up_world, near) < 0.3


def test_max_frames_bounds_what_is_read():
    scan, read = room_scan(VIEWS), []

    class Counting(NoFiles):
        def depth(self, i):
            read.append(i)
            return scan.files.depth(i)

    with patch.object(gravity_module, "MAX_FRAMES", 3):
        find_gravity(replace(scan, files=Counting()), Runtime(1))
    assert sorted(read) == [0, 4, 8]


def test_level_puts_the_floor_at_zero():
    gravity = Gravity(np.array([0.0, 1.0, 0.0]), 1.0, "")
    level = level_from_world(gravity, -1.2)
    assert_allclose(level @ [3.0, -1.2, 5.0, 1.0], [3, -5, 0, 1], atol=1e-12)
    unknown = level_from_world(gravity, float("nan"))
    assert_allclose(unknown @ [0, 0.5, 0, 1.0], [0, 0, 0.5, 1], atol=1e-12)
