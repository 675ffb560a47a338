"""The time between images and poses, found from measured motions, on walks whose delay is known."""

from unittest.mock import patch

import numpy as np
import pytest
from measured_walk import displaced, measure
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

from planfit.findings import PoseKind
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions
from planfit.tracking import TrackingOptions, judge, judge_tracking
from planfit.tracking.trajectory import frame_times, interpolate_trajectory

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


def scanned(seed, late_s, n=180, rate_hz=RATE_HZ):
    """True poses, recorded ones, motions, times: images are taken `late_s` after their poses."""
    rng = np.random.default_rng(seed)
    times = np.arange(n) / rate_hz
    walk = Handheld(rng, times[-1])
    true = walk.at(times + late_s)
    return true, recorded(walk.at(times), rng), measure(true, rng), times


def judged(poses, motions, times, convention="recorded", **chosen):
    options = OdometryOptions(), TrackingOptions(**chosen)
    return judge_tracking(poses, motions, convention, *options, None, times)


def errors_m(poses, true):
    """Errors of the steps over a second: what a constant transform of the world leaves alone."""
    k = int(RATE_HZ)
    steps, expected = (se3.inverse(p[:-k]) @ p[k:] for p in (poses, true))
    return np.linalg.norm((steps - expected)[:, :3, 3], axis=1)


@pytest.mark.parametrize("late_s", [0.03, -0.03, 0.1, -0.1])
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
    assert tracking.findings[0].kind is PoseKind.CLOCK_CORRECTED
    assert tracking.findings[0].facts["offset_s"] == clock.offset_s
    assert tracking.breaks == ()


@pytest.mark.parametrize(("late_s", "rate"), [(0.03, 0.005), (-0.05, -0.004), (0.0, 0.003)])
def test_clocks_that_run_apart_are_found_and_undone(late_s, rate):
    rng = np.random.default_rng(9)
    times = np.arange(420) / RATE_HZ
    walk = Handheld(rng, times[-1] + 1.0)
    true = walk.at(times + late_s + rate * (times - times[-1] / 2))
    poses, motions = recorded(walk.at(times), rng), measure(true, rng)
    tracking = judged(poses, motions, times)
    assert tracking.clock.rate == pytest.approx(rate, abs=5e-4)
    assert tracking.clock.offset_s == pytest.approx(late_s, abs=0.005)
    assert np.sqrt(np.mean(errors_m(tracking.world_from_cams, true) ** 2)) < 0.01
    assert f"{1000 * abs(tracking.clock.rate):.2g} ms" in tracking.findings[0].words


@pytest.mark.parametrize("late_s", [0.0, 0.05])
def test_clocks_that_run_alike_have_no_rate(late_s):
    for seed in range(3):
        _, poses, motions, times = scanned(20 + seed, late_s, n=420)
        clock = judged(poses, motions, times).clock
        assert (clock is None) == (late_s == 0.0)
        assert clock is None or clock.rate == 0.0


def test_without_a_delay_poses_stay_bit_for_bit():
    _, poses, motions, times = scanned(1, 0.0)
    tracking = judged(poses, motions, times)
    assert tracking.clock is None
    assert np.array_equal(tracking.world_from_cams, poses)


def test_a_noisy_tracker_has_no_delay():
    """Poses between two frames are means of two, whose noise is less: that alone is no delay."""
    true, _, motions, times = scanned(2, 0.0)
    rng = np.random.default_rng(3)
    sigma = np.repeat([np.deg2rad(0.6), 0.02], 3)
    poses = se3.retract(true, rng.normal(size=(len(true), 6)) * sigma)
    with patch.object(judge, "NOTED_FACTOR", 100.0):
        assert judged(poses, motions, times).clock is None


def test_frames_without_times_have_an_offset_in_frames():
    _, poses, motions, _ = scanned(3, 0.05)
    tracking = judged(poses, motions, 4.0 * np.arange(len(poses)))
    assert tracking.clock.intervals == pytest.approx(1.5, abs=0.15)
    assert tracking.clock.offset_s is None
    assert tracking.findings[0].facts["offset_s"] is None


def test_poses_far_apart_are_not_read_but_the_offset_is_named(monkeypatch):
    _, poses, motions, times = scanned(0, 0.02)
    monkeypatch.setattr("planfit.tracking.clock.MAX_STEP_M", 0.01)  # this walker's steps are 0.03 m
    tracking = judged(poses, motions, times)
    assert tracking.clock is not None
    assert not tracking.clock.is_read
    assert tracking.findings[0].kind is PoseKind.CLOCK_OFF


def test_who_stands_still_tells_no_offset():
    rng = np.random.default_rng(4)
    true = np.tile(np.eye(4), (180, 1, 1))
    poses = recorded(true, rng)
    tracking = judged(poses, measure(true, rng), np.arange(180) / RATE_HZ)
    assert tracking.clock is None
    assert np.array_equal(tracking.world_from_cams, poses)


def test_nothing_is_read_across_a_jump():
    true, poses, motions, times = scanned(5, 0.05)
    poses = displaced(poses, 90, len(poses) - 1, 2.0, 30.0, np.random.default_rng(6))
    tracking = judged(poses, motions, times)
    assert tracking.clock.offset_s == pytest.approx(0.05, abs=0.005)
    (found,) = tracking.breaks
    assert found.kind == "jump"
    assert found.first_frame == 89
    assert np.median(errors_m(tracking.world_from_cams, true)) < 0.01
    assert errors_m(tracking.world_from_cams, true).max() < 0.1


@pytest.mark.parametrize("frames", [1, -1, 2, -2])
def test_whole_frames_of_a_dense_scan_are_a_clock(frames):
    """At 30 Hz a clock that is 33 or 67 ms off is nothing that asks for a flag."""
    _, poses, motions, times = scanned(7, frames / RATE_HZ)
    tracking = judged(poses, motions, times)
    assert tracking.convention == "recorded"
    assert tracking.clock.intervals == pytest.approx(frames, abs=0.1)


@pytest.mark.parametrize(("name", "frames"), [("one_frame_late", 1), ("two_frames_early", -2)])
def test_whole_frames_that_are_far_apart_in_time_stay_a_convention(name, frames):
    # A pose that was recorded a frame before its image is that of the image before: late.
    _, poses, motions, times = scanned(7, frames / RATE_HZ)
    slow_times = 20 * times  # two frames a second and less: no clock is off by that
    tracking = judged(poses, motions, slow_times, "auto")
    assert tracking.convention == name
    assert tracking.clock is None


def test_a_delay_hides_no_convention():
    true, poses, motions, times = scanned(8, 0.05)
    tracking = judged(se3.inverse(poses), motions, times, "auto")
    assert tracking.convention == "camera_from_world"
    assert tracking.clock.offset_s == pytest.approx(0.05, abs=0.005)
    assert np.median(errors_m(tracking.world_from_cams, true)) < 0.01


def test_the_search_can_be_left_out():
    _, poses, motions, times = scanned(0, 0.01)
    tracking = judged(poses, motions, times, clock_is_sought=False)
    assert tracking.clock is None
    assert tracking.breaks == ()


def test_poses_are_read_within_tracked_runs_alone():
    """Six frames a metre apart, the trajectory cut after the third: both sides go on as they went."""
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = [0, 1, 2, 10, 11, 12]
    is_whole = np.array([True, True, False, True, True])
    later = interpolate_trajectory(poses, np.arange(6.0), 0.5, is_whole)
    earlier = interpolate_trajectory(poses, np.arange(6.0), -0.5, is_whole)
    assert_allclose(later[:, 0, 3], [0.5, 1.5, 2.5, 10.5, 11.5, 12.5])
    assert_allclose(earlier[:, 0, 3], [-0.5, 0.5, 1.5, 9.5, 10.5, 11.5])


def test_times_that_do_not_grow_are_frame_numbers():
    assert frame_times(np.array([0.1, 0.2, 0.2, 0.3])).interval_s is None
    assert frame_times(np.array([0.1, 0.2, 0.3])).interval_s == pytest.approx(0.1)
    assert_allclose(frame_times(np.array([4.0, 8.0, 16.0])).intervals, [0, 2 / 3, 2])
