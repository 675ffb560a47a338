"""Walls of one drawing in several styles: bearing walls filled and partitions as two lines, or the other way.

Each interpretation of a picture knows one style. What another one has beside its walls is wall too where it
hangs together with them as walls do: it ends at them, as partitions do. Furniture stands along walls or
free, and windows lie in their gaps.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Shaped
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.columns import ELONGATED
from planfit.floorplan.faces import weighted_median
from planfit.floorplan.raster.candidates import WallStyle
from planfit.floorplan.raster.interpretation import Interpretation, measure_forms, worth_of_walls
from planfit.floorplan.raster.openings import find_openings
from planfit.floorplan.raster.trace import straight_lengths
from planfit.floorplan.vector.regions import faces_of_regions

_TOUCHING_PX = 3.0
"""What lies nearer touches."""
_MOST_CONTACT = 0.3
"""Of its outline, what of a wall that ends at others touches them; of furniture along a wall, a third."""
_STRAIGHT = 0.7
"""Of its outline, what is straight."""
_ALIKE = 2.0
"""Walls of one style are up to so many times as thick as most of them, or as thin: what differs more is
furniture, unless it is solid black beside paler walls, as the flat that is sold is among its neighbours."""
LEAST_SHARE = 0.15
"""Of the score of one style, what walls of others add at least: less is furniture more often than wall."""
_MOST_STYLES = 3
"""In one drawing."""


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
    is_wall = (forms.reach > ELONGATED * thickness) & (forms.straight > _STRAIGHT * outline)
    beside = shapely.intersection(
        shapely.boundary(pieces), shapely.buffer(around, 1.0, join_style="mitre")
    )
    is_wall &= shapely.length(beside) < _MOST_CONTACT * outline
    is_black = other.candidate.style.family is WallStyle.BLACK
    across = _gaps(shapely.union_all(_valid(other.walls)), other.thickness_px) if is_black else None
    is_wall &= _hang_together(pieces, is_wall, around, reach_px, across)
    if not is_wall.any():
        return nothing
    usual = weighted_median(thickness[is_wall], outline[is_wall])
    if not is_black:
        is_wall &= (thickness < _ALIKE * usual) & (thickness > usual / _ALIKE)
    walls = tuple(pieces[is_wall])
    share = _worth(walls, usual, extent_px) / max(
        _worth(other.walls, other.thickness_px, extent_px), 1e-6
    )
    return replace(
        other, walls=walls, dropped=(), thickness_px=usual, score=min(share, 1.0) * other.score
    )


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
