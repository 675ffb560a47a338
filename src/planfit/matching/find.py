"""Matches of a scan: keypoints of all frames, matched over pairs, verified, and cycle-consistent."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from planfit.geometry import se3
from planfit.matching.loop_closure import cycle_consistent, is_near
from planfit.matching.options import MatchingOptions
from planfit.matching.tentative import TentativeMatches, from_colmap, from_images
from planfit.matching.types import Matches, RelativePoses
from planfit.matching.verify import match_sigma, verify
from planfit.matching.view_agreement import explained_shares
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan
from planfit.scan.odometry import Odometry


def find_matches(
    scan: Scan, odometry: Odometry, options: MatchingOptions, runtime: Runtime
) -> Matches:
    """Detect, match and verify; see the options for each step.

    Raises:
        OptionError: a learned detector or matcher cannot be had.
        ScanError: an image cannot be read, or the COLMAP files are not those of this scan.
    """
    if options.colmap:
        tentative = from_colmap(scan, Path(options.colmap).expanduser(), options, runtime)
    else:
        tentative = from_images(scan, odometry, options, runtime)

    def verified(pairs: np.ndarray, stage: str) -> _VerifiedPairs:
        return _verify_pairs(scan, tentative, pairs, odometry, options, runtime, stage)

    def accepted(found: _VerifiedPairs) -> np.ndarray:
        return cycle_consistent(
            found.relative_poses, scan.world_from_cams, odometry, options.cycle_consistency
        )

    found = _compared(verified(tentative.pairs, "pairs"), tentative, options)
    is_accepted = accepted(found)
    n_tried = len(tentative.pairs)
    if tentative.propose is not None:
        proposed = tentative.propose(found.relative_poses[is_accepted])
        found = _compared(found.joined(verified(proposed, "more pairs")), tentative, options)
        is_accepted = accepted(found)
        n_tried += len(proposed)
    return _gather(found, np.flatnonzero(is_accepted), tentative, n_tried, options)


@dataclass(frozen=True)
class _VerifiedPairs:
    """Verified pairs, in the order they were tried; points (m, 3) m of each, camera frames."""

    relative_poses: RelativePoses
    points_a: list[np.ndarray]
    points_b: list[np.ndarray]

    def joined(self, other: "_VerifiedPairs") -> "_VerifiedPairs":
        """These, then those of `other`."""
        return _VerifiedPairs(
            self.relative_poses.joined(other.relative_poses),
            self.points_a + other.points_a,
            self.points_b + other.points_b,
        )


def _compared(
    found: _VerifiedPairs, tentative: TentativeMatches, options: MatchingOptions
) -> _VerifiedPairs:
    """The same with how much of both views each motion explains."""
    relative_poses = found.relative_poses
    sigma_m = np.array(
        [
            np.median(match_sigma(a, b, options.verify))
            for a, b in zip(found.points_a, found.points_b, strict=True)
        ]
    )
    explained = explained_shares(
        relative_poses,
        found.points_a,
        found.points_b,
        sigma_m,
        relative_poses.pairs[:, 1] - relative_poses.pairs[:, 0] <= options.pairs.neighbours,
        tentative.grids,
        options.agreement,
    )
    return replace(found, relative_poses=replace(relative_poses, explained=explained))


def _gather(
    found: _VerifiedPairs,
    accepted: np.ndarray,
    tentative: TentativeMatches,
    n_tried: int,
    options: MatchingOptions,
) -> Matches:
    """Matches of the accepted pairs (k,), sorted by pair."""
    relative_poses = found.relative_poses
    pairs = relative_poses.pairs[accepted]
    accepted = accepted[
        np.lexsort((pairs[:, 1], pairs[:, 0]))
    ]  # by the first frame, then the second
    none = [np.zeros((0, 3))]
    points_a = np.concatenate([found.points_a[k] for k in accepted] or none)
    points_b = np.concatenate([found.points_b[k] for k in accepted] or none)
    return Matches(
        pairs=relative_poses.pairs[accepted],
        start=np.cumsum([0, *relative_poses.n_inliers[accepted]]),
        points_a=points_a,
        points_b=points_b,
        sigma=match_sigma(points_a, points_b, options.verify),
        n_tried=n_tried,
        n_keypoints=sum(len(k) for k in tentative.keypoints),
        sharpness=np.array([k.sharpness for k in tentative.keypoints], dtype=float),
        explained=relative_poses[accepted].explained,
    )


def _verify_pairs(
    scan: Scan,
    tentative: TentativeMatches,
    pairs: np.ndarray,
    odometry: Odometry,
    options: MatchingOptions,
    runtime: Runtime,
    stage: str,
) -> _VerifiedPairs:
    """Those of the pairs (p, 2) that hold together."""
    sigmas = (odometry.sigma_rotation.tobytes(), odometry.sigma_translation.tobytes())
    key = cache_key(
        tentative.key, "matches", options, scan.world_from_cams.tobytes(), sigmas, pairs.tobytes()
    )
    compute = partial(_verify_pair, scan, tentative, pairs, odometry, options)
    items = runtime.map(stage, key, len(pairs), compute, chunk_size=64)
    sizes = np.array([len(item["points_a"]) for item in items], dtype=int)
    some = np.flatnonzero(sizes)
    motions = np.array([items[k]["a_from_b"] for k in some]).reshape(-1, 4, 4)
    return _VerifiedPairs(
        RelativePoses(pairs[some], motions, sizes[some]),
        [items[k]["points_a"] for k in some],
        [items[k]["points_b"] for k in some],
    )


def _verify_pair(
    scan: Scan,
    tentative: TentativeMatches,
    pairs: np.ndarray,
    odometry: Odometry,
    options: MatchingOptions,
    k: int,
) -> Arrays:
    """Verified matches of one pair; none where the pair does not hold together."""
    i, j = (int(v) for v in pairs[k])
    a, b = tentative.keypoints[i], tentative.keypoints[j]
    none = {"points_a": np.zeros((0, 3)), "points_b": np.zeros((0, 3)), "a_from_b": np.eye(4)}
    idx = tentative.of_pair(i, j)
    if len(idx) < options.verify.min_inliers:
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
        options.verify,
        # By seed and pair: the result depends neither on the order of pairs nor on the number of threads.
        np.random.default_rng([options.seed, i, j]),
    )
    if motion is None or not _is_possible(motion.a_from_b, scan, odometry, i, j, options):
        return none
    return {
        "points_a": points_a[motion.is_inlier],
        "points_b": points_b[motion.is_inlier],
        "a_from_b": motion.a_from_b,
    }


def _is_possible(
    a_from_b: np.ndarray, scan: Scan, odometry: Odometry, i: int, j: int, options: MatchingOptions
) -> bool:
    """Whether drift can explain how a verified motion (4, 4) departs from the recorded one."""
    recorded = se3.inverse(scan.world_from_cams[i]) @ scan.world_from_cams[j]
    sigmas = odometry.sigma_between(np.array([i]), np.array([j]))
    return bool(is_near(a_from_b[None], recorded[None], sigmas, options.cycle_consistency)[0])
