"""A synthetic building drawn as plans are: in a style, with the clutter of real drawings, and its truth."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, UInt8
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from drawn_plans.clutter import draw_clutter, draw_fittings
from drawn_plans.pen import Pen
from planfit.geometry import segments
from planfit.synth.building import Building
from planfit.synth.options import OUTER_WALL_M
from planfit.synth.quads import Rect

Style = Literal["black", "grey", "hatched", "double", "double filled", "poche"]

STYLES: tuple[Style, ...] = ("black", "grey", "hatched", "double", "double filled", "poche")

HATCH_M = 0.09
"""Distance between the lines of hatching, m."""


@dataclass(frozen=True)
class DrawingOptions:
    """How a building is drawn."""

    style: Style = "black"
    """Walls: solid black, solid grey, outlined and hatched, two lines, two lines filled with a light
    tone, heavy outline with a dark fill."""
    pixels_per_metre: float = 70.0
    """Scale."""
    line_px: float = 1.5
    """Width of thin lines; outlines of walls are 1.3 times as wide, heavy ones twice."""
    tone: float = 0.5
    """Darkness of grey walls, 0 (paper) to 1 (black); fills are a fraction of it."""
    is_cluttered: bool = False
    """Furniture, dimension lines, tiles, stairs, title block; else only room names, doors, windows."""
    skew_deg: float = 0.0
    """Rotation of the sheet."""
    perspective: float = 0.0
    """Shrinking of the far side, as a share of its width, as in a photograph taken at a slant."""
    shade: float = 0.0
    """Darkening from one corner of the sheet to the other, 0 to 1."""
    noise: float = 0.0
    """Standard deviation of the noise of a pixel, of 255."""
    jpeg_quality: int = 0
    """Quality of JPEG compression; 0 for none."""


@dataclass(frozen=True)
class PlanPicture:
    """A drawn picture of a plan, and the true faces in it."""

    image: UInt8[np.ndarray, "h w 3"]
    """BGR."""
    ends_uv: Float[np.ndarray, "n 2 2"]
    """True faces, jambs and ends of walls included, pixels (an integer is a pixel centre)."""
    normals_uv: Float[np.ndarray, "n 2"]
    """Out of the wall, in the axes of the picture."""
    is_wall: Bool[np.ndarray, " n"]
    """Longer than the ends of walls and the jambs of openings."""


def draw_building(
    building: Building, options: DrawingOptions, rng: np.random.Generator
) -> PlanPicture:
    """Draw a building; the same options and generator state give the same picture."""
    solid, windows = _solid_wall(building, rng)
    low, high = np.array(solid.bounds[:2]), np.array(solid.bounds[2:])
    margin_m = 2.4 if options.is_cluttered else 1.2
    scale = options.pixels_per_metre
    size = np.ceil((high - low + 2 * margin_m) * scale).astype(int)
    # The building's y goes up, the picture's v goes down.
    uv_from_building = np.array(
        [[scale, 0, (margin_m - low[0]) * scale], [0, -scale, (margin_m + high[1]) * scale]]
    )
    pen = Pen(np.full((size[1], size[0]), 255, np.uint8), uv_from_building)
    draw_fittings(pen, building, windows, options.line_px, rng)
    if options.is_cluttered:
        draw_clutter(pen, building, options.line_px, rng)
    _draw_walls(pen, solid, options)
    ends, normals = _faces(solid)
    ends = pen.to_uv(ends)
    normals = normals * (1.0, -1.0)
    image, picture_from_sheet = _photographed(pen.image, options, rng)
    ends, normals = _moved(ends, normals, picture_from_sheet)
    is_wall = segments.lengths(ends) > 0.45 * scale
    return PlanPicture(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), ends, normals, is_wall)


def _box(rect: Rect) -> BaseGeometry:
    return shapely.box(rect.x0, rect.y0, rect.x1, rect.y1)


def _solid_wall(building: Building, rng: np.random.Generator) -> tuple[BaseGeometry, list[Rect]]:
    """Walls with holes at doors and windows, and the windows."""
    layout, outer = building.layout, OUTER_WALL_M
    shell = shapely.union_all([_box(room.grown(outer)) for room in layout.rooms])
    free = [_box(room) for room in layout.rooms] + [_box(door.rect) for door in layout.doors]
    solid = shapely.difference(shell, shapely.union_all(free))
    solid = shapely.union_all([solid, *(_box(column) for column in layout.columns)])
    windows = []
    for room in layout.rooms:
        for is_low in (True, False):
            y0, y1 = (room.y0 - outer, room.y0) if is_low else (room.y1, room.y1 + outer)
            width = rng.uniform(0.9, 1.6)
            if room.x1 - room.x0 < width + 1.2:
                continue
            x0 = rng.uniform(room.x0 + 0.5, room.x1 - 0.5 - width)
            window = Rect(x0, y0, x0 + width, y1)
            outside = Rect(x0, y0 - 0.1, x0 + width, y0) if is_low else Rect(
                x0, y1, x0 + width, y1 + 0.1)  # fmt: skip
            hole = _box(window)
            if shapely.covers(solid, hole) and not shapely.intersects(
                shell, shapely.buffer(_box(outside), -1e-3)
            ):
                windows.append(window)
                solid = shapely.difference(solid, hole)
    return solid, windows


def _draw_walls(pen: Pen, solid: BaseGeometry, options: DrawingOptions) -> None:
    outline_px = 1.3 * options.line_px
    if options.style == "black":
        pen.fill(solid, 1.0)
    elif options.style == "grey":
        pen.fill(solid, options.tone)
    elif options.style == "hatched":
        pen.fill(solid, 0.0)
        pen.hatch(solid, HATCH_M, options.line_px)
        pen.outline(solid, outline_px)
    elif options.style == "double":
        pen.fill(solid, 0.0)
        pen.outline(solid, outline_px)
    elif options.style == "double filled":
        pen.fill(solid, 0.4 * options.tone)
        pen.outline(solid, outline_px)
    else:
        pen.fill(solid, 1.2 * options.tone)
        pen.outline(solid, 2.0 * options.line_px)


def _faces(solid: BaseGeometry) -> tuple[Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 2"]]:
    """Edges of solid wall, m, and normals out of it."""
    rings = [
        np.asarray(ring.coords)
        for part in shapely.get_parts(shapely.simplify(solid, 1e-6))
        for polygon in [orient(part)]
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    ends = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
    return ends, -segments.left_normals(ends)


def _photographed(
    image: UInt8[np.ndarray, "h w"], options: DrawingOptions, rng: np.random.Generator
) -> tuple[UInt8[np.ndarray, "a b"], Float[np.ndarray, "3 3"]]:
    """Skewed, shaded, noisy picture, and the homography from the sheet to it."""
    h, w = image.shape
    homography = np.eye(3)
    if options.skew_deg or options.perspective:
        skew = np.deg2rad(options.skew_deg)
        c, s = np.cos(skew), np.sin(skew)
        corners = np.array([[0, 0], [w, 0], [w, h], [0, h]], dtype=float)
        moved = (corners - [w / 2, h / 2]) @ np.array([[c, s], [-s, c]])
        shrink = 1 - options.perspective * (corners[:, 1] < h / 2)
        moved[:, 0] *= shrink
        moved -= moved.min(axis=0)
        homography = cv2.getPerspectiveTransform(
            corners.astype(np.float32), moved.astype(np.float32)
        )
        size = np.ceil(moved.max(axis=0)).astype(int)
        image = cv2.warpPerspective(
            image, homography, (int(size[0]), int(size[1])), flags=cv2.INTER_AREA, borderValue=255
        )
    values = image.astype(np.float32)
    if options.shade:
        rows, columns = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
        values *= 1 - options.shade * (rows / image.shape[0] + columns / image.shape[1]) / 2
    if options.noise:
        values += rng.normal(0.0, options.noise, values.shape)
    image = np.clip(np.round(values), 0, 255).astype(np.uint8)
    if options.jpeg_quality:
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, options.jpeg_quality])[1]
        image = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))
    return image, homography


def _moved(
    ends: Float[np.ndarray, "n 2 2"],
    normals: Float[np.ndarray, "n 2"],
    homography: Float[np.ndarray, "3 3"],
) -> tuple[Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 2"]]:
    """Faces under a homography; normals stay at right angles."""
    middle = ends.mean(axis=1, keepdims=True)
    points = np.concatenate([ends, middle + normals[:, None]], axis=1).reshape(-1, 1, 2)
    moved = cv2.perspectiveTransform(points, homography).reshape(-1, 3, 2)
    result = moved[:, :2]
    left = segments.left_normals(result)
    side = np.sign(np.sum((moved[:, 2] - result.mean(axis=1)) * left, axis=1))
    return result, left * side[:, None]
