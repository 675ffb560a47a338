"""A level cut through triangles."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings


def section_segments(corners: np.ndarray, triangles: np.ndarray, height: float) -> np.ndarray:
    """Segments (n, 2, 2), x-y, where a level plane meets triangles (m, 3) over corners (k, 3).

    Corners at the very height count as above, so that each triangle gives one segment or none.
    """
    at = corners[triangles]
    above = at[..., 2] >= height
    is_cut = above.any(axis=1) & ~above.all(axis=1)
    at, above = at[is_cut], above[is_cut]
    # Turn each so that corner 0 is alone on its side.
    alone = np.where(above.sum(axis=1) == 1, np.argmax(above, axis=1), np.argmin(above, axis=1))
    order = (alone[:, None] + np.arange(3)) % 3
    at = np.take_along_axis(at, order[..., None], axis=1)
    ends = []
    for other in (1, 2):
        rise = at[:, other, 2] - at[:, 0, 2]
        t = ((height - at[:, 0, 2]) / rise)[:, None]
        ends.append(at[:, 0, :2] * (1 - t) + at[:, other, :2] * t)
    return np.stack(ends, axis=1)


def section_area(corners: np.ndarray, triangles: np.ndarray, height: float) -> BaseGeometry:
    """Area of the solid inside a closed surface at a height; empty where the surface is open there.

    Rings within rings are holes, as in a hollow pillar.
    """
    segments = section_segments(corners, triangles, height)
    if len(segments) == 0:
        return shapely.Polygon()
    # Triangles that share an edge compute its point alike up to rounding.
    segments = np.round(segments, 6)
    segments = segments[np.abs(segments[:, 0] - segments[:, 1]).max(axis=1) > 0]
    if len(segments) == 0:
        return shapely.Polygon()
    lines = shapely.node(shapely.multilinestrings(line_strings(segments)))
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    if len(cells) == 0:
        return shapely.Polygon()
    inside = shapely.get_coordinates(shapely.point_on_surface(cells))
    solid = cells[[_is_inside(segments, point) for point in inside]]
    return shapely.union_all(solid)


def _is_inside(segments: np.ndarray, point: np.ndarray) -> bool:
    """Whether a ray from the point crosses the outline an odd number of times."""
    y = segments[..., 1] > point[1]
    crossing = segments[y[:, 0] != y[:, 1]]
    t = (point[1] - crossing[:, 0, 1]) / (crossing[:, 1, 1] - crossing[:, 0, 1])
    x = crossing[:, 0, 0] * (1 - t) + crossing[:, 1, 0] * t
    return bool((x > point[0]).sum() % 2)
