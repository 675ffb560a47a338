"""Rooms of a plan as built against as planned: their areas, and their clear widths between opposite walls."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float, Int
from shapely.geometry.polygon import orient

from planfit.as_built.openings import MOST_SHARE
from planfit.as_built.types import AsBuilt, AsBuiltWall
from planfit.floorplan import Floorplan
from planfit.floorplan.faces import line_strings
from planfit.floorplan.gaps import PARALLEL, SAME_CORNER_M, find_gaps
from planfit.geometry import segments
from planfit.priors import ROOM_SIDE_M

ACROSS = 0.1
"""Least cosine between the normals of walls that are not across one another: within 6 degrees of square."""


@dataclass(frozen=True)
class ClearWidth:
    """Between two walls that face each other, m."""

    planned_m: float
    built_m: float
    """NaN where one of the two was not seen."""
    sigma_m: float
    """One standard deviation of the latter."""


@dataclass(frozen=True)
class RoomAsBuilt:
    """One room, which faces and openings of the plan enclose."""

    middle_xy: tuple[float, float]
    """Plan frame, m."""
    area_m2: float
    """As planned."""
    built_area_m2: float
    """With each wall that was seen where it stands, and the others where they are drawn."""
    area_sigma_m2: float
    """Standard deviation of what was seen of it."""
    seen_share: float
    """Of the length of its walls, of those that were seen."""
    widths: tuple[ClearWidth, ...]
    """Along its longest wall's normal, and across."""


def rooms_as_built(floorplan: Floorplan, as_built: AsBuilt) -> tuple[RoomAsBuilt, ...]:
    """Rooms of a plan of one storey whose faces know their free sides, in the order of their areas, largest
    first; none of other plans.
    """
    if floorplan.storeys is not None or len(floorplan) == 0:
        return ()
    gaps = find_gaps(floorplan, as_built.options.opening_widths_m)
    sides = [gap.ends + k * gap.thickness_m / 2 * gap.normal for gap in gaps for k in (-1, 1)]
    lines = [*line_strings(floorplan.ends), *map(shapely.LineString, sides)]
    noded = shapely.node(shapely.set_precision(shapely.MultiLineString(lines), SAME_CORNER_M))
    standing = {wall.face_idx: wall for wall in as_built.walls if wall.is_standing}
    rooms = [
        room
        for polygon in shapely.polygonize([noded]).geoms
        if isinstance(polygon, shapely.Polygon)
        and polygon.area > ROOM_SIDE_M.low**2
        and (room := _room(orient(polygon), floorplan, standing)) is not None
    ]
    return tuple(sorted(rooms, key=lambda room: -room.area_m2))


def _room(
    polygon: shapely.Polygon, floorplan: Floorplan, standing: dict[int, AsBuiltWall]
) -> RoomAsBuilt | None:
    """A closed piece of the plan as a room; None where faces do not look into it."""
    corners = np.array(polygon.exterior.coords)
    edges = np.stack([corners[:-1], corners[1:]], axis=1)
    faces, lengths = _faces_of(edges, floorplan), segments.lengths(edges)
    if lengths[faces >= 0].sum() < MOST_SHARE * lengths.sum():
        return None
    of_face = {
        int(face): float(lengths[faces == face].sum()) for face in np.unique(faces) if face >= 0
    }
    seen = {face: length for face, length in of_face.items() if face in standing}
    moved_m2 = [standing[face].offset_m * length for face, length in seen.items()]
    sigmas_m2 = [standing[face].sigma_m * length for face, length in seen.items()]
    x, y = polygon.representative_point().coords[0]
    return RoomAsBuilt(
        (float(x), float(y)),
        float(polygon.area),
        float(polygon.area - sum(moved_m2)),
        float(np.linalg.norm(sigmas_m2)) if sigmas_m2 else np.nan,
        sum(seen.values()) / sum(of_face.values()),
        tuple(_widths(of_face, floorplan, standing)),
    )


def _faces_of(edges: Float[np.ndarray, "e 2 2"], floorplan: Floorplan) -> Int[np.ndarray, " e"]:
    """The face that each edge of a piece is of, free side inside; -1 across openings, and of the backs of
    faces. Inside is on the left of edges."""
    faces = np.full(len(edges), -1)
    tree = shapely.STRtree(line_strings(floorplan.ends))
    of_edge, near = tree.query(
        shapely.points(edges.mean(axis=1)), predicate="dwithin", distance=2 * SAME_CORNER_M
    )
    inwards = np.einsum("pi,pi->p", segments.left_normals(edges)[of_edge], floorplan.normals[near])
    is_own = (inwards > PARALLEL) & floorplan.is_oriented[near]
    faces[of_edge[is_own]] = near[is_own]
    return faces


def _widths(
    of_face: dict[int, float], floorplan: Floorplan, standing: dict[int, AsBuiltWall]
) -> list[ClearWidth]:
    """Between the longest wall of a room and the longest that faces it, and the same across."""
    ends, normals = floorplan.ends, floorplan.normals
    by_length, found = sorted(of_face, key=lambda face: -of_face[face]), []
    for is_across in (False, True):
        cosines = np.abs(normals[by_length] @ normals[by_length[0]])
        own = np.array(by_length)[(cosines < ACROSS) if is_across else (cosines > PARALLEL)]
        facing = own[normals[own] @ normals[own[0]] < -PARALLEL] if len(own) else own
        if len(facing) == 0:
            continue
        a, b = int(own[0]), int(facing[0])
        planned_m = float(abs((ends[b].mean(axis=0) - ends[a, 0]) @ normals[a]))
        walls = [standing[face] for face in (a, b) if face in standing]
        built_m = sigma_m = np.nan
        if len(walls) == 2:
            built_m = planned_m - sum(wall.offset_m for wall in walls)
            sigma_m = float(np.linalg.norm([wall.sigma_m for wall in walls]))
        found.append(ClearWidth(planned_m, built_m, sigma_m))
    return found
