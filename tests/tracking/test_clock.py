"""The time between images and poses, found from measured motions, on walks whose delay is known."""

import numpy as np
import pytest
from measured_walk import displaced, measure
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions
from planfit.tracking import TrackingOptions, judge_tracking
from planfit.tracking.trajectory import frame_times, read_trajectory

RATE_HZ = 30.0
SIGMA_RAD, SIGMA_M = np.deg2rad(0.02), 0.0005
"""Of the recorded poses, each for itself: a phone's tracker is smooth."""


class Handheld:
    """A continuous walk: a metre a second, looking about, swaying with each step."""

    def __init__(self, rng, duration_s):
        knots = np.arange(-1.0, duration_s + 1.5, 0.25)
        n = len(knots)
        yaw = np.cumsum(rng.normal(0, np.deg2rad(6), n))
        turn = np.column_stack(
            [rng.normal(0, np.deg2rad(2), n), yaw, rng.normal(0, np.deg2rad(1.5), n)]
        )
        heading = np.column_stack([np.sin(yaw), 0 * yaw, np.cos(yaw)])
        place = np.cumsum(0.25 * heading, axis=0) + rng.normal(0, 0.02, (n, 3))
        self._turn, self._place = CubicSpline(knots, turn), CubicSpline(knots, place)

    def at(self, times_s):
        """True poses (k, 4, 4)."""
        turn = self._turn(times_s)
        yaw, tilt = turn * [0, 1, 0], turn * [1, 0, 1]
        return se3.make_transform(se3.exp_so3(yaw) @ se3.exp_so3(tilt), self._place(times_s))


def recorded(true, rng):
    """As a tracker records them."""
    sigma = np.repeat([SIGMA_RAD, SIGMA_M], 3)
    return se3.retract(true, rng.normal(size=(len(true), 6)) * sigma)


def scanned(seed, late_s, n=300, rate_hz=RATE_HZ):
    """True poses, recorded ones, motions, times: images are taken `late_s` after their poses."""
    rng = np.random.default_rng(seed)
    times = np.arange(n) / rate_hz
    walk = Handheld(rng, times[-1])
    true = walk.at(times + late_s)
    return true, recorded(walk.at(times), rng), measure(true, rng), times


def judged(poses, motions, times, convention="recorded", **chosen):
    options = OdometryOptions(), TrackingOptions(**chosen)
    return judge_tracking("scan", poses, motions, convention, *options, None, times)


def errors_m(poses, true):
    """Errors of the steps over a second: what a constant transform of the world leaves alone."""
    k = int(RATE_HZ)
    steps, expected = (se3.inverse(p[:-k]) @ p[k:] for p in (poses, true))
    return np.linalg.norm((steps - expected)[:, :3, 3], axis=1)


@pytest.mark.parametrize("late_s", [0.03, -0.03, 0.1, -0.1, 0.015])
def test_the_offset_is_found_and_undone(late_s):
    true, poses, motions, times = scanned(0, late_s)
    tracking = judged(poses, motions, times)
    clock = tracking.clock
    assert clock.offset_s == pytest.approx(late_s, abs=max(0.1 * abs(late_s), 3 * clock.sigma_s))
    assert clock.sigma_s < 0.005
    rms = [
        np.sqrt(np.mean(errors_m(p, true) ** 2))
        for p in (tracking.world_from_cams, recorded(true, np.random.default_rng(1)))
    ]
    assert rms[0] < 1.25 * rms[1] + 0.005
    which = "later" if late_s > 0 else "earlier"
    size = f"{1000 * abs(clock.offset_s):.0f} ms"
    assert f"images are {size} {which} than their poses: poses were read" in tracking.warnings[0]
    assert tracking.breaks == ()
