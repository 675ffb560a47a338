"""Which of the interpretations of a picture is taken.

Pictures of walls and nothing else, wall masks as sites and mapping programs give them, need none: all that is
dark is wall then, of any thickness, slanted, curved or round, and nothing is left out but specks.
"""

from dataclasses import replace

import cv2
import numpy as np
import shapely
from jaxtyping import Float, UInt8
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import weighted_median
from planfit.floorplan.raster.candidates import (
    INK,
    Candidate,
    WallStyle,
    are_patchy,
    find_candidates,
    find_extent,
)
from planfit.floorplan.raster.ink import ink_share, stroke_length
from planfit.floorplan.raster.interpretation import Interpretation, interpret
from planfit.floorplan.raster.line_work import opened
from planfit.floorplan.raster.mixed import LEAST_SHARE, with_other_styles
from planfit.floorplan.raster.picture import DARK
from planfit.floorplan.raster.stroke_widths import least_wall_width
from planfit.floorplan.raster.trace import straight_lengths, trace_regions

_FACTORS = {
    WallStyle.OUTLINED: 1.15,  # says more of the drawing than the other interpretations of the same walls
    WallStyle.LINES: 0.6,  # furniture and dimensions have parallel lines too
    WallStyle.CLOSED_LINES: 0.8,  # furniture is closed too, but little of it is so long and thin
}
_BASES, _LEAST_BASE = 4, 0.3
"""So many interpretations, of this share of the best one's score at least, are looked at for walls that
others have beside theirs."""
_ALL_INK = 0.95
"""Of the ink, what walls are at least where nothing else is drawn."""
_ENOUGH_INK = 0.4
"""Of the ink, what walls are at least in drawings full of furniture and words: 0.43 and more (measured)."""
_LEAST_BLACK = 0.5
"""Of the ink; the rest are the soft edges of thin walls, or pale furniture."""
_FINE_SIDE_PX, _MOST_ZOOM = 5000, 4
"""Outlines are found in a picture of about this size at least, enlarged this many times at most."""
_SPECK_PX, _SPECK = 3, 0.33
"""What is thinner and shorter than this, in pixels or in thicknesses of the usual wall, is dirt."""


def choose(
    candidates: list[Candidate], extent_px: float, ink: UInt8[np.ndarray, "h w"]
) -> Interpretation | None:
    """The best interpretation; None where there is no candidate.

    One that leaves most of the ink to furniture and words is taken only where no other has walls: a few
    parallel lines in a street are no plan of the building beside it. Where others have many walls beside
    those of the best one, the drawing has several styles, and theirs are taken too.

    Args:
        candidates: masks of what may be wall.
        extent_px: of the drawing.
        ink: 1 on everything dark.
    """
    weighed = _weighed(candidates, extent_px)
    if not weighed:
        return None

    def worth(found: Interpretation) -> float:
        score = sum(part.score for part in found.parts)
        return score * min(1.0, ink_share(found, ink) / _ENOUGH_INK) if found.walls else score

    ranked = sorted(weighed, key=worth, reverse=True)
    most = worth(ranked[0])
    bases = [found for found in ranked[:_BASES] if worth(found) >= _LEAST_BASE * most]
    mixed = max((with_other_styles(base, weighed, extent_px) for base in bases), key=worth)
    return mixed if worth(mixed) > (1.0 + LEAST_SHARE) * most else ranked[0]


def with_paler_walls(alone: Interpretation, darkness: Float[np.ndarray, "h w"]) -> Interpretation:
    """Walls that seem to be all that is drawn, with those of other styles where much of the ink is no wall.

    Args:
        alone: of everything black.
        darkness: of the picture.
    """
    ink = (darkness > DARK).astype(np.uint8)
    if ink_share(alone, ink) > _ALL_INK:
        return alone
    extent_px = find_extent(darkness)
    weighed = _weighed(find_candidates(darkness), extent_px)
    found = with_other_styles(alone, weighed, extent_px)
    # With others beside, something else was drawn after all.
    return (
        replace(found, candidate=replace(alone.candidate, style=WallStyle.BLACK))
        if found.beside
        else alone
    )


def _weighed(candidates: list[Candidate], extent_px: float) -> list[Interpretation]:
    """Interpretations, their scores by what their styles are worth."""
    found = [interpret(candidate, extent_px) for candidate in candidates]
    outlined = [
        max(alike, key=lambda one: one.score)
        for style in (WallStyle.LINES, WallStyle.OUTLINED)
        if (alike := [one for one in found if one.candidate.style.family is style and one.walls])
    ]
    return [replace(one, score=one.score * _style_factor(one, outlined)) for one in found]


def _style_factor(found: Interpretation, outlined: list[Interpretation]) -> float:
    """How much of its walls an interpretation is worth, by what else its style may come from.

    `outlined` are the best ones of walls with outlines, which may have been taken for solid walls.
    """
    candidate = found.candidate
    if candidate.style.family in (WallStyle.BLACK, WallStyle.GREY):
        return 1.0 - max((_outline_share(found, other) for other in outlined), default=0.0)
    if candidate.style is WallStyle.HATCHED:
        # Filling gaps makes walls of other things too, unless the same lines fill them everywhere.
        return 0.5 + 0.6 * candidate.hatched_share
    return _FACTORS[candidate.style]


def _outline_share(solid: Interpretation, outlined: Interpretation) -> float:
    """Share of the solid walls that are the outlines of walls drawn as two lines, or filled and outlined.

    By length: partitions may be solid beside walls with outlines, and have more ink than these.
    """
    reach = 2 * round(outlined.candidate.grow_px * 2) + 3
    beside = np.asarray(
        cv2.dilate(outlined.candidate.mask, np.ones((reach, reach), np.uint8)), dtype=np.uint8
    )
    mask = solid.candidate.mask
    share = float((mask & beside).sum()) / max(int(mask.sum()), 1)
    thin = mask & (1 - opened(mask, reach))
    length = stroke_length(mask)
    share = max(share, stroke_length(thin & beside) / max(length, 1.0))
    return min(1.0, 2 * share) if share > 0.25 else 0.0


def find_walls_alone(
    small: Float[np.ndarray, "h w"], full: Float[np.ndarray, "a b"]
) -> Interpretation | None:
    """All that is dark, as walls; None where lines of a drawing are among it.

    Args:
        small: darkness that walls are looked for in, without the frame of the sheet.
        full: the same with all its pixels, for outlines finer than those.
    """
    black = (small > INK).astype(np.uint8)
    n_dark = int((small > DARK).sum())
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
    straight = float(straight_lengths(walls, max(1.5 * usual, 6.0)).sum())
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
