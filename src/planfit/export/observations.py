"""From matches of pairs to points that several images observe, as structure from motion has them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from planfit.geometry import se3
from planfit.matching import Matches
from planfit.matching.verify import MAX_REPROJECTION_PX
from planfit.scan import Scan

SAME_KEYPOINT_M = 1e-4
"""Matches of one keypoint in several pairs hold the same point, up to how it is stored."""
MAX_ERROR_PX = MAX_REPROJECTION_PX
"""Observations further off are left out, as COLMAP's filter does."""


@dataclass(frozen=True)
class Observations:
    """Points in the target frame, and where each was seen."""

    points: Float[np.ndarray, "p 3"]
    error_px: Float[np.ndarray, " p"]
    """Mean distance between where a point was seen and where it projects to."""
    point_idx: Int[np.ndarray, " o"]
    """Of each observation, sorted by frame."""
    frame_idx: Int[np.ndarray, " o"]
    uv: Float[np.ndarray, "o 2"]
    """px; an integer is a pixel's centre."""


def observe(
    scan: Scan, target_from_cams: Float[np.ndarray, "n 4 4"], matches: Matches
) -> Observations:
    """Keypoints that matches join are one point, at the mean of where depth puts it.

    A point that one image would see twice is none: a wrong match joined two. At least two images see each.
    """
    frames, points_cam, track = _tracks(matches)
    placed = np.zeros((len(frames), 3))
    uv = np.zeros((len(frames), 2))
    for i in np.unique(frames):
        mine = frames == i
        placed[mine] = se3.transform(target_from_cams[i], points_cam[mine])
        uv[mine] = scan.cameras[i].project(points_cam[mine])
    keep = _seen_once(frames, track)
    # Once more without what is too far off, whose points move.
    for _ in range(2):
        points, track_of_kept = _means(placed[keep], track[keep])
        error = _errors(scan, target_from_cams, frames[keep], uv[keep], points[track_of_kept])
        keep[np.flatnonzero(keep)[error > MAX_ERROR_PX]] = False
        counts = np.bincount(track[keep], minlength=track.max(initial=0) + 1)
        keep &= counts[track] >= 2
    points, point_idx = _means(placed[keep], track[keep])
    error = _errors(scan, target_from_cams, frames[keep], uv[keep], points[point_idx])
    order = np.argsort(frames[keep], kind="stable")
    n_seen = np.bincount(point_idx, minlength=len(points))
    return Observations(
        points,
        np.bincount(point_idx, error, len(points)) / np.maximum(n_seen, 1),
        point_idx[order],
        frames[keep][order],
        uv[keep][order],
    )


def _tracks(
    matches: Matches,
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k 3"], Int[np.ndarray, " k"]]:
    """Frame, point in its camera, and number of the track of each keypoint."""
    pair_of = np.repeat(np.arange(len(matches.pairs)), np.diff(matches.start))
    frames = matches.pairs[pair_of].T.ravel()  # all first frames, then all second ones
    points = np.concatenate([matches.points_a, matches.points_b]).astype(float)
    keys = np.column_stack([frames, np.rint(points / SAME_KEYPOINT_M)]).astype(np.int64)
    _, first, keypoint = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    m, n = len(pair_of), len(first)
    joined = coo_array((np.ones(m), (keypoint.ravel()[:m], keypoint.ravel()[m:])), shape=(n, n))
    _, track = connected_components(joined, directed=False)
    return frames[first].astype(int), points[first], track.astype(int)


def _seen_once(frames: Int[np.ndarray, " k"], track: Int[np.ndarray, " k"]) -> np.ndarray:
    """Whether the track of each keypoint has no two in one image."""
    _, inverse, counts = np.unique(
        np.column_stack([track, frames]), axis=0, return_inverse=True, return_counts=True
    )
    is_twice = np.zeros(track.max(initial=0) + 1, dtype=bool)
    is_twice[track[counts[inverse.ravel()] > 1]] = True
    return ~is_twice[track]


def _means(
    placed: Float[np.ndarray, "k 3"], track: Int[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, "p 3"], Int[np.ndarray, " k"]]:
    """Mean of each track's points, and which is whose."""
    names, point_idx = np.unique(track, return_inverse=True)
    point_idx = point_idx.ravel()
    counts = np.bincount(point_idx, minlength=len(names))[:, None]
    sums = [np.bincount(point_idx, placed[:, axis], len(names)) for axis in range(3)]
    return np.column_stack(sums) / counts, point_idx


def _errors(
    scan: Scan,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    frames: Int[np.ndarray, " k"],
    uv: Float[np.ndarray, "k 2"],
    points: Float[np.ndarray, "k 3"],
) -> Float[np.ndarray, " k"]:
    """px between where points were seen and where they project to; infinite behind the camera."""
    error = np.full(len(frames), np.inf)
    for i in np.unique(frames):
        mine = np.flatnonzero(frames == i)
        inside = se3.transform(se3.inverse(target_from_cams[i]), points[mine])
        ahead = inside[:, 2] > 0
        projected = scan.cameras[i].project(inside[ahead])
        error[mine[ahead]] = np.linalg.norm(projected - uv[mine[ahead]], axis=1)
    return error
