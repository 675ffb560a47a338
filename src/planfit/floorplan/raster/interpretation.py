"""Which interpretation of a picture's dark regions is right.

Walls are straight, long, of few thicknesses, and explain most of the ink.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Shaped

from planfit.floorplan.elements import ELONGATED
from planfit.floorplan.faces import weighted_median
from planfit.floorplan.gaps import LINE_PX, PARALLEL, WIDEST
from planfit.floorplan.raster.candidates import Candidate, WallStyle
from planfit.floorplan.raster.trace import straight_lengths, trace_regions
from planfit.floorplan.vector.line_work import outlines
from planfit.floorplan.vector.regions import without_seams
from planfit.geometry import segments

STRAIGHT = 0.6
"""Share of a wall's outline that is long and straight."""
_ALIKE = 1.4
"""Walls of one drawing are up to so many times as thick as usual, or as thin."""
_THICK = 1.6
"""Bars from so many times the usual thickness on are no walls."""
_APART = 24.0
"""A wall that hangs on no other has an outline at least this many times as long as it is thick."""
_NARROW, _MESHED = 2.0, 0.4
"""Meshes narrower than so many strokes between them, and what of the outline runs around such: planks of
decks and parquet have 0.1 to 1.6 over 0.46 to 0.77, rooms of double lines 3 and more, but for shafts."""
_FATTEST = 1 / 9
"""Walls are thinner than this share of the plan."""


@dataclass(frozen=True)
class Interpretation:
    """What a picture's dark regions are taken for: a candidate, traced, parted into walls and the rest."""

    candidate: Candidate
    walls: tuple[shapely.Polygon, ...]
    dropped: tuple[shapely.Polygon, ...]
    """What looked like wall in tone and thickness, but not in form."""
    thickness_px: float
    """Median over the length of the walls."""
    score: float
    straight_share: float
    """Of the outline of everything traced, what is straight wall."""
    beside: tuple["Interpretation", ...] = ()
    """Walls in other styles of the same drawing, nothing dropped."""

    @property
    def parts(self) -> tuple["Interpretation", ...]:
        """This and those beside, a style each."""
        return (self, *self.beside)

    @property
    def all_walls(self) -> tuple[shapely.Polygon, ...]:
        """Of all styles."""
        return tuple(wall for part in self.parts for wall in part.walls)

    @property
    def style(self) -> str:
        """All styles in words, each with its share of the walls' outlines where there are several."""
        length: dict[str, float] = {}
        for part in self.parts:
            name = part.candidate.style
            length[name] = length.get(name, 0.0) + sum(wall.length for wall in part.walls)
        if len(length) == 1:
            return next(iter(length))
        total = max(sum(length.values()), 1e-9)
        return " and ".join(f"{name} ({100 * own / total:.0f} %)" for name, own in length.items())


def interpret(candidate: Candidate, extent_px: float, is_given: bool = False) -> Interpretation:
    """Trace a candidate and keep what has the form of walls; all of it where the walls are given."""
    mask = candidate.mask if candidate.bars is None else candidate.mask | candidate.bars
    regions = np.array(trace_regions(mask, candidate.grow_px), dtype=object)
    if len(regions) == 0:
        return Interpretation(candidate, (), (), 0.0, 0.0, 0.0)
    forms = measure_forms(regions)
    outline, thickness, straight = forms.outline, forms.thickness, forms.straight
    share = straight / np.maximum(outline, 1e-6)
    is_long = (
        (forms.reach >= ELONGATED * thickness)
        & (share >= STRAIGHT)
        & (thickness < _FATTEST * extent_px)
    )
    if candidate.style.family is WallStyle.LINES:
        is_long &= ~are_patterns(regions, forms)
    if not (is_given or is_long.any()):
        return Interpretation(candidate, (), tuple(regions), 0.0, 0.0, 0.0)
    usual = weighted_median(thickness[is_long], outline[is_long]) if is_long.any() else 1.0
    is_wall = is_long & (forms.reach >= 2.5 * usual) & (thickness >= 0.3 * usual)
    is_wall |= _are_columns(regions, outline, usual)
    if is_given:
        is_long[:] = is_wall[:] = True
        usual = weighted_median(thickness, outline)
    is_wall &= is_given | ~_are_frames(regions, outline, is_wall, thickness < 0.6 * usual)
    if candidate.edge == "stroke":
        is_wall &= _are_part_of_the_building(regions, forms, is_wall, extent_px, usual)
    good = float(straight[is_wall].sum())
    straight_share = good / float(outline.sum())
    return Interpretation(
        candidate,
        _joined(regions[is_wall], candidate),
        tuple(regions[~is_wall]),
        usual,
        worth_of_walls(straight[is_wall], extent_px) * straight_share,
        straight_share,
    )


@dataclass(frozen=True)
class Forms:
    """What some regions look like, px each."""

    outline: Float[np.ndarray, " n"]
    """Length of it."""
    thickness: Float[np.ndarray, " n"]
    """Of a wall by itself, of length L and thickness t, 2 A / P = t L / (L + t), a little less than t."""
    reach: Float[np.ndarray, " n"]
    """Larger side of the box around."""
    straight: Float[np.ndarray, " n"]
    """Length of the edges that are long for the region's thickness."""


def measure_forms(regions: Shaped[np.ndarray, " n"]) -> Forms:
    """Form of each of some polygons."""
    outline = shapely.length(regions)
    thickness = 2 * shapely.area(regions) / np.maximum(outline, 1e-6)
    bounds = shapely.bounds(regions)
    reach = np.maximum(bounds[:, 2] - bounds[:, 0], bounds[:, 3] - bounds[:, 1])
    straight = straight_lengths(regions, np.maximum(1.5 * thickness, 6.0))
    return Forms(outline, thickness, reach, straight)


def are_patterns(regions: Shaped[np.ndarray, " n"], forms: Forms) -> Bool[np.ndarray, " n"]:
    """Which polygons are nets with meshes as narrow as their strokes: planks of a deck, tiles, bricks."""
    rings, of = shapely.get_rings(regions, return_index=True)
    is_hole = np.concatenate([[False], of[1:] == of[:-1]])[: len(of)]
    length = shapely.length(rings)
    width = 2 * shapely.area(shapely.polygons(rings)) / np.maximum(length, 1e-6)
    is_mesh = is_hole & (width < _NARROW * forms.thickness[of])
    meshed = np.bincount(of, length * is_mesh, minlength=len(regions))
    return meshed > _MESHED * forms.outline


def worth_of_walls(straight: Float[np.ndarray, " n"], extent_px: float) -> float:
    """Straight length, weighed: walls hang together, and long ones tell more than many short ones."""
    weight = straight / (straight + 0.3 * extent_px)
    return float((weight * straight).sum())


def _joined(walls: Shaped[np.ndarray, " n"], candidate: Candidate) -> tuple[shapely.Polygon, ...]:
    """Parts of walls that only a line separates become one."""
    if candidate.edge != "stroke":
        return tuple(walls)
    reach = max(0.6 * abs(candidate.grow_px), 0.6)
    return tuple(
        part
        for part in shapely.get_parts(without_seams(walls, reach))
        if isinstance(part, shapely.Polygon) and part.area > 0
    )


def _are_columns(
    regions: Shaped[np.ndarray, " n"], outline: Float[np.ndarray, " n"], usual: float
) -> Bool[np.ndarray, " n"]:
    """Compact rectangles at least as thick as most walls, and not much thicker."""
    area = shapely.area(regions)
    side = outline / 4
    box = shapely.area(shapely.oriented_envelope(regions))
    is_full = area > 0.88 * np.maximum(box, 1e-6)
    is_compact = area > 0.6 * side**2
    return is_full & is_compact & (side > 0.9 * usual) & (side < 6 * usual)


def _are_frames(
    regions: Shaped[np.ndarray, " n"],
    outline: Float[np.ndarray, " n"],
    is_wall: Bool[np.ndarray, " n"],
    is_thin: Bool[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Closed rectangles around most of the other walls, which do not touch them: frames of the sheet, with
    a title block in them where they are thin."""
    result = np.zeros(len(regions), dtype=bool)
    bounds = shapely.bounds(regions)
    for i in np.flatnonzero(is_wall):
        filled = shapely.Polygon(regions[i].exterior)
        box = shapely.area(shapely.box(*bounds[i]))
        n_inside = len(regions[i].interiors)
        if n_inside == 0 or (n_inside > 1 and not is_thin[i]) or filled.area < 0.97 * box:
            continue
        others = is_wall.copy()
        others[i] = False
        inside = others & shapely.contains(filled, regions)
        result[i] = outline[inside].sum() > max(0.6 * outline[others].sum(), 0.3 * outline[i])
    return result


def _are_part_of_the_building(
    regions: Shaped[np.ndarray, " n"],
    forms: Forms,
    is_wall: Bool[np.ndarray, " n"],
    extent_px: float,
    usual: float,
) -> Bool[np.ndarray, " n"]:
    """Large regions, and small ones in line with them: what else is outlined is furniture.

    Args:
        forms: of these.
        is_wall: what has the form of walls by itself.
        extent_px: of the drawing.
        usual: thickness, px.
    """
    outline, straight, thickness = forms.outline, forms.straight, forms.thickness / usual
    # Lines of furniture are nearer to each other than those of walls.
    is_thick = is_wall & (thickness > 0.35)
    least = min(0.25 * straight[is_wall].max(initial=0.0), 0.25 * extent_px)
    is_large = is_thick & (straight > least)
    has_holes = shapely.get_num_interior_rings(regions) > 0
    # A bar of length L and thickness t has the outline 2 (L + t) and the area L t.
    area = shapely.area(regions)
    is_straight = area > 0.75 * np.maximum(shapely.area(shapely.oriented_envelope(regions)), 1e-6)
    is_bar = is_straight & (outline**2 > 30.0 * area)
    # The frame of a window, a table, a bath: a small ring, thinner than walls.
    is_small = forms.reach < 0.2 * extent_px
    is_large &= ~((has_holes | ~is_straight) & (thickness < 1 / _ALIKE) & is_small)
    # Two lines of dimensions are a bar by themselves, further apart than the faces of walls.
    is_large &= ~(is_bar & (thickness > _THICK))
    result = is_large | (is_thick & is_bar & (thickness < _THICK) & (outline > 0.1 * extent_px))
    # As thick as other walls, straight, and open: what stands about has closed outlines, or is as short.
    is_alike = is_wall & ~has_holes & (thickness > 1 / _ALIKE) & (thickness < _ALIKE)
    is_alike &= (straight > 0.75 * outline) & (outline > max(_APART * usual, 0.05 * extent_px))
    result |= is_alike & ~is_straight
    lines = [_long_lines(region) for region in regions[result]]
    lines = [edges for edges in lines if len(edges)]
    # Many small marks: letters and hatching, no walls that doors and windows part.
    if not lines or (is_thick & ~result).sum() > 400:
        return result
    others, firsts = np.concatenate(lines), np.cumsum([0, *map(len, lines[:-1])])
    for i in np.flatnonzero(is_thick & ~result):
        result[i] = _goes_on(_long_lines(regions[i]), others, firsts, thickness[i] * usual)
    return result


def _goes_on(
    own: Float[np.ndarray, "a 6"],
    others: Float[np.ndarray, "b 6"],
    firsts: Int[np.ndarray, " r"],
    thickness_px: float,
) -> bool:
    """Whether two opposite long edges of a region are in line with edges of one wall not far away.

    Args:
        own: its edges, see `_long_lines`.
        others: edges of walls, wall after wall.
        firsts: row of the first edge of each wall.
        thickness_px: of the region.
    """
    if len(own) == 0:
        return False
    own = own[own[:, 5] > 0.6 * own[:, 5].max()]
    is_opposite = own[:, :2] @ own[:, :2].T < -0.9
    if not is_opposite.any():
        return False
    alike = own[:, :2] @ others[:, :2].T > PARALLEL
    gap = others[None, :, 3:5] - own[:, None, 3:5]
    off = np.abs(np.sum(gap * others[None, :, :2], axis=2))
    along = np.linalg.norm(gap, axis=2) - (own[:, None, 5] + others[None, :, 5]) / 2
    in_line = alike & (off < LINE_PX) & (along < WIDEST * thickness_px)
    with_wall = np.logical_or.reduceat(in_line, firsts, axis=1)
    return bool((with_wall & (is_opposite @ with_wall)).any())


def _long_lines(region: shapely.Polygon) -> Float[np.ndarray, "k 6"]:
    """Normal, offset, middle and length of a region's longer edges."""
    edges = outlines([region])
    edges = edges[segments.lengths(edges) > 8.0]
    normal = -segments.left_normals(edges)
    offset = np.sum(normal * edges[:, 0], axis=1)
    return np.column_stack([normal, offset, edges.mean(axis=1), segments.lengths(edges)])
