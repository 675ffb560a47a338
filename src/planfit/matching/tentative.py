"""Keypoints of a scan, which frames are tried with which, and their matches before they are verified."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from jaxtyping import Int

from planfit.geometry.camera import Camera
from planfit.matching.colmap import Imported, read_colmap_matches, stamp
from planfit.matching.covisibility import sample_views
from planfit.matching.detect import (
    KeypointOptions,
    detect,
    lift,
    make_detector,
    no_keypoints,
    without_descriptors,
)
from planfit.matching.loop_closure import propose_loop_closures
from planfit.matching.matchers import make_matcher
from planfit.matching.options import MatchingOptions
from planfit.matching.pairs import FrameDescriptors, choose_pairs, distinct_views
from planfit.matching.retrieval import describe_frames
from planfit.matching.types import Detector, KeptKeypoints, Matcher, RelativePoses
from planfit.matching.view_grids import ViewGrids, depth_grid, gather_grids, grey_grid
from planfit.runtime import SEED, Arrays, Runtime, StoredItem, blas_on_one_thread, cache_key
from planfit.scan import Scan
from planfit.scan.odometry import Odometry
from planfit.scan.views import select_frames

_STORED = ("descriptors", "depth_grid")
"""Of what is found in a frame, the parts that are read where they are needed: five sixths."""
FRAMES_AT_HAND = 32
"""Frames whose descriptors are kept from one pair to the next, 40 kB each."""


@dataclass(frozen=True)
class ScanKeypoints:
    """Keypoints of all frames and how those of two frames are matched: nothing here knows of poses."""

    keypoints: list[KeptKeypoints]
    """Of each frame."""
    grids: ViewGrids
    """What each frame shows, coarsely."""
    of_pair: Callable[[int, int], Int[np.ndarray, "m 2"]]
    """Matches of the keypoints of a pair of frames."""
    imported_pairs: Int[np.ndarray, "p 2"] | None
    """The only pairs that have matches, first < second; None where any two frames can be matched."""
    key: str
    """Changes with whatever the keypoints depend on."""

    def of_frames(self, frame_idx: Int[np.ndarray, " f"]) -> "ScanKeypoints":
        """Those of some frames, of which any two can be matched."""
        key = cache_key(self.key, "some frames", frame_idx.tobytes())
        return ScanKeypoints(
            [self.keypoints[k] for k in frame_idx],
            self.grids[frame_idx],
            lambda i, j: self.of_pair(int(frame_idx[i]), int(frame_idx[j])),
            None,
            key,
        )


@dataclass(frozen=True)
class TentativePairs:
    """Which frames are tried with which."""

    pairs: Int[np.ndarray, "p 2"]
    """Frame indices, first < second."""
    propose: Callable[[RelativePoses], Int[np.ndarray, "q 2"]] | None
    """Given what was accepted, further pairs to try."""


def find_keypoints(scan: Scan, options: MatchingOptions, runtime: Runtime) -> ScanKeypoints:
    """Keypoints of our own, or those of COLMAP where the options name its files.

    Raises:
        OptionError: a learned detector or matcher cannot be had.
        ScanError: an image cannot be read, or the COLMAP files are not those of this scan.
    """
    if options.colmap:
        return _from_colmap(scan, Path(options.colmap).expanduser(), options, runtime)
    return _from_images(scan, options, runtime)


def choose_tentative(
    scan: Scan, seen: ScanKeypoints, odometry: Odometry, options: MatchingOptions
) -> TentativePairs:
    """Pairs of frames to try: by recorded poses and by what the frames show, or those of COLMAP."""
    if seen.imported_pairs is not None:
        return TentativePairs(seen.imported_pairs, None)
    descriptors = describe_views(scan.cameras, seen.keypoints, np.random.default_rng(SEED))
    pairs = choose_pairs(scan.world_from_cams, odometry, options.pairs, descriptors)

    def propose(accepted: RelativePoses) -> Int[np.ndarray, "q 2"]:
        views = distinct_views(scan.world_from_cams, odometry.walked_m, descriptors.sharpness)
        return propose_loop_closures(
            accepted,
            pairs,
            views.frame_idx,
            scan.world_from_cams,
            descriptors.samples,
            options.pairs,
        )

    return TentativePairs(pairs, propose)


def _from_images(scan: Scan, options: MatchingOptions, runtime: Runtime) -> ScanKeypoints:
    detector = make_detector(options.keypoints, options.device)
    matcher = make_matcher(options.matcher, options.device)
    key = cache_key(scan.fingerprint, "keypoints and grids", options.keypoints, options.device)
    compute = partial(_detect_frame, scan, options.keypoints, detector)
    items = runtime.map_stored("keypoints", key, len(scan), compute, _STORED, chunk_size=16)
    keypoints = [_keypoints(item) for item in items]
    of_pair = _pair_matcher(scan.cameras, keypoints, matcher)
    return ScanKeypoints(keypoints, _gather(items, scan.cameras), of_pair, None, key)


def find_more_keypoints(
    scan: Scan,
    seen: ScanKeypoints,
    known_idx: Int[np.ndarray, " k"],
    options: MatchingOptions,
    runtime: Runtime,
) -> ScanKeypoints:
    """Keypoints of our own of a scan, given those of its frames `known_idx`; the other images are opened.

    Raises:
        OptionError: a learned detector or matcher cannot be had.
        ScanError: an image cannot be read.
    """
    new_idx = np.setdiff1d(np.arange(len(scan)), known_idx)
    new_scan = select_frames(scan, new_idx, scan.world_from_cams[new_idx])
    new = _from_images(new_scan, options, runtime)
    order = np.argsort(np.concatenate([known_idx, new_idx]))
    both = seen.keypoints + new.keypoints
    keypoints = [both[k] for k in order]
    of_pair = _pair_matcher(scan.cameras, keypoints, make_matcher(options.matcher, options.device))
    grids = seen.grids.joined(new.grids)[order]
    key = cache_key(scan.fingerprint, "more keypoints", seen.key, new.key)
    return ScanKeypoints(keypoints, grids, of_pair, None, key)


def join_keypoints(
    cameras: Sequence[Camera], seen: Sequence[ScanKeypoints], options: MatchingOptions
) -> ScanKeypoints:
    """Keypoints of our own of several scans as those of one, frame after frame.

    Args:
        seen: of each scan.
    """
    keypoints = [each for scan in seen for each in scan.keypoints]
    grids = seen[0].grids
    for scan in seen[1:]:
        grids = grids.joined(scan.grids)
    of_pair = _pair_matcher(cameras, keypoints, make_matcher(options.matcher, options.device))
    keys = [scan.key for scan in seen]
    key = cache_key(keys[0], "joined keypoints", *keys[1:]) if all(keys) else ""
    return ScanKeypoints(keypoints, grids, of_pair, None, key)


def _pair_matcher(
    cameras: Sequence[Camera], keypoints: list[KeptKeypoints], matcher: Matcher
) -> Callable[[int, int], Int[np.ndarray, "m 2"]]:
    """Matches of two frames, whose descriptors are read; those of the last few frames are at hand.

    Pairs come sorted: one after the other, most have a frame in common.
    """
    read = lru_cache(maxsize=FRAMES_AT_HAND)(lambda k: keypoints[k].read())

    def of_pair(i: int, j: int) -> Int[np.ndarray, "m 2"]:
        size_a, size_b = ((c.width, c.height) for c in (cameras[i], cameras[j]))
        return matcher(read(i), read(j), size_a, size_b)

    return of_pair


def _from_colmap(
    scan: Scan, path: Path, options: MatchingOptions, runtime: Runtime
) -> ScanKeypoints:
    """From COLMAP; keypoints without depth are dropped, and their matches with them."""
    imported = read_colmap_matches(path, scan)
    key = cache_key(
        scan.fingerprint, "imported keypoints and grids", stamp(path), options.keypoints
    )
    compute = partial(_lift_frame, scan, imported, options.keypoints)
    items = runtime.map_stored("keypoints", key, len(scan), compute, _STORED, chunk_size=16)
    keypoints = [_keypoints(item) for item in items]
    # From COLMAP's number of a keypoint to ours among those that kept a depth; -1 for the others.
    number = [np.full(len(uv), -1) for uv in imported.uv]
    for new, item in zip(number, items, strict=True):
        kept = item.arrays["kept"]
        new[kept] = np.arange(len(kept))

    by_pair = dict(zip(map(tuple, imported.pairs.tolist()), imported.matches, strict=True))

    def of_pair(i: int, j: int) -> Int[np.ndarray, "m 2"]:
        idx = by_pair[i, j]
        both = np.column_stack([number[i][idx[:, 0]], number[j][idx[:, 1]]])
        return both[(both >= 0).all(axis=1)]

    return ScanKeypoints(
        keypoints,
        _gather(items, scan.cameras),
        of_pair,
        imported.pairs,
        key,
    )


def describe_views(
    cameras: Sequence[Camera], keypoints: list[KeptKeypoints], rng: np.random.Generator
) -> FrameDescriptors:
    """What is known of frames besides their poses, from their keypoints."""
    with blas_on_one_thread():
        vectors = describe_frames([k.stored_descriptors for k in keypoints], rng)
    return FrameDescriptors(
        vectors,
        np.array([k.sharpness for k in keypoints], dtype=float),
        sample_views([k.points_cam for k in keypoints], cameras),
    )


def _keypoints(item: StoredItem) -> KeptKeypoints:
    """Of what was kept of a frame, the keypoints."""
    found, descriptors = item.arrays, item.stored["descriptors"]
    return KeptKeypoints(
        found["uv"],
        found["points_cam"],
        found["scores"],
        descriptors,
        np.float32(found["sharpness"]),
    )


def _gather(items: Sequence[StoredItem], cameras: Sequence[Camera]) -> ViewGrids:
    depths_m = (item.stored["depth_grid"].read() for item in items)
    return gather_grids(depths_m, [item.arrays["grey_grid"] for item in items], cameras)


def _grids(color: np.ndarray | None, depth: np.ndarray) -> Arrays:
    return {"depth_grid": depth_grid(depth), "grey_grid": grey_grid(color)}


def _detect_frame(scan: Scan, options: KeypointOptions, detector: Detector, i: int) -> Arrays:
    color, depth = scan.files.color(i), scan.files.depth(i)
    if color is None:
        found = no_keypoints(options.kind)
    else:
        found = detect(color, depth, scan.cameras[i], options, detector)
    return {**vars(found), **_grids(color, depth)}


def _lift_frame(scan: Scan, imported: Imported, options: KeypointOptions, i: int) -> Arrays:
    color, depth = scan.files.color(i), scan.files.depth(i)
    lifted, kept = lift(color, depth, scan.cameras[i], options, without_descriptors(imported.uv[i]))
    return {**vars(lifted), **_grids(color, depth), "kept": kept}
