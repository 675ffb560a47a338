"""From a picture of a plan to its wall faces."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import shapely

from planfit.errors import FloorplanError
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.raster.candidates import LINE, Candidate, find_candidates, find_extent
from planfit.floorplan.raster.choose import Reading, choose, straight_length, trace
from planfit.floorplan.raster.frame import without_frame
from planfit.floorplan.raster.openings import find_openings
from planfit.floorplan.raster.picture import Upright, load_picture, make_darkness, make_upright
from planfit.floorplan.raster.storeys import find_storeys, storey_words
from planfit.floorplan.raster.trace import settle_faces
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.units import choose_unit
from planfit.floorplan.vector.regions import RegionFaces, faces_of_regions
from planfit.geometry import segments

WORK_SIDE_PX = 2000
"""Walls are found in a picture of about this size and their faces placed in the full one. Pictures up to half
as large again are not shrunk: shrinking by a little blurs thin lines the most."""
_LEAST_STRAIGHT = 0.35
_LEAST_LONG_SHARE = 0.25
_DOUBTFUL_STRAIGHT = 0.6


def read_raster(path: Path, options: PlanOptions) -> Floorplan:
    """Read a PNG, JPEG or TIFF picture of a plan.

    Plan x-y are the picture's (u, -v): pixels, unless the options tell the scale.

    Raises:
        FloorplanError: no picture, too large or too small, blank, a photograph, or without walls.
    """
    fingerprint = hashlib.sha256(path.read_bytes())
    if options.wall_mask is not None:
        if not options.wall_mask.exists():
            raise FloorplanError(
                f"{options.wall_mask}: expected a wall mask, found nothing; check the path"
            )
        fingerprint.update(options.wall_mask.read_bytes())
    image = load_picture(path)
    return read_picture(image, str(path), fingerprint.hexdigest()[:16], options, "raster picture")


def read_picture(
    image_bgr: np.ndarray, name: str, fingerprint: str, options: PlanOptions, kind: str
) -> Floorplan:
    """Read a picture (h, w, 3) uint8 of a plan; see `read_raster`.

    Args:
        image_bgr: integer pixels are pixel centres.
        name: of the file, for messages.
        fingerprint: of the file.
        options: unit, scale, storey and wall mask are used.
        kind: of the file, in words.
    """
    mask = None if options.wall_mask is None else _load_mask(options.wall_mask, image_bgr, name)
    darkness = make_darkness(image_bgr, name, is_judged=mask is None)
    upright = make_upright(darkness if mask is None else mask.astype(np.float32))
    if mask is not None:
        upright = _same_turn(darkness, upright)
    side = max(upright.darkness.shape)
    shrink = side / WORK_SIDE_PX if side > 1.5 * WORK_SIDE_PX else 1.0
    small = _shrunk(upright.darkness, shrink)
    if mask is None:
        small = without_frame(small)
        reading = choose(find_candidates(small), find_extent(small))
    else:
        turned = _shrunk(_turned(mask.astype(np.float32), upright), shrink)
        given = Candidate("as given", (turned > 0.5).astype(np.uint8), "mask", 0.5, 0.0, 1.0)
        reading = trace(given, float(max(small.shape)), is_given=True)
    _check(name, reading, small.shape)
    assert reading is not None
    found = _faces(reading, upright, shrink)
    return _to_floorplan(found, reading, upright, (name, fingerprint, kind), options, shrink)


@dataclass(frozen=True)
class _Found:
    """Faces in pixels of the upright picture."""

    faces: RegionFaces
    storey: np.ndarray
    """(n,) of each face."""
    storeys: tuple[str, ...]


def _check(name: str, reading: Reading | None, shape: tuple[int, ...]) -> None:
    """Refuse what is no plan."""
    found = ""
    if reading is None or not reading.walls:
        found = "none"
    else:
        length = float(sum(shapely.length(np.array(reading.walls, dtype=object))))
        if reading.candidate.edge != "mask" and reading.straight_share < _LEAST_STRAIGHT:
            found = "shapes without straight sides"
        elif reading.candidate.edge != "mask" and _long_share(reading) < _LEAST_LONG_SHARE:
            found = "short strokes, as of letters or curves"
        elif length < 0.5 * max(shape):
            found = f"{length:.0f} px of them, too little for a building"
    if found:
        raise FloorplanError(
            f"{name}: expected walls (solid, grey, hatched or double lines), found {found}; "
            "is it a floorplan? If it is, give your own picture of its walls with --wall-mask"
        )


def _long_share(reading: Reading) -> float:
    """Share of the outline of the walls in edges several times as long as walls are thick."""
    long = sum(straight_length(wall, 5.0 * reading.thickness_px) for wall in reading.walls)
    return long / sum(wall.length for wall in reading.walls)


def _load_mask(path: Path, image: np.ndarray, name: str) -> np.ndarray:
    """(h, w) uint8, 1 where the user's picture is white."""
    if not path.exists():
        raise FloorplanError(f"{path}: expected a wall mask, found nothing; check the path")
    mask = load_picture(path).mean(axis=2) > 127
    if mask.shape != image.shape[:2]:
        h, w = image.shape[:2]
        raise FloorplanError(
            f"{path}: expected a wall mask of the size of {name}, {w} x {h} px, "
            f"found {mask.shape[1]} x {mask.shape[0]}; resize it"
        )
    if not mask.any() or mask.all():
        raise FloorplanError(
            f"{path}: expected white where there is wall and black elsewhere, found one tone"
        )
    return mask.astype(np.uint8)


def _same_turn(darkness: np.ndarray, upright: Upright) -> Upright:
    return Upright(_turned(darkness, upright), upright.upright_from_picture, upright.skew_deg)


def _turned(values: np.ndarray, upright: Upright) -> np.ndarray:
    """A picture turned as the upright one was."""
    if upright.skew_deg == 0.0:
        return values
    h, w = upright.darkness.shape
    return cv2.warpAffine(values, upright.upright_from_picture, (w, h), flags=cv2.INTER_LINEAR)


def _shrunk(values: np.ndarray, shrink: float) -> np.ndarray:
    if shrink == 1.0:
        return values
    return cv2.resize(values, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)


def _faces(reading: Reading, upright: Upright, shrink: float) -> _Found:
    """Faces of each storey, where the ink of the full picture has them."""
    walls = np.array(reading.walls, dtype=object)
    least_px = max(0.5 * reading.thickness_px, 5.0)
    faces = faces_of_regions(shapely.GeometryCollection(list(walls)), 0.6, least_px)
    openings = find_openings(faces.ends, faces.normals, faces.thickness)
    small = _shrunk(upright.darkness, shrink)
    storey_of = find_storeys(walls, reading.thickness_px, openings, small > LINE)
    inside = faces.ends.mean(axis=1) - 0.5 * faces.normals
    storey = storey_of[shapely.STRtree(walls).nearest(shapely.points(inside))]
    size = np.array(upright.darkness.shape[::-1]) / np.array(small.shape[::-1])
    faces = RegionFaces((faces.ends + 0.5) * size - 0.5, faces.normals, faces.thickness * shrink)
    candidate = reading.candidate
    if candidate.edge != "mask" and len(faces.ends):
        faces = settle_faces(
            faces,
            upright.darkness,
            candidate.level,
            candidate.edge == "stroke",
            max(1.5, 1.2 * shrink, 0.75 * abs(candidate.grow_px) * shrink),
        )
    return _Found(faces, storey, storey_words(walls, storey_of))


def _to_floorplan(
    found: _Found,
    reading: Reading,
    upright: Upright,
    origin: tuple[str, str, str],
    options: PlanOptions,
    shrink: float,
) -> Floorplan:
    name, fingerprint, kind = origin
    kept = np.ones(len(found.faces.ends), dtype=bool)
    warnings = []
    n_storeys = len(found.storeys)
    if options.storey:
        kept = found.storey == _storey_number(name, options.storey, found.storeys)
    elif n_storeys > 1:
        words = ", ".join(f"{k} ({where})" for k, where in enumerate(found.storeys))
        warnings.append(
            f"{n_storeys} plans on one sheet, probably storeys: {words}; all are kept, "
            "choose one with --storey 0 and so on"
        )
    if reading.candidate.edge != "mask" and reading.straight_share < _DOUBTFUL_STRAIGHT:
        warnings.append(
            "much that looks like wall was left out, because its form is none: compare the overlay "
            "(-o FILE.png) with the drawing"
        )
    ends, normals = found.faces.ends[kept], found.faces.normals[kept]
    thickness = found.faces.thickness[kept]
    openings = find_openings(ends, normals, thickness)
    if abs(upright.skew_deg) >= 0.1:
        warnings.append(
            f"the sheet is turned by {upright.skew_deg:.1f} deg; faces are in its own axes"
        )
    picture_from_upright = cv2.invertAffineTransform(upright.upright_from_picture)
    unit = choose_unit(options, None, "")
    mirror = np.array([1.0, -1.0])
    plan = Floorplan(
        name,
        _moved(ends, picture_from_upright) * mirror,
        normals @ picture_from_upright[:, :2].T * mirror,
        np.ones(len(ends), dtype=bool),
        fingerprint,
        thickness,
        _moved(openings, picture_from_upright) * mirror,
        is_metric=False,
        source=PlanSource(
            kind=f"{kind}, walls {reading.candidate.style}",
            unit="px" if unit.metres is None else f"px of {unit.metres:g} m",
            unit_from=unit.known_from or "unknown: a picture does not tell, and texts are not read",
            storey=options.storey,
            storeys=tuple(f"{k}: {w}" for k, w in enumerate(found.storeys))
            if n_storeys > 1
            else (),
            dropped=_dropped_words(reading),
            warnings=tuple(warnings),
            file_from_plan=np.diag([1.0, -1.0, 1.0]),
            dropped_lines=_moved(_outlines(reading, shrink), picture_from_upright),
        ),
    )
    return plan if unit.metres is None else plan.scaled(unit.metres)


def _storey_number(name: str, asked: str, storeys: tuple[str, ...]) -> int:
    known = [str(k) for k in range(len(storeys))]
    if asked in known:
        return int(asked)
    if asked in storeys and storeys.count(asked) == 1:
        return storeys.index(asked)
    listed = ", ".join(f"{k} ({where})" for k, where in enumerate(storeys))
    raise FloorplanError(
        f"{name}: expected a storey of {listed}, found {asked!r}; choose one of these"
    )


def _dropped_words(reading: Reading) -> tuple[str, ...]:
    if not reading.dropped:
        return ()
    return (
        f"{len(reading.dropped)} marks of the tone and thickness of walls, but not of their form "
        "(letters, arrows, furniture, frames)",
    )


def _outlines(reading: Reading, shrink: float) -> np.ndarray:
    """Edges (k, 2, 2) of what was dropped, px of the upright picture."""
    parts = [np.zeros((0, 2, 2))]
    for region in reading.dropped:
        for ring in (region.exterior, *region.interiors):
            points = (np.asarray(ring.coords) + 0.5) * shrink - 0.5
            parts.append(np.stack([points[:-1], points[1:]], axis=1))
    edges = np.concatenate(parts)
    return edges[segments.lengths(edges) > 0]


def _moved(ends: np.ndarray, affine: np.ndarray) -> np.ndarray:
    return ends @ affine[:, :2].T + affine[:, 2]
