"""Where on a map a plan lies: world files beside a picture, tags of GeoTIFF; of an IFC model IfcMapConversion
(IFC4), or property sets of that name (IFC2X3)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

from planfit.errors import FloorplanError
from planfit.floorplan.options import MAX_SIZE_M, MIN_SIZE_M
from planfit.floorplan.types import Floorplan
from planfit.floorplan.vector.drawing import ABSURD
from planfit.floorplan.vector.line_work import round_origin
from planfit.geometry import segments
from planfit.units import FOOT_M

WORLD_SUFFIXES = {
    ".png": (".pgw", ".pngw"), ".jpg": (".jgw", ".jpgw"), ".jpeg": (".jgw", ".jpegw", ".jpgw"),
    ".tif": (".tfw", ".tifw"), ".tiff": (".tfw", ".tiffw", ".tifw"), ".bmp": (".bpw", ".bmpw"),
}  # fmt: skip
"""Of the world files of pictures; `.wld` belongs to any."""
_PIXEL_SCALE, _TIE_POINT, _TRANSFORMATION, _KEYS = 33550, 33922, 34264, 34735
_RASTER_TYPE, _MODEL_TYPE, _LINEAR_UNITS = 1025, 1024, 3076
_GEOGRAPHIC, _PIXEL_IS_POINT = 2, 2
_METRES = {9001: 1.0, 9002: FOOT_M, 9003: 1200 / 3937}
"""By the code of EPSG: metre, foot, US survey foot."""
_EQUATOR_M, _FLATTENING = 6378137.0, 1 / 298.257223563
"""WGS84."""
_DEGREES, MOST_DEGREES = 0.05, 0.1
"""A building spans less than 0.05 degrees of latitude, 5.6 km, and none is so small in metres; what is
said to be in degrees may span more."""
FARTHEST_M = 1.2e7
"""Coordinates of projected systems on Earth are smaller (UTM northings end at 10,000 km): beyond, they are in
another unit than claimed."""


SAME_SCALE = 0.01
"""Scales of a conversion this near to each other, as a share, differ by the projection, not by the unit."""


@dataclass(frozen=True)
class Georeference:
    """From pixels of a picture to a map."""

    map_from_pixel: Float[np.ndarray, "3 3"]
    """Integer pixels are pixel centres; map units."""
    metres_per_unit: float | None
    """None where the coordinates are degrees, or their size tells."""
    told_by: str


def find_georeference(path: Path) -> Georeference | None:
    """What a world file beside a picture says, or its own tags; None where there is neither.

    Raises:
        FloorplanError: there is one, but no numbers in it that can be used.
    """
    candidates = [path.with_suffix(s) for s in WORLD_SUFFIXES.get(path.suffix.lower(), ())]
    candidates += [path.with_suffix(".wld"), path.with_name(path.name + "w")]
    for candidate in candidates:
        for spelled in (candidate, candidate.with_suffix(candidate.suffix.upper())):
            if spelled.is_file():
                return _world_file(spelled)
    return _geotiff(path) if path.suffix.lower() in (".tif", ".tiff") else None


def _world_file(path: Path) -> Georeference:
    """Six lines: x along u, y along u, x along v, y along v, x and y of the first pixel's centre."""
    try:
        numbers = [float(word.replace(",", ".")) for word in path.read_text().split()]
        if len(numbers) != 6:
            raise ValueError(f"{len(numbers)} numbers")
    except (OSError, ValueError) as error:
        raise FloorplanError(
            f"{path}: expected a world file of six numbers, found {error}; mend it, or move it away from the "
            "picture"
        ) from error
    a, d, b, e, c, f = numbers
    found = np.array([[a, b, c], [d, e, f], [0, 0, 1]])
    return _checked(path, found, None, f"the world file {path.name}")


def _geotiff(path: Path) -> Georeference | None:
    """Tags of GeoTIFF 1.1; None where they do not place the picture."""
    try:
        with Image.open(path) as file:
            tags = dict(getattr(file, "tag_v2", {}))
    except (OSError, ValueError, SyntaxError):
        return None  # said by the reader of the picture
    keys = _geo_keys(tags.get(_KEYS, ()))
    try:
        if _TRANSFORMATION in tags:
            whole = np.array(tags[_TRANSFORMATION], dtype=float).reshape(4, 4)
            found = whole[np.ix_([0, 1, 3], [0, 1, 3])]
        elif _PIXEL_SCALE in tags and _TIE_POINT in tags:
            sx, sy = (float(v) for v in tags[_PIXEL_SCALE][:2])
            u, v, _, x, y = (float(n) for n in tags[_TIE_POINT][:5])
            found = np.array([[sx, 0, x - sx * u], [0, -sy, y + sy * v], [0, 0, 1]])
        else:
            return None
    except (ValueError, TypeError) as error:
        raise FloorplanError(
            f"{path}: expected tags of GeoTIFF that place it, found others ({error}); write it again, or "
            "give --scale"
        ) from error
    if keys.get(_RASTER_TYPE) != _PIXEL_IS_POINT:
        # The tags count from the corner of the first pixel, planfit from its centre.
        found = found @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    is_geographic = keys.get(_MODEL_TYPE) == _GEOGRAPHIC
    metres = None if is_geographic else _METRES.get(keys.get(_LINEAR_UNITS, 9001))
    return _checked(path, found, metres, "the file's GeoTIFF tags")


def _geo_keys(values: object) -> dict[int, int]:
    """Keys whose values stand in the directory itself."""
    if not isinstance(values, tuple) or len(values) < 4:
        return {}
    rows = [values[i : i + 4] for i in range(4, len(values) - 3, 4)]
    return {int(key): int(value) for key, place, _, value in rows if place == 0}


def _checked(
    path: Path, found: Float[np.ndarray, "3 3"], metres: float | None, told_by: str
) -> Georeference:
    with np.errstate(invalid="ignore"):
        determinant = float(np.linalg.det(found[:2, :2])) if np.isfinite(found).all() else 0.0
    if determinant == 0 or np.abs(found).max() > ABSURD:
        raise FloorplanError(
            f"{path}: expected numbers that place a picture on a map, found {found[:2].tolist()}; mend them, "
            "or give --scale and move the file away"
        )
    return Georeference(found, metres, told_by)


def place_on_map(floorplan: Floorplan, georeference: Georeference) -> Floorplan:
    """A plan in pixels in the axes of its map, in metres; far from the map's origin, moved by whole numbers.

    Where the size makes no building, the plan stays in pixels, with a warning.
    """
    assert floorplan.source.file_from_plan is not None
    map_from_plan = georeference.map_from_pixel @ floorplan.source.file_from_plan
    corners = segments.moved(floorplan.ends.reshape(-1, 2), map_from_plan)
    extent = np.ptp(corners, axis=0)
    metres = _metres_per_unit(georeference, corners)
    size = float((extent * metres).max())
    if not MIN_SIZE_M <= size <= MAX_SIZE_M:
        return floorplan.with_warning(
            f"{georeference.told_by} makes a building of {size:.3g} m: not used; give --scale"
        )
    origin = round_origin(corners)
    metres_from_map = np.diag([*metres, 1.0]) @ np.array(
        [[1, 0, -origin[0]], [0, 1, -origin[1]], [0, 0, 1]]
    )
    placed = _transformed(floorplan, metres_from_map @ map_from_plan)
    moved = f"; the plan frame is the map's less ({origin[0]:.10g}, {origin[1]:.10g})"
    metres_from_pixel = metres_from_map @ georeference.map_from_pixel
    pixel_m = float(np.sqrt(abs(np.linalg.det(metres_from_pixel[:2, :2]))))
    source = replace(
        placed.source,
        unit=f"px of {pixel_m:.4g} m",
        unit_from=georeference.told_by + (moved if origin.any() else ""),
        map_from_file=georeference.map_from_pixel,
    )
    return replace(placed, source=source)


def _metres_per_unit(
    georeference: Georeference, corners: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "2"]:
    """Along x and y: of degrees by the radii of the ellipsoid at the building."""
    if georeference.metres_per_unit is not None:
        return np.full(2, georeference.metres_per_unit)
    longitude, latitude = corners.mean(axis=0)
    is_on_earth = abs(latitude) <= 90 and abs(longitude) <= 180
    is_degrees = is_on_earth and np.ptp(corners, axis=0).max() < _DEGREES
    return metres_of_degrees(latitude) if is_degrees else np.ones(2)


def metres_of_degrees(latitude: float) -> Float[np.ndarray, "2"]:
    """Metres of a degree of longitude and of one of latitude, at a latitude (deg) on the ellipsoid."""
    phi = np.deg2rad(latitude)
    eccentricity_sq = _FLATTENING * (2 - _FLATTENING)
    w_sq = 1 - eccentricity_sq * np.sin(phi) ** 2
    across = _EQUATOR_M / np.sqrt(w_sq)
    along = across * (1 - eccentricity_sq) / w_sq
    return np.deg2rad([across * np.cos(phi), along])


def _transformed(floorplan: Floorplan, metres_from_plan: Float[np.ndarray, "3 3"]) -> Floorplan:
    """The same plan in metres and other axes.

    Args:
        floorplan: in a unit of its own.
        metres_from_plan: affine, with an inverse; it may mirror.
    """
    # A line keeps its normal under the inverse transpose; what is left of its length is how far apart
    # parallel lines come to lie.
    across = floorplan.normals @ np.linalg.inv(metres_from_plan[:2, :2])
    shrink = np.linalg.norm(across, axis=1)
    return floorplan.mapped(
        lambda xy: segments.moved(xy, metres_from_plan),
        np.linalg.inv(metres_from_plan),
        normals=across / shrink[:, None],
        thickness=None if floorplan.thickness is None else floorplan.thickness / shrink,
        is_metric=True,
    )


@dataclass(frozen=True)
class MapConversion:
    """Where a model's origin lies on a map, and how it is turned there."""

    east_m: float
    north_m: float
    turn_rad: float
    """Of the model's x from the easting, counter-clockwise."""
    scale: float
    """As the file has it."""
    unit_scale: float
    """Metres of one unit of the model."""
    system: str
    """Name of the projected system; empty where the file has none."""
    height_m: float = 0.0
    """Of the model's origin."""

    @property
    def words(self) -> str:
        """For people."""
        words = f"origin at ({self.east_m:.3f}, {self.north_m:.3f}) m"
        if self.system:
            words += f" in {self.system}"
        words += f", x turned by {math.degrees(self.turn_rad):.3f} deg"
        is_plain = self.scale in (1.0, self.unit_scale)
        return words + ("" if is_plain else f", lengths times {self.scale:g}")

    @property
    def map_from_file(self) -> Float[np.ndarray, "3 3"] | None:
        """From the model's coordinates, in its unit, to the map, m; None where the scale makes no sense.

        The scale of the standard turns units into those of the map; files have the projection's alone, too.
        """
        lengths = [
            by for by in (self.scale / self.unit_scale, self.scale) if abs(by - 1) < SAME_SCALE
        ]
        if not lengths:
            return None
        metres = self.unit_scale * lengths[0]
        c, s = metres * math.cos(self.turn_rad), metres * math.sin(self.turn_rad)
        return np.array([[c, -s, self.east_m], [s, c, self.north_m], [0.0, 0.0, 1.0]])


def map_conversion(model: Any, unit_scale: float) -> MapConversion | None:
    """Place of the model's origin and its turn; None where the model has none.

    Eastings and northings are in the unit of the projected system, or of the project; where the one that is
    claimed leads off the Earth, the other is meant.
    """
    conversion = _attributes(model, "IfcMapConversion")
    east, north = (_number(conversion.get(name)) for name in ("Eastings", "Northings"))
    if east is None or north is None:
        return None
    metres = 1.0 if max(abs(east), abs(north)) < FARTHEST_M else unit_scale
    x, y = _number(conversion.get("XAxisAbscissa")), _number(conversion.get("XAxisOrdinate"))
    turn = 0.0 if x is None or y is None else math.atan2(y, x)
    scale = _number(conversion.get("Scale")) or 1.0
    system = str(_attributes(model, "IfcProjectedCRS").get("Name") or "")
    height_m = (_number(conversion.get("OrthogonalHeight")) or 0.0) * metres
    return MapConversion(east * metres, north * metres, turn, scale, unit_scale, system, height_m)


def _attributes(model: Any, entity: str) -> Mapping[str, Any]:
    """Of the first entity of a kind (IfcMapConversion), else the property set of that name: of the site, the
    project or the building, ePSet_MapConversion, in any spelling. Empty where there is neither."""
    if model.schema != "IFC2X3":
        for found in model.by_type(entity):
            return found.get_info()
    import ifcopenshell.util.element

    name = entity.removeprefix("Ifc").lower()
    for kind in ("IfcSite", "IfcProject", "IfcBuilding"):
        for element in model.by_type(kind):
            try:
                sets = ifcopenshell.util.element.get_psets(element)
            except (AttributeError, RuntimeError):
                continue
            for title, values in sets.items():
                if title.lower().replace("_", "").removeprefix("epset") == name:
                    return values
    return {}


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None
