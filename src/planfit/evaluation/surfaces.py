"""Distance of scanned walls to the plan (NSD), and flatness of the scanned floor.

These are the metrics of walls and floor for the whole program: the checks of a run, its record, its report
and `planfit evaluate` take them from here. They are means over **all** points, never over a sample: a
sample's NSD differs by a few per cent with where the thinning begins, and a million points take 0.3 s
against 400 faces.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float, Int

from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import facing_distances
from planfit.geometry import se3
from planfit.runtime import let_go, row_parts
from planfit.segmentation import Structure

NEAR_FACE_M = 0.10
"""A wall point this near to a face of the plan counts as one of its points."""


@dataclass(frozen=True)
class WallDistances:
    """Distances of the scan's wall points, the paper's P_W, to the plan; there is at least one point."""

    nearest_m: Float[np.ndarray, " m"]
    """To the nearest face, as a segment: its ends included."""
    facing_m: Float[np.ndarray, " m"]
    """To the nearest face whose free side the camera is on; faces without a known side count from both.
    Infinite where there is no such face."""

    @property
    def nsd_m(self) -> float:
        """Mean distance to the nearest face (NSD; paper, Sec. IV-B)."""
        return float(self.nearest_m.mean())

    @property
    def oriented_nsd_m(self) -> float:
        """Mean distance to the nearest face that looks at the camera; NaN where any point has none."""
        mean = float(self.facing_m.mean())
        return mean if np.isfinite(mean) else np.nan

    @property
    def near_share(self) -> float:
        """Share of wall points within `NEAR_FACE_M` of the plan."""
        return float(np.mean(self.nearest_m < NEAR_FACE_M))

    @property
    def n_points(self) -> int:
        """Wall points, on flat patches and unassigned."""
        return len(self.nearest_m)


@dataclass(frozen=True)
class FloorHeights:
    """Floor points, the paper's P_F, each storey's brought to height 0; three points or more."""

    points: Float[np.ndarray, "m 3"]
    """m, target frame, but heights are above the floor of the storey that the camera stands on."""

    @property
    def heights_m(self) -> Float[np.ndarray, " m"]:
        """Above the floor plane of the storey."""
        return self.points[:, 2]

    @property
    def height_rms_m(self) -> float:
        """Root mean square about their mean height: a floor that is bent or leans."""
        return float(np.std(self.heights_m))

    @cached_property
    def plane_rms_m(self) -> float:
        """Root mean square about the plane that fits them best: a floor that is bent."""
        # About the centroid, so that the normal equations stay well-conditioned far from the origin.
        xy = self.points[:, :2] - self.points[:, :2].mean(axis=0)
        design = np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
        plane = np.linalg.lstsq(design.T @ design, design.T @ self.heights_m, rcond=None)[0]
        return float(np.sqrt(np.mean((self.heights_m - design @ plane) ** 2)))

    @property
    def height_median_m(self) -> float:
        """Half of the points lie within this of their median height (MAD); things on the floor move it less.

        Not of height 0: poses that are given without a plan have an origin of their own.
        """
        return float(np.median(np.abs(self.heights_m - np.median(self.heights_m))))

    @property
    def n_points(self) -> int:
        """Floor points on storeys; those seen from stairs do not count."""
        return len(self.points)


def wall_points(
    structure: Structure, target_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "m 3"]:
    """All wall points (m) of a scan, the paper's P_W, in the target frame: on patches, then unassigned."""
    parts = [
        se3.transform_each(target_from_cams[frame_idx], points_cam)
        for frame_idx, points_cam in _wall_points_cam(structure)
    ]
    return np.concatenate([np.zeros((0, 3)), *parts])


def wall_frame_idx(structure: Structure) -> Int[np.ndarray, " m"]:
    """Frame of each wall point, in the order of `wall_points` and `wall_distances`."""
    return np.concatenate([structure.walls.point_frame_idx, structure.unassigned_frame_idx])


def wall_distances(
    structure: Structure,
    floorplan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    workers: int = 1,
) -> WallDistances | None:
    """Distances of all wall points to the plan, in the order of `wall_points`; None where no wall was seen.

    Where plan and scan have storeys, each point is held against the faces of its own one. `workers`
    (threads) change no bit of the result.
    """
    if structure.n_wall_points == 0:
        return None
    with ThreadPoolExecutor(workers) as pool:
        distances = partial(_distances, structure, floorplan, plan_from_cams)
        found = np.concatenate(list(pool.map(distances, _wall_points_cam(structure))))
    return WallDistances(found[:, 0], found[:, 1])


def near_share(
    structure: Structure, floorplan: Floorplan, plan_from_cams: Float[np.ndarray, "n 4 4"]
) -> float:
    """`WallDistances.near_share` alone, without a number for each point; NaN where no wall was seen."""
    n_near = 0
    for part in _wall_points_cam(structure):
        nearest_m = _distances(structure, floorplan, plan_from_cams, part)[:, 0]
        n_near += int(np.count_nonzero(nearest_m < NEAR_FACE_M))
    return n_near / structure.n_wall_points if structure.n_wall_points else np.nan


def _distances(
    structure: Structure,
    floorplan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    part: tuple[np.ndarray, np.ndarray],
) -> Float[np.ndarray, "m 2"]:
    """Of some wall points, frame (m,) and point (m, 3) m each, to the nearest and the nearest facing face."""
    frame_idx, points_cam = part
    xy = se3.transform_each(plan_from_cams[frame_idx], points_cam)[:, :2]
    eyes = plan_from_cams[frame_idx, :2, 3]
    storeys = None if structure.storeys is None else structure.storeys[frame_idx]
    return facing_distances(xy, eyes, floorplan, storeys)


def floor_heights(
    structure: Structure, target_from_cams: Float[np.ndarray, "n 4 4"]
) -> FloorHeights | None:
    """Floor points (z up) above the floor of their storeys; None where fewer than three are on storeys."""
    frame_idx, points_cam = structure.floor.frame_idx, structure.floor.points_cam
    storey = structure.floor_heights_m[frame_idx]
    on_storey = np.isfinite(storey)  # others are on stairs, and belong to no plane
    if on_storey.sum() < 3:
        return None
    points = se3.transform_indexed(target_from_cams, frame_idx, points_cam)
    if not on_storey.all():
        points = points[on_storey]
    points[:, 2] -= storey[on_storey]
    return FloorHeights(points)


def _wall_points_cam(structure: Structure) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Frame (m,) and point (m, 3) m, camera frame, of each wall point, some at a time."""
    walls, first = structure.walls, 0
    for part, patch in se3.points_in_parts(walls.start):
        yield walls.frame_idx[patch], walls.points_cam[part]
        let_go(walls.points_cam[part])
    for points in row_parts(structure.unassigned_points_cam):
        yield structure.unassigned_frame_idx[first : first + len(points)], points
        first += len(points)
