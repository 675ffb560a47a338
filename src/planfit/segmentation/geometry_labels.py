"""Floor, wall and ceiling pixels of a frame from geometry, given what its stretch of the scan shows."""

from dataclasses import dataclass

import numba
import numpy as np

from planfit.errors import require_positive
from planfit.scan import Label
from planfit.segmentation.surfaces import Surfaces
from planfit.segmentation.visibility_map import Stretch


@dataclass(frozen=True)
class GeometryLabelOptions:
    """What counts as floor, wall and ceiling by its geometry."""

    normal_radius_px: int = 3
    """Half the baseline of a normal, for images 320 px wide; larger is steadier and blurs corners."""
    max_tilt_deg: float = 15.0
    """A floor's normal is within this of up, a wall's within this of level."""
    floor_band_m: float = 0.15
    """Level surfaces within this of the floor's height nearby are floor, of the ceiling's ceiling; leaves
    room for drift in height within a stretch of frames."""
    tolerance_m: float = 0.03
    """Pixels without a sure normal belong to the floor, wall or ceiling beside them within this of its
    plane, plus `tolerance_per_m2` of their squared depth."""
    tolerance_per_m2: float = 0.003
    """Growth of that tolerance with depth: the noise of depth cameras."""
    grow_px: int = 12
    """How far floor, walls and ceiling grow over such pixels, for images 320 px wide."""
    free_above_m: float = 0.15
    """What cameras see past the top of by more than this is furniture; what they never see over is wall."""
    min_wall_rise_m: float = 0.4
    """Upright surfaces seen over a smaller range of heights are no wall."""
    stretch_frames: int = 32
    """Frames whose sights are put together; fewer know less, more suffer from drift."""

    def __post_init__(self) -> None:
        require_positive(
            self,
            "normal_radius_px",
            "max_tilt_deg",
            "floor_band_m",
            "tolerance_m",
            "free_above_m",
            "min_wall_rise_m",
            "stretch_frames",
        )


MIN_SEEDS = 3000
"""A plane is fitted to at least this many points where there are as many, and to less than twice."""


def label_by_geometry(
    surfaces: Surfaces,
    centre: np.ndarray,
    stretch: Stretch,
    options: GeometryLabelOptions,
) -> np.ndarray:
    """Labels (h', w') uint8 of a frame's surfaces: floor, wall, ceiling, or none.

    `centre` (3,) is where the camera is in the world turned upright, the frame of `stretch`.
    """
    points, normals = surfaces.points, surfaces.normals
    nz = np.ascontiguousarray(normals[..., 2])
    height = points[..., 2] + centre[2]
    cosine, sine = (
        np.cos(np.deg2rad(options.max_tilt_deg)),
        np.sin(np.deg2rad(options.max_tilt_deg)),
    )
    labels = np.full(height.shape, Label.NONE, dtype=np.uint8)
    planes = np.zeros((*height.shape, 4), dtype=np.float32)
    with np.errstate(invalid="ignore"):
        tolerance = options.tolerance_m + options.tolerance_per_m2 * surfaces.depth**2
    is_wall = stretch.wall_at(points[..., :2] + centre[:2])
    _lay_walls(labels, planes, points, normals, sine, is_wall, int(Label.WALL))
    levels = [(Label.FLOOR, stretch.floor_m, 1.0)]
    levels += [(Label.CEILING, z, -1.0) for z in stretch.ceilings_m]
    for label, level_m, facing in levels:
        with np.errstate(invalid="ignore"):
            near = np.abs(height - level_m) < options.floor_band_m
            seeds = np.flatnonzero(near & (facing * nz > cosine))
        some = seeds[:: max(1, len(seeds) // MIN_SEEDS)]
        plane = _level_plane(points.reshape(-1, 3)[some].astype(float))
        if plane is not None:
            _lay_level(labels, planes, points, nz, near, tolerance, plane, facing, int(label))
    grow = max(1, round(options.grow_px * points.shape[1] / 320))
    _grow(labels, planes, points, normals, tolerance, grow)
    return labels


def to_full_size(labels: np.ndarray, step_px: int, shape: tuple[int, int]) -> np.ndarray:
    """Labels of a thinned image at the size (h, w) of its depth image."""
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


@numba.njit(cache=True, nogil=True)
def _lay_walls(
    labels: np.ndarray,
    planes: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    tilt_sine: float,
    is_wall: np.ndarray,
    label: int,
) -> None:
    """Label upright pixels (h, w) where it `is_wall`, each with the upright plane it lies on, in place."""
    h, w = labels.shape
    for r in range(h):
        for c in range(w):
            n, p = normals[r, c], points[r, c]
            if is_wall[r, c] and abs(n[2]) < tilt_sine:
                length = np.hypot(n[0], n[1])
                labels[r, c] = label
                planes[r, c, 0], planes[r, c, 1] = n[0] / length, n[1] / length
                planes[r, c, 3] = planes[r, c, 0] * p[0] + planes[r, c, 1] * p[1]


@numba.njit(cache=True, nogil=True)
def _lay_level(
    labels: np.ndarray,
    planes: np.ndarray,
    points: np.ndarray,
    normal_z: np.ndarray,
    near: np.ndarray,
    tolerance: np.ndarray,
    plane: np.ndarray,
    facing: float,
    label: int,
) -> None:
    """Give pixels (h, w) `near` a level its label where they lie on its plane (4,), in place.

    Seen at a flat angle normals are wild; whatever lies on the plane and is not upright is it.
    """
    h, w = labels.shape
    for r in range(h):
        for c in range(w):
            if not near[r, c] or facing * normal_z[r, c] < np.float32(0.7):
                continue
            off = -plane[3]
            for a in range(3):
                off += plane[a] * points[r, c, a]
            if abs(off) < tolerance[r, c]:
                labels[r, c] = label
                planes[r, c] = plane


@numba.njit(cache=True, nogil=True)
def _grow(
    labels: np.ndarray,
    planes: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    tolerance: np.ndarray,
    n_steps: int,
) -> None:
    """Carry labels (h, w) with their planes (h, w, 4) to unlabelled neighbours on the plane, in place."""
    h, w = labels.shape
    queue = np.zeros((h * w, 2), dtype=np.int32)
    age = np.zeros((h, w), dtype=np.int16)
    head, tail = 0, 0
    for r in range(h):
        for c in range(w):
            if labels[r, c] != 0:
                queue[tail, 0], queue[tail, 1] = r, c
                tail += 1
    while head < tail:
        r, c = queue[head]
        head += 1
        if age[r, c] >= n_steps:
            continue
        for k in range(4):
            i = r + (1 if k == 0 else -1 if k == 1 else 0)
            j = c + (1 if k == 2 else -1 if k == 3 else 0)
            if i < 0 or j < 0 or i >= h or j >= w or labels[i, j] != 0:
                continue
            off = -planes[r, c, 3]
            along = np.float32(0.0)
            for a in range(3):
                off += planes[r, c, a] * points[i, j, a]
                along += planes[r, c, a] * normals[i, j, a]
            # NaN normals compare false and are let in; NaN points are not.
            if abs(off) < tolerance[i, j] and not abs(along) < 0.85:
                labels[i, j] = labels[r, c]
                planes[i, j] = planes[r, c]
                age[i, j] = age[r, c] + 1
                queue[tail, 0], queue[tail, 1] = i, j
                tail += 1
