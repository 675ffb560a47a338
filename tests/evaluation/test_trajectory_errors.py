"""Trajectory errors, by hand."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from builders import random_transforms
from planfit.errors import ScanError
from planfit.evaluation import associate_times, position_errors, relative_errors
from planfit.geometry import se3


def line(n=5, step_m=1.0):
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = np.arange(n) * step_m
    return poses


def test_truth_has_no_error(rng):
    poses = random_transforms(rng, 10)
    errors = position_errors(poses, poses)
    assert errors.rms_m == errors.mean_m == errors.max_m == 0.0
    assert errors.aligned_rms_m == pytest.approx(0.0, abs=1e-9)
    assert errors.rotation_mean_deg == pytest.approx(0.0, abs=1e-5)


def test_by_hand():
    truth, poses = line(4), line(4)
    poses[:, 1, 3] = [0.0, 3.0, 0.0, 4.0]
    errors = position_errors(poses, truth)
    assert errors.rms_m == pytest.approx(2.5)
    assert errors.mean_m == pytest.approx(1.75)
    assert errors.max_m == pytest.approx(4.0)
    assert errors.mean_offset_m == pytest.approx((0.0, 1.75, 0.0))


def test_alignment_removes_a_rigid_motion_and_nothing_else(rng):
    truth = random_transforms(rng, 20)
    moved = se3.yaw_transform(0.5, np.array([3.0, -2.0, 1.0])) @ truth
    errors = position_errors(moved, truth)
    assert errors.rms_m > 1.0
    assert errors.aligned_rms_m == pytest.approx(0.0, abs=1e-9)
    assert errors.rotation_mean_deg == pytest.approx(np.rad2deg(0.5))
    scaled = truth.copy()
    scaled[:, :3, 3] *= 1.1
    centred = truth[:, :3, 3] - truth[:, :3, 3].mean(axis=0)
    expected = 0.1 * np.sqrt(np.mean(np.sum(centred**2, axis=1)))
    assert position_errors(scaled, truth).aligned_rms_m == pytest.approx(expected)


def test_a_translation_of_the_whole_shows_in_the_mean_offset():
    poses = line()
    poses[:, 2, 3] += 0.3
    errors = position_errors(poses, line())
    assert errors.mean_offset_m == pytest.approx((0, 0, 0.3))
    assert errors.rms_m == pytest.approx(0.3)


@pytest.mark.parametrize("n", [1, 2])
def test_one_or_two_poses_are_not_aligned(n):
    poses = line(n)
    poses[:, 1, 3] += 1.0
    errors = position_errors(poses, line(n))
    assert errors.aligned_rms_m == errors.rms_m == pytest.approx(1.0)


def test_steps_by_hand():
    poses = line(5)
    poses[3:, 1, 3] += 0.4  # one jump aside between the third and the fourth
    errors = relative_errors(poses, line(5), 1.0)
    assert errors.n_pairs == 4
    assert errors.translation_rms_m == pytest.approx(np.sqrt(0.4**2 / 4))
    assert errors.rotation_rms_deg == pytest.approx(0.0, abs=1e-6)
    errors = relative_errors(poses, line(5), 2.0)
    assert errors.n_pairs == 3
    assert errors.translation_rms_m == pytest.approx(np.sqrt(2 * 0.4**2 / 3))


def test_a_rotation_in_the_path_is_counted_once():
    poses = line(5)
    poses[2:] = se3.yaw_transform(np.deg2rad(6.0)) @ poses[2:]
    poses[2:, :3, 3] += line(5)[2, :3, 3] - poses[2, :3, 3]
    errors = relative_errors(poses, line(5), 1.0)
    assert errors.rotation_rms_deg == pytest.approx(np.sqrt(6.0**2 / 4))


def test_steps_do_not_depend_on_the_frame(rng):
    truth = random_transforms(rng, 15)
    poses = se3.retract(truth, rng.normal(0, 0.02, (15, 6)))
    here = relative_errors(poses, truth, 5.0)
    there = relative_errors(random_transforms(rng, 1)[0] @ poses, truth, 5.0)
    assert there.translation_rms_m == pytest.approx(here.translation_rms_m)
    assert there.rotation_rms_deg == pytest.approx(here.rotation_rms_deg)


def test_a_path_shorter_than_the_step():
    assert relative_errors(line(3), line(3), 5.0) is None


def test_times_are_associated_with_the_nearest():
    times = np.array([0.0, 1.001, 2.5, 3.99, 10.0])
    true_times = np.array([4.0, 0.01, 1.0, 2.0, 3.0])  # not sorted
    mine, true = associate_times(times, true_times)
    assert_array_equal(mine, [0, 1, 3])
    assert_array_equal(true, [1, 2, 0])


def test_max_difference_s():
    mine, true = associate_times(np.array([0.4, 2.0]), np.array([0.0, 1.0]), 0.5)
    assert_array_equal(mine, [0])
    assert_array_equal(true, [0])


def test_a_true_pose_belongs_to_one_frame_only():
    """Three frames a true pose: the nearest has it, as its neighbours were elsewhere at that time."""
    times = np.arange(9) / 30
    mine, true = associate_times(times, times[1::3] + 0.002, 0.1)
    assert_array_equal(mine, [1, 4, 7])
    assert_array_equal(true, [0, 1, 2])


def test_a_single_true_pose():
    mine, true = associate_times(np.array([0.0, 5.0]), np.array([5.0]))
    assert_array_equal(mine, [1])
    assert_array_equal(true, [0])


def test_truth_of_another_scan():
    with pytest.raises(ScanError, match="truth of this scan"):
        associate_times(np.arange(5.0), np.arange(100.0, 105.0))
