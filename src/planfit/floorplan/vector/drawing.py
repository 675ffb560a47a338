"""A vector drawing as readers of DXF, SVG and PDF hand it on: lines, fills and texts, file units."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import Rows
from planfit.floorplan.vector.regions import SelfCrossings
from planfit.floorplan.vector.strokes import (
    LEAST_SLIM,
    MANY,
    MOST_COVERED,
    Pen,
    are_bodies,
    are_in_area,
    area_of_strokes,
    body_of_strokes,
    slimness,
)
from planfit.priors import COORDINATE_MOST_M

ABSURD = COORDINATE_MOST_M.value

DARK = 180
"""Of 255, of every colour: walls that are filled are darker, floors are not."""
LIGHT = 200
"""Of 255, of every colour: paper and floors are lighter."""
SAME = 3e-5
"""Of the drawing's size: what is drawn so near is the same up to rounding."""
EDGE = 1e-3
"""Of the drawing's size: lines this near to the edge of an area that covers what is under it show."""


@dataclass(frozen=True)
class Lines(Rows):
    """Straight segments of line work, x right and y up in the drawing."""

    ends: Float[np.ndarray, "n 2 2"]
    layer: Int[np.ndarray, " n"]
    """Index into `VectorDrawing.layers`."""
    path: Int[np.ndarray, " n"]
    """Which path of the file a segment belongs to."""
    style: Int[np.ndarray, " n"]
    """Equal where colour and stroke width are."""
    is_curved: Bool[np.ndarray, " n"]
    """Segment of an arc, a circle or a spline."""
    is_dashed: Bool[np.ndarray, " n"]
    """Drawn with gaps."""
    is_pale: Bool[np.ndarray, " n"]
    """As pale as a floor, by a pen no broader than others."""

    def __len__(self) -> int:
        return len(self.ends)


@dataclass(frozen=True)
class Fill:
    """A filled area."""

    polygon: BaseGeometry
    layer: int
    colour: tuple[int, int, int] | None
    """RGB from 0 to 255; None where the file does not tell."""
    is_opaque: bool = False
    """Known to hide what was drawn before it."""


@dataclass(frozen=True)
class Text:
    """A line of text."""

    text: str
    xy: Float[np.ndarray, "2"]
    """About its middle."""
    height: float
    layer: int = 0


@dataclass(frozen=True)
class VectorDrawing:
    """Everything of a drawing that tells about walls; coordinates in the file's unit, y up."""

    lines: Lines
    fills: tuple[Fill, ...]
    texts: tuple[Text, ...]
    layers: tuple[str, ...]
    metres_per_unit: float | None = None
    """None where the file does not tell, or tells the size on paper only."""
    unit: str = "unknown"
    """Name of the file's unit."""
    hidden_layers: tuple[str, ...] = ()
    """Layers that are off or frozen, and so were not read."""


class DrawingBuilder:
    """Collects what a reader meets, path by path."""

    def __init__(self) -> None:
        self._ends: list[np.ndarray] = []
        self._numbers: list[np.ndarray] = []
        self._styles: dict[object, int] = {}
        self._layers: dict[str, int] = {}
        self._clips: list[BaseGeometry | None] = []
        self._pens: list[Pen | None] = []
        self.clip: BaseGeometry | None = None
        """What is added next shows inside this area only."""
        self.fills: list[Fill] = []
        self.texts: list[Text] = []
        self._covers: list[tuple[int, BaseGeometry]] = []
        self._crossings = SelfCrossings()

    def layer(self, name: str) -> int:
        """Index of a layer, made when first met."""
        return self._layers.setdefault(name, len(self._layers))

    def add_polyline(
        self,
        points: Float[np.ndarray, "k 2"],
        is_curved: Bool[np.ndarray, " k-1"],
        layer: str,
        style: object,
        pen: Pen | None = None,
    ) -> None:
        """A path through `points`; `is_curved` of each segment, drawn with `pen` where that is known."""
        n = len(points) - 1
        if n < 1:
            return
        style_number = self._styles.setdefault(style, len(self._styles))
        is_dashed = pen is not None and pen.is_dashed
        numbers = np.array([self.layer(layer), len(self._ends), style_number, 0, is_dashed])
        numbers = np.tile(numbers, (n, 1))
        numbers[:, 3] = is_curved
        self._ends.append(np.stack([points[:-1], points[1:]], axis=1))
        self._numbers.append(numbers)
        self._clips.append(self.clip)
        self._pens.append(pen)

    def add_fill(
        self,
        rings: list[Float[np.ndarray, "_ 2"]],
        layer: str,
        colour: tuple[int, int, int] | None,
        is_opaque: bool = False,
    ) -> None:
        """An area inside an odd number of `rings`, each (k, 2)."""
        area = self._area(rings)
        if area.area > 0:
            self.fills.append(Fill(area, self.layer(layer), colour, is_opaque))

    def add_cover(self, rings: list[Float[np.ndarray, "_ 2"]]) -> None:
        """An opaque area: of the lines that were added before, nothing shows in it. Doors are drawn so, as
        patches of the floor's colour over the wall."""
        area = self._area(rings)
        if area.area > 0:
            self._covers.append((len(self._ends), area))

    def _area(self, rings: list[Float[np.ndarray, "_ 2"]]) -> BaseGeometry:
        """What shows of the area inside an odd number of rings."""
        rings = [ring for ring in rings if len(ring) >= 3 and np.isfinite(ring).all()]
        rings = [ring for ring in rings if np.abs(ring).max() < ABSURD]
        area = area_of_rings(rings, self._crossings)
        return area if self.clip is None else shapely.intersection(area, self.clip)

    def build(
        self,
        metres_per_unit: float | None = None,
        unit: str = "unknown",
        hidden_layers: tuple[str, ...] = (),
    ) -> "VectorDrawing":
        """The drawing of all that was added; see `VectorDrawing` for the arguments."""
        numbers = np.concatenate([*self._numbers, np.zeros((0, 5), dtype=int)])
        ends = np.concatenate([*self._ends, np.zeros((0, 2, 2))])
        layer, path, style = numbers[:, 0], numbers[:, 1], numbers[:, 2]
        is_curved, is_dashed = numbers[:, 3].astype(bool), numbers[:, 4].astype(bool)
        pale = _are_pale(self._pens)[path] if self._pens else is_dashed
        lines = Lines(ends, layer, path, style, is_curved, is_dashed, pale)
        lines = _uncovered(_clipped(lines, self._clips), self._covers)
        lines, areas = _without_stroke_fills(lines, self._pens)
        lines, bodies = _without_bodies(lines, self._pens)
        return VectorDrawing(
            lines, (*_under_floors(self.fills), *areas, *bodies),
            tuple(self.texts), tuple(self._layers), metres_per_unit, unit, hidden_layers,
        )  # fmt: skip


def area_of_rings(rings: list[Float[np.ndarray, "_ 2"]], crossings: SelfCrossings) -> BaseGeometry:
    """The area inside an odd number of rings, each (k, 2)."""
    area: BaseGeometry = shapely.Polygon()
    for ring in rings:
        area = shapely.symmetric_difference(area, crossings.valid(shapely.Polygon(ring)))
    return area


def is_dark(colour: tuple[int, int, int] | None) -> bool:
    """Black to light grey, or unknown: colours are for rooms."""
    return colour is None or (max(colour) - min(colour) < 40 and max(colour) < 230)


def _are_pale(pens: list[Pen | None]) -> Bool[np.ndarray, " p"]:
    """Pens as light as floors that are no broader than most of the others."""
    is_light = np.array([pen is not None and min(pen.colour or (0,)) >= LIGHT for pen in pens])
    widths = _widths(pens)
    return is_light & (widths <= np.median(widths[~is_light] if not is_light.all() else widths))


def _widths(pens: list[Pen | None]) -> Float[np.ndarray, " p"]:
    """Of pens; 0 where it is not known."""
    return np.array([0.0 if pen is None else pen.width for pen in pens])


def _without_stroke_fills(lines: Lines, pens: list[Pen | None]) -> tuple[Lines, list[Fill]]:
    """Lines without those that fill areas side by side, and these areas, one a layer and pen."""
    fills: list[Fill] = []
    if len(lines) < MANY:
        return lines, fills
    width = _widths(pens)[lines.path]
    is_kept = np.ones(len(lines), dtype=bool)
    may_be = (width > 0) & np.isfinite(lines.ends).all(axis=(1, 2))
    kinds = np.stack([lines.layer, lines.style], axis=1)
    for layer, style in np.unique(kinds[may_be], axis=0):
        own = np.flatnonzero(may_be & (kinds == (layer, style)).all(axis=1))
        area = area_of_strokes(lines.ends[own], float(width[own[0]]))
        if not area.is_empty:
            is_kept[own[are_in_area(lines.ends[own], area, float(width[own[0]]))]] = False
            pen = pens[lines.path[own[0]]]
            fills.append(Fill(area, int(layer), None if pen is None else pen.colour))
    return lines.take(is_kept), fills


def _without_bodies(lines: Lines, pens: list[Pen | None]) -> tuple[Lines, list[Fill]]:
    """Lines without strokes that are walls by themselves, and those as areas, one a layer."""
    if len(lines) == 0 or all(pen is None or pen.width == 0 for pen in pens):
        return lines, []
    may_be = np.array([pen is not None and is_dark(pen.colour) for pen in pens])
    # What is drawn with gaps is overhead, or the edge of a plot.
    width, may = _widths(pens)[lines.path], may_be[lines.path] & ~lines.is_dashed
    is_body = np.zeros(len(lines), dtype=bool)
    finite = np.flatnonzero((np.abs(lines.ends) < ABSURD).all(axis=(1, 2)))
    is_body[finite] = are_bodies(lines.ends[finite], width[finite], may[finite])
    fills = []
    for layer in np.unique(lines.layer[is_body]):
        own = np.flatnonzero(is_body & (lines.layer == layer))
        fills.append(Fill(body_of_strokes(lines.ends[own], width[own]), int(layer), None))
    return lines.take(~is_body), fills


def _under_floors(fills: list[Fill]) -> list[Fill]:
    """Fills, of dark ones without what opaque ones that are not dark later hide of them: rooms on a slab,
    doors and windows over walls. Of what is no wall and mostly shows, as a dark floor does, the whole is
    left: what hides it is furniture."""
    is_wall = np.array(
        [fill.colour is not None and max(fill.colour) < DARK for fill in fills], bool
    )
    hides = np.array([fill.is_opaque and max(fill.colour or (0,)) >= DARK for fill in fills], bool)
    areas = [fill.polygon for fill in fills]
    polygons = np.array(areas, dtype=object)
    walls, floors = np.flatnonzero(is_wall), np.flatnonzero(hides)
    tree = shapely.STRtree(polygons[floors])
    under, over = tree.query(polygons[walls], predicate="intersects")
    under, over = walls[under], floors[over]
    under, over = under[under < over], over[under < over]
    shown = list(fills)
    for k in np.unique(under).tolist():
        hidden = shapely.union_all(polygons[over[under == k]])
        rest = areas[k].difference(hidden)
        if slimness(areas[k]) > LEAST_SLIM or rest.area < MOST_COVERED * areas[k].convex_hull.area:
            shown[k] = replace(fills[k], polygon=rest)
    return shown


def _clipped(lines: Lines, clips: list[BaseGeometry | None]) -> Lines:
    """Lines cut to the clip of their path: hatches are often drawn far beyond what shows."""
    by_clip: dict[int, list[int]] = {}
    for path, clip in enumerate(clips):
        if clip is not None:
            by_clip.setdefault(id(clip), []).append(path)
    shown, source = [], []
    is_whole = np.ones(len(lines), dtype=bool)
    # Paths ascend: the segments of path p are starts[p] to starts[p + 1].
    starts = np.searchsorted(lines.path, np.arange(len(clips) + 1))
    for paths in by_clip.values():
        clip = clips[paths[0]]
        at = np.concatenate([np.arange(starts[p], starts[p + 1]) for p in paths])
        at = at[np.isfinite(lines.ends[at]).all(axis=(1, 2))]
        drawn = np.asarray(shapely.linestrings(lines.ends[at]), dtype=object)
        shapely.prepare(clip)
        is_cut = ~np.asarray(shapely.covers(clip, drawn))
        is_whole[at[is_cut]] = False
        shown.append(shapely.intersection(drawn[is_cut], clip))
        source.append(at[is_cut])
    if is_whole.all():
        return lines
    return _cut(lines, is_whole, np.concatenate(source), np.concatenate(shown))


def _cut(
    lines: Lines, is_whole: Bool[np.ndarray, " n"], source: Int[np.ndarray, " k"], shown: np.ndarray
) -> Lines:
    """Lines with what shows of some in the place of each, so that paths stay together.

    Args:
        lines: as they were drawn.
        is_whole: those that all shows of.
        source: the others, by index.
        shown: what shows of each of these, shapely's, in any number of parts.
    """
    parts, of = shapely.get_parts(shown, return_index=True)
    shows = shapely.length(parts) > 0
    corners = [shapely.get_coordinates(shapely.get_point(parts[shows], i)) for i in (0, -1)]
    ends = np.concatenate([lines.ends[is_whole], np.stack(corners, axis=1)])
    order = np.concatenate([np.flatnonzero(is_whole), source[of[shows]]])
    in_order = np.argsort(order, kind="stable")
    return replace(lines.take(order[in_order]), ends=ends[in_order])


def _uncovered(lines: Lines, covers: list[tuple[int, BaseGeometry]]) -> Lines:
    """Lines without the parts that areas drawn later cover; a line along the edge of one shows.

    `lines`: of all paths; `covers`: for each area, the number of paths that were drawn before it.
    """
    finite = np.flatnonzero(np.isfinite(lines.ends).all(axis=(1, 2)))
    if not covers or len(finite) == 0:
        return lines
    areas = np.array([area for _, area in covers], dtype=object)
    reach = float(np.ptp(lines.ends[finite].reshape(-1, 2), axis=0).max())
    areas = shapely.buffer(areas, -EDGE * reach)
    before = np.array([n for n, _ in covers])
    drawn = shapely.linestrings(lines.ends[finite])
    line, cover = shapely.STRtree(areas).query(drawn, predicate="intersects")
    is_later = lines.path[finite[line]] < before[cover]
    line, cover = line[is_later], cover[is_later]
    hit = np.unique(line)
    hidden = [shapely.union_all(areas[cover[line == one]]) for one in hit]
    is_whole = np.ones(len(lines), dtype=bool)
    is_whole[finite[hit]] = False
    shown = shapely.difference(np.asarray(drawn, dtype=object)[hit], np.array(hidden, dtype=object))
    return _cut(lines, is_whole, finite[hit], shown)
