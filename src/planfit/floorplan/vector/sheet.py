"""What a sheet has around its plan, where no layer tells it apart: the frame with its title block, chains
of dimensions, and axes. They are pairs of parallel lines, or run beside faces of walls, as walls do."""

from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from planfit.floorplan.faces import (
    Ends,
    covered_lengths,
    ends_that_meet,
    groups_within,
    line_strings,
)
from planfit.floorplan.vector.arcs import fit_circle
from planfit.floorplan.vector.drawing import Lines, VectorDrawing
from planfit.floorplan.vector.layer_names import Role
from planfit.floorplan.vector.line_work import extremes, usual_extent
from planfit.floorplan.vector.single_lines import SPANNED
from planfit.geometry import segments

FRAME_LAYER, DIMENSION_LAYER = "frame of the sheet", "lines of dimensions"
AXIS_LAYER, PLAIN_AXIS_LAYER = "axes with bubbles", "axes without bubbles"
TABLE_LAYER, LEAST_RULES = "rules of tables", 8
"""So many parallel lines from one margin to another, which meet nothing, are rules between rows of text. The
steps of a stair end at its walls."""
DASHED_LAYER, MOST_DASHED = "dashed lines", 0.35
"""Beams overhead, cupboards on walls, what is below: of the length of the lines; where more is dashed, walls
are drawn so."""
PALE_LAYER = "lines as pale as floors"
"""Grids, and edges of floors."""
ON, WHOLE, MOST_FRAMES = 1e-3, 0.97, 6
"""Lines within this share of a side are on it; they cover so much of each side of a frame, one in another."""
HUGGED, NEAR_SHARE = 0.4, 0.06
"""Beside the outer face of a building runs its inner one, within this share of its shorter side and along at
least so much of the whole; a frame keeps away from what it frames."""
TITLE_SHARE = 0.3
LONGEST_TICK = 0.03
"""Of the drawing's size; 0.4 m in a house of 13 m. They are drawn as 2 to 4 mm of paper."""
TICK_SINE = (float(np.sin(np.deg2rad(25.0))), float(np.sin(np.deg2rad(65.0))))
ON_LINE = 0.05
"""Of a tick's length: its middle is so near to the line that it ends, and nothing else to its own ends."""
ALIKE = 0.15
"""Ticks of one chain differ by less in length."""
BUBBLE, LEAST_BUBBLES, LONG_AXIS = (3e-3, 0.05), 3, 0.2
"""Radius of the circles that name axes, of the drawing's size; a plan has so many, and axes so long."""
FREE = 2e-3
"""Of the drawing's size: the end of an axis is further from all else."""
TAILS = (4e-3, 0.02)
"""Of the drawing's size, what an axis runs on beyond all else at its two ends: draughtsmen let lines of walls
cross at corners by 0.1 to 0.3 m of 15."""
LEAST_PLAIN, LEAST_CROSSED = 3, 2
"""So many axes without bubbles there are, through so many lines each."""
MOST_LONG = 500
"""Lines as long as half of the drawing that are looked at: real ones have at most some 50."""


def without_sheet(drawing: VectorDrawing, roles: list[Role]) -> tuple[VectorDrawing, list[Role]]:
    """The drawing with frames, title blocks, lines of dimensions and axes on layers of their own, which hold
    no walls; lines on layers called wall stay.

    `drawing`: cleaned.
    """
    lines = drawing.lines
    if len(lines) == 0:
        return drawing, roles
    extent = usual_extent(lines.ends.reshape(-1, 2))
    role = np.array(roles, dtype=int)[lines.layer]
    layers, layer = list(drawing.layers), lines.layer.copy()
    is_unknown, taken = role == Role.UNKNOWN, np.zeros(len(lines), dtype=bool)
    kinds: list[tuple[str, Bool[np.ndarray, " n"]]] = []
    for name, may_be, lines_of in (
        (FRAME_LAYER, role != Role.NO_WALL, lambda own, _: lines_of_frame(own)),
        (DIMENSION_LAYER, is_unknown & ~lines.is_curved, lines_of_dimensions),
        (TABLE_LAYER, is_unknown & ~lines.is_curved, lines_of_tables),
        (AXIS_LAYER, is_unknown, lines_of_axes),
        (PLAIN_AXIS_LAYER, is_unknown, lines_of_plain_axes),
    ):
        at, found = np.flatnonzero(may_be & ~taken), np.zeros(len(lines), dtype=bool)
        found[at] = lines_of(lines.take(at), extent)
        taken |= found
        kinds.append((name, found))
    kinds.append((DASHED_LAYER, _are_dashed(lines, role) & ~kinds[-1][1]))
    kinds.append((PALE_LAYER, _are_pale(lines, role)))
    for name, found in kinds:
        found &= role != Role.WALL
        if found.any():
            layer[found] = len(layers)
            layers.append(name)
            roles = [*roles, Role.NO_WALL]
    return replace(drawing, lines=replace(lines, layer=layer), layers=tuple(layers)), roles


def _are_dashed(lines: Lines, role: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Straight lines with gaps, on layers that no name tells, where most lines have none."""
    looked_at = (role != Role.NO_WALL) & ~lines.is_curved
    found = looked_at & lines.is_dashed & (role == Role.UNKNOWN)
    length = segments.lengths(lines.ends)
    few = length[looked_at & lines.is_dashed].sum() < MOST_DASHED * length[looked_at].sum()
    return found & few


def _are_pale(lines: Lines, role: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Straight lines as pale as floors, on layers that no name tells, where others go as far."""
    looked_at = (role != Role.NO_WALL) & ~lines.is_curved
    found = looked_at & lines.is_pale & (role == Role.UNKNOWN)
    dark = lines.ends[looked_at & ~lines.is_pale].reshape(-1, 2)
    if len(dark) == 0 or not found.any():
        return np.zeros(len(lines), dtype=bool)
    reach = np.ptp(lines.ends[found].reshape(-1, 2), axis=0)
    return found & bool((np.ptp(dark, axis=0) >= SPANNED * reach).all())


def lines_of_frame(lines: Lines) -> Bool[np.ndarray, " n"]:
    """Rectangles around everything else, what is outside of the innermost, and what hangs on it.

    A building's outer faces are such a rectangle too, if no door is in them: beside them run the inner
    ones. Nothing is taken for a frame that has neither a title block nor doors inside.
    """
    none = np.zeros(len(lines), dtype=bool)
    if len(lines) < 8:
        return none
    box, on_side = _innermost_frame(lines)
    if box is None:
        return none
    size = box[1] - box[0]
    near = ON * float(size.max())
    is_inside = ((lines.ends > box[0] - near) & (lines.ends < box[1] + near)).all(axis=(1, 2))
    inside = np.flatnonzero(is_inside & ~on_side)
    if len(inside) == 0:
        return none
    ends, length = lines.ends[inside], segments.lengths(lines.ends[inside])
    group = groups_within(ends, near)
    at_frame = np.minimum(ends - box[0], box[1] - ends).min(axis=(1, 2)) < near
    hangs = (np.bincount(group, at_frame) > 0)[group]
    free = ~hangs
    perimeter = 2.0 * float(size.sum())
    # The title block hangs on it, which has a corner of it.
    if length[free].sum() < max(perimeter, 2 * length[hangs].sum()):
        return none
    if lines.is_curved[inside[hangs]].any() or _is_hugged(ends[free], box):
        return none
    has_title = bool(hangs.any()) and _is_title(ends[hangs], box)
    if not (has_title or lines.is_curved[inside[free]].any()):
        return none
    result = ~is_inside | on_side
    if has_title:
        result[inside[hangs]] = True
    return result


def _innermost_frame(
    lines: Lines,
) -> tuple[Float[np.ndarray, "2 2"] | None, Bool[np.ndarray, " n"]]:
    """Lowest and highest corner of the last rectangle around all else, one in another, and its lines."""
    ends, along = lines.ends, np.abs(segments.directions(lines.ends))
    length = segments.lengths(ends)
    is_upright = (along.max(axis=1) > np.cos(1e-3)) & ~lines.is_curved
    left = length > 0.05 * float(np.ptp(ends.reshape(-1, 2), axis=0).max())
    box, found = None, np.zeros(len(lines), dtype=bool)
    for _ in range(MOST_FRAMES):
        if left.sum() < 8:
            break
        points = ends[left].reshape(-1, 2)
        low, high = points.min(axis=0), points.max(axis=0)
        at, near = np.flatnonzero(is_upright & left), ON * float((high - low).max())
        is_along, covered = _along_sides(ends[at], np.stack([low, high]), near)
        n_whole = int((covered >= WHOLE * (high - low)[::-1, None]).sum())
        if n_whole < 3:
            break
        on_side = np.zeros(len(lines), dtype=bool)
        on_side[at[is_along]] = True
        if n_whole == 4:
            box, found = np.stack([low, high]), on_side
        else:
            # A trim that marks for folding cross: another frame is within, or it is none.
            on_side |= (np.minimum(ends - low, high - ends) < near).any(axis=(1, 2))
        left &= ~on_side
    return box, found


def _along_sides(
    ends: Ends, box: Float[np.ndarray, "2 2"], near: float
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, "2 2"]]:
    """Lines that are near one side of a box all along, and how much of each side they cover, by the axis that
    it is across and whether it is the lower one."""
    result, covered = np.zeros(len(ends), dtype=bool), np.zeros((2, 2))
    for axis, side in np.ndindex(2, 2):
        at = np.abs(ends[:, :, axis] - box[side, axis]).max(axis=1) < near
        low, high = np.sort(ends[at][:, :, 1 - axis], axis=1).T
        covered[axis, side] = covered_lengths(np.zeros(len(low), dtype=int), low, high, 1)[0]
        result |= at
    return result, covered


def _is_hugged(ends: Ends, box: Float[np.ndarray, "2 2"]) -> bool:
    """Whether lines run along a box inside of it, near it and for much of its length."""
    size = box[1] - box[0]
    _, covered = _along_sides(ends, box, NEAR_SHARE * float(size.min()))
    return float(covered.sum()) > HUGGED * 2.0 * float(size.sum())


def _is_title(ends: Ends, box: Float[np.ndarray, "2 2"]) -> bool:
    """Whether lines that hang on a frame are upright and lie in a strip or a corner of it."""
    along = np.abs(segments.directions(ends)).max(axis=1)
    low, high = ends.min(axis=(0, 1)), ends.max(axis=(0, 1))
    area, whole = float(np.prod(high - low)), float(np.prod(box[1] - box[0]))
    return bool((along > np.cos(1e-3)).mean() > 0.8) and area < TITLE_SHARE * whole


def lines_of_tables(lines: Lines, extent: float) -> Bool[np.ndarray, " n"]:
    """Many parallel lines, longer than treads, that begin and end at the same margins and meet no other."""
    ends, n, near = lines.ends, len(lines), ON * extent
    result = np.zeros(n, dtype=bool)
    along = np.abs(segments.directions(ends))
    strings = line_strings(ends)
    for axis in (0, 1):
        is_long = segments.lengths(ends) > 0.1 * extent
        at = np.flatnonzero((along[:, axis] > np.cos(1e-3)) & is_long)
        margins = np.round(np.sort(ends[at][:, :, axis], axis=1) / near).astype(int)
        _, group, count = np.unique(margins, axis=0, return_inverse=True, return_counts=True)
        for k in np.flatnonzero(count >= LEAST_RULES):
            own = at[group.ravel() == k]
            others = np.setdiff1d(np.arange(n), own)
            line, _ = shapely.STRtree(strings[others]).query(strings[own], "dwithin", distance=near)
            free = np.setdiff1d(own, own[line])
            # Between rules is a row of text, between hatches none.
            across: Float[np.ndarray, " f"] = ends[free].mean(axis=1)[:, 1 - axis]
            gaps = np.diff(np.sort(across)).astype(float)
            result[free] = len(free) >= LEAST_RULES and np.median(gaps) > near
    return result


def lines_of_dimensions(lines: Lines, extent: float) -> Bool[np.ndarray, " n"]:
    """Lines with a slanted tick at both ends, the ticks, and the lines from a tick to what is measured.

    `lines`: straight ones.
    """
    n = len(lines)
    result = np.zeros(n, dtype=bool)
    length = segments.lengths(lines.ends)
    ticks = np.flatnonzero((length < LONGEST_TICK * extent) & (length > 1e-3 * extent))
    if len(ticks) < 2:
        return result
    along, strings = segments.directions(lines.ends), line_strings(lines.ends)
    # Strokes of hatches and outlines meet others at their ends.
    meets = ends_that_meet(lines.ends[ticks], ticks, strings, ON_LINE * length[ticks])
    ticks = ticks[~meets.any(axis=1)]
    middles = lines.ends[ticks].mean(axis=1)
    points = np.asarray(shapely.points(middles), dtype=object)
    reach = 0.1 * LONGEST_TICK * extent
    k, base = shapely.STRtree(strings).query(points, "dwithin", reach)
    tick = ticks[k]
    sine = np.abs(along[tick, 0] * along[base, 1] - along[tick, 1] * along[base, 0])
    start = middles[k] - lines.ends[base, 0]
    off = np.abs(along[base, 0] * start[:, 1] - along[base, 1] * start[:, 0])
    at = np.einsum("pi,pi->p", start, along[base])
    is_tick = (sine > TICK_SINE[0]) & (sine < TICK_SINE[1]) & (off < ON_LINE * length[tick])
    is_tick &= length[base] > 2 * length[tick]
    tick, base, at, k = tick[is_tick], base[is_tick], at[is_tick], k[is_tick]
    bases, used = [], []
    for line in np.unique(base):
        own = np.flatnonzero(base == line)
        usual = float(np.median(length[tick[own]]))
        own = own[np.abs(length[tick[own]] - usual) < ALIKE * usual]
        has_first = (np.abs(at[own]) < 1.2 * usual).any()
        has_last = (np.abs(at[own] - length[line]) < 1.2 * usual).any()
        if has_first and has_last:
            bases.append(line)
            used.append(own)
    if not bases:
        return result
    own = np.concatenate(used)
    result[bases] = True
    result[tick[own]] = True
    result |= _extension_lines(lines, middles[k[own]], length[tick[own]], base[own], result)
    return result


def _extension_lines(
    lines: Lines,
    ticks: Float[np.ndarray, "t 2"],
    size: Float[np.ndarray, " t"],
    base: Int[np.ndarray, " t"],
    is_known: Bool[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Lines across a line of dimensions at a tick, which end near it on one side and meet nothing else.

    Args:
        lines: straight ones.
        ticks: their middles.
        size: their lengths.
        base: the line that each is on.
        is_known: lines of dimensions and ticks.
    """
    along, strings = segments.directions(lines.ends), line_strings(lines.ends)
    reach = float(np.median(size))
    points = np.asarray(shapely.points(ticks), dtype=object)
    k, line = shapely.STRtree(strings).query(points, predicate="dwithin", distance=3.0 * reach)
    start = ticks[k] - lines.ends[line, 0]
    off = np.abs(along[line, 0] * start[:, 1] - along[line, 1] * start[:, 0])
    is_across = np.abs(np.einsum("pi,pi->p", along[line], along[base[k]])) < 0.02
    chosen = is_across & (off < 0.1 * size[k]) & ~is_known[line]
    line = np.unique(line[chosen])
    result = np.zeros(len(lines), dtype=bool)
    if len(line) == 0:
        return result
    others = np.delete(strings, np.union1d(np.flatnonzero(is_known), line))
    meets = ends_that_meet(lines.ends[line], np.full(len(line), -1), others, 0.1 * reach)
    result[line[~meets.any(axis=1)]] = True
    return result


def lines_of_axes(lines: Lines, extent: float) -> Bool[np.ndarray, " n"]:
    """Long lines that end at small circles of one size, pointing at their middle, and the circles.

    `lines`: of the drawing, in the order of the file.
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
    """Straight lines through the drawing that run on beyond all else at both ends and end at nothing."""
    result = np.zeros(len(lines), dtype=bool)
    at = _long_and_free(lines, extent)
    others = np.setdiff1d(np.arange(len(lines)), at)
    if len(at) == 0 or len(others) == 0:
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
    if len(at) < LEAST_PLAIN:
        return at[:0]
    hull = shapely.convex_hull(shapely.multipoints(lines.ends.reshape(-1, 2)))
    whole = np.ptp(shapely.get_coordinates(hull) @ along[at].T, axis=0)
    at = at[length[at] > whole / 2]
    if len(at) > MOST_LONG:
        return at[:0]
    meets = ends_that_meet(lines.ends[at], at, line_strings(lines.ends), FREE * extent)
    return at[~meets.any(axis=1)]
