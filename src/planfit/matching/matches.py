"""Keypoints of all frames, matched over pairs and verified: the paper's set M."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from planfit.geometry import se3
from planfit.matching.loop_closure import RelativePoses, agree_with_cycles
from planfit.matching.options import MatchingOptions
from planfit.matching.sources import Source, imported_source, own_source
from planfit.matching.verify import point_sigma, verify
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class Matches:
    """Verified matches, sorted by pair: `points_a` in the frame of the first of the pair."""

    pairs: np.ndarray  # (p, 2) frame indices, first < second
    start: np.ndarray  # (p + 1,): matches of pair k are start[k]:start[k + 1]
    points_a: np.ndarray  # (m, 3) m, camera frame of pairs[k, 0]
    points_b: np.ndarray  # (m, 3) m, camera frame of pairs[k, 1]
    sigma: np.ndarray  # (m,) m, spread of points_a - points_b, each axis
    n_tried: int
    """Pairs of frames that were tried."""
    n_keypoints: int
    """Keypoints with depth, over all frames."""
    sharpness: np.ndarray | None = None
    """(n,) how sharp each frame's image is, where it was looked at."""

    @property
    def n_matches(self) -> int:
        """Number of verified matches."""
        return len(self.points_a)

    def n_loops(self, neighbours: int) -> int:
        """Verified pairs that are further apart in time than `neighbours` frames."""
        return int(np.sum(self.pairs[:, 1] - self.pairs[:, 0] > neighbours))


def find_matches(
    scan: Scan, odometry: Odometry, options: MatchingOptions, runtime: Runtime
) -> Matches:
    """Detect, match and verify; see the options for each step.

    Raises:
        OptionError: a learned detector or matcher cannot be had.
        ScanError: an image cannot be read, or the COLMAP files are not those of this scan.
    """
    if options.colmap:
        source = imported_source(scan, Path(options.colmap).expanduser(), options, runtime)
    else:
        source = own_source(scan, odometry, options, runtime)
    found = _verified(scan, source, source.pairs, odometry, options, runtime, "pairs")
    believed = _believed(found, scan, odometry, options)
    n_tried = len(source.pairs)
    if source.more is not None:
        more = source.more(found.loops[believed])
        found = found.joined(
            _verified(scan, source, more, odometry, options, runtime, "more pairs")
        )
        believed = _believed(found, scan, odometry, options)
        n_tried += len(more)
    some = np.flatnonzero(believed)
    pairs = found.loops.pairs[some]
    some = some[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    sizes = found.loops.n_inliers[some]
    points = {
        name: np.concatenate([getattr(found, name)[k] for k in some] or [np.zeros((0, 3))])
        for name in ("points_a", "points_b")
    }
    spread = partial(point_sigma, options=options.verify)
    return Matches(
        pairs=found.loops.pairs[some],
        start=np.cumsum([0, *sizes]),
        sigma=np.hypot(spread(points["points_a"][:, 2]), spread(points["points_b"][:, 2])),
        n_tried=n_tried,
        n_keypoints=sum(len(k) for k in source.keypoints),
        sharpness=np.array([k.sharpness for k in source.keypoints], dtype=float),
        **points,
    )


@dataclass(frozen=True)
class _Found:
    """Verified pairs, in the order they were tried."""

    loops: RelativePoses
    points_a: list[np.ndarray]
    points_b: list[np.ndarray]

    def joined(self, other: "_Found") -> "_Found":
        fields = ("pairs", "a_from_b", "n_inliers")
        both = (np.concatenate([getattr(f.loops, name) for f in (self, other)]) for name in fields)
        return _Found(
            RelativePoses(*both), self.points_a + other.points_a, self.points_b + other.points_b
        )


def _verified(
    scan: Scan,
    source: Source,
    pairs: np.ndarray,
    odometry: Odometry,
    options: MatchingOptions,
    runtime: Runtime,
    stage: str,
) -> _Found:
    """Those of the pairs that hold together."""
    spreads = (odometry.sigma_rotation.tobytes(), odometry.sigma_translation.tobytes())
    key = cache_key(
        "matches", source.key, options, scan.world_from_cams.tobytes(), spreads, pairs.tobytes()
    )
    compute = partial(_verify_pair, scan, source, pairs, odometry, options)
    items = runtime.map(stage, key, len(pairs), compute, chunk_size=64)
    sizes = np.array([len(item["points_a"]) for item in items], dtype=int)
    some = np.flatnonzero(sizes)
    motions = np.array([items[k]["a_from_b"] for k in some]).reshape(-1, 4, 4)
    return _Found(
        RelativePoses(pairs[some], motions, sizes[some]),
        [items[k]["points_a"] for k in some],
        [items[k]["points_b"] for k in some],
    )


def _believed(
    found: _Found, scan: Scan, odometry: Odometry, options: MatchingOptions
) -> np.ndarray:
    return agree_with_cycles(found.loops, scan.world_from_cams, odometry, options.cycles)


def _verify_pair(
    scan: Scan,
    source: Source,
    pairs: np.ndarray,
    odometry: Odometry,
    options: MatchingOptions,
    k: int,
) -> Arrays:
    """Verified matches of one pair; none where the pair does not hold together."""
    i, j = (int(v) for v in pairs[k])
    a, b = source.keypoints[i], source.keypoints[j]
    none = {"points_a": np.zeros((0, 3)), "points_b": np.zeros((0, 3)), "a_from_b": np.eye(4)}
    idx = source.tentative(i, j)
    if len(idx) < options.verify.min_inliers:
        return none
    points_a, points_b = (
        a.points_cam[idx[:, 0]].astype(float),
        b.points_cam[idx[:, 1]].astype(float),
    )
    motion = verify(
        points_a,
        points_b,
        a.uv[idx[:, 0]],
        b.uv[idx[:, 1]],
        scan.cameras[i],
        scan.cameras[j],
        options.verify,
        np.random.default_rng([options.seed, i, j]),
    )
    if motion is None:
        return none
    recorded = se3.inverse(scan.world_from_cams[i]) @ scan.world_from_cams[j]
    if not _is_possible(motion.a_from_b, recorded, odometry, i, j, options):
        return none
    return {
        "points_a": points_a[motion.is_inlier],
        "points_b": points_b[motion.is_inlier],
        "a_from_b": motion.a_from_b,
    }


def _is_possible(
    a_from_b: np.ndarray,
    recorded: np.ndarray,
    odometry: Odometry,
    i: int,
    j: int,
    options: MatchingOptions,
) -> bool:
    """Whether drift can explain how a verified motion departs from the recorded one."""
    sigma_rotation, sigma_translation = odometry.sigma_between(np.array(i), np.array(j))
    turn = float(se3.rotation_angle(recorded[:3, :3].T @ a_from_b[:3, :3]))
    shift = float(np.linalg.norm(recorded[:3, 3] - a_from_b[:3, 3]))
    most = options.cycles.max_sigmas
    return bool(
        turn < most * sigma_rotation + np.deg2rad(options.cycles.slack_deg)
        and shift < most * sigma_translation + options.cycles.slack_m
    )
