"""Floor, wall and ceiling pixels of a frame from geometry, given what its submap shows."""

import numpy as np
from jaxtyping import Float, UInt8

from planfit.priors import SURFACE_TILT_MOST_DEG
from planfit.scan import Label
from planfit.segmentation.label_kernels import grow_labels, label_level, label_walls
from planfit.segmentation.surfaces import Surfaces
from planfit.segmentation.visibility_map import Submap

MAX_TILT_DEG = SURFACE_TILT_MOST_DEG.value
"""A floor's normal is within this of up, a wall's within this of level."""
_FLOOR_BAND_M = 0.15
"""Level surfaces within this of the floor's height nearby are floor, of the ceiling's ceiling; leaves
room for drift in height within a submap."""
_TOLERANCE_M = 0.03
"""Pixels without a sure normal belong to the floor, wall or ceiling beside them within this of its
plane, plus `_TOLERANCE_PER_M2` of their squared depth."""
_TOLERANCE_PER_M2 = 0.003
"""Growth of that tolerance with depth: the noise of depth cameras."""
_GROW_PX = 12
"""How far floor, walls and ceiling grow over such pixels, for images 320 px wide."""
_MIN_SEEDS = 3000
"""A plane is fitted to at least this many points where there are as many, and to less than twice."""


def label_by_geometry(
    surfaces: Surfaces,
    centre: Float[np.ndarray, "3"],
    submap: Submap,
) -> UInt8[np.ndarray, "h w"]:
    """Labels of a frame's surfaces: floor, wall, ceiling, or none.

    `centre` is where the camera is in the world turned upright, the frame of `submap`.
    """
    points, normals = surfaces.points, surfaces.normals
    height = points[..., 2] + centre[2]
    sine = np.sin(np.deg2rad(MAX_TILT_DEG))
    labels = np.full(height.shape, Label.NONE, dtype=np.uint8)
    planes = np.zeros((*height.shape, 4), dtype=np.float32)  # that each labelled pixel lies on
    with np.errstate(invalid="ignore"):
        tolerance = _TOLERANCE_M + _TOLERANCE_PER_M2 * surfaces.depth**2
    is_wall = submap.wall_at(points[..., :2] + centre[:2])
    label_walls(labels, planes, points, normals, sine, is_wall, int(Label.WALL))
    _label_levels(labels, planes, surfaces, height, tolerance, submap)
    grow = max(1, round(_GROW_PX * points.shape[1] / 320))
    grow_labels(labels, planes, points, normals, tolerance, grow)
    return labels


def _label_levels(
    labels: np.ndarray,
    planes: np.ndarray,
    surfaces: Surfaces,
    height: np.ndarray,
    tolerance: np.ndarray,
    submap: Submap,
) -> None:
    """Label floor and ceilings (h, w) with the plane fitted to each (h, w, 4), in place."""
    points = surfaces.points
    nz = np.ascontiguousarray(surfaces.normals[..., 2])
    cosine = np.cos(np.deg2rad(MAX_TILT_DEG))
    levels = [(Label.FLOOR, submap.floor_m, 1.0)]
    levels += [(Label.CEILING, z, -1.0) for z in submap.ceilings_m]
    for label, level_m, facing in levels:
        with np.errstate(invalid="ignore"):
            near = np.abs(height - level_m) < _FLOOR_BAND_M
            seeds = np.flatnonzero(near & (facing * nz > cosine))
        some = seeds[:: max(1, len(seeds) // _MIN_SEEDS)]
        plane = _level_plane(points.reshape(-1, 3)[some].astype(float))
        if plane is not None:
            label_level(labels, planes, points, nz, near, tolerance, plane, facing, int(label))


def to_full_size(
    labels: UInt8[np.ndarray, "h2 w2"], step_px: int, shape: tuple[int, int]
) -> UInt8[np.ndarray, "h w"]:
    """Labels of a thinned image at the size of its depth image."""
    full = np.repeat(np.repeat(labels, step_px, axis=0), step_px, axis=1)
    missing = (max(0, shape[0] - full.shape[0]), max(0, shape[1] - full.shape[1]))
    if any(missing):
        full = np.pad(full, ((0, missing[0]), (0, missing[1])), mode="edge")
    return full[: shape[0], : shape[1]]


def _level_plane(points: np.ndarray) -> np.ndarray | None:
    """Nearly level plane (normal, offset) (4,) float32 through points (n, 3) m; None for too few.

    Drifted poses are off by a degree: a floor that is level in the building is not in the world.
    """
    if len(points) < 100:
        return None
    middle = np.array([*points[:, :2].mean(axis=0), np.median(points[:, 2])])
    near = np.abs(points[:, 2] - middle[2]) < 0.1
    slope = np.zeros(2)
    for _ in range(3):
        if near.sum() < 50:
            return None
        xy, z = points[near, :2] - middle[:2], points[near, 2] - middle[2]
        scatter = xy.T @ xy + 0.5 * len(xy) * np.eye(2)  # small patches stay level
        slope = np.clip(np.linalg.solve(scatter, xy.T @ (z - z.mean())), -0.05, 0.05)
        middle[2] += np.median(z - xy @ slope)
        off = points[:, 2] - middle[2] - (points[:, :2] - middle[:2]) @ slope
        near = np.abs(off) < 0.05
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1 + slope @ slope)
    return np.array([*normal, normal @ middle], dtype=np.float32)
