"""Scans that are placed against each other as one scan, with all that was observed in them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.geometry import se3
from planfit.matching import Matches, RelativePoses, SurfacePairs, relative_poses_of
from planfit.matching.between_scans import (
    ScansSeen,
    accept_between,
    pairs_between,
    verify_between,
)
from planfit.matching.relative_motions import VerifiedPairs
from planfit.matching.tentative import describe_views, join_keypoints
from planfit.pipeline.observations import Observations
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.together.observed import ObservedScan
from planfit.runtime import SEED, Runtime
from planfit.scan import Scan
from planfit.scan.joined import FramesOfScan, join_scans
from planfit.scan.odometry import Odometry
from planfit.scan.views import select_frames
from planfit.segmentation.joined import join_structures
from planfit.tracking.joined import join_trackings

PLACED_RAD, PLACED_M = np.deg2rad(3.0), 0.5
"""Sigmas of the step between two scans that were placed, where matches between them are sought: as far as
drift lets the votes of one link disagree."""


@dataclass(frozen=True)
class JoinedScans:
    """Several scans as one."""

    scan: Scan
    frames: tuple[FramesOfScan, ...]
    joined_from_worlds: tuple[Float[np.ndarray, "4 4"], ...]
    """From the axes of each scan to those of the first."""
    observations: Observations


def see_together(observed: Sequence[ObservedScan], options: RefineOptions) -> ScansSeen:
    """The keyframes of several scans, for matching between them; poses are those of each scan's own world."""
    keys = [
        select_frames(
            each.corrected_scan, each.keyframe_idx, each.scan.world_from_cams[each.keyframe_idx]
        )
        for each in observed
    ]
    scan, _ = join_scans(keys, [each.name for each in observed], [np.eye(4)] * len(keys))
    keypoints = join_keypoints(
        scan.cameras, [each.keypoints for each in observed], options.matching
    )
    rng = np.random.default_rng(SEED)
    descriptors = describe_views(scan.cameras, keypoints.keypoints, rng)
    of_scan = np.repeat(np.arange(len(keys)), [len(own) for own in keys])
    return ScansSeen(scan, of_scan, keypoints, descriptors)


def match_between(
    observed: Sequence[ObservedScan],
    joined_from_levels: Sequence[Float[np.ndarray, "4 4"]],
    seen: ScansSeen,
    known: VerifiedPairs,
    options: RefineOptions,
    runtime: Runtime,
) -> Matches:
    """Matches between keyframes of scans that are placed, numbered as in `seen`.

    Args:
        observed: the scans, all of which are placed.
        joined_from_levels: where.
        seen: their keyframes.
        known: pairs that were verified before.
        options: of matching.
        runtime: threads, cache and progress.
    """
    poses = np.concatenate(
        [
            move @ each.prepared.level_from_keys
            for move, each in zip(joined_from_levels, observed, strict=True)
        ]
    )
    odometry = _placed_odometry(observed, poses)
    pairs = pairs_between(seen, poses, odometry, options.matching)
    found = verify_between(seen, pairs, known, options.matching, runtime)
    within = _within(observed)
    accepted = accept_between(found, within, poses, odometry)
    return replace(accepted, n_tried=len(pairs))


def join_observed(
    observed: Sequence[ObservedScan],
    joined_from_levels: Sequence[Float[np.ndarray, "4 4"]],
    between: Matches | None,
) -> JoinedScans:
    """One scan of several, in the world of the first.

    Args:
        observed: the scans, in their order.
        joined_from_levels: from the level frame of each to that of the first.
        between: matches between their keyframes, these numbered one scan after the other.
    """
    first = observed[0]
    world_from_level = se3.inverse(first.level_from_world)
    worlds = [
        world_from_level @ move @ each.level_from_world
        for move, each in zip(joined_from_levels, observed, strict=True)
    ]
    worlds[0] = np.eye(4)  # exactly: the world of the first is the joined one
    names, scans = [each.name for each in observed], [each.corrected_scan for each in observed]
    scan, frames = join_scans(scans, names, worlds)
    seen = [each.observations for each in observed]
    keys = np.concatenate(
        [each.keyframe_idx + own.first for each, own in zip(observed, frames, strict=True)]
    )
    matches, surfaces = Matches.none(), SurfacePairs.none()
    for own, each in zip(frames, seen, strict=True):
        every = np.arange(own.first, own.last + 1)
        matches = matches.joined(each.matches.numbered(every))
        surfaces = surfaces.joined(each.surfaces.numbered(every))
    if between is not None:
        matches = matches.joined(between.numbered(keys))
    least_sure = min((each.gravity for each in seen), key=lambda gravity: gravity.confidence)
    observations = Observations(
        gravity=replace(seen[0].gravity, confidence=least_sure.confidence),
        structure=join_structures(
            [each.structure for each in seen], seen[0].structure.floor_height_m
        ),
        matches=matches,
        tracking=join_trackings([each.tracking for each in observed], frames, worlds),
        surfaces=surfaces,
        keyframe_idx=None if len(keys) == len(scan) else keys,
    )
    return JoinedScans(scan, frames, tuple(worlds), observations)


def offsets_of(observed: Sequence[ObservedScan]) -> Int[np.ndarray, " s"]:
    """Number of the first keyframe of each scan, one scan after the other, and that of the end."""
    return np.cumsum([0, *(len(each.keyframe_idx) for each in observed)])


def _within(observed: Sequence[ObservedScan]) -> RelativePoses:
    """Motions between keyframes of one scan, those of each scan after the other."""
    parts = [
        (relative_poses_of(each.prepared.measurements.matches), first)
        for each, first in zip(observed, offsets_of(observed)[:-1], strict=True)
    ]
    return RelativePoses(
        np.concatenate([own.pairs + first for own, first in parts]),
        np.concatenate([own.a_from_b for own, _ in parts]),
        np.concatenate([own.n_inliers for own, _ in parts]),
        np.concatenate(
            [np.ones(len(own)) if own.explained is None else own.explained for own, _ in parts]
        ),
    )


def _placed_odometry(
    observed: Sequence[ObservedScan], joined_from_keys: Float[np.ndarray, "k 4 4"]
) -> Odometry:
    """Steps between all keyframes; those from scan to scan as sure as the scans are placed."""
    steps = se3.inverse(joined_from_keys[:-1]) @ joined_from_keys[1:]
    rotation, translation = np.full(len(steps), PLACED_RAD), np.full(len(steps), PLACED_M)
    for each, first in zip(observed, offsets_of(observed)[:-1], strict=True):
        own = each.prepared.measurements.odometry
        of = slice(first, first + len(own.sigma_rotation))
        rotation[of], translation[of] = own.sigma_rotation, own.sigma_translation
    return Odometry(steps, rotation, translation)
