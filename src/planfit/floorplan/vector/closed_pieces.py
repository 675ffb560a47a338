"""Walls and columns drawn piece by piece as closed outlines, on layers that are called so.

The outer wall of a building may be two closed outlines, one in the other, however thick it is beside the
rest: where the unit is unknown, how thick walls may be comes from the usual distance of neighbouring lines,
which in a furnished room is that of furniture.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.spatial
import shapely
from jaxtyping import Bool, Float, Int, Shaped
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.elements import ELONGATED
from planfit.floorplan.faces import connected_groups, line_strings
from planfit.floorplan.vector.drawing import EDGE, SAME, Fill, Lines
from planfit.floorplan.vector.layer_names import Role
from planfit.floorplan.vector.line_work import ends_of, extremes, path_rings
from planfit.floorplan.vector.regions import without_seams
from planfit.floorplan.vector.single_lines import MIN_ENDING
from planfit.geometry import segments

_COLUMN = 1.5
"""What is no longer than so many times the thickest wall is a column, which may be round."""
_LEAST = 0.24
"""Of the largest column, 0.22 m of 0.93: smaller ones are mullions and posts of railings."""
_FILLED, _ROUND = 0.93, 0.03
"""A column fills its box, up to chamfers, or is a circle up to this share; pans and basins are neither."""
_ALIKE, _MANY = 0.1, 3
"""Elsewhere than among walls, columns are at least so many of one size, up to this share of it."""


@dataclass(frozen=True)
class ClosedPieces:
    """Solid pieces, in the drawing's unit."""

    areas: list[BaseGeometry]
    layer: Int[np.ndarray, " k"]
    """Layers that they are on, ascending."""
    column_size: float
    """What is joined and still no larger stands alone, a column."""


def closed_pieces(lines: Lines, roles: list[Role], most: float) -> ClosedPieces:
    """Closed paths nowhere wider than walls may be, of the layers called wall that hold little else; of the
    others, columns.

    `lines`: of layers that may hold walls, in the order of the file; `most`: how thick walls may be, in the
    unit of the lines.
    """
    found: list[BaseGeometry] = []
    used = []
    length = segments.lengths(lines.ends)
    for layer, role in enumerate(roles):
        at = np.flatnonzero(lines.layer == layer)
        if len(at) == 0 or role not in (Role.WALL, Role.OPENING):
            continue
        if role == Role.OPENING:
            own = find_column_rings(lines.ends[at], _COLUMN * most, is_wall_layer=False)
        else:
            areas = _closed_areas(lines.take(at))
            is_slim = np.array([area.buffer(-most / 2).is_empty for area in areas], dtype=bool)
            own = areas[is_slim]
            # Where walls are not drawn so, a slim closed outline may be a shaft, and the room in it.
            if shapely.length(own).sum() < length[at].sum() / 2:
                own = find_column_rings(lines.ends[at], _COLUMN * most)
        if len(own):
            used.append(layer)
            found += [*own]
    return ClosedPieces(found, np.array(used, dtype=int), _COLUMN * most)


@dataclass(frozen=True)
class OpenedWalls:
    """Solid walls with holes where doors and windows are drawn over them."""

    solids: list[BaseGeometry]
    pieces: ClosedPieces
    area: BaseGeometry
    """Of the openings."""
    openings: Float[np.ndarray, "k 2 2"]
    """Along the faces that they interrupt, two of each opening."""


def open_walls(
    solids: list[BaseGeometry],
    pieces: ClosedPieces,
    lines: Lines,
    fills: tuple[Fill, ...],
    roles: list[Role],
    extent: float,
) -> OpenedWalls:
    """Cut doors and windows out of solid walls where they are closed outlines or areas on layers of their
    own, each from one face of its wall to the other: programs that keep walls as bodies draw openings over
    them.

    Args:
        solids: filled walls.
        pieces: walls drawn as closed outlines.
        lines: of layers that may hold walls, in the order of the file.
    """
    seam = SAME * extent
    is_opening = np.array([role == Role.OPENING for role in roles], dtype=bool)
    areas = [*_closed_areas(lines.take(is_opening[lines.layer]))]
    areas += [fill.polygon for fill in fills if is_opening[fill.layer]]
    closed = OpenedWalls(solids, pieces, shapely.Polygon(), np.zeros((0, 2, 2)))
    if not areas or not (solids or pieces.areas):
        return closed
    body = without_seams([*solids, *pieces.areas], seam)
    shapely.prepare(body)
    grown = shapely.buffer(np.array(areas, dtype=object), seam, join_style="mitre")
    grown = grown[shapely.contains(shapely.buffer(body, 2 * seam, join_style="mitre"), grown)]
    sides = shapely.line_merge(shapely.intersection(shapely.boundary(body), grown))
    kept, ends = [], [np.zeros((0, 2, 2))]
    for area, side in zip(grown, sides, strict=True):
        parts = shapely.get_parts(side)
        parts = parts[shapely.length(parts) > 4 * seam]
        if len(parts) == 2:
            kept.append(area)
            ends.append(ends_of(parts))
    if not kept:
        return closed
    # An outline and its fill are one opening.
    area = shapely.union_all(kept)
    _, once = np.unique(shapely.STRtree(shapely.get_parts(area)).nearest(kept), return_index=True)
    return OpenedWalls(
        [solid.difference(area) for solid in solids],
        replace(pieces, areas=[piece.difference(area) for piece in pieces.areas]),
        area,
        np.concatenate([ends[1 + k] for k in once]),
    )


def _closed_areas(lines: Lines) -> np.ndarray:
    """Areas of paths that end where they begin and do not cross themselves."""
    order = np.argsort(lines.path, kind="stable")
    found = []
    for _, ring, gaps in path_rings(lines.ends[order], lines.path[order]):
        if np.abs(gaps).max() > 1e-3 * float(np.ptp(ring, axis=0).max()):
            continue
        area = shapely.Polygon(ring)
        if area.is_valid and area.area > 0:
            found.append(area)
    return np.array(found, dtype=object)


def find_column_rings(
    ends: Float[np.ndarray, "n 2 2"], most: float, is_wall_layer: bool = True
) -> Shaped[np.ndarray, " k"]:
    """Outlines of columns, as polygons, among the lines of a layer, curves included.

    Columns are compact, rectangles or circles, and nothing of the layer is in them, as in shafts, frames and
    furniture.

    Args:
        most: largest side of a column.
        is_wall_layer: whether the layer is called wall; elsewhere columns are asked to be several alike.
    """
    areas = _rings(ends, _LEAST * most, most)
    if len(areas) == 0:
        return areas
    found = areas[_have_form(areas)]
    if len(found) == 0:
        return found
    strings = line_strings(ends)
    inner = shapely.buffer(found, -0.01 * most)
    column, _ = shapely.STRtree(strings).query(inner, predicate="intersects")
    found = found[~np.isin(np.arange(len(found)), column)]
    if is_wall_layer or len(found) == 0:
        return found
    size = np.sqrt(shapely.area(found))
    alike = np.abs(size[:, None] / size[None] - 1) < _ALIKE
    return found[alike.sum(axis=1) >= _MANY]


def _have_form(areas: Shaped[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
    """Which areas are compact rectangles or circles."""
    boxes = np.array([shapely.oriented_envelope(area) for area in areas], dtype=object)
    corners = np.stack([shapely.get_coordinates(box)[:3] for box in boxes])
    sides = np.sort(np.linalg.norm(np.diff(corners, axis=1), axis=2), axis=1)
    area = shapely.area(areas)
    is_rectangle = area > _FILLED * shapely.area(boxes)
    perimeter = shapely.length(areas)
    is_circle = np.abs(4 * np.pi * area / perimeter**2 - 1) < _ROUND
    return (sides[:, 1] < ELONGATED * sides[:, 0]) & (is_rectangle | is_circle)


def _rings(ends: Float[np.ndarray, "n 2 2"], least: float, most: float) -> Shaped[np.ndarray, " k"]:
    """Areas within segments that close, end to end, and that no other touches; the sides of their boxes from
    `least` to `most`."""
    n = len(ends)
    tips = ends.reshape(-1, 2)
    pairs = scipy.spatial.cKDTree(tips).query_pairs(1e-3 * most, output_type="ndarray")
    corner = connected_groups(pairs[:, 0], pairs[:, 1], 2 * n)
    meeting = np.bincount(corner)
    ring = connected_groups(corner[::2], corner[1::2], len(meeting))[corner[::2]]
    count = int(ring.max()) + 1
    low, high = extremes(tips, np.repeat(ring, 2), count)
    fits = ((high - low).min(axis=1) >= least) & ((high - low).max(axis=1) <= most)
    fits &= np.bincount(np.repeat(ring, 2), meeting[corner] != 2, minlength=count) == 0
    found = []
    for each in np.flatnonzero(fits):
        own = np.flatnonzero(ring == each)
        snapped = tips[np.unique(corner, return_index=True)[1]][corner.reshape(-1, 2)[own]]
        area = shapely.get_parts(shapely.polygonize(line_strings(snapped)))
        found += [*area] if len(area) == 1 else []
    return np.array(found, dtype=object)


def outer_wall(lines: Lines, most: float, extent: float) -> BaseGeometry:
    """The area between the largest closed path and the largest within, where these are the faces of a wall:
    nowhere further apart than walls are thick, with lines that end at the inner one, as what stands along a
    wall does. Empty where there is none. The frame of a sheet keeps away from what it frames.

    `lines`: straight ones that may be faces; `most`: how thick walls may be.
    """
    none = shapely.Polygon()
    rings = sorted(_closed_areas(lines), key=lambda ring: -ring.area)[:2]
    if len(rings) < 2 or not rings[0].contains(rings[1]):
        return none
    outer, inner = rings
    length = segments.lengths(lines.ends)
    is_inside = shapely.covers(shapely.buffer(outer, EDGE * extent), line_strings(lines.ends))
    if length[is_inside].sum() < length.sum() / 2:  # not the outline of the building
        return none
    apart = shapely.distance(shapely.points(shapely.get_coordinates(outer)), inner).max()
    if apart > np.sqrt(2.0) * most or inner.exterior.distance(outer.exterior) < EDGE * extent:
        return none
    at = np.concatenate([lines.ends, lines.ends.mean(axis=1, keepdims=True)], axis=1)
    on_inner = np.asarray(shapely.distance(shapely.points(at), inner.exterior)) < EDGE * extent
    # The middle of a line along the outline is on it too: that one is of the outline itself.
    is_ending = on_inner[:, :2].any(axis=1) & ~on_inner[:, 2]
    return outer.difference(inner) if is_ending.sum() >= MIN_ENDING else none
