"""Frames held to keyframes: measurements kept, the rest carried along."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import make_world, nudged
from planfit.adjust import AdjustOptions, close_loops, costs
from planfit.adjust.keyframes import (
    follow_keyframes,
    hold_to_keyframes,
    reduce_measurements,
)
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.synth import DriftOptions, drift_poses


def straight_walk(n, step_m=0.1, rotation_deg=0.0):
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = se3.exp_so3(np.outer(np.arange(n), [0, 0, np.deg2rad(rotation_deg)]))
    poses[:, 0, 3] = step_m * np.arange(n)
    return poses


def every_third(n):
    return np.unique([*range(0, n, 3), n - 1])


def test_a_frame_is_held_to_the_keyframe_that_is_nearer_along_the_path():
    poses = straight_walk(11)
    poses[6:, 0, 3] += 1.0  # between frames 5 and 6 the camera goes far
    found = hold_to_keyframes(poses, np.array([0, 10]))
    assert_array_equal(found.nearest, [0] * 6 + [1] * 5)
    for i, k in enumerate(found.nearest):
        assert_allclose(poses[found.frame_idx[k]] @ found.key_from_cam[i], poses[i], atol=1e-12)


def test_all_frames_as_keyframes_are_their_own():
    found = hold_to_keyframes(straight_walk(10), np.arange(10))
    assert_array_equal(found.nearest, np.arange(10))
    assert_allclose(found.key_from_cam, np.tile(np.eye(4), (10, 1, 1)), atol=1e-12)


def test_frames_follow_a_rigid_motion_of_their_keyframes_exactly(rng):
    poses = nudged(rng, straight_walk(40, rotation_deg=1.0), 0.5, 0.01)
    found = hold_to_keyframes(poses, np.array([0, 3, 9, 17, 30, 39]))
    motion = se3.make_transform(se3.exp_so3(np.array([0.3, -0.2, 1.0])), np.array([5.0, 1, 2]))
    assert_allclose(
        follow_keyframes(motion @ poses[found.frame_idx], found), motion @ poses, atol=1e-9
    )


def test_frames_between_two_keyframes_share_their_correction():
    poses = straight_walk(9)
    found = hold_to_keyframes(poses, np.array([0, 8]))
    moved = poses[found.frame_idx].copy()
    moved[1, 1, 3] = 0.8
    assert_allclose(follow_keyframes(moved, found)[:, 1, 3], 0.1 * np.arange(9), atol=1e-12)


def test_measurements_cost_the_same_at_poses_that_keep_to_the_record(rng):
    world = make_world(rng)
    recorded = world.plan_from_cams
    found = hold_to_keyframes(recorded, every_third(len(recorded)))
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
    found = hold_to_keyframes(recorded, every_third(len(recorded)))
    reduced = reduce_measurements(world.measurements, found)
    solved = close_loops(reduced, recorded[found.frame_idx], AdjustOptions())
    after = follow_keyframes(solved.target_from_cams, found)

    def error(poses):
        return np.linalg.norm(poses[:, :3, 3] - world.plan_from_cams[:, :3, 3], axis=1).mean()

    assert error(after) < 0.7 * error(recorded)


def test_what_keyframes_saw_is_not_copied(rng):
    world = make_world(rng)
    recorded = nudged(rng, world.plan_from_cams, 0.5, 0.01)
    n = len(recorded)
    between = np.insert(recorded, 4, recorded[3], axis=0)  # a frame that nothing was seen from
    own = np.delete(np.arange(n + 1), 4)
    seen = replace(
        world.measurements,
        matches=world.matches.numbered(own),
        structure=world.structure.numbered(own, n + 1),
        odometry=make_odometry(between, OdometryOptions()),
        cameras=(),
    )
    reduced = reduce_measurements(seen, hold_to_keyframes(between, own))
    assert reduced.matches.points_a is seen.matches.points_a
    assert reduced.matches.points_b is seen.matches.points_b
    assert reduced.structure.floor.points_cam is seen.structure.floor.points_cam
    assert reduced.structure.walls.points_cam is seen.structure.walls.points_cam
    assert_array_equal(reduced.matches.pairs, world.matches.pairs)
    assert_array_equal(reduced.structure.floor.start, world.structure.floor.start)
