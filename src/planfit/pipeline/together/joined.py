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
from planfit.runtime import SEED, Runtime, concatenated
from planfit.scan import Scan
from planfit.scan.joined import FramesOfScan, join_scans
from planfit.scan.odometry import Odometry
from planfit.scan.views import select_frames
from planfit.segmentation.types import LevelPoints, Structure, WallPatches
from planfit.tracking.types import Tracking, submaps_of

PLACED_RAD, PLACED_M = np.deg2rad(3.0), 0.5
"""Sigmas of the step between two scans that were placed, where matches between them are sought: as far as
drift lets the votes of one link disagree."""
_APART_RAD, APART_M = 1.0, 10.0
"""Sigmas of the step from the last frame of a scan to the first of the next: it says nothing, beside a
degree and a centimetre of others, and holds a scan that nothing else does."""


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


@dataclass(frozen=True)
class ScansTogether:
    """Several scans, and what their keyframes show of each other."""

    observed: tuple[ObservedScan, ...]
    seen: ScansSeen
    """Their keyframes."""
    verified: VerifiedPairs
    """Pairs between them, numbered as in `seen`."""
    options: RefineOptions
    runtime: Runtime

    def of(self, scans: Sequence[int]) -> "ScansTogether":
        """Some of the scans alone."""
        observed, seen, verified = tuple(self.observed[k] for k in scans), self.seen, self.verified
        is_own = np.isin(seen.of_scan, scans)
        if not is_own.all():
            number = np.cumsum(is_own) - 1
            first, second = verified.relative_poses.pairs.T
            verified = verified.where(is_own[first] & is_own[second])
            pairs = number[verified.relative_poses.pairs]
            relative = replace(verified.relative_poses, pairs=pairs)
            seen = seen.of_frames(np.flatnonzero(is_own))
            verified = replace(verified, relative_poses=relative)
        return replace(self, observed=observed, seen=seen, verified=verified)

    def match(self, joined_from_levels: Sequence[Float[np.ndarray, "4 4"]]) -> Matches:
        """Matches between keyframes of scans that are all placed, numbered as in `seen`."""
        placed = zip(joined_from_levels, self.observed, strict=True)
        poses = np.concatenate([move @ each.prepared.level_from_keys for move, each in placed])
        odometry, matching = _placed_odometry(self.observed, poses), self.options.matching
        pairs = pairs_between(self.seen, poses, odometry, matching)
        found = verify_between(self.seen, pairs, self.verified, matching, self.runtime)
        accepted = accept_between(found, _within(self.observed), poses, odometry)
        return replace(accepted, n_tried=len(pairs))


def join_observed(
    observed: Sequence[ObservedScan],
    joined_from_levels: Sequence[Float[np.ndarray, "4 4"]],
    between: Matches | None,
) -> JoinedScans:
    """One scan of several, in the world of the first.

    Args:
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


def join_trackings(
    trackings: Sequence[Tracking],
    scans: Sequence[FramesOfScan],
    joined_from_worlds: Sequence[Float[np.ndarray, "4 4"]],
) -> Tracking:
    """One tracking of all frames, in the joined world.

    Findings of breaks name their scan. What was found of clocks and conventions is each
    scan's own.

    Args:
        trackings: of the scans, in their order.
    """
    moves, firsts = list(joined_from_worlds), [scan.first for scan in scans]
    recorded, poses = (
        np.concatenate([move @ getattr(t, name) for move, t in zip(moves, trackings, strict=True)])
        for name in ("recorded_world_from_cams", "world_from_cams")
    )
    borders = np.array(firsts[1:], dtype=int) - 1
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    rotation, translation = np.full(len(steps), _APART_RAD), np.full(len(steps), APART_M)
    for tracking, scan in zip(trackings, scans, strict=True):
        of = slice(scan.first, scan.last)
        steps[of] = tracking.odometry.cam_from_next
        rotation[of] = tracking.odometry.sigma_rotation
        translation[of] = tracking.odometry.sigma_translation
    open_steps, undecided, contradicted = (
        np.concatenate([getattr(t, name) + f for t, f in zip(trackings, firsts, strict=True)])
        for name in ("open_steps", "undecided_steps", "contradicted_steps")
    )
    breaks = [
        replace(
            found,
            first_frame=found.first_frame + scan.first,
            last_frame=found.last_frame + scan.first,
            finding=found.finding.about(scan.name),
        )
        for tracking, scan in zip(trackings, scans, strict=True)
        for found in tracking.breaks
    ]
    own_links = [
        (a + first, b + first)
        for tracking, first in zip(trackings, firsts, strict=True)
        for a, b in tracking.linked
    ]
    mains = [_main_frame(t) + first for t, first in zip(trackings, firsts, strict=True)]
    return Tracking(
        recorded_world_from_cams=recorded,
        world_from_cams=poses,
        odometry=Odometry(steps, rotation, translation),
        sigma_factors=(
            max(t.sigma_factors[0] for t in trackings),
            max(t.sigma_factors[1] for t in trackings),
        ),
        breaks=tuple(breaks),
        n_motions=sum(t.n_motions for t in trackings),
        open_steps=np.union1d(open_steps, borders).astype(int),
        undecided_steps=undecided,
        contradicted_steps=contradicted,
        n_repeated=sum(t.n_repeated for t in trackings),
        n_held=sum(t.n_held for t in trackings),
        # Between the scans nothing was tracked, but what is placed of each is placed against the others.
        linked=(*own_links, *((mains[0], other) for other in mains[1:])),
    )


def _main_frame(tracking: Tracking) -> int:
    """A frame of the largest part of a scan that hangs together."""
    submap = submaps_of(len(tracking.world_from_cams), tracking.open_steps, tracking.linked)
    return int(np.argmax(submap == np.argmax(np.bincount(submap))))


def join_structures(structures: Sequence[Structure], floor_height_m: float) -> Structure:
    """The structure of the frames of several scans, each of which stands on one storey.

    Args:
        structures: of the scans, one or more, in their order.
        floor_height_m: of the joined world, turned level.
    """
    offsets = np.cumsum([0, *(len(s.floor.start) - 1 for s in structures)])[:-1]
    # Of labels from several back ends, what is expected of the less exact ones holds for all.
    back_ends = [s.back_end for s in structures]
    return Structure(
        floor=_joined_levels([s.floor for s in structures]),
        floor_heights_m=np.concatenate([s.floor_heights_m for s in structures]),
        walls=_joined_patches([s.walls for s in structures], offsets),
        unassigned_points_cam=concatenated([s.unassigned_points_cam for s in structures]),
        unassigned_frame_idx=np.concatenate(
            [s.unassigned_frame_idx + k for s, k in zip(structures, offsets, strict=True)]
        ),
        ceiling=_joined_levels([s.ceiling for s in structures]),
        columns=_joined_patches([s.columns for s in structures], offsets),
        back_end=next((name for name in back_ends if name != "masks"), "masks"),
        floor_height_m=floor_height_m,
        floor_pieces=tuple(sorted({piece for s in structures for piece in s.floor_pieces})),
        drifted_floors_m=tuple(sorted({h for s in structures for h in s.drifted_floors_m})),
    )


def _joined_levels(levels: Sequence[LevelPoints]) -> LevelPoints:
    sizes = np.concatenate([np.diff(level.start) for level in levels])
    points = concatenated([level.points_cam for level in levels])
    return LevelPoints(points, np.cumsum([0, *sizes]))


def _joined_patches(patches: Sequence[WallPatches], offsets: Int[np.ndarray, " s"]) -> WallPatches:
    sizes = np.concatenate([np.diff(each.start) for each in patches])
    frames = [each.frame_idx + k for each, k in zip(patches, offsets, strict=True)]
    return WallPatches(
        points_cam=concatenated([each.points_cam for each in patches]),
        start=np.cumsum([0, *sizes]),
        frame_idx=np.concatenate(frames),
        normals_cam=np.concatenate([each.normals_cam for each in patches]),
        ends_cam=np.concatenate([each.ends_cam for each in patches]),
    )
