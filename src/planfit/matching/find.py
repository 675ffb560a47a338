"""Matches of a scan: keypoints of all frames, matched over pairs, verified, and cycle-consistent."""

from dataclasses import replace

import numpy as np

from planfit.geometry import se3
from planfit.matching.by_hand import HandVerdicts
from planfit.matching.cycles import is_near
from planfit.matching.loop_closure import cycle_consistent
from planfit.matching.options import MatchingOptions
from planfit.matching.relative_motions import (
    NeighbourMotions,
    VerifiedPairs,
    are_neighbours,
    is_among,
    matches_of,
    measure_neighbours,
    verify_pairs,
    with_explained,
)
from planfit.matching.tentative import ScanKeypoints, choose_tentative
from planfit.matching.types import Matches
from planfit.matching.view_agreement import MAX_CONTRADICTED
from planfit.runtime import Runtime
from planfit.scan import Scan
from planfit.scan.odometry import Odometry


def find_matches(
    scan: Scan,
    odometry: Odometry,
    options: MatchingOptions,
    runtime: Runtime,
    neighbours: NeighbourMotions | None = None,
    by_hand: HandVerdicts | None = None,
) -> Matches:
    """Detect, match and verify; see the options for each step.

    Args:
        scan: its poses say which frames may have seen the same.
        neighbours: what `measure_neighbours` found with these options; without, it is measured here.
        by_hand: what a person says of frames and pairs.

    Raises:
        OptionError: a learned detector or matcher cannot be had.
        ScanError: an image cannot be read, or the COLMAP files are not those of this scan.
    """
    measured = neighbours or measure_neighbours(scan, options, runtime)
    return search_matches(scan, odometry, options, runtime, measured, by_hand)[0]


def search_matches(
    scan: Scan,
    odometry: Odometry,
    options: MatchingOptions,
    runtime: Runtime,
    known: NeighbourMotions,
    by_hand: HandVerdicts | None = None,
) -> tuple[Matches, NeighbourMotions]:
    """As `find_matches`; pairs that are `known` are not tried again, and the new ones come with them."""
    seen = known.keypoints
    tentative = choose_tentative(scan, seen, odometry, options)
    certain = None if by_hand is None else by_hand.certain

    def verified(pairs: np.ndarray, stage: str) -> VerifiedPairs:
        nonlocal known
        new = pairs[~is_among(pairs, known.tried)]
        known = known.with_more(new, verify_pairs(scan, seen, new, options, runtime, stage))
        found = _possible(known.of(pairs), scan, odometry)
        # All pairs are tried, whatever a person says, so that what was kept of them serves again.
        return found if by_hand is None else by_hand.kept(found)

    def accepted(found: VerifiedPairs) -> np.ndarray:
        return cycle_consistent(found.relative_poses, scan.world_from_cams, odometry, certain)

    found = _compared(verified(tentative.pairs, "pairs"), seen, options)
    is_accepted = accepted(found)
    n_tried = len(tentative.pairs)
    if tentative.propose is not None:
        told = found.relative_poses[is_accepted]
        if certain is not None:
            told = replace(told, explained=None).then(certain)
        proposed = tentative.propose(told)
        found = _compared(found.joined(verified(proposed, "more pairs")), seen, options)
        is_accepted = accepted(found)
        n_tried += len(proposed)
    n_keypoints = sum(len(k) for k in seen.keypoints)
    return matches_of(found.where(is_accepted), n_tried, n_keypoints), known


def _compared(found: VerifiedPairs, seen: ScanKeypoints, options: MatchingOptions) -> VerifiedPairs:
    """The same with how much of both views each motion explains."""
    is_neighbour = are_neighbours(found.relative_poses.pairs, options.pairs.neighbours)
    return with_explained(found, is_neighbour, seen.grids, MAX_CONTRADICTED)


def _possible(found: VerifiedPairs, scan: Scan, odometry: Odometry) -> VerifiedPairs:
    """Those whose departure from the recorded motion drift can explain."""
    i, j = found.relative_poses.pairs.T
    recorded = se3.inverse(scan.world_from_cams[i]) @ scan.world_from_cams[j]
    sigmas = odometry.sigma_between(i, j)
    motions = found.relative_poses.a_from_b
    return found.where(is_near(motions, recorded, sigmas))
