"""On which side of a line its wall is: told by what has room beside it, by the other face of the wall, and by
what lies near.

No wall is as wide as a disc of more than the greatest thickness. So where the disc fits against a line there
is a room or the outside. Furniture lies near the face that it stands at, often nearer than the other face of
the wall; but it seldom covers all of a face, and nothing covers the outside.
"""

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from planfit.floorplan.faces import Ends, Partners, covered_lengths, line_strings
from planfit.geometry import segments

ROOM = 1.35
"""How wide a room is at least, in greatest thicknesses, as the disc is: 0.84 m, wider than seats of sofas,
narrower than corridors."""
STEP = 0.5
"""Between places along a line where the disc is tried, in its radii."""
MIN_FREE = 0.1
"""Of a line's length: with less beside it there is nothing. So much must have room on one side; on the other
nothing may."""
CLEAR = 1.02
"""Distance of the disc's middle from the line, in its radii."""
MOST_PLACES = 400_000
"""Of a drawing; larger ones (site plans with their contours) are left as they are."""


def sides_with_room(ends: Ends, widest: float) -> Int[np.ndarray, " n"]:
    """1 where the left side of a line is free, -1 the right, 0 where both or neither have room.

    `ends`: merged, no two on one another; `widest`: what a wall may be thick at most.
    """
    n, radius = len(ends), ROOM * widest / 2
    length = segments.lengths(ends)
    if n == 0 or length.sum() / (STEP * radius) + 3 * n > MOST_PLACES:
        return np.zeros(n, dtype=int)
    count = np.maximum(np.ceil(length / (STEP * radius)).astype(int), 3)
    points, line = segments.spread(ends, count)
    left = segments.left_normals(ends)[line]
    tree = shapely.STRtree(line_strings(ends))
    share = np.zeros((2, n))
    for i, side in enumerate((1.0, -1.0)):
        middle = shapely.points(points + side * CLEAR * radius * left)
        is_near = np.zeros(len(line), dtype=bool)
        # The nearest alone: in a scribble thousands are near.
        is_near[tree.query_nearest(middle, radius, all_matches=False)[0]] = True
        share[i] = np.bincount(line, ~is_near, minlength=n) / count
    is_left = (share[0] >= MIN_FREE) & (share[1] == 0.0)
    is_right = (share[1] >= MIN_FREE) & (share[0] == 0.0)
    return np.where(is_left, 1, np.where(is_right, -1, 0))


def votes_of_other_faces(
    ends: Ends, pairs: Partners, free_side: Int[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "2 n"], Bool[np.ndarray, " n"]]:
    """How much tells that the left side of a line of unknown side is free, or the right: it is the nearest
    behind a line whose side is known, and so the other face of its wall, whatever stands near that one. And
    which lines lie behind two that look away from one another, so that they may be within a wall.

    Votes are lengths in thicknesses: of two walls a thin one is more likely than one as wide as a cupboard.
    """
    seen, gap = side_seen_from_partner(ends, pairs), np.abs(pairs.gap)
    votes, behind_of = np.zeros((2, len(ends))), np.zeros((2, len(ends)), dtype=bool)
    order = np.lexsort((gap, pairs.line))
    starts = np.searchsorted(pairs.line[order], np.arange(len(ends) + 1))
    asked = (free_side[pairs.line] != 0) & (free_side[pairs.partner] == 0)
    for i in np.unique(pairs.line[asked]):
        behind = order[starts[i] : starts[i + 1]]
        reached: list[tuple[float, float]] = []
        for k in behind[pairs.gap[behind] * free_side[i] < 0]:
            low, high = float(pairs.low[k]), float(pairs.high[k])
            hidden = sum(max(0.0, min(high, b) - max(low, a)) for a, b in reached)
            reached.append((low, high))
            # The wall is where the known line is, the free side across.
            free = int(seen[k] > 0)
            behind_of[free, pairs.partner[k]] = True
            if hidden < 0.5 * (high - low):
                votes[free, pairs.partner[k]] += (high - low - hidden) / gap[k]
    return votes, behind_of[0] & behind_of[1]


def _beside(
    ends: Ends, pairs: Partners
) -> tuple[Float[np.ndarray, "2 n"], Float[np.ndarray, "2 n"]]:
    """Left and right of each line: mean distance of what lies there, weighed by its length so that a jamb or
    a short stroke decides nothing, infinite where nothing does; and the share of the line that has any."""
    n, length = len(ends), segments.lengths(ends)
    gaps, shares = np.full((2, n), np.inf), np.zeros((2, n))
    for i, side in enumerate((1, -1)):
        here = pairs.take(np.sign(pairs.gap) == side)
        weight = here.high - here.low
        total = np.bincount(here.line, weight, minlength=n)
        mean = np.bincount(here.line, weight * np.abs(here.gap), minlength=n)
        has = total > 0
        gaps[i, has] = mean[has] / total[has]
        shares[i] = covered_lengths(here.line, here.low, here.high, n) / length
    return gaps, shares


def inner_lines(ends: Ends, pairs: Partners, most: float) -> Bool[np.ndarray, " n"]:
    """Lines with others on both sides all along, all within one wall's thickness: panes of
    windows, cavities, leaves of sliding doors."""
    gaps, shares = _beside(ends, pairs)
    return (shares.min(axis=0) > 1 - MIN_FREE) & (gaps.sum(axis=0) < most)


def wall_sides(
    ends: Ends, pairs: Partners, free_side: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """For each line, 1 where the wall is left of a line, -1 right, 0 where nothing tells."""
    gaps, shares = _beside(ends, pairs)
    left = (shares[0] > MIN_FREE) & ((shares[1] < 0.4 * shares[0]) | (gaps[0] < 0.75 * gaps[1]))
    right = (shares[1] > MIN_FREE) & ((shares[0] < 0.4 * shares[1]) | (gaps[1] < 0.75 * gaps[0]))
    found = np.where(left ^ right, np.where(left, 1, -1), 0)
    return np.where(free_side != 0, -free_side, found)


def side_seen_from_partner(ends: Ends, pairs: Partners) -> Float[np.ndarray, " p"]:
    """For each pair, 1 where `line` is left of `partner`, -1 right."""
    along = segments.directions(ends)
    same_way = np.sign(np.einsum("pi,pi->p", along[pairs.line], along[pairs.partner]))
    return -np.sign(pairs.gap) * same_way
