"""Recorded poses as a trajectory: read at other times, weighed with motion that was measured beside them."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.pose_terms import BetweenTerm, PosePriorTerm
from planfit.lsq.problem import Problem
from planfit.lsq.robust import Loss, LossKind
from planfit.scan.odometry import Odometry
from planfit.tracking.motions import MeasuredMotions

LONG_INTERVAL = 3.0
"""Nothing is interpolated over a time of more frame intervals: frames are missing."""

_LOSS = Loss(LossKind.CAUCHY, 4.0)
"""Of a departure's six numbers in sigmas; false motions count little."""


@dataclass(frozen=True)
class FrameTimes:
    """When frames were taken, in intervals between frames (median)."""

    intervals: Float[np.ndarray, " n"]
    interval_s: float | None
    """s; None where the scan has frame numbers instead of times."""


def frame_times(timestamps: Float[np.ndarray, " n"]) -> FrameTimes:
    """Times of frames that follow each other; frames are numbered where times do not grow.

    Whole numbers alone are frame numbers, as formats without times have them.
    """
    steps = np.diff(timestamps)
    if len(steps) == 0 or steps.min() <= 0:
        return FrameTimes(np.arange(float(len(timestamps))), None)
    interval = float(np.median(steps))
    is_numbered = bool(np.all(timestamps == np.round(timestamps)))
    intervals = (timestamps - timestamps[0]) / interval
    return FrameTimes(intervals, None if is_numbered else interval)


def interpolate_trajectory(
    world_from_cams: Poses,
    times: Float[np.ndarray, " n"],
    offset: float | Float[np.ndarray, " n"],
    is_whole: Bool[np.ndarray, " s"],
) -> Poses:
    """Poses of a trajectory at the times of its frames plus an offset, one for all or each its own.

    They are interpolated between the poses around them. At the ends, and at steps (frame i to i + 1) that
    are not whole, motion goes on at the velocity of the last step.
    """
    before, after, share = _brackets(times, offset, is_whole)
    return se3.interpolate(world_from_cams[before], world_from_cams[after], share)


def interpolation_sigmas(
    world_from_cams: Poses,
    times: Float[np.ndarray, " n"],
    offset: float | Float[np.ndarray, " n"],
    is_whole: Bool[np.ndarray, " s"],
) -> Float[np.ndarray, "n 2"]:
    """How far `interpolate_trajectory` may be off at each frame: rotation (rad), translation (m), each axis.

    Of linear interpolation at share x of a step the error is x (1 - x) / 2 times the second difference.
    """
    before, _, share = _brackets(times, offset, is_whole)
    steps = se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:]
    tangents = np.concatenate([se3.log_so3(steps[:, :3, :3]), steps[:, :3, 3]], axis=1)
    bends = np.diff(tangents, axis=0) ** 2
    bends[~(is_whole[:-1] & is_whole[1:])] = 0.0
    if len(bends) == 0:
        return np.zeros((len(world_from_cams), 2))
    # Of the step from frame k: the mean over the bends at frames k and k + 1.
    at = np.stack([before - 1, before]).clip(0, len(bends) - 1)
    around = bends[at].mean(axis=0)
    lever = np.abs(share * (1 - share)) / 2
    sigma = np.sqrt(around.reshape(-1, 2, 3).mean(axis=2))
    return lever[:, None] * sigma


def _brackets(
    times: Float[np.ndarray, " n"],
    offset: float | Float[np.ndarray, " n"],
    is_whole: Bool[np.ndarray, " s"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Frame before and after the time at which each pose is read, and how far on the way it is."""
    first, last = joined_frames(is_whole)
    at = times + offset
    before = np.searchsorted(times, at, side="right") - 1
    before = np.clip(before, first, np.maximum(last - 1, first))
    after = np.minimum(before + 1, last)
    length = np.where(after > before, times[after] - times[before], 1.0)
    return before, after, np.where(after > before, (at - times[before]) / length, 0.0)


def joined_frames(
    is_whole: Bool[np.ndarray, " s"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """First and last frame that whole steps (frame i to i + 1) join each of the n = s + 1 frames with."""
    n = len(is_whole) + 1
    cuts = np.flatnonzero(~is_whole)
    firsts = np.concatenate([[0], cuts + 1])
    lasts = np.concatenate([cuts, [n - 1]])
    segment = np.searchsorted(cuts, np.arange(n))
    return firsts[segment], lasts[segment]


def fuse(world_from_cams: Poses, odometry: Odometry, motions: MeasuredMotions) -> Poses:
    """Poses that recorded steps and measured motions agree on best; the first stays.

    Neighbouring motions close no loops: what is gained is smaller drift, by which loops are then found.
    """
    steps = np.arange(len(world_from_cams) - 1)
    sigma = np.repeat(
        np.column_stack([odometry.sigma_rotation, odometry.sigma_translation]), 3, axis=1
    )
    terms = [
        BetweenTerm(
            np.column_stack([steps, steps + 1]),
            odometry.cam_from_next,
            sigma,
            loss=_LOSS,
            name="recorded",
        ),
        measured_term(motions),
        PosePriorTerm(np.array([0]), world_from_cams[:1], np.full(6, 0.01)),
    ]
    return Problem(terms, world_from_cams).solve().target_from_cams


def measured_term(motions: MeasuredMotions) -> BetweenTerm:
    """Measured motions as a term over poses; false ones count little."""
    # The residual of a relative pose is in the axes of the second frame: R^T times that in the first's.
    rotation = np.zeros_like(motions.covariance)
    rotation[:, :3, :3] = rotation[:, 3:, 3:] = motions.a_from_b[:, :3, :3]
    information = np.swapaxes(rotation, 1, 2) @ np.linalg.inv(motions.covariance) @ rotation
    information = (information + np.swapaxes(information, 1, 2)) / 2
    return BetweenTerm(
        motions.pairs, motions.a_from_b, information=information, loss=_LOSS, name="measured"
    )


def with_steps_of(odometry: Odometry, world_from_cams: Poses) -> Odometry:
    """The same sigmas of other steps. They stay as wide as the tracker's: matches count once, later on."""
    steps = se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:]
    return replace(odometry, cam_from_next=steps)
