"""Faces of walls by the ways they are drawn: solid, as two lines, by the edges of rooms, as single lines."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings
from planfit.floorplan.vector.areas import outside_rooms
from planfit.floorplan.vector.closed_pieces import ClosedPieces
from planfit.floorplan.vector.double_lines import estimate_thickness, faces_of_lines
from planfit.floorplan.vector.furniture import are_furniture
from planfit.floorplan.vector.line_work import Candidates, WallFaces, cut_out, outlines
from planfit.floorplan.vector.regions import faces_of_regions, without_seams
from planfit.floorplan.vector.room_edges import (
    TOUCHING_WORDS,
    WALLED_SHARE,
    around_rooms,
    bare_edges,
    edges_run_in,
    walls_between_rooms,
)
from planfit.floorplan.vector.single_lines import (
    MAX_OUTLINE_LINES,
    nearest_line,
    single_line_walls,
    single_lines,
)
from planfit.geometry import segments

MAIN_SHARE = 0.35
"""Solid walls with this share of the length of double lines beside them are the walls of the drawing."""
MIN_SHARE = 0.8
"""An area is the body of a wall where faces with the wall behind them, in the area, are this share of its
outline. A room has none: its faces look into it."""
_MIN_LENGTH = 1.5
"""Of what is added, in usual thicknesses: the closed end of a wall is as long as the wall is thick."""


@dataclass(frozen=True)
class FoundFaces:
    """Faces by the way they are drawn, and the lines that were looked at."""

    parts: list[WallFaces]
    candidates: Candidates
    warnings: tuple[str, ...]
    shared_edges: float
    """See `DrawnWalls`."""
    are_rooms_touching: bool = False
    """Likewise."""

    def with_single_lines(self, walls: WallFaces) -> "FoundFaces":
        """The same with walls between two rooms, which were taken for open there."""
        if len(walls.ends) == 0:
            return self
        length = float(segments.lengths(walls.ends).sum())
        warning = _single_warning(self.parts, length)
        left = self.shared_edges - length
        return replace(
            self,
            parts=[*self.parts, walls],
            warnings=(*self.warnings, warning),
            shared_edges=left if left > 0.01 * length else 0.0,  # else what rounding leaves
        )


def faces_of_all(
    solids: list[BaseGeometry],
    pieces: ClosedPieces,
    rooms: list[BaseGeometry],
    candidates: Candidates,
    metres_per_unit: float | None,
    extent: float,
) -> FoundFaces:
    """Faces of solid walls and columns, of double lines, of the edges of rooms, and of single lines where
    walls are drawn so."""
    parts: list[WallFaces] = []
    around: BaseGeometry = shapely.Polygon()
    if solids or pieces.areas:
        solid = shapely.union_all(solids)
        if pieces.areas:
            solid = without_seams([*solids, *pieces.areas], 2e-4 * extent)
        if rooms and edges_run_in(rooms, shapely.buffer(solid, -1e-3 * extent), WALLED_SHARE):
            candidates = candidates.cut(*outside_rooms(candidates.ends, rooms, 4e-4 * extent))
            rooms = []
        if pieces.areas:
            alone = np.array(shapely.get_parts(solid), dtype=object)
            size = np.ptp(shapely.bounds(alone).reshape(-1, 2, 2), axis=1).max(axis=1)
            is_column = size <= pieces.column_size
            parts += [_faces_of_column(column) for column in alone[is_column]]
            solid = shapely.union_all(alone[~is_column])
        parts.append(faces_of_solid(solid, extent))
        around = shapely.buffer(shapely.union_all([*solids, *pieces.areas]), 1e-3 * extent)
        candidates = candidates.take(~shapely.contains(around, line_strings(candidates.ends)))
    solid_length = sum(float(segments.lengths(part.ends).sum()) for part in parts)
    shared_edges = 0.0
    if rooms:
        candidates, shared_edges = around_rooms(candidates, rooms, around, extent)
    thickness = None
    if len(candidates):
        thickness = estimate_thickness(candidates.ends, metres_per_unit, extent)
    paired = WallFaces.of_parts([])
    if thickness is not None:
        may_be = ~candidates.is_called_wall & (candidates.layer >= 0) & (candidates.free_side == 0)
        is_furniture = may_be & are_furniture(candidates.ends, thickness, extent)
        candidates = candidates.take(~is_furniture)
        paired = faces_of_lines(
            candidates.ends, thickness, candidates.is_called_wall, candidates.free_side
        )
        # Beside solid walls, line work is furniture and windows, unless a layer calls it wall, or the solid
        # ones are few: columns, the walls of a shaft.
        is_clutter = solid_length > MAIN_SHARE * segments.lengths(paired.ends).sum()
        if is_clutter and not candidates.is_called_wall.any():
            paired = WallFaces.of_parts([])
        parts += [paired, _rest_of_bodies(candidates, paired, extent)]
    if rooms:
        gap = 0.0 if thickness is None else 2 * thickness.usual
        parts.append(bare_edges(candidates, paired, gap))
    is_taken = WallFaces.of_parts(parts)
    between = walls_between_rooms(candidates, rooms, shared_edges, extent)
    if len(between.ends):
        parts = [*parts, between]
        return FoundFaces(parts, candidates, (TOUCHING_WORDS,), 0.0, are_rooms_touching=True)
    has_others = bool(solids or pieces.areas or rooms) or candidates.is_called_wall.any()
    if thickness is not None and not has_others:
        is_wall = single_line_walls(candidates, thickness, extent)
        if is_wall.any():
            parts, is_taken = [], WallFaces.of_parts([])
            candidates = candidates.take(is_wall)
    single = single_lines(candidates, is_taken, extent)
    if len(single.ends) == 0:
        return FoundFaces(parts, candidates, (), shared_edges)
    warning = _single_warning([is_taken], float(segments.lengths(single.ends).sum()))
    return FoundFaces([*parts, single], candidates, (warning,), shared_edges)


def _single_warning(others: list[WallFaces], length: float) -> str:
    whole = length + sum(float(segments.lengths(part.ends).sum()) for part in others)
    share = f"{length / whole:.0%}"
    few = "" if share == "100%" else f" ({share} of the length of faces)"
    return f"walls are drawn as single lines{few}: which side of them is free is unknown"


def faces_of_solid(solid: BaseGeometry, extent: float) -> WallFaces:
    """Faces around solid walls, in a drawing of that size."""
    return faces_of_regions(solid, 1e-4 * extent, 3e-3 * extent)


def _faces_of_column(column: BaseGeometry) -> WallFaces:
    """Round ones have nine faces or so, off by a thirtieth of their diameter."""
    size = float(np.ptp(np.array(column.bounds).reshape(2, 2), axis=0).max())
    return faces_of_regions(column, 0.03 * size, 0.1 * size)


def _rest_of_bodies(candidates: Candidates, faces: WallFaces, extent: float) -> WallFaces:
    """Faces where lines close the body of a wall that is thicker there than a wall may be.

    None of drawings of more than `MAX_OUTLINE_LINES` lines, whose areas take too long to close.

    `candidates`: all lines that were looked at; `faces`: found among them as two faces of one wall.
    """
    none = WallFaces.of_parts([])
    paired = faces.take(np.isfinite(faces.thickness) & faces.is_oriented & (faces.line >= 0))
    if len(paired.ends) == 0 or len(candidates) > MAX_OUTLINE_LINES:
        return none
    usual = paired.usual_thickness
    assert usual is not None
    tolerance = 1e-4 * extent
    # Corners of a drawing are as good as its last digit.
    lines = shapely.union_all(line_strings(candidates.ends), grid_size=0.1 * tolerance)
    areas = shapely.get_parts(shapely.polygonize([lines]))
    if len(areas) == 0:
        return none
    points, of = segments.sample(np.ascontiguousarray(paired.ends), 0.5 * usual)
    behind = points - 0.25 * paired.thickness[of, None] * paired.normals[of]
    point, area = shapely.STRtree(areas).query(shapely.points(behind), predicate="within")
    count = np.bincount(of, minlength=len(paired.ends))
    each = (segments.lengths(paired.ends) / np.maximum(count, 1))[of[point]]
    length = np.bincount(area, each, minlength=len(areas))
    on_faces = shapely.buffer(line_strings(faces.ends), tolerance, cap_style="flat")
    tree = shapely.STRtree(on_faces)
    ends, normals = [np.zeros((0, 2, 2))], [np.zeros((0, 2))]
    for body in areas[length > MIN_SHARE * shapely.length(areas)]:
        taken = shapely.union_all(on_faces[tree.query(body, "intersects")])
        rest, _ = cut_out(outlines([body]), taken, _MIN_LENGTH * usual)
        rest = rest[segments.lengths(rest) > _MIN_LENGTH * usual]
        ends.append(rest)
        normals.append(_out_of(body, rest, tolerance))
    found = np.concatenate(ends)
    if len(found) == 0:
        return none
    line = nearest_line(candidates.ends, found)
    return WallFaces.oriented(found, np.concatenate(normals), line=line)


def _out_of(body: BaseGeometry, ends: np.ndarray, step: float) -> np.ndarray:
    """Normals (n, 2) of parts of an outline, out of its area."""
    left = segments.left_normals(ends)
    is_inside = shapely.contains(body, shapely.points(ends.mean(axis=1) + step * left))
    return np.where(is_inside[:, None], -left, left)
