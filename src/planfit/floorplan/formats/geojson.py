"""GeoJSON and IMDF: walls as areas or lines, or rooms whose edges are the walls; local metres."""

import json
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from planfit.errors import FloorplanError
from planfit.floorplan.formats import fingerprint_of, plans_in
from planfit.floorplan.formats.geojson_storeys import (
    Properties,
    chosen_level,
    level_names,
    told_storeys,
)
from planfit.floorplan.options import PlanOptions, choose_unit
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.drawing import DrawingBuilder, VectorDrawing
from planfit.floorplan.vector.layer_names import Role, chosen_layers, role_of, words_of
from planfit.floorplan.vector.line_work import ends_of, longest, outlines
from planfit.floorplan.vector.plan import plan_of_drawing
from planfit.floorplan.vector.regions import MAX_COORDINATE, SelfCrossings, faces_of_regions
from planfit.geometry import segments
from planfit.priors import BUILDING_USUAL_SIZE_M, WALL_FACES_APART_M

_NAMING = ("category", "feature_type", "indoor", "type", "class", "layer", "kind", "building:part")
"""Properties that say what a feature is, in the order they are asked."""
_ROOM_NAMES = """
    room unit corridor walkway office area space zone hall lobby foyer kitchen bathroom restroom
    bedroom livingroom classroom conferenceroom auditorium laboratory storage elevator stairs
    stairwell escalator nonpublic unspecified
"""
_ROOMS = frozenset(_ROOM_NAMES.split())
_OUTSIDE_NAMES = """
    building buildings gebaude gebaeude batiment edificio footprint venue level floor storey site
    parcel outline perimeter address anchor section geofence kiosk amenity road street path tree
"""
_OUTSIDE = frozenset(_OUTSIDE_NAMES.split())
"""Kinds of polygons beside rooms in files that name no room in English."""
_WIDEST_M = WALL_FACES_APART_M.high
_IMDF_PARTS = ("unit", "opening", "level", "fixture")
MAX_ARCHIVE_BYTES = 200_000_000
MAX_DEGREES = 0.1
"""Wider than 11 km is no building: the coordinates are no degrees."""
LIKELY_SIZE_M = BUILDING_USUAL_SIZE_M.value
"""Of a plan whose unit is unknown; used for tolerances alone."""
OPENING_MARGIN_M = 0.05
_EQUATOR_M, _FLATTENING = 6378137.0, 1 / 298.257223563


@dataclass(frozen=True)
class _Feature:
    area: BaseGeometry
    name: str
    properties: Properties


@dataclass(frozen=True)
class _Frame:
    """Local metres of coordinates: `(xy - origin) * scale`."""

    origin: Float[np.ndarray, "2"]
    """In the file's coordinates."""
    scale: Float[np.ndarray, "2"]
    """Metres of one unit along each axis."""
    unit: str
    unit_from: str
    is_metric: bool
    warnings: tuple[str, ...] = ()
    likely_metre: float = 1.0
    """About a metre in `(xy - origin) * scale`, for tolerances."""

    def local(self, area: BaseGeometry) -> BaseGeometry:
        """The same area in local metres."""
        return shapely.transform(area, lambda xy: (xy - self.origin) * self.scale)

    @property
    def file_from_local(self) -> Float[np.ndarray, "3 3"]:
        """From homogeneous local x-y to the file's coordinates."""
        return np.array(
            [
                [1 / self.scale[0], 0, self.origin[0]],
                [0, 1 / self.scale[1], self.origin[1]],
                [0, 0, 1],
            ]
        )


@dataclass(frozen=True)
class _Features:
    """Features of the storey that is read, by what they are."""

    all: list[_Feature]
    walls: list[_Feature]
    openings: list[_Feature]
    rooms: list[_Feature]
    level: str
    levels: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    @property
    def bounding(self) -> list[_Feature]:
        """Those that the faces come from: walls, or where there are none, rooms."""
        return self.walls or self.rooms

    @property
    def used(self) -> list[_Feature]:
        """Those that take part."""
        return [*self.walls, *self.openings, *self.rooms]


def read_geojson(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of a GeoJSON file, or of an IMDF folder or archive.

    Degrees become metres about the middle of the plan, x east and y north.

    Raises:
        FloorplanError: it is no GeoJSON, or holds neither walls nor rooms.
    """
    collections, fingerprint = _load(path)
    features = _sorted_features(path, options, collections)
    frame = _frame([f.area for f in features.bounding], options, collections)
    features = _told_by_width(features, frame)
    source = _source(features, frame, "IMDF" if len(collections) > 1 else "GeoJSON")
    areas = [frame.local(f.area) for f in features.walls]
    solid = [a for a in areas if a.geom_type.endswith("Polygon")]
    if areas and not solid:
        return _plan_of_lines(path, fingerprint, options, areas, features, frame, source)
    if solid:
        faces = faces_of_regions(
            shapely.geometrycollections(solid),
            0.005 * frame.likely_metre,
            0.03 * frame.likely_metre,
        )
        ends, normals, thickness = faces.ends, faces.normals, faces.thickness
    else:
        margin = OPENING_MARGIN_M * frame.likely_metre
        gaps: list[BaseGeometry] = [frame.local(f.area).buffer(margin) for f in features.openings]
        ends = _edges([frame.local(f.area) for f in features.rooms], gaps, frame.likely_metre)
        normals, thickness = segments.left_normals(ends), np.full(len(ends), np.nan)
    return Floorplan(
        str(path), ends, normals, np.ones(len(ends), dtype=bool), fingerprint,
        thickness=thickness, is_metric=frame.is_metric, source=source,
    )  # fmt: skip


def _sorted_features(
    path: Path, options: PlanOptions, collections: list[tuple[str, Any]]
) -> _Features:
    """Walls, openings and rooms of the storey that is asked for. What is told to be neither by the name of
    its kind is among the walls, for `_told_by_width`.

    Raises:
        FloorplanError: there is no such storey, or nothing that could bound rooms on it.
    """
    features = [f for kind, data in collections for f in _features(path, kind, data)]
    is_wall, is_room, is_opening = _kinds(path, features, options.layers)
    areas, properties = [f.area for f in features], [f.properties for f in features]
    told = told_storeys(properties, np.flatnonzero(is_wall | is_room).tolist(), areas)
    names = level_names(collections, told.order)
    level = chosen_level(path, options.storey, names, told.order)
    is_here = np.array([not each or each == level for each in told.of_feature], dtype=bool)
    walls, rooms, openings, here = (
        [features[i] for i in np.flatnonzero(is_here & mask)]
        for mask in (is_wall, is_room, is_opening, np.ones(len(features), dtype=bool))
    )
    if not walls and not rooms:
        kinds = sorted({f.name for f in here if f.name})
        raise FloorplanError(
            f"{path}: expected walls or rooms, found {len(here)} features"
            f"{' of the kinds ' if kinds else ''}{', '.join(kinds[:10])}; rooms are polygons, walls "
            "polygons or lines that are named 'wall' in their property 'category' or 'type'"
        )
    return _Features(
        here, walls, openings, rooms, names.get(level, ""), tuple(names.values()), told.warnings
    )


def _kinds(
    path: Path, features: list[_Feature], layers: tuple[str, ...]
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Which features are walls, rooms and openings: as the user says, or by the names of their kinds. Where
    no name tells a wall or a room, all polygons are rooms, in whatever language their kinds are.

    Raises:
        FloorplanError: the user names a kind that there is not.
    """
    roles = np.array([role_of(f.name) for f in features], dtype=int)
    is_polygon = np.array([f.area.geom_type.endswith("Polygon") for f in features], dtype=bool)
    is_opening = roles == Role.OPENING
    if layers:
        names = tuple(sorted({f.name for f in features}))
        chosen = dict(zip(names, chosen_layers(path, layers, names), strict=True))
        is_chosen = np.array([chosen[f.name] for f in features], dtype=bool)
        return is_chosen, np.zeros(len(features), dtype=bool), is_opening
    is_wall = roles == Role.WALL
    is_room = np.array([_is_room(f.name) for f in features], dtype=bool) & is_polygon
    if not (is_wall | is_room).any():
        is_outside = np.array([bool(words_of(f.name) & _OUTSIDE) for f in features], dtype=bool)
        is_wall = is_polygon & ~is_opening & ~is_outside
    return is_wall, is_room, is_opening


def _told_by_width(features: _Features, frame: _Frame) -> _Features:
    """Polygons of a kind whose name does not say wall are rooms where they are wider than walls; of those,
    outlines of storeys and furniture are left out."""
    unnamed = [f for f in features.walls if role_of(f.name) != Role.WALL]
    wide = [f for f in unnamed if _width_m(frame.local(f.area)) > _WIDEST_M * frame.likely_metre]
    if not wide or len(wide) < len(unnamed) / 2:
        return features
    walls = [f for f in features.walls if f.area.geom_type.endswith("LineString")]
    walls += [f for f in features.walls if role_of(f.name) == Role.WALL]
    rooms = [*features.rooms, *_without_nested(wide)]
    return replace(features, walls=walls, rooms=rooms)


def _width_m(area: BaseGeometry) -> float:
    """About the width of a long area, and half the side of a square one; 0 of lines."""
    return 2.0 * area.area / max(area.length, 1e-12)


def _without_nested(features: list[_Feature]) -> list[_Feature]:
    """Areas that neither hold others that fill more than half of them, as outlines of a storey do, nor lie in
    another, as furniture does."""
    areas = np.array([f.area for f in features], dtype=object)
    size = shapely.area(areas)
    outer, inner = shapely.STRtree(areas).query(areas, predicate="covers")
    outer, inner = outer[size[inner] < size[outer]], inner[size[inner] < size[outer]]
    is_outline = np.array(
        [shapely.union_all(areas[inner[outer == k]]).area > size[k] / 2 for k in range(len(areas))]
    )
    is_inside = np.zeros(len(areas), dtype=bool)
    is_inside[inner[~is_outline[outer]]] = True
    return [features[k] for k in np.flatnonzero(~is_outline & ~is_inside)]


def _source(features: _Features, frame: _Frame, kind: str) -> PlanSource:
    used = features.used
    taken = {id(feature) for feature in used}
    unused = [f.area for f in features.all if id(f) not in taken]
    return PlanSource(
        kind=kind,
        unit=frame.unit,
        unit_from=frame.unit_from,
        storey=features.level,
        storeys=features.levels,
        layers=tuple(sorted({f.name for f in features.bounding})),
        dropped=_left_out(features),
        warnings=(*frame.warnings, *features.warnings),
        file_from_plan=frame.file_from_local,
        drawn_lines=longest(outlines([f.area for f in used])),
        dropped_lines=longest(outlines(unused)),
    )


def _plan_of_lines(
    path: Path,
    fingerprint: str,
    options: PlanOptions,
    areas: list[BaseGeometry],
    features: _Features,
    frame: _Frame,
    source: PlanSource,
) -> Floorplan:
    """Walls that are lines, not areas, are read as line work; `areas` are theirs in local metres."""
    unit = "m" if frame.is_metric else "unknown"
    plan = plan_of_drawing(
        _drawing(areas, features.walls),
        path,
        fingerprint,
        replace(options, layers=(), storey="", metres_per_unit=None, unit=unit),
        source.kind,
        np.eye(3),
    )
    warnings = (*source.warnings, *plan.source.warnings)
    return replace(plan, source=replace(source, warnings=warnings))


def _load(path: Path) -> tuple[list[tuple[str, Any]], str]:
    """Pairs of (name of the part, parsed JSON), and a fingerprint."""
    if path.is_dir():
        parts = [path / f"{name}.geojson" for name in _IMDF_PARTS]
        parts = [part for part in parts if part.exists()]
        if not parts:
            held = plans_in(path)
            named = f"{', '.join(held[:5])}{f' and {len(held) - 5} more' if len(held) > 5 else ''}"
            raise FloorplanError(
                f"{path}: expected a file, or a folder of IMDF with unit.geojson, found a folder "
                + (
                    f"that holds {named}; give one of these"
                    if held
                    else "without a plan; give the file"
                )
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
    found, crossings = [], SelfCrossings()
    for feature in data.get("features", [data]):
        try:
            area = shape(feature["geometry"])
            properties = feature.get("properties") or {}
        except (KeyError, TypeError, ValueError, AttributeError, shapely.errors.ShapelyError):
            continue
        except OverflowError:
            continue  # a number beyond what floats hold
        if area.is_empty or not np.isfinite(shapely.get_coordinates(area)).all():
            continue
        named = next((str(properties[k]) for k in _NAMING if properties.get(k)), "")
        part = kind or str(feature.get("feature_type") or "")
        if part == "opening" or (part in _OUTSIDE and not _is_room(named)):
            named = part
        elif part == "unit" and role_of(named) != Role.WALL and named != "structure":
            named = named if named in _ROOMS else "room"
        scalars = {
            str(key): float(value) if isinstance(value, int | float) else value
            for key, value in properties.items()
            if isinstance(value, str | int | float) and value != ""
        }
        found.append(_Feature(shapely.force_2d(crossings.valid(area)), named, scalars))
    return found


def _is_room(name: str) -> bool:
    return name.lower() in _ROOMS


def _frame(areas: list[BaseGeometry], options: PlanOptions, collections: list[Any]) -> _Frame:
    low, high = shapely.total_bounds(np.array(areas)).reshape(2, 2)
    if not np.abs([low, high]).max() < MAX_COORDINATE:
        # Rings so far apart in size keep GEOS busy for ever.
        raise ValueError(f"coordinates of up to {np.abs([low, high]).max():.3g}")
    middle = (low + high) / 2
    told = choose_unit(options.unit, options.metres_per_unit)
    if told.metres is not None:
        return _Frame(np.zeros(2), np.full(2, told.metres), told.name, told.known_from, True)
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


def _edges(
    rooms: list[BaseGeometry], gaps: list[BaseGeometry], metre: float
) -> Float[np.ndarray, "n 2 2"]:
    """Edges of rooms, the room on the left, without where openings are. Rooms of maps meet
    without thickness: each side of a shared edge is a face of its own."""
    rings = [
        np.asarray(ring.coords)[:, :2]
        for part in shapely.get_parts(shapely.simplify(rooms, 0.005 * metre))
        if part.geom_type == "Polygon" and not part.is_empty
        for polygon in [orient(part)]
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    ends = np.concatenate([np.stack([r[:-1], r[1:]], axis=1) for r in rings])
    parts, _ = shapely.get_parts(
        shapely.difference(shapely.linestrings(ends), shapely.union_all(gaps)), return_index=True
    )
    parts = parts[shapely.length(parts) > 0.05 * metre]
    return ends_of(parts)


def _drawing(areas: list[BaseGeometry], features: list[_Feature]) -> VectorDrawing:
    builder = DrawingBuilder()
    for area, feature in zip(areas, features, strict=True):
        for part in shapely.get_parts(area):
            points = shapely.get_coordinates(part)
            if part.geom_type == "LineString":
                builder.add_polyline(
                    points, np.zeros(len(points) - 1, dtype=bool), feature.name, ""
                )
    return builder.build(1.0, "m")


def _left_out(features: _Features) -> tuple[str, ...]:
    n = len(features.all) - len(features.used)
    if n <= 0:
        return ()
    names = sorted({f.name or "unnamed" for f in features.all} - {f.name for f in features.used})
    return (f"{n} features that are neither walls, rooms nor openings: {', '.join(names[:5])}",)
