"""The edges of filled rooms as faces of the walls between them."""

import numpy as np
import shapely
from jaxtyping import Bool, Float, Shaped
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings
from planfit.floorplan.vector.areas import (
    MUCH_LEFT_OUT,
    ROOMS_COVER,
    drawn_shares,
    outside_rooms,
)
from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.line_work import Candidates, WallFaces, cut_out, outlines, path_rings
from planfit.floorplan.vector.regions import SelfCrossings
from planfit.geometry import segments

TOUCHING_SHARE = 0.3
"""Where rooms meet without a wall along more of their outline, walls are drawn so: 0.47 and more of two plans
of web pages, 0.04 of a university's floors, where a corridor goes on into a hall."""
TOUCHING_WORDS = (
    "rooms touch: where two of them meet is taken for a wall without thickness, closed but for doors that "
    "are drawn as swings or gaps"
)
LEAST_BETWEEN, DRAWN_SHARE = 0.02, 0.6
"""Of the drawing's size, edges between rooms that are looked at; of a wall, what of the edge is drawn."""
WALLED_SHARE = 0.4
"""Of the outlines of rooms, what runs inside solid walls where walls are drawn over tints of the rooms: the
middles of walls and, elsewhere, doors and windows. Rooms that end at the faces of walls have next to none."""
WALLED_ALL_ROUND = 0.75
"""Of the outlines of rooms, what runs along the faces of solid walls where the rest is doors and windows."""


def boxed_rooms(lines: Lines, most: float, extent: float) -> list[BaseGeometry]:
    """Rooms drawn as outlines that stand apart, so that walls are what is between them; none where they
    touch, cover little of the ground, where one is most of it, or where much else is drawn around them.

    `lines`: that may be walls, curved ones too, in the order of the file; `most`: how thick walls may be.
    """
    valid, drawn = SelfCrossings().valid, segments.lengths(lines.ends)
    areas = np.array([
        valid(shapely.Polygon(ring)) for at, ring, gaps in path_rings(lines.ends, lines.path)
        if np.linalg.norm(gaps, axis=1).sum() < MUCH_LEFT_OUT * drawn[at].sum()
    ], dtype=object)  # fmt: skip
    inner, _ = shapely.STRtree(areas).query(areas, predicate="covered_by")
    is_outer = np.bincount(inner, minlength=len(areas)) == 1
    rooms = areas[is_outer & ~shapely.is_empty(shapely.buffer(areas, -most / 2))]
    if len(rooms) < 3:
        return []
    a, b = shapely.STRtree(rooms).query(rooms, predicate="dwithin", distance=4e-4 * extent)
    ground = shapely.convex_hull(shapely.GeometryCollection(list(rooms)))
    size = shapely.area(rooms)
    floors = shapely.buffer(shapely.union_all(rooms), 4e-4 * extent)
    shapely.prepare(floors)
    others = drawn[~shapely.covers(floors, line_strings(lines.ends))].sum()
    is_plan = size.sum() > ROOMS_COVER * ground.area and size.max() < size.sum() / 2
    is_plan &= others < MUCH_LEFT_OUT * shapely.length(rooms).sum()
    return list(rooms) if is_plan and (a == b).all() else []


def edges_run_in(rooms: list[BaseGeometry], area: BaseGeometry, least_share: float) -> bool:
    """Whether more than a share of the edges of rooms, by their length, runs in an area."""
    edges = shapely.boundary(np.array(rooms, dtype=object))
    inside = shapely.length(shapely.intersection(edges, area)).sum()
    return bool(inside > least_share * shapely.length(edges).sum())


def edges_of_rooms(
    rooms: list[BaseGeometry], tolerance: float
) -> tuple[Float[np.ndarray, "n 2 2"], float]:
    """Edges of rooms with the room on the left; where two rooms meet without a wall between them, within
    `tolerance`, there is none. And the length of those where there is none, each counted once."""
    parts = _simple_parts(rooms, tolerance)
    tree = shapely.STRtree(parts)
    edges, outline = [], 0.0
    for i, part in enumerate(parts):
        others = [parts[j] for j in tree.query(part, "dwithin", tolerance) if j != i]
        near = shapely.buffer(shapely.union_all(others), 1.5 * tolerance)
        for ring in shapely.get_rings(shapely.orient_polygons(part)):
            ends = outlines([ring])
            edges.append(cut_out(ends, near, 3 * tolerance)[0])
            outline += float(segments.lengths(ends).sum())
    bounding = np.concatenate([*edges, np.zeros((0, 2, 2))])
    return bounding, (outline - float(segments.lengths(bounding).sum())) / 2


def _simple_parts(rooms: list[BaseGeometry], tolerance: float) -> Shaped[np.ndarray, " p"]:
    """Polygons of rooms, with no more corners than their form has within half of the tolerance."""
    parts = shapely.get_parts(shapely.simplify(rooms, 0.5 * tolerance))
    is_area = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    return parts[is_area & ~shapely.is_empty(parts)]


def edges_between_rooms(rooms: list[BaseGeometry], tolerance: float) -> Float[np.ndarray, "n 2 2"]:
    """Edges where two rooms meet without a wall between them, within `tolerance`, each once; not those of
    what lies in a room."""
    parts = _simple_parts(rooms, tolerance)
    inner, outer = shapely.STRtree(shapely.buffer(parts, tolerance)).query(parts, "within")
    area = shapely.area(parts)
    parts = np.delete(parts, inner[area[inner] < area[outer]])
    one, other = shapely.STRtree(parts).query(parts, "dwithin", tolerance)
    one, other = one[one < other], other[one < other]
    rings = shapely.boundary(parts)
    near = shapely.buffer(rings[other], tolerance)
    found = list(shapely.intersection(rings[one], near))
    ends = outlines(found)
    return ends[segments.lengths(ends) > 3 * tolerance]


def around_rooms(
    candidates: Candidates, rooms: list[BaseGeometry], walls: BaseGeometry, extent: float
) -> tuple[Candidates, float]:
    """Lines outside rooms, and the edges of these, which look into their room on the left; and the length of
    the edges that two rooms share.

    `candidates`: lines; `walls`: all solid walls, grown a little.
    """
    outside = candidates.cut(*outside_rooms(candidates.ends, rooms, 4e-4 * extent))
    edges, shared_edges = edges_of_rooms(rooms, 4e-4 * extent)
    if edges_run_in(rooms, walls, WALLED_ALL_ROUND):
        edges = outlines(list(shapely.intersection(line_strings(edges), walls)))
        edges = edges[segments.lengths(edges) > 3e-3 * extent]
    n = len(edges)
    of_rooms = Candidates(edges, np.ones(n, dtype=bool), np.full(n, -1), np.ones(n, dtype=int))
    return Candidates.together([outside, of_rooms]), shared_edges


def walls_between_rooms(
    candidates: Candidates, rooms: list[BaseGeometry], shared_edges: float, extent: float
) -> WallFaces:
    """Where two rooms meet, in a drawing whose walls have no thickness; in others a room goes on there."""
    own = segments.lengths(candidates.ends)[candidates.free_side != 0].sum()
    if 2 * shared_edges <= TOUCHING_SHARE * (own + 2 * shared_edges):
        return WallFaces.of_parts([])
    return WallFaces.without_a_side(edges_between_rooms(rooms, 4e-4 * extent))


def drawn_between_rooms(lines: Lines, rooms: list[BaseGeometry], extent: float) -> WallFaces:
    """Edges that two rooms share where a straight line is drawn on them beside the outlines of the two, as
    faces whose free side is unknown: a glazed front, a wall drawn as one line. Where nothing is drawn, as
    between a corridor and a hall, a room goes on.

    `lines`: straight ones, that may be faces.
    """
    tolerance = 4e-4 * extent
    edges = edges_between_rooms(rooms, tolerance)
    edges = edges[segments.lengths(edges) > LEAST_BETWEEN * extent]
    if len(edges) == 0 or len(lines) == 0:
        return WallFaces.of_parts([])
    drawn = lines.ends[~_are_closed(lines, tolerance)]
    is_drawn = drawn_shares(line_strings(edges), drawn, extent) > DRAWN_SHARE
    return WallFaces.without_a_side(edges[is_drawn])


def _are_closed(lines: Lines, tolerance: float) -> Bool[np.ndarray, " n"]:
    """Segments of paths that end where they began."""
    is_closed = np.zeros(len(lines), dtype=bool)
    for own, _, gaps in path_rings(lines.ends, lines.path):
        is_closed[own] = np.hypot(*gaps[0]) < tolerance
    return is_closed


def bare_edges(candidates: Candidates, paired: WallFaces, least: float) -> WallFaces:
    """Edges of rooms, or parts of them longer than `least`, with nothing beside them: glazed fronts, the
    outside of a building drawn without thickness. A room ends there, whatever the wall is drawn like."""
    along, length = segments.directions(candidates.ends), segments.lengths(candidates.ends)
    ends, at = [], []
    for i in np.flatnonzero(candidates.free_side != 0):
        taken = np.sort((paired.ends[paired.line == i] - candidates.ends[i, 0]) @ along[i], axis=1)
        taken = taken[np.argsort(taken[:, 0])]
        # From the end of each face, and of all before it, to the begin of the next.
        low = np.maximum.accumulate(np.concatenate([[0.0], taken[:, 1]]))
        high = np.concatenate([taken[:, 0], length[i : i + 1]])
        bare = high - low > (least if len(taken) else 0.0)
        ends.append(candidates.ends[i, 0] + np.stack([low, high], axis=1)[bare, :, None] * along[i])
        at.append(np.full(bare.sum(), i))
    line = np.concatenate([*at, np.zeros(0, dtype=int)])
    parts = np.concatenate([*ends, np.zeros((0, 2, 2))])
    normals = segments.left_normals(parts) * candidates.free_side[line, None]
    return WallFaces.oriented(parts, normals, line=line)
