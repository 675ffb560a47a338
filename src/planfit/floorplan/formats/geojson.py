"""GeoJSON and IMDF: walls as areas or lines, or rooms whose edges are the walls; local metres."""

import json
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from planfit.errors import FloorplanError
from planfit.floorplan.file import fingerprint_of
from planfit.floorplan.options import METRES_PER_UNIT, PlanOptions
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.drawing import Drawing, DrawingBuilder
from planfit.floorplan.vector.drawing_plan import plan_of_drawing
from planfit.floorplan.vector.layer_names import Role, role_of
from planfit.floorplan.vector.regions import faces_of_regions
from planfit.floorplan.vector.shown_lines import longest, outlines
from planfit.geometry import segments

_NAMING = ("category", "feature_type", "indoor", "type", "class", "layer", "kind", "building:part")
"""Properties that say what a feature is, in the order they are asked."""
_ROOM_NAMES = """
    room unit corridor walkway office area space zone hall lobby foyer kitchen bathroom restroom
    bedroom livingroom classroom conferenceroom auditorium laboratory storage elevator stairs
    stairwell escalator nonpublic unspecified
"""
_ROOMS = frozenset(_ROOM_NAMES.split())
_IMDF_PARTS = ("unit", "opening", "level", "fixture")
MAX_ARCHIVE_BYTES = 200_000_000
MAX_DEGREES = 0.1
"""Wider than 11 km is no building: the coordinates are no degrees."""
LIKELY_SIZE_M = 30.0
"""Of a plan whose unit is unknown; used for tolerances alone."""
OPENING_MARGIN_M = 0.05
_EQUATOR_M, _FLATTENING = 6378137.0, 1 / 298.257223563


@dataclass(frozen=True)
class _Feature:
    area: BaseGeometry
    name: str
    level: str


@dataclass(frozen=True)
class _Frame:
    """Local metres of coordinates: `(xy - origin) * scale`."""

    origin: np.ndarray  # (2,)
    scale: np.ndarray  # (2,) metres of one unit along each axis
    unit: str
    unit_from: str
    is_metric: bool
    warnings: tuple[str, ...] = ()
    likely_metre: float = 1.0
    """About a metre in `(xy - origin) * scale`, for tolerances."""


def read_geojson(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of a GeoJSON file, or of an IMDF folder or archive.

    Degrees become metres about the middle of the plan, x east and y north.

    Raises:
        FloorplanError: it is no GeoJSON, or holds neither walls nor rooms.
    """
    collections, fingerprint = _load(path)
    features = [f for kind, data in collections for f in _features(path, kind, data)]
    levels = tuple(sorted({f.level for f in features if f.level}))
    level = _chosen_level(path, options.storey, levels)
    here = [f for f in features if not f.level or f.level == level]
    walls = [f for f in here if role_of(f.name) == Role.WALL]
    openings = [f for f in here if role_of(f.name) == Role.OPENING]
    rooms = [f for f in here if _is_room(f.name) and f.area.geom_type.endswith("Polygon")]
    if options.layers:
        walls, rooms = [f for f in here if f.name in options.layers], []
    if not walls and not rooms:
        names = sorted({f.name for f in here if f.name})
        raise FloorplanError(
            f"{path}: expected walls or rooms, found {len(here)} features of the kinds "
            f"{', '.join(names[:10]) or 'none'}; name walls 'wall' and rooms 'room' in their "
            "property 'category' or 'type'"
        )
    frame = _frame([f.area for f in (walls or rooms)], options, collections)
    used = [*walls, *openings, *rooms]
    source = PlanSource(
        kind="IMDF" if len(collections) > 1 else "GeoJSON",
        unit=frame.unit,
        unit_from=frame.unit_from,
        storey=level,
        storeys=levels,
        layers=tuple(sorted({f.name for f in (walls or rooms)})),
        dropped=_left_out(here, used),
        warnings=frame.warnings,
        file_from_plan=np.array(
            [[1 / frame.scale[0], 0, frame.origin[0]], [0, 1 / frame.scale[1], frame.origin[1]], [0, 0, 1]]
        ),
        drawn_lines=longest(outlines([f.area for f in used])),
        dropped_lines=longest(outlines([f.area for f in here if not any(f is u for u in used)])),
    )  # fmt: skip
    areas = [_local(f.area, frame) for f in walls]
    solid = [a for a in areas if a.geom_type.endswith("Polygon")]
    if walls and not solid:
        drawn = _drawing(areas, walls)
        plan = plan_of_drawing(
            drawn,
            path,
            fingerprint,
            replace(
                options, layers=(), metres_per_unit=None, unit="m" if frame.is_metric else "unknown"
            ),
            source.kind,
            np.eye(3),
        )
        return replace(
            plan, source=replace(source, warnings=(*frame.warnings, *plan.source.warnings))
        )
    if solid:
        faces = faces_of_regions(
            shapely.union_all(solid), 0.005 * frame.likely_metre, 0.03 * frame.likely_metre
        )
        ends, normals, thickness = faces.ends, faces.normals, faces.thickness
    else:
        gaps: list[BaseGeometry] = [
            _local(f.area, frame).buffer(OPENING_MARGIN_M * frame.likely_metre) for f in openings
        ]
        ends = _edges([_local(f.area, frame) for f in rooms], gaps, frame.likely_metre)
        normals, thickness = segments.left_normals(ends), np.full(len(ends), np.nan)
    return Floorplan(
        str(path), ends, normals, np.ones(len(ends), dtype=bool), fingerprint,
        thickness=thickness, is_metric=frame.is_metric, source=source,
    )  # fmt: skip


def _load(path: Path) -> tuple[list[tuple[str, Any]], str]:
    """Pairs of (name of the part, parsed JSON), and a fingerprint."""
    if path.is_dir():
        parts = [path / f"{name}.geojson" for name in _IMDF_PARTS]
        parts = [part for part in parts if part.exists()]
        if not parts:
            raise FloorplanError(
                f"{path}: expected a folder of IMDF with unit.geojson, found none; "
                "pass the folder that holds it"
            )
        loaded = [(part.stem, _parsed(part, part.read_bytes())) for part in parts]
        return loaded, "-".join(fingerprint_of(part) for part in parts)
    if path.suffix.lower() != ".zip":
        return [("", _parsed(path, path.read_bytes()))], fingerprint_of(path)
    try:
        with zipfile.ZipFile(path) as archive:
            infos = [i for i in archive.infolist() if Path(i.filename).stem in _IMDF_PARTS]
            infos = [i for i in infos if i.filename.lower().endswith((".geojson", ".json"))]
            if sum(i.file_size for i in infos) > MAX_ARCHIVE_BYTES:
                raise FloorplanError(
                    f"{path}: expected an IMDF archive of at most {MAX_ARCHIVE_BYTES // 10**6} MB, "
                    "found more; unpack the building you need"
                )
            loaded = [(Path(i.filename).stem, _parsed(path, archive.read(i))) for i in infos]
    except (zipfile.BadZipFile, EOFError, OSError, RuntimeError) as error:
        raise FloorplanError(
            f"{path}: expected an IMDF archive, found a damaged one ({error}); download it again"
        ) from error
    if not loaded:
        raise FloorplanError(
            f"{path}: expected an IMDF archive with unit.geojson, found none in it"
        )
    return loaded, fingerprint_of(path)


def _parsed(path: Path, data: bytes) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise FloorplanError(
            f"{path}: expected GeoJSON, found no JSON ({error}); export it again"
        ) from error


def _features(path: Path, kind: str, data: Any) -> list[_Feature]:
    if not isinstance(data, dict) or not isinstance(data.get("features", []), list):
        raise FloorplanError(f"{path}: expected a GeoJSON FeatureCollection, found other JSON")
    found = []
    for feature in data.get("features", [data]):
        try:
            area = shape(feature["geometry"])
            properties = feature.get("properties") or {}
        except (KeyError, TypeError, ValueError, AttributeError, shapely.errors.ShapelyError):
            continue
        if area.is_empty or not np.isfinite(shapely.get_coordinates(area)).all():
            continue
        named = next((str(properties[k]) for k in _NAMING if properties.get(k)), "")
        part = kind or str(feature.get("feature_type") or "")
        if part == "opening":
            named = "opening"
        elif part == "unit" and role_of(named) != Role.WALL and named != "structure":
            named = named if named in _ROOMS else "room"
        level = next(
            (str(properties[k]) for k in ("level_id", "level") if properties.get(k) is not None), ""
        )
        found.append(_Feature(shapely.force_2d(shapely.make_valid(area)), named, level))
    return found


def _is_room(name: str) -> bool:
    return name.lower() in _ROOMS


def _chosen_level(path: Path, wanted: str, levels: tuple[str, ...]) -> str:
    if not wanted:
        return levels[0] if levels else ""
    if wanted in levels:
        return wanted
    if wanted.isdigit() and int(wanted) < len(levels):
        return levels[int(wanted)]
    raise FloorplanError(
        f"{path}: expected a storey {wanted!r}, found {', '.join(levels) or 'none'}; "
        "pass one of them"
    )


def _frame(areas: list[BaseGeometry], options: PlanOptions, collections: list[Any]) -> _Frame:
    low, high = shapely.total_bounds(np.array(areas)).reshape(2, 2)
    middle = (low + high) / 2
    told = options.metres_per_unit or METRES_PER_UNIT.get(options.unit)
    if told is not None:
        return _Frame(np.zeros(2), np.full(2, told), options.unit, "--unit", True)
    has_crs = any("crs" in data and "CRS84" not in str(data["crs"]) and "4326" not in str(data["crs"])
                  for _, data in collections)  # fmt: skip
    in_range = (np.abs([low, high]) <= (180.0, 90.0)).all()
    if options.unit == "unknown" or has_crs or not in_range or (high - low).max() > MAX_DEGREES:
        found = (
            "another system of coordinates" if has_crs
            else f"{(high - low).max():.4g} degrees of extent" if in_range
            else f"coordinates up to {np.abs([low, high]).max():.4g}"
        )  # fmt: skip
        warning = (
            f"expected longitude and latitude of a building, found {found}: the unit is unknown; "
            "give --unit or --scale"
        )
        warnings = () if options.unit == "unknown" else (warning,)
        likely_metre = float((high - low).max()) / LIKELY_SIZE_M
        return _Frame(low, np.ones(2), "unknown", "", False, warnings, likely_metre)
    latitude = np.deg2rad(middle[1])
    eccentricity_sq = _FLATTENING * (2 - _FLATTENING)
    w_sq = 1 - eccentricity_sq * np.sin(latitude) ** 2
    across = _EQUATOR_M / np.sqrt(w_sq)
    along = across * (1 - eccentricity_sq) / w_sq
    scale = np.deg2rad([across * np.cos(latitude), along])
    return _Frame(middle, scale, "degrees", "the standard of the format (degrees)", True)


def _local(area: BaseGeometry, frame: _Frame) -> BaseGeometry:
    return shapely.transform(area, lambda xy: (xy - frame.origin) * frame.scale)


def _edges(rooms: list[BaseGeometry], gaps: list[BaseGeometry], metre: float) -> np.ndarray:
    """Edges (n, 2, 2) of rooms, the room on the left, without where openings are. Rooms of maps meet
    without thickness: each side of a shared edge is a face of its own."""
    rings = [
        np.asarray(ring.coords)[:, :2]
        for part in shapely.get_parts(shapely.simplify(rooms, 0.005 * metre))
        if part.geom_type == "Polygon" and not part.is_empty
        for polygon in [orient(part)]
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    ends = np.concatenate([np.stack([r[:-1], r[1:]], axis=1) for r in rings])
    pieces, _ = shapely.get_parts(
        shapely.difference(shapely.linestrings(ends), shapely.union_all(gaps)), return_index=True
    )
    pieces = pieces[shapely.length(pieces) > 0.05 * metre]
    return np.stack(
        [shapely.get_coordinates(shapely.get_point(pieces, i)) for i in (0, -1)], axis=1
    )


def _drawing(areas: list[BaseGeometry], features: list[_Feature]) -> Drawing:
    builder = DrawingBuilder()
    for area, feature in zip(areas, features, strict=True):
        for part in shapely.get_parts(area):
            points = shapely.get_coordinates(part)
            if part.geom_type == "LineString":
                builder.add_polyline(points, np.zeros(len(points) - 1), feature.name, "")
    lines, fills, texts, layers = builder.build()
    return Drawing(lines, fills, texts, layers, 1.0, "m")


def _left_out(features: list[_Feature], used: list[_Feature]) -> tuple[str, ...]:
    n = len(features) - len(used)
    if n <= 0:
        return ()
    names = sorted({f.name or "unnamed" for f in features} - {f.name for f in used})
    return (f"{n} features that are neither walls, rooms nor openings: {', '.join(names[:5])}",)
