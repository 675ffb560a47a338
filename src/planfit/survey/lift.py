"""Marks lifted into the axes of their cameras: by depth, by the size of a tag, or the camera itself."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.runtime import Runtime
from planfit.scan import Scan
from planfit.survey.tags import find_tags
from planfit.survey.types import LiftedMarks, Mark, Survey

WINDOW_PX = 2
"""Depth is the median of the pixels this near: marks are set on something flat, single pixels are noisy."""
SAME_SURFACE_SHARE = 0.03
"""Pixels of the window whose depth differs by more, as a share, show something else."""

SigmaOfDepth = Callable[[Float[np.ndarray, " m"]], Float[np.ndarray, " m"]]


def find_marks(
    scan: Scan,
    survey: Survey,
    frames: Int[np.ndarray, " k"],
    sigma_of_depth: SigmaOfDepth,
    runtime: Runtime | None = None,
) -> LiftedMarks:
    """All marks of a survey, and tags seen in `frames`, lifted by the nominal sensor.

    Args:
        scan: whose images and depth are read, where a mark says so whether or not in `frames`.
        survey: points and marks.
        frames: in which tags are looked for.
        sigma_of_depth: standard deviation (m) of points at depths (m).
        runtime: threads and cache.

    Raises:
        OptionError: a mark lies outside of its image, or where no depth was measured.
    """
    index = {point.id: k for k, point in enumerate(survey.points)}
    rows = [_lifted(scan, mark) for mark in survey.marks]
    besides = [0.0] * len(rows)
    frame_idx = [mark.frame_idx for mark in survey.marks]
    point_idx = [index[mark.point_id] for mark in survey.marks]
    if survey.tags:
        tags = find_tags(scan, survey.tags, survey.tag_size_m, frames, runtime or Runtime())
        for tag in tags:
            if tag.id in index:
                rows.append(tag.middle_cam)
                besides.append(tag.sigma_m)
                frame_idx.append(tag.frame_idx)
                point_idx.append(index[tag.id])
    points = np.array(rows, dtype=float).reshape(-1, 3)
    is_camera = (points == 0).all(axis=1)
    sigma = np.where(is_camera, 0.0, np.hypot(sigma_of_depth(points[:, 2]), besides))
    return LiftedMarks(points, sigma, np.array(frame_idx, int), np.array(point_idx, int))


def _lifted(scan: Scan, mark: Mark) -> Float[np.ndarray, "3"]:
    if mark.uv is None:
        return np.zeros(3)
    camera, (u, v) = scan.cameras[mark.frame_idx], mark.uv
    who = f"{scan.name}: mark of {mark.point_id!r} in frame {mark.frame_idx}"
    if not (-0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5):
        raise OptionError(
            f"{who}: expected a pixel of an image of {camera.width} x {camera.height}, found ({u:g}, {v:g}); "
            "u counts columns and v rows, from 0, in the images as planfit reads them"
        )
    depth_m = depth_at(scan.files.depth(mark.frame_idx), u, v)
    if depth_m is None:
        raise OptionError(
            f"{who}: expected depth at pixel ({u:g}, {v:g}), found none within {WINDOW_PX} pixels; mark the "
            "point in another frame, nearer or less slanted"
        )
    return camera.lift(np.array([[u, v]], dtype=float), np.array([depth_m]))[0]


def depth_at(depth_m: Float[np.ndarray, "h w"], u: float, v: float) -> float | None:
    """Depth (m) of the surface at a pixel: the median of those near that show the same; None without any."""
    row, column = round(v), round(u)
    top, left = max(row - WINDOW_PX, 0), max(column - WINDOW_PX, 0)
    window = depth_m[top : row + WINDOW_PX + 1, left : column + WINDOW_PX + 1].astype(float)
    rows, columns = np.nonzero(np.isfinite(window) & (window > 0))
    if len(rows) == 0:
        return None
    values = window[rows, columns]
    nearest = np.argmin((rows + top - v) ** 2 + (columns + left - u) ** 2)
    same = np.abs(values - values[nearest]) <= SAME_SURFACE_SHARE * values[nearest]
    return float(np.median(values[same]))
