"""Axes of a building that are drawn through its walls: with bubbles at their ends, or as lines alone."""

import numpy as np
import shapely
from jaxtyping import Bool, Int

from planfit.floorplan.faces import line_strings
from planfit.floorplan.near_lines import ends_that_meet
from planfit.floorplan.vector.arcs import fit_circle
from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.line_work import extremes
from planfit.geometry import segments

BUBBLE, LEAST_BUBBLES, LONG_AXIS = (3e-3, 0.05), 3, 0.2
"""Radius of the circles that name axes, of the drawing's size; a plan has so many, and axes so long."""
SPAN = 0.5
"""Of the drawing along it, what an axis without a bubble runs through at least."""
FREE = 2e-3
"""Of the drawing's size: the end of an axis is further from all else."""
TAILS = (4e-3, 0.02)
"""Of the drawing's size, what an axis runs on beyond all else at its two ends: draughtsmen let lines of walls
cross at corners by 0.1 to 0.3 m of 15."""
LEAST_PLAIN, LEAST_CROSSED = 3, 2
"""So many axes without bubbles there are, through so many lines each."""
MOST_LONG = 500
"""Lines as long as half of the drawing that are looked at: real ones have at most some 50."""


def lines_of_axes(lines: Lines, extent: float) -> Bool[np.ndarray, " n"]:
    """Long lines that end at small circles of one size, pointing at their middle, and the circles.

    Args:
        lines: of the drawing, in the order of the file.
        extent: of the drawing.
    """
    result = np.zeros(len(lines), dtype=bool)
    bubbles, of = [], []
    curved = np.flatnonzero(lines.is_curved)
    starts = np.flatnonzero(np.diff(lines.path[curved], prepend=-1))
    for own in np.split(curved, starts[1:]):
        if len(own) < 6:
            continue
        circle = fit_circle(lines.ends[own, 0])
        if circle is None or not BUBBLE[0] * extent < circle.radius < BUBBLE[1] * extent:
            continue
        if segments.lengths(lines.ends[own]).sum() > 0.9 * 2 * np.pi * circle.radius:
            bubbles.append([*circle.centre, circle.radius])
            of.append(own)
    if len(bubbles) < LEAST_BUBBLES:
        return result
    circles = np.array(bubbles)
    alike = np.abs(circles[:, 2] / np.median(circles[:, 2]) - 1) < 0.05
    long = ~lines.is_curved & (segments.lengths(lines.ends) > LONG_AXIS * extent)
    at = np.flatnonzero(long)
    away = lines.ends[at][:, :, None] - circles[None, None, :, :2]
    along = segments.directions(lines.ends[at])
    # Of each line, end and circle: how far the end is from the ring, and the line from the middle.
    ring = np.abs(np.linalg.norm(away, axis=3) / circles[:, 2] - 1)
    aside = np.abs(along[:, None, None, 0] * away[..., 1] - along[:, None, None, 1] * away[..., 0])
    points_at = (ring < 0.1) & (aside < 0.1 * circles[:, 2]) & alike
    is_axis = points_at.any(axis=(1, 2))
    if is_axis.sum() < LEAST_BUBBLES:
        return result
    result[at[is_axis]] = True
    for k in np.flatnonzero(points_at.any(axis=(0, 1))):
        result[of[k]] = True
    return result


def lines_of_plain_axes(lines: Lines, extent: float) -> Bool[np.ndarray, " n"]:
    """Straight lines through the whole drawing that run on beyond all else at both ends and end at nothing.

    Args:
        lines: of the drawing.
        extent: of it.
    """
    result = np.zeros(len(lines), dtype=bool)
    at = _long_and_free(lines, extent)
    if len(at) == 0:
        return result
    others = np.setdiff1d(np.arange(len(lines)), at)
    if len(others) == 0:
        return result
    strings = line_strings(lines.ends)
    i, j = shapely.STRtree(strings[others]).query(strings[at], predicate="intersects")
    start = lines.ends[at, 0]
    along = segments.directions(lines.ends[at])
    met = shapely.intersection(strings[at][i], strings[others][j])
    points, of = shapely.get_coordinates(met, return_index=True)
    place = np.einsum("pi,pi->p", points - start[i[of]], along[i[of]])
    first, last = extremes(place, i[of], len(at))
    tails = np.stack([first, segments.lengths(lines.ends[at]) - last], axis=1) / extent
    is_axis = np.isfinite(first) & (np.bincount(i, minlength=len(at)) >= LEAST_CROSSED)
    is_axis &= (tails.min(axis=1) > TAILS[0]) & (tails.max(axis=1) > TAILS[1])
    if is_axis.sum() >= LEAST_PLAIN:
        result[at[is_axis]] = True
    return result


def _long_and_free(lines: Lines, extent: float) -> Int[np.ndarray, " k"]:
    """Lines that run through half of the drawing and whose ends meet nothing."""
    length, along = segments.lengths(lines.ends), segments.directions(lines.ends)
    at = np.flatnonzero(~lines.is_curved & (length > LONG_AXIS * extent))
    if not len(at):
        return at
    hull = shapely.convex_hull(shapely.multipoints(lines.ends.reshape(-1, 2)))
    whole = np.ptp(shapely.get_coordinates(hull) @ along[at].T, axis=0)
    at = at[length[at] > SPAN * whole]
    if not LEAST_PLAIN <= len(at) <= MOST_LONG:
        return at[:0]
    meets = ends_that_meet(lines.ends[at], at, line_strings(lines.ends), FREE * extent)
    return at[~meets.any(axis=1)]
