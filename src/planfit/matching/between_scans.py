"""Frames of different scans of one building that show the same place.

Nothing is recorded of how two scans stand to each other, so pairs are found first by what frames show, and
verified; then, once the scans are placed, by where their cameras stand. Between two visits things are moved:
the rest of two views may contradict the motion more than within one scan (`view_agreement.py`).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.matching.loop_closure import cycle_consistent
from planfit.matching.options import MatchingOptions
from planfit.matching.pairs import FrameDescriptors, choose_pairs
from planfit.matching.relative_motions import (
    VerifiedPairs,
    is_among,
    matches_of,
    verify_pairs,
    with_explained,
)
from planfit.matching.tentative import ScanKeypoints
from planfit.matching.types import Matches, RelativePoses
from planfit.matching.view_agreement import MAX_CONTRADICTED_BETWEEN
from planfit.runtime import Runtime
from planfit.scan import Scan
from planfit.scan.odometry import Odometry
from planfit.scan.views import select_frames

_RETRIEVED = 6
"""Frames of another scan that each frame is tried with, the most alike; of two visits to a synthetic flat,
refurnished, a tenth of these pairs are verified, all but one in eighty of them rightly."""
_LOOPS_PER_FRAME = 12
"""Pairs a frame may take part in once the scans are placed."""


@dataclass(frozen=True)
class ScansSeen:
    """What the keyframes of several scans show, one scan after the other."""

    scan: Scan
    """The keyframes, joined."""
    of_scan: Int[np.ndarray, " k"]
    """Number of the scan that each is of."""
    keypoints: ScanKeypoints
    descriptors: FrameDescriptors

    def between(self, pairs: Int[np.ndarray, "p 2"]) -> Int[np.ndarray, "q 2"]:
        """Those of frames of different scans."""
        return pairs[self.of_scan[pairs[:, 0]] != self.of_scan[pairs[:, 1]]]

    def of_frames(self, frame_idx: Int[np.ndarray, " f"]) -> "ScansSeen":
        """Some of the keyframes alone, increasing."""
        scan = select_frames(self.scan, frame_idx, self.scan.world_from_cams[frame_idx])
        descriptors = FrameDescriptors(
            self.descriptors.vectors[frame_idx],
            self.descriptors.sharpness[frame_idx],
            self.descriptors.samples[frame_idx],
        )
        keypoints = self.keypoints.of_frames(frame_idx)
        return ScansSeen(scan, self.of_scan[frame_idx], keypoints, descriptors)


def retrieve_between(seen: ScansSeen, view_idx: Int[np.ndarray, " v"]) -> Int[np.ndarray, "p 2"]:
    """Pairs of frames of different scans that look alike, first < second, sorted.

    Args:
        view_idx: frames that stand for their like, increasing.
    """
    vectors, of_scan = seen.descriptors.vectors[view_idx], seen.of_scan[view_idx]
    found = [np.zeros((0, 2), dtype=int)]
    for own in np.unique(of_scan):
        for other in np.unique(of_scan[of_scan != own]):
            rows, columns = (view_idx[of_scan == k] for k in (own, other))
            alike = vectors[of_scan == own] @ vectors[of_scan == other].T
            k = min(_RETRIEVED, len(columns))
            best = np.argsort(-alike, axis=1, kind="stable")[:, :k]
            ok = np.take_along_axis(alike, best, axis=1) > 0
            found.append(
                np.column_stack([np.broadcast_to(rows[:, None], best.shape)[ok], columns[best][ok]])
            )
    return np.unique(np.sort(np.concatenate(found), axis=1), axis=0)


def pairs_between(
    seen: ScansSeen,
    joined_from_cams: Float[np.ndarray, "k 4 4"],
    odometry: Odometry,
    options: MatchingOptions,
) -> Int[np.ndarray, "p 2"]:
    """Pairs of frames of different scans that may show the same place, by where they stand."""
    chosen = replace(options.pairs, loops_per_frame=_LOOPS_PER_FRAME)
    return seen.between(choose_pairs(joined_from_cams, odometry, chosen, seen.descriptors))


def verify_between(
    seen: ScansSeen,
    pairs: Int[np.ndarray, "p 2"],
    known: VerifiedPairs | None,
    options: MatchingOptions,
    runtime: Runtime,
) -> VerifiedPairs:
    """Those of the pairs that hold together, and how much of both views each explains; with those known.

    Args:
        pairs: first < second.
        known: of another call; not tried again.
    """
    if known is not None:
        pairs = pairs[~is_among(pairs, known.relative_poses.pairs)]
    stage = "pairs between scans"
    found = verify_pairs(seen.scan, seen.keypoints, pairs, options, runtime, stage)
    is_neighbour = np.zeros(len(found), dtype=bool)
    found = with_explained(found, is_neighbour, seen.keypoints.grids, MAX_CONTRADICTED_BETWEEN)
    return found if known is None else known.joined(found)


def accept_between(
    found: VerifiedPairs,
    within: RelativePoses,
    joined_from_cams: Float[np.ndarray, "k 4 4"],
    odometry: Odometry,
) -> Matches:
    """Matches of the pairs between scans that agree with each other and with what each scan knows of itself.

    Args:
        found: verified pairs of frames of different scans.
        within: accepted pairs of frames of one scan.
        joined_from_cams: where the frames stand, loops closed and scans placed.
        odometry: of the scans, with a step between each two that is as sure as they are placed.
    """
    if within.explained is None:
        within = replace(within, explained=np.ones(len(within)))
    edges = found.relative_poses.then(within)
    is_accepted = cycle_consistent(edges, joined_from_cams, odometry)
    accepted = found.where(is_accepted[: len(found)])
    return matches_of(accepted, len(accepted), 0)
