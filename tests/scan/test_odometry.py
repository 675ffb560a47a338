"""The sigmas of recorded motion: per step, and between frames far apart."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import random_transforms
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry


def straight(n, step_m=0.5, rotation=0.0):
    step = se3.make_transform(se3.exp_so3(np.array([0, 0, rotation])), np.array([step_m, 0, 0]))
    poses = [np.eye(4)]
    for _ in range(n - 1):
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def test_steps_chain_to_the_recorded_poses(rng):
    poses = random_transforms(rng, 6)
    pose = poses[0]
    for i, step in enumerate(make_odometry(poses, OdometryOptions()).cam_from_next):
        pose = pose @ step
        assert_allclose(pose, poses[i + 1], atol=1e-9)


def test_options_set_the_sigmas_of_a_step():
    poses = straight(3, step_m=0.5, rotation=np.deg2rad(10))
    odometry = make_odometry(poses, OdometryOptions(0.01, 0.02, 0.1, 0.01))
    assert_allclose(odometry.sigma_translation, 0.01 + 0.02 * 0.5)
    assert_allclose(odometry.sigma_rotation, np.deg2rad(0.1 + 0.01 * 10))
    odometry = make_odometry(poses, OdometryOptions(0.03, 0.0, 0.5, 0.0))
    assert_allclose(odometry.sigma_translation, 0.03)
    assert_allclose(odometry.sigma_rotation, np.deg2rad(0.5))


def test_walked_is_the_length_of_the_path():
    odometry = make_odometry(straight(5, step_m=0.5), OdometryOptions())
    assert_allclose(odometry.walked_m, [0, 0.5, 1, 1.5, 2])


def test_sigma_between_neighbours_is_that_of_the_step_and_a_little_swing():
    odometry = make_odometry(straight(5), OdometryOptions())
    rotation, translation = odometry.sigma_between(np.array([1]), np.array([2]))
    assert_allclose(rotation, odometry.sigma_rotation[1])
    swing = odometry.sigma_rotation[1] * 0.5 / np.sqrt(3)
    assert_allclose(translation, np.hypot(odometry.sigma_translation[1], swing))


def test_sigma_grows_with_distance_and_does_not_depend_on_the_order():
    odometry = make_odometry(straight(50), OdometryOptions())
    last = np.arange(50)
    rotation, translation = odometry.sigma_between(np.zeros(50, dtype=int), last)
    assert rotation[0] == translation[0] == 0
    assert np.all(np.diff(rotation) > 0)
    assert np.all(np.diff(translation) > 0)
    back_rotation, back_translation = odometry.sigma_between(last, np.zeros(50, dtype=int))
    assert_allclose(back_rotation, rotation)
    assert_allclose(back_translation, translation)


def test_sigma_covers_simulated_drift(rng):
    n = 40
    poses = straight(n)
    options = OdometryOptions(0.02, 0.0, 0.3, 0.0)
    odometry = make_odometry(poses, options)
    ends = []
    for _ in range(300):
        delta = rng.normal(size=(n - 1, 6)) * ([np.deg2rad(0.3)] * 3 + [0.02] * 3)
        pose = np.eye(4)
        for step in se3.retract(odometry.cam_from_next, delta):
            pose = pose @ step
        ends.append(pose)
    ends = np.stack(ends)
    rotation, translation = odometry.sigma_between(np.array([0]), np.array([n - 1]))
    off = ends[:, :3, 3] - poses[-1, :3, 3]
    assert np.sqrt(np.mean(off[:, 1:] ** 2)) == pytest.approx(translation[0], rel=0.15)
    angle = se3.log_so3(ends[:, :3, :3])
    assert np.sqrt(np.mean(angle**2)) == pytest.approx(rotation[0], rel=0.15)


def test_frames_may_be_one_or_a_table():
    odometry = make_odometry(straight(6), OdometryOptions())
    first, last = np.arange(6)[:, None], np.arange(6)[None, :]
    rotation, translation = odometry.sigma_between(first, last)
    one_rotation, one_translation = odometry.sigma_between(np.array(1), np.array(4))
    assert rotation.shape == translation.shape == (6, 6)
    assert one_rotation.shape == one_translation.shape == ()
    assert (one_rotation, one_translation) == (rotation[1, 4], translation[1, 4])


def test_one_frame_has_no_steps():
    odometry = make_odometry(np.eye(4)[None], OdometryOptions())
    assert odometry.cam_from_next.shape == (0, 4, 4)
    assert_allclose(odometry.walked_m, [0.0])


def test_frames_of_one_time_are_fixed_to_each_other():
    """Views of one instant, a quarter turn apart: nothing between them may move, and the step to the next
    instant is as sure as its motion, not as the quarter turn between the views that it joins."""
    quarter = [se3.make_transform(se3.exp_so3(np.array([0.0, k * np.pi / 2, 0.0])), np.zeros(3))
               for k in range(4)]  # fmt: skip
    body = straight(3, step_m=0.5)
    poses = np.concatenate([[one @ view for view in quarter] for one in body])
    odometry = make_odometry(
        poses, OdometryOptions(0.01, 0.02, 0.1, 0.01), np.repeat([0.0, 0.5, 1.0], 4)
    )
    crossing = np.array([3, 7])
    fixed = np.delete(np.arange(11), crossing)
    assert odometry.sigma_rotation[fixed].max() < np.deg2rad(0.01)
    assert odometry.sigma_translation[fixed].max() < 0.001
    assert_allclose(odometry.sigma_rotation[crossing], np.deg2rad(0.1), rtol=1e-6)
    assert_allclose(odometry.sigma_translation[crossing], 0.01 + 0.02 * 0.5)
    alone = make_odometry(body, OdometryOptions(0.01, 0.02, 0.1, 0.01))
    for name in ("rotation", "translation"):
        ends = [getattr(o, f"sigma_{name}") for o in (odometry, alone)]
        assert_allclose(np.sqrt((ends[0] ** 2).sum()), np.sqrt((ends[1] ** 2).sum()), rtol=1e-2)


def test_two_images_of_a_coarse_clocks_second_are_not_fixed_to_each_other():
    times, poses = np.repeat(np.arange(4.0), 2), straight(8)
    coarse, without = (make_odometry(poses, OdometryOptions(), t) for t in (times, None))
    assert_allclose(coarse.sigma_translation, without.sigma_translation)
