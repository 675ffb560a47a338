"""Loops by hand: what a person says that two frames show, or do not show, whatever their images say.

A loop that was added is verified by the images of its two frames, which are opened for it. Where they say
nothing, the points that were picked in both hold alone. Neither has to pass the gates by which a program
tells look-alikes: that is what the person is asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching.cycles import TRANSLATION_SLACK_M
from planfit.matching.options import MatchingOptions
from planfit.matching.relative_motions import VerifiedPairs, verify_pairs
from planfit.matching.tentative import find_keypoints
from planfit.matching.types import Matches, RelativePoses
from planfit.matching.verify import match_sigma
from planfit.runtime import Runtime
from planfit.scan import Scan
from planfit.scan.statistics import lift_pixel
from planfit.scan.views import select_frames

_PICK_PX = 3.0
"""How far off its point a pixel is that a person picks, standard deviation."""
AGREES_M = TRANSLATION_SLACK_M
"""Two picked points that the images put further apart than this are not one."""


@dataclass(frozen=True)
class PickedPoint:
    """A point that a person picked in the images of two frames."""

    uv: tuple[tuple[float, float], tuple[float, float]]
    """px, in the image of each."""


@dataclass(frozen=True)
class HandLoop:
    """A loop as a person gave it."""

    frames: tuple[int, int]
    """First < second, as numbered in the scan."""
    picked: PickedPoint | None


@dataclass(frozen=True)
class HandMatches:
    """What loops by hand come to."""

    matches: Matches
    """Verified matches, and picked points where the images say nothing."""
    relative_poses: RelativePoses
    """Of those that the images verified."""
    gaps_m: tuple[float | None, ...]
    """Of each loop, how far apart the motion of its images puts its picked points; None where either is not
    there."""
    has_matches: tuple[bool, ...]
    """Of each loop, whether it holds anything."""


@dataclass(frozen=True)
class HandVerdicts:
    """What matching is told: which frames and pairs are out, and which loops are right."""

    is_excluded: Bool[np.ndarray, " n"]
    are_deleted: Callable[[Int[np.ndarray, "p 2"]], Bool[np.ndarray, " p"]]
    """Of pairs of the scan's frames."""
    certain: RelativePoses
    """Loops that are right, between the frames that are matched."""
    frame_idx: Int[np.ndarray, " k"]
    """The scan's number of each of the frames that are matched."""

    def allows(self, pairs: Int[np.ndarray, "p 2"]) -> Bool[np.ndarray, " p"]:
        """Which pairs, of the frames that are matched, may be used."""
        named = self.frame_idx[pairs]
        return ~(self.is_excluded[named].any(axis=1) | self.are_deleted(named))

    def kept(self, found: VerifiedPairs) -> VerifiedPairs:
        """Those that may be used."""
        allowed = self.allows(found.relative_poses.pairs)
        return found if allowed.all() else found.where(allowed)


def carried(
    relative_poses: RelativePoses, frame_idx: Int[np.ndarray, " k"], world_from_cams: Poses
) -> RelativePoses:
    """Motions between frames of a scan, carried by the recorded motion (poses of all n frames) onto the
    nearest of the frames `frame_idx`, by whose numbers the pairs then are. Those of one are left out."""
    borders = 0.5 * (frame_idx[:-1] + frame_idx[1:])
    named = relative_poses.pairs
    keys = np.searchsorted(borders, named)
    key_from_frame = se3.inverse(world_from_cams[frame_idx[keys]]) @ world_from_cams[named]
    motions = key_from_frame[:, 0] @ relative_poses.a_from_b @ se3.inverse(key_from_frame[:, 1])
    apart = np.flatnonzero(keys[:, 0] != keys[:, 1])
    return RelativePoses(keys, motions, relative_poses.n_inliers)[apart]


def match_by_hand(
    scan: Scan, loops: tuple[HandLoop, ...], options: MatchingOptions, runtime: Runtime
) -> HandMatches:
    """Open the frames of loops that a person added, and match them.

    Raises:
        ScanError: an image cannot be read, or there is no depth where a point was picked.
    """
    if not loops:
        return no_hand_matches()
    frame_idx = np.unique([loop.frames for loop in loops])
    chosen = select_frames(scan, frame_idx, scan.world_from_cams[frame_idx])
    pairs = np.unique(np.searchsorted(frame_idx, [loop.frames for loop in loops]), axis=0)
    verified = VerifiedPairs(
        RelativePoses(np.zeros((0, 2), int), np.zeros((0, 4, 4)), np.zeros(0, int)), [], []
    )
    if scan.has_color and not options.colmap:
        seen = find_keypoints(chosen, options, runtime)
        verified = verify_pairs(chosen, seen, pairs, options, runtime, "loops by hand")
    by_pair = {
        (int(frame_idx[a]), int(frame_idx[b])): k
        for k, (a, b) in enumerate(verified.relative_poses.pairs)
    }
    rows: list[tuple[tuple[int, int], np.ndarray, np.ndarray, np.ndarray]] = []
    right, gaps, has = [], [], []
    for loop in loops:
        k, gap = by_pair.get(loop.frames), None
        picked = None if loop.picked is None else _lifted(scan, loop)
        if k is not None and picked is not None:
            there = se3.transform(verified.relative_poses.a_from_b[k], picked[1])
            gap = float(np.linalg.norm(there - picked[0]))
        # A person who picks points that the images put elsewhere knows better than these.
        if k is not None and (gap is None or gap <= AGREES_M):
            a, b = verified.points_a[k], verified.points_b[k]
            rows.append((loop.frames, a, b, match_sigma(a, b)))
            right.append(k)
        elif picked is not None:
            rows.append((loop.frames, *picked))
        gaps.append(gap)
        has.append(k is not None or picked is not None)
    kept = verified.relative_poses[np.unique(np.array(right, dtype=int))]
    named = RelativePoses(frame_idx[kept.pairs], kept.a_from_b, kept.n_inliers)
    return HandMatches(_gathered(rows), named, tuple(gaps), tuple(has))


def no_hand_matches() -> HandMatches:
    """What no loops by hand come to."""
    none = RelativePoses(np.zeros((0, 2), dtype=int), np.zeros((0, 4, 4)), np.zeros(0, dtype=int))
    return HandMatches(_gathered([]), none, (), ())


def _lifted(scan: Scan, loop: HandLoop) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A picked point in both camera frames (1, 3), m, and the sigma of their difference (1,)."""
    assert loop.picked is not None
    a, b = (
        lift_pixel(scan, frame, uv)[None]
        for frame, uv in zip(loop.frames, loop.picked.uv, strict=True)
    )
    off_m = [
        _PICK_PX * point[0, 2] / scan.cameras[frame].fx
        for frame, point in zip(loop.frames, (a, b), strict=True)
    ]
    sigma = np.sqrt(match_sigma(a, b) ** 2 + off_m[0] ** 2 + off_m[1] ** 2)
    return a, b, sigma


def _gathered(
    rows: list[tuple[tuple[int, int], np.ndarray, np.ndarray, np.ndarray]],
) -> Matches:
    none = np.zeros((0, 3))
    frames = [np.tile(pair, (len(a), 1)) for pair, a, _, _ in rows]
    return Matches.from_arrays(
        np.concatenate([np.zeros((0, 2), dtype=int), *frames]),
        np.concatenate([none, *(a for _, a, _, _ in rows)]),
        np.concatenate([none, *(b for _, _, b, _ in rows)]),
        np.concatenate([np.zeros(0), *(sigma for _, _, _, sigma in rows)]),
    )
