"""Distances between matched points."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import make_matches, make_world
from planfit.evaluation import match_distances, median_match_distance


def test_match_distances(rng):
    world = make_world(rng)
    assert_allclose(match_distances(world.matches, world.plan_from_cams), 0, atol=1e-12)
    poses = world.plan_from_cams.copy()
    poses[3, 0, 3] += 0.5
    distances = match_distances(world.matches, poses)
    pair = np.repeat(world.matches.pairs, np.diff(world.matches.start), axis=0)
    expected = np.where((pair == 3).any(axis=1), 0.5, 0.0)
    assert_allclose(distances, expected, atol=1e-9)
    median = median_match_distance(world.matches, poses)
    assert median == pytest.approx(np.median(expected), abs=1e-9)


def test_no_matches_have_no_median(rng):
    world = make_world(rng)
    none = make_matches(world.plan_from_cams, [], np.zeros((0, 3)))
    assert np.isnan(median_match_distance(none, world.plan_from_cams))
