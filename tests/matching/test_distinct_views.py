"""Distinct views: one frame for those alike, another for another visit."""

import numpy as np
from numpy.testing import assert_array_equal

from builders import look
from planfit.matching.pairs import distinct_views


def walked(poses):
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def test_a_camera_that_stands_is_one_view():
    poses = np.stack([look([0.1, 0.1, 1.6], 3)] * 50)
    assert_array_equal(distinct_views(poses, walked(poses)).frame_idx, [0])


def test_the_sharpest_stands_for_its_like():
    poses = np.stack([look([0.1, 0.1, 1.6], 3)] * 50)
    sharpness = np.zeros(50)
    sharpness[17] = 1
    assert_array_equal(distinct_views(poses, walked(poses), sharpness).frame_idx, [17])


def test_each_step_and_each_turn_of_a_fast_walk_is_a_view():
    poses = np.stack([look([0.3 * i, 0, 1.5], 0) for i in range(30)])
    assert len(distinct_views(poses, walked(poses)).frame_idx) == 30
    poses = np.stack([look([0, 0, 1.5], 15 * i) for i in range(24)])
    assert len(distinct_views(poses, walked(poses)).frame_idx) >= 20


def test_a_later_visit_of_a_view_is_another():
    out = [look([0.3 * i, 0, 1.5], 0) for i in range(20)]
    poses = np.stack(out + out[::-1])
    views = distinct_views(poses, walked(poses))
    assert {0, 39} <= set(views.frame_idx.tolist())
    assert_array_equal(views.centres, poses[views.frame_idx, :3, 3])
    assert_array_equal(views.forward, poses[views.frame_idx, :3, 2])
