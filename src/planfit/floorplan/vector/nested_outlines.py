"""The outer wall of a building as two closed outlines, one in the other, however thick it is beside the rest.

Where the unit is unknown, how thick walls may be comes from the usual distance of neighbouring lines, which
in a furnished room is that of furniture.
"""

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings
from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.single_lines import MIN_ENDING
from planfit.geometry import segments

AROUND = 0.5
"""Of the length of all lines, what the outer outline holds at least: the outline is that of the building."""
MEETS = 1e-3
"""Of the drawing's size: lines that end so near to an outline end at it."""


def outer_wall(lines: Lines, most: float, extent: float) -> BaseGeometry:
    """The area between the largest closed path and the largest within, where these are the faces of a wall:
    nowhere further apart than walls are thick, with lines that end at the inner one, as what stands along a
    wall does. Empty where there is none. The frame of a sheet keeps away from what it frames.

    Args:
        lines: straight ones that may be faces.
        most: how thick walls may be.
        extent: of the drawing.
    """
    none = shapely.Polygon()
    rings = _closed_paths(lines)
    rings = sorted(rings, key=lambda ring: -ring.area)[:2]
    if len(rings) < 2 or not rings[0].contains(rings[1]):
        return none
    outer, inner = rings
    strings = line_strings(lines.ends)
    inside = segments.lengths(lines.ends)[
        shapely.covers(shapely.buffer(outer, MEETS * extent), strings)
    ]
    if inside.sum() < AROUND * segments.lengths(lines.ends).sum():
        return none
    apart = shapely.distance(shapely.points(shapely.get_coordinates(outer)), inner).max()
    if apart > np.sqrt(2.0) * most or inner.exterior.distance(outer.exterior) < MEETS * extent:
        return none
    at = np.concatenate([lines.ends, lines.ends.mean(axis=1, keepdims=True)], axis=1)
    on_inner = np.asarray(shapely.distance(shapely.points(at), inner.exterior)) < MEETS * extent
    # The middle of a line along the outline is on it too: that one is of the outline itself.
    is_ending = on_inner[:, :2].any(axis=1) & ~on_inner[:, 2]
    return outer.difference(inner) if is_ending.sum() >= MIN_ENDING else none


def _closed_paths(lines: Lines) -> list[shapely.Polygon]:
    """Paths of four segments or more that end where they began."""
    starts = np.flatnonzero(np.diff(lines.path, prepend=-1) != 0)
    found = []
    for start, stop in zip(starts, np.append(starts[1:], len(lines)), strict=True):
        ends: Float[np.ndarray, "n 2 2"] = lines.ends[start:stop]
        is_joined = np.allclose(ends[:-1, 1], ends[1:, 0]) and np.allclose(ends[-1, 1], ends[0, 0])
        if stop - start >= 4 and is_joined:
            ring = shapely.Polygon(ends[:, 0])
            if ring.is_valid:
                found.append(ring)
    return found
