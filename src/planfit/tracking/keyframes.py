"""Keyframes: the frames whose images are looked at, chosen by the recorded trajectory before any is opened.

A camera that records 60 frames a second shows the same wall 60 times. What images and depth say is taken from
keyframes; all other frames follow them by the recorded motion, which over a few decimetres is better than
anything else that is known. Where the tracker is in doubt, more frames are taken.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import require_positive
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.priors import FRAME_RATE_HZ, VIEW_DISTANCE_M
from planfit.scan.odometry import step_sizes
from planfit.scan.types import Image
from planfit.tracking.lost import REACH
from planfit.tracking.lost_runs import MAX_SHARE, MIN_FRAMES, is_identity, runs, stands_still
from planfit.tracking.trajectory import frame_times
from planfit.tracking.types import Tracking

UNTIMED_FPS = FRAME_RATE_HZ.value
"""Frames a second of a scan without times."""
STEADIER_SHARE = 0.4
"""Within this last share of the way to the next keyframe, the frame at which the camera moved most slowly
is taken instead: its image is the least blurred."""
MAX_MORE_SHARE = 0.5
"""Where neighbouring keyframes do not match, frames between them are looked at too: at most so many, as a
share of the keyframes. About jumps and lost frames all are."""
MORE_PER_GAP = 7
"""Frames looked at besides between two keyframes where something is in doubt: a gap becomes eight."""


@dataclass(frozen=True)
class KeyframeOptions:
    """Which frames are keyframes: they alone are opened, matched, segmented and solved for."""

    min_frames: int = 600
    """All frames of shorter scans are keyframes."""
    max_step_m: float = 0.25
    """A frame this far along the path from the last keyframe is the next one."""
    max_rotation_deg: float = 7.0
    """So is a frame that has rotated by this much, added up along the path. In a room, 7 degrees place
    keyframes as well as all frames do (0.02 m on 7-Scenes' kitchen), 10 degrees half as well."""
    max_interval_s: float = 1.0
    """And one this much later, however slowly the camera moves."""

    def __post_init__(self) -> None:
        require_positive(self, "max_step_m", "max_rotation_deg", "max_interval_s")


def choose_keyframes(
    world_from_cams: Poses,
    timestamps: Float[np.ndarray, " n"],
    options: KeyframeOptions,
    lacking: Sequence[Image] = (),
) -> Int[np.ndarray, " k"]:
    """Indices of keyframes, increasing; the first and the last frame are among them.

    Frames that lack an image are none, but for those without colour where others are too far apart.

    Args:
        timestamps: of the frames, s, or frame numbers.
        lacking: the image that each frame lacks; none lacks any without.
    """
    if not any(lacking):
        return _chosen(world_from_cams, timestamps, options)
    n, lacks = len(world_from_cams), np.array(lacking)
    whole = np.union1d(np.flatnonzero(lacks == ""), [0, n - 1])
    gone = _gone(world_from_cams, timestamps, options)[:, whole]
    is_far = np.repeat((np.diff(gone) > 1.0).any(axis=0), np.diff(whole))
    by_depth = np.flatnonzero((lacks[:-1] == "colour") & is_far)
    seen = np.union1d(whole, by_depth)
    return seen[_chosen(world_from_cams[seen], timestamps[seen], options)]


def _gone(
    world_from_cams: Poses, timestamps: Float[np.ndarray, " n"], options: KeyframeOptions
) -> Float[np.ndarray, "3 n"]:
    """How far each frame is from the first along the path, in shares of what is allowed between keyframes."""
    length, angle = step_sizes(se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:])
    return np.stack(
        [
            _summed(length) / options.max_step_m,
            _summed(angle) / np.deg2rad(options.max_rotation_deg),
            _times_s(timestamps) / options.max_interval_s,
        ]
    )


def _times_s(timestamps: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    times = frame_times(timestamps)
    return times.intervals * (times.interval_s or 1.0 / UNTIMED_FPS)


def _chosen(
    world_from_cams: Poses, timestamps: Float[np.ndarray, " n"], options: KeyframeOptions
) -> Int[np.ndarray, " k"]:
    """Keyframes among frames that all may be."""
    n = len(world_from_cams)
    if n < options.min_frames:
        return np.arange(n)
    gone = _gone(world_from_cams, timestamps, options)
    length, angle = step_sizes(se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:])
    blur = _blur(length, angle, np.diff(_times_s(timestamps)))
    chosen, last = [0], 0
    for i in range(1, n - 1):
        # The next frame would go beyond: this one is the last that is near enough. Before a jump it is beyond
        # whichever is taken, until that is the last one.
        while last < i and (gone[:, i + 1] - gone[:, last]).max() > 1.0:
            first = i - int(STEADIER_SHARE * max(i - last - 1, 0))
            # The latest of equals.
            last = i - int(np.argmin(blur[first : i + 1][::-1]))
            chosen.append(last)
    return np.union1d([*chosen, n - 1], _about_lost(world_from_cams))


def _summed(sizes: Float[np.ndarray, " s"]) -> Float[np.ndarray, " n"]:
    return np.concatenate([[0.0], np.cumsum(sizes)])


def _blur(
    length: Float[np.ndarray, " s"], angle: Float[np.ndarray, " s"], dt_s: Float[np.ndarray, " s"]
) -> Float[np.ndarray, " n"]:
    """How fast the view changes at each frame, rad/s: the larger of the steps before and after."""
    speed = (angle + length / VIEW_DISTANCE_M.value) / np.maximum(dt_s, 1e-6)
    return np.maximum(np.concatenate([speed[:1], speed]), np.concatenate([speed, speed[-1:]]))


def _about_lost(world_from_cams: Poses) -> Int[np.ndarray, " l"]:
    """Frames of runs whose pose repeats or is the identity, as lost trackers write it, and those beside.

    No motion tells keyframes there. Where most poses repeat, it is how the scan was recorded.
    """
    n, is_same = len(world_from_cams), stands_still(world_from_cams)
    repeats = [(a, b + 1) for a, b in runs(is_same) if b + 2 - a >= MIN_FRAMES]
    lost = repeats + runs(is_identity(world_from_cams))
    if sum(b - a + 1 for a, b in lost) > MAX_SHARE * n:
        return np.zeros(0, dtype=int)
    about = [np.arange(max(a - REACH, 0), min(b + REACH + 1, n)) for a, b in lost]
    return np.unique(np.concatenate([np.zeros(0, dtype=int), *about]))


def frames_in_doubt(
    tracking: Tracking,
    keyframe_idx: Int[np.ndarray, " k"],
    is_bridged: Bool[np.ndarray, " g"],
) -> Int[np.ndarray, " m"]:
    """Frames between keyframes to be looked at too: about breaks, and where no neighbours match.

    Args:
        is_bridged: of each gap between two keyframes, whether a pair of matched frames spans it.
    """
    n_between = np.diff(keyframe_idx) - 1
    broken = np.zeros(len(n_between), dtype=bool)
    for found in tracking.breaks:
        first, last = np.searchsorted(keyframe_idx, [found.first_frame, found.last_frame])
        # A frame is the end of the gap before it, and the begin of the one after.
        broken[max(first - 1, 0) : last + 1] = True
    broken |= _holds_any(tracking.doubtful_steps, keyframe_idx)
    unmatched = np.flatnonzero(~is_bridged & ~broken & (n_between > 0))
    most = int(MAX_MORE_SHARE * len(keyframe_idx)) // MORE_PER_GAP
    # The longest first: there most is to be won.
    unmatched = unmatched[np.argsort(-n_between[unmatched], kind="stable")][:most]
    added = [_within(keyframe_idx, int(k), None) for k in np.flatnonzero(broken)]
    added += [_within(keyframe_idx, int(k), MORE_PER_GAP) for k in unmatched]
    return np.unique(np.concatenate([np.zeros(0, dtype=int), *added]))


def _holds_any(steps: Iterable[int], keyframe_idx: np.ndarray) -> np.ndarray:
    """Which gaps between keyframes (g,) hold any of the steps (frame i to i + 1)."""
    gaps = np.searchsorted(keyframe_idx, np.asarray(steps, dtype=int), side="right") - 1
    return np.isin(np.arange(len(keyframe_idx) - 1), gaps)


def _within(keyframe_idx: np.ndarray, gap: int, most: int | None) -> np.ndarray:
    """Frames of a gap, without its ends; at most so many, spread evenly."""
    first, last = int(keyframe_idx[gap]), int(keyframe_idx[gap + 1])
    count = last - first - 1 if most is None else min(most, last - first - 1)
    return np.unique(np.linspace(first, last, count + 2).round().astype(int)[1:-1])
