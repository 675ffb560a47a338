"""Heights of level surfaces, and what is seen over what."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.segmentation.storeys import storey_heights
from planfit.segmentation.visibility_map import FrameSample, build_submap, level_peaks


def heights(rng, *parts):
    return np.concatenate([rng.normal(z, 0.01, n) for z, n in parts])


def test_peaks_are_found_most_first(rng):
    found, counts = level_peaks(heights(rng, (-1.4, 5000), (-0.65, 3000), (0.4, 100)), 1 / 3)
    assert_allclose(found, [-1.4, -0.65], atol=0.005)
    assert counts.tolist() == [5000, 3000]


def test_min_share_and_min_count(rng):
    some = heights(rng, (0.0, 1000), (2.0, 300))
    assert len(level_peaks(some, 0.5)[0]) == 1
    assert len(level_peaks(some, 0.2)[0]) == 2
    assert len(level_peaks(some, 0.2, min_count=400)[0]) == 1
    assert len(level_peaks(some[:20], 0.2)[0]) == 0
    assert len(level_peaks(np.zeros(0), 0.2)[0]) == 0


def level_sample(rng, *parts, camera_z=1.5):
    """Level surfaces at heights z with n points each, facing up below the camera and down above."""
    z = heights(rng, *parts)
    points = np.column_stack([rng.uniform(-2, 2, (len(z), 2)), z]).astype(np.float32)
    return FrameSample(np.array([0, 0, camera_z]), points, np.where(z < camera_z, 1.0, -1.0))


def mapped(*samples):
    return build_submap(list(samples), 0.26, 0.15, 0.4)


def test_a_large_table_does_not_pass_for_the_floor(rng):
    assert mapped(level_sample(rng, (0.0, 400), (0.75, 900))).floor_m == pytest.approx(0, abs=0.01)


def test_a_floor_seen_past_a_table_is_the_floor_where_cameras_stand_so_high_over_it(rng):
    """As in a kitchen whose worktops fill the images: 0.7 m below the camera, the floor 1.4 m."""
    assert mapped(level_sample(rng, (0.1, 60), (0.8, 900))).floor_m == pytest.approx(0.1, abs=0.01)


def test_what_mirrors_and_shafts_show_below_a_floor_is_no_floor(rng):
    found = mapped(level_sample(rng, (-1.2, 230), (0.0, 900), camera_z=1.9))
    assert found.floor_m == pytest.approx(0.0, abs=0.01)


def test_a_few_points_below_do_not_pass_for_the_floor(rng):
    assert mapped(level_sample(rng, (-1.0, 50), (0.0, 900))).floor_m == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(("camera_z", "is_floor"), [(1.6, False), (1.6 + 0.6, True)])
def test_fronts_below_a_worktop_say_that_the_floor_is_not_seen(rng, camera_z, is_floor):
    """Of 7-Scenes' kitchen, worktops alone: a fifth as many points on fronts below, 0.7 m above it."""
    top = level_sample(rng, (0.9, 900), camera_z=camera_z)
    fronts = level_sample(rng, (0.4, 180), camera_z=camera_z)
    found = mapped(top, replace(fronts, normal_z=np.zeros(180, np.float32)))
    assert np.isfinite(found.floor_m) == is_floor


def test_what_a_shining_floor_reflects_leaves_it_the_floor_of_a_robot(rng):
    floor = level_sample(rng, (0.0, 900), camera_z=0.5)
    walls = level_sample(rng, *((z, 3) for z in np.arange(-2.4, 0.0, 0.2)), camera_z=0.5)
    reflected = replace(walls, normal_z=np.zeros(len(walls.points), np.float32))
    assert mapped(floor, reflected).floor_m == pytest.approx(0.0, abs=0.01)


def test_points_below_the_floor_leave_it_the_floor(rng):
    floor, below = level_sample(rng, (0.0, 900)), level_sample(rng, (-0.6, 250))
    sideways = replace(below, normal_z=np.zeros(250, np.float32))
    assert mapped(floor, sideways).floor_m == pytest.approx(0.0, abs=0.01)


def test_floor_of_the_storey_that_the_camera_is_on(rng):
    found = mapped(level_sample(rng, (0.0, 900), (3.0, 900), camera_z=4.5))
    assert found.floor_m == pytest.approx(3.0, abs=0.01)


def test_two_ceilings(rng):
    found = mapped(level_sample(rng, (0.0, 500), (2.4, 900), (3.2, 400)))
    assert_allclose(found.ceilings_m, [2.4, 3.2], atol=0.01)


def test_nothing_level():
    found = mapped(FrameSample(np.zeros(3), np.zeros((0, 3), np.float32), np.zeros(0, np.float32)))
    assert np.isnan(found.floor_m)
    assert len(found.ceilings_m) == 0


def upright(x, z_low, z_high):
    y, z = np.meshgrid(np.arange(-1, 1, 0.05), np.arange(z_low, z_high, 0.05))
    return np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()])


def test_what_is_seen_over_is_no_wall_and_what_is_behind_it_is():
    shelf, wall = upright(2.03, 0.0, 1.2), upright(3.03, 1.2, 2.4)
    points = np.concatenate([shelf, wall]).astype(np.float32)
    found = mapped(FrameSample(np.array([0, 0, 1.5]), points, np.zeros(len(points), np.float32)))
    at = found.wall_at(np.array([[2.03, 0.0], [3.03, 0.0], [1.0, 0.0], [90.0, 0.0], [np.nan, 0.0]]))
    assert at.tolist() == [False, True, False, False, False]


def test_storeys_keep_their_floors_and_tables_and_gaps_get_them():
    floors = np.array([0.0, 0.05, 0.75, np.nan, 0.02, 1.5, 3.0, 3.02, 3.0, 2.98])
    found = storey_heights(floors)
    assert_allclose(found[[0, 1, 4, 6, 7, 8, 9]], floors[[0, 1, 4, 6, 7, 8, 9]])
    assert_allclose(found[3], 0.02)
    assert_allclose(found[2], 0.05)
    assert np.isnan(found[5])


def test_the_lower_of_two_heights_is_the_floor_though_most_submaps_see_the_worktop():
    floors = np.array([0.7, 0.71, 0.7, 0.0, 0.7, 0.7])
    assert_allclose(storey_heights(floors), 0.0)


def test_a_floor_that_drifts_over_a_long_scan_stays_what_it_is():
    floors = np.linspace(0.0, 1.0, 11)
    assert_allclose(storey_heights(floors), floors)


def test_one_stray_low_floor_among_many_is_ignored():
    floors = np.array([-1.0] + [0.0] * 39)
    assert_allclose(storey_heights(floors)[1:], 0.0)


def test_no_storey_at_all():
    assert np.isnan(storey_heights(np.full(3, np.nan))).all()
