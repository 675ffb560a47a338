"""Motions by surfaces against the recorded ones: jumps that all show, and false motions that agree."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planfit.geometry import se3
from planfit.matching import SurfacePairs
from planfit.matching.surfaces.witnesses import is_witnessed
from planfit.matching.types import RelativePoses
from planfit.scan.odometry import OdometryOptions, make_odometry

ALL = np.diag([4e4, 4e4, 4e4, 1e4, 1e4, 1e4])
FREE_ALONG = np.diag([4e4, 4e4, 4e4, 0.0, 1e4, 1e4])
JUMP_M = np.array([0.9, 0.0, 0.0])


def walk(n=7):
    """Straight along x, half a metre a step."""
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = 0.5 * np.arange(n)
    return poses


def motions(poses, pairs):
    i, j = np.asarray(pairs).T
    return se3.inverse(poses[i]) @ poses[j]


def surfaces(poses, pairs, information=ALL):
    n = len(pairs)
    return SurfacePairs(
        np.asarray(pairs), motions(poses, pairs), np.tile(information, (n, 1, 1)), np.ones(n),
        np.zeros((n, 6, 7)), np.ones(n),
    )  # fmt: skip


def matched(poses, pairs):
    pairs = np.asarray(pairs, int).reshape(-1, 2)
    return RelativePoses(pairs, motions(poses, pairs), np.full(len(pairs), 100))


def witnessed(found, by_keypoints, recorded):
    odometry = make_odometry(recorded, OdometryOptions())
    return is_witnessed(found, by_keypoints, recorded, odometry)


def jumped(at, by_m=JUMP_M):
    """Recorded poses of the walk by a tracker that jumps in the step to frame `at`."""
    poses = walk()
    poses[at:, :3, 3] += by_m
    return poses


def test_a_jump_that_all_pairs_over_the_step_show_is_believed():
    pairs = [[1, 2], [1, 3], [2, 3], [2, 4], [3, 4]]
    assert witnessed(surfaces(walk(), pairs), matched(walk(), []), jumped(3)).all()


def test_a_jump_that_keypoints_beside_it_close_the_triangle_for_is_believed():
    found = surfaces(walk(), [[1, 3], [2, 3]])
    alone = matched(walk(), [])
    beside = matched(walk(), [[1, 2]])
    assert not witnessed(found, alone, jumped(3)).any()
    assert witnessed(found, beside, jumped(3)).all()


@pytest.mark.parametrize("by", ["surfaces", "keypoints"])
def test_two_false_motions_to_one_frame_do_not_witness_each_other_against_all_others(by):
    """Both take frame 3 to be elsewhere, alike; a third one over the same steps would show the jump."""
    pairs, others = [[1, 3], [2, 3]], [[1, 2], [2, 4], [1, 4]]
    false = surfaces(jumped(3), pairs)
    if by == "surfaces":
        found = false.joined(surfaces(walk(), others))
        told = witnessed(found, matched(walk(), []), walk())
    else:
        found = false
        told = witnessed(found, matched(walk(), others), walk())
    is_false = np.isin(found.pairs @ [10, 1], [13, 23])
    assert_array_equal(told, ~is_false)


def test_those_that_leave_the_jump_free_do_not_rule_it_out():
    """A corridor's surfaces agree with any motion along it, and so with a jump that keypoints do not see."""
    found = surfaces(walk(), [[1, 3], [2, 3]]).joined(
        surfaces(walk(), [[2, 4], [1, 4]], FREE_ALONG)
    )
    beside = matched(walk(), [[1, 2]])
    assert witnessed(found, beside, jumped(3)).all()


def test_a_motion_off_by_a_quarter_turn_is_never_believed_against_the_recorded_one():
    recorded = walk()
    recorded[3:, :3, :3] = se3.exp_so3(np.array([0.0, 0.0, np.pi / 2]))
    found = surfaces(walk(), [[1, 3], [2, 3]])
    assert not witnessed(found, matched(walk(), [[1, 2]]), recorded).any()
