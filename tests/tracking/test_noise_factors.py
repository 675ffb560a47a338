"""How sure measured motions are, and how much more than usual a tracker errs."""

import numpy as np
import pytest
from measured_walk import displaced, measure, tracked, walk
from numpy.testing import assert_allclose

from builders import with_constants
from planfit.geometry import se3
from planfit.matching import verify
from planfit.matching.relative_motions import VerifiedPairs
from planfit.matching.types import RelativePoses
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.tracking.motions import (
    EFFECTIVE_MATCHES,
    departures,
    expected_covariance,
    measured_motions,
    noise_factors,
    squared_sigmas,
)

PLAIN = OdometryOptions(0.01, 0.0, 0.1, 0.0)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_covariance_is_that_of_the_fit_of_so_many_points(rng):
    """The slow twin: the spread of motions fitted to the points with fresh noise."""
    n, sigma = int(EFFECTIVE_MATCHES), 0.02
    motion = se3.make_transform(se3.exp_so3(np.array([0.1, -0.2, 0.3])), np.array([0.3, 0.1, 0.0]))
    points_b = rng.uniform([-1, -1, 2], [1, 1, 4], (n, 3))
    points_a = se3.transform(motion, points_b)
    verified = VerifiedPairs(
        RelativePoses(np.array([[0, 1]]), motion[None], np.array([n])), [points_a], [points_b]
    )
    with with_constants(verify, sigma_base_m=sigma / np.sqrt(2), sigma_per_m=0.0):
        found = measured_motions(verified).covariance[0]
    fits = np.stack(
        [se3.fit_rigid(points_b, points_a + rng.normal(0, sigma, (n, 3))) for _ in range(4000)]
    )
    spread = np.cov(se3.difference(fits, motion).T)
    floor = np.repeat([np.deg2rad(0.1) ** 2, 0.01**2], 3)
    assert_allclose(found - np.diag(floor), spread, atol=0.08 * np.abs(spread).max())


def test_more_matches_than_are_worth_it_make_no_surer_motion(rng):
    def sigma_of(n):
        points = rng.uniform([-1, -1, 2], [1, 1, 4], (n, 3))
        relative = RelativePoses(np.array([[0, 1]]), np.eye(4)[None], np.array([n]))
        motions = measured_motions(VerifiedPairs(relative, [points], [points]))
        return np.sqrt(np.trace(motions.covariance[0]))

    assert sigma_of(2000) == pytest.approx(sigma_of(200), rel=0.1)
    assert sigma_of(8) > 1.2 * sigma_of(200)


def test_departures_are_as_large_as_expected(rng):
    true = walk(rng, 300)
    poses, motions = tracked(true, rng), measure(true, rng)
    covariance = expected_covariance(motions, make_odometry(poses, PLAIN))
    squared = squared_sigmas(departures(motions, poses), covariance)
    assert np.mean(squared) == pytest.approx(6.0, rel=0.15)


@pytest.mark.parametrize("factor", [1.0, 3.0, 6.0])
def test_factors_are_those_of_the_tracker(rng, factor):
    true = walk(rng, 150)
    motions = measure(true, rng)
    poses = tracked(true, rng, factor * np.deg2rad(0.1), factor * 0.01)
    found = noise_factors(poses, make_odometry(poses, PLAIN), motions)
    assert_allclose(found, factor, rtol=0.3)


def test_rotation_and_translation_have_factors_of_their_own(rng):
    true = walk(rng, 150)
    motions = measure(true, rng)
    poses = tracked(true, rng, 5 * np.deg2rad(0.1), 0.01)
    rotation, translation = noise_factors(poses, make_odometry(poses, PLAIN), motions)
    assert rotation > 3.5
    assert translation < 1.5


def test_jumps_are_no_noise(rng):
    true = walk(rng, 100)
    poses, motions = tracked(true, rng), measure(true, rng)
    for first in (20, 50, 80):
        poses = displaced(poses, first, len(poses) - 1, 4.0, 40.0, rng)
    assert max(noise_factors(poses, make_odometry(poses, PLAIN), motions)) < 1.5


def test_few_motions_tell_nothing(rng):
    true = walk(rng, 8)
    poses, motions = tracked(true, rng, 0.1, 0.5), measure(true, rng)
    assert noise_factors(poses, make_odometry(poses, PLAIN), motions) == (1.0, 1.0)
