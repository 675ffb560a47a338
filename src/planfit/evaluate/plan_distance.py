"""Distance of scanned walls to the plan (NSD), and flatness of the scanned floor."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import facing_distances
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
        return facing_distances(xy, eyes, floorplan).sum(axis=0)

    with ThreadPoolExecutor(workers) as pool:
        totals = list(pool.map(total_of, _chunks(len(points_cam))))
    nsd, oriented = np.sum(totals, axis=0) / len(points_cam)
    return WallDistances(
        float(nsd), float(oriented) if np.isfinite(oriented) else np.nan, len(points_cam)
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
