"""From a drawing to wall faces: fills, hatches and double lines, each read as what it is."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import check_crossings, groups_within, line_strings, weighted_median
from planfit.floorplan.vector.arcs import round_walls
from planfit.floorplan.vector.areas import (
    are_outlined,
    hatched_areas,
    left_out_rooms,
    main_rooms,
    plot_words,
    sort_fills,
    uppermost,
    without_ground,
    without_paper,
    without_surroundings,
)
from planfit.floorplan.vector.closed_pieces import closed_pieces, open_walls, outer_wall
from planfit.floorplan.vector.door_swings import (
    DoorSwing,
    door_radii,
    find_door_swings,
    without_sectors,
)
from planfit.floorplan.vector.doors import OpenedDoors, open_doors, open_jambs
from planfit.floorplan.vector.double_lines import rows_of_lines, thickness_bounds
from planfit.floorplan.vector.drawing import SAME, Lines, VectorDrawing
from planfit.floorplan.vector.layer_names import LayerLength, Role, counted, lengths_by_layer
from planfit.floorplan.vector.line_work import (
    Candidates,
    WallFaces,
    cut_out,
    merge_collinear,
    usual_extent,
)
from planfit.floorplan.vector.openings import take_out_windows
from planfit.floorplan.vector.room_edges import boxed_rooms, drawn_between_rooms
from planfit.floorplan.vector.single_lines import body_of_faces, left_out_words, lengths_beside
from planfit.floorplan.vector.strokes import LEAST_SLIM, slimness
from planfit.floorplan.vector.wall_faces import MAIN_SHARE, faces_of_all, faces_of_solid
from planfit.geometry import segments

CALLED_SHARE = 0.25
"""Of a line, what must lie on lines of layers that are called wall: the end of a wall lies on the outline of
the building that it is built in."""


@dataclass(frozen=True)
class DrawnWalls:
    """Faces in the drawing's own unit and axes."""

    faces: WallFaces
    layers: tuple[str, ...]
    dropped: tuple[str, ...]
    warnings: tuple[str, ...]
    is_left_out: Bool[np.ndarray, " n"]
    """Of the drawing's lines: on layers of no walls, or of a form that no wall has."""
    apart: Float[np.ndarray, "a 2 2"]
    """Faces left out because they stand apart from the building."""
    openings: Float[np.ndarray, "k 2 2"]
    """Windows along the faces they interrupt, as far as they were drawn as such."""
    by_layer: tuple[LayerLength, ...] = ()
    """What became of the line work of each layer."""
    opening_kinds: tuple[str, ...] = ()
    """What the openings are, counted."""
    shared_edges: float = 0.0
    """Length of the edges where two filled rooms meet without a wall between them, taken for open."""
    opening_names: tuple[str, ...] = ()
    """What each of the openings is."""
    are_rooms_touching: bool = False
    """Whether rooms meet without a wall of any thickness between them: where they do was taken for wall."""


def walls_of_drawing(
    drawing: VectorDrawing,
    roles: list[Role],
    metres_per_unit: float | None,
    are_chosen: bool = False,
) -> DrawnWalls:
    """Find the walls of a cleaned drawing.

    Args:
        roles: what each layer holds.
        metres_per_unit: where it is known, walls are 0.03 to 0.62 m thick; otherwise the usual distance of
            neighbouring lines tells.
        are_chosen: whether the user named the layers of walls: others only open them.

    Raises:
        LineWorkTooDense: more lines lie side by side, or cross, than in any plan.
    """
    role = np.array(roles, dtype=int)[drawing.lines.layer]
    extent = _extent(drawing, role)
    looked_at = np.flatnonzero(role != Role.NO_WALL)
    lines = drawing.lines.take(looked_at)
    dropped: list[str] = []
    is_row = _are_in_rows(lines, extent, metres_per_unit)
    radii = door_radii(metres_per_unit, None, extent)
    swings = find_door_swings(lines, radii)
    fills, sectors = without_sectors(drawing.fills, radii)
    drawing, swings = replace(drawing, fills=fills), [*swings, *sectors]
    check_crossings(lines.ends[~is_row])
    bounds = thickness_bounds(metres_per_unit, extent)
    solids, rooms, room_words = _solids_and_rooms(drawing, roles, lines, is_row, bounds[1], extent)
    pieces = closed_pieces(lines, roles, bounds[1])
    opened = open_walls(solids, pieces, lines, drawing.fills, roles, extent)
    solids, pieces = opened.solids, opened.pieces
    has_form, words = _have_form_of_faces(lines, is_row, swings)
    dropped += words
    if are_chosen:
        has_form &= role[looked_at] == Role.WALL
    is_left_out = np.ones(len(drawing.lines), dtype=bool)
    candidates = _merged(lines.take(has_form), role[looked_at[has_form]], extent)
    candidates = candidates.cut(*cut_out(candidates.ends, opened.area, 1e-3 * extent))
    windows = take_out_windows(candidates.ends, *bounds, 2e-4 * extent)
    candidates = candidates.cut(windows.ends, windows.line)
    if len(windows.openings):
        dropped.append(f"panes and sills of {len(windows.openings) // 2} windows in double lines")
    if rooms:
        dropped.append(f"line work inside {len(rooms)} filled or hatched rooms")
    wall = shapely.Polygon()
    if metres_per_unit is None and not (solids or pieces.areas or rooms):
        wall = outer_wall(lines.take(has_form), bounds[1], extent)
        on_wall = shapely.buffer(wall, 1e-3 * extent, join_style="mitre")
        candidates = candidates.take(~shapely.covers(on_wall, line_strings(candidates.ends)))
    found = faces_of_all(solids, pieces, rooms, candidates, metres_per_unit, extent)
    if not wall.is_empty:
        found = replace(found, parts=[*found.parts, faces_of_solid(wall, extent)])
    if rooms and not found.are_rooms_touching:
        between = drawn_between_rooms(lines.take(has_form), rooms, extent)
        found = found.with_single_lines(between)
    round_faces, is_round = _round_walls(WallFaces.of_parts(found.parts), lines)
    openings = np.concatenate([windows.openings, opened.openings])
    faces, apart = _main_part(WallFaces.of_parts([*found.parts, round_faces]), openings, extent)
    is_left_out[looked_at[has_form | is_round]] = False
    if n_curves := int((lines.is_curved & ~is_round).sum()):
        dropped.append(f"{n_curves} segments of curves (door arcs, symbols)")
    doors = _open_doors(faces, swings, metres_per_unit, bounds[1], extent)
    faces, between_jambs = open_jambs(doors, lines.ends[has_form], extent)
    n_windows, n_others = len(windows.openings) // 2, len(between_jambs) // 2
    doors_are = counted(doors.n_doors, "door")
    others_are = counted(n_others + len(opened.openings) // 2, "opening")
    if doors.n_doors:
        dropped.append(f"lines that ran through {doors_are} drawn with their swing")
    if n_others:
        dropped.append(f"lines that ran through {counted(n_others, 'opening')} between jambs")
    if len(apart):
        dropped.append(f"{len(apart)} faces apart from the building (legend, title block, details)")
    by_layer = lengths_by_layer(drawing, roles, found.candidates, faces)
    of_fills = {fill.layer for fill in drawing.fills if roles[fill.layer] != Role.NO_WALL}
    names = [drawing.layers[layer] for layer in of_fills] if solids or rooms else []
    names += [drawing.layers[i] for i in np.unique(pieces.layer)]
    used = [each.name for each in by_layer if each.taken > 0]
    return DrawnWalls(
        faces,
        tuple(dict.fromkeys([*used, *sorted(set(names))])),
        tuple(dropped),
        (*found.warnings, *room_words, *left_out_words(candidates, faces, extent)),
        is_left_out,
        apart,
        np.concatenate([windows.openings, doors.openings, between_jambs, opened.openings]),
        by_layer,
        tuple(filter(None, (doors_are, counted(n_windows, "window"), others_are))),
        found.shared_edges,
        opening_names=("window",) * len(windows.openings)
        + ("door",) * len(doors.openings)
        + ("opening",) * (len(between_jambs) + len(opened.openings)),
        are_rooms_touching=found.are_rooms_touching,
    )


def _round_walls(faces: WallFaces, lines: Lines) -> tuple[WallFaces, Bool[np.ndarray, " n"]]:
    """Faces of round walls and their lines, where walls are drawn as two lines; where they are solid, curves
    beside them are windows and furniture."""
    is_drawn = np.isfinite(faces.thickness) & (faces.line >= 0)
    length = segments.lengths(faces.ends)
    if length[is_drawn].sum() <= MAIN_SHARE * length.sum():
        return WallFaces.of_parts([]), np.zeros(len(lines), dtype=bool)
    usual = weighted_median(faces.thickness[is_drawn], length[is_drawn])
    return round_walls(lines, usual)


def counted_openings(names: Sequence[str]) -> tuple[str, ...]:
    """How many doors and windows there are, each with an opening in both faces of its wall.

    `names`: what each opening is.
    """
    count = Counter(names)
    return tuple(counted((n + 1) // 2, name) for name, n in count.items())


def _open_doors(
    faces: WallFaces,
    swings: list[DoorSwing],
    metres_per_unit: float | None,
    most: float,
    extent: float,
) -> OpenedDoors:
    """Faces cut where doors are drawn in them. Where nothing tells how large doors are, as walls have no
    thickness, those count whose leaf is drawn."""
    usual = faces.usual_thickness
    least, widest = door_radii(metres_per_unit, usual, extent)
    is_size_known = metres_per_unit is not None or usual is not None
    doors = [
        swing
        for swing in swings
        if least < swing.radius < widest and (is_size_known or any(swing.has_leaf))
    ]
    if not doors or len(faces.ends) == 0:
        return OpenedDoors(faces, np.zeros((0, 2, 2)), 0)
    return open_doors(faces, doors, body_of_faces(faces, extent), most)


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
    most: float,
    extent: float,
) -> tuple[list[BaseGeometry], list[BaseGeometry], list[str]]:
    """Filled and hatched areas: solid walls, and floors of rooms; and doubts about these."""
    fills, is_paper_white = without_paper(drawing.fills, drawing.lines.ends, extent)
    fills = uppermost(fills)
    walls, rooms = sort_fills(fills, roles, extent, drawing.lines.ends, is_paper_white)
    rooms = without_surroundings(rooms, drawing.lines.ends, extent)
    hatched = hatched_areas(lines.ends, lines.path, is_row, extent)
    slim = [area for area in hatched if slimness(area) > LEAST_SLIM]
    # A drawing hatches either its walls or its floors.
    if rooms or len(slim) < len(hatched) - len(slim):
        rooms = [*rooms, *hatched]
    else:
        walls = [*walls, *slim]
    rooms = without_ground(rooms, walls, extent)
    drawn = [*line_strings(lines.ends), *(fill.polygon for fill in fills)]
    hull = shapely.convex_hull(shapely.GeometryCollection(drawn))
    chosen = main_rooms(rooms, extent, hull)
    called_wall = lines.ends[np.array(roles, dtype=int)[lines.layer] == Role.WALL]
    if chosen and are_outlined(chosen, called_wall, extent):
        # Faces of walls run in twos, and the floors end at them.
        beside = lengths_beside(called_wall, most, SAME * extent)
        if 2 * beside.sum() < segments.lengths(called_wall).sum():
            chosen = []
    if not walls and not chosen:
        chosen = boxed_rooms(lines, most, extent)
    words = [left_out_rooms(rooms, chosen), plot_words(chosen)]
    return walls, chosen, [each for each in words if each]


def _have_form_of_faces(
    lines: Lines, is_row: Bool[np.ndarray, " n"], swings: list[DoorSwing]
) -> tuple[Bool[np.ndarray, " n"], list[str]]:
    """Lines that are neither in rows, nor curved, nor open doors; and what the others are, in words."""
    is_leaf = np.zeros(len(lines), dtype=bool)
    for swing in swings:
        is_leaf[swing.leaf_lines] = True
    words = []
    if is_row.any():
        words.append(f"{is_row.sum()} lines in rows at equal distance (hatches, stairs)")
    if is_leaf.any():
        words.append(f"{is_leaf.sum()} lines of open doors")
    return ~is_row & ~lines.is_curved & ~is_leaf, words


def _merged(lines: Lines, role: Int[np.ndarray, " n"], extent: float) -> Candidates:
    """Lines on one another as one: a wall if more than a speck of it is called so, on the layer of the
    longest of those that are; else on the layer of the longest."""
    ends, group = merge_collinear(lines.ends, SAME * extent)
    length = segments.lengths(lines.ends)
    is_wall = role == Role.WALL
    called_length = np.zeros(len(ends))
    np.add.at(called_length, group[is_wall], length[is_wall])
    is_called_wall = called_length > CALLED_SHARE * segments.lengths(ends)
    layer = np.zeros(len(ends), dtype=int)
    # Of an array's places that are written several times the last stays.
    order = np.lexsort((length, is_wall & is_called_wall[group]))
    layer[group[order]] = lines.layer[order]
    return Candidates(ends, is_called_wall, layer, np.zeros(len(ends), dtype=int))


def _extent(drawing: VectorDrawing, role: Int[np.ndarray, " n"]) -> float:
    """Larger side of the box around the line work and fills."""
    points = [drawing.lines.ends[role != Role.NO_WALL].reshape(-1, 2)]
    points += [np.array(f.polygon.bounds).reshape(2, 2) for f in drawing.fills]
    return usual_extent(np.concatenate(points))


def _main_part(
    faces: WallFaces, openings: Float[np.ndarray, "k 2 2"], extent: float
) -> tuple[WallFaces, Float[np.ndarray, "a 2 2"]]:
    """Faces without groups that stand apart by a twentieth of the drawing and hold less than a
    twentieth of the largest group's length; and the ends of those. Openings do not part their wall. What
    stands inside of the largest is a column or a wall on its own."""
    n = len(faces.ends)
    if n == 0:
        return faces, faces.ends
    lines = line_strings(faces.ends)
    group = groups_within(np.concatenate([faces.ends, openings]), 0.05 * extent)[:n]
    total = np.bincount(group, segments.lengths(faces.ends))
    largest = shapely.convex_hull(shapely.multilinestrings(lines[group == total.argmax()]))
    shapely.prepare(largest)
    is_inside = np.bincount(group, ~shapely.covers(largest, lines)) == 0
    keep = ((total > 0.05 * total.max()) | is_inside)[group]
    return faces.take(keep), faces.ends[~keep]
