"""Areas that a program wrote as strokes side by side, as printers do of solid hatches."""

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings

MANY = 5_000
"""Fewer strokes of one pen are line work: of a real floor 1,000 to 3,000 may be faces. 50,000 take 6 s."""
TWICE = 2.0
"""Strokes that fill an area lie on one another: their own areas together are so many times the area."""


def area_of_strokes(ends: Float[np.ndarray, "n 2 2"], width: float) -> BaseGeometry:
    """What strokes of one width fill where they lie side by side, to the middle of the outermost; empty where
    they are lines, or too few to be a fill.

    Args:
        ends: straight strokes.
        width: of the pen, in the same unit.
    """
    if len(ends) < MANY:
        return shapely.Polygon()
    bodies = shapely.buffer(line_strings(ends), 0.5 * width, cap_style="square", quad_segs=1)
    # Steps where strokes end cost minutes below, and are no edges.
    body = shapely.simplify(shapely.union_all(bodies), 0.25 * width)
    if shapely.area(bodies).sum() < TWICE * body.area:
        return shapely.Polygon()
    core = shapely.buffer(body, -1.0 * width, join_style="mitre")
    return shapely.buffer(core, 0.5 * width, join_style="mitre")


def are_in_area(
    ends: Float[np.ndarray, "n 2 2"], area: BaseGeometry, width: float
) -> Bool[np.ndarray, " n"]:
    """Which strokes an area is made of, its outline included."""
    grown = shapely.buffer(area, width, join_style="mitre")
    shapely.prepare(grown)
    return shapely.covers(grown, line_strings(ends))
