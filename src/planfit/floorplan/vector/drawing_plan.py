"""From a drawing, whatever its format, to a floorplan: clean, choose layers, find walls and unit."""

from pathlib import Path

import numpy as np

from planfit.errors import FloorplanError
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.drawing import Drawing, cleaned
from planfit.floorplan.vector.drawing_units import UnitFound, unit_of_drawing
from planfit.floorplan.vector.drawing_walls import DrawnWalls, walls_of_drawing
from planfit.floorplan.vector.layer_names import Role, chosen_layers, role_of
from planfit.floorplan.vector.shown_lines import shown_lines

FAR_FROM_ORIGIN = 20.0
"""Coordinates further from the origin than this many times the plan's size are shifted to it."""


def plan_of_drawing(
    drawing: Drawing,
    path: Path,
    fingerprint: str,
    options: PlanOptions,
    kind: str,
    file_from_drawing: np.ndarray,
) -> Floorplan:
    """Wall faces of a drawing.

    Args:
        drawing: x right, y up, in the file's unit.
        path: for messages.
        fingerprint: of the file.
        options: unit and layers.
        kind: of file, in words.
        file_from_drawing: (3, 3), to the file's own axes.

    Raises:
        FloorplanError: nothing in it looks like a wall, or a layer or unit asked for does not fit.
    """
    drawing, dropped = cleaned(drawing)
    if len(drawing.lines) == 0 and not drawing.fills:
        raise FloorplanError(
            f"{path}: expected a drawing of walls, found no lines or areas in it"
            + (f" ({dropped[0]} left out)" if dropped else "")
            + "; check that it is the right file"
        )
    if options.layers:
        chosen = chosen_layers(path, options.layers, drawing.layers)
        roles = [Role.WALL if is_chosen else Role.NO_WALL for is_chosen in chosen]
    else:
        roles = [role_of(name) for name in drawing.layers]
        if all(role == Role.NO_WALL for role in roles):
            roles = [Role.UNKNOWN] * len(roles)
    said = options.metres_per_unit
    walls = first = walls_of_drawing(drawing, roles, said)
    _require_walls(walls, path, drawing)
    size = float(np.ptp(walls.faces.ends.reshape(-1, 2), axis=0).max())
    unit = unit_of_drawing(drawing, path, options, size, _usual_thickness(walls))
    if unit.metres_per_unit is not None and unit.metres_per_unit != said:
        again = walls_of_drawing(drawing, roles, unit.metres_per_unit)
        walls = again if len(again.faces.ends) else walls
    doubts = _unit_doubts(first, walls, unit)
    hidden = [f"layers that are off or frozen: {', '.join(drawing.hidden_layers)}"]
    faces = walls.faces
    scale = unit.metres_per_unit or 1.0
    origin = _origin(faces.ends)
    file_from_plan = file_from_drawing @ np.array(
        [[1 / scale, 0, origin[0]], [0, 1 / scale, origin[1]], [0, 0, 1]]
    )
    drawn, left_out = shown_lines(drawing, roles, walls.is_left_out, walls.apart, file_from_drawing)
    return Floorplan(
        str(path),
        (faces.ends - origin) * scale,
        faces.normals,
        faces.is_oriented,
        fingerprint,
        thickness=faces.thickness * scale,
        openings=(walls.openings - origin) * scale if len(walls.openings) else None,
        is_metric=unit.metres_per_unit is not None,
        source=PlanSource(
            kind=kind,
            unit=unit.unit,
            unit_from=unit.unit_from,
            layers=tuple(name for name in walls.layers if name),
            dropped=(*dropped, *walls.dropped, *(hidden if drawing.hidden_layers else [])),
            warnings=(*unit.warnings, *doubts, *walls.warnings),
            file_from_plan=file_from_plan,
            drawn_lines=drawn,
            dropped_lines=left_out,
        ),
    )


def _require_walls(walls: DrawnWalls, path: Path, drawing: Drawing) -> None:
    if len(walls.faces.ends) == 0:
        raise FloorplanError(
            f"{path}: expected walls as double lines, filled or hatched areas, found none in "
            f"{len(drawing.lines)} lines and {len(drawing.fills)} areas; "
            "pass the layers that hold them, or check that it is a plan"
        )


def _unit_doubts(first: DrawnWalls, walls: DrawnWalls, unit: UnitFound) -> tuple[str, ...]:
    """Whether lines that look like walls where nothing is known of the unit are none in this one."""
    apart = _usual_thickness(first)
    if unit.metres_per_unit is None or apart is None or walls.faces.is_oriented.any():
        return ()
    return (
        f"with {unit.unit} as the unit, no two lines are as near as the faces of a wall; if those "
        f"{apart * unit.metres_per_unit:.2g} m apart are walls, the unit is wrong: give --unit",
    )


def _usual_thickness(walls: DrawnWalls) -> float | None:
    """Median over the length of the faces."""
    known = np.isfinite(walls.faces.thickness)
    if not known.any():
        return None
    thickness = walls.faces.thickness[known]
    length = np.linalg.norm(walls.faces.ends[known, 1] - walls.faces.ends[known, 0], axis=1)
    order = np.argsort(thickness)
    share = np.cumsum(length[order])
    return float(thickness[order][np.searchsorted(share, 0.5 * share[-1])])


def _origin(ends: np.ndarray) -> np.ndarray:
    """(2,) what to subtract: nothing for a plan near its origin, a round number for one far off,
    as in national grids, where single precision and squares of coordinates would suffer."""
    points = ends.reshape(-1, 2)
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(max(high - low))
    if np.abs(low + high).max() / 2 < FAR_FROM_ORIGIN * size:
        return np.zeros(2)
    step = 10.0 ** np.floor(np.log10(size))
    return np.floor(low / step) * step
