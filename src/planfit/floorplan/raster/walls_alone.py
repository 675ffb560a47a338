"""Pictures of walls and nothing else: wall masks, as sites and mapping programs give them.

All that is dark is wall then, of any thickness, slanted, curved or round: nothing has to be told apart, and
nothing is left out but specks.

Lines of a drawing run beside lines of the same pen: furniture, windows, stairs, letters, tiles and walls
drawn as two lines have another stroke as thin as they are a few strokes away, over a third and more of their
length. Walls stand alone: beyond one is a room, and only now and then, in a shaft or a pier, another wall as
thick. It holds at any resolution, as all lengths are in thicknesses of the stroke itself.
"""

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Shaped, UInt8
from shapely import Polygon, affinity
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from planfit.floorplan.faces import weighted_median
from planfit.floorplan.raster.candidates import INK, LINE, Candidate, WallStyle
from planfit.floorplan.raster.interpretation import Interpretation, straight_length
from planfit.floorplan.raster.line_work import opened
from planfit.floorplan.raster.trace import trace_regions
from planfit.geometry import segments

_MOST_TWINS, _MOST_TWINS_TINY = 0.18, 0.13
"""Between 0.09 (the most of masks) and 0.28 (the least of drawings), see `twin_share`; in tiny drawings that
were enlarged, words are blots without twins: one of 435 px has 0.17, of 290 px 0.14, masks 0.04."""
_LEAST_BLACK = 0.5
"""Of the ink; the rest are the soft edges of thin walls, or pale furniture."""
_LEAST_STRAIGHT = 0.4
"""Of the outline, in edges at least half as long again as walls are thick: circles have less."""
_FINE_SIDE_PX, _MOST_ZOOM = 5000, 4
"""Outlines are found in a picture of about this size at least, enlarged this many times at most."""
_HAIRLINE, _MANY = 0.25, 0.1
"""Strokes thinner than this share of the usual wall are lines of a pen where there are many of them, for each
metre of wall this many metres: 0.37 in a drawing with swings of doors and panes. Few are thin walls: 0.03 in
a mask with landings of stairs."""
_BROAD_PX, _NEAR, _PATCHY = 4, 0.07, 0.3
"""Of what is so broad, pixels within so much of `INK`: soft edges of black walls are 0.02 to 0.1 of it."""
_SPECK_PX, _SPECK = 3, 0.33
"""What is thinner and shorter than this, in pixels or in thicknesses of the usual wall, is dirt."""
_WORDS = 20
"""So many small bent marks are words: masks of sites have 10 at most (corners of shafts), drawings with names
of rooms 15 to 180."""
_LETTER_REACH, _LETTER_FILL, _LETTER_SLIM = 1 / 25, 0.65, 4.0
"""Letters: smaller than this share of the drawing, cover less than this of the box around them, and reach
over more than this many thicknesses of their stroke."""
_PEN = 0.62
"""Where strokes of letters are thicker than this share of the usual stroke, all is drawn with one pen: 0.67
and more in drawings of lines; 0.58 in a site plan, of whose houses other interpretations have no doubt."""
_MARK, _MARK_REACH = 0.35, 3.0
"""Beside words, what is thinner than this share of the usual wall and shorter than so many of its thicknesses
is part of them."""
_TWIN_NEAR = 8.0
"""A twin is at most this many thicknesses of the stroke away."""
_ALIKE = 1.6
"""A twin is as thick as the stroke, up to this factor and a pixel."""
_MAX_ROWS = 30_000
"""OpenCV maps at most 32,767 rows at once."""
_REACH_PX = 120
_MOST_POINTS = 8_000
_STEP_PX = 3.0
_LEAST_EDGE_PX = 0.5


def find_walls_alone(
    small: Float[np.ndarray, "h w"], full: Float[np.ndarray, "a b"]
) -> Interpretation | None:
    """All that is dark, as walls; None where lines of a drawing are among it.

    Args:
        small: darkness that walls are looked for in, without the frame of the sheet.
        full: the same with all its pixels, for outlines finer than those.
    """
    n_dark = int((small > LINE).sum())
    black = (small > INK).astype(np.uint8)
    if n_dark == 0 or opened(black, 2).sum() < _LEAST_BLACK * n_dark:
        return None
    if _are_patchy(small):
        return None
    regions = trace_regions(black, 0.0)
    most = _MOST_TWINS_TINY if small.shape[0] > full.shape[0] else _MOST_TWINS
    pen = _pen_of_words(regions, max(small.shape))
    if twin_share(black, regions) > most or pen > _PEN:
        return None
    has_words = pen > 0
    mask = opened(_without_hairlines(black, regions, has_words), 2)
    walls, specks = _parted(_finely(mask, full), has_words)
    if not walls:
        return None
    length = shapely.length(walls)
    thickness = 2 * shapely.area(walls) / np.maximum(length, 1e-6)
    usual = weighted_median(thickness, length)
    straight = sum(straight_length(wall, max(1.5 * usual, 6.0)) for wall in walls)
    share = straight / float(length.sum())
    if share < _LEAST_STRAIGHT:
        return None
    candidate = Candidate(WallStyle.BLACK_ALONE, mask, "edge", INK, 0.0, 2.0)
    return Interpretation(candidate, tuple(walls), tuple(specks), usual, straight * share, share)


def _are_patchy(darkness: Float[np.ndarray, "h w"]) -> bool:
    """Whether much of what is as broad as walls has nearly the darkness that parts black from paler: grey
    walls, which are black in patches where a JPEG made them uneven."""
    broad = opened((darkness > LINE).astype(np.uint8), _BROAD_PX) > 0
    is_near = np.abs(darkness - INK) < _NEAR
    return bool((broad & is_near).sum() > _PATCHY * max(int(broad.sum()), 1))


def _pen_of_words(regions: list[BaseGeometry], extent_px: float) -> float:
    """Thickness of the strokes of letters, as a share of the usual stroke; 0 where there are no words."""
    shapes = np.array(regions, dtype=object)
    area, thickness, side = _sizes(shapes)
    if len(shapes) == 0:
        return 0.0
    filled = area / np.maximum(shapely.area(shapely.oriented_envelope(shapes)), 1e-6)
    is_letter = (side < _LETTER_REACH * extent_px) & (filled < _LETTER_FILL)
    is_letter &= side > _LETTER_SLIM * thickness
    if is_letter.sum() < _WORDS:
        return 0.0
    return float(np.median(thickness[is_letter]) / weighted_median(thickness, area))


def _sizes(
    shapes: Shaped[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Area, thickness of the stroke, and larger side of each region."""
    area, bounds = shapely.area(shapes), shapely.bounds(shapes).reshape(-1, 4)
    thickness = 2 * area / np.maximum(shapely.length(shapes), 1e-6)
    return area, thickness, (bounds[:, 2:] - bounds[:, :2]).max(axis=1, initial=0.0)


def _without_hairlines(
    black: UInt8[np.ndarray, "h w"], regions: list[BaseGeometry], has_words: bool
) -> UInt8[np.ndarray, "h w"]:
    """The mask, which `regions` are the outlines of, without long strokes far thinner than walls are: swings
    of doors, panes of windows. Few of them stay, unless there are words, which a pen wrote too."""
    area, thickness, _ = _sizes(np.array(regions, dtype=object))
    usual = weighted_median(thickness, area) if len(regions) else 0.0
    thick = opened(black, max(round(_HAIRLINE * usual), 1))
    is_thin = (black > 0) & (np.asarray(cv2.dilate(thick, np.ones((3, 3), np.uint8))) == 0)
    n, label, boxes, _ = cv2.connectedComponentsWithStats(is_thin.astype(np.uint8))
    side = np.hypot(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT])
    is_line = (side > 2 * usual) & (np.arange(n) > 0)  # 0 is what is not thin
    if not has_words and side[is_line].sum() * usual < _MANY * black.sum():
        return black
    return np.where(is_line[label], 0, black).astype(np.uint8)


def _finely(
    mask: UInt8[np.ndarray, "h w"], darkness: Float[np.ndarray, "a b"]
) -> list[BaseGeometry]:
    """Regions of the full picture where the mask is, in pixels of the mask.

    A small picture is enlarged: outlines of walls of 3 px then follow their soft edges.
    """
    zoom = int(np.clip(_FINE_SIDE_PX / max(darkness.shape), 1, _MOST_ZOOM))
    if zoom > 1:
        darkness = cv2.resize(darkness, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_LINEAR)
    height, width = darkness.shape
    near = cv2.dilate(mask, np.ones((3, 3), np.uint8))
    near = cv2.resize(near, (width, height), interpolation=cv2.INTER_NEAREST)
    walls = (np.asarray(near) > 0) & (darkness > INK)
    regions = trace_regions(walls.astype(np.uint8), 0.0)
    across, down = mask.shape[1] / width, mask.shape[0] / height
    matrix = [across, 0, 0, down, 0.5 * across - 0.5, 0.5 * down - 0.5]
    return [affinity.affine_transform(region, matrix) for region in regions]


def _parted(
    regions: list[BaseGeometry], has_words: bool
) -> tuple[list[shapely.Polygon], list[shapely.Polygon]]:
    """Walls and specks."""
    shapes = [region for region in regions if isinstance(region, shapely.Polygon)]
    if not shapes:
        return [], []
    area, thickness, side = _sizes(np.array(shapes, dtype=object))
    usual = weighted_median(thickness, area)
    is_speck = (side < max(_SPECK_PX, _SPECK * usual)) | (area < _SPECK_PX)
    if has_words:
        is_speck |= (thickness < _MARK * usual) & (side < _MARK_REACH * usual)
    walls = [shape for shape, speck in zip(shapes, is_speck, strict=True) if not speck]
    return walls, [shape for shape, speck in zip(shapes, is_speck, strict=True) if speck]


def twin_share(mask: UInt8[np.ndarray, "h w"], regions: list[BaseGeometry]) -> float:
    """Share of the outline of the thinner half of all strokes that faces a stroke as thin, close by.

    Measured: 0.03 to 0.09 in pictures of walls alone (a site with and without windows at two scales, upright
    and turned by 3 deg, a villa), 0.28 to 0.8 in drawings of every style, with and without clutter, as they
    were and enlarged 2.5 times.

    Args:
        mask: 1 on strokes.
        regions: polygons around them, pixels.
    """
    ends = _edges(regions)
    if len(ends) == 0:
        return 1.0
    length, normals = segments.lengths(ends), -segments.left_normals(ends)
    step = max(_STEP_PX, float(length.sum()) / _MOST_POINTS)
    points, edge = segments.sample(ends, step)
    inside = _along(mask, points, -normals[edge])
    outside = _along(mask, points, normals[edge])
    inside[:, 0] = True
    outside[:, 0] = False
    thickness = _first(~inside)
    gap = _first(outside)
    beyond = ~outside & (np.arange(outside.shape[1])[None] > gap[:, None])
    faced = _first(beyond) - gap
    is_twin = (gap < _REACH_PX) & (gap <= _TWIN_NEAR * thickness)
    is_twin &= (faced <= _ALIKE * thickness + 1.0) & (faced >= thickness / _ALIKE - 1.0)
    is_stroke = length[edge] > 2.0 * thickness
    if not is_stroke.any():
        return 1.0
    is_thin = thickness <= np.median(thickness[is_stroke])
    return float(is_twin[is_thin].mean())


def _edges(regions: list[BaseGeometry]) -> Float[np.ndarray, "n 2 2"]:
    """Edges of polygons, the inside to their left."""
    parts = [np.zeros((0, 2, 2))]
    for region in regions:
        if not isinstance(region, Polygon):
            continue
        polygon = orient(region)
        for ring in (polygon.exterior, *polygon.interiors):
            points = np.asarray(ring.coords)[:, :2]
            parts.append(np.stack([points[:-1], points[1:]], axis=1))
    ends = np.concatenate(parts)
    return ends[segments.lengths(ends) > _LEAST_EDGE_PX]


def _along(
    mask: UInt8[np.ndarray, "h w"],
    points: Float[np.ndarray, "m 2"],
    directions: Float[np.ndarray, "m 2"],
) -> Bool[np.ndarray, "m reach"]:
    """Whether the mask is set 1, 2, ... px from each point."""
    steps = np.arange(1.0, _REACH_PX + 1.0)
    at = (points[:, None] + steps[None, :, None] * directions[:, None]).astype(np.float32)
    result = np.zeros(at.shape[:2], dtype=bool)
    for first in range(0, len(at), _MAX_ROWS):
        part = at[first : first + _MAX_ROWS]
        found = cv2.remap(mask, part[..., 0], part[..., 1], cv2.INTER_NEAREST, borderValue=0)
        result[first : first + _MAX_ROWS] = found > 0
    return result


def _first(is_set: Bool[np.ndarray, "m reach"]) -> Int[np.ndarray, " m"]:
    """Pixels to the first that is set; the reach where none is."""
    return np.where(is_set.any(axis=1), np.argmax(is_set, axis=1) + 1, is_set.shape[1])
