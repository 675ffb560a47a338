"""What each pixel shows, from masks on disk, from geometry, or from a learned model: one protocol."""

import hashlib
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import ScanError
from planfit.geometry.se3 import Poses
from planfit.priors import SURFACE_TILT_MOST_DEG
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Label, Scan
from planfit.segmentation.label_kernels import grow_labels, label_level, label_walls
from planfit.segmentation.storeys import storey_heights
from planfit.segmentation.surfaces import Surfaces, find_surfaces
from planfit.segmentation.visibility_map import FrameSample, Submap, build_submap

_SAMPLE_WIDTH_PX = 40
"""About as many points of a row tell what a frame sees over what."""
_NORMAL_RADIUS_PX = 3
"""Half the baseline of a normal, for images 320 px wide; larger is steadier and blurs corners."""
_FREE_ABOVE_M = 0.15
"""What cameras see past the top of by more than this is furniture; what they never see over is wall."""
_MIN_WALL_RISE_M = 0.4
"""Upright surfaces seen over a smaller range of heights are no wall."""
_SUBMAP_FRAMES = 32
"""Frames whose lines of sight are put together; fewer know less, more suffer from drift."""
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


@runtime_checkable
class BackEnd(Protocol):
    """Labels the pixels of one frame at a time; safe to use from several threads."""

    name: str
    """masks, geometry or learned."""
    identity: str
    """Changes when its labels do, for the same scan, gravity and options; caches are keyed by it."""

    def labels(self, frame_idx: int, depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
        """Label image of `Label`, the size of the frame's depth image (m)."""
        ...


class MaskBackEnd:
    """Masks that lie beside the images."""

    name = "masks"
    identity = "masks"

    def __init__(self, scan: Scan) -> None:
        self._files = scan.files

    def labels(
        self,
        frame_idx: int,
        depth: Float[np.ndarray, "h w"],  # noqa: ARG002
    ) -> UInt8[np.ndarray, "h w"]:
        """As the scan's files have them."""
        return self._files.labels(frame_idx)


class ArrayBackEnd:
    """Labels of one's own, from memory."""

    name = "masks"

    def __init__(self, labels: Int[np.ndarray, "n h w"] | UInt8[np.ndarray, "n h w"]) -> None:
        """Take the label images of all frames, numbers of `Label`, the size of the depth images.

        Raises:
            ScanError: they are no stack of images, or have numbers that are no labels.
        """
        if labels.ndim != 3:
            raise ScanError(f"labels: expected label images (n, h, w), found shape {labels.shape}")
        if labels.size and not (labels.min() >= 0 and labels.max() <= max(Label)):
            raise ScanError(
                f"labels: expected numbers 0 to {int(max(Label))} of Label, found "
                f"{labels.min()} to {labels.max()}"
            )
        self._labels = labels.astype(np.uint8)
        self.identity = f"labels {hashlib.sha256(self._labels.tobytes()).hexdigest()[:16]}"

    def labels(self, frame_idx: int, depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
        """As they were given.

        Raises:
            ScanError: there is no image of this frame, or its size is not that of the depth.
        """
        if frame_idx >= len(self._labels):
            raise ScanError(
                f"labels: expected a label image of each frame, found {len(self._labels)}"
            )
        if self._labels.shape[1:] != depth.shape:
            raise ScanError(
                f"labels: expected images of {depth.shape[1]} x {depth.shape[0]} as the depth has, found "
                f"{self._labels.shape[2]} x {self._labels.shape[1]}"
            )
        return self._labels[frame_idx]


class _GeometryBackEnd:
    """Normals, heights, and what is seen over what."""

    name = "geometry"
    identity = "geometry"

    def __init__(self, scan: Scan, upright_from_cams: Poses, submaps: list[Submap]) -> None:
        self._cameras = scan.cameras
        self._upright_from_cams = upright_from_cams
        self._submaps = submaps

    def labels(self, frame_idx: int, depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
        """From the frame's depth and the submap that it is part of."""
        upright_from_cam = self._upright_from_cams[frame_idx]
        surfaces = find_surfaces(
            depth, self._cameras[frame_idx], upright_from_cam, _NORMAL_RADIUS_PX
        )
        submap = self._submaps[frame_idx // _SUBMAP_FRAMES]
        labels = _label_by_geometry(surfaces, upright_from_cam[:3, 3], submap)
        return _to_full_size(labels, surfaces.step_px, (depth.shape[0], depth.shape[1]))


def geometry_back_end(scan: Scan, upright_from_cams: Poses, runtime: Runtime) -> _GeometryBackEnd:
    """Look through the scan once, and make the back end that labels by what was seen.

    Each submap also takes a quarter of the frames of the next ones, so that frames at its ends know as much.
    What is kept of it is one bit a cell, a few kilobytes.

    Args:
        upright_from_cams: poses in the world turned upright.
    """
    n, size = len(scan), _SUBMAP_FRAMES
    # Frames at its ends are part of two submaps: their depth is decoded once for both.
    sample = lru_cache(maxsize=2 * size)(lambda i: _sample_frame(scan, upright_from_cams, i))

    def one(k: int) -> Arrays:
        frames = range(max(0, k * size - size // 4), min(n, (k + 1) * size + size // 4))
        samples = [sample(i) for i in frames]
        tilt_sine = float(np.sin(np.deg2rad(MAX_TILT_DEG)))
        found = build_submap(samples, tilt_sine, _FREE_ABOVE_M, _MIN_WALL_RISE_M)
        return {name: np.asarray(value) for name, value in vars(found).items()}

    key = cache_key(
        scan.fingerprint, "submaps", scan.world_from_cams.tobytes(),
        upright_from_cams.tobytes(),
    )  # fmt: skip
    items = runtime.map("what is seen over what", key, -(-n // size), one, chunk_size=1)
    floors = storey_heights(np.array([float(item["floor_m"]) for item in items]))
    submaps = [
        Submap(**{**item, "n_y": int(item["n_y"]), "floor_m": float(floor_m)})  # type: ignore[arg-type]
        for item, floor_m in zip(items, floors, strict=True)
    ]
    return _GeometryBackEnd(scan, upright_from_cams, submaps)


def _sample_frame(scan: Scan, upright_from_cams: np.ndarray, i: int) -> FrameSample:
    """Few points of frame i, in the world turned upright (n, 4, 4)."""
    centre = upright_from_cams[i, :3, 3]
    found = find_surfaces(
        scan.files.depth(i),
        scan.cameras[i],
        upright_from_cams[i],
        _NORMAL_RADIUS_PX,
        _SAMPLE_WIDTH_PX,
    )
    seen = np.isfinite(found.points[..., 2])
    points = found.points[seen] + centre.astype(np.float32)
    return FrameSample(centre, points, found.normals[seen, 2])


def _label_by_geometry(
    surfaces: Surfaces, centre: Float[np.ndarray, "3"], submap: Submap
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


def _to_full_size(
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
