"""Distance of scanned walls to the plan (NSD), and flatness of the scanned floor."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np

from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.segmentation import Structure

_CHUNK = 300_000
"""Points placed at a time by a thread: each takes a transform of its own, 128 bytes."""


@dataclass(frozen=True)
class WallDistances:
    """Means over the scan's wall points, the paper's P_W; all of them, not a sample."""

    nsd_m: float
    """Mean distance to the nearest segment of the plan, its ends included."""
    oriented_nsd_m: float
    """Mean distance to the nearest segment whose free side the camera is on; segments without a known side
    count from both. NaN where no such segment is on the plan."""
    n_points: int


@dataclass(frozen=True)
class FloorFlatness:
    """Floor points of all frames, the paper's P_F, each storey's brought to height 0."""

    height_rms_m: float
    """Root mean square about their mean height: a floor that is bent or leans."""
    plane_rms_m: float
    """Root mean square about the plane that fits them best: a floor that is bent."""
    n_points: int


def wall_distances(
    structure: Structure, floorplan: Floorplan, plan_from_cams: np.ndarray, workers: int = 1
) -> WallDistances | None:
    """Distances of all wall points to the plan at poses (n, 4, 4); None where no wall was seen.

    `workers` (threads) change no bit of the result.
    """
    walls = structure.walls
    frame_idx = np.concatenate([walls.point_frame_idx, structure.unassigned_frame_idx])
    points_cam = np.concatenate([walls.points_cam, structure.unassigned_points_cam])
    if len(points_cam) == 0:
        return None

    def total_of(part: slice) -> np.ndarray:
        xy = se3.transform_each(plan_from_cams[frame_idx[part]], points_cam[part])[:, :2]
        eyes = plan_from_cams[frame_idx[part], :2, 3]
        return nearest_distances(xy, eyes, floorplan).sum(axis=0)

    with ThreadPoolExecutor(workers) as pool:
        totals = list(pool.map(total_of, _chunks(len(points_cam))))
    nsd, oriented = np.sum(totals, axis=0) / len(points_cam)
    return WallDistances(
        float(nsd), float(oriented) if np.isfinite(oriented) else np.nan, len(points_cam)
    )


def nearest_distances(xy: np.ndarray, eyes_xy: np.ndarray, floorplan: Floorplan) -> np.ndarray:
    """Distances (m, 2) m of points (m, 2) seen from eyes (m, 2): to the nearest segment, and to the nearest
    that looks at the eye (infinite where none does)."""
    return _nearest(
        np.ascontiguousarray(xy, dtype=float),
        np.ascontiguousarray(eyes_xy, dtype=float),
        np.ascontiguousarray(floorplan.ends, dtype=float),
        np.ascontiguousarray(floorplan.normals, dtype=float),
        np.asarray(floorplan.offsets, dtype=float),
        np.asarray(floorplan.is_oriented, dtype=bool),
    )


def floor_flatness(structure: Structure, target_from_cams: np.ndarray) -> FloorFlatness | None:
    """How flat the floor is at poses (n, 4, 4), z up; None where fewer than three points are on storeys."""
    frame_idx, points_cam = structure.floor.frame_idx, structure.floor.points_cam
    storey = structure.floor_heights_m[frame_idx]
    on_storey = np.isfinite(storey)  # others are on stairs, and belong to no plane
    if on_storey.sum() < 3:
        return None
    points = np.concatenate(
        [
            se3.transform_each(target_from_cams[frame_idx[part]], points_cam[part])[on_storey[part]]
            for part in _chunks(len(points_cam))
        ]
    )
    height = points[:, 2] - storey[on_storey]
    xy = points[:, :2] - points[:, :2].mean(axis=0)
    design = np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
    plane = np.linalg.lstsq(design.T @ design, design.T @ height, rcond=None)[0]
    off = height - design @ plane
    return FloorFlatness(float(np.std(height)), float(np.sqrt(np.mean(off**2))), len(points))


def _chunks(n: int) -> list[slice]:
    return [slice(first, first + _CHUNK) for first in range(0, n, _CHUNK)]


@numba.njit(cache=True, nogil=True)
def _nearest(
    xy, eyes, ends, normals, offsets, is_oriented
):  # pragma: no cover - compiled; has a NumPy twin in the tests
    result = np.full((len(xy), 2), np.inf)
    block = 1024  # points that stay in the nearest cache while all faces pass by
    for first in range(0, len(xy), block):
        x, y = xy[first : first + block, 0].copy(), xy[first : first + block, 1].copy()
        u, v = eyes[first : first + block, 0].copy(), eyes[first : first + block, 1].copy()
        near, facing = np.full(len(x), np.inf), np.full(len(x), np.inf)
        for n in range(len(ends)):
            ax, ay = ends[n, 0, 0], ends[n, 0, 1]
            dx, dy = ends[n, 1, 0] - ax, ends[n, 1, 1] - ay
            length_sq = dx * dx + dy * dy
            scale = 1.0 / length_sq if length_sq > 0 else 0.0
            nx, ny, offset = normals[n, 0], normals[n, 1], offsets[n]
            if not is_oriented[n]:
                nx, ny, offset = 0.0, 0.0, -1.0  # looks at every eye
            for m in range(len(x)):  # without branches, so that it runs four abreast
                px, py = x[m] - ax, y[m] - ay
                t = (px * dx + py * dy) * scale
                t = t if t > 0.0 else 0.0
                t = t if t < 1.0 else 1.0
                px, py = px - t * dx, py - t * dy
                distance_sq = px * px + py * py
                near[m] = distance_sq if distance_sq < near[m] else near[m]
                seen = distance_sq if nx * u[m] + ny * v[m] > offset else np.inf
                facing[m] = seen if seen < facing[m] else facing[m]
        result[first : first + block, 0] = np.sqrt(near)
        result[first : first + block, 1] = np.sqrt(facing)
    return result
