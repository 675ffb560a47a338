"""Where a drawing fills or hatches the floors of rooms, the walls are what it leaves out."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from planfit.floorplan.faces import line_strings


def edges_of_rooms(rooms: list[BaseGeometry], tolerance: float) -> np.ndarray:
    """Edges (n, 2, 2) of rooms with the room on the left; where two rooms meet without a wall
    between them, within `tolerance`, there is none."""
    parts = [p for p in shapely.get_parts(shapely.simplify(rooms, 0.5 * tolerance))
             if p.geom_type == "Polygon" and not p.is_empty]  # fmt: skip
    tree = shapely.STRtree(parts)
    edges = []
    for i, part in enumerate(parts):
        polygon = orient(part)
        others = [parts[j] for j in tree.query(part, "dwithin", tolerance) if j != i]
        near = shapely.buffer(shapely.union_all(others), 1.5 * tolerance)
        for ring in (polygon.exterior, *polygon.interiors):
            corners = np.asarray(ring.coords)[:, :2]
            ends = np.stack([corners[:-1], corners[1:]], axis=1)
            edges.append(cut_out(ends, near, 3 * tolerance)[0])
    return np.concatenate([*edges, np.zeros((0, 2, 2))])


def outside_rooms(
    ends: np.ndarray, rooms: list[BaseGeometry], tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """The pieces (m, 2, 2) of lines that lie in no room nor along its edge, and the line (m,) each
    is of: what is drawn inside a room is furniture, stairs and text."""
    area = shapely.buffer(shapely.union_all(rooms), tolerance)
    return cut_out(ends, area, 3 * tolerance)


def ends_of(lines: np.ndarray) -> np.ndarray:
    """First and last point (n, 2, 2) of line strings, which overlays may give points in between."""
    first, last = shapely.get_point(lines, 0), shapely.get_point(lines, -1)
    both = np.stack([shapely.get_coordinates(first), shapely.get_coordinates(last)], axis=1)
    return both.reshape(-1, 2, 2)


def cut_out(
    ends: np.ndarray, area: BaseGeometry, min_length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pieces of segments outside `area`, kept as they are where they do not meet it."""
    if area.is_empty or len(ends) == 0:
        return ends, np.arange(len(ends))
    shapely.prepare(area)
    lines = line_strings(ends)
    meets = shapely.intersects(area, lines)
    rest = np.flatnonzero(meets & ~shapely.contains(area, lines))
    pieces, of = shapely.get_parts(shapely.difference(lines[rest], area), return_index=True)
    long = shapely.length(pieces) > min_length
    cut, of = ends_of(pieces[long]), of[long]
    apart = np.flatnonzero(~meets)
    return np.concatenate([ends[apart], cut]), np.concatenate([apart, rest[of]])
