"""What each pixel shows, from masks on disk, from geometry, or from a learned model: one protocol."""

from typing import Protocol, runtime_checkable

import numpy as np

from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan
from planfit.segmentation.geometry_labels import (
    GeometryLabelOptions,
    label_by_geometry,
    to_full_size,
)
from planfit.segmentation.storeys import StoreyOptions, storey_heights
from planfit.segmentation.surfaces import find_surfaces
from planfit.segmentation.visibility_map import Glance, Stretch, map_stretch

GLANCE_WIDTH_PX = 40
"""About as many points of a row tell what a frame sees over what."""


@runtime_checkable
class BackEnd(Protocol):
    """Labels the pixels of one frame at a time; safe to use from several threads."""

    name: str
    """masks, geometry or learned."""
    identity: str
    """Changes when its labels do, for the same scan, gravity and options; caches are keyed by it."""

    def labels(self, frame_idx: int, depth: np.ndarray) -> np.ndarray:
        """Label image (h, w) uint8 of `Label`, the size of the frame's depth image (h, w) m."""
        ...


class MaskBackEnd:
    """Masks that lie beside the images."""

    name = "masks"
    identity = "masks"

    def __init__(self, scan: Scan) -> None:
        self._files = scan.files

    def labels(self, frame_idx: int, depth: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """As the scan's files have them."""
        return self._files.labels(frame_idx)


class GeometryBackEnd:
    """Normals, heights, and what is seen over what."""

    name = "geometry"
    identity = "geometry"

    def __init__(
        self,
        scan: Scan,
        upright_from_cams: np.ndarray,
        stretches: list[Stretch],
        options: GeometryLabelOptions,
    ) -> None:
        self._cameras = scan.cameras
        self._upright_from_cams = upright_from_cams
        self._stretches = stretches
        self._options = options

    def labels(self, frame_idx: int, depth: np.ndarray) -> np.ndarray:
        """From the frame's depth and its stretch of the scan."""
        upright_from_cam = self._upright_from_cams[frame_idx]
        options = self._options
        surfaces = find_surfaces(
            depth, self._cameras[frame_idx], upright_from_cam, options.normal_radius_px
        )
        stretch = self._stretches[frame_idx // options.stretch_frames]
        labels = label_by_geometry(surfaces, upright_from_cam[:3, 3], stretch, options)
        return to_full_size(labels, surfaces.step_px, (depth.shape[0], depth.shape[1]))


def geometry_back_end(
    scan: Scan,
    upright_from_cams: np.ndarray,
    options: GeometryLabelOptions,
    storeys: StoreyOptions,
    runtime: Runtime,
) -> GeometryBackEnd:
    """Look through the scan once, and make the back end that labels by what was seen.

    Each stretch also looks at a quarter of the next ones, so that frames at its ends know as much.
    What is kept of a stretch is a map of one bit a cell, a few kilobytes.
    """
    n, size = len(scan), options.stretch_frames

    def one(k: int) -> Arrays:
        frames = range(max(0, k * size - size // 4), min(n, (k + 1) * size + size // 4))
        glances = [_glance(scan, upright_from_cams, i, options) for i in frames]
        tilt_sine = float(np.sin(np.deg2rad(options.max_tilt_deg)))
        found = map_stretch(glances, tilt_sine, options.free_above_m, options.min_wall_rise_m)
        return {
            "low_xy": found.low_xy,
            "is_wall": found.is_wall,
            "n_y": np.array(found.n_y),
            "floor_m": np.array(found.floor_m),
            "ceilings_m": found.ceilings_m,
        }

    key = cache_key(
        "stretches", scan.fingerprint, scan.world_from_cams.tobytes(),
        upright_from_cams.tobytes(), options,
    )  # fmt: skip
    items = runtime.map("what is seen over what", key, -(-n // size), one, chunk_size=1)
    floors = storey_heights(np.array([float(item["floor_m"]) for item in items]), storeys)
    stretches = [
        Stretch(
            low_xy=item["low_xy"],
            is_wall=item["is_wall"],
            n_y=int(item["n_y"]),
            floor_m=float(floor_m),
            ceilings_m=item["ceilings_m"],
        )
        for item, floor_m in zip(items, floors, strict=True)
    ]
    return GeometryBackEnd(scan, upright_from_cams, stretches, options)


def _glance(
    scan: Scan, upright_from_cams: np.ndarray, i: int, options: GeometryLabelOptions
) -> Glance:
    centre = upright_from_cams[i, :3, 3]
    found = find_surfaces(
        scan.files.depth(i),
        scan.cameras[i],
        upright_from_cams[i],
        options.normal_radius_px,
        GLANCE_WIDTH_PX,
    )
    seen = np.isfinite(found.points[..., 2])
    points = found.points[seen] + centre.astype(np.float32)
    return Glance(centre, points, found.normals[seen, 2])
