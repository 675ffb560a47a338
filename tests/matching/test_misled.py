"""Motions of neighbouring frames between which a repeating pattern and the recorded poses disagree."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from painted_rooms import POSTER, ROOM, grids_of

from builders import look
from planfit.geometry import se3
from planfit.matching import NeighbourMotions, visits, without_misled
from planfit.matching.relative_motions import VerifiedPairs
from planfit.matching.tentative import ScanKeypoints
from planfit.matching.types import RelativePoses
from planfit.scan.odometry import OdometryOptions, make_odometry

N = 8
PATTERN_M = 1.2
"""From a picture to the next of its kind, along the wall."""
MISLED = 3
"""Index of the pair that was."""


def walk():
    return np.stack([look([2.0, 1.2 + 0.1 * k, 1.5], 0.0) for k in range(N)])


def neighbours(poses, is_misled=True):
    """Pairs of a walk along a wall; of one the matches are those of the picture beside."""
    rng = np.random.default_rng(2)
    points = POSTER + rng.uniform(-0.4, 0.4, (40, 3)) * (0, 1, 1)
    pairs = np.column_stack([np.arange(N - 1), np.arange(1, N)])
    motions, points_a, points_b = [], [], []
    for k, (i, j) in enumerate(pairs):
        seen = poses[j].copy()
        if is_misled and k == MISLED:
            seen[1, 3] += PATTERN_M
        motions.append(se3.inverse(poses[i]) @ seen)
        points_a.append(se3.transform(se3.inverse(poses[i]), points))
        points_b.append(se3.transform(se3.inverse(seen), points))
    relative_poses = RelativePoses(pairs, np.stack(motions), np.full(len(pairs), 40))
    grids = grids_of(*[(pose, *ROOM, 1) for pose in poses])
    keypoints = ScanKeypoints([], grids, lambda *_: np.zeros((0, 2), dtype=int), None, "")
    return NeighbourMotions(keypoints, pairs, VerifiedPairs(relative_poses, points_a, points_b))


def kept(known, recorded):
    found = without_misled(known, recorded, make_odometry(recorded, OdometryOptions()))
    assert found.tried is known.tried
    return np.isin(known.tried[:, 0], found.verified.relative_poses.pairs[:, 0])


def test_a_motion_from_a_picture_to_the_next_is_left_out():
    poses = walk()
    assert_array_equal(kept(neighbours(poses), poses), np.arange(N - 1) != MISLED)


@pytest.mark.parametrize("jump_m", [0.8, 3.0])
def test_where_the_tracker_jumped_the_measured_motion_stays(jump_m):
    poses = walk()
    jumped = poses.copy()
    jumped[MISLED + 1 :, :3, 3] += (0.0, jump_m, 0.0)
    known = neighbours(poses, is_misled=False)
    assert kept(known, jumped).all()
    assert kept(known, poses).all()


def test_where_the_recorded_views_share_nothing_a_jump_is_told_by_its_long_step():
    poses = walk()
    turned = poses.copy()
    # The tracker turned back to the other wall at once, where the camera went on: a jump.
    about = se3.make_transform(np.diag([-1.0, -1.0, 1.0]), np.array([4.0, 3.2, 0.0]))
    turned[MISLED + 1 :] = about @ poses[MISLED + 1 :]
    assert kept(neighbours(poses, is_misled=False), turned).all()


def test_a_turn_in_usual_steps_is_no_jump_though_the_same_picture_hangs_on_the_next_wall():
    # From the wall at x = 5 to that at y = 4 by 15 deg a step; matches say that nobody turned.
    poses = np.stack([look([2.5, 2.0, 1.5], 15.0 * k) for k in range(N)])
    known = neighbours(poses, is_misled=False)
    relative_poses = known.verified.relative_poses
    pairs = np.array([[0, 6], [1, 7]])
    still = np.tile(np.eye(4), (2, 1, 1))
    more = RelativePoses(pairs, still, np.array([40, 40]))
    points = [known.verified.points_a[0]] * 2
    known = replace(known, verified=known.verified.joined(VerifiedPairs(more, points, points)))
    found = without_misled(known, poses, make_odometry(poses, OdometryOptions()))
    assert_array_equal(found.verified.relative_poses.pairs, relative_poses.pairs)


def test_of_a_long_walk_some_of_the_pairs_that_agree_say_what_is_usual(monkeypatch):
    poses = walk()
    every = kept(neighbours(poses), poses)
    asked = []
    whole = visits.compare

    def compare(relative_poses, *rest):
        asked.append(len(relative_poses))
        return whole(relative_poses, *rest)

    monkeypatch.setattr(visits, "compare", compare)
    monkeypatch.setattr(visits, "MAX_USUAL", 3)
    assert_array_equal(kept(neighbours(poses), poses), every)
    assert asked == [4, 4]  # three of the six that agree, and the one that does not
