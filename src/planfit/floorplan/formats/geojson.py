"""GeoJSON and IMDF: walls as areas or lines, or rooms whose edges are the walls; local metres."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from planfit.errors import FloorplanError
from planfit.floorplan.faces import line_strings
from planfit.floorplan.formats.geojson_features import (
    OUTSIDE,
    Feature,
    LocalFrame,
    features_of,
    is_room_name,
    load_collections,
    local_frame,
)
from planfit.floorplan.formats.geojson_storeys import chosen_level, level_names, told_storeys
from planfit.floorplan.gaps import ASKEW_M
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.drawing import DrawingBuilder, VectorDrawing
from planfit.floorplan.vector.layer_names import Role, chosen_layers, role_of, words_of
from planfit.floorplan.vector.line_work import edges_of_areas, ends_of, longest, outlines
from planfit.floorplan.vector.plan import plan_of_drawing
from planfit.floorplan.vector.regions import MIN_FACE_M, TOLERANCE_M, faces_of_regions
from planfit.geometry import segments
from planfit.priors import WALL_FACES_APART_M

_WIDEST_M = WALL_FACES_APART_M.high


@dataclass(frozen=True)
class _Features:
    """Features of the storey that is read, by what they are."""

    all: list[Feature]
    walls: list[Feature]
    openings: list[Feature]
    rooms: list[Feature]
    level: str
    levels: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    @property
    def bounding(self) -> list[Feature]:
        """Those that the faces come from: walls, or where there are none, rooms."""
        return self.walls or self.rooms

    @property
    def used(self) -> list[Feature]:
        """Those that take part."""
        return [*self.walls, *self.openings, *self.rooms]


def read_geojson(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of a GeoJSON file, or of an IMDF folder or archive.

    Degrees become metres about the middle of the plan, x east and y north.

    Raises:
        FloorplanError: it is no GeoJSON, or holds neither walls nor rooms.
    """
    collections, fingerprint = load_collections(path)
    features = _sorted_features(path, options, collections)
    frame = local_frame([f.area for f in features.bounding], options, collections)
    features = _bounded(_told_by_width(features, frame), frame)
    source = _source(features, frame, "IMDF" if len(collections) > 1 else "GeoJSON")
    areas = [frame.local(f.area) for f in features.walls]
    solid = [a for a in areas if a.geom_type.endswith("Polygon")]
    if areas and not solid:
        return _plan_of_lines(path, fingerprint, options, areas, features, frame, source)
    if solid:
        faces = faces_of_regions(
            shapely.geometrycollections(solid),
            TOLERANCE_M * frame.likely_metre,
            MIN_FACE_M * frame.likely_metre,
        )
        ends, normals, thickness = faces.ends, faces.normals, faces.thickness
    else:
        margin = ASKEW_M * frame.likely_metre
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
    features = [f for kind, data in collections for f in features_of(path, kind, data)]
    is_wall, is_room, is_opening = _kinds(path, features, options.layers)
    areas, properties = [f.area for f in features], [f.properties for f in features]
    told = told_storeys(properties, np.flatnonzero(is_wall | is_room).tolist(), areas, is_wall)
    names = level_names(collections, told.order)
    level = chosen_level(path, options.storey, names, told.order)
    is_here = np.array([not each or level in each for each in told.of_feature], dtype=bool)
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
    path: Path, features: list[Feature], layers: tuple[str, ...]
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
    is_room = np.array([is_room_name(f.name) for f in features], dtype=bool) & is_polygon
    if not (is_wall | is_room).any():
        is_outside = np.array([bool(words_of(f.name) & OUTSIDE) for f in features], dtype=bool)
        is_wall = is_polygon & ~is_opening & ~is_outside
    return is_wall, is_room, is_opening


def _told_by_width(features: _Features, frame: LocalFrame) -> _Features:
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


def _bounded(features: _Features, frame: LocalFrame) -> _Features:
    """Without walls where most edges of rooms have none along them: indoor maps of OpenStreetMap draw rooms,
    and walls where no room ends."""
    if not features.walls or not features.rooms:
        return features
    edges = shapely.boundary(shapely.union_all([frame.local(f.area) for f in features.rooms]))
    walls = shapely.union_all([frame.local(f.area) for f in features.walls])
    along = shapely.intersection(edges, walls.buffer(_WIDEST_M * frame.likely_metre))
    if along.length >= edges.length - along.length:
        return features
    share = along.length / edges.length
    warning = (
        f"walls are drawn along {share:.0%} of the edges of rooms: rooms bound the plan, and what is named "
        "wall is left out; give --layer with the kinds that are to be read"
    )
    return replace(features, walls=[], warnings=(*features.warnings, warning))


def _width_m(area: BaseGeometry) -> float:
    """About the width of a long area, and half the side of a square one; 0 of lines."""
    return 2.0 * area.area / max(area.length, 1e-12)


def _without_nested(features: list[Feature]) -> list[Feature]:
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


def _source(features: _Features, frame: LocalFrame, kind: str) -> PlanSource:
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
    frame: LocalFrame,
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


def _edges(
    rooms: list[BaseGeometry], gaps: list[BaseGeometry], metre: float
) -> Float[np.ndarray, "n 2 2"]:
    """Edges of rooms, the room on the left, without where openings are. Rooms of maps meet
    without thickness: each side of a shared edge is a face of its own."""
    ends = edges_of_areas(list(shapely.simplify(rooms, TOLERANCE_M * metre)))
    parts = shapely.get_parts(shapely.difference(line_strings(ends), shapely.union_all(gaps)))
    return ends_of(parts[shapely.length(parts) > 0.05 * metre])


def _drawing(areas: list[BaseGeometry], features: list[Feature]) -> VectorDrawing:
    builder = DrawingBuilder()
    for area, feature in zip(areas, features, strict=True):
        for part in shapely.get_parts(area):
            if part.geom_type == "LineString":
                points = shapely.get_coordinates(part)
                is_curved = np.zeros(len(points) - 1, dtype=bool)
                builder.add_polyline(points, is_curved, feature.name, "")
    return builder.build(1.0, "m")


def _left_out(features: _Features) -> tuple[str, ...]:
    n = len(features.all) - len(features.used)
    if n <= 0:
        return ()
    names = sorted({f.name or "unnamed" for f in features.all} - {f.name for f in features.used})
    return (f"{n} features that bound nothing: {', '.join(names[:5])}",)
