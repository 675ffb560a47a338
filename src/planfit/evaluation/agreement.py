"""Whether frames agree with each other: matched points lie at one place, and what one camera sees, another
does not look through.

Poses that lay two rooms over each other, or bend a corridor, put walls into the free space of other views,
however well matched points fit. No plan is needed, and nothing of this takes part in the adjustment. The
idea is that of free-space violations in surface reconstruction and map merging (e.g. Zach et al. 2007).
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.spatial import cKDTree

from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.matching import Matches
from planfit.runtime import Arrays, Runtime, cache_key, let_go
from planfit.scan import Scan

MAX_VIEWS = 250
"""Maximum number of frames, evenly spread, that are looked at."""
MAX_PAIRS = 1500
"""Maximum number of their pairs, evenly taken from those that are near each other."""
REACH_M = 4.0
"""Cameras of a pair are this near to each other, m, at one set of poses or the other."""
WIDTH_PX = 64
"""Width that depth maps are shrunk to: each pixel the nearest depth of its block."""
MAX_DEPTH_M = 6.0
"""Depth beyond, m, takes no part."""
TOLERANCE_M, TOLERANCE_SHARE = 0.15, 0.03
"""A point is looked through that lies this much, m, before what the other view sees there, or this share of
the distance where that is more."""


def match_distances(
    matches: Matches, target_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, " m"]:
    """Distance (m) between the two points of each match."""
    found = np.zeros(matches.n_matches)
    for part, pair in se3.points_in_parts(matches.start):
        first, second = matches.pairs[pair].T
        points_a, points_b = matches.points_a[part], matches.points_b[part]
        a = se3.transform_each(target_from_cams[first], points_a)
        b = se3.transform_each(target_from_cams[second], points_b)
        found[part] = np.linalg.norm(a - b, axis=1)
        let_go(points_a)
        let_go(points_b)
    return found


def median_match_distance(matches: Matches, target_from_cams: Float[np.ndarray, "n 4 4"]) -> float:
    """Median distance (m) between matched points; NaN where there are no matches."""
    if matches.n_matches == 0:
        return np.nan
    return float(np.median(match_distances(matches, target_from_cams)))


@dataclass(frozen=True)
class DepthThumbnails:
    """Small depth maps of some frames of a scan."""

    frame_idx: Int[np.ndarray, " v"]
    cameras: tuple[Camera, ...]
    """Of the small maps."""
    points_cam: tuple[Float32[np.ndarray, "... 3"], ...]
    """Centres of their pixels that have a depth, m."""
    nearest_m: tuple[Float32[np.ndarray, "..."], ...]
    """Of each small map (h, w): least depth of each pixel and its neighbours; 0 where any of them has none:
    what borders on an edge or on a hole is never looked through."""


def read_thumbnails(scan: Scan, runtime: Runtime) -> DepthThumbnails:
    """Shrink depth maps, evenly spread over a scan.

    Raises:
        ScanError: a depth image cannot be used.
    """
    n = min(len(scan), MAX_VIEWS)
    frame_idx = np.unique(np.linspace(0, len(scan) - 1, n).astype(int))
    key = cache_key(scan.fingerprint, "free space", n, WIDTH_PX, MAX_DEPTH_M)
    compute = partial(_shrink, scan)
    items = runtime.map("free space", key, len(frame_idx), lambda k: compute(int(frame_idx[k])))
    cameras = tuple(_small_camera(scan.cameras[i])[0] for i in frame_idx)
    return DepthThumbnails(
        frame_idx,
        cameras,
        tuple(item["points"] for item in items),
        tuple(item["nearest"] for item in items),
    )


def near_pairs(
    poses: tuple[Float[np.ndarray, "v 4 4"], Float[np.ndarray, "v 4 4"]],
) -> Int[np.ndarray, "p 2"]:
    """Ordered pairs of views that are near and look the same way, at one set of poses or the other.

    The same pairs judge both sets: what one of them tears apart is then not lost to the count.
    """
    found = []
    for at in poses:
        pairs = cKDTree(at[:, :3, 3]).query_pairs(REACH_M, output_type="ndarray")
        looking = at[:, :3, 2]  # optical axes
        alike = np.einsum("ij,ij->i", looking[pairs[:, 0]], looking[pairs[:, 1]]) > 0.0
        found.append(pairs[alike])
    pairs = np.unique(np.concatenate(found), axis=0)
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    if len(pairs) > MAX_PAIRS:
        pairs = pairs[np.linspace(0, len(pairs) - 1, MAX_PAIRS).astype(int)]
    return pairs


def looked_through_share(
    thumbnails: DepthThumbnails,
    target_from_cams: Float[np.ndarray, "v 4 4"],
    pairs: Int[np.ndarray, "p 2"],
) -> float:
    """Of the points of first views that fall on what second views see, the share that these look through.

    Points behind what the second view sees say nothing and do not count; NaN where no view falls on another.

    Args:
        thumbnails: small depth maps.
        target_from_cams: poses of their frames.
        pairs: first and second view.
    """
    n_through = n_agree = 0
    for i, j in pairs:
        second_from_first = se3.inverse(target_from_cams[j]) @ target_from_cams[i]
        points = se3.transform(second_from_first, thumbnails.points_cam[i].astype(float))
        points = points[points[:, 2] > 0.3]
        seen_m, depth_m = _look_up(thumbnails.nearest_m[j], thumbnails.cameras[j], points)
        tolerance_m = np.maximum(TOLERANCE_M, TOLERANCE_SHARE * depth_m)
        n_through += int(np.sum(seen_m > depth_m + tolerance_m))
        n_agree += int(np.sum((seen_m > 0) & (np.abs(seen_m - depth_m) <= tolerance_m)))
    total = n_through + n_agree
    return n_through / total if total else np.nan


def _look_up(
    depth_map_m: np.ndarray, camera: Camera, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What a view sees where points (k, 3) fall on its image, and the points' own depth, m."""
    uv = np.rint(camera.project(points)).astype(int)
    inside = np.all((uv >= 0) & (uv < depth_map_m.shape[::-1]), axis=1)
    u, v = uv[inside].T
    return depth_map_m[v, u].astype(float), points[inside, 2]


def _shrink(scan: Scan, i: int) -> Arrays:
    """Points and nearest depths of the small map of frame i."""
    depth = scan.files.depth(i)
    camera, block = _small_camera(scan.cameras[i])
    rows, columns = camera.height, camera.width
    with np.errstate(invalid="ignore"):
        usable = np.where((depth > 0) & (depth < MAX_DEPTH_M), depth, np.inf)
    blocks = usable[: rows * block, : columns * block].reshape(rows, block, columns, block)
    nearest = blocks.min(axis=(1, 3))
    has_depth = np.isfinite(nearest)
    v, u = np.nonzero(has_depth)
    points = camera.lift(np.stack([u, v], axis=1).astype(float), nearest[has_depth])
    padded = np.pad(np.where(has_depth, nearest, 0.0), 1)
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).min(axis=(2, 3))
    return {"points": points.astype(np.float32), "nearest": around.astype(np.float32)}


def _small_camera(camera: Camera) -> tuple[Camera, int]:
    """The camera of a small map, and the pixels a block has each way; a rest at the border is cut off."""
    block = max(1, camera.width // WIDTH_PX)
    rows, columns = camera.height // block, camera.width // block
    cut = replace(camera, width=columns * block, height=rows * block)
    return cut.scaled(columns, rows), block
