"""From a drawing to wall faces: fills, hatches and double lines, each read as what it is."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import shapely
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings
from planfit.floorplan.vector.collinear import merge_collinear
from planfit.floorplan.vector.doors import arcs_of_lines, is_door_leaf
from planfit.floorplan.vector.drawing import Drawing, usual_extent
from planfit.floorplan.vector.fills import hatched_areas, main_rooms, sort_fills
from planfit.floorplan.vector.layer_names import Role
from planfit.floorplan.vector.line_walls import (
    LineFaces,
    Thickness,
    estimate_thickness,
    faces_of_lines,
    rows_of_lines,
    thickness_bounds,
)
from planfit.floorplan.vector.regions import faces_of_regions
from planfit.floorplan.vector.rooms import edges_of_rooms, outside_rooms
from planfit.floorplan.vector.windows import take_out_windows
from planfit.geometry import segments


@dataclass(frozen=True)
class DrawnWalls:
    """Faces in the drawing's own unit and axes."""

    faces: LineFaces
    layers: tuple[str, ...]
    dropped: tuple[str, ...]
    warnings: tuple[str, ...]
    thickness: Thickness | None
    is_left_out: np.ndarray
    """(n,) bool of the drawing's lines: on layers of no walls, or of a form that no wall has."""
    apart: np.ndarray
    """(k, 2, 2) faces left out because they stand apart from the building."""
    openings: np.ndarray
    """(k, 2, 2) windows along the faces they interrupt, as far as they were drawn as such."""


def walls_of_drawing(
    drawing: Drawing, roles: list[Role], metres_per_unit: float | None
) -> DrawnWalls:
    """Find the walls of a cleaned drawing.

    Args:
        drawing: lines, fills; coordinates in its own unit.
        roles: what each layer holds.
        metres_per_unit: where it is known, walls are 0.03 to 0.62 m thick; otherwise the usual
            distance of neighbouring lines tells.
    """
    dropped: list[str] = []
    warnings: list[str] = []
    lines = drawing.lines
    role = np.array(roles, dtype=int)[lines.layer] if len(lines) else np.zeros(0, dtype=int)
    is_no_wall = role == Role.NO_WALL
    extent = _extent(drawing, role)
    if is_no_wall.any():
        names = sorted({drawing.layers[i] for i in np.unique(lines.layer[is_no_wall])})
        dropped.append(f"{is_no_wall.sum()} lines on layers of no walls: {_listed(names)}")
    is_left_out, looked_at = is_no_wall.copy(), np.flatnonzero(~is_no_wall)
    lines, role = lines.take(~is_no_wall), role[~is_no_wall]

    areas = sort_fills(drawing.fills, roles, extent)
    reach = extent / 25 if metres_per_unit is None else 1.0 / metres_per_unit
    is_row = np.zeros(len(lines), dtype=bool)
    straight = np.flatnonzero(~lines.is_curved & (segments.lengths(lines.ends) > 2e-3 * extent))
    is_row[straight] = rows_of_lines(lines.ends[straight], lines.style[straight], reach)
    hatched = hatched_areas(lines.ends, lines.path, is_row, extent)
    wall_areas, rooms = areas.walls, areas.rooms
    if hatched:
        thin = [a for a in hatched if _is_slim(a)]
        wide = [a for a in hatched if not _is_slim(a)]
        if rooms or len(wide) > len(thin):
            rooms = [*rooms, *hatched]
        else:
            wall_areas = [*wall_areas, *thin]
    rooms = main_rooms(rooms, extent)
    if is_row.any():
        dropped.append(f"{is_row.sum()} lines in rows at equal distance (hatches, stairs)")
    if lines.is_curved.any():
        dropped.append(
            f"{lines.is_curved.sum()} pieces of curves (door arcs, symbols, round walls)"
        )
    is_leaf = ~lines.is_curved & is_door_leaf(lines.ends, *arcs_of_lines(lines))
    if is_leaf.any():
        dropped.append(f"{is_leaf.sum()} lines of open doors")
    keep = ~is_row & ~lines.is_curved & ~is_leaf
    is_left_out[looked_at[~keep]] = True
    lines, role = lines.take(keep), role[keep]

    found: list[LineFaces] = []
    ends, group = merge_collinear(lines.ends, 3e-5 * extent)
    is_called_wall = np.zeros(len(ends), dtype=bool)
    is_called_wall[group[role == Role.WALL]] = True
    layer_of = np.zeros(len(ends), dtype=int)
    layer_of[group] = lines.layer
    bounds = thickness_bounds(metres_per_unit, extent)
    windows = take_out_windows(ends, *bounds, 2e-4 * extent)
    ends, is_called_wall = windows.ends, is_called_wall[windows.line]
    layer_of = layer_of[windows.line]
    if len(windows.openings):
        dropped.append(f"panes and sills of {len(windows.openings) // 2} windows in double lines")
    if wall_areas:
        solid = shapely.union_all(wall_areas)
        found.append(_faces_of_solid(solid, extent))
        near = shapely.contains(shapely.buffer(solid, 1e-3 * extent), line_strings(ends))
        ends, is_called_wall, layer_of = ends[~near], is_called_wall[~near], layer_of[~near]
    free_side = np.zeros(len(ends), dtype=int)
    if rooms:
        ends, kept = outside_rooms(ends, rooms, 4e-4 * extent)
        is_called_wall, layer_of = is_called_wall[kept], layer_of[kept]
        edges = edges_of_rooms(rooms, 4e-4 * extent)
        free_side = np.concatenate([np.zeros(len(ends), dtype=int), np.ones(len(edges), dtype=int)])
        ends = np.concatenate([ends, edges])
        is_called_wall = np.concatenate([is_called_wall, np.ones(len(edges), dtype=bool)])
        layer_of = np.concatenate([layer_of, np.full(len(edges), -1)])
        dropped.append(f"line work inside {len(rooms)} filled or hatched rooms")
    thickness = None if len(ends) == 0 else estimate_thickness(ends, metres_per_unit, extent)
    used = np.zeros(0, dtype=int)
    # Beside solid walls, line work is furniture and windows, unless a layer calls it wall.
    if thickness is not None and not (wall_areas and not is_called_wall.any()):
        by_lines, _ = faces_of_lines(ends, thickness, is_called_wall, free_side)
        found.append(by_lines)
        used = np.unique(layer_of[by_lines.line])
    if rooms:
        found.append(_bare_edges(ends, free_side, found[-1] if thickness is not None else None))
    n_faces = sum(len(f.ends) for f in found)
    if n_faces == 0 and len(ends):
        found.append(_single_lines(ends, is_called_wall, extent))
        if len(found[-1].ends):
            used = np.unique(layer_of[found[-1].line])
            warnings.append(
                "walls are drawn as single lines: which side of them is free is unknown"
            )
    faces, apart = _main_part(_together(found), extent)
    if len(apart):
        dropped.append(f"{len(apart)} faces apart from the building (legend, title block, details)")
    names = [drawing.layers[i] for i in used if i >= 0]
    names += sorted({drawing.layers[f.layer] for f in drawing.fills} if wall_areas or rooms else [])
    return DrawnWalls(
        faces,
        tuple(dict.fromkeys(names)),
        tuple(dropped),
        tuple(warnings),
        thickness,
        is_left_out,
        apart,
        windows.openings,
    )


def _extent(drawing: Drawing, role: np.ndarray) -> float:
    """Larger side of the box around the line work and fills."""
    points = [drawing.lines.ends[role != Role.NO_WALL].reshape(-1, 2)]
    points += [np.array(f.polygon.bounds).reshape(2, 2) for f in drawing.fills]
    return usual_extent(np.concatenate(points))


def _is_slim(area: BaseGeometry) -> bool:
    return bool(shapely.length(area) ** 2 / (16 * area.area) > 2.5)


def _faces_of_solid(solid: BaseGeometry, extent: float) -> LineFaces:
    faces = faces_of_regions(solid, 1e-4 * extent, 3e-3 * extent)
    n = len(faces.ends)
    return LineFaces(
        faces.ends, faces.normals, np.ones(n, dtype=bool), faces.thickness, np.full(n, -1)
    )


def _bare_edges(ends: np.ndarray, free_side: np.ndarray, paired: LineFaces | None) -> LineFaces:
    """Edges of rooms with nothing beside them: the outside of a building drawn without thickness."""
    is_edge = free_side != 0
    if paired is not None:
        is_edge[paired.line] = False
    at = np.flatnonzero(is_edge)
    normals = segments.left_normals(ends[at]) * free_side[at, None]
    n = len(at)
    return LineFaces(ends[at], normals, np.ones(n, dtype=bool), np.full(n, np.nan), at)


def _single_lines(ends: np.ndarray, is_called_wall: np.ndarray, extent: float) -> LineFaces:
    long = segments.lengths(ends) > 0.02 * extent
    at = np.flatnonzero(long & is_called_wall if is_called_wall.any() else long)
    n = len(at)
    return LineFaces(
        ends[at], segments.left_normals(ends[at]), np.zeros(n, dtype=bool), np.full(n, np.nan), at
    )


def _together(parts: list[LineFaces]) -> LineFaces:
    return LineFaces(
        np.concatenate([p.ends for p in parts] or [np.zeros((0, 2, 2))]),
        np.concatenate([p.normals for p in parts] or [np.zeros((0, 2))]),
        np.concatenate([p.is_oriented for p in parts] or [np.zeros(0, dtype=bool)]),
        np.concatenate([p.thickness for p in parts] or [np.zeros(0)]),
        np.concatenate([p.line for p in parts] or [np.zeros(0, dtype=int)]),
    )


def _main_part(faces: LineFaces, extent: float) -> tuple[LineFaces, np.ndarray]:
    """Faces without groups that stand apart by a twentieth of the drawing and hold less than a
    twentieth of the largest group's length; and the ends of those."""
    if len(faces.ends) == 0:
        return faces, faces.ends
    lines = line_strings(faces.ends)
    a, b = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=0.05 * extent)
    n = len(lines)
    graph = scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n))
    count, group = scipy.sparse.csgraph.connected_components(graph, directed=False)
    total = np.bincount(group, segments.lengths(faces.ends), minlength=count)
    keep = (total > 0.05 * total.max())[group]
    kept = LineFaces(
        faces.ends[keep], faces.normals[keep], faces.is_oriented[keep], faces.thickness[keep],
        faces.line[keep],
    )  # fmt: skip
    return kept, faces.ends[~keep]


def _listed(names: list[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
