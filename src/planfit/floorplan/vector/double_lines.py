"""Walls drawn as two parallel lines: which lines are the faces of walls, and which way they look.

Nothing else in a plan is so thin for so long. What comes near is told apart by how it stands:
treads and hatches in rows at equal distance, panes of windows between two other lines, furniture
in short lines that touch nothing.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from planfit.floorplan.faces import (
    PARALLEL_SINE,
    Ends,
    Partners,
    connected_groups,
    covered_lengths,
    find_partners,
    line_strings,
    weighted_median,
)
from planfit.floorplan.vector.line_work import WallFaces
from planfit.floorplan.vector.wall_sides import (
    inner_lines,
    side_seen_from_partner,
    sides_with_room,
    votes_of_other_faces,
    wall_sides,
)
from planfit.geometry import segments
from planfit.priors import WALL_FACES_APART_M, WALL_LINES_APART_LEAST_M

MAX_OPENING = 25.0
"""Widest opening between parts of one wall, in thicknesses of the usual wall: 2.5 m for one of 10 cm."""
ALIKE, SELDOM = (0.9, 1.1), 0.02
LEAST_OFTEN, SURELY_OFTEN = 6.0, 60.0
"""A thickness is one of walls where, within such shares of it, walls have such a share of all their length;
at least and at most so many thicknesses. At 0.04 the few thick walls of an office were lost."""


@dataclass(frozen=True)
class Thickness:
    """How thick walls are in this drawing, in its own unit."""

    usual: float
    least: float
    most: float


def thickness_bounds(metres_per_unit: float | None, extent: float) -> tuple[float, float]:
    """Least and most thickness that a wall may have, in the drawing's unit."""
    if metres_per_unit is None:
        return extent / 3000, extent / 25
    return (
        WALL_LINES_APART_LEAST_M.value / metres_per_unit,
        WALL_FACES_APART_M.high / metres_per_unit,
    )


def estimate_thickness(
    ends: Ends, metres_per_unit: float | None, extent: float
) -> Thickness | None:
    """Thickness of most of the walls: of the gaps from each line to the nearest beside it, the one in
    the middle of all the length that has one. None where no lines lie side by side."""
    least, most = thickness_bounds(metres_per_unit, extent)
    pairs = find_partners(ends, most, least, 0.0, PARALLEL_SINE)
    gap, overlap = np.abs(pairs.gap), pairs.high - pairs.low
    is_long = overlap > 3 * gap
    if not is_long.any():
        return None
    line, gap, overlap = pairs.line[is_long], gap[is_long], overlap[is_long]
    # Sorted by line, then by gap: the first of each line is its nearest.
    order = np.lexsort((gap, line))
    _, first = np.unique(line[order], return_index=True)
    nearest = order[first]
    usual = weighted_median(gap[nearest], overlap[nearest])
    if metres_per_unit is None:
        return Thickness(usual, 0.2 * usual, min(4 * usual, most))
    return Thickness(usual, least, most)


def rows_of_lines(
    ends: Ends, style: Int[np.ndarray, " n"], max_gap: float
) -> Bool[np.ndarray, " n"]:
    """Which lines belong to a row of six or more alike at equal distance: hatches, treads.

    Two neighbours at equal distance on its two sides make a line regular; four regular ones that
    follow each other make a row. The panes of a window are fewer.
    """
    n = len(ends)
    is_row = np.zeros(n, dtype=bool)
    if n == 0:
        return is_row
    pairs = find_partners(ends, max_gap, 1e-6 * max_gap, 0.0, PARALLEL_SINE)
    length = segments.lengths(ends)
    alike = (style[pairs.line] == style[pairs.partner]) & (
        pairs.high - pairs.low > 0.4 * np.minimum(length[pairs.line], length[pairs.partner])
    )
    nearest = []
    for side in (1, -1):
        chosen = np.flatnonzero(alike & (pairs.gap * side > 0))
        order = chosen[np.lexsort((np.abs(pairs.gap[chosen]), pairs.line[chosen]))]
        lines, first = np.unique(pairs.line[order], return_index=True)
        partner, gap = np.full(n, -1), np.full(n, np.nan)
        partner[lines] = pairs.partner[order[first]]
        gap[lines] = np.abs(pairs.gap[order[first]])
        nearest.append((partner, gap))
    (left, gap_left), (right, gap_right) = nearest
    both = (left >= 0) & (right >= 0)
    with np.errstate(invalid="ignore"):
        is_regular = both & (np.abs(gap_left - gap_right) < 0.1 * (gap_left + gap_right) / 2)
    at = np.flatnonzero(is_regular)
    group = connected_groups(np.tile(at, 2), np.concatenate([left[at], right[at]]), n)
    regular = np.bincount(group, is_regular)
    return _families(ends, style, regular[group] >= 4)


def _families(
    ends: Ends, style: Int[np.ndarray, " n"], is_row: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Rows, and what else is drawn in the same style and direction where nearly all such lines are in
    rows: the few hatch lines of a small area."""
    along = segments.directions(ends)
    angle = np.round(np.rad2deg(np.arctan2(along[:, 1], along[:, 0])) % 180.0).astype(int) % 180
    _, family = np.unique(np.stack([style, angle], axis=1), axis=0, return_inverse=True)
    family = family.ravel()
    total, in_row = np.bincount(family), np.bincount(family, is_row)
    return is_row | ((in_row > 20) & (in_row > 0.6 * total))[family]


def faces_of_lines(
    ends: Ends,
    thickness: Thickness,
    is_surely_wall: Bool[np.ndarray, " n"],
    free_side: Int[np.ndarray, " n"],
) -> WallFaces:
    """Faces of walls drawn as two lines.

    Args:
        ends: merged, no two on one another.
        thickness: of the walls to look for.
        is_surely_wall: lines that something else (the name of their layer) calls wall.
        free_side: 1 where the left side is known to be free, -1 the right, 0 unknown.
    """
    is_surely_wall = is_surely_wall | (free_side != 0)
    free_side = np.where(free_side != 0, free_side, sides_with_room(ends, thickness.most))
    has_room = free_side != 0
    # No wall is where one of two lines has room towards the other.
    least, most = thickness.least, thickness.most
    near = find_partners(ends, most, least, 0.5 * least, PARALLEL_SINE)
    near = near.take(~_are_beside_single(ends, near, is_surely_wall))
    is_long = near.high - near.low > 0.8 * np.abs(near.gap)
    pairs = near.take(is_long & ~_is_free_between(ends, near, free_side))
    # The other face of a wall is known by the first, unless both lie beside it: then it is within the wall.
    votes, is_between = votes_of_other_faces(ends, pairs, free_side)
    may_be = ~has_room & (is_between | ~votes.any(axis=0))
    is_inner = inner_lines(ends, pairs, thickness.most) & may_be
    voted = np.where(is_inner, 0, np.sign(votes[0] - votes[1]).astype(int))
    free_side = np.where(has_room, free_side, voted)
    is_out = is_inner[pairs.line] | is_inner[pairs.partner]
    pairs = pairs.take(~is_out & ~_is_free_between(ends, pairs, free_side))
    # Of the rest the nearer and longer neighbour decides.
    wall_side = wall_sides(ends, pairs, free_side)
    seen = side_seen_from_partner(ends, pairs)
    keep = (wall_side[pairs.line] == np.sign(pairs.gap)) & (wall_side[pairs.partner] == seen)
    pairs = pairs.take(keep)
    is_certain = has_room[pairs.line] & has_room[pairs.partner]
    reach = MAX_OPENING * _usual_of_certain(pairs, is_certain, thickness)
    is_called = is_surely_wall[pairs.line] | is_surely_wall[pairs.partner]
    pairs = pairs.take(is_called | _are_as_thick(pairs, is_certain | is_called))
    in_wall = _standing(ends, pairs, thickness, is_surely_wall, reach)
    pairs = pairs.take(in_wall[pairs.line])
    return _faces(ends, _with_short(ends, pairs, near, wall_side), wall_side, thickness)


def _are_beside_single(
    ends: Ends, near: Partners, is_called: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " p"]:
    """Pairs of a line that is called wall and one that is not, where most lines that are have no other of
    them beside them: walls are drawn as single lines there, and dimension and grid lines run beside them."""
    both, one = is_called[near.line] & is_called[near.partner], is_called[near.line]
    paired = covered_lengths(near.line[both], near.low[both], near.high[both], len(ends))
    length = segments.lengths(ends)
    if paired[is_called].sum() > length[is_called].sum() / 2:
        return np.zeros(len(one), dtype=bool)
    return one != is_called[near.partner]


def _is_free_between(
    ends: Ends, pairs: Partners, free_side: Int[np.ndarray, " n"]
) -> Bool[np.ndarray, " p"]:
    """Pairs with the free side of one of their lines towards the other: no wall is between them."""
    return (free_side[pairs.line] == np.sign(pairs.gap)) | (
        free_side[pairs.partner] == side_seen_from_partner(ends, pairs)
    )


def _are_as_thick(pairs: Partners, is_certain: Bool[np.ndarray, " p"]) -> Bool[np.ndarray, " p"]:
    """Pairs as far apart as enough that have room on both sides: walls have few thicknesses, furniture many.
    All where such pairs are not most."""
    gap, overlap = np.abs(pairs.gap), pairs.high - pairs.low
    if overlap[is_certain].sum() <= overlap.sum() / 2:
        return np.ones(len(gap), dtype=bool)
    order = np.argsort(gap[is_certain])
    known = gap[is_certain][order]
    length = np.concatenate([[0.0], np.cumsum(overlap[is_certain][order])])
    low, high = np.searchsorted(known, ALIKE[0] * gap), np.searchsorted(known, ALIKE[1] * gap)
    enough = np.clip(SELDOM * length[-1], LEAST_OFTEN * gap, SURELY_OFTEN * gap)
    return length[high] - length[low] > enough


def _usual_of_certain(
    pairs: Partners, is_certain: Bool[np.ndarray, " p"], thickness: Thickness
) -> float:
    """How thick walls usually are by the pairs with room on both sides, where these are most and it is more:
    what is counted before has furniture in it."""
    overlap = pairs.high - pairs.low
    if overlap[is_certain].sum() <= overlap.sum() / 2:
        return thickness.usual
    certain = weighted_median(np.abs(pairs.gap)[is_certain], overlap[is_certain])
    return max(certain, thickness.usual)


def _with_short(
    ends: Ends, pairs: Partners, near: Partners, wall_side: Int[np.ndarray, " n"]
) -> Partners:
    """`pairs` of faces of walls, and of all that are `near` those that lie as deep beside one another for
    less than a wall's thickness: between a corner and the next wall there may be no more."""
    n = len(ends)
    in_wall, depth = np.zeros(n, dtype=bool), np.zeros(n)
    in_wall[pairs.line] = True
    np.maximum.at(depth, pairs.line, np.abs(pairs.gap))
    keep = in_wall[near.line] & in_wall[near.partner]
    keep &= wall_side[near.line] == np.sign(near.gap)
    keep &= wall_side[near.partner] == side_seen_from_partner(ends, near)
    keep &= np.abs(near.gap) <= 1.01 * depth[near.line]
    both = Partners.together([pairs, near.take(keep)])
    return both.take(np.argsort(both.line, kind="stable"))


def _standing(
    ends: Ends,
    pairs: Partners,
    thickness: Thickness,
    is_surely_wall: Bool[np.ndarray, " n"],
    reach: float,
) -> Bool[np.ndarray, " n"]:
    """Lines that belong to a run of wall long enough to be one.

    A run is of lines that are partners or touch. It needs a stretch four times as long as thick,
    and in all as much as a wall beside a door; what the layer calls wall, and columns there, need not.
    """
    n = len(ends)
    lines = line_strings(ends)
    in_pair = np.zeros(n, dtype=bool)
    in_pair[pairs.line] = True
    at = np.flatnonzero(in_pair)
    near = 0.05 * thickness.usual
    a, b = shapely.STRtree(lines[at]).query(lines[at], "dwithin", near)
    a, b = np.concatenate([at[a], pairs.line]), np.concatenate([at[b], pairs.partner])
    group = connected_groups(a, b, n)
    count = int(group.max(initial=-1)) + 1
    overlap = pairs.high - pairs.low
    total = np.bincount(group[pairs.line], overlap, minlength=count) / 2
    slim = np.zeros(count)
    np.maximum.at(slim, group[pairs.line], overlap / np.abs(pairs.gap))
    sure = np.bincount(group, is_surely_wall) > 0
    is_wall = (total > 6 * thickness.usual) & (slim > 4)
    stands = in_pair & (is_wall | (sure & (total > thickness.usual)))[group]
    while True:
        found = _piers(ends, pairs, stands, group, reach)
        if not found.any():
            return stands
        stands |= found


def _piers(
    ends: Ends,
    pairs: Partners,
    stands: Bool[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    reach: float,
) -> Bool[np.ndarray, " n"]:
    """Lines of runs too short to be walls by themselves, both faces of which go on the lines of
    both faces of a wall within `reach`: what is left between two windows, a corner between two."""
    found = np.zeros(len(ends), dtype=bool)
    strings, left = line_strings(ends), segments.left_normals(ends)
    length = segments.lengths(ends)
    new = np.flatnonzero((pairs.line < pairs.partner) & ~stands[pairs.line])
    old = np.flatnonzero(stands[pairs.line])
    if len(new) == 0 or len(old) == 0:
        return found
    tree = shapely.STRtree(strings[pairs.line[old]])
    a, b = tree.query(strings[pairs.line[new]], "dwithin", reach)
    a, b = new[a], old[b]
    off = np.zeros(len(a))
    for mine, other in ((pairs.line, pairs.line), (pairs.partner, pairs.partner)):
        # Seen from the wall, which is longer: its course is the surer one.
        i, j = mine[a], other[b]
        across = np.einsum("pei,pi->pe", ends[i] - ends[j, :1], left[j])
        off = np.maximum(off, np.abs(across).max(axis=1) / length[i])
        off = np.maximum(off, np.abs(across).max(axis=1) / np.abs(pairs.gap[a]))
    in_line = np.isin(group, group[pairs.line[a[off < 0.03]]])
    in_pair = np.zeros(len(ends), dtype=bool)
    in_pair[pairs.line] = in_pair[pairs.partner] = True
    return in_pair & in_line & ~stands


def _faces(
    ends: Ends, pairs: Partners, wall_side: Int[np.ndarray, " n"], thickness: Thickness
) -> WallFaces:
    """Cut each line to where its wall is; corners and T-junctions, where a partner ends a wall's
    thickness early, belong to the face."""
    along, left = segments.directions(ends), segments.left_normals(ends)
    length = segments.lengths(ends)
    starts = np.searchsorted(pairs.line, np.arange(len(ends) + 1))
    new_ends, normals, depths, of_line = [], [], [], []
    for i in np.flatnonzero(np.diff(starts)):
        mine = slice(starts[i], starts[i + 1])
        gap = np.abs(pairs.gap[mine])
        depth = weighted_median(gap, pairs.high[mine] - pairs.low[mine])
        for low, high in _joined(pairs.low[mine], pairs.high[mine], thickness.most):
            if high - low < 1.5 * min(depth, thickness.usual):
                continue  # ends of walls and jambs: too short to hold a scan to
            # Behind the rest are a wall that joins and, at a corner, the wall that goes on.
            low = 0.0 if low <= thickness.most + depth else low
            high = length[i] if high >= length[i] - thickness.most - depth else high
            new_ends.append(ends[i, 0] + np.outer([low, high], along[i]))
            normals.append(-wall_side[i] * left[i])
            depths.append(depth)
            of_line.append(i)
    return WallFaces.oriented(
        np.array(new_ends).reshape(-1, 2, 2),
        np.array(normals).reshape(-1, 2),
        np.array(depths),
        np.array(of_line, dtype=int),
    )


def _joined(
    low: Float[np.ndarray, " k"], high: Float[np.ndarray, " k"], bridge: float
) -> list[tuple[float, float]]:
    """Union of intervals, with gaps up to `bridge` closed."""
    result: list[tuple[float, float]] = []
    for i in np.argsort(low):
        if result and low[i] <= result[-1][1] + bridge:
            result[-1] = (result[-1][0], max(result[-1][1], float(high[i])))
        else:
            result.append((float(low[i]), float(high[i])))
    return result
