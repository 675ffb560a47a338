"""IFC: the walls of one storey, cut level so that doors and windows are gaps."""

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from planfit.errors import FloorplanError, told_as
from planfit.floorplan.elements import are_glass
from planfit.floorplan.formats import fingerprint_of
from planfit.floorplan.formats.georeference import map_conversion
from planfit.floorplan.formats.ifc_openings import LevelCut, find_openings, is_glass_element
from planfit.floorplan.options import PlanOptions, name_of_unit
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.line_work import longest, outlines
from planfit.floorplan.vector.regions import (
    MIN_FACE_M,
    TOLERANCE_M,
    faces_of_regions,
    without_seams,
)
from planfit.runtime import whole_number

WALL_KINDS = ("IfcWall", "IfcCurtainWall", "IfcColumn")
"""With all that derive from them, as IfcWallStandardCase does."""
MAX_SCHEMA_NAME, HEAD_BYTES = 60, 1 << 20
"""IFC4X3_ADD2 and its like; of a file, where its header must have ended."""


def read_ifc(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of a storey at `options.cut_height_m` above its floor, in metres.

    Without `options.storey` the lowest storey with doors is read (foundations have walls too), else
    the lowest with walls.

    Raises:
        FloorplanError: ifcopenshell is missing, the file is no IFC, has no such storey or no walls.
    """
    ifcopenshell = _ifcopenshell(path)
    model = _open(path, ifcopenshell)
    walls = [wall for kind in WALL_KINDS[:2] for wall in model.by_type(kind)]
    if not walls:
        raise FloorplanError(
            f"{path}: expected walls (IfcWall), found none in {len(model.by_type('IfcElement'))} "
            "elements; export the architect's model, not that of the structure or the services"
        )
    elements = [*walls, *model.by_type(WALL_KINDS[2])]
    unit_scale = float(ifcopenshell.util.unit.calculate_unit_scale(model))
    storeys = sorted(model.by_type("IfcBuildingStorey"), key=lambda s: _elevation(s, unit_scale))
    names = tuple(storey.Name or f"storey {i}" for i, storey in enumerate(storeys))
    by_storey = _by_storey([*elements, *model.by_type("IfcDoor")], ifcopenshell.util.element)
    chosen = _choose(path, options.storey, storeys, names, by_storey)
    floor = 0.0 if chosen is None else _elevation(storeys[chosen], unit_scale)
    parts, n_failed = _cut(ifcopenshell, elements, floor + options.cut_height_m)
    areas = [part.area for part in parts]
    if not areas:
        raise FloorplanError(
            f"{path}: expected walls {options.cut_height_m:g} m above the floor of "
            f"{names[chosen] if chosen is not None else 'the model'!r}, found none; "
            "choose another storey or height of the cut"
        )
    # Neighbouring walls are often mitred and meet up to rounding: seams of 4 mm are closed.
    solid = without_seams(areas, 0.002)
    faces = faces_of_regions(solid, TOLERANCE_M, MIN_FACE_M)
    found = find_openings(ifcopenshell, walls, solid, floor + options.cut_height_m, unit_scale)
    on_map = map_conversion(model, unit_scale)
    lines = [outlines([area]) / unit_scale for area in areas]
    has_units = len(model.by_type("IfcUnitAssignment")) > 0
    plan = Floorplan(
        str(path),
        faces.ends,
        faces.normals,
        np.ones(len(faces.ends), dtype=bool),
        fingerprint_of(path),
        thickness=faces.thickness,
        openings=found.sides if len(found.sides) else None,
        source=PlanSource(
            kind=f"IFC model ({model.schema})",
            unit=name_of_unit(unit_scale),
            unit_from="the project's units" if has_units else "the standard of the format (metres)",
            storey=names[chosen] if chosen is not None else "",
            storeys=names,
            dropped=(f"{n_failed} elements without geometry",) if n_failed else (),
            file_from_plan=np.diag([1 / unit_scale, 1 / unit_scale, 1.0]),
            drawn_lines=longest(outlines(areas)) / unit_scale,
            opening_kinds=found.kinds,
            opening_lines=found.sides / unit_scale,
            opening_names=found.kind_of_side,
            opening_ids=found.id_of_side,
            map_words="" if on_map is None else on_map.words,
            map_from_file=None if on_map is None else on_map.map_from_file,
            map_height_m=0.0 if on_map is None else on_map.height_m,
            element_lines=np.concatenate(lines),
            element_ids=tuple(
                part.element_id
                for part, own in zip(parts, lines, strict=True)
                for _ in range(len(own))
            ),
            element_is_glass=np.repeat([part.is_glass for part in parts], list(map(len, lines))),
            elevation_m=floor,
        ),
    )
    glass_m = float(plan.lengths[are_glass(plan)].sum())
    if glass_m == 0.0:
        return plan
    return plan.with_warning(
        f"{glass_m:.3g} m of faces are glass (curtain walls, and walls by their material): depth cameras "
        "may see what is behind them"
    )


def _ifcopenshell(path: Path) -> Any:
    """The package that reads IFC, which not everyone installs."""
    try:
        import ifcopenshell
        import ifcopenshell.geom
        import ifcopenshell.util.element
        import ifcopenshell.util.placement
        import ifcopenshell.util.unit
    except ImportError as error:
        raise FloorplanError(
            f"{path}: expected the package ifcopenshell to read IFC, found it missing; "
            "pip install 'planfit[ifc]'"
        ) from error
    return ifcopenshell


def _open(path: Path, ifcopenshell: Any) -> Any:
    with told_as(FloorplanError, path, "an IFC model"):
        _check_schema(path)
        model = ifcopenshell.open(str(path))
        if not isinstance(model, ifcopenshell.file):
            raise TypeError("not a building model")
        # ifcopenshell 0.9 divides by their number, and the process ends.
        for kind, points in (("IfcPolyline", "Points"), ("IfcPolyLoop", "Polygon")):
            if not all(getattr(line, points) for line in model.by_type(kind)):
                raise ValueError(f"an {kind} without points")
    return model


def _check_schema(path: Path) -> None:
    """Raise `ValueError` where the header names no schema as it should, several, or one of any length:
    ifcopenshell 0.9 dies of it, which no caller survives."""
    named = re.findall(rb"FILE_SCHEMA([^;]*)", _head(path))
    if len(named) > 1:
        raise ValueError(f"a header with {len(named)} schemas")
    for words in named:
        found = re.fullmatch(rb"\s*\(\s*\(\s*'([^']*)'\s*(?:,\s*'[^']*'\s*)*\)\s*\)\s*", words)
        if found is None:
            raise ValueError("a header whose schema has no name")
        if len(found[1]) > MAX_SCHEMA_NAME:
            raise ValueError(f"a schema whose name has {len(found[1])} letters")


def _head(path: Path) -> bytes:
    """The begin of the model, which a zip archive may hold."""
    if not zipfile.is_zipfile(path):
        with path.open("rb") as file:
            return file.read(HEAD_BYTES)
    with zipfile.ZipFile(path) as archive:
        models = [name for name in archive.namelist() if name.lower().endswith(".ifc")]
        if not models:
            return b""
        with archive.open(models[0]) as file:
            return file.read(HEAD_BYTES)


def _by_storey(elements: list[Any], util_element: Any) -> dict[int, list[Any]]:
    """Elements by the id of their storey; 0 where they have none."""
    result: dict[int, list[Any]] = {}
    for element in elements:
        storey = _storey_of(element, util_element)
        result.setdefault(storey.id() if storey is not None else 0, []).append(element)
    return result


def _storey_of(element: Any, util_element: Any) -> Any:
    container = util_element.get_container(element, ifc_class="IfcBuildingStorey")
    if container is None:
        parent = util_element.get_aggregate(element)
        return None if parent is None else _storey_of(parent, util_element)
    return container


def _elevation(storey: Any, unit_scale: float) -> float:
    """Height of a storey's floor, m: of its placement, which its geometry stands on."""
    import ifcopenshell.util.placement

    if storey.ObjectPlacement is not None:
        matrix = ifcopenshell.util.placement.get_local_placement(storey.ObjectPlacement)
        return float(matrix[2][3]) * unit_scale
    return float(storey.Elevation or 0.0) * unit_scale


def _choose(
    path: Path,
    wanted: str,
    storeys: list[Any],
    names: tuple[str, ...],
    by_storey: dict[int, list[Any]],
) -> int | None:
    """Index of the storey to read; None where the model has none."""
    listed = ", ".join(f"{i} {name!r}" for i, name in enumerate(names)) or "none"
    if wanted:
        lower = [name.lower() for name in names]
        if wanted.lower() in lower:
            return lower.index(wanted.lower())
        number = whole_number(wanted)
        if number is not None and number < len(names):
            return number
        raise FloorplanError(
            f"{path}: expected a storey {wanted!r}, found {listed}; pass one of them"
        )
    kinds = [{e.is_a() for e in by_storey.get(storey.id(), [])} for storey in storeys]
    with_doors = [i for i, kind in enumerate(kinds) if "IfcDoor" in kind]
    with_walls = [i for i, kind in enumerate(kinds) if kind - {"IfcDoor", "IfcColumn"}]
    return next(iter([*with_doors, *with_walls, *range(len(storeys))]), None)


@dataclass(frozen=True)
class _Part:
    """Of a wall or a column, cut."""

    area: BaseGeometry
    """m"""
    element_id: str
    """GlobalId of the wall or column that it is of."""
    is_glass: bool


def _cut(ifcopenshell: Any, elements: list[Any], height: float) -> tuple[list[_Part], int]:
    """Areas of solid at a height, and the number of elements without geometry.

    All elements of the building are cut, not those of the storey alone: walls may go on through
    several, and hang on the one they begin in.
    """
    cut = LevelCut(ifcopenshell, height)
    found: list[_Part] = []
    failed = 0
    for element in elements:
        shapes = [part for part in [element, *_parts(element)] if part.Representation is not None]
        failed += not shapes
        for part in shapes:
            area = cut.area_of(part)
            if area is None:
                failed += 1
            elif not area.is_empty:
                is_glass = is_glass_element(part, ifcopenshell.util.element)
                found.append(_Part(area, str(element.GlobalId), is_glass))
    return found, failed


def _parts(element: Any) -> list[Any]:
    """What a wall is put together of, at any depth: panels and posts of a curtain wall, elements of a wall.
    A door in a curtain wall is a gap, as in other walls."""
    found: list[Any] = []
    met, open_ones = {element.id()}, [element]
    while open_ones:
        for relation in open_ones.pop().IsDecomposedBy or ():
            # In a damaged file parts may be wholes of each other.
            new = [one for one in relation.RelatedObjects if one.id() not in met]
            met.update(one.id() for one in new)
            found += new
            open_ones += new
    return [one for one in found if one.is_a("IfcProduct") and not one.is_a("IfcDoor")]
