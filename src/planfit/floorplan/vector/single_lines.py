"""Walls drawn as single lines, whose thickness and free side a drawing does not tell; and whether lines that
were taken for no walls go from wall to wall, as partitions drawn so do."""

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import (
    PARALLEL_SINE,
    Ends,
    covered_lengths,
    ends_that_meet,
    find_partners,
    groups_within,
    line_strings,
)
from planfit.floorplan.plausible import COMPARE
from planfit.floorplan.vector.double_lines import Thickness
from planfit.floorplan.vector.layer_names import LITTLE
from planfit.floorplan.vector.line_work import Candidates, WallFaces, cut_out, ends_of
from planfit.geometry import segments

FEW_SHARE = 0.25
"""The same of lines longer than a tenth of the drawing, which furniture is not."""
MIN_INSIDE, MIN_ENDING = 0.8, 4
"""An outline is of the building where this share of the faces' length is inside, and so many faces end at it:
both faces of two walls."""
BESIDE, MAIN, SPANNED = 0.35, 0.4, 0.7
"""Of the length of rooms drawn by single lines, those with another line beside them, a bed's or a cupboard's;
of all lines, theirs, and of theirs, that of a block of rooms apart; of the sides of the drawing, that they
span. Of walls drawn as two lines 0.8 have."""
NETWORK, NETWORK_SHARE, NETWORK_SPANS = 0.1, 0.5, 0.5
"""Rooms of single lines beside walls of two: of the drawing's size, the length of a group of lines that
touch; of the faces of their layer, the length of all such; of the sides of the drawing, that they span."""
ROOMS, COMPACT, EXPLAINED = 8, 50.0, 0.8
"""Rooms that single lines close, as lines beside them may be of the next room: so many at least, with this
perimeter squared over area at most (1:5 has 29, a wall 20 times as long as thick 88), of the length."""
BESIDE_REACH = 0.01
"""Of the drawing's size, how near another line is beside one: half a metre of a floor of 50 m."""
MAX_OUTLINE_LINES = 20_000
"""Closing the areas of 10,000 lines takes 0.4 s; a real floor has 1,000 to 3,000 that may be faces."""
LONGEST_PANE = 0.4
"""Of the drawing's size: a line that goes on from a wall for longer is no pane of a window, but its wall. Nor
does one join two plans: axes and section lines run through all that are on a sheet."""
DOUBTFUL_SHARE = 0.15
"""Of the length of faces, long lines that were left out and go from wall to wall: 0.08 at most of 12 plans
that were read right, 0.39 of a house whose partitions were left out."""


def single_line_walls(
    candidates: Candidates, thickness: Thickness, extent: float
) -> Bool[np.ndarray, " n"]:
    """Lines of the largest group that touch one another, where it spans the drawing and few of them have
    another line beside them, or nearly all are edges of rooms that they close: rooms drawn by single lines,
    whatever stands along some of them; and what stands alone without a closed outline, or is a block of rooms
    as long. None otherwise.

    `candidates`: all lines that were looked at; `thickness`: of the walls that are drawn as two lines, if any
    are.
    """
    ends = candidates.ends
    if len(ends) == 0:
        return np.zeros(0, dtype=bool)
    length = segments.lengths(ends)
    group = groups_within(ends, 1e-3 * extent)
    main = int(np.bincount(group, length).argmax())
    found = group == main
    size, whole = (np.ptp(part.reshape(-1, 2), axis=0) for part in (ends[found], ends))
    beside = lengths_beside(ends, thickness.most, thickness.least)
    is_single = beside[found].sum() < BESIDE * length[found].sum()
    is_main = length[found].sum() > MAIN * length.sum()
    spans = bool((size > SPANNED * whole).all())
    if not (is_main and spans and (is_single or _are_edges_of_rooms(ends[found]))):
        return np.zeros(len(ends), dtype=bool)
    # Of the other groups those that enclose nothing: a wall between two doors stands alone.
    for other in np.setdiff1d(group, group[found]):
        own = group == other
        areas = shapely.get_parts(shapely.polygonize([shapely.union_all(line_strings(ends[own]))]))
        is_block = length[own].sum() > MAIN * length[group == main].sum()
        is_block &= beside[own].sum() < BESIDE * length[own].sum()
        found |= own & (len(areas) == 0 or bool(is_block))
    return found


def _are_edges_of_rooms(ends: Ends) -> bool:
    """Whether lines close in rooms on both sides, where two faces of a wall would close in that too."""
    if len(ends) > MAX_OUTLINE_LINES:
        return False
    lines = shapely.union_all(line_strings(ends))
    cells = shapely.get_parts(shapely.polygonize([lines]))
    rooms = cells[shapely.length(cells) ** 2 < COMPACT * shapely.area(cells)]
    explained = shapely.union_all(shapely.boundary(rooms)).length
    return len(rooms) >= ROOMS and explained > EXPLAINED * lines.length


def lengths_beside(ends: Ends, most: float, least: float) -> Float[np.ndarray, " n"]:
    """How much of each line has a parallel one beside it, within `most` and beyond `least`."""
    pairs = find_partners(ends, most, least, 0.0, PARALLEL_SINE)
    return covered_lengths(pairs.line, pairs.low, pairs.high, len(ends))


def single_lines(candidates: Candidates, faces: WallFaces, extent: float) -> WallFaces:
    """Long lines where walls are drawn as such, as faces whose free side is unknown.

    Of layers called wall, those of which little became faces. Of a drawing without such layers all, where
    what became faces is little beside the very long ones, or is little beside the rest and fills little of
    its room: a counter, a staircase. And the outline of a building that walls drawn as two lines end at:
    those that stand, beside those that are to be built.

    `candidates`: all lines that were looked at; `faces`: that were found among them.
    """
    if len(candidates) == 0:
        return WallFaces.of_parts([])
    rest = candidates.cut(*cut_out(candidates.ends, body_of_faces(faces, extent), 0.01 * extent))
    length = segments.lengths(rest.ends)
    is_long = length > 0.02 * extent
    own = np.flatnonzero(is_long & (rest.layer >= 0))
    n_layers = max(int(candidates.layer.max()) + 1, 1)
    left = np.bincount(rest.layer[own], length[own], minlength=n_layers)
    on_line = faces.line >= 0
    of_face = candidates.layer[faces.line[on_line]]
    face_length = segments.lengths(faces.ends[on_line])
    taken = np.zeros(len(left))
    np.add.at(taken, of_face[of_face >= 0], face_length[of_face >= 0])
    if candidates.is_called_wall.any():
        is_single = taken < LITTLE * left
        is_wall = rest.is_called_wall & is_single[rest.layer]
        is_wall |= _are_of_rooms(rest, candidates, taken, extent)
        at = own[is_wall[own]]
    else:
        total = segments.lengths(faces.ends).sum()
        very_long = length[own][length[own] > 0.1 * extent].sum()
        is_corner = _room(faces.ends) < 0.5 * _room(rest.ends[own])
        is_little = is_corner and total < LITTLE * left.sum()
        is_single = total < FEW_SHARE * very_long or is_little
        at = own if is_single or len(faces.ends) == 0 else own[:0]
    others = rest.ends[np.setdiff1d(own, at)]
    around = _around_faces(others, candidates.ends, faces, extent)
    ends = np.concatenate([rest.ends[at], around])
    if len(ends) == 0:
        return WallFaces.of_parts([])
    return WallFaces.without_a_side(ends, nearest_line(candidates.ends, ends))


def _are_of_rooms(
    rest: Candidates, candidates: Candidates, taken: Float[np.ndarray, " l"], extent: float
) -> Bool[np.ndarray, " n"]:
    """Lines of layers that draw rooms by single lines, beside others whose walls have two: groups of lines
    that touch, most without another line beside them, span the drawing and are not little beside the faces
    of the layer. Of layers that are not called wall only where those that are hold little in comparison.

    Args:
        rest: what no face is of.
        candidates: all lines that were looked at.
        taken: length of the faces of each layer.
    """
    found, length = np.zeros(len(rest), dtype=bool), segments.lengths(rest.ends)
    whole = np.ptp(candidates.ends.reshape(-1, 2), axis=0)
    called_length = segments.lengths(candidates.ends[candidates.is_called_wall]).sum()
    for layer in np.unique(rest.layer[rest.layer >= 0]):
        own = np.flatnonzero(rest.layer == layer)
        group = groups_within(rest.ends[own], 1e-3 * extent)
        at = own[np.bincount(group, length[own])[group] > NETWORK * extent]
        if len(at) == 0:
            continue
        ends, total = rest.ends[at], length[at].sum()
        beside = lengths_beside(ends, BESIDE_REACH * extent, 1e-3 * extent).sum()
        spans = (np.ptp(ends.reshape(-1, 2), axis=0) > NETWORK_SPANS * whole).all()
        called = length[at[rest.is_called_wall[at]]].sum()
        is_named = called > 0.5 * total or called_length < LITTLE * total
        is_main = total > NETWORK_SHARE * taken[layer]
        found[own] = is_named and is_main and spans and beside < BESIDE * total
    return found


def _around_faces(
    parts: Float[np.ndarray, "k 2 2"], lines: Ends, faces: WallFaces, extent: float
) -> Float[np.ndarray, "m 2 2"]:
    """What of parts of lines is on a closed outline around faces that end at it: a line may leave it where a
    bay begins. The frame of a sheet and the border of a site stand apart from walls.

    Args:
        parts: of the lines, what no face is of.
        lines: all that were looked at.
        faces: that were found among them.
    """
    if len(parts) == 0 or len(faces.ends) == 0 or len(lines) > MAX_OUTLINE_LINES:
        return parts[:0]
    tolerance = 2e-3 * extent
    rings = shapely.get_parts(shapely.polygonize([shapely.union_all(line_strings(lines))]))
    areas = shapely.get_parts(shapely.union_all(rings))
    if len(areas) == 0:
        return parts[:0]
    # Most faces are in one area, if in any: it is the largest.
    area = areas[np.argmax(shapely.area(areas))]
    outline, face_lines = shapely.get_exterior_ring(area), line_strings(faces.ends)
    grown, face_length = shapely.buffer(area, tolerance), shapely.length(face_lines)
    shapely.prepare(grown)
    inside = face_length[shapely.covers(grown, face_lines)].sum()
    is_around = inside > MIN_INSIDE * face_length.sum()
    tips = shapely.points(faces.ends.reshape(-1, 2))
    touches = (shapely.distance(tips, outline) < tolerance).reshape(-1, 2).any(axis=1)
    # The middle of a face along the outline is on it too: that one is of the outline itself.
    middles = shapely.points(faces.ends.mean(axis=1))
    n_ending = int(np.sum(touches & (shapely.distance(middles, outline) > tolerance)))
    if not is_around or n_ending < MIN_ENDING:
        return parts[:0]
    near, strings = shapely.buffer(outline, tolerance), line_strings(parts)
    shapely.prepare(near)
    is_whole = shapely.covers(near, strings)
    parted = strings[~is_whole & shapely.intersects(near, strings)]
    on = shapely.get_parts(shapely.intersection(parted, near))
    # A line that crosses the outline has a speck within it.
    return np.concatenate([parts[is_whole], ends_of(on[shapely.length(on) > 0.02 * extent])])


def nearest_line(lines: Ends, parts: Float[np.ndarray, "k 2 2"]) -> Int[np.ndarray, " k"]:
    """Index of the line that each part was cut from."""
    middles = shapely.points(parts.mean(axis=1))
    return np.asarray(shapely.STRtree(line_strings(lines)).nearest(middles), dtype=int)


def body_of_faces(faces: WallFaces, extent: float) -> BaseGeometry:
    """Walls behind faces, with the faces themselves."""
    if len(faces.ends) == 0:
        return shapely.Polygon()
    depth = np.where(np.isfinite(faces.thickness), faces.thickness, 0.0)[:, None]
    behind = faces.ends - (depth * faces.normals)[:, None]
    quads = np.concatenate([faces.ends, behind[:, ::-1]], axis=1)
    shapes = [*np.asarray(shapely.polygons(quads)), *line_strings(faces.ends)]
    return shapely.union_all(
        shapely.buffer(np.array(shapes, dtype=object), 1e-3 * extent, join_style="mitre")
    )


def _room(ends: Ends) -> float:
    """Area of the box around segments; 0 of none."""
    if len(ends) == 0:
        return 0.0
    return float(np.prod(np.ptp(ends.reshape(-1, 2), axis=0)))


def left_out_words(candidates: Candidates, faces: WallFaces, extent: float) -> tuple[str, ...]:
    """A doubt where much that may be partitions is no face, whatever layers are called: an outer wall may be
    on layer `base`, and one partition on layer `new wall`.

    `candidates`: all lines that were looked at; `faces`: that were found.
    """
    if len(faces.ends) == 0:
        return ()
    left = float(segments.lengths(_lines_between_walls(candidates.ends, faces, extent)).sum())
    share = left / float(segments.lengths(faces.ends).sum())
    if share < DOUBTFUL_SHARE:
        return ()
    return (
        f"lines from wall to wall, {100 * share:.0f} % of the length of faces, were taken for no walls: if "
        f"they are partitions drawn as single lines, these are missing; {COMPARE}",
    )


def _lines_between_walls(ends: Ends, faces: WallFaces, extent: float) -> Float[np.ndarray, "k 2 2"]:
    """Long lines away from faces whose both ends meet faces, or other such lines."""
    ends = ends[segments.lengths(ends) > NETWORK * extent]
    walls = line_strings(faces.ends)
    # One by one: around thousands of walls that cross, which no drawing has, it takes minutes and gigabytes.
    near = shapely.union_all(shapely.buffer(walls, 0.5 * BESIDE_REACH * extent))
    body = shapely.union(near, body_of_faces(faces, extent))
    left, _ = cut_out(ends, body, NETWORK * extent)
    is_short = segments.lengths(left) < LONGEST_PANE * extent
    left = left[~(is_short & _are_panes(left, faces, BESIDE_REACH * extent))]
    count = -1
    while len(left) not in (0, count):
        count = len(left)
        others = np.concatenate([line_strings(left), walls])
        meets = ends_that_meet(left, np.arange(count), others, BESIDE_REACH * extent)
        left = left[meets.all(axis=1)]
    if len(left) == 0:
        return left
    # What touches no wall by any other line is a frame, or furniture.
    group = groups_within(left, BESIDE_REACH * extent)
    touches = shapely.distance(line_strings(left), shapely.union_all(walls)) < BESIDE_REACH * extent
    return left[(np.bincount(group, touches) > 0)[group]]


def _are_panes(
    ends: Float[np.ndarray, "k 2 2"], faces: WallFaces, reach: float
) -> Bool[np.ndarray, " k"]:
    """Lines in line with a wall that ends at them: panes and sills of a window in its gap."""
    along, normal = segments.directions(ends), segments.left_normals(faces.ends)
    is_parallel = np.abs(along @ normal.T) < PARALLEL_SINE
    usual = faces.usual_thickness or 0.0
    offset = np.einsum("nj,nj->n", normal, faces.ends[:, 0])
    is_in_line = np.abs(ends.mean(axis=1) @ normal.T - offset) < usual + reach
    strings, walls = line_strings(ends), line_strings(faces.ends)
    found = is_parallel & is_in_line
    line, face = np.nonzero(found)
    found[line, face] = shapely.distance(strings[line], walls[face]) < usual + reach
    return found.any(axis=1)
