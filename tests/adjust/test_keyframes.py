"""Keyframes: chosen by motion, measurements kept, the rest carried along."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import make_world, nudged
from planfit.adjust import AdjustOptions, KeyframeOptions, close_loops, costs
from planfit.adjust.keyframes import (
    choose_keyframes,
    follow_keyframes,
    reduce_measurements,
)
from planfit.geometry import se3
from planfit.synth import DriftOptions, drift_poses


def straight_walk(n, step_m=0.1, rotation_deg=0.0):
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = se3.exp_so3(np.outer(np.arange(n), [0, 0, np.deg2rad(rotation_deg)]))
    poses[:, 0, 3] = step_m * np.arange(n)
    return poses


def test_short_scans_keep_every_frame():
    found = choose_keyframes(straight_walk(10), KeyframeOptions(min_frames=11))
    assert_array_equal(found.frame_idx, np.arange(10))
    assert_array_equal(found.nearest, np.arange(10))
    assert_allclose(found.key_from_cam, np.tile(np.eye(4), (10, 1, 1)), atol=1e-12)


def test_steps_between_keyframes_are_bounded_and_no_shorter_than_needed():
    options = KeyframeOptions(min_frames=0, max_step_m=0.35)
    found = choose_keyframes(straight_walk(50), options)
    assert found.frame_idx[0] == 0
    assert found.frame_idx[-1] == 49
    assert set(np.diff(found.frame_idx)[:-1]) == {3}


def test_sharper_frames_are_preferred_within_the_end_of_a_stretch():
    poses = straight_walk(200, step_m=0.01)
    sharpness = np.where(np.arange(200) % 7 == 3, 2.0, 1.0)
    plain = KeyframeOptions(min_frames=0, sharper_share=0.0)
    by_motion = choose_keyframes(poses, plain).frame_idx
    assert_array_equal(choose_keyframes(poses, plain, sharpness).frame_idx, by_motion)
    sharp = choose_keyframes(poses, KeyframeOptions(min_frames=0), sharpness).frame_idx
    assert np.all(sharpness[sharp[1:-1]] == 2.0)
    assert np.diff(sharp).max() <= np.diff(by_motion).max()
    assert np.diff(sharp)[:-1].min() >= 0.6 * np.diff(by_motion)[:-1].min() - 1
    # Where all are alike, nothing changes.
    same = choose_keyframes(poses, KeyframeOptions(min_frames=0), np.ones(200)).frame_idx
    assert_array_equal(same, by_motion)


def test_turning_on_the_spot_makes_keyframes():
    options = KeyframeOptions(min_frames=0, max_rotation_deg=10.5)
    found = choose_keyframes(straight_walk(40, step_m=0.0, rotation_deg=2.0), options)
    assert set(np.diff(found.frame_idx)[:-1]) == {5}


def test_frames_follow_a_rigid_motion_of_their_keyframes_exactly(rng):
    poses = nudged(rng, straight_walk(40, rotation_deg=1.0), 0.5, 0.01)
    found = choose_keyframes(poses, KeyframeOptions(min_frames=0))
    assert len(found.frame_idx) < 25
    motion = se3.make_transform(se3.exp_so3(np.array([0.3, -0.2, 1.0])), np.array([5.0, 1, 2]))
    assert_allclose(
        follow_keyframes(motion @ poses[found.frame_idx], found), motion @ poses, atol=1e-9
    )


def test_frames_between_two_keyframes_share_their_correction():
    poses = straight_walk(9)
    found = choose_keyframes(poses, KeyframeOptions(min_frames=0, max_step_m=0.85))
    assert_array_equal(found.frame_idx, [0, 8])
    moved = poses[found.frame_idx].copy()
    moved[1, 1, 3] = 0.8
    assert_allclose(follow_keyframes(moved, found)[:, 1, 3], 0.1 * np.arange(9), atol=1e-12)


def test_measurements_cost_the_same_at_poses_that_keep_to_the_record(rng):
    world = make_world(rng)
    recorded = world.plan_from_cams
    found = choose_keyframes(
        recorded, KeyframeOptions(min_frames=0, max_step_m=4.0, max_rotation_deg=150)
    )
    assert len(found.frame_idx) < len(recorded)
    reduced = reduce_measurements(world.measurements, found)
    motion = se3.yaw_transform(0.01, np.array([0.02, 0.03, 0.01]))
    full = costs(world.measurements, motion @ recorded, AdjustOptions())
    few = costs(reduced, motion @ recorded[found.frame_idx], AdjustOptions())
    assert few["odometry"] == pytest.approx(0.0, abs=1e-12)
    assert few["points"] <= full["points"] + 1e-9
    assert len(reduced.structure.walls) == len(world.structure.walls)
    assert len(reduced.structure.floor.points_cam) == len(world.structure.floor.points_cam)


def test_solving_for_keyframes_is_nearly_as_good(rng):
    world = make_world(rng)
    up = np.array([0.0, 0, 1.0])
    recorded = drift_poses(
        world.plan_from_cams, DriftOptions(yaw_deg=0.3, translation_m=0.01), rng, up
    )
    found = choose_keyframes(
        recorded, KeyframeOptions(min_frames=0, max_step_m=4.0, max_rotation_deg=150)
    )
    reduced = reduce_measurements(world.measurements, found)
    solved = close_loops(reduced, recorded[found.frame_idx], AdjustOptions())
    after = follow_keyframes(solved.target_from_cams, found)

    def error(poses):
        return np.linalg.norm(poses[:, :3, 3] - world.plan_from_cams[:, :3, 3], axis=1).mean()

    assert error(after) < 0.7 * error(recorded)
