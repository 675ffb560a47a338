"""Walls drawn as strokes as wide as they are thick."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float, Shaped
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import (
    PARALLEL_SINE,
    Ends,
    covered_lengths,
    ends_that_meet,
    find_partners,
    line_strings,
    weighted_median,
)
from planfit.floorplan.vector.line_work import usual_extent
from planfit.geometry import segments

WIDE, WIDEST = 7e-3, 0.05
"""Of the drawing's size. Pens of 0.7 mm are 1.7e-3 of a sheet of 420 mm, walls of 0.1 to 0.4 m 8e-3 to 3e-2
of a house of 13 m. Narrower ones are read as single lines, whose thickness an alignment finds."""
FINER = 3.0
"""The usual one of the finer lines is so many times as fine."""
THINNER = 0.45
"""Partitions are at least so many times as thick as walls usually are: 0.115 m beside 0.24 by DIN 4172. Finer
pens are those of doors, windows and dimensions, which hang on walls as well."""
PAIRED, PAIR_GAP = 0.5, 4.5
"""Strokes with another beside them for so much of their length, so many widths off at most, are the two faces
of walls in a broad pen."""
MOST_COVERED, LEAST_SLIM = 0.45, 2.5
"""Of the hull, what walls cover; and how slim they are (`slimness`)."""
MANY = 5_000
"""Fewer strokes of one pen are line work: of a real floor 1,000 to 3,000 may be faces. 50,000 take 6 s."""
_TWICE = 2.0
"""Strokes that fill an area lie on one another: their own areas together are so many times the area."""


@dataclass(frozen=True)
class Pen:
    """What a path is drawn with."""

    width: float
    """In the drawing's unit; 0 for the finest line there is."""
    colour: tuple[int, int, int] | None
    """RGB from 0 to 255; None where the file does not tell."""
    is_dashed: bool = False
    """With gaps, as what lies above or below is drawn."""


def are_bodies(
    ends: Ends, width: Float[np.ndarray, " n"], may: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Which lines are walls by themselves: as wide as walls are thick, finer ones beside them being none.

    Args:
        width: of their strokes, in its unit; 0 where unknown.
        may: those in a colour that walls have.
    """
    none = np.zeros(len(ends), dtype=bool)
    if not (may & (width > 0)).any():
        return none
    extent, length = usual_extent(ends.reshape(-1, 2)), segments.lengths(ends)
    fine = (width < WIDE * extent) & (length > 0)
    least = WIDE * extent
    if fine.any():
        least = max(least, FINER * weighted_median(width[fine], length[fine]))
    chosen = np.flatnonzero(may & (width >= least) & (width < WIDEST * extent) & (length > 0))
    if len(chosen) == 0:
        return none
    widest = float(width[chosen].max())
    pairs = find_partners(ends[chosen], PAIR_GAP * widest, 1e-6 * extent, 0.0, PARALLEL_SINE)
    is_near = np.abs(pairs.gap) < PAIR_GAP * width[chosen][pairs.line]
    is_near &= np.abs(pairs.gap) > 0.5 * width[chosen][pairs.line]
    near = pairs.take(is_near)
    beside = covered_lengths(near.line, near.low, near.high, len(chosen))
    if beside.sum() > PAIRED * length[chosen].sum():
        return none
    body = body_of_strokes(ends[chosen], width[chosen])
    hull = shapely.convex_hull(body).area
    if body.area < MOST_COVERED * hull and slimness(body) > LEAST_SLIM:
        none[chosen] = True
        finer = may & ~none & (length > 0)
        finer &= width >= THINNER * weighted_median(width[chosen], length[chosen])
        for each in np.unique(width[finer]):
            own = np.flatnonzero(finer & (width == each))
            none[own[_hang_on(ends[own], float(each), body)]] = True
    return none


def slimness(area: BaseGeometry) -> float:
    """Perimeter squared over sixteen areas: a square has 1."""
    return area.length**2 / (16 * max(area.area, 1e-300))


def _hang_on(ends: Ends, width: float, body: BaseGeometry) -> Bool[np.ndarray, " n"]:
    """Which strokes of one pen go on from walls, straight or by way of others of their own."""
    own = _bodies(ends, np.full(len(ends), width))
    joined = shapely.get_parts(shapely.union_all(shapely.buffer(own, 0.1 * width)))
    part, _ = shapely.STRtree([body]).query(joined, predicate="intersects")
    _, line = shapely.STRtree(own).query(joined[np.unique(part)], predicate="intersects")
    return np.isin(np.arange(len(ends)), line)


def body_of_strokes(ends: Ends, width: Float[np.ndarray, " n"]) -> BaseGeometry:
    """Area that strokes cover. An end that meets another stroke goes on for half a width, which closes
    corners; one at a door does not, nor one that reached the far side of the other already."""
    lines = line_strings(ends)
    along = segments.directions(ends)
    meets = ends_that_meet(ends, np.arange(len(ends)), lines, 0.6 * width)
    step = 0.5 * width[:, None] * along
    outwards = np.stack([-step, step], axis=1)
    longer = _bodies(ends + meets[:, :, None] * outwards, width)
    meets &= ends_that_meet(ends + 0.2 * outwards, np.arange(len(ends)), longer, 0.05 * width)
    return shapely.union_all(_bodies(ends + meets[:, :, None] * outwards, width))


def _bodies(ends: Ends, width: Float[np.ndarray, " n"]) -> Shaped[np.ndarray, " n"]:
    """What each stroke covers."""
    return shapely.buffer(line_strings(ends), width / 2, cap_style="flat", join_style="mitre")


def area_of_strokes(ends: Ends, width: float) -> BaseGeometry:
    """What strokes of one width fill where they lie side by side, to the middle of the outermost; empty where
    they are lines, or too few to be a fill.

    `ends`: straight strokes; `width`: of the pen, in the same unit.
    """
    if len(ends) < MANY:
        return shapely.Polygon()
    bodies = shapely.buffer(line_strings(ends), 0.5 * width, cap_style="square", quad_segs=1)
    # Steps where strokes end cost minutes below, and are no edges.
    body = shapely.simplify(shapely.union_all(bodies), 0.25 * width)
    if shapely.area(bodies).sum() < _TWICE * body.area:
        return shapely.Polygon()
    core = shapely.buffer(body, -1.0 * width, join_style="mitre")
    return shapely.buffer(core, 0.5 * width, join_style="mitre")


def are_in_area(ends: Ends, area: BaseGeometry, width: float) -> Bool[np.ndarray, " n"]:
    """Which strokes an area is made of, its outline included."""
    grown = shapely.buffer(area, width, join_style="mitre")
    shapely.prepare(grown)
    return shapely.covers(grown, line_strings(ends))
