"""Furniture among line work: closed outlines that stand for themselves."""

import numpy as np
import shapely
from jaxtyping import Bool, Float

from planfit.floorplan.faces import covered_lengths, find_partners, line_strings
from planfit.floorplan.near_lines import groups_within
from planfit.floorplan.vector.double_lines import PARALLEL_SINE, Thickness
from planfit.geometry import segments

TOUCHING = 1e-3
"""Of the drawing's size: lines nearer than this are of one outline."""
LARGEST = 0.35
"""Of the drawing's size: larger outlines are those of rooms and buildings."""
SLIM = 4.0
"""Thicknesses of the usual wall: smaller outlines are columns and piers."""
CLOSED = 0.8
"""Of the hull of an outline, what it encloses."""
BESIDE, OWN = 0.6, 2.0
"""The outline of a room has the other faces of its walls beside it all around, or for so much of its length;
a cupboard has at one or two sides, a bed in a corner at two. Lines of one outline count as faces of one wall
up to so many thicknesses of the usual one: a worktop is 0.6 m deep, a lift's wall 0.2 m."""
LONGEST = 5.0
"""What is longer in its widths may be a piece of wall between two doors."""
MOST_LINES = 200


def are_furniture(
    ends: Float[np.ndarray, "n 2 2"], thickness: Thickness, extent: float
) -> Bool[np.ndarray, " n"]:
    """Lines of closed outlines that touch nothing else and have no other faces of walls around them.

    Args:
        ends: merged, no two on one another.
        thickness: of the walls to look for.
        extent: of the drawing.
    """
    n = len(ends)
    result = np.zeros(n, dtype=bool)
    if n == 0:
        return result
    group = groups_within(ends, TOUCHING * extent)
    count = np.bincount(group)
    low, high = np.full((len(count), 2), np.inf), np.full((len(count), 2), -np.inf)
    np.minimum.at(low, group, ends.min(axis=1))
    np.maximum.at(high, group, ends.max(axis=1))
    size = (high - low).max(axis=1)
    asked = (count >= 3) & (count <= MOST_LINES)
    asked &= (size < LARGEST * extent) & (size > SLIM * thickness.usual)
    pairs = find_partners(ends, thickness.most, thickness.least, 0.0, PARALLEL_SINE)
    keep = (group[pairs.line] != group[pairs.partner]) | (np.abs(pairs.gap) < OWN * thickness.usual)
    covered = covered_lengths(pairs.line[keep], pairs.low[keep], pairs.high[keep], n)
    total = np.bincount(group, segments.lengths(ends))
    asked &= np.bincount(group, covered) < BESIDE * total
    strings = line_strings(ends)
    for one in np.flatnonzero(asked):
        own = np.flatnonzero(group == one)
        # Lines cut where they cross: what they enclose then shares no ground.
        areas = shapely.get_parts(shapely.polygonize([shapely.union_all(strings[own])]))
        hull = shapely.convex_hull(shapely.MultiLineString(list(ends[own])))
        if float(shapely.area(areas).sum()) > CLOSED * hull.area > 0.0:
            corners = shapely.get_coordinates(shapely.oriented_envelope(hull))
            sides = np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)
            result[own] = sides.max() < LONGEST * sides.min()
    return result
