"""From a drawing to wall faces: fills, hatches and double lines, each read as what it is."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
import shapely
from jaxtyping import Bool, Float, Int, Shaped
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings
from planfit.floorplan.vector.areas import (
    edges_of_rooms,
    hatched_areas,
    main_rooms,
    outside_rooms,
    sort_fills,
)
from planfit.floorplan.vector.double_lines import (
    LineFaces,
    estimate_thickness,
    faces_of_lines,
    rows_of_lines,
    thickness_bounds,
)
from planfit.floorplan.vector.drawing import Lines, VectorDrawing
from planfit.floorplan.vector.layer_names import Role
from planfit.floorplan.vector.line_work import merge_collinear, usual_extent
from planfit.floorplan.vector.openings import arcs_of_lines, is_door_leaf, take_out_windows
from planfit.floorplan.vector.regions import faces_of_regions
from planfit.geometry import segments


@dataclass(frozen=True)
class DrawnWalls:
    """Faces in the drawing's own unit and axes."""

    faces: LineFaces
    layers: tuple[str, ...]
    dropped: tuple[str, ...]
    warnings: tuple[str, ...]
    is_left_out: Bool[np.ndarray, " n"]
    """Of the drawing's lines: on layers of no walls, or of a form that no wall has."""
    apart: Float[np.ndarray, "a 2 2"]
    """Faces left out because they stand apart from the building."""
    openings: Float[np.ndarray, "k 2 2"]
    """Windows along the faces they interrupt, as far as they were drawn as such."""


@dataclass(frozen=True)
class _Candidates:
    """Lines that may be faces of walls, merged: no two lie on one another."""

    ends: Float[np.ndarray, "n 2 2"]
    is_called_wall: Bool[np.ndarray, " n"]
    """Whether the name of the layer, or a room that begins there, makes the line a wall."""
    layer: Int[np.ndarray, " n"]
    """Index of the layer, -1 for edges of rooms."""
    free_side: Int[np.ndarray, " n"]
    """1 where the left side is known to be free, 0 where nothing is."""

    def __len__(self) -> int:
        return len(self.ends)

    def take(self, keep: Shaped[np.ndarray, " k"]) -> "_Candidates":
        """Those of a mask or an index."""
        return _Candidates(
            self.ends[keep], self.is_called_wall[keep], self.layer[keep], self.free_side[keep]
        )

    def cut(self, ends: Float[np.ndarray, "m 2 2"], line: Int[np.ndarray, " m"]) -> "_Candidates":
        """Parts of the lines: `ends` of each, and the line that it is of."""
        return replace(self.take(line), ends=ends)


def walls_of_drawing(
    drawing: VectorDrawing, roles: list[Role], metres_per_unit: float | None
) -> DrawnWalls:
    """Find the walls of a cleaned drawing.

    Args:
        drawing: lines, fills; coordinates in its own unit.
        roles: what each layer holds.
        metres_per_unit: where it is known, walls are 0.03 to 0.62 m thick; otherwise the usual
            distance of neighbouring lines tells.
    """
    role = np.array(roles, dtype=int)[drawing.lines.layer]
    extent = _extent(drawing, role)
    looked_at = np.flatnonzero(role != Role.NO_WALL)
    lines = drawing.lines.take(looked_at)
    dropped = _words_on_layers(drawing, role)
    is_row = _are_in_rows(lines, extent, metres_per_unit)
    solids, rooms = _solids_and_rooms(drawing, roles, lines, is_row, extent)
    has_form, words = _have_form_of_faces(lines, is_row)
    dropped += words
    is_left_out = np.ones(len(drawing.lines), dtype=bool)
    is_left_out[looked_at[has_form]] = False
    candidates = _merged(lines.take(has_form), role[looked_at[has_form]], extent)
    bounds = thickness_bounds(metres_per_unit, extent)
    windows = take_out_windows(candidates.ends, *bounds, 2e-4 * extent)
    candidates = candidates.cut(windows.ends, windows.line)
    if len(windows.openings):
        dropped.append(f"panes and sills of {len(windows.openings) // 2} windows in double lines")
    if rooms:
        dropped.append(f"line work inside {len(rooms)} filled or hatched rooms")
    parts, used, warnings = _faces_of_all(solids, rooms, candidates, metres_per_unit, extent)
    faces, apart = _main_part(LineFaces.together(parts), extent)
    if len(apart):
        dropped.append(f"{len(apart)} faces apart from the building (legend, title block, details)")
    names = [drawing.layers[i] for i in used if i >= 0]
    if solids or rooms:
        names += sorted({drawing.layers[fill.layer] for fill in drawing.fills})
    return DrawnWalls(
        faces,
        tuple(dict.fromkeys(names)),
        tuple(dropped),
        warnings,
        is_left_out,
        apart,
        windows.openings,
    )


def _words_on_layers(drawing: VectorDrawing, role: Int[np.ndarray, " n"]) -> list[str]:
    """What was left out because its layer holds no walls."""
    is_no_wall = role == Role.NO_WALL
    if not is_no_wall.any():
        return []
    names = sorted({drawing.layers[i] for i in np.unique(drawing.lines.layer[is_no_wall])})
    return [f"{is_no_wall.sum()} lines on layers of no walls: {_listed(names)}"]


def _are_in_rows(
    lines: Lines, extent: float, metres_per_unit: float | None
) -> Bool[np.ndarray, " n"]:
    """Straight lines in rows at equal distance: hatches and treads."""
    reach = extent / 25 if metres_per_unit is None else 1.0 / metres_per_unit
    is_row = np.zeros(len(lines), dtype=bool)
    straight = np.flatnonzero(~lines.is_curved & (segments.lengths(lines.ends) > 2e-3 * extent))
    is_row[straight] = rows_of_lines(lines.ends[straight], lines.style[straight], reach)
    return is_row


def _solids_and_rooms(
    drawing: VectorDrawing,
    roles: list[Role],
    lines: Lines,
    is_row: Bool[np.ndarray, " n"],
    extent: float,
) -> tuple[list[BaseGeometry], list[BaseGeometry]]:
    """Filled and hatched areas: solid walls, and floors of rooms."""
    areas = sort_fills(drawing.fills, roles, extent)
    walls, rooms = areas.walls, areas.rooms
    hatched = hatched_areas(lines.ends, lines.path, is_row, extent)
    slim = [area for area in hatched if _is_slim(area)]
    # A drawing hatches either its walls or its floors.
    if rooms or len(slim) < len(hatched) - len(slim):
        rooms = [*rooms, *hatched]
    else:
        walls = [*walls, *slim]
    return walls, main_rooms(rooms, extent)


def _have_form_of_faces(
    lines: Lines, is_row: Bool[np.ndarray, " n"]
) -> tuple[Bool[np.ndarray, " n"], list[str]]:
    """Lines that are neither in rows, nor curved, nor open doors; and what the others are, in words."""
    is_leaf = ~lines.is_curved & is_door_leaf(lines.ends, *arcs_of_lines(lines))
    words = []
    if is_row.any():
        words.append(f"{is_row.sum()} lines in rows at equal distance (hatches, stairs)")
    if lines.is_curved.any():
        words.append(
            f"{lines.is_curved.sum()} segments of curves (door arcs, symbols, round walls)"
        )
    if is_leaf.any():
        words.append(f"{is_leaf.sum()} lines of open doors")
    return ~is_row & ~lines.is_curved & ~is_leaf, words


def _merged(lines: Lines, role: Int[np.ndarray, " n"], extent: float) -> _Candidates:
    """Lines on one another as one: a wall if one of them is called so, on the layer of the last."""
    ends, group = merge_collinear(lines.ends, 3e-5 * extent)
    is_called_wall = np.zeros(len(ends), dtype=bool)
    is_called_wall[group[role == Role.WALL]] = True
    layer = np.zeros(len(ends), dtype=int)
    layer[group] = lines.layer
    return _Candidates(ends, is_called_wall, layer, np.zeros(len(ends), dtype=int))


def _faces_of_all(
    solids: list[BaseGeometry],
    rooms: list[BaseGeometry],
    candidates: _Candidates,
    metres_per_unit: float | None,
    extent: float,
) -> tuple[list[LineFaces], Int[np.ndarray, " u"], tuple[str, ...]]:
    """Faces of solid walls, of double lines, and of the edges of rooms; where there are none, single lines.

    Also the layers, ascending, whose lines are faces, and warnings.
    """
    parts: list[LineFaces] = []
    if solids:
        solid = shapely.union_all(solids)
        parts.append(_faces_of_solid(solid, extent))
        around = shapely.buffer(solid, 1e-3 * extent)
        candidates = candidates.take(~shapely.contains(around, line_strings(candidates.ends)))
    if rooms:
        candidates = _around_rooms(candidates, rooms, extent)
    thickness = None
    if len(candidates):
        thickness = estimate_thickness(candidates.ends, metres_per_unit, extent)
    used, paired = np.zeros(0, dtype=int), None
    # Beside solid walls, line work is furniture and windows, unless a layer calls it wall.
    if thickness is not None and not (solids and not candidates.is_called_wall.any()):
        paired, _ = faces_of_lines(
            candidates.ends, thickness, candidates.is_called_wall, candidates.free_side
        )
        parts.append(paired)
        used = np.unique(candidates.layer[paired.line])
    if rooms:
        parts.append(_bare_edges(candidates, paired))
    if len(candidates) and sum(len(part.ends) for part in parts) == 0:
        single = _single_lines(candidates, extent)
        if len(single.ends):
            used = np.unique(candidates.layer[single.line])
            warning = "walls are drawn as single lines: which side of them is free is unknown"
            return [single], used, (warning,)
    return parts, used, ()


def _around_rooms(candidates: _Candidates, rooms: list[BaseGeometry], extent: float) -> _Candidates:
    """Lines outside rooms, and the edges of these, which look into their room on the left."""
    outside = candidates.cut(*outside_rooms(candidates.ends, rooms, 4e-4 * extent))
    edges = edges_of_rooms(rooms, 4e-4 * extent)
    n = len(edges)
    return _Candidates(
        np.concatenate([outside.ends, edges]),
        np.concatenate([outside.is_called_wall, np.ones(n, dtype=bool)]),
        np.concatenate([outside.layer, np.full(n, -1)]),
        np.concatenate([outside.free_side, np.ones(n, dtype=int)]),
    )


def _extent(drawing: VectorDrawing, role: Int[np.ndarray, " n"]) -> float:
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


def _bare_edges(candidates: _Candidates, paired: LineFaces | None) -> LineFaces:
    """Edges of rooms with nothing beside them: the outside of a building drawn without thickness."""
    is_edge = candidates.free_side != 0
    if paired is not None:
        is_edge[paired.line] = False
    at = np.flatnonzero(is_edge)
    normals = segments.left_normals(candidates.ends[at]) * candidates.free_side[at, None]
    n = len(at)
    return LineFaces(candidates.ends[at], normals, np.ones(n, dtype=bool), np.full(n, np.nan), at)


def _single_lines(candidates: _Candidates, extent: float) -> LineFaces:
    """Long lines, of walls by name where any is, as faces whose free side is unknown."""
    long, is_called_wall = (
        segments.lengths(candidates.ends) > 0.02 * extent,
        candidates.is_called_wall,
    )
    at = np.flatnonzero(long & is_called_wall if is_called_wall.any() else long)
    ends, n = candidates.ends[at], len(at)
    return LineFaces(
        ends, segments.left_normals(ends), np.zeros(n, dtype=bool), np.full(n, np.nan), at
    )


def _main_part(faces: LineFaces, extent: float) -> tuple[LineFaces, Float[np.ndarray, "a 2 2"]]:
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
    return faces.take(keep), faces.ends[~keep]


def _listed(names: list[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
