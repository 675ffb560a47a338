"""A noisy tracker's poses, fused with measured motions."""

from unittest.mock import patch

import numpy as np
import pytest
from measured_walk import measure, tracked, walk

from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.tracking import TrackingOptions, judge, judge_tracking
from planfit.tracking.motions import MeasuredMotions
from planfit.tracking.trajectory import fuse

NOISY_RAD, NOISY_M = np.deg2rad(1.0), 0.12


@pytest.fixture(scope="module")
def noisy():
    rng = np.random.default_rng(5)
    true = walk(rng, 60)
    return true, tracked(true, rng, NOISY_RAD, NOISY_M), measure(true, rng)


def drift_m(poses, true, gap=20):
    """RMS error of the motion over so many frames."""
    motions = [se3.inverse(p[:-gap]) @ p[gap:] for p in (poses, true)]
    return np.sqrt(np.mean(np.sum((motions[0] - motions[1])[:, :3, 3] ** 2, axis=1)))


def judged(poses, motions, **options):
    return judge_tracking(poses, motions, "recorded", OdometryOptions(), TrackingOptions(**options))


def test_fused_poses_drift_less_and_begin_where_recorded(noisy):
    true, poses, motions = noisy
    odometry = make_odometry(poses, OdometryOptions(NOISY_M, 0.0, np.rad2deg(NOISY_RAD), 0.0))
    fused = fuse(poses, odometry, motions)
    assert drift_m(fused, true) < 0.4 * drift_m(poses, true)
    np.testing.assert_allclose(fused[0], poses[0], atol=1e-3)


def test_the_covariance_of_a_motion_is_heeded_in_its_own_axes(noisy):
    """Motions that know nothing of one direction, in the first frame's axes, leave it to the tracker."""
    true, poses, motions = noisy
    sigma = np.array([1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e3])
    blind = MeasuredMotions(
        motions.pairs,
        se3.inverse(true[motions.pairs[:, 0]]) @ true[motions.pairs[:, 1]],
        np.tile(np.diag(sigma**2), (len(motions), 1, 1)),
        motions.n_inliers,
    )
    one_step = blind[(blind.pairs == (10, 11)).all(axis=1)]
    two = np.stack([poses[10], poses[11]])
    one_step = MeasuredMotions(np.array([[0, 1]]), *(getattr(one_step, n) for n in (
        "a_from_b", "covariance", "n_inliers")))  # fmt: skip
    odometry = make_odometry(two, OdometryOptions(0.5, 0.0, 10.0, 0.0))
    step = se3.inverse(fuse(two, odometry, one_step)[0]) @ fuse(two, odometry, one_step)[1]
    expected, recorded = (se3.inverse(p[10]) @ p[11] for p in (true, poses))
    np.testing.assert_allclose(step[:2, 3], expected[:2, 3], atol=2e-3)
    assert abs(step[2, 3] - recorded[2, 3]) < 0.02


def test_only_trackers_that_err_much_more_than_usual_are_fused(noisy):
    true, poses, motions = noisy
    tracking = judged(poses, motions)
    assert max(tracking.sigma_factors) > 3
    assert drift_m(tracking.world_from_cams, true) < 0.5 * drift_m(poses, true)
    steps = se3.inverse(tracking.world_from_cams[:-1]) @ tracking.world_from_cams[1:]
    np.testing.assert_allclose(tracking.odometry.cam_from_next, steps, atol=1e-9)
    assert np.array_equal(tracking.recorded_world_from_cams, poses)
    with patch.object(judge, "NOTED_FACTOR", 99.0):
        assert np.array_equal(judged(poses, motions).world_from_cams, poses)
    usual = tracked(true, np.random.default_rng(1))
    assert np.array_equal(judged(usual, motions).world_from_cams, usual)
