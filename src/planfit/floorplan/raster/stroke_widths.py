"""Strokes of a picture by their width: down to which width they are walls, and from which a pen's.

A drawing has kinds of strokes: outer walls, partitions, and what a pen drew, which are leaves and swings of
doors, panes, furniture, letters. Between two kinds few strokes are as wide. A kind is weighed as a whole, by
how thick it is beside the walls that are thicker, how much of it is long and straight, hangs on thicker walls
and has another stroke as thin a few strokes away. The weights are fitted on marked pictures
(`benchmarks/fit_stroke_widths.py`).

Strokes that run beside strokes as thin are what a pen drew, unlike walls, which have a room beyond:
furniture, windows, stairs, letters, tiles and walls drawn as two lines have such a twin over a third and more
of their length, walls only now and then, in a shaft or a pier. It holds at any resolution, as all lengths
are in thicknesses of the stroke itself.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Shaped
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import weighted_median
from planfit.floorplan.raster.line_work import opened
from planfit.floorplan.raster.picture import Mask
from planfit.floorplan.raster.trace import profiles, straight_lengths, trace_regions
from planfit.floorplan.vector.line_work import edges_of_areas
from planfit.geometry import segments

_BASE = 1.0
"""The thickest strokes that are this long in all, in sides of the drawing, are walls, if any are."""
_MOST_TWINS = 0.21
"""Of the thickest strokes: walls have 0.19 at most, lines where all is drawn with them 0.24 and
more, in the marked pictures."""
_LEAST_PX = 3.0
"""Thinner strokes may be a pen's, where none are thicker: half as many may be twins (0.01 where walls are
drawn so, 0.21 where outlines of rooms are)."""
_LONG = 6.0
"""An edge is long from so many thicknesses of the thicker walls: leaves of doors are shorter."""
_DIRT = 0.02
"""Of the length of all strokes, what is left of round and slanted ones, and specks."""
_UNSURE, _MANY = 0.5, 1.0
"""Nearer to even log odds, strokes that are together longer than so many sides of the drawing are doubted."""
FEATURES = ("log_ratio", "long", "apart", "root_twins")
"""Of a kind, what it is weighed by."""
_WEIGHTS = {"one": 3.34, "log_ratio": 2.16, "long": 2.37, "apart": -2.43, "root_twins": -4.7}
"""Log odds of walls, fitted on marked pictures (`benchmarks/fit_stroke_widths.py`)."""
_MOST_BODIES = 0.35
"""Of walls alone, see `bodies_share`."""
_NARROW = 0.25
"""Insides of walls are narrower than so much of a room's mean width: 0.3 m of 2 m."""
_TWIN_NEAR = 8.0
"""A twin is at most this many thicknesses of the stroke away."""
_ALIKE = 1.6
"""A twin is as thick as the stroke, up to this factor and a pixel."""
_REACH_PX = 120
_MOST_POINTS = 8_000
_STEP_PX = 3.0
_LEAST_EDGE_PX = 0.5


@dataclass(frozen=True)
class Kind:
    """Strokes of one width, beside those that are thicker."""

    least_px: int
    """They are no thinner."""
    thickness_px: float
    """Usual one."""
    length: float
    """Of their outlines, in sides of the drawing."""
    is_base: bool
    """Of the thickest, which the others are compared with."""
    log_ratio: float
    """Logarithm of their thickness over that of thicker ones, of the thickest over its own."""
    long: float
    """Share of the outline in long edges."""
    apart: float
    """Share of the outline of those that touch no thicker stroke."""
    twins: float
    """See `twin_share`."""

    regions: tuple[shapely.Polygon, ...]
    """Their outlines, px."""

    @property
    def features(self) -> dict[str, float]:
        """By name, see `FEATURES`."""
        return {
            "log_ratio": self.log_ratio,
            "long": self.long,
            "apart": self.apart,
            "root_twins": math.sqrt(self.twins),  # walls have none: a few tell more than many
        }

    @property
    def log_odds(self) -> float:
        """Of being walls."""
        return _WEIGHTS["one"] + sum(_WEIGHTS[name] * x for name, x in self.features.items())


@dataclass(frozen=True)
class WallWidth:
    """Down to which width strokes are walls."""

    least_px: int
    """Walls are no thinner; 0 where there are none."""
    is_all: bool
    """Nothing is thinner."""
    unsure_px: float
    """Thickness of strokes that may be walls or a pen's, whatever they are taken for; 0 where all is sure."""


def least_wall_width(mask: Mask, extent: float) -> WallWidth:
    """Down to which width the strokes of a mask are walls.

    `extent`: larger side of what is drawn, px.
    """
    total, most, best, length, unsure = 0.0, 0.0, 0, 0.0, 0.0
    is_all = True
    # Of all strokes: piers in a row face each other, the walls beside them nothing.
    of_all = twin_share(mask, trace_regions(mask, 0.0))
    for kind in kinds_of_strokes(mask, extent):
        length += kind.length
        if kind.is_base:
            is_thin = kind.thickness_px < _LEAST_PX
            twins = 2 * of_all if is_thin else min(kind.twins, of_all)
            if length >= _BASE and twins > _MOST_TWINS:
                break
        else:
            total += kind.length * kind.log_odds
            if abs(kind.log_odds) < _UNSURE and kind.length > _MANY:
                unsure = kind.thickness_px
        if total >= most:
            most, best, is_all = total, kind.least_px, True
        elif kind.length > _DIRT * length:
            is_all = False
    is_all = is_all and best > 0 and of_all <= _MOST_TWINS and bodies_share(mask) <= _MOST_BODIES
    # A slanted wall is thinner to a square that is moved over it.
    return WallWidth(math.ceil(best / math.sqrt(2)), is_all, unsure)


def kinds_of_strokes(mask: Mask, extent: float) -> Iterator[Kind]:
    """Kinds of strokes, the thickest first.

    `mask`: 1 on strokes; `extent`: larger side of what is drawn, px.
    """
    largest = int(min(max(extent / 12, 8), 60))
    widths = [2, *_valleys(_length_by_width(mask, largest))]
    thicker, outlines, thicknesses = np.zeros_like(mask), np.zeros(0), np.zeros(0)
    for least in sorted(set(widths), reverse=True):
        whole = opened(mask, least)
        own = opened(whole & (1 - cv2.dilate(thicker, np.ones((3, 3), np.uint8))), least - 1)
        regions = np.array([r for r in trace_regions(own, 0.0) if r.area > 0], dtype=object)
        if len(regions) == 0:
            continue
        outline = shapely.length(regions)
        thickness = 2 * shapely.area(regions) / outline
        own_usual = weighted_median(thickness, outline)
        is_base = bool(outlines.sum() < _BASE * extent)
        usual = own_usual if is_base else weighted_median(thicknesses, outlines)
        long = straight_lengths(regions, _LONG * usual).sum()
        yield Kind(
            least,
            own_usual,
            outline.sum() / extent,
            is_base,
            math.log(own_usual / usual),
            long / outline.sum(),
            outline[~_touch(regions, thicker)].sum() / outline.sum(),
            twin_share(own, list(regions)),
            tuple(regions),
        )
        outlines, thicknesses = np.append(outlines, outline), np.append(thicknesses, thickness)
        thicker = whole


def _length_by_width(mask: Mask, largest: int) -> Float[np.ndarray, " widths"]:
    """Length (largest + 1,) of what is 0, 1, 2 ... px thick in a mask."""
    areas = [float(mask.sum())]
    for size in range(2, largest + 2):
        areas.append(float(opened(mask, size).sum()))
        if areas[-1] == 0:
            break
    areas += [0.0] * (largest + 1 - len(areas))
    lost = -np.diff(areas)
    return np.concatenate([[0.0], lost / np.arange(1, len(lost) + 1)])


def _valleys(length: Float[np.ndarray, " widths"]) -> list[int]:
    """Least width above each gap between two kinds of strokes, where the drawing has at most half the length
    that it has at the usual width of either: past the emptiest one, or the first that is as good as empty, as
    round walls lose their form where an opening is wide."""
    below = np.maximum.accumulate(length)
    above = np.maximum.accumulate(length[::-1])[::-1]
    most = np.minimum(below, above)
    is_empty = (length <= most / 2) & (most > 0)
    label = np.cumsum(np.diff(is_empty, prepend=False))
    gaps = [np.flatnonzero(is_empty & (label == k)) for k in np.unique(label[is_empty])]
    return [int(gap[np.argmin(np.maximum(length, _DIRT * most)[gap])]) + 1 for gap in gaps]


def _touch(regions: Shaped[np.ndarray, " n"], mask: Mask) -> np.ndarray:
    """(n,) Whether a corner of each region lies on a mask or 3 px beside."""
    near = np.asarray(cv2.dilate(mask, np.ones((7, 7), np.uint8))) > 0
    corners, of = shapely.get_coordinates(regions, return_index=True)
    u, v = np.round(corners).astype(int).T
    height, width = mask.shape
    is_near = near[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
    return np.bincount(of[is_near], minlength=len(regions)) > 0


def twin_share(mask: Mask, regions: list[BaseGeometry]) -> float:
    """Share of the outline of the thinner half of all strokes that faces a stroke as thin, close by.

    Measured: 0.03 to 0.09 in pictures of walls alone (a site with and without windows at two scales, upright
    and turned by 3 deg, a villa), 0.28 to 0.8 in drawings of every style, with and without clutter, as they
    were and enlarged 2.5 times.

    `mask`: 1 on strokes; `regions`: polygons around them, pixels.
    """
    ends = edges_of_areas(regions)
    ends = ends[segments.lengths(ends) > _LEAST_EDGE_PX]
    if len(ends) == 0:
        return 1.0
    length, normals = segments.lengths(ends), -segments.left_normals(ends)
    step = max(_STEP_PX, float(length.sum()) / _MOST_POINTS)
    points, edge = segments.sample(ends, step)
    steps = np.arange(1.0, _REACH_PX + 1.0)
    inside, outside = (
        profiles(mask, points, side * normals[edge], steps, cv2.INTER_NEAREST) > 0
        for side in (-1, 1)
    )
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


def bodies_share(mask: Mask) -> float:
    """Share of the edges of all that is blank along areas as narrow as the insides of walls beside rooms.

    Of walls drawn as two lines, however thick and far apart, it is a half: each line has a room on one side
    and the inside of its wall on the other. Measured of solid walls: 0.00 (a villa) to 0.19 (a site).
    """
    blank = (1 - mask).astype(np.uint8)
    n, of, stats, _ = cv2.connectedComponentsWithStats(blank, connectivity=4)
    edges = of[(cv2.dilate(mask, np.ones((3, 3), np.uint8)) > 0) & (blank > 0)]
    length = np.bincount(edges, minlength=n).astype(float)
    width = 2 * stats[:, cv2.CC_STAT_AREA] / np.maximum(length, 1.0)
    is_blank = length > 0
    if not is_blank.any():
        return 0.0
    order = np.flatnonzero(is_blank)[np.argsort(width[is_blank])]
    # Insides of walls hold up to half of all edges: the upper quarter are those of rooms.
    total = np.cumsum(length[order])
    of_rooms = width[order][np.searchsorted(total, 0.75 * total[-1])]
    is_body = is_blank & (width < _NARROW * of_rooms)
    # What is left of the paper around a drawing may be narrow too.
    is_body &= ~np.isin(np.arange(n), np.concatenate([of[0], of[-1], of[:, 0], of[:, -1]]))
    return float(length[is_body].sum() / total[-1])


def _first(is_set: Bool[np.ndarray, "m reach"]) -> Int[np.ndarray, " m"]:
    """Pixels to the first that is set; the reach where none is."""
    return np.where(is_set.any(axis=1), np.argmax(is_set, axis=1) + 1, is_set.shape[1])
