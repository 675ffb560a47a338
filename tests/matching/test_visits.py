"""Visits: motions from matches, and pairs that stand or fall together."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import look, random_transforms
from planfit.geometry import se3
from planfit.matching import Matches, RelativePoses, group_visits, relative_poses_of
from planfit.scan.odometry import OdometryOptions, make_odometry


@pytest.mark.parametrize("at_a_time", [7, 100_000])
def test_the_motion_of_each_pair_is_the_weighted_rigid_fit(at_a_time, monkeypatch):
    monkeypatch.setattr("planfit.geometry.se3.POINTS_AT_A_TIME", at_a_time)
    rng = np.random.default_rng(0)
    pair = np.repeat([[0, 4], [1, 9], [2, 3]], [5, 30, 12], axis=0)
    b = rng.normal(size=(len(pair), 3))
    motions = random_transforms(rng, 3)
    a = np.concatenate([se3.transform(m, b[s]) for m, s in
                        zip(motions, (slice(0, 5), slice(5, 35), slice(35, 47)), strict=True)])  # fmt: skip
    a += 0.05 * rng.normal(size=a.shape)
    sigma = rng.uniform(0.01, 0.1, len(pair))
    matches = Matches.from_arrays(pair, a, b, sigma)
    found = relative_poses_of(matches)
    order = np.lexsort((pair[:, 1], pair[:, 0]))
    for k in range(3):
        own = order[matches.start[k] : matches.start[k + 1]]
        assert_allclose(
            found.a_from_b[k], se3.fit_rigid(b[own], a[own], 1 / sigma[own] ** 2), atol=1e-9
        )
    assert_array_equal(found.n_inliers, np.diff(matches.start))
    none = Matches.from_arrays(np.zeros((0, 2), int), np.zeros((0, 3)), np.zeros((0, 3)), 1.0)
    assert len(relative_poses_of(none)) == 0


def test_pairs_of_two_stretches_are_one_visit_where_they_agree():
    # Up and down a way of 10 m, a frame each 0.5 m.
    poses = np.stack(
        [look([x, 0, 1.5], 0) for x in [*np.arange(0, 10, 0.5), *np.arange(10, 0, -0.5)]]
    )
    odometry = make_odometry(poses, OdometryOptions())
    pairs = np.array([(4, 36), (5, 35), (6, 34), (16, 24), (4, 35), (5, 6)])
    motion = se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]]
    motion[4, 0, 3] += 4.0  # says otherwise of the same stretches
    found = RelativePoses(pairs, motion, np.full(6, 20))
    visit = group_visits(found, poses, odometry)
    assert visit[0] == visit[1] == visit[2]
    assert len({int(visit[0]), int(visit[3]), int(visit[4])}) == 3
    assert visit[5] == -1  # neighbours on the walk are no visit
