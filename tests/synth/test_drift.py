"""Drift: a random walk with the stated standard deviation, about the stated axes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.synth import DriftOptions, drift_poses

NONE = {"yaw_deg": 0.0, "translation_m": 0.0}


def trajectory(n, rng):
    rotations = se3.exp_so3(rng.normal(size=(n, 3)))
    return se3.make_transform(rotations, rng.normal(size=(n, 3)) * 5.0)


def motion_errors(true, drifted):
    """The error put on each motion, in world axes: rotation vectors and translations (n - 1, 3)."""
    true_motion = se3.inverse(true[:-1]) @ true[1:]
    motion = se3.inverse(drifted[:-1]) @ drifted[1:]
    error_cam = motion @ se3.inverse(true_motion)
    rotation = true[:-1, :3, :3]
    rotations = rotation @ error_cam[:, :3, :3] @ np.swapaxes(rotation, 1, 2)
    return se3.log_so3(rotations), (rotation @ error_cam[:, :3, 3:])[..., 0]


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.36, -0.48, 0.8)])
def test_sigma_is_as_stated_about_every_axis(up):
    rng = np.random.default_rng(0)
    up = np.array(up)
    true = trajectory(6000, rng)
    options = DriftOptions(yaw_deg=0.2, translation_m=0.01)
    drifted = drift_poses(true, options, rng, up)
    rotations, translations = motion_errors(true, drifted)
    across = np.cross(up, [0.6, 0.8, 0.0])
    across /= np.linalg.norm(across)
    assert_allclose(np.rad2deg(np.std(rotations @ up)), 0.2, rtol=0.04)
    assert_allclose(np.rad2deg(np.std(rotations @ across)), 0.06, rtol=0.04)
    assert_allclose(np.std(translations @ up), 0.003, rtol=0.04)
    assert_allclose(np.std(translations @ across), 0.01, rtol=0.04)


def test_heading_error_grows_with_the_root_of_the_frames():
    true = np.tile(np.eye(4), (401, 1, 1))
    options = DriftOptions(yaw_deg=0.1, translation_m=0.0)
    up = np.array([0.0, 0.0, 1.0])
    yaw = [
        se3.log_so3(drift_poses(true, options, np.random.default_rng(seed), up)[[100, 400], :3, :3])
        for seed in range(300)
    ]
    assert_allclose(np.rad2deg(np.std(yaw, axis=0)[:, 2]), [1.0, 2.0], rtol=0.12)


def test_first_pose_is_kept_and_no_drift_changes_nothing():
    rng = np.random.default_rng(1)
    true, up = trajectory(50, rng), np.array([0.0, 1.0, 0.0])
    assert_array_equal(drift_poses(true, DriftOptions(), rng, up)[0], true[0])
    assert_allclose(drift_poses(true, DriftOptions(**NONE), rng, up), true, atol=1e-12)


@pytest.mark.parametrize(
    ("field", "axis", "part"),
    [("yaw_deg", "up", "rotation"), ("translation_m", "across", "translation")],
)
def test_each_sigma_moves_only_its_own(field, axis, part):
    rng = np.random.default_rng(2)
    true, up = trajectory(100, rng), np.array([0.0, 0.0, 1.0])
    rotations, translations = motion_errors(true, drift_poses(true, DriftOptions(**(NONE | {field: 0.1})),
                                                    rng, up))  # fmt: skip
    moved, still = (rotations, translations) if part == "rotation" else (translations, rotations)
    along, across = np.std(moved[:, 2]), np.std(moved[:, :2])
    ratio = along / across if axis == "up" else across / along
    assert ratio == pytest.approx(1 / 0.3, rel=0.3)
    assert_allclose(still, 0.0, atol=1e-9)


def test_moving_the_world_moves_the_drifted_poses_along():
    true = trajectory(30, np.random.default_rng(3))
    up = np.array([0.0, 0.0, 1.0])
    moved_from_world = se3.make_transform(np.eye(3), np.array([10.0, -4.0, 2.0]))
    one = drift_poses(true, DriftOptions(), np.random.default_rng(4), up)
    two = drift_poses(moved_from_world @ true, DriftOptions(), np.random.default_rng(4), up)
    assert_allclose(two, moved_from_world @ one, atol=1e-9)


def test_negative_sigma_is_refused():
    with pytest.raises(OptionError, match="drift"):
        DriftOptions(yaw_deg=-0.1)


def test_jumps_are_as_often_and_as_large_as_asked():
    true = np.tile(np.eye(4), (4001, 1, 1))
    still = {"yaw_deg": 0.0, "translation_m": 0.0}
    options = DriftOptions(**still, jumps_per_100_frames=5.0, jump_m=0.2, jump_yaw_deg=3.0)
    poses = drift_poses(true, options, np.random.default_rng(0), np.array([0, 0, 1.0]))
    step = se3.inverse(poses[:-1]) @ poses[1:]
    jumped = np.linalg.norm(step[:, :3, 3], axis=1) > 1e-9
    assert 150 < jumped.sum() < 250
    assert np.std(step[jumped, :2, 3]) == pytest.approx(0.2, rel=0.15)
    yaw = np.rad2deg(np.arctan2(step[jumped, 1, 0], step[jumped, 0, 0]))
    assert np.std(yaw) == pytest.approx(3.0, rel=0.15)
    assert np.abs(step[:, 2, 3]).max() < 1e-9


def test_without_jumps_nothing_else_is_drawn():
    true = np.tile(np.eye(4), (50, 1, 1))
    up = np.array([0, 0, 1.0])
    plain, none = (
        drift_poses(true, options, np.random.default_rng(1), up)
        for options in (DriftOptions(), DriftOptions(jump_m=9.0, jump_yaw_deg=9.0))
    )
    assert np.array_equal(plain, none)
