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
from jaxtyping import Float, UInt8
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import weighted_median
from planfit.floorplan.raster.candidates import INK, LINE, Candidate, WallStyle, are_patchy
from planfit.floorplan.raster.interpretation import Interpretation
from planfit.floorplan.raster.line_work import opened
from planfit.floorplan.raster.stroke_widths import least_wall_width
from planfit.floorplan.raster.trace import straight_length, trace_regions

_LEAST_BLACK = 0.5
"""Of the ink; the rest are the soft edges of thin walls, or pale furniture."""
_FINE_SIDE_PX, _MOST_ZOOM = 5000, 4
"""Outlines are found in a picture of about this size at least, enlarged this many times at most."""
_SPECK_PX, _SPECK = 3, 0.33
"""What is thinner and shorter than this, in pixels or in thicknesses of the usual wall, is dirt."""


def find_walls_alone(
    small: Float[np.ndarray, "h w"], full: Float[np.ndarray, "a b"]
) -> Interpretation | None:
    """All that is dark, as walls; None where lines of a drawing are among it.

    Args:
        small: darkness that walls are looked for in, without the frame of the sheet.
        full: the same with all its pixels, for outlines finer than those.
    """
    black = (small > INK).astype(np.uint8)
    n_dark = int((small > LINE).sum())
    if opened(black, 2).sum() < _LEAST_BLACK * n_dark or are_patchy(small):
        return None
    width = least_wall_width(black, max(small.shape))
    if width.least_px == 0 or not width.is_all:
        return None
    mask = opened(black, 2)
    walls, specks = _parted(_finely(mask, full))
    if not walls:
        return None
    length = shapely.length(walls)
    thickness = 2 * shapely.area(walls) / np.maximum(length, 1e-6)
    usual = weighted_median(thickness, length)
    straight = sum(straight_length(wall, max(1.5 * usual, 6.0)) for wall in walls)
    share = straight / float(length.sum())
    candidate = Candidate(
        WallStyle.BLACK_ALONE, mask, "edge", INK, 0.0, 2.0, unsure_px=width.unsure_px
    )
    return Interpretation(candidate, tuple(walls), tuple(specks), usual, straight * share, share)


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


def _parted(regions: list[BaseGeometry]) -> tuple[list[shapely.Polygon], list[shapely.Polygon]]:
    """Walls and specks."""
    shapes = [region for region in regions if isinstance(region, shapely.Polygon)]
    if not shapes:
        return [], []
    forms = np.array(shapes, dtype=object)
    area, bounds = shapely.area(forms), shapely.bounds(forms)
    thickness = 2 * area / np.maximum(shapely.length(forms), 1e-6)
    side = (bounds[:, 2:] - bounds[:, :2]).max(axis=1)
    usual = weighted_median(thickness, area)
    is_speck = (side < max(_SPECK_PX, _SPECK * usual)) | (area < _SPECK_PX)
    walls = [shape for shape, speck in zip(shapes, is_speck, strict=True) if not speck]
    return walls, [shape for shape, speck in zip(shapes, is_speck, strict=True) if speck]
