"""Squared distances of points and matches, some points at a time."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import make_world, nudged
from planfit.adjust.terms.groups import PairGroups, PlaneGroups
from planfit.geometry import se3
from planfit.lsq.robust import Loss, LossKind

LOSS = Loss(LossKind.CAUCHY, 2.0)


def gathered(groups, poses):
    """Of all points, in order: every point once."""
    parts = list(groups.squares(poses))
    idx = np.concatenate([np.arange(each.part.start, each.part.stop) for each in parts])
    assert np.array_equal(idx, np.arange(groups.start[-1]))
    return (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("in_sigmas", "information")
    )


@pytest.mark.parametrize("at_a_time", [7, 100_000])
def test_matches_apart(rng, monkeypatch, at_a_time):
    monkeypatch.setattr("planfit.geometry.se3.POINTS_AT_A_TIME", at_a_time)
    world = make_world(rng)
    m, poses = world.matches, nudged(rng, world.plan_from_cams, 1.0, 0.05)
    sigma_m, worth = rng.uniform(0.01, 0.1, m.n_matches), rng.uniform(1, 2, len(m.pairs))
    groups = PairGroups(m.points_a, m.points_b, sigma_m, m.start, m.pairs, worth, LOSS)
    in_sigmas, information = gathered(groups, poses)
    i, j = np.repeat(m.pairs, np.diff(m.start), axis=0).T
    # Distances in the world are those in the first camera.
    apart = se3.transform_each(poses[i], m.points_a) - se3.transform_each(poses[j], m.points_b)
    assert_allclose(in_sigmas, np.sum(apart**2, axis=1) / sigma_m**2, rtol=1e-9)
    assert_allclose(information, np.repeat(worth, np.diff(m.start)) / sigma_m**2, rtol=1e-12)


@pytest.mark.parametrize("at_a_time", [7, 100_000])
def test_points_off_their_planes_and_groups_without_points(rng, monkeypatch, at_a_time):
    monkeypatch.setattr("planfit.geometry.se3.POINTS_AT_A_TIME", at_a_time)
    poses = nudged(rng, np.tile(np.eye(4), (3, 1, 1)), 30.0, 1.0)
    start, pose_idx = np.array([0, 10, 10, 25]), np.array([2, 0, 1])
    points, worth = rng.normal(size=(25, 3)), np.array([1.0, 5.0, 2.0])
    normals = rng.normal(size=(3, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    planes = np.column_stack([normals, rng.normal(size=3)])
    groups = PlaneGroups(points, start, pose_idx, planes, worth, 0.05, LOSS)
    in_sigmas, information = gathered(groups, poses)
    group = np.repeat(np.arange(3), np.diff(start))
    there = se3.transform_each(poses[pose_idx[group]], points)
    off_m = np.sum(there * planes[group, :3], axis=1) + planes[group, 3]
    assert_allclose(in_sigmas, (off_m / 0.05) ** 2, rtol=1e-9)
    assert_allclose(information, worth[group] / 0.05**2, rtol=1e-12)
