"""Which of the interpretations of a picture is taken, or which of them where walls have several styles.

Pictures of walls and nothing else, wall masks as sites and mapping programs give them, need none: all that is
dark is wall then, of any thickness, slanted, curved or round, and nothing is left out but specks.

Each interpretation knows one style. What another one has beside its walls is wall too where it hangs together
with them as walls do: it ends at them, as partitions do. Furniture stands along walls or free, and windows
lie in their gaps.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Shaped
from scipy.spatial import cKDTree
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.elements import ELONGATED
from planfit.floorplan.faces import weighted_median
from planfit.floorplan.gaps import find_openings
from planfit.floorplan.raster.candidates import (
    INK,
    Candidate,
    WallStyle,
    are_patchy,
    find_candidates,
    find_extent,
)
from planfit.floorplan.raster.ink import ink_share, stroke_length
from planfit.floorplan.raster.interpretation import (
    STRAIGHT,
    Interpretation,
    are_patterns,
    interpret,
    measure_forms,
    worth_of_walls,
)
from planfit.floorplan.raster.line_work import opened
from planfit.floorplan.raster.picture import DARK, Mask
from planfit.floorplan.raster.stroke_widths import least_wall_width
from planfit.floorplan.raster.trace import straight_lengths, trace_regions
from planfit.floorplan.vector.regions import faces_of_regions

_FACTORS = {
    WallStyle.OUTLINED: 1.15,  # says more of the drawing than the other interpretations of the same walls
    WallStyle.LINES: 0.6,  # furniture and dimensions have parallel lines too
    WallStyle.CLOSED_LINES: 0.8,  # furniture is closed too, but little of it is so long and thin
}
_BASES, _LEAST_BASE = 4, 0.3
"""So many interpretations, of this share of the best one's score at least, are looked at for walls that
others have beside theirs."""
ALL_INK = 0.95
"""Of the ink, what walls are at least where nothing else is drawn."""
_ENOUGH_INK = 0.4
"""Of the ink, what walls are at least in drawings full of furniture and words: 0.43 and more (measured)."""
_FINE_SIDE_PX, _MOST_ZOOM = 5000, 4
"""Outlines are found in a picture of about this size at least, enlarged this many times at most."""
_SPECK_PX, _SPECK = 3, 0.33
"""What is thinner and shorter than this, in pixels or in thicknesses of the usual wall, is dirt."""
_TOUCHING_PX = 3.0
"""What lies nearer touches."""
_MOST_CONTACT = 0.3
"""Of its outline, what of a wall that ends at others touches them; of furniture along a wall, a third."""

_ALIKE = 2.0
"""Walls of one style are up to so many times as thick as most of them, or as thin: what differs more is
furniture, unless it is solid black beside paler walls, as the flat that is sold is among its neighbours."""
LEAST_SHARE = 0.15
"""Of the score of one style, what walls of others add at least: less is furniture more often than wall."""
_MOST_STYLES = 3
"""In one drawing."""


def choose(candidates: list[Candidate], extent_px: float, ink: Mask) -> Interpretation | None:
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

    `alone`: of everything black; `darkness`: of the picture.
    """
    ink = (darkness > DARK).astype(np.uint8)
    if ink_share(alone, ink) > ALL_INK:
        return alone
    extent_px = find_extent(darkness)
    weighed = _weighed(find_candidates(darkness), extent_px)
    found = with_other_styles(alone, weighed, extent_px)
    if not found.beside:
        return alone
    # With others beside, something else was drawn after all.
    return replace(found, candidate=replace(alone.candidate, style=WallStyle.BLACK))


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
    kernel = np.ones((reach, reach), np.uint8)
    beside = np.asarray(cv2.dilate(outlined.candidate.mask, kernel), dtype=np.uint8)
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

    `small`: darkness that walls are looked for in, without the frame of the sheet; `full`: the same with all
    its pixels, for outlines finer than those.
    """
    black = (small > INK).astype(np.uint8)
    n_dark = int((small > DARK).sum())
    # What is not black are the soft edges of thin walls, or pale furniture.
    if opened(black, 2).sum() < n_dark / 2 or are_patchy(small):
        return None
    width = least_wall_width(black, max(small.shape))
    if width.least_px == 0 or not width.is_all:
        return None
    return _alone(opened(black, 2), full, width.unsure_px)


def or_lines_alone(
    chosen: Interpretation | None, ink: Mask, full: Float[np.ndarray, "a b"]
) -> Interpretation | None:
    """An interpretation, or walls drawn by single lines where it leaves most of the ink and they do not.

    `ink` is as for `choose`, `full` as for `find_walls_alone`.
    """
    if chosen is not None and chosen.walls and ink_share(chosen, ink) > _ENOUGH_INK:
        return chosen
    found = _alone(ink, full, 0.0)
    if found is None:
        return chosen
    regions = np.array(found.walls, dtype=object)
    forms = measure_forms(regions)
    is_line = forms.reach > ELONGATED * forms.thickness
    is_line &= forms.straight > STRAIGHT * forms.outline
    found = replace(
        found,
        candidate=replace(found.candidate, style=WallStyle.SINGLE_LINES),
        walls=tuple(regions[is_line]),
        dropped=(*found.dropped, *regions[~is_line]),
        straight_share=float(forms.straight[is_line].sum() / forms.outline.sum()),
    )
    # Of double lines among furniture and words, five regions of six have not the form of lines.
    shares = is_line.mean(), found.straight_share, ink_share(found, ink)
    return found if min(shares) > STRAIGHT else chosen


def _alone(mask: Mask, full: Float[np.ndarray, "a b"], unsure_px: float) -> Interpretation | None:
    """All of a mask as walls; None where it is specks."""
    walls, specks = _parted(_finely(mask, full))
    if not walls:
        return None
    length = shapely.length(walls)
    thickness = 2 * shapely.area(walls) / np.maximum(length, 1e-6)
    usual = weighted_median(thickness, length)
    straight = float(straight_lengths(walls, max(1.5 * usual, 6.0)).sum())
    share = straight / float(length.sum())
    candidate = Candidate(WallStyle.BLACK_ALONE, mask, "edge", INK, 0.0, 2.0, unsure_px=unsure_px)
    return Interpretation(candidate, tuple(walls), tuple(specks), usual, straight * share, share)


def _finely(mask: Mask, darkness: Float[np.ndarray, "a b"]) -> list[BaseGeometry]:
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
    forms, area = measure_forms(np.array(shapes, dtype=object)), shapely.area(shapes)
    usual = weighted_median(forms.thickness, area)
    is_speck = (forms.reach < max(_SPECK_PX, _SPECK * usual)) | (area < _SPECK_PX)
    walls = [shape for shape, speck in zip(shapes, is_speck, strict=True) if not speck]
    return walls, [shape for shape, speck in zip(shapes, is_speck, strict=True) if speck]


def with_other_styles(
    base: Interpretation, others: Sequence[Interpretation], extent_px: float
) -> Interpretation:
    """An interpretation with the walls that others have beside its own, where these are many.

    Args:
        base: whose walls are believed.
        others: of the same picture.
        extent_px: of the drawing.
    """
    for _ in range(_MOST_STYLES - 1):
        own = shapely.union_all(_valid(base.all_walls))
        gaps = _gaps(own, base.thickness_px)
        beside = [_walls_beside(base, other, own, gaps, extent_px) for other in others]
        most = max(beside, key=lambda added: added.score, default=None)
        if most is None or most.score <= LEAST_SHARE * sum(part.score for part in base.parts):
            break
        base = _joined(base, most)
    return base


def _walls_beside(
    base: Interpretation,
    other: Interpretation,
    own: BaseGeometry,
    gaps: BaseGeometry,
    extent_px: float,
) -> Interpretation:
    """Of another interpretation, the walls that hang together with those of the first: none where none do.

    Args:
        base: whose walls are believed.
        other: of the same picture.
        own: walls of the first.
        gaps: doors and windows in them.
        extent_px: of the drawing.
    """
    nothing = replace(other, walls=(), score=0.0)
    families = {part.candidate.style.family for part in base.parts}
    if not other.walls or other.candidate.style.family in families:
        return nothing
    # Strokes of outlines lie between the walls of two styles.
    reach_px = _TOUCHING_PX + 2 * max(base.candidate.grow_px, other.candidate.grow_px, 0.0)
    around = shapely.buffer(own, reach_px, join_style="mitre")
    pieces = _outside(_valid(other.walls), shapely.union(around, gaps))
    if len(pieces) == 0:
        return nothing
    forms = measure_forms(pieces)
    thickness, outline = forms.thickness, forms.outline
    is_wall = (forms.reach > ELONGATED * thickness) & (forms.straight > STRAIGHT * outline)
    is_wall &= ~are_patterns(pieces, forms)
    near = shapely.buffer(around, 1.0, join_style="mitre")
    beside = shapely.intersection(shapely.boundary(pieces), near)
    is_wall &= shapely.length(beside) < _MOST_CONTACT * outline
    is_black = other.candidate.style.family is WallStyle.BLACK
    across = _gaps(shapely.union_all(_valid(other.walls)), other.thickness_px) if is_black else None
    is_wall &= _hang_together(pieces, is_wall, around, reach_px, across)
    if not is_wall.any():
        return nothing
    usual = weighted_median(thickness[is_wall], outline[is_wall])
    if not is_black:
        is_wall &= (thickness < _ALIKE * usual) & (thickness > usual / _ALIKE)
    walls, whole = tuple(pieces[is_wall]), _worth(other.walls, other.thickness_px, extent_px)
    score = min(_worth(walls, usual, extent_px) / max(whole, 1e-6), 1.0) * other.score
    return replace(other, walls=walls, dropped=(), thickness_px=usual, score=score)


def _worth(walls: Sequence[shapely.Polygon], thickness_px: float, extent_px: float) -> float:
    """As interpretations are scored: straight length, that of long walls the most."""
    return worth_of_walls(straight_lengths(walls, max(1.5 * thickness_px, 6.0)), extent_px)


def _gaps(own: BaseGeometry, thickness_px: float) -> BaseGeometry:
    """Doors and windows of walls: what is drawn there is no wall of its own."""
    faces = faces_of_regions(own, 0.6, max(0.5 * thickness_px, 5.0))
    openings = find_openings(faces.ends, faces.normals, faces.thickness)
    if len(openings) < 2:
        return shapely.Polygon()
    # An opening has a line on each face of its wall, the nearest to each other: its area is what both span.
    middles = openings.mean(axis=1)
    _, nearest = cKDTree(middles).query(middles, k=[2])
    corners = np.concatenate([openings, openings[np.reshape(nearest, -1)]], axis=1)
    hulls = shapely.convex_hull(shapely.multipoints(corners))
    return shapely.buffer(shapely.union_all(hulls), _TOUCHING_PX, join_style="mitre")


def _joined(base: Interpretation, added: Interpretation) -> Interpretation:
    """Both; what the first left out for furniture and is wall of the other style is not left out."""
    new = shapely.union_all(_valid(added.walls))
    new = shapely.buffer(new, _TOUCHING_PX + max(added.candidate.grow_px, 0.0))
    shapely.prepare(new)  # or each question looks at all of it: of hundreds, ten seconds
    dropped = tuple(region for region in base.dropped if not shapely.covers(new, region))
    return replace(base, beside=(*base.beside, added), dropped=dropped)


def _valid(walls: Sequence[shapely.Polygon]) -> Shaped[np.ndarray, " n"]:
    """Outlines that were straightened may cross themselves, which GEOS refuses to cut."""
    return np.asarray(shapely.buffer(np.array(walls, dtype=object), 0.0))


def _outside(walls: Shaped[np.ndarray, " n"], around: BaseGeometry) -> Shaped[np.ndarray, " p"]:
    """Parts of walls that lie outside of others."""
    shapely.prepare(around)
    walls = walls[~shapely.covered_by(walls, around)]
    is_cut = shapely.intersects(walls, around)
    left = np.concatenate([walls[~is_cut], shapely.difference(walls[is_cut], around)])
    parts = shapely.get_parts(left)
    is_polygon = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    return parts[is_polygon & (shapely.area(parts) > 4.0)]


def _hang_together(
    pieces: Shaped[np.ndarray, " n"],
    is_wall: Bool[np.ndarray, " n"],
    around: BaseGeometry,
    reach_px: float,
    across: BaseGeometry | None,
) -> Bool[np.ndarray, " n"]:
    """Those that touch the walls, or others that do, or go on from one of those across a door or window of
    their own (`across`)."""
    idx = np.flatnonzero(is_wall)
    result = np.zeros(len(pieces), dtype=bool)
    if len(idx) == 0:
        return result
    reached = shapely.distance(pieces[idx], around) < reach_px
    tree = shapely.STRtree(pieces[idx])
    a, b = tree.query(pieces[idx], predicate="dwithin", distance=reach_px)
    if across is not None:
        gap, side = tree.query(shapely.get_parts(across), predicate="dwithin", distance=reach_px)
        i, j = np.nonzero(gap[:, None] == gap)
        a, b = np.concatenate([a, side[i]]), np.concatenate([b, side[j]])
    n_before = -1
    while reached.sum() != n_before:
        n_before = int(reached.sum())
        reached[a[reached[b]]] = True
    result[idx[reached]] = True
    return result
