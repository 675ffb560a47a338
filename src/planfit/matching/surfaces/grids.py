"""Surface grids: depth and normals of frames on a coarse grid, each cell a piece of a plane."""

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, Int8

from planfit.geometry.camera import Camera
from planfit.geometry.depth_normals import depth_normals, measured_points
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan

COLUMNS, ROWS = 80, 60
"""Cells of a grid: under a degree each for a phone; depth and normals take 34 kB a frame."""
STEP = 4
"""Of an image as large as this many times the grid, normals are taken; they are smoothed over as much."""
_RADIUS_PX = 4
"""Half the baseline of a normal there."""
_GRAZING = 0.15
"""Cosine between ray and normal below which depth is too rough to tell a plane."""


@dataclass(frozen=True)
class SurfaceGrids:
    """What some frames show, a piece of a plane a cell."""

    number: Int[np.ndarray, " n"]
    """Of each frame of the scan, its place in the arrays; -1 for frames without a grid."""
    depth_m: Float32[np.ndarray, "k r c"]
    """Along the optical axis, m; NaN where no plane was seen."""
    normals: Int8[np.ndarray, "k r c 3"]
    """Unit normals times 127, camera frame, towards the camera."""
    cameras: Float[np.ndarray, "k 4"]
    """fx, fy, cx, cy of each in cells: integers are the cells' centres."""


def _surface_grid(
    depth: Float[np.ndarray, "h w"], camera: Camera, max_depth_m: float
) -> tuple[Float32[np.ndarray, "r c"], Int8[np.ndarray, "r c 3"]]:
    """Depth (m) and normals (times 127) of each cell of a depth image (m, NaN where nothing was measured)."""
    width, height = COLUMNS * STEP, ROWS * STEP
    scaled = camera.scaled(width, height)
    # The nearest pixel of each: means across an edge would be on neither side.
    near = cv2.resize(depth.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST)
    with np.errstate(invalid="ignore"):
        near = np.where(near < max_depth_m, near, np.float32(np.nan))
    points = scaled.lift_image(near).astype(np.float32)
    first = STEP // 2
    normals = depth_normals(points, _RADIUS_PX, STEP, first)
    mean = cv2.blur(measured_points(points), (2 * _RADIUS_PX + 1, 2 * _RADIUS_PX + 1))
    at = mean[first::STEP, first::STEP]
    # The plane through the window's mean meets the ray of the pixel at this depth.
    own = points[first::STEP, first::STEP]
    with np.errstate(invalid="ignore", divide="ignore"):
        rays = own / own[..., 2:]
        along = np.sum(normals * rays, axis=-1)
        cosine = -along / np.linalg.norm(rays, axis=-1)
        z = np.sum(normals * at[..., :3] / at[..., 3:], axis=-1) / along
        is_plane = (cosine > _GRAZING) & (np.abs(z - own[..., 2]) < 0.03 + 0.02 * own[..., 2])
    kept = np.where(is_plane[..., None], normals, np.float32(0))
    return np.where(is_plane, z, np.nan).astype(np.float32), np.rint(127 * kept).astype(np.int8)


def find_surface_grids(
    scan: Scan, frame_idx: Int[np.ndarray, " k"], max_depth_m: float, runtime: Runtime
) -> SurfaceGrids:
    """Grids of some frames of a scan.

    Raises:
        ScanError: a depth image cannot be read.
    """

    def one(k: int) -> Arrays:
        i = int(frame_idx[k])
        depth, normals = _surface_grid(scan.files.depth(i), scan.cameras[i], max_depth_m)
        return {"depth": depth, "normals": normals}

    key = cache_key(scan.fingerprint, "surface grids", frame_idx.tobytes(), max_depth_m)
    items = runtime.map("surfaces", key, len(frame_idx), partial(one), chunk_size=16)
    number = np.full(len(scan), -1)
    number[frame_idx] = np.arange(len(frame_idx))
    scaled = [scan.cameras[i].scaled(COLUMNS * STEP, ROWS * STEP) for i in frame_idx]
    return SurfaceGrids(
        number,
        np.array([item["depth"] for item in items], np.float32).reshape(-1, ROWS, COLUMNS),
        np.array([item["normals"] for item in items], np.int8).reshape(-1, ROWS, COLUMNS, 3),
        # Cell c is pixel STEP c + STEP // 2 of the larger image.
        np.array(
            [
                [c.fx / STEP, c.fy / STEP, (c.cx - STEP // 2) / STEP, (c.cy - STEP // 2) / STEP]
                for c in scaled
            ],
            dtype=float,
        ).reshape(-1, 4),
    )
