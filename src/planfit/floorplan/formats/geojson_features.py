"""Features of GeoJSON and IMDF: areas with what they are called, and the local metres that they lie in."""

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from planfit.errors import FloorplanError
from planfit.floorplan.formats import MAX_UNPACKED_BYTES, fingerprint_of, plans_in
from planfit.floorplan.formats.geojson_storeys import Properties
from planfit.floorplan.formats.georeference import MOST_DEGREES, metres_of_degrees
from planfit.floorplan.options import PlanOptions, choose_unit
from planfit.floorplan.vector.layer_names import Role, role_of
from planfit.floorplan.vector.regions import MAX_COORDINATE, SelfCrossings
from planfit.priors import BUILDING_USUAL_SIZE_M

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
OUTSIDE = frozenset(_OUTSIDE_NAMES.split())
"""Kinds of polygons beside rooms in files that name no room in English."""
_IMDF_PARTS = ("unit", "opening", "level", "fixture")
_LIKELY_SIZE_M = BUILDING_USUAL_SIZE_M.value
"""Of a plan whose unit is unknown; used for tolerances alone."""


@dataclass(frozen=True)
class Feature:
    """A feature of the file."""

    area: BaseGeometry
    """Or line, in the file's coordinates."""
    name: str
    """Of its kind."""
    properties: Properties


@dataclass(frozen=True)
class LocalFrame:
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
        (x, y), (across, up) = self.origin, 1 / self.scale
        return np.array([[across, 0, x], [0, up, y], [0, 0, 1]])


def load_collections(path: Path) -> tuple[list[tuple[str, Any]], str]:
    """Pairs of (name of the part of IMDF, parsed JSON), and a fingerprint.

    Raises:
        FloorplanError: it is neither GeoJSON nor an IMDF folder or archive.
    """
    if path.is_dir():
        parts = [path / f"{name}.geojson" for name in _IMDF_PARTS]
        parts = [part for part in parts if part.exists()]
        if not parts:
            held = plans_in(path)
            more = f" and {len(held) - 5} more" if len(held) > 5 else ""
            named = f"that holds {', '.join(held[:5])}{more}; give one of these"
            raise FloorplanError(
                f"{path}: expected a file, or a folder of IMDF with unit.geojson, found a folder "
                f"{named if held else 'without a plan; give the file'}"
            )
        loaded = [(part.stem, _parsed(part, part.read_bytes())) for part in parts]
        return loaded, "-".join(fingerprint_of(part) for part in parts)
    if path.suffix.lower() != ".zip":
        return [("", _parsed(path, path.read_bytes()))], fingerprint_of(path)
    try:
        with zipfile.ZipFile(path) as archive:
            infos = [i for i in archive.infolist() if Path(i.filename).stem in _IMDF_PARTS]
            infos = [i for i in infos if i.filename.lower().endswith((".geojson", ".json"))]
            if sum(i.file_size for i in infos) > MAX_UNPACKED_BYTES:
                raise FloorplanError(
                    f"{path}: expected an IMDF archive of at most {MAX_UNPACKED_BYTES // 10**6} MB, "
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


def features_of(path: Path, kind: str, data: Any) -> list[Feature]:
    """Features that have a place, with the names of their kinds.

    Raises:
        FloorplanError: the JSON is no collection of features.
    """
    if not isinstance(data, dict) or not isinstance(data.get("features", []), list):
        raise FloorplanError(f"{path}: expected a GeoJSON FeatureCollection, found other JSON")
    found, crossings = [], SelfCrossings()
    naming = _naming_property(data.get("features", [data]))
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
        named = next((str(properties[k]) for k in (naming, *_NAMING) if properties.get(k)), "")
        part = kind or str(feature.get("feature_type") or "")
        if part == "opening" or (part in OUTSIDE and not is_room_name(named)):
            named = part
        elif part == "unit" and role_of(named) != Role.WALL and named != "structure":
            named = named if named in _ROOMS else "room"
        scalars = {
            str(key): float(value) if isinstance(value, int | float) else value
            for key, value in properties.items()
            if isinstance(value, str | int | float) and value != "" and key != naming
        }
        found.append(Feature(shapely.force_2d(crossings.valid(area)), named, scalars))
    return found


def _naming_property(features: list[Any]) -> str:
    """The property that says what features are where none of the usual ones does: its values name walls, and
    rooms or openings beside them. The most telling one; empty where there is none."""
    walls: dict[str, int] = {}
    others: dict[str, int] = {}
    for feature in features:
        properties = feature.get("properties") if isinstance(feature, dict) else None
        for key, value in (properties if isinstance(properties, dict) else {}).items():
            if isinstance(value, str) and role_of(value) == Role.WALL:
                walls[key] = walls.get(key, 0) + 1
            elif isinstance(value, str) and (is_room_name(value) or role_of(value) == Role.OPENING):
                others[key] = others.get(key, 0) + 1
    telling = [key for key in walls if key in others]
    if any(key in _NAMING for key in walls):
        return ""
    return max(telling, key=lambda key: walls[key] + others[key], default="")


def is_room_name(name: str) -> bool:
    """Whether a kind is a room's, in English."""
    return name.lower() in _ROOMS


def local_frame(
    areas: list[BaseGeometry], options: PlanOptions, collections: list[Any]
) -> LocalFrame:
    """Local metres about areas in degrees, or in a unit that the user or nobody tells."""
    low, high = shapely.total_bounds(np.array(areas)).reshape(2, 2)
    if not np.abs([low, high]).max() < MAX_COORDINATE:
        # Rings so far apart in size keep GEOS busy for ever.
        raise ValueError(f"coordinates of up to {np.abs([low, high]).max():.3g}")
    middle = (low + high) / 2
    told = choose_unit(options.unit, options.metres_per_unit)
    if told.metres is not None:
        return LocalFrame(np.zeros(2), np.full(2, told.metres), told.name, told.known_from, True)
    has_crs = any("crs" in data and "CRS84" not in str(data["crs"]) and "4326" not in str(data["crs"])
                  for _, data in collections)  # fmt: skip
    in_range = (np.abs([low, high]) <= (180.0, 90.0)).all()
    if options.unit == "unknown" or has_crs or not in_range or (high - low).max() > MOST_DEGREES:
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
        likely_metre = float((high - low).max()) / _LIKELY_SIZE_M
        return LocalFrame(low, np.ones(2), "unknown", "", False, warnings, likely_metre)
    scale = metres_of_degrees(middle[1])
    return LocalFrame(middle, scale, "degrees", "the standard of the format (degrees)", True)


def _parsed(path: Path, data: bytes) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise FloorplanError(
            f"{path}: expected GeoJSON, found no JSON ({error}); export it again"
        ) from error
