"""What a scan measured: points that single pixels show, and statistics of depth, path, gaps, jumps."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.priors import DEPTH_EDGE_SHARE, STEP_AT_VIDEO_RATE_M
from planfit.runtime import Runtime, cache_key
from planfit.scan.types import Scan

NEAR_PX = 3
"""Depth is the median of the pixels this near, rows and columns: what is picked is set on something flat, and
single pixels are noisy, or have none."""

MAX_FRAMES = 60
POINTS_PER_FRAME = 3000
JUMP_M, JUMP_DEG = STEP_AT_VIDEO_RATE_M.value, 60.0
"""No step of a walk filmed at video rate comes near these; one at a frame a second, by its size against the
usual step."""
MANY = 5.0
"""Times the usual step or interval from which one is a jump or a gap."""


@dataclass(frozen=True)
class DepthStatistics:
    """Depth of some frames from all over the scan."""

    frame_idx: Int[np.ndarray, " k"]
    """Frames looked at."""
    near_m: float
    """A hundredth of the measurements is nearer."""
    median_m: float
    far_m: float
    """A hundredth of the measurements is farther."""
    coverage: float
    """Share of pixels with a measurement."""
    n_empty: int
    """Frames without any."""
    points_world: Float[np.ndarray, "m 3"]
    """m, a sample of the points seen, world axes."""


@dataclass(frozen=True)
class PathStatistics:
    """The path of the camera."""

    length_m: float
    extent_m: Float[np.ndarray, "3"]
    """Size of the box around the camera's positions, world axes."""
    step_m: float
    """Median distance between frames."""
    interval_s: float
    """Median time between frames; NaN for one frame."""
    gaps: Int[np.ndarray, " g"]
    """Frames after which the recording stops for more than five usual intervals."""
    jumps: Int[np.ndarray, " j"]
    """Frames after which the camera is elsewhere at once: over half a metre or 60 degrees, and over five
    usual steps, without a gap in time that explains it."""


def depth_statistics(scan: Scan, runtime: Runtime) -> DepthStatistics:
    """Read the depth of up to sixty frames.

    Raises:
        ScanError: one of them cannot be read, and too many others were corrupt, too.
    """
    frames = np.unique(np.linspace(0, len(scan) - 1, MAX_FRAMES).astype(int))

    def one_frame(item: int) -> dict[str, np.ndarray]:
        i = int(frames[item])
        depth = scan.files.depth(i)
        # A grid of about so many pixels: every step-th column of every step-th row, away from the border.
        step = max(1, int(np.sqrt(depth.size / POINTS_PER_FRAME)))
        rows, columns = np.mgrid[
            step // 2 : depth.shape[0] : step, step // 2 : depth.shape[1] : step
        ]
        at = depth[rows, columns]
        known = np.isfinite(at)
        uv = np.stack([columns[known], rows[known]], axis=1).astype(float)
        points = se3.transform(scan.world_from_cams[i], scan.cameras[i].lift(uv, at[known]))
        share = np.array(np.isfinite(depth).mean())
        return {"points": points.astype(np.float32), "depth": at[known], "share": share}

    items = runtime.map("depth", cache_key(scan.fingerprint, "statistics"), len(frames), one_frame)
    depths = np.concatenate([item["depth"] for item in items])
    shares = np.array([float(item["share"]) for item in items])
    quantiles = np.percentile(depths, [1, 50, 99]) if len(depths) else np.full(3, np.nan)
    near, middle, far = (float(v) for v in quantiles)
    return DepthStatistics(
        frames,
        near,
        middle,
        far,
        float(shares.mean()),
        int((shares == 0).sum()),
        np.concatenate([item["points"] for item in items]).astype(float),
    )


def path_statistics(scan: Scan) -> PathStatistics:
    """The recorded poses alone."""
    centres = scan.world_from_cams[:, :3, 3]
    steps = se3.inverse(scan.world_from_cams[:-1]) @ scan.world_from_cams[1:]
    step_m = np.linalg.norm(steps[:, :3, 3], axis=1)
    rotation_deg = np.rad2deg(se3.rotation_angle(steps[:, :3, :3]))
    interval = np.diff(scan.timestamps)
    if len(interval) == 0:
        none = np.zeros(0, dtype=int)
        return PathStatistics(0.0, np.zeros(3), 0.0, np.nan, none, none)
    usual_s, usual_m = float(np.median(interval)), float(np.median(step_m))
    is_gap = interval > MANY * max(usual_s, 1e-9)
    is_far = (step_m > JUMP_M) & (step_m > MANY * usual_m)
    is_rotated = (rotation_deg > JUMP_DEG) & (rotation_deg > MANY * float(np.median(rotation_deg)))
    return PathStatistics(
        float(step_m.sum()),
        np.ptp(centres, axis=0),
        usual_m,
        usual_s,
        np.flatnonzero(is_gap),
        np.flatnonzero((is_far | is_rotated) & ~is_gap),
    )


def lift_pixel(scan: Scan, frame_idx: int, uv: tuple[float, float]) -> Float[np.ndarray, "3"]:
    """The point (m, camera frame) that a pixel of a frame shows: picked on a page, or marked in a table.

    Raises:
        ScanError: the pixel is outside of the image, or no depth was measured near it.
    """
    camera, (u, v) = scan.cameras[frame_idx], uv
    if not (-0.5 <= u <= camera.width - 0.5 and -0.5 <= v <= camera.height - 0.5):
        raise ScanError(
            f"frame {frame_idx}: expected a pixel within {camera.width} x {camera.height}, found "
            f"({u:g}, {v:g}); u counts columns and v rows, from 0, in the images as planfit reads them, "
            "which may be smaller than as recorded"
        )
    depth_m = depth_at(scan.files.depth(frame_idx), u, v)
    if depth_m is None:
        raise ScanError(
            f"frame {frame_idx}: expected a pixel with depth, found none at ({u:g}, {v:g}) nor within "
            f"{NEAR_PX} px; take another point, or another frame that is nearer or less slanted"
        )
    return camera.lift(np.array([[u, v]], dtype=float), np.array([depth_m]))[0]


def depth_at(depth_m: Float[np.ndarray, "h w"], u: float, v: float) -> float | None:
    """Depth (m) of the surface at a pixel: the median of those near that show the same; None without any."""
    row, column = round(v), round(u)
    top, left = max(row - NEAR_PX, 0), max(column - NEAR_PX, 0)
    window = depth_m[top : row + NEAR_PX + 1, left : column + NEAR_PX + 1].astype(float)
    rows, columns = np.nonzero(np.isfinite(window) & (window > 0))
    if len(rows) == 0:
        return None
    values = window[rows, columns]
    nearest = np.argmin((rows + top - v) ** 2 + (columns + left - u) ** 2)
    same = np.abs(values - values[nearest]) <= DEPTH_EDGE_SHARE.value * values[nearest]
    return float(np.median(values[same]))
