"""Furniture among line work: closed outlines that stand for themselves."""

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import (
    PARALLEL_SINE,
    Ends,
    Partners,
    covered_lengths,
    find_partners,
    groups_within,
    line_strings,
)
from planfit.floorplan.vector.double_lines import Thickness
from planfit.floorplan.vector.drawing import EDGE
from planfit.floorplan.vector.line_work import extremes
from planfit.floorplan.vector.wall_sides import ROOM, sides_with_room
from planfit.geometry import segments

TOUCHING = EDGE
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
"""Of one piece: closing the areas of more takes long, and none is drawn so."""
AROUND = 0.25
"""Of the hull of an outline, what must be seen to have room before it."""
SAME_SIZE = 0.05
"""Pieces of furniture that differ by less are of one kind, and may stand in a row."""


def are_furniture(ends: Ends, thickness: Thickness, extent: float) -> Bool[np.ndarray, " n"]:
    """Lines of closed outlines that touch nothing else, and have no other faces of walls around them, or room
    around them and none inside.

    `ends`: merged, no two on one another; `thickness`: of the walls to look for.
    """
    n = len(ends)
    result = np.zeros(n, dtype=bool)
    if n == 0:
        return result
    group = groups_within(ends, TOUCHING * extent)
    count = np.bincount(group)
    low, high = extremes(ends.reshape(-1, 2), np.repeat(group, 2), len(count))
    size = (high - low).max(axis=1)
    asked = (count >= 3) & (count <= MOST_LINES)
    asked &= (size < LARGEST * extent) & (size > SLIM * thickness.usual)
    pairs = find_partners(ends, thickness.most, thickness.least, 0.0, PARALLEL_SINE)
    keep = (group[pairs.line] != group[pairs.partner]) | (np.abs(pairs.gap) < OWN * thickness.usual)
    covered = covered_lengths(pairs.line[keep], pairs.low[keep], pairs.high[keep], n)
    total = np.bincount(group, segments.lengths(ends))
    has_faces = np.bincount(group, covered) >= BESIDE * total
    free_side = sides_with_room(ends, thickness.most)
    walls = _Alignment(ends, group, size, pairs, 1e-3 * extent)
    strings = line_strings(ends)
    for one in np.flatnonzero(asked):
        own = np.flatnonzero(group == one)
        # Lines cut where they cross: what they enclose then shares no ground.
        areas = shapely.get_parts(shapely.polygonize([shapely.union_all(strings[own])]))
        hull = shapely.convex_hull(shapely.MultiLineString(list(ends[own])))
        if float(shapely.area(areas).sum()) <= CLOSED * hull.area or hull.area == 0.0:
            continue
        corners = shapely.get_coordinates(shapely.oriented_envelope(hull))
        sides = np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)
        if sides.max() >= LONGEST * sides.min():
            continue
        # A room is wider than what furniture has within its parts, as the seat of a sofa.
        cores = shapely.buffer(areas, -ROOM / 2 * thickness.most, quad_segs=16)
        is_slim = bool(shapely.is_empty(cores).all())
        is_body = is_slim and _looks_out(ends[own], free_side[own], hull)
        result[own] = (is_body or not has_faces[one]) and not walls.go_on(int(one))
    return result


def _looks_out(ends: Ends, free_side: Int[np.ndarray, " n"], hull: BaseGeometry) -> bool:
    """Whether an outline has more room around it than inside: a room has it inside alone."""
    length = segments.lengths(ends)
    step = (1e-3 * np.sqrt(hull.area)) * free_side[:, None] * segments.left_normals(ends)
    is_inward = shapely.contains(hull, shapely.points(ends.mean(axis=1) + step))
    middles = shapely.points(ends.mean(axis=1))
    on_hull = shapely.distance(hull.boundary, middles) < 1e-3 * hull.length
    outward = length[(free_side != 0) & on_hull & ~is_inward].sum()
    inward = length[(free_side != 0) & on_hull & is_inward].sum()
    return bool(outward > max(AROUND * hull.length, inward))


class _Alignment:
    """Which groups of lines have both faces of a wall that go on the lines of those of another group."""

    def __init__(
        self,
        ends: Ends,
        group: Int[np.ndarray, " n"],
        size: Float[np.ndarray, " g"],
        pairs: Partners,
        tolerance: float,
    ) -> None:
        self._ends, self._group, self._size, self._tolerance = ends, group, size, tolerance
        self._left = segments.left_normals(ends)
        is_own = (group[pairs.line] == group[pairs.partner]) & (pairs.line < pairs.partner)
        is_own &= pairs.high - pairs.low > 0.5 * np.abs(pairs.gap)
        self._pairs = pairs.take(is_own)

    def go_on(self, one: int) -> bool:
        """Of a group; another as large may be the same piece of furniture again."""
        mine = np.flatnonzero(self._group[self._pairs.line] == one)
        return any(
            self._on_line(int(self._pairs.line[k])) & self._on_line(int(self._pairs.partner[k]))
            for k in mine
        )

    def _on_line(self, i: int) -> set[int]:
        """Groups of another size with a line on that of line `i`."""
        across = np.abs(np.einsum("nei,i->ne", self._ends - self._ends[i, 0], self._left[i]))
        found = np.unique(self._group[across.max(axis=1) < self._tolerance])
        apart = np.abs(self._size[found] - self._size[self._group[i]])
        return set(found[apart > SAME_SIZE * self._size[self._group[i]]].tolist())
