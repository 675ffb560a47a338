"""Strokes that run beside strokes as thin: what a pen drew, unlike walls, which have a room beyond."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.line_work import edges_of_areas
from planfit.geometry import segments

_TWIN_NEAR = 8.0
"""A twin is at most this many thicknesses of the stroke away."""
_ALIKE = 1.6
"""A twin is as thick as the stroke, up to this factor and a pixel."""
_MAX_ROWS = 30_000
"""OpenCV maps at most 32,767 rows at once."""
_REACH_PX = 120
_MOST_POINTS = 8_000
_STEP_PX = 3.0
_LEAST_EDGE_PX = 0.5


def twin_share(mask: UInt8[np.ndarray, "h w"], regions: list[BaseGeometry]) -> float:
    """Share of the outline of the thinner half of all strokes that faces a stroke as thin, close by.

    Measured: 0.03 to 0.09 in pictures of walls alone (a site with and without windows at two scales, upright
    and turned by 3 deg, a villa), 0.28 to 0.8 in drawings of every style, with and without clutter, as they
    were and enlarged 2.5 times.

    Args:
        mask: 1 on strokes.
        regions: polygons around them, pixels.
    """
    ends = edges_of_areas(regions)
    ends = ends[segments.lengths(ends) > _LEAST_EDGE_PX]
    if len(ends) == 0:
        return 1.0
    length, normals = segments.lengths(ends), -segments.left_normals(ends)
    step = max(_STEP_PX, float(length.sum()) / _MOST_POINTS)
    points, edge = segments.sample(ends, step)
    inside = _along(mask, points, -normals[edge])
    outside = _along(mask, points, normals[edge])
    inside[:, 0] = True
    outside[:, 0] = False
    thickness = _first(~inside)
    gap = _first(outside)
    beyond = ~outside & (np.arange(outside.shape[1])[None] > gap[:, None])
    faced = _first(beyond) - gap
    is_twin = (gap < _REACH_PX) & (gap <= _TWIN_NEAR * thickness)
    is_twin &= (faced <= _ALIKE * thickness + 1.0) & (faced >= thickness / _ALIKE - 1.0)
    is_stroke = length[edge] > 2.0 * thickness
    if not is_stroke.any():
        return 1.0
    is_thin = thickness <= np.median(thickness[is_stroke])
    return float(is_twin[is_thin].mean())


def _along(
    mask: UInt8[np.ndarray, "h w"],
    points: Float[np.ndarray, "m 2"],
    directions: Float[np.ndarray, "m 2"],
) -> Bool[np.ndarray, "m reach"]:
    """Whether the mask is set 1, 2, ... px from each point."""
    steps = np.arange(1.0, _REACH_PX + 1.0)
    at = (points[:, None] + steps[None, :, None] * directions[:, None]).astype(np.float32)
    result = np.zeros(at.shape[:2], dtype=bool)
    for first in range(0, len(at), _MAX_ROWS):
        part = at[first : first + _MAX_ROWS]
        found = cv2.remap(mask, part[..., 0], part[..., 1], cv2.INTER_NEAREST, borderValue=0)
        result[first : first + _MAX_ROWS] = found > 0
    return result


def _first(is_set: Bool[np.ndarray, "m reach"]) -> Int[np.ndarray, " m"]:
    """Pixels to the first that is set; the reach where none is."""
    return np.where(is_set.any(axis=1), np.argmax(is_set, axis=1) + 1, is_set.shape[1])
