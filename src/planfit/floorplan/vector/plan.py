"""From a drawing, whatever its format, to a floorplan: clean, choose layers, find walls and unit, and tell
storeys that are drawn beside one another."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.errors import FloorplanError
from planfit.floorplan.gaps import find_openings
from planfit.floorplan.options import PlanOptions, PlanUnit
from planfit.floorplan.plans_on_sheet import (
    MOST_STOREYS,
    find_storeys,
    storey_number,
    storey_words,
    storeys_warning,
)
from planfit.floorplan.plausible import are_closed_rooms, closed_shares, closed_words, sketch_words
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.cleaning import cleaned
from planfit.floorplan.vector.drawing import EDGE, VectorDrawing
from planfit.floorplan.vector.layer_names import (
    Role,
    chosen_layers,
    length_words,
    role_of,
    words_on_layers,
)
from planfit.floorplan.vector.line_work import WallFaces, longest, outlines, round_origin
from planfit.floorplan.vector.own_drawing import is_own_drawing, plan_of_own_drawing
from planfit.floorplan.vector.scale_bars import ScaleBar, find_scale_bars, without_scale_bars
from planfit.floorplan.vector.sheet import without_sheet
from planfit.floorplan.vector.single_lines import LONGEST_PANE, body_of_faces
from planfit.floorplan.vector.units import scale_of_rooms, unit_of_drawing
from planfit.floorplan.vector.walls import DrawnWalls, counted_openings, walls_of_drawing
from planfit.geometry import segments

SKETCH_PX = 1000.0
"""What sketches are told by is measured in pixels of a picture as wide."""
SIDE = 1200
"""Cells along the longer side of the grid in which is looked at what is drawn between two plans."""


def plan_of_drawing(
    drawing: VectorDrawing,
    path: Path,
    fingerprint: str,
    options: PlanOptions,
    kind: str,
    file_from_drawing: Float[np.ndarray, "3 3"],
) -> Floorplan:
    """Wall faces of a drawing.

    Args:
        drawing: x right, y up, in the file's unit.
        options: unit and layers.
        file_from_drawing: affine, to the file's own axes.

    Raises:
        FloorplanError: nothing in it looks like a wall, or a layer or unit asked for does not fit.
    """
    if is_own_drawing(drawing, options):
        return plan_of_own_drawing(drawing, path, fingerprint, options, kind, file_from_drawing)
    drawing, dropped = cleaned(drawing)
    if len(drawing.lines) == 0 and not drawing.fills:
        raise FloorplanError(
            f"{path}: expected a drawing of walls, found no lines or areas in it"
            + (f" ({dropped[0]} left out)" if dropped else "")
            + "; check that it is the right file"
        )
    roles = _roles(path, drawing, options)
    bars = find_scale_bars(drawing)
    drawing, roles = without_scale_bars(drawing, roles, bars)
    if not options.layers:
        drawing, roles = without_sheet(drawing, roles)
    walls, unit = _walls_and_unit(drawing, roles, bars, path, options)
    unread = [*walls.dropped]
    if drawing.hidden_layers:
        unread.append(f"layers that are off or frozen: {', '.join(drawing.hidden_layers)}")
    if walls.shared_edges > 0:
        edges = length_words(walls.shared_edges, unit.metres)
        unread.append(f"{edges} of edges where two rooms meet without a wall between them")
    origin = round_origin(walls.faces.ends.reshape(-1, 2))
    walls, storeys = _of_storey(walls, drawing, path, options.storey)
    left, doubts = words_on_layers(walls.by_layer, unit.metres, bool(options.layers))
    warnings = (*unit.warnings, *walls.warnings, *doubts)
    drawn, left_out = shown_lines(drawing, roles, walls.is_left_out, walls.apart, file_from_drawing)
    faces = walls.faces
    scale = unit.scale
    return Floorplan(
        str(path),
        (faces.ends - origin) * scale,
        faces.normals,
        faces.is_oriented,
        fingerprint,
        thickness=faces.thickness * scale,
        openings=(walls.openings - origin) * scale if len(walls.openings) else None,
        is_metric=unit.metres is not None,
        source=PlanSource(
            kind=kind,
            unit=unit.name,
            unit_from=unit.known_from,
            storey=options.storey if storeys else "",
            storeys=storeys,
            layers=tuple(name for name in walls.layers if name),
            dropped=(*dropped, *left, *unread),
            warnings=warnings,
            file_from_plan=file_from_drawing
            @ np.array([[1 / scale, 0, origin[0]], [0, 1 / scale, origin[1]], [0, 0, 1]]),
            drawn_lines=drawn,
            dropped_lines=left_out,
            opening_kinds=walls.opening_kinds,
            opening_lines=segments.moved(walls.openings, file_from_drawing),
            opening_names=walls.opening_names,
            opening_ids=("",) * len(walls.opening_names),
        ),
    )


def _of_storey(
    walls: DrawnWalls, drawing: VectorDrawing, path: Path, asked: str
) -> tuple[DrawnWalls, tuple[str, ...]]:
    """The walls of the storey that is asked for, or all with a warning where there are several; and what
    the storeys are called.

    Raises:
        FloorplanError: there is no such storey.
    """
    looked_at = drawing.lines.ends[~walls.is_left_out]
    of_face, of_opening, words = storeys_of_drawing(walls.faces, walls.openings, looked_at)
    if not asked:
        if len(words) == 1:
            return walls, ()
        warning = storeys_warning(words) if len(words) <= MOST_STOREYS else (
            f"{len(words)} groups of walls stand apart, more than there are storeys on a sheet: is it a site "
            "plan, or a sheet of details? Compare the overlay (-o FILE.png) with the drawing"
        )  # fmt: skip
        walls = replace(walls, warnings=(*walls.warnings, warning))
    else:
        number = storey_number(str(path), asked, words)
        walls = _only(walls, of_face == number, of_opening == number)
    names = tuple(f"{k}: {word}" for k, word in enumerate(words))
    return walls, names if 1 < len(words) <= MOST_STOREYS else ()


def _only(
    walls: DrawnWalls, is_face: Bool[np.ndarray, " n"], kept: Bool[np.ndarray, " k"]
) -> DrawnWalls:
    """Faces and openings (`kept`) of one storey."""
    names = tuple(name for name, keep in zip(walls.opening_names, kept, strict=True) if keep)
    return replace(
        walls,
        faces=walls.faces.take(is_face),
        openings=walls.openings[kept],
        opening_names=names,
        opening_kinds=counted_openings(names),
    )


def _roles(path: Path, drawing: VectorDrawing, options: PlanOptions) -> list[Role]:
    """What each layer holds: as the user says, or by its name, unless no layer is left by that, or a page
    alone, as beside the group `axes_1` of Matplotlib, which holds all that is drawn. Doors open the walls of
    chosen layers, whichever layer they are on."""
    roles = [role_of(name) for name in drawing.layers]
    if options.layers:
        chosen = chosen_layers(path, options.layers, drawing.layers)
        roles = [role if role == Role.OPENING else Role.NO_WALL for role in roles]
        return [Role.WALL if own else role for own, role in zip(chosen, roles, strict=True)]
    of_lines = drawing.lines.layer.tolist()
    others = [k for k in (*of_lines, *(f.layer for f in drawing.fills)) if roles[k] != Role.NO_WALL]
    return roles if len(others) > 1 else [Role.UNKNOWN] * len(roles)


def _walls_and_unit(
    drawing: VectorDrawing,
    roles: list[Role],
    bars: list[ScaleBar],
    path: Path,
    options: PlanOptions,
) -> tuple[DrawnWalls, PlanUnit]:
    """Walls, looked for twice where only their thickness and size tell the unit, which tells how thick they
    may be.

    Raises:
        FloorplanError: there are none, or the user's unit makes a building of an absurd size.
    """
    said = options.metres_per_unit
    are_chosen = bool(options.layers)
    walls = first = walls_of_drawing(drawing, roles, said, are_chosen)
    if len(walls.faces.ends) == 0:
        raise FloorplanError(
            f"{path}: expected walls as double lines, filled or hatched areas, found none in "
            f"{len(drawing.lines)} lines and {len(drawing.fills)} areas; "
            "pass the layers that hold them, or check that it is a plan"
        )
    size = float(np.ptp(walls.faces.ends.reshape(-1, 2), axis=0).max())
    rooms = scale_of_rooms(walls.faces.ends, drawing.texts)
    thickness = walls.faces.usual_thickness
    unit = unit_of_drawing(drawing, path, options, size, thickness, bars, rooms)
    if unit.metres is not None and unit.metres != said:
        again = walls_of_drawing(drawing, roles, unit.metres, are_chosen)
        walls = again if len(again.faces.ends) else walls
    warnings = (*_warnings_on_unit(first, walls, unit), *walls.warnings)
    return replace(walls, warnings=(*warnings, *_doubts(walls))), unit


def _doubts(walls: DrawnWalls) -> tuple[str, ...]:
    """What speaks against a floorplan, a sentence each: a section has no doors, a sketch no straight line."""
    ends = walls.faces.ends
    extent = float(np.ptp(ends.reshape(-1, 2), axis=0).max())
    found = [sketch_words(SKETCH_PX / extent * ends)]
    # Rooms that touch are told to be closed already.
    if not walls.are_rooms_touching:
        shares = closed_shares(list(shapely.get_parts(body_of_faces(walls.faces, extent))))
        found += [closed_words(shares)] if are_closed_rooms(shares) else []
    return tuple(words for words in found if words)


def _warnings_on_unit(first: DrawnWalls, walls: DrawnWalls, unit: PlanUnit) -> tuple[str, ...]:
    """Whether lines that look like walls where nothing is known of the unit are none in this one."""
    apart = first.faces.usual_thickness
    if unit.metres is None or apart is None or walls.faces.is_oriented.any():
        return ()
    return (
        f"with {unit.name} as the unit, no two lines are as near as the faces of a wall; if those "
        f"{apart * unit.metres:.2g} m apart are walls, the unit is wrong: give --unit",
    )


def shown_lines(
    drawing: VectorDrawing,
    roles: list[Role],
    is_left_out: Bool[np.ndarray, " n"],
    apart: Float[np.ndarray, "a 2 2"],
    file_from_drawing: Float[np.ndarray, "3 3"],
) -> tuple[Float[np.ndarray, "k 2 2"], Float[np.ndarray, "d 2 2"]]:
    """What was looked at, and what was left out, to be shown behind the faces; in the file's own coordinates.

    Args:
        drawing: cleaned.
        is_left_out: of its lines: not looked at as walls.
        apart: faces that were found and left out, in the drawing's coordinates.
        file_from_drawing: affine.
    """
    by_role: tuple[list[BaseGeometry], list[BaseGeometry]] = ([], [])
    for fill in drawing.fills:
        by_role[roles[fill.layer] == Role.NO_WALL].append(fill.polygon)
    ends = drawing.lines.ends
    kept = np.concatenate([ends[~is_left_out], outlines(by_role[0])])
    left = np.concatenate([ends[is_left_out], outlines(by_role[1]), apart])
    drawn, left_out = (segments.moved(longest(each), file_from_drawing) for each in (kept, left))
    return drawn, left_out


def storeys_of_drawing(
    faces: WallFaces, openings: Float[np.ndarray, "k 2 2"], lines: Float[np.ndarray, "m 2 2"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " k"], tuple[str, ...]]:
    """Storey of each face and of each opening, numbered as one reads a page, and where on it each storey is;
    all 0 where there is one plan.

    Args:
        faces: of the walls, in the drawing's unit, y up.
        openings: doors and windows along faces: what is on their two sides is of one storey.
        lines: that were looked at as walls; what joins two parts of a plan, as a glazed front does.
    """
    points = faces.ends.reshape(-1, 2)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = float((high - low).max())
    one = np.zeros(len(faces.ends), dtype=int), np.zeros(len(openings), dtype=int), ("all",)
    if extent <= 0.0:
        return one
    cell = extent / SIDE
    # A page's u, v: down is up in the drawing.
    page, origin = np.array([1.0, -1.0]) / cell, np.array([low[0], high[1]])
    body = shapely.transform(body_of_faces(faces, extent), lambda xy: (xy - origin) * page)
    walls = np.array(shapely.get_parts(body), dtype=object)
    known = np.isfinite(faces.thickness)
    thickness = faces.usual_thickness or EDGE * extent
    is_short = segments.lengths(lines) < LONGEST_PANE * extent
    drawn = np.concatenate([(lines[is_short] - origin) * page, (faces.ends - origin) * page])
    gaps = (openings - origin) * page
    # Doors and windows that are not drawn, as where the layer of walls alone was chosen.
    bare = find_openings(
        (faces.ends[known] - origin) * page,
        faces.normals[known] * np.sign(page),
        faces.thickness[known] / cell,
    )
    joining = np.concatenate([gaps, bare])
    storey_of = find_storeys(walls, thickness / cell, joining, _grid(drawn))
    if storey_of.max() == 0:
        return one
    tree = shapely.STRtree(walls)

    def nearest(ends: Float[np.ndarray, "n 2 2"]) -> Int[np.ndarray, " n"]:
        return storey_of[tree.nearest(shapely.points(ends.mean(axis=1)))]

    of_face = nearest((faces.ends - origin) * page)
    return of_face, nearest(gaps), storey_words(walls, storey_of)


def _grid(ends: Float[np.ndarray, "n 2 2"]) -> Bool[np.ndarray, "h w"]:
    """Cells that lines go through, row v and column u."""
    grid = np.zeros((SIDE + 2, SIDE + 2), dtype=bool)
    n_steps = np.ceil(2 * segments.lengths(ends)).astype(int) + 1
    at = np.round(segments.spread(ends, n_steps)[0]).astype(int)
    at = at[((at >= 0) & (at < SIDE + 2)).all(axis=1)]
    grid[at[:, 1], at[:, 0]] = True
    return grid
