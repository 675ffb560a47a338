"""Where on a map a picture lies: world files beside it, and the tags of GeoTIFF."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from planfit.errors import FloorplanError
from planfit.floorplan.options import MAX_SIZE_M, MIN_SIZE_M
from planfit.floorplan.types import Floorplan
from planfit.floorplan.vector.drawing import ABSURD
from planfit.geometry import segments

WORLD_SUFFIXES = {
    ".png": (".pgw", ".pngw"), ".jpg": (".jgw", ".jpgw"), ".jpeg": (".jgw", ".jpegw", ".jpgw"),
    ".tif": (".tfw", ".tifw"), ".tiff": (".tfw", ".tiffw", ".tifw"), ".bmp": (".bpw", ".bmpw"),
}  # fmt: skip
"""Of the world files of pictures; `.wld` belongs to any."""
_PIXEL_SCALE, _TIE_POINT, _TRANSFORMATION, _KEYS = 33550, 33922, 34264, 34735
_RASTER_TYPE, _MODEL_TYPE, _LINEAR_UNITS = 1025, 1024, 3076
_GEOGRAPHIC, _PIXEL_IS_POINT = 2, 2
_METRES = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}
"""By the code of EPSG: metre, foot, US survey foot."""
_GEODETIC_A, _GEODETIC_E2 = 6378137.0, 0.00669437999014
"""WGS84."""
_DEGREES = 0.05
"""A building spans less than 0.05 degrees of latitude, 5.6 km, and none is so small in metres."""


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
        found = next(
            (
                c
                for c in (candidate, candidate.with_suffix(candidate.suffix.upper()))
                if c.is_file()
            ),
            None,
        )
        if found is not None:
            return _world_file(found)
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
    return _checked(
        path, np.array([[a, b, c], [d, e, f], [0, 0, 1]]), None, f"the world file {path.name}"
    )


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
    low, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    metres = _metres_per_unit(georeference, corners)
    size = float((extent * metres).max())
    if not MIN_SIZE_M <= size <= MAX_SIZE_M:
        return floorplan.with_warning(
            f"{georeference.told_by} makes a building of {size:.3g} m: not used; give --scale"
        )
    is_far = np.abs(low).max() > 20 * extent.max()
    step = 10.0 ** np.floor(np.log10(extent.max()))
    origin = np.floor(low / step) * step if is_far else np.zeros(2)
    metres_from_map = np.diag([*metres, 1.0]) @ np.array(
        [[1, 0, -origin[0]], [0, 1, -origin[1]], [0, 0, 1]]
    )
    placed = _transformed(floorplan, metres_from_map @ map_from_plan)
    where = (
        f"; the plan frame is the map's less ({origin[0]:.10g}, {origin[1]:.10g})" if is_far else ""
    )
    pixel_m = float(
        np.sqrt(abs(np.linalg.det((metres_from_map @ georeference.map_from_pixel)[:2, :2])))
    )
    source = replace(
        placed.source,
        unit=f"px of {pixel_m:.4g} m",
        unit_from=georeference.told_by + where,
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
    is_degrees = (
        np.ptp(corners, axis=0).max() < _DEGREES and abs(latitude) <= 90 and abs(longitude) <= 180
    )
    if not is_degrees:
        return np.ones(2)
    phi = np.deg2rad(latitude)
    w = np.sqrt(1 - _GEODETIC_E2 * np.sin(phi) ** 2)
    radii = np.array([np.cos(phi) / w, (1 - _GEODETIC_E2) / w**3]) * _GEODETIC_A
    return np.deg2rad(radii)


def _transformed(floorplan: Floorplan, metres_from_plan: Float[np.ndarray, "3 3"]) -> Floorplan:
    """The same plan in metres and other axes.

    Args:
        floorplan: in a unit of its own.
        metres_from_plan: affine, with an inverse; it may mirror.
    """
    linear, translation = metres_from_plan[:2, :2], metres_from_plan[:2, 2]
    # A line keeps its normal under the inverse transpose; what is left of its length is how far apart
    # parallel lines come to lie.
    across = floorplan.normals @ np.linalg.inv(linear)
    shrink = np.linalg.norm(across, axis=1)
    source = floorplan.source
    if source.file_from_plan is not None:
        source = replace(
            source, file_from_plan=source.file_from_plan @ np.linalg.inv(metres_from_plan)
        )
    openings = floorplan.openings
    return replace(
        floorplan,
        ends=floorplan.ends @ linear.T + translation,
        normals=across / shrink[:, None],
        thickness=None if floorplan.thickness is None else floorplan.thickness / shrink,
        openings=None if openings is None else openings @ linear.T + translation,
        is_metric=True,
        source=source,
    )
