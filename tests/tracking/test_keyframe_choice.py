"""Keyframes chosen from the recorded trajectory alone, and more of them where it is in doubt."""

from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planfit.errors import OptionError
from planfit.findings import Finding, PoseKind
from planfit.geometry import se3
from planfit.matching import spanned_steps
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.tracking import (
    KeyframeOptions,
    Tracking,
    TrackingBreak,
    choose_keyframes,
    frames_in_doubt,
    keyframes,
)

PLAIN = KeyframeOptions(min_frames=0)


def walk(n, step_m=0.02, rotation_deg=0.0):
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = se3.exp_so3(np.outer(np.arange(n), [0, 0, np.deg2rad(rotation_deg)]))
    poses[:, 0, 3] = 1.0 + step_m * np.arange(n)
    return poses


def at_30_hz(n):
    return np.arange(n) / 30.0


def chosen(poses, options=PLAIN, times=None):
    with patch.object(keyframes, "STEADIER_SHARE", 0.0):
        return choose_keyframes(poses, at_30_hz(len(poses)) if times is None else times, options)


def test_short_scans_keep_every_frame():
    assert_array_equal(chosen(walk(599), KeyframeOptions()), np.arange(599))
    assert len(chosen(walk(600), KeyframeOptions())) < 100


def test_keyframes_are_as_far_apart_as_allowed_and_no_nearer():
    found = chosen(walk(100), KeyframeOptions(min_frames=0, max_step_m=0.105))
    assert found[0] == 0
    assert found[-1] == 99
    assert set(np.diff(found)[:-1]) == {5}


def test_turning_on_the_spot_makes_keyframes():
    options = KeyframeOptions(min_frames=0, max_rotation_deg=10.5)
    assert set(np.diff(chosen(walk(40, 0.0, rotation_deg=2.0), options))[:-1]) == {5}


def test_a_camera_that_hardly_moves_is_looked_at_now_and_then():
    poses = walk(301, step_m=1e-5)
    assert set(np.diff(chosen(poses))[:-1]) <= {29, 30}
    options = KeyframeOptions(min_frames=0, max_interval_s=0.505)
    assert set(np.diff(chosen(poses, options))[:-1]) == {15}
    # Numbers are no times: as if recorded at 30 frames a second.
    assert set(np.diff(chosen(poses, PLAIN, np.arange(301.0)))[:-1]) <= {29, 30}


def test_steady_frames_are_preferred_within_the_last_part():
    poses = walk(200, step_m=0.01)
    # The camera shakes at every twentieth frame, at which keyframes are due.
    shaken = np.arange(200) % 20 == 0
    poses[shaken, :3, :3] = se3.exp_so3(np.array([0.0, np.deg2rad(0.1), 0.0]))
    options = KeyframeOptions(min_frames=0, max_step_m=0.205)
    by_motion = chosen(poses, options)
    steady = choose_keyframes(poses, at_30_hz(200), options)
    assert shaken[by_motion[1:-1]].all()
    assert not shaken[steady[1:-1]].any()
    assert np.diff(steady).max() <= np.diff(by_motion).max()


def test_both_ends_of_a_jump_are_keyframes():
    poses = walk(100)
    poses[50:, 0, 3] += 3.0
    for options in (PLAIN, KeyframeOptions(min_frames=0)):
        found = chosen(poses, options)
        assert {49, 50} <= set(found.tolist())


def test_frames_whose_pose_repeats_are_all_looked_at_and_those_beside():
    poses = walk(400)
    poses[200:210] = poses[200]
    found = set(chosen(poses).tolist())
    assert set(range(192, 218)) <= found
    assert len(found) < 80
    identity = walk(400)
    identity[300] = np.eye(4)
    assert set(range(292, 309)) <= set(chosen(identity).tolist())


def test_poses_that_repeat_by_two_or_mostly_are_how_the_scan_was_recorded():
    by_two = np.repeat(walk(200, step_m=0.04), 2, axis=0)
    assert len(chosen(by_two)) < 60
    mostly = walk(400)
    mostly[100:350] = mostly[100]
    assert len(chosen(mostly)) < 40


def judged(n, breaks=(), doubtful=()):
    poses = walk(n)
    steps = make_odometry(poses, OdometryOptions())
    return Tracking(
        poses, poses, steps, breaks=tuple(breaks), doubtful_steps=np.array(doubtful, dtype=int)
    )


def jump(first, last):
    jumped = Finding(PoseKind.REVISITS_CONTRADICT_MOTION, frames=((first, last),))
    return TrackingBreak("jump", first, last, (1.0, 0.0), (0.0, 0.0), 3, jumped)


KEYS = np.arange(0, 101, 10)
BRIDGED = np.ones(10, dtype=bool)


def test_nothing_more_is_looked_at_without_doubt():
    assert len(frames_in_doubt(judged(101), KEYS, BRIDGED)) == 0


def test_all_frames_about_a_break_are_looked_at():
    found = frames_in_doubt(judged(101, [jump(33, 34)]), KEYS, BRIDGED)
    assert set(range(31, 40)) <= set(found.tolist())
    # A break between two keyframes puts both gaps beside it in doubt.
    found = frames_in_doubt(judged(101, [jump(30, 31)]), KEYS, BRIDGED)
    assert set(range(31, 40)) <= set(found.tolist())
    assert found.min() > 10
    assert found.max() < 50
    doubtful = frames_in_doubt(judged(101, (), [55]), KEYS, BRIDGED)
    assert_array_equal(doubtful, np.arange(51, 60))


def test_gaps_that_no_match_spans_get_some_more_frames_within_the_budget():
    bridged = BRIDGED.copy()
    bridged[[2, 6]] = False
    with patch.object(keyframes, "MAX_MORE_SHARE", 1.0):
        only = frames_in_doubt(judged(101), KEYS, bridged)
    assert set((only // 10).tolist()) == {2}  # 11 keyframes allow one gap of seven frames
    assert len(only) == 7
    with patch.object(keyframes, "MAX_MORE_SHARE", 0.0):
        none = frames_in_doubt(judged(101), KEYS, bridged)
    assert len(none) == 0


def test_options_that_cannot_work_are_refused():
    with pytest.raises(OptionError):
        KeyframeOptions(max_step_m=0.0)


def test_a_tracker_is_believed_as_much_however_many_poses_it_records():
    fast, keys = walk(81, 0.025, 0.5), np.arange(0, 81, 8)
    slow = make_odometry(fast[keys], OdometryOptions())
    odometry = make_odometry(fast, OdometryOptions(), None, keys)
    for a, b in ((0, 1), (0, 10), (3, 7)):
        assert np.allclose(
            odometry.sigma_between(keys[a : a + 1], keys[b : b + 1]),
            slow.sigma_between(np.array([a]), np.array([b])),
        )
    between = odometry.between(keys, fast[keys])
    assert np.allclose(between.cam_from_next, slow.cam_from_next)
    assert np.allclose(between.sigma_rotation, slow.sigma_rotation)
    assert np.allclose(between.sigma_translation, slow.sigma_translation, rtol=0.02)
    # Without keyframes each of the eight steps adds its own.
    plain = make_odometry(fast, OdometryOptions())
    assert plain.sigma_between(keys[:1], keys[1:2])[0] > 2 * slow.sigma_rotation[0]


def test_steps_between_the_frames_of_any_pair_are_spanned():
    rng = np.random.default_rng(2)
    for n_pairs in (0, 1, 5, 12):
        first = rng.integers(0, 30, n_pairs)
        pairs = np.column_stack([first, np.minimum(first + rng.integers(1, 6, n_pairs), 30)])
        slow = np.zeros(30, dtype=bool)
        for a, b in pairs:
            slow[a:b] = True
        assert_array_equal(spanned_steps(pairs, 30), slow)
