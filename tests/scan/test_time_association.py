"""Clocks that differ: pairs by time, poses between poses."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from planfit.geometry import se3
from planfit.scan.poses import pair_times, poses_at

TIMES = st.lists(st.integers(0, 400), min_size=1, max_size=25, unique=True)


@given(TIMES, TIMES, st.integers(0, 30))
def test_pairs_are_one_to_one_near_and_in_order(a, b, gap):
    a, b = np.array(a, dtype=float), np.array(b, dtype=float)
    mine, other = pair_times(a, b, gap)
    assert len(set(mine)) == len(mine) == len(set(other)) == len(other)
    assert np.all(np.abs(a[mine] - b[other]) <= gap)
    assert np.all(np.diff(mine) > 0)
    # The nearest pair of all is always kept.
    gaps = np.abs(a[:, None] - b[None])
    if gaps.min() <= gap:
        assert np.abs(a[mine] - b[other]).min() == gaps.min()


def test_a_frame_is_not_used_twice():
    mine, other = pair_times(np.array([0.0, 0.01, 1.0]), np.array([0.009, 1.001, 2.0]), 0.02)
    assert_array_equal(mine, [1, 2])
    assert_array_equal(other, [0, 1])


def test_order_of_the_other_list_does_not_matter():
    a, b = np.arange(10) / 30, np.arange(10) / 30 + 0.004
    order = np.random.default_rng(0).permutation(10)
    mine, other = pair_times(a, b[order], 0.01)
    assert_array_equal(mine, np.arange(10))
    assert_allclose(b[order][other] - a, 0.004)


def screw(t):
    """A camera that walks and turns at constant speed."""
    rotation = se3.exp_so3(np.array([0.1, 0.5, -0.2]) * t)
    return se3.make_transform(rotation, np.array([0.7, -0.1, 0.3]) * t)


def test_poses_between_poses():
    times = np.arange(0, 2, 0.05)
    poses = np.stack([screw(t) for t in times])
    at = np.array([0.0, 0.0123, 0.5, 1.037, 1.95])
    found, known = poses_at(times, poses, at, 0.02 + 1e-9)
    assert_array_equal(known, [True] * 5)
    assert_allclose(found, [screw(t) for t in at], atol=1e-12)


def test_poses_are_in_any_order():
    times = np.arange(0, 1, 0.05)
    order = np.random.default_rng(1).permutation(len(times))
    poses = np.stack([screw(t) for t in times[order]])
    found, _ = poses_at(times[order], poses, np.array([0.51]), 0.02)
    assert_allclose(found[0], screw(0.51), atol=1e-12)


def test_no_pose_is_made_up_across_a_gap():
    times = np.array([0.0, 0.05, 3.0])
    poses = np.stack([screw(t) for t in times])
    found, known = poses_at(times, poses, np.array([0.06, 1.5, 2.99, 4.0]), 0.02)
    assert_array_equal(known, [True, False, True, False])
    # Near a gap: the nearest pose itself.
    assert_allclose(found[0], screw(0.05))
    assert_allclose(found[2], screw(3.0))
    assert_allclose(found[[1, 3]], [np.eye(4)] * 2)


def test_a_single_pose():
    found, known = poses_at(np.array([5.0]), screw(1.0)[None], np.array([5.01, 6.0]), 0.02)
    assert_array_equal(known, [True, False])
    assert_allclose(found[0], screw(1.0))
