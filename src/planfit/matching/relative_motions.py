"""Pairs of frames whose matches agree with one rigid motion, whatever the recorded poses say of it."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import ScanError
from planfit.matching.options import MatchingOptions
from planfit.matching.tentative import ScanKeypoints, find_keypoints, find_more_keypoints
from planfit.matching.types import Matches, RelativePoses
from planfit.matching.verify import MIN_INLIERS, match_sigma, verify
from planfit.matching.view_agreement import explained_shares
from planfit.matching.view_grids import ViewGrids
from planfit.runtime import SEED, Arrays, Runtime, cache_key, map_rows
from planfit.scan import Scan


@dataclass(frozen=True)
class VerifiedPairs:
    """Verified pairs of frames."""

    relative_poses: RelativePoses
    points_a: list[Float[np.ndarray, "_ 3"]]
    """Of each pair the matched points, m, camera frame of its first frame; float32, as keypoints are."""
    points_b: list[Float[np.ndarray, "_ 3"]]
    """The same of its second."""

    def __len__(self) -> int:
        return len(self.relative_poses)

    def where(self, keep: Bool[np.ndarray, " p"]) -> "VerifiedPairs":
        """Those that a mask takes."""
        kept = np.flatnonzero(keep)
        return VerifiedPairs(
            self.relative_poses[kept],
            [self.points_a[k] for k in kept],
            [self.points_b[k] for k in kept],
        )

    def joined(self, other: "VerifiedPairs") -> "VerifiedPairs":
        """These and those of `other`, sorted by pair."""
        both = self.relative_poses.then(other.relative_poses)
        order = np.lexsort((both.pairs[:, 1], both.pairs[:, 0]))
        points_a, points_b = self.points_a + other.points_a, self.points_b + other.points_b
        return VerifiedPairs(
            both[order], [points_a[k] for k in order], [points_b[k] for k in order]
        )


def match_sigmas(verified: VerifiedPairs) -> Float[np.ndarray, " p"]:
    """Standard deviation of a match of each pair, m, each axis: the median of its matches."""
    return np.array(
        [
            np.median(match_sigma(a, b))
            for a, b in zip(verified.points_a, verified.points_b, strict=True)
        ]
    )


def with_explained(
    found: VerifiedPairs,
    is_neighbour: Bool[np.ndarray, " p"],
    grids: ViewGrids,
    max_contradicted: float,
) -> VerifiedPairs:
    """The same with how much of both views each motion explains; arguments as of `explained_shares`."""
    edges, points, sigma_m = (
        found.relative_poses,
        (found.points_a, found.points_b),
        match_sigmas(found),
    )
    explained = explained_shares(edges, *points, sigma_m, is_neighbour, grids, max_contradicted)
    return replace(found, relative_poses=replace(edges, explained=explained))


def matches_of(accepted: VerifiedPairs, n_tried: int, n_keypoints: int) -> Matches:
    """Matches of accepted pairs, which are sorted by pair.

    Args:
        accepted: verified, and consistent with the others.
        n_tried: pairs that were looked at.
    """
    start = np.cumsum([0, *accepted.relative_poses.n_inliers])
    shape, sigma = (int(start[-1]), 3), np.zeros(int(start[-1]), np.float32)
    for k, (a, b) in enumerate(zip(accepted.points_a, accepted.points_b, strict=True)):
        sigma[start[k] : start[k + 1]] = match_sigma(a, b)
    return Matches(
        pairs=accepted.relative_poses.pairs,
        start=start,
        points_a=map_rows(accepted.points_a, shape, np.dtype(np.float32)),
        points_b=map_rows(accepted.points_b, shape, np.dtype(np.float32)),
        sigma=sigma,
        n_tried=n_tried,
        n_keypoints=n_keypoints,
        explained=accepted.relative_poses.explained,
    )


@dataclass(frozen=True)
class NeighbourMotions:
    """Motions between frames that follow each other, measured from images and depth alone.

    They know nothing of the recorded poses, so they can judge them.
    """

    keypoints: ScanKeypoints
    tried: Int[np.ndarray, "t 2"]
    """Pairs of frames that were matched."""
    verified: VerifiedPairs
    """Those that hold together, sorted by pair."""

    def with_more(
        self, tried: Int[np.ndarray, "t 2"], verified: VerifiedPairs
    ) -> "NeighbourMotions":
        """These and other pairs, so that none is matched twice."""
        both = np.concatenate([self.tried, tried])
        return NeighbourMotions(self.keypoints, both, self.verified.joined(verified))

    def of(self, pairs: Int[np.ndarray, "p 2"]) -> VerifiedPairs:
        """The verified among given pairs."""
        return self.verified.where(is_among(self.verified.relative_poses.pairs, pairs))


def measure_neighbours(scan: Scan, options: MatchingOptions, runtime: Runtime) -> NeighbourMotions:
    """Match each frame with the `options.pairs.neighbours` that follow it.

    Raises:
        OptionError: a learned detector or matcher cannot be had.
        ScanError: an image cannot be read, or the COLMAP files are not those of this scan.
    """
    seen = find_keypoints(scan, options, runtime)
    most = options.pairs.neighbours
    if seen.imported_pairs is None:
        pairs = _neighbouring_pairs(len(scan), most)
    else:
        pairs = seen.imported_pairs[are_neighbours(seen.imported_pairs, most)]
    verified = verify_pairs(scan, seen, pairs, options, runtime, "neighbours")
    return NeighbourMotions(seen, pairs, verified)


def measure_between(
    scan: Scan,
    known: NeighbourMotions,
    known_idx: Int[np.ndarray, " k"],
    options: MatchingOptions,
    runtime: Runtime,
) -> NeighbourMotions:
    """The same of a scan, whose frames `known_idx` are those that are known: more frames lie between them.

    Raises:
        OptionError: a learned detector or matcher cannot be had.
        ScanError: an image cannot be read, or the keypoints came from COLMAP, which has no more.
    """
    if known.keypoints.imported_pairs is not None:
        raise ScanError(f"{scan.name}: keypoints of COLMAP are those of its own frames")
    seen = find_more_keypoints(scan, known.keypoints, known_idx, options, runtime)
    relative = replace(
        known.verified.relative_poses, pairs=known_idx[known.verified.relative_poses.pairs]
    )
    renumbered = NeighbourMotions(
        seen, known_idx[known.tried], replace(known.verified, relative_poses=relative)
    )
    pairs = _neighbouring_pairs(len(scan), options.pairs.neighbours)
    return measure_more(scan, renumbered, pairs, options, runtime)


def _neighbouring_pairs(n_frames: int, most: int) -> Int[np.ndarray, "p 2"]:
    """Each frame with those that follow it, so many at most."""
    pairs = [(i, j) for i in range(n_frames) for j in range(i + 1, min(i + most + 1, n_frames))]
    return np.array(pairs).reshape(-1, 2).astype(int)


def measure_more(
    scan: Scan,
    known: NeighbourMotions,
    pairs: Int[np.ndarray, "p 2"],
    options: MatchingOptions,
    runtime: Runtime,
) -> NeighbourMotions:
    """Match further pairs, first < second, besides those that are known."""
    if known.keypoints.imported_pairs is not None:
        pairs = pairs[is_among(pairs, known.keypoints.imported_pairs)]
    new = pairs[~is_among(pairs, known.tried)]
    return known.with_more(
        new, verify_pairs(scan, known.keypoints, new, options, runtime, "neighbours")
    )


def is_among(
    pairs: Int[np.ndarray, "p 2"], others: Int[np.ndarray, "q 2"]
) -> Bool[np.ndarray, " p"]:
    """Which pairs are among others."""
    # A pair as one number, i n + j, so that a set of pairs is a set of numbers.
    n = 1 + max((int(p.max()) for p in (pairs, others) if len(p)), default=0)
    return np.isin(pairs @ (n, 1), others @ (n, 1))


def are_neighbours(pairs: Int[np.ndarray, "p 2"], neighbours: int) -> Bool[np.ndarray, " p"]:
    """Which pairs, first < second, are so near in time that they are no revisits."""
    return pairs[:, 1] - pairs[:, 0] <= neighbours


def verify_pairs(
    scan: Scan,
    seen: ScanKeypoints,
    pairs: Int[np.ndarray, "p 2"],
    options: MatchingOptions,
    runtime: Runtime,
    stage: str,
) -> VerifiedPairs:
    """Those of the pairs that hold together, in their order. Poses have no say in it."""
    key = cache_key(seen.key, stage, "float32", options.matcher, options.device, pairs.tobytes())
    compute = partial(_verify_pair, scan, seen, pairs)
    items = runtime.map(stage, key, len(pairs), compute, chunk_size=64)
    sizes = np.array([len(item["points_a"]) for item in items], dtype=int)
    some = np.flatnonzero(sizes)
    motions = np.array([items[k]["a_from_b"] for k in some]).reshape(-1, 4, 4)
    return VerifiedPairs(
        RelativePoses(pairs[some], motions, sizes[some]),
        [items[k]["points_a"] for k in some],
        [items[k]["points_b"] for k in some],
    )


def _verify_pair(scan: Scan, seen: ScanKeypoints, pairs: np.ndarray, k: int) -> Arrays:
    """Verified matches of one pair; none where the pair does not hold together."""
    i, j = (int(v) for v in pairs[k])
    a, b = seen.keypoints[i], seen.keypoints[j]
    nowhere = np.zeros((0, 3), np.float32)
    none = {"points_a": nowhere, "points_b": nowhere, "a_from_b": np.eye(4)}
    idx = seen.of_pair(i, j)
    if len(idx) < MIN_INLIERS:
        return none
    points_a = a.points_cam[idx[:, 0]].astype(float)
    points_b = b.points_cam[idx[:, 1]].astype(float)
    motion = verify(
        points_a,
        points_b,
        a.uv[idx[:, 0]],
        b.uv[idx[:, 1]],
        scan.cameras[i],
        scan.cameras[j],
        # By seed and pair: the result depends neither on the order of pairs nor on the number of threads.
        np.random.default_rng([SEED, i, j]),
    )
    if motion is None:
        return none
    agreeing = idx[motion.is_inlier]
    return {
        "points_a": a.points_cam[agreeing[:, 0]],
        "points_b": b.points_cam[agreeing[:, 1]],
        "a_from_b": motion.a_from_b,
    }
