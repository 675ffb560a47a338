"""Whether frames agree with each other: matched points lie at one place, what one camera sees, another does
not look through, and no wall is seen as two layers.

Poses that lay two rooms over each other, or bend a corridor, put walls into the free space of other views,
however well matched points fit; drift leaves two layers of a wall where the camera comes back. No plan is
needed, and nothing of this takes part in the adjustment. The idea of free space is that of surface
reconstruction and map merging (e.g. Zach et al. 2007).
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.spatial import cKDTree

from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.matching import Matches
from planfit.runtime import Arrays, Runtime, cache_key, let_go
from planfit.scan import Scan
from planfit.segmentation import WallPatches

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


_PARALLEL = np.cos(np.deg2rad(15.0))


WINDOW_M = 0.5
"""Side of the square window, m, along the wall and up."""
MIN_GAP_M = 0.03
"""Layers nearer than this, m, are one: depth cameras are off by as much from frame to frame."""
MAX_GAP_M = 0.3
"""Layers further apart, m, are two walls."""
GAP_TO_SIGMA = 2.0
"""The gap is at least this many times the standard deviation of either layer; else the wall is thick, not
double."""
MIN_FRAMES = 2
"""Each layer is seen by this many frames or more; windows seen by fewer than twice as many are not judged."""
MIN_POINTS = 5
"""Points that a frame's measurement of a window takes."""
MAX_BOTH_SHARE = 0.1
"""Share of frames that may see both layers; where more do, they are two surfaces."""


@dataclass(frozen=True)
class Layers:
    """What the windows show."""

    double_share: float
    """Windows that are double over windows judged; NaN where none could be judged."""
    n_windows: int
    """Windows judged: seen by enough frames."""
    gap_median_m: float
    """Median distance of the two layers where double; NaN where none is."""
    windows: Float[np.ndarray, "w 3"]
    """Centres, m, target frame."""
    is_double: Bool[np.ndarray, " w"]


def wall_layers(
    walls: WallPatches,
    target_from_cams: Float[np.ndarray, "n 4 4"],
) -> Layers:
    """Judge the wall patches of a scan at poses with z up, through square windows.

    In each, every frame that shows the wall gives a few measurements: how far its points lie before the
    window's plane. A window is double where these fall into two groups with a gap between them, and almost no
    frame sees both: a niche, a radiator or the edge of a door is seen with the wall behind it in the same
    frame, a wall doubled by drift never is.
    """
    positions, normals, frame_idx = _measurements(walls, target_from_cams)
    centres, gaps = [], []
    is_open = np.ones(len(positions), dtype=bool)
    tree = cKDTree(positions) if len(positions) else None
    for i in range(len(positions)):
        if tree is None or not is_open[i]:
            continue
        inside, before = _in_window(tree, positions, normals, i)
        is_open[inside] = False  # each bit of wall is judged through one window
        if len(np.unique(frame_idx[inside])) >= 2 * MIN_FRAMES:
            centres.append(positions[i])
            gaps.append(_gap(before, frame_idx[inside]))
    gap = np.array(gaps)
    is_double = gap > 0
    return Layers(
        double_share=float(is_double.mean()) if len(gap) else np.nan,
        n_windows=len(gap),
        gap_median_m=float(np.median(gap[is_double])) if is_double.any() else np.nan,
        windows=np.array(centres).reshape(-1, 3),
        is_double=is_double.reshape(-1),
    )


def _in_window(
    tree: cKDTree, positions: np.ndarray, normals: np.ndarray, i: int
) -> tuple[np.ndarray, np.ndarray]:
    """Measurements (k,) of the same side in the window about measurement i, and m before it."""
    # A ball about the window, a box of its side along and up and of the largest gap to both sides.
    near = np.array(tree.query_ball_point(positions[i], np.hypot(WINDOW_M / np.sqrt(2), MAX_GAP_M)))
    near = near[normals[near] @ normals[i] > _PARALLEL]
    step = positions[near] - positions[i]
    before = step @ normals[i]
    along = step @ np.array([-normals[i, 1], normals[i, 0], 0.0])
    inside = np.maximum(np.abs(along), np.abs(step[:, 2])) <= WINDOW_M / 2
    inside &= np.abs(before) <= MAX_GAP_M
    return near[inside], before[inside]


def _gap(before: np.ndarray, frame_idx: np.ndarray) -> float:
    """Distance (m) of the two layers among measurements (m,) of frames (m,); 0 where there are not two."""
    order = np.argsort(before)
    before, frame_idx = before[order], frame_idx[order]
    cut = int(np.argmax(np.diff(before))) + 1
    low, high = before[:cut], before[cut:]
    gap = float(high[0] - low[-1])
    sigma = max(float(np.std(low)), float(np.std(high)))
    if gap < max(MIN_GAP_M, GAP_TO_SIGMA * sigma):
        return 0.0
    frames_low, frames_high = set(frame_idx[:cut].tolist()), set(frame_idx[cut:].tolist())
    both = frames_low & frames_high
    if len(both) > MAX_BOTH_SHARE * len(frames_low | frames_high):
        return 0.0
    if min(len(frames_low - both), len(frames_high - both)) < MIN_FRAMES:
        return 0.0
    return float(np.median(high) - np.median(low))


def _measurements(
    walls: WallPatches, target_from_cams: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean position (m, 3) m, level normal (m, 3) and frame (m,) of the points of each patch in each square.

    Squares are half a window wide, so that every window holds measurements of every frame that shows it.
    """
    patch = np.repeat(np.arange(len(walls)), np.diff(walls.start))
    normals = np.einsum(
        "kij,kj->ki", target_from_cams[walls.frame_idx][:, :3, :3], walls.normals_cam
    )
    normals[:, 2] = 0.0
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    points = se3.transform_indexed(target_from_cams, walls.frame_idx[patch], walls.points_cam)
    side = WINDOW_M / 2
    along = points[:, 1] * normals[patch, 0] - points[:, 0] * normals[patch, 1]
    square = np.stack(
        [patch, np.floor(along / side).astype(int), np.floor(points[:, 2] / side).astype(int)],
        axis=1,
    )
    # Sorted by patch, then square, the points of a square follow each other and reduceat adds them.
    order = np.lexsort(square.T[::-1])
    square = square[order]
    is_first = np.concatenate([[True], (np.diff(square, axis=0) != 0).any(axis=1)])[: len(square)]
    start = np.flatnonzero(is_first)
    if len(start) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=int)
    sizes = np.diff(np.concatenate([start, [len(square)]]))
    positions = np.add.reduceat(points[order], start, axis=0) / sizes[:, None]
    kept = sizes >= MIN_POINTS
    of_patch = square[start, 0][kept]
    return positions[kept], normals[of_patch], walls.frame_idx[of_patch]
