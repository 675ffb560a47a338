"""Time between images and poses: the offset that makes recorded motions explain the measured ones best.

Temporal calibration (Furgale, Rehder and Siegwart 2013; Qin and Shen 2018) in one dimension: the recorded
trajectory is read at the frames' times plus an offset, and compared with motions from images alone. Where
clocks run apart, as where times are counted at a nominal rate, the offset grows with time.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import require_positive
from planfit.findings import Finding, PoseKind
from planfit.geometry.se3 import Poses
from planfit.priors import CLEAR_ODDS, CLOCK_RATE_SHARE, SURE_SIGMAS
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.tracking.motions import (
    FREEDOM,
    MeasuredMotions,
    departures,
    expected_covariance,
    noise_factors,
)
from planfit.tracking.trajectory import FrameTimes, interpolate_trajectory, joined_frames

GRID = 0.25
"""Offsets tried, in frame intervals; half an interval is a whole number of them."""
HALF = round(0.5 / GRID)
"""Of them, in half an interval."""
RATE_GRID = GRID / 4
"""Between the rates that are tried, in frame intervals at the ends of the walk."""
MIN_MOTIONS, MAX_MOTIONS = 30, 2000
"""Fewer motions tell no offset; more do not tell it better, and are thinned."""
MIN_BLOCKS, MAX_BLOCKS, BLOCK_FRAMES = 6, 30, 8
"""Stretches of the walk, as independent witnesses: motions that share frames share their errors. So many at
least and at most, and frames in each at least."""
MIN_INTERVALS, MIN_S = 0.05, 0.002
"""Smaller offsets are left alone: they move no pose by more than trackers err."""
MAX_STEP_M = 0.25
"""Between frames that are usually further apart, poses are not read: nobody walks straight for so long. On
ConSLAM (0.6 m, half a frame late) the offset is found, but steps read err by 0.50 m, as recorded by 0.42."""
MAX_SOUGHT_FRAMES = 2.5
"""Largest time between an image and its pose that is sought, in intervals between frames, where
`TrackingOptions.clock_max_s` is less: for scans with few frames a second or without times."""
MIN_SIGMAS = SURE_SIGMAS.value
"""A time between images and poses is believed from this many standard deviations on."""
MAX_INTERVALS = 15.0
"""Offsets further off are not searched, however many frames a second there are."""
INTERPOLATION_SIGMA = 0.03
"""Frame intervals. Poses between frames lie on chords of the way. Where it bends between two frames, the
best offset is drawn to whole frames in all stretches alike: 0.90 was found as 0.97 of a walk with corners."""


@dataclass(frozen=True)
class TrackingOptions:
    """When recorded motion is not believed, and what takes its place."""

    is_judged: bool = True
    """Whether the recorded motion is compared with motions that neighbouring images and their depth give."""
    mend: bool = True
    """Whether steps that are contradicted are corrected; otherwise they stay as recorded."""
    clock_is_sought: bool = True
    """Whether a constant time between images and poses is sought, and poses are read at the images' times."""
    clock_max_s: float = 0.2
    """Largest time between an image and its pose that is sought, s; at least two and a half intervals
    between frames."""

    def __post_init__(self) -> None:
        require_positive(self, "clock_max_s")


@dataclass(frozen=True)
class ClockOffset:
    """How much later than their poses images were taken."""

    intervals: float
    """In frame intervals, half way; negative where images are earlier."""
    sigma_intervals: float
    """Standard deviation, from how much stretches of the walk disagree, and of what interpolation hides."""
    interval_s: float | None
    """s; None where the scan has frame numbers instead of times."""
    is_read: bool
    """Whether poses were read from the trajectory at the images' times. They were not where frames are too
    far apart: motions read between them explain the images no better."""
    rate: float = 0.0
    """By which share of the time images get later than their poses; 0 where the clocks run alike."""

    def offsets(self, times: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """At each of the frames' times, all in frame intervals."""
        return self.intervals + self.rate * (times - _middle(times))

    @property
    def offset_s(self) -> float | None:
        """s; None where the scan has frame numbers."""
        return None if self.interval_s is None else self.intervals * self.interval_s

    @property
    def sigma_s(self) -> float | None:
        """Standard deviation, s; None where the scan has frame numbers."""
        return None if self.interval_s is None else self.sigma_intervals * self.interval_s

    def is_whole(self, frames: int) -> bool:
        """Whether it is as good as so many whole frame intervals."""
        return abs(self.intervals - frames) < max(
            MIN_INTERVALS, min(3 * self.sigma_intervals, 0.15)
        )

    @property
    def finding(self) -> Finding:
        """For the user."""
        kind = PoseKind.CLOCK_CORRECTED if self.is_read else PoseKind.CLOCK_OFF
        facts = {"offset_s": self.offset_s, "offset_frames": self.intervals, "rate": self.rate}
        return Finding(kind, facts)


@dataclass(frozen=True)
class _Costs:
    """Robust costs of the measured motions of each stretch, at each offset tried."""

    offsets: Float[np.ndarray, " g"]
    by_block: Float[np.ndarray, "b g"]
    since_middle: Float[np.ndarray, " b"]
    """Times of the stretches since the middle of the walk, frame intervals."""
    frames_per_motion: float
    """Motions that share frames share their errors: they are worth no more than there are frames."""

    def at_rate(self, rate: float) -> "_Costs | None":
        """Of offsets half way, where they grow at a rate; None where the search does not reach so far."""
        grown = rate * self.since_middle
        cut = int(np.ceil(np.abs(grown).max() / GRID))
        if len(self.offsets) < 2 * (cut + 2 * HALF) + 1:
            return None
        offsets = self.offsets[cut : len(self.offsets) - cut]
        rows = zip(grown, self.by_block, strict=True)
        by_block = [np.interp(offsets + more, self.offsets, row) for more, row in rows]
        return replace(self, offsets=offsets, by_block=np.stack(by_block))

    def apart(self) -> "tuple[float, _Costs]":
        """The rate at which the clocks run apart, 0 where none is clearly likelier, and the costs at it."""
        ends = float(np.abs(self.since_middle).max())
        most = int(CLOCK_RATE_SHARE.value * ends / RATE_GRID)
        rates = np.arange(-most, most + 1) * RATE_GRID / max(ends, 1.0)
        tried = {float(rate): at for rate in rates if (at := self.at_rate(float(rate))) is not None}
        lowest = {}
        for rate, at in tried.items():
            averaged = at.averaged()
            lowest[rate] = averaged[:, np.argmin(averaged.sum(axis=0))]
        best = min(lowest, key=lambda rate: lowest[rate].sum(), default=0.0)
        if best == 0.0:
            return 0.0, self
        falls = lowest[0.0] - lowest[best]
        is_clear = falls.sum() * self.frames_per_motion > np.log(CLEAR_ODDS.value)
        is_apart = is_clear and _significance(falls) > MIN_SIGMAS
        return (best, tried[best]) if is_apart else (0.0, self)

    def averaged(self) -> Float[np.ndarray, "b g"]:
        """Each over one frame interval about its offset; without half an interval at both ends.

        Interpolation averages the tracker's noise, most between two frames. What this takes off the cost
        repeats with every interval, and is gone in the average.
        """
        weights = np.full(2 * HALF + 1, 1.0)
        weights[[0, -1]] = 0.5
        return np.stack(
            [np.convolve(row, weights / weights.sum(), mode="valid") for row in self.by_block]
        )

    def slopes(self) -> Float[np.ndarray, "b g"]:
        """Derivatives of these, an interval."""
        return self.by_block[:, 2 * HALF :] - self.by_block[:, : -2 * HALF]


def tells_clock(world_from_cams: Poses, motions: MeasuredMotions, options: TrackingOptions) -> bool:
    """Whether `find_clock` would see a delay of a whole frame: frames are dense, and enough was measured.

    Among sparse frames a delay of one frame contradicts most motions. Among dense ones it changes little, and
    motions over a jump of the tracker, of which it hides one or two, weigh more than all others.
    """
    steps_m = np.linalg.norm(np.diff(world_from_cams[:, :3, 3], axis=0), axis=1)
    is_enough = len(motions) >= MIN_MOTIONS and len(world_from_cams) >= MIN_BLOCKS * BLOCK_FRAMES
    return bool(options.clock_is_sought and is_enough and np.median(steps_m) <= MAX_STEP_M)


def find_clock(
    world_from_cams: Poses,
    times: FrameTimes,
    motions: MeasuredMotions,
    is_whole: Bool[np.ndarray, " s"],
    odometry: OdometryOptions,
    options: TrackingOptions,
    keyframe_idx: Int[np.ndarray, " k"] | None = None,
) -> ClockOffset | None:
    """The offset at which the trajectory explains the measured motions best; None where none is significant.

    Args:
        world_from_cams: as recorded, in our convention.
        is_whole: steps (frame i to i + 1) that may be interpolated.
        keyframe_idx: frames between which steps are as sure as `odometry` says; without, all.
    """
    reach = _reach(times, options)
    usable = _inside(motions, times.intervals, is_whole, reach + 1.0)
    if len(usable) < MIN_MOTIONS or len(world_from_cams) < MIN_BLOCKS * BLOCK_FRAMES:
        return None
    usable = usable[np.unique(np.linspace(0, len(usable) - 1, MAX_MOTIONS).astype(int))]
    found = None
    for _ in range(2):  # the noise at the offset, by which departures count, is told only near it
        read = world_from_cams
        if found is not None:
            at = found.offsets(times.intervals)
            read = interpolate_trajectory(world_from_cams, times.intervals, at, is_whole)
        steps = make_odometry(read, odometry, None, keyframe_idx)
        covariance = expected_covariance(usable, steps, noise_factors(read, steps, usable))
        costs = _costs(world_from_cams, times.intervals, usable, is_whole, covariance, reach)
        found = _minimum(costs, times)
        if found is None:
            return None
    steps_m = np.linalg.norm(np.diff(world_from_cams[:, :3, 3], axis=0), axis=1)
    if found is not None and np.median(steps_m[is_whole]) > MAX_STEP_M:
        return replace(found, is_read=False)
    return found


def _reach(times: FrameTimes, options: TrackingOptions) -> float:
    """Largest offset searched, in frame intervals."""
    of_time = 0.0 if times.interval_s is None else options.clock_max_s / times.interval_s
    return min(max(MAX_SOUGHT_FRAMES, of_time), MAX_INTERVALS)


def _inside(
    motions: MeasuredMotions,
    times: Float[np.ndarray, " n"],
    is_whole: Bool[np.ndarray, " s"],
    margin: float,
) -> MeasuredMotions:
    """Motions whose frames are read, at offsets up to `margin`, from steps that are whole."""
    first, last = joined_frames(is_whole)
    i, j = motions.pairs.T
    holds = (first[i] == first[j]) & (times[i] - margin >= times[first[i]])
    return motions[np.flatnonzero(holds & (times[j] + margin <= times[last[j]]))]


def _costs(
    poses: Poses,
    times: Float[np.ndarray, " n"],
    motions: MeasuredMotions,
    is_whole: Bool[np.ndarray, " s"],
    covariance: Float[np.ndarray, "p 6 6"],
    reach: float,
) -> _Costs:
    """Costs under a t-distribution of departures with these covariances."""
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    n_blocks = min(MAX_BLOCKS, len(poses) // BLOCK_FRAMES)
    block = np.minimum(motions.pairs[:, 0] * n_blocks // len(poses), n_blocks - 1)
    half = int(np.ceil(reach / GRID)) + HALF
    offsets = GRID * np.arange(-half, half + 1)
    by_block = np.zeros((n_blocks, len(offsets)))
    for k, offset in enumerate(offsets):
        departed = departures(motions, interpolate_trajectory(poses, times, offset, is_whole))
        squared = np.sum(np.einsum("pij,pj->pi", whiten, departed) ** 2, axis=1)
        cost = (FREEDOM + 6.0) / 2 * np.log1p(squared / FREEDOM)
        by_block[:, k] = np.bincount(block, cost, n_blocks)
    count = np.bincount(block, minlength=n_blocks)
    since = np.bincount(block, times[motions.pairs].mean(axis=1) - _middle(times), n_blocks)
    has = count > 0
    frames_per_motion = len(np.unique(motions.pairs)) / len(motions)
    return _Costs(offsets, by_block[has], since[has] / count[has], frames_per_motion)


def _middle(times: Float[np.ndarray, " n"]) -> float:
    return float(times[0] + times[-1]) / 2


def _minimum(as_is: _Costs, times: FrameTimes) -> ClockOffset | None:
    """Where the averaged cost is least; None where that is at an end, or the fall is not significant."""
    rate, costs = as_is.apart()
    averaged, slopes = costs.averaged(), costs.slopes()
    offsets = costs.offsets[HALF:-HALF]
    total, slope = averaged.sum(axis=0), slopes.sum(axis=0)
    k = int(np.argmin(total))
    if len(averaged) < MIN_BLOCKS or k in (0, len(total) - 1):
        return None
    low = k - 1 if slope[k] > 0 else k
    share = -slope[low] / (slope[low + 1] - slope[low])
    best = offsets[low] + share * GRID
    curvature = (slope[low + 1] - slope[low]) / GRID
    at_best = slopes[:, low] * (1 - share) + slopes[:, low + 1] * share
    n = len(averaged)
    sigma = float(np.sqrt(np.sum(at_best**2) * n / (n - 1)) / curvature)
    zero = len(offsets) // 2
    fall = _significance(averaged[:, zero] - averaged[:, k])
    read, now = as_is.by_block, costs.by_block[:, HALF:-HALF]
    gain = _significance(read[:, len(as_is.offsets) // 2] - now[:, k])
    least = (
        MIN_INTERVALS if times.interval_s is None else max(MIN_INTERVALS, MIN_S / times.interval_s)
    )
    is_kept = abs(best) > max(least, MIN_SIGMAS * sigma)
    if not rate and (not is_kept or fall < MIN_SIGMAS):
        return None
    sigma = float(np.hypot(sigma, INTERPOLATION_SIGMA))
    return ClockOffset(best, sigma, times.interval_s, gain > MIN_SIGMAS, rate)


def _significance(falls: Float[np.ndarray, " b"]) -> float:
    """The sum of what stretches fall by, in its standard deviations."""
    spread = float(np.std(falls, ddof=1) * np.sqrt(len(falls)))
    return float(falls.sum()) / max(spread, 1e-12)
