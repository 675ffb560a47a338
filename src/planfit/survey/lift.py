"""Marks lifted into the axes of their cameras: by depth, by the size of a tag, or the camera itself."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError, ScanError
from planfit.runtime import Runtime
from planfit.scan import Scan
from planfit.scan.statistics import lift_pixel
from planfit.survey.tags import find_tags
from planfit.survey.types import LiftedMarks, Mark, Survey

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
    try:
        return lift_pixel(scan, mark.frame_idx, mark.uv)
    except ScanError as error:
        raise OptionError(f"{scan.name}: mark of {mark.point_id!r}: {error}") from error
