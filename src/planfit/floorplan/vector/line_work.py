"""Geometry of line work: sets of segments (n, 2, 2), curves and outlines as segments; lines that may be faces
of walls, and the faces that were found among them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Shaped
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import (
    MAX_PAIRS,
    PARALLEL_SINE,
    Ends,
    Rows,
    at_most,
    connected_groups,
    in_blocks,
    line_strings,
    possible_partners,
    weighted_median,
)
from planfit.geometry import segments

SEGMENTS_A_CUBIC = 12
"""A quarter circle then strays by 0.2 % of its radius, a millimetre in a door's arc."""
BY_HAND, BY_HAND_PENS = 0.02, 1.5
"""Of its length, and in widths of its pen, what a straight stroke bends at most where programs imitate a hand
(rough.js: 0.015 of short ones, 1.2 pens)."""
FAR_FROM_ORIGIN = 20.0
"""Coordinates further from the origin than this many times the plan's size are moved to it."""
MAX_LINES = 100_000
"""More of them, in 3 MB, do not show in a picture of 1600 px: those left off are the shortest."""


def flatten_cubic(
    controls: Float[np.ndarray, "4 2"], pen_width: float = 0.0
) -> tuple[Float[np.ndarray, "k 2"], bool]:
    """Points along a cubic with control points, its first left out, and whether it bends (`is_bent`); a
    straight one is one segment."""
    if not is_bent(controls, pen_width):
        return controls[3:], False
    t = (np.arange(1, SEGMENTS_A_CUBIC + 1) / SEGMENTS_A_CUBIC)[:, None]
    s = 1 - t
    points = (
        s**3 * controls[0]
        + 3 * s**2 * t * controls[1]
        + 3 * s * t**2 * controls[2]
        + t**3 * controls[3]
    )
    return points, True


def is_bent(points: Float[np.ndarray, "n 2"], pen_width: float = 0.0) -> bool:
    """Whether a curve through points, or with these control points, leaves its chord: some programs write
    straight walls as curves, others draw them as if by hand with a pen so wide."""
    chord, offset = points[-1] - points[0], points - points[0]
    length = float(np.hypot(*chord))
    across = np.abs(offset[:, 0] * chord[1] - offset[:, 1] * chord[0])
    by_hand = min(BY_HAND_PENS * pen_width, BY_HAND * length)
    return not across.max() < max(1e-3 * length, by_hand) * length


class SubPaths:
    """The sub-paths of a path of a file, whose points are added one after the other."""

    def __init__(self, pen_width: float = 0.0) -> None:
        self._pen_width = pen_width
        self._points: list[np.ndarray] = []
        self._curved: list[bool] = []
        self._found: list[tuple[np.ndarray, np.ndarray]] = []

    def __len__(self) -> int:
        """Points of the sub-path that is open."""
        return len(self._points)

    @property
    def last(self) -> Float[np.ndarray, "2"]:
        """The point that was added last."""
        return self._points[-1]

    def move(self, to: Float[np.ndarray, "2"]) -> None:
        """Begin another sub-path."""
        if len(self._points) > 1:
            self._found.append((np.array(self._points), np.array(self._curved, dtype=bool)))
        self._points, self._curved = [to], []

    def line(self, to: Float[np.ndarray, "2"]) -> None:
        """A straight segment."""
        self._points.append(to)
        self._curved.append(False)

    def cubic(self, controls: Float[np.ndarray, "4 2"]) -> None:
        """A curve by its control points, the first of which is where the path is."""
        flat, is_bent = flatten_cubic(controls, self._pen_width)
        self._points.extend(flat)
        self._curved.extend([is_bent] * len(flat))

    def close(self) -> None:
        """Back to where the sub-path begins; another begins there."""
        if np.abs(self._points[-1] - self._points[0]).max() > 0:
            self.line(self._points[0])
        self.move(self._points[0])

    def found(self) -> list[tuple[Float[np.ndarray, "_ 2"], Bool[np.ndarray, " _"]]]:
        """Each sub-path as points (k, 2) and which of its segments (k - 1,) are curved."""
        if self._points:
            self.move(self._points[-1])
        return self._found


def merge_collinear(
    ends: Ends, tolerance: float
) -> tuple[Float[np.ndarray, "m 2 2"], Int[np.ndarray, " n"]]:
    """Lines that cover the same ground, and for each of the given ones the one it went into.

    Only lines that touch within `tolerance` and stay as near to the line of the longer one are
    joined: a door between two parts of a wall stays open.
    """
    if len(ends) == 0:
        return ends, np.zeros(0, dtype=int)
    a, b = _on_one_another(ends, tolerance)
    group = connected_groups(a, b, len(ends))
    count = int(group.max()) + 1
    length = segments.lengths(ends)
    # The longest of each group gives the line, all of it the extent.
    # Sorted by group, then longest first: the first of each group is its longest.
    order = np.lexsort((-length, group))
    first = order[np.searchsorted(group[order], np.arange(count))]
    origin, along = ends[first, 0], segments.directions(ends)[first]
    at = np.einsum("nei,ni->ne", ends - origin[group][:, None], along[group])
    low, high = extremes(at.ravel(), np.repeat(group, 2), count)
    merged = origin[:, None] + np.stack([low, high], axis=1)[:, :, None] * along[:, None]
    return merged, group


def _on_one_another(
    ends: Ends, tolerance: float
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Pairs of (longer, shorter) lines that touch within `tolerance`, the shorter along the other's line."""
    lines, length = line_strings(ends), segments.lengths(ends)
    # Both ends of the shorter are that near to a line: only specks may lie across it.
    is_speck = length < 2.1 * tolerance / PARALLEL_SINE
    specks, others = np.flatnonzero(is_speck), np.flatnonzero(~is_speck)
    of_specks = in_blocks(lines[specks], shapely.STRtree(lines), tolerance)
    of_others = possible_partners(ends[others], tolerance, PARALLEL_SINE)
    pairs = chain(
        ((a, specks[b]) for b, a in of_specks), ((others[a], others[b]) for a, b in of_others)
    )
    found = [np.zeros((2, 0), dtype=int)]
    for a, b in at_most(MAX_PAIRS, pairs, len(ends), f"with over {MAX_PAIRS} pairs side by side"):
        shorter = (length[b] < length[a]) | ((length[b] == length[a]) & (a < b))
        a, b = a[shorter], b[shorter]
        across = np.einsum("pei,pi->pe", ends[b] - ends[a, :1], segments.left_normals(ends[a]))
        is_one = np.abs(across).max(axis=1, initial=0.0) < tolerance
        a, b = a[is_one], b[is_one]
        found.append(np.stack([a, b])[:, shapely.dwithin(lines[a], lines[b], tolerance)])
    a, b = np.concatenate(found, axis=1)
    return a, b


def cut_out(
    ends: Ends, area: BaseGeometry, min_length: float
) -> tuple[Float[np.ndarray, "m 2 2"], Int[np.ndarray, " m"]]:
    """Parts of segments outside `area`, kept as they are where they do not meet it."""
    if area.is_empty or len(ends) == 0:
        return ends, np.arange(len(ends))
    shapely.prepare(area)
    lines = line_strings(ends)
    meets = shapely.intersects(area, lines)
    rest = np.flatnonzero(meets & ~shapely.contains(area, lines))
    parts, of = shapely.get_parts(shapely.difference(lines[rest], area), return_index=True)
    long = shapely.length(parts) > min_length
    cut, of = ends_of(parts[long]), of[long]
    apart = np.flatnonzero(~meets)
    return np.concatenate([ends[apart], cut]), np.concatenate([apart, rest[of]])


def ends_of(lines: Shaped[np.ndarray, " n"]) -> Ends:
    """First and last point of line strings, which overlays may give points in between."""
    first, last = shapely.get_point(lines, 0), shapely.get_point(lines, -1)
    both = np.stack([shapely.get_coordinates(first), shapely.get_coordinates(last)], axis=1)
    return both.reshape(-1, 2, 2)


def outlines(shapes: Sequence[BaseGeometry]) -> Float[np.ndarray, "k 2 2"]:
    """Segments of the rings of areas and of lines; points have none."""
    parts = shapely.get_parts(shapely.get_parts(np.array(shapes, dtype=object)))
    kinds = shapely.get_type_id(parts)
    rings = shapely.get_rings(parts[kinds == shapely.GeometryType.POLYGON])
    lines = parts[
        np.isin(kinds, [shapely.GeometryType.LINESTRING, shapely.GeometryType.LINEARRING])
    ]
    points, of = shapely.get_coordinates(np.concatenate([rings, lines]), return_index=True)
    # Two points in sequence are a segment where they are of one line.
    same = of[:-1] == of[1:]
    return np.stack([points[:-1][same], points[1:][same]], axis=1)


def edges_of_areas(shapes: Sequence[BaseGeometry]) -> Float[np.ndarray, "k 2 2"]:
    """Edges of the areas among some shapes, the inside on their left."""
    parts = shapely.get_parts(shapely.get_parts(np.array(shapes, dtype=object)))
    is_area = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    return outlines(list(shapely.orient_polygons(parts[is_area])))


def path_rings(
    ends: Ends, path: Int[np.ndarray, " n"]
) -> Iterator[tuple[slice, Float[np.ndarray, "_ 2"], Float[np.ndarray, "_ 2"]]]:
    """Of each path of three segments or more which they are, its points in order, and from where each segment
    begins to the end of the one before: of the first to that of the last, so that all are 0 of a ring.

    `ends`: of segments, those of one path one after the other; `path`: of each segment, from 0.
    """
    for start, stop in pairwise(np.flatnonzero(np.diff(path, prepend=-1, append=-1))):
        if stop - start >= 3:
            own = ends[start:stop]
            gaps = own[:, 0] - np.roll(own[:, 1], 1, axis=0)
            yield slice(start, stop), np.concatenate([own[:, 0], own[-1:, 1]]), gaps


def extremes(
    values: Float[np.ndarray, "p ..."], of: Int[np.ndarray, " p"], n: int
) -> tuple[Float[np.ndarray, "n ..."], Float[np.ndarray, "n ..."]]:
    """The least and the greatest of the values of each of `n` groups; infinite of a group that has none."""
    low = np.full((n, *values.shape[1:]), np.inf)
    high = np.full((n, *values.shape[1:]), -np.inf)
    np.minimum.at(low, of, values)
    np.maximum.at(high, of, values)
    return low, high


def longest(ends: Ends, n: int = MAX_LINES) -> Float[np.ndarray, "k 2 2"]:
    """At most `n` of the segments, in their order."""
    if len(ends) <= n:
        return ends
    shortest_first = np.argsort(segments.lengths(ends), kind="stable")
    return ends[np.sort(shortest_first[-n:])]


def usual_extent(points: Float[np.ndarray, "n 2"]) -> float:
    """Larger side of the box around points, without those further from the middle than twenty times
    the median: one stray line a world away must not make the rest specks."""
    away = np.abs(points - np.median(points, axis=0))
    usual = float(np.median(away, axis=0).max())
    near = away.max(axis=1) <= 20 * usual
    extent = float(np.ptp(points[near], axis=0).max()) if near.any() else 0.0
    return extent if extent > 0 else float(np.ptp(points, axis=0).max())


def round_origin(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2"]:
    """What to subtract: nothing of points near their origin, a round number of those far off, as in national
    grids, where single precision and squares of coordinates would suffer."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(max(high - low))
    if np.abs(low + high).max() / 2 < FAR_FROM_ORIGIN * size:
        return np.zeros(2)
    step = 10.0 ** np.floor(np.log10(size))
    return np.floor(low / step) * step


@dataclass(frozen=True)
class Candidates(Rows):
    """Lines that may be faces of walls, merged: no two lie on one another."""

    ends: Ends
    is_called_wall: Bool[np.ndarray, " n"]
    """Whether the name of the layer, or a room that begins there, makes the line a wall."""
    layer: Int[np.ndarray, " n"]
    """Index of the layer, -1 for edges of rooms."""
    free_side: Int[np.ndarray, " n"]
    """1 where the left side is known to be free, 0 where nothing is."""

    def __len__(self) -> int:
        return len(self.ends)

    def cut(self, ends: Float[np.ndarray, "m 2 2"], line: Int[np.ndarray, " m"]) -> "Candidates":
        """Parts of the lines: `ends` of each, and the line that it is of."""
        return replace(self.take(line), ends=ends)


@dataclass(frozen=True)
class WallFaces(Rows):
    """Faces of walls, in the unit of the drawing."""

    ends: Float[np.ndarray, "m 2 2"]
    normals: Float[np.ndarray, "m 2"]
    is_oriented: Bool[np.ndarray, " m"]
    thickness: Float[np.ndarray, " m"]
    """NaN where unknown."""
    line: Int[np.ndarray, " m"]
    """Index of the line that each lies on, -1 for none."""

    @classmethod
    def oriented(
        cls,
        ends: Float[np.ndarray, "m 2 2"],
        normals: Float[np.ndarray, "m 2"],
        thickness: Float[np.ndarray, " m"] | None = None,
        line: Int[np.ndarray, " m"] | None = None,
    ) -> "WallFaces":
        """Faces whose free side is known; of unknown thickness, and on no line, where these are not given."""
        n = len(ends)
        thickness = np.full(n, np.nan) if thickness is None else thickness
        return cls(
            ends, normals, np.ones(n, bool), thickness, np.full(n, -1) if line is None else line
        )

    @classmethod
    def without_a_side(
        cls, ends: Float[np.ndarray, "m 2 2"], line: Int[np.ndarray, " m"] | None = None
    ) -> "WallFaces":
        """Faces of which neither side is known to be free; on no line where none are given."""
        faces = cls.oriented(ends, segments.left_normals(ends), line=line)
        return replace(faces, is_oriented=np.zeros(len(ends), dtype=bool))

    @staticmethod
    def of_parts(parts: "Sequence[WallFaces]") -> "WallFaces":
        """All of several; none of no parts."""
        none = WallFaces.oriented(np.zeros((0, 2, 2)), np.zeros((0, 2)))
        return WallFaces.together([none, *parts])

    @property
    def usual_thickness(self) -> float | None:
        """Median over the length of the faces of known thickness; None where no thickness is known."""
        known = np.isfinite(self.thickness)
        if not known.any():
            return None
        return weighted_median(self.thickness[known], segments.lengths(self.ends[known]))
