"""Motions of neighbouring frames between which a repeating pattern and the recorded poses disagree."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from painted_rooms import POSTER, ROOM, grids_of

from builders import look
from planfit.geometry import se3
from planfit.matching import MatchingOptions, NeighbourMotions, without_misled
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


def neighbours(poses, misled=True):
    """Pairs of a walk along a wall; of one the matches are those of the picture beside."""
    rng = np.random.default_rng(2)
    points = POSTER + rng.uniform(-0.4, 0.4, (40, 3)) * (0, 1, 1)
    pairs = np.column_stack([np.arange(N - 1), np.arange(1, N)])
    motions, points_a, points_b = [], [], []
    for k, (i, j) in enumerate(pairs):
        seen = poses[j].copy()
        if misled and k == MISLED:
            seen[1, 3] += PATTERN_M
        motions.append(se3.inverse(poses[i]) @ seen)
        points_a.append(se3.transform(se3.inverse(poses[i]), points))
        points_b.append(se3.transform(se3.inverse(seen), points))
    relative_poses = RelativePoses(pairs, np.stack(motions), np.full(len(pairs), 40))
    grids = grids_of(*[(pose, *ROOM, 1) for pose in poses])
    keypoints = ScanKeypoints([], grids, lambda *_: np.zeros((0, 2), dtype=int), None, "")
    return NeighbourMotions(keypoints, pairs, VerifiedPairs(relative_poses, points_a, points_b))


def kept(known, recorded):
    found = without_misled(
        known, recorded, make_odometry(recorded, OdometryOptions()), MatchingOptions()
    )
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
    known = neighbours(poses, misled=False)
    assert kept(known, jumped).all()
    assert kept(known, poses).all()
