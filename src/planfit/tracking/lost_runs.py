"""Which frames have a pose that says nothing: one that stands still, or the identity.

Trackers that are lost repeat the last pose or write the identity (what they leave out, readers leave out).
Whether a repeated pose is lost or the camera stood on a tripod, the images tell.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.scan.odometry import LONG, times_usual, usual_step
from planfit.tracking.motions import MAX_SIGMAS, MIN_MATCHES_ALONE, MeasuredMotions, squared_sigmas
from planfit.tracking.trajectory import interpolation_sigmas

SAME = 1e-9
"""Poses of a camera that is only held still differ by more."""
MIN_FRAMES = 3
"""Two equal poses in a row are one pose for two images, as some formats have it."""
HELD_SHARE = 0.9
"""Poses come at a rate of their own where so many frames are held as long as each other, but for one: of a
pose at 10 Hz, three or four images at 35."""
MAX_SHARE = 0.5
"""A scan with more lost frames has no recorded poses to speak of, and stays as it is."""
LEAST_STEP = 1e-3
"""Usual steps are taken to be this long (m) and to turn this far (rad) at least."""


@dataclass(frozen=True)
class LostRun:
    """Frames in a row whose recorded poses say nothing."""

    kind: Literal["frozen", "identity"]
    first: int
    last: int
    """Inclusive; both ends of the scan may be among them."""
    knows_its_place: bool
    """Whether the tracker found itself again afterwards: the recorded motion from the frame before to the
    frame after can be believed. It cannot where the tracker went on from the pose that stood still."""


def find_lost_runs(
    recorded: Poses,
    is_at_origin: Bool[np.ndarray, " n"],
    motions: MeasuredMotions,
) -> tuple[LostRun, ...]:
    """Runs of lost frames, in their order; none where more than half of the frames would be lost.

    Args:
        is_at_origin: whether a pose is the identity, as it stood in the file.
    """
    is_same = stands_still(recorded)
    usual, found = usual_of_known(recorded, ~is_same), []
    for first, last in runs(is_at_origin):
        found += _identity_run(recorded, (first, last), motions, usual)
    for first, before_last in runs(is_same & ~is_at_origin[:-1]):
        last = before_last + 1
        inside = motions[(motions.pairs[:, 0] >= first) & (motions.pairs[:, 1] <= last)]
        if last - first + 1 < MIN_FRAMES or not moves(inside):
            continue
        goes_on = _goes_on(recorded, last, +1, motions, usual)
        # The pose that is repeated was right when it was first recorded.
        found.append(LostRun("frozen", first + 1, last - goes_on, not goes_on))
    n_lost = sum(run.last - run.first + 1 for run in found)
    return (
        tuple(sorted(found, key=lambda r: r.first)) if n_lost <= MAX_SHARE * len(recorded) else ()
    )


def stands_still(recorded: Poses) -> Bool[np.ndarray, " s"]:
    """Steps (frame i to i + 1) over which the recorded pose is the same."""
    return np.abs(np.diff(recorded, axis=0)).max(axis=(1, 2)) < SAME


def count_repeated(recorded: Poses, motions: MeasuredMotions) -> int:
    """How many frames repeat the pose before though the images move, where these are too many to be lost."""
    is_same = stands_still(recorded)
    is_most = len(is_same) > 0 and is_same.mean() > MAX_SHARE
    return int(is_same.sum()) if is_most and moves(_within_runs(_run_of(is_same), motions)) else 0


def _run_of(is_same: Bool[np.ndarray, " s"]) -> Int[np.ndarray, " n"]:
    """Of each frame the number of its run of frames with one pose."""
    return np.concatenate([[0], np.cumsum(~is_same)])


def _within_runs(run: Int[np.ndarray, " n"], motions: MeasuredMotions) -> MeasuredMotions:
    """Motions between two frames of one run."""
    return motions[np.flatnonzero(run[motions.pairs[:, 0]] == run[motions.pairs[:, 1]])]


def between_held(
    recorded: Poses, times: Float[np.ndarray, " n"], motions: MeasuredMotions
) -> tuple[Poses, Float[np.ndarray, "n 2"]] | None:
    """Poses that came at a lower rate than images and are held between, read at the images' times instead,
    and how far they may be off (rad, m, each axis); None where each frame has its own, or they stand still
    for other reasons.

    Args:
        times: of the frames, in any unit.
    """
    is_same = stands_still(recorded)
    # Each pose is of the first image that has it.
    first = np.concatenate([[0], 1 + np.flatnonzero(~is_same)])
    n_held = np.diff(first)
    if len(n_held) < MIN_FRAMES or not is_same.any():
        return None
    least = np.quantile(n_held, 1 - HELD_SHARE)
    alike = n_held[(n_held >= least) & (n_held <= least + 1)]
    run = _run_of(is_same)
    is_regular = alike.max() >= 2 and alike.sum() >= HELD_SHARE * n_held.sum()
    if not is_regular or not moves(_within_runs(run, motions)):
        return None
    before = np.minimum(run, len(first) - 2)
    a, b = first[before], first[before + 1]
    share = (times - times[a]) / (times[b] - times[a])
    half = np.diff(times[first], append=times[first[-1]]) / 2
    middle = interpolation_sigmas(recorded[first], times[first], half, np.full(len(n_held), True))
    sigmas = 4 * np.abs(share * (1 - share))[:, None] * middle[before]
    return se3.interpolate(recorded[a], recorded[b], share), sigmas


def is_identity(poses: Poses) -> Bool[np.ndarray, " n"]:
    """Which poses are exactly the identity."""
    return np.abs(poses - np.eye(4)).max(axis=(1, 2)) < SAME


def usual_of_known(recorded: Poses, is_known: Bool[np.ndarray, " s"]) -> tuple[float, float]:
    """Length (m) and angle (rad) of the usual step among those that are known."""
    return usual_step((se3.inverse(recorded[:-1]) @ recorded[1:])[is_known], LEAST_STEP)


def moves(motions: MeasuredMotions) -> bool:
    """Whether measured motions say that the camera did not stand still."""
    still = np.tile(np.eye(4), (len(motions), 1, 1))
    squared = squared_sigmas(se3.difference(motions.a_from_b, still), motions.covariance)
    n_inliers = motions.n_inliers[squared > MAX_SIGMAS**2]
    return len(n_inliers) >= 2 or bool((n_inliers >= MIN_MATCHES_ALONE).any())


def runs(holds: Bool[np.ndarray, " k"]) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.diff(np.concatenate([[0], holds.astype(int), [0]]))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _identity_run(
    recorded: Poses,
    run: tuple[int, int],
    motions: MeasuredMotions,
    usual: tuple[float, float],
) -> list[LostRun]:
    """A run of identities as lost frames; nothing where the camera stood at the origin.

    A recording mostly begins at the origin, and may come back: there, motions onto or off it are right.
    """
    first, last = run
    came = first > 0 and _goes_on(recorded, first, -1, motions, usual)
    goes_on = last < len(recorded) - 1 and _goes_on(recorded, last, +1, motions, usual)
    inside = motions[(motions.pairs[:, 0] >= first) & (motions.pairs[:, 1] <= last)]
    is_still = not moves(inside)
    at_start = first == 0 and not len(_ends_at(motions, last, +1))
    if (is_still and (came or goes_on or at_start)) or (came and goes_on and first == last):
        return []
    begin, end = first + came, last - goes_on
    return [LostRun("identity", begin, end, not goes_on)] if begin <= end else []


def _goes_on(
    recorded: Poses,
    frame: int,
    way: int,
    motions: MeasuredMotions,
    usual: tuple[float, float],
) -> bool:
    """Whether the recorded motion off a frame is right, onwards (way 1) or back (-1).

    Measured motions say so; without any, whether it is as long as usual.
    """
    if not 0 <= frame + way < len(recorded):
        return False
    of = motions[_ends_at(motions, frame, way)]
    if len(of) == 0:
        step = se3.inverse(recorded[frame]) @ recorded[frame + way]
        return bool(times_usual(step[None], usual)[0] <= LONG)
    i, j = of.pairs.T
    residual = se3.difference(of.a_from_b, se3.inverse(recorded[i]) @ recorded[j])
    # A tracker errs too: twice the sigmas of the measurement alone.
    return bool(np.median(squared_sigmas(residual, 4 * of.covariance)) < MAX_SIGMAS**2)


def _ends_at(motions: MeasuredMotions, frame: int, way: int) -> Int[np.ndarray, " k"]:
    """Motions from a frame onwards (way 1), or to it from before (-1)."""
    return np.flatnonzero(motions.pairs[:, 0 if way > 0 else 1] == frame)
