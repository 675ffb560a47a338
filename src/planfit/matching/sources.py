"""Where keypoints, pairs and tentative matches come from: our own, or imported from COLMAP."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from planfit.matching.colmap import Imported, read_colmap_matches, stamp
from planfit.matching.covisibility import sample_views
from planfit.matching.detectors import Detector, without_descriptors
from planfit.matching.guided_proposals import around_loops
from planfit.matching.keypoints import (
    KeypointOptions,
    Keypoints,
    detect,
    lift,
    make_detector,
)
from planfit.matching.loop_closure import RelativePoses
from planfit.matching.matchers import make_matcher
from planfit.matching.options import MatchingOptions
from planfit.matching.pairs import FrameDescriptors, choose_pairs
from planfit.matching.retrieval import describe_frames
from planfit.matching.views import distinct_views
from planfit.runtime import Arrays, Runtime, blas_on_one_thread, cache_key
from planfit.scan import Scan
from planfit.scan.odometry import Odometry

Tentative = Callable[[int, int], np.ndarray]
"""Matches (m, 2) of the keypoints of a pair of frames, before they are verified."""


@dataclass(frozen=True)
class Source:
    """Where tentative matches come from."""

    keypoints: list[Keypoints]
    pairs: np.ndarray  # (p, 2) to be tried
    tentative: Tentative
    more: Callable[[RelativePoses], np.ndarray] | None
    """Given what was believed, further pairs to try."""
    key: str
    """Changes with whatever the keypoints depend on."""


def own_source(
    scan: Scan, odometry: Odometry, options: MatchingOptions, runtime: Runtime
) -> Source:
    """Keypoints, pairs and matches of our own."""
    detector, matcher = make_detector(options.keypoints), make_matcher(options.matcher)
    key = cache_key("keypoints", scan.fingerprint, options.keypoints)
    compute = partial(_detect_frame, scan, options.keypoints, detector)
    items = runtime.map("keypoints", key, len(scan), compute, chunk_size=16)
    keypoints = [Keypoints(**item) for item in items]
    rng = np.random.default_rng(options.seed)
    with blas_on_one_thread():
        appearance = describe_frames([k.descriptors for k in keypoints], rng)
    looks = FrameDescriptors(
        appearance,
        np.array([k.sharpness for k in keypoints], dtype=float),
        sample_views([k.points_cam for k in keypoints], scan.cameras),
    )
    pairs = choose_pairs(scan.world_from_cams, odometry, options.pairs, looks)

    def tentative(i: int, j: int) -> np.ndarray:
        size_a, size_b = ((c.width, c.height) for c in (scan.cameras[i], scan.cameras[j]))
        return matcher(keypoints[i], keypoints[j], size_a, size_b)

    def more(believed: RelativePoses) -> np.ndarray:
        views = distinct_views(scan.world_from_cams, odometry.walked_m, looks.sharpness)
        return around_loops(
            believed, pairs, views.frame_idx, scan.world_from_cams, looks.samples, options.pairs
        )

    return Source(keypoints, pairs, tentative, more, key)


def imported_source(scan: Scan, path: Path, options: MatchingOptions, runtime: Runtime) -> Source:
    """The same from COLMAP; keypoints without depth are dropped, and their matches with them."""
    imported = read_colmap_matches(path, scan)
    key = cache_key("imported keypoints", scan.fingerprint, stamp(path), options.keypoints)
    compute = partial(_lift_frame, scan, imported, options.keypoints)
    items = runtime.map("keypoints", key, len(scan), compute, chunk_size=16)
    keypoints = [
        Keypoints(**{name: value for name, value in item.items() if name != "kept"})
        for item in items
    ]
    number = [np.full(len(uv), -1) for uv in imported.uv]
    for new, item in zip(number, items, strict=True):
        new[item["kept"]] = np.arange(len(item["kept"]))

    of_pair = dict(zip(map(tuple, imported.pairs.tolist()), imported.matches, strict=True))

    def tentative(i: int, j: int) -> np.ndarray:
        idx = of_pair[i, j]
        both = np.column_stack([number[i][idx[:, 0]], number[j][idx[:, 1]]])
        return both[(both >= 0).all(axis=1)]

    return Source(keypoints, imported.pairs, tentative, None, key)


def _detect_frame(scan: Scan, options: KeypointOptions, detector: Detector, i: int) -> Arrays:
    color, depth = scan.files.color(i), scan.files.depth(i)
    return vars(detect(color, depth, scan.cameras[i], options, detector))


def _lift_frame(scan: Scan, imported: Imported, options: KeypointOptions, i: int) -> Arrays:
    color, depth = scan.files.color(i), scan.files.depth(i)
    lifted, kept = lift(color, depth, scan.cameras[i], options, without_descriptors(imported.uv[i]))
    return {**vars(lifted), "kept": kept}
