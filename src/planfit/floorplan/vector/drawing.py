"""A vector drawing as readers of DXF, SVG and PDF hand it on: lines, fills and texts, file units."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from planfit.geometry import segments

ABSURD = 1e9
"""No national grid reaches this far, in any unit: such coordinates are faults of the file."""


@dataclass(frozen=True)
class Lines:
    """Straight pieces of line work, x right and y up in the drawing."""

    ends: np.ndarray  # (n, 2, 2)
    layer: np.ndarray  # (n,) index into `Drawing.layers`
    path: np.ndarray  # (n,) which path of the file a piece belongs to
    style: np.ndarray  # (n,) equal where colour and stroke width are
    is_curved: np.ndarray  # (n,) bool, piece of an arc, a circle or a spline

    def __len__(self) -> int:
        return len(self.ends)

    def take(self, keep: np.ndarray) -> "Lines":
        """Those of a mask or an index."""
        return Lines(
            self.ends[keep],
            self.layer[keep],
            self.path[keep],
            self.style[keep],
            self.is_curved[keep],
        )


@dataclass(frozen=True)
class Fill:
    """A filled area."""

    polygon: BaseGeometry
    layer: int
    colour: tuple[int, int, int] | None
    """RGB from 0 to 255; None where the file does not tell."""


@dataclass(frozen=True)
class Text:
    """A line of text."""

    text: str
    xy: np.ndarray  # (2,) about its middle
    height: float
    layer: int = 0


@dataclass(frozen=True)
class Drawing:
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
        self.clip: BaseGeometry | None = None
        """What is added next shows inside this area only."""
        self.fills: list[Fill] = []
        self.texts: list[Text] = []

    def layer(self, name: str) -> int:
        """Index of a layer, made when first met."""
        return self._layers.setdefault(name, len(self._layers))

    def add_polyline(
        self, points: np.ndarray, is_curved: np.ndarray, layer: str, style: object
    ) -> None:
        """A path through `points` (k, 2); `is_curved` (k - 1,) of each piece."""
        n = len(points) - 1
        if n < 1:
            return
        style_number = self._styles.setdefault(style, len(self._styles))
        numbers = np.array([self.layer(layer), len(self._ends), style_number, 0])
        numbers = np.tile(numbers, (n, 1))
        numbers[:, 3] = is_curved
        self._ends.append(np.stack([points[:-1], points[1:]], axis=1))
        self._numbers.append(numbers)
        self._clips.append(self.clip)

    def add_fill(
        self, rings: list[np.ndarray], layer: str, colour: tuple[int, int, int] | None
    ) -> None:
        """An area inside an odd number of `rings`, each (k, 2)."""
        area: BaseGeometry = shapely.Polygon()
        for ring in rings:
            if len(ring) >= 3 and np.isfinite(ring).all() and np.abs(ring).max() < ABSURD:
                area = shapely.symmetric_difference(area, shapely.make_valid(shapely.Polygon(ring)))
        if self.clip is not None:
            area = shapely.intersection(area, self.clip)
        if area.area > 0:
            self.fills.append(Fill(area, self.layer(layer), colour))

    def build(self) -> tuple[Lines, tuple[Fill, ...], tuple[Text, ...], tuple[str, ...]]:
        """The parts of a `Drawing`."""
        numbers = np.concatenate([*self._numbers, np.zeros((0, 4), dtype=int)])
        ends = np.concatenate([*self._ends, np.zeros((0, 2, 2))])
        lines = Lines(ends, numbers[:, 0], numbers[:, 1], numbers[:, 2], numbers[:, 3].astype(bool))
        lines = _clipped(lines, self._clips)
        return lines, tuple(self.fills), tuple(self.texts), tuple(self._layers)


def cleaned(drawing: Drawing) -> tuple[Drawing, tuple[str, ...]]:
    """The drawing without pieces that no plan has, and a sentence on each kind left out."""
    lines, notes = drawing.lines, []
    with np.errstate(invalid="ignore"):
        is_absurd = np.asarray(~(np.abs(lines.ends) < ABSURD).all(axis=(1, 2)))
    if is_absurd.any():
        notes.append(
            f"{_count(is_absurd.sum(), 'line')} with coordinates that are no numbers or beyond 1e9"
        )
        lines = lines.take(~is_absurd)
    if len(lines):
        extent = usual_extent(lines.ends.reshape(-1, 2))
        is_point = segments.lengths(lines.ends) <= 1e-7 * extent
        if is_point.any():
            notes.append(f"{_count(is_point.sum(), 'line')} without length")
            lines = lines.take(~is_point)
        unit = max(1e-6 * extent, 1e-12)
        keys = np.round(lines.ends / unit).astype(np.int64).reshape(-1, 4)
        is_turned = (keys[:, 0] > keys[:, 2]) | (
            (keys[:, 0] == keys[:, 2]) & (keys[:, 1] > keys[:, 3])
        )
        keys[is_turned] = keys[is_turned][:, [2, 3, 0, 1]]
        _, first = np.unique(np.column_stack([keys, lines.layer]), axis=0, return_index=True)
        # They stay: outlines of neighbours share sides, and each is needed whole to be closed. Lines on
        # one another are one wall in `merge_collinear`.
        if len(first) < len(lines):
            notes.append(f"{_count(len(lines) - len(first), 'line')} drawn twice")
    lines = _simplified(lines)
    lines = lines.take(segments.lengths(lines.ends) > 0)
    lines = replace(lines, is_curved=lines.is_curved | bent_pieces(lines))
    return replace(drawing, lines=lines), tuple(notes)


def _clipped(lines: Lines, clips: list[BaseGeometry | None]) -> Lines:
    """Lines cut to the clip of their path: hatches are often drawn far beyond what shows."""
    by_clip: dict[int, list[int]] = {}
    for path, clip in enumerate(clips):
        if clip is not None:
            by_clip.setdefault(id(clip), []).append(path)
    ends, source = [lines.ends], [np.arange(len(lines))]
    is_whole = np.ones(len(lines), dtype=bool)
    starts = np.searchsorted(lines.path, np.arange(len(clips) + 1))
    for paths in by_clip.values():
        clip = clips[paths[0]]
        at = np.concatenate([np.arange(starts[p], starts[p + 1]) for p in paths])
        at = at[np.isfinite(lines.ends[at]).all(axis=(1, 2))]
        drawn = shapely.linestrings(lines.ends[at])
        shapely.prepare(clip)
        outside = at[~np.asarray(shapely.covers(clip, drawn))]
        is_whole[outside] = False
        pieces, of = shapely.get_parts(
            shapely.intersection(shapely.linestrings(lines.ends[outside]), clip), return_index=True
        )
        is_line = shapely.length(pieces) > 0
        first, last = (shapely.get_point(pieces[is_line], i) for i in (0, -1))
        corners = [shapely.get_coordinates(first), shapely.get_coordinates(last)]
        ends.append(np.stack(corners, axis=1))
        source.append(outside[of[is_line]])
    order = np.concatenate(source)
    keep = np.concatenate([is_whole, np.ones(len(order) - len(lines), dtype=bool)])
    ends, order = np.concatenate(ends)[keep], order[keep]
    in_order = np.argsort(order, kind="stable")
    return replace(lines.take(order[in_order]), ends=ends[in_order])


def _simplified(lines: Lines) -> Lines:
    """Paths with fewer corners, none off by more than 3e-5 of the drawing (a millimetre in a
    building of 30 m): some files hold curves as tens of thousands of pieces."""
    n = len(lines)
    if n < 4:
        return lines
    extent = usual_extent(lines.ends.reshape(-1, 2))
    joined = (
        (lines.path[:-1] == lines.path[1:])
        & (lines.is_curved[:-1] == lines.is_curved[1:])
        & (np.abs(lines.ends[:-1, 1] - lines.ends[1:, 0]).max(axis=1) <= 1e-9 * extent)
    )
    first = np.flatnonzero(np.concatenate([[True], ~joined]))
    run = np.repeat(np.arange(len(first)), np.diff(np.append(first, n)))
    last = np.append(first[1:], n) - 1
    points = np.concatenate([lines.ends[:, 0], lines.ends[last, 1]])
    owner = np.concatenate([run, np.arange(len(first))])
    order = np.argsort(owner, kind="stable")
    paths = shapely.linestrings(points[order], indices=owner[order])
    simple, of = shapely.get_coordinates(
        shapely.simplify(paths, 3e-5 * extent, preserve_topology=False), return_index=True
    )
    same = of[:-1] == of[1:]
    taken = lines.take(first[of[:-1][same]])
    return replace(taken, ends=np.stack([simple[:-1][same], simple[1:][same]], axis=1))


def bent_pieces(lines: Lines) -> np.ndarray:
    """(n,) bool: pieces of curves that a file holds as short straight pieces.

    A piece is of a curve where it turns by 2 to 40 degrees to the same side at both ends, or follows
    such a piece with such a turn.
    """
    n = len(lines)
    if n < 3:
        return np.zeros(n, dtype=bool)
    along = segments.directions(lines.ends)
    turn = np.arctan2(
        along[:-1, 0] * along[1:, 1] - along[:-1, 1] * along[1:, 0],
        np.einsum("ni,ni->n", along[:-1], along[1:]),
    )
    length = segments.lengths(lines.ends)
    gap = np.linalg.norm(lines.ends[1:, 0] - lines.ends[:-1, 1], axis=1)
    joined = (lines.path[:-1] == lines.path[1:]) & (
        gap < 1e-3 * np.minimum(length[:-1], length[1:])
    )
    bend = np.where(
        joined & (np.abs(turn) > np.deg2rad(2)) & (np.abs(turn) < np.deg2rad(40)),
        np.sign(turn),
        0.0,
    )
    before, after = np.concatenate([[0.0], bend]), np.concatenate([bend, [0.0]])
    is_curved = before * after > 0
    follows = (before != 0) & np.concatenate([[False], is_curved[:-1]])
    leads = (after != 0) & np.concatenate([is_curved[1:], [False]])
    return is_curved | follows | leads


def usual_extent(points: np.ndarray) -> float:
    """Larger side of the box around points (n, 2), without those further from the middle than twenty times
    the median: one stray line a world away must not make the rest specks."""
    away = np.abs(points - np.median(points, axis=0))
    usual = float(np.median(away, axis=0).max())
    near = away.max(axis=1) <= 20 * usual
    extent = float(np.ptp(points[near], axis=0).max()) if near.any() else 0.0
    return extent if extent > 0 else float(np.ptp(points, axis=0).max())


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" + ("" if n == 1 else "s")
