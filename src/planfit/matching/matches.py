"""Keypoints of all frames, matched over pairs and verified: the paper's set M."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from planfit.errors import require
from planfit.geometry import se3
from planfit.matching.cycles import CycleOptions, Loops, agree_with_cycles
from planfit.matching.detectors import Detector
from planfit.matching.keypoints import KeypointOptions, Keypoints, detect, make_detector
from planfit.matching.matchers import Matcher, MatcherOptions, make_matcher
from planfit.matching.overlap import sample_views
from planfit.matching.pairs import Looks, PairOptions, choose_pairs
from planfit.matching.retrieval import describe_frames
from planfit.matching.verify import VerifyOptions, point_sigma, verify
from planfit.scan import Scan
from planfit.scan.odometry import Odometry
from planfit.work import Arrays, Work, cache_key


@dataclass(frozen=True)
class MatchingOptions:
    """How matches between frames are found and verified."""

    keypoints: KeypointOptions = field(default_factory=KeypointOptions)
    """Which keypoints are kept."""
    matcher: MatcherOptions = field(default_factory=MatcherOptions)
    """How keypoints of two frames are matched."""
    pairs: PairOptions = field(default_factory=PairOptions)
    """Which frames are tried with which."""
    verify: VerifyOptions = field(default_factory=VerifyOptions)
    """When matches are believed."""
    cycles: CycleOptions = field(default_factory=CycleOptions)
    """Which loops are look-alikes: their motion departs from what else is known by more than its spread."""
    seed: int = 0
    """Seed of the random choices."""

    def __post_init__(self) -> None:
        require(
            self.matcher.kind == "nearest" or self.keypoints.kind == "superpoint",
            f"MatchingOptions.matcher.kind: {self.matcher.kind} matches superpoint keypoints only, "
            f"found keypoints.kind {self.keypoints.kind}; set it to superpoint",
        )


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


def find_matches(scan: Scan, odometry: Odometry, options: MatchingOptions, work: Work) -> Matches:
    """Detect, match and verify; see the options for each step.

    Raises:
        OptionError: a learned detector or matcher cannot be had.
        ScanError: an image cannot be read.
    """
    detector, matcher = make_detector(options.keypoints), make_matcher(options.matcher)
    key = cache_key("keypoints", scan.fingerprint, options.keypoints)
    compute = partial(_detect_frame, scan, options.keypoints, detector)
    items = work.map("keypoints", key, len(scan), compute, chunk_size=16)
    keypoints = [Keypoints(**item) for item in items]
    sharpness = np.array([k.sharpness for k in keypoints], dtype=float)
    appearance = describe_frames(
        [k.descriptors for k in keypoints], np.random.default_rng(options.seed)
    )
    samples = sample_views([k.points_cam for k in keypoints], scan.cameras)
    looks = Looks(appearance, sharpness, samples)
    pairs = choose_pairs(scan.world_from_cams, odometry, options.pairs, looks)
    spreads = (odometry.sigma_turn.tobytes(), odometry.sigma_shift.tobytes())
    key = cache_key("matches", key, options, scan.world_from_cams.tobytes(), spreads)
    compute = partial(_match_pair, scan, keypoints, pairs, odometry, options, matcher)
    found = work.map("pairs", key, len(pairs), compute, chunk_size=64)
    sizes = np.array([len(item["points_a"]) for item in found], dtype=int)
    some = np.flatnonzero(sizes)
    motions = np.array([found[k]["a_from_b"] for k in some]).reshape(-1, 4, 4)
    loops = Loops(pairs[some], motions, sizes[some])
    some = some[agree_with_cycles(loops, scan.world_from_cams, odometry, options.cycles)]
    points = {
        name: np.concatenate([found[k][name] for k in some] or [np.zeros((0, 3))])
        for name in ("points_a", "points_b")
    }
    spread = partial(point_sigma, options=options.verify)
    return Matches(
        pairs=pairs[some],
        start=np.cumsum([0, *sizes[some]]),
        sigma=np.hypot(spread(points["points_a"][:, 2]), spread(points["points_b"][:, 2])),
        n_tried=len(pairs),
        n_keypoints=sum(len(k) for k in keypoints),
        sharpness=sharpness,
        **points,
    )


def _detect_frame(scan: Scan, options: KeypointOptions, detector: Detector, i: int) -> Arrays:
    color, depth = scan.files.color(i), scan.files.depth(i)
    return vars(detect(color, depth, scan.cameras[i], options, detector))


def _match_pair(
    scan: Scan,
    keypoints: list[Keypoints],
    pairs: np.ndarray,
    odometry: Odometry,
    options: MatchingOptions,
    matcher: Matcher,
    k: int,
) -> Arrays:
    """Verified matches of one pair; none where the pair does not hold together."""
    i, j = (int(v) for v in pairs[k])
    a, b = keypoints[i], keypoints[j]
    none = {"points_a": np.zeros((0, 3)), "points_b": np.zeros((0, 3)), "a_from_b": np.eye(4)}
    size_a, size_b = ((c.width, c.height) for c in (scan.cameras[i], scan.cameras[j]))
    idx = matcher(a, b, size_a, size_b)
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
    sigma_turn, sigma_shift = odometry.spread_between(np.array(i), np.array(j))
    turn = float(se3.rotation_angle(recorded[:3, :3].T @ a_from_b[:3, :3]))
    shift = float(np.linalg.norm(recorded[:3, 3] - a_from_b[:3, 3]))
    most = options.cycles.max_sigmas
    return bool(
        turn < most * sigma_turn + np.deg2rad(options.cycles.slack_deg)
        and shift < most * sigma_shift + options.cycles.slack_m
    )
