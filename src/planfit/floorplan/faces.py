"""From bare segments to faces: which lines lie near one another, and which side of each segment is free.

Plans draw a wall as two parallel lines with the wall between them. So the free side of a line is
the one away from its partner: the nearest parallel line that overlaps it within a wall's thickness.
A line that has partners on both sides equally near, or none, stays unoriented.

A tree of boxes alone looks at every line that crosses another. Sorted by direction first, and boxed along it,
lines meet only those that may be parallel to them: pairs of 30,000 random lines take a thirtieth of the time.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Literal, TypeVar

import numpy as np
import scipy.sparse
import shapely
from jaxtyping import Bool, Float, Int, Shaped

from planfit.compiled import kernel
from planfit.errors import FloorplanError
from planfit.geometry import segments
from planfit.priors import WALL_FACES_APART_M

Ends = Float[np.ndarray, "n 2 2"]
"""The two ends of each of some segments."""
PARALLEL_SINE = float(np.sin(np.deg2rad(2.0)))
"""Lines of a drawing that differ by less are parallel."""
_PARALLEL_SINE = np.sin(np.deg2rad(5.0))
BESIDE_SHARE = 0.3
"""Share of a line with another beside it from which that may be the other side of its wall."""
MAX_PAIRS = 5_000_000
"""Lines that may be side by side; of twelve real drawings the densest has 200,000. They take 6 s, 0.5 GB."""
MAX_CROSSINGS, CROSSINGS_A_LINE = 400_000, 20
"""Lines that meet, each pair counted from either: every overlay takes time by them, 6 s for 340,000. Real
drawings have four a line, at most 50,000; so large ones may have as many more as they have lines."""
MAX_SAMPLES = 64
"""Places a line that are looked at to see which lines are surely together."""
_BLOCK, _PAIRS_AT_ONCE = 2000, 200_000
"""Lines looked at together, which bounds the memory of what is sorted out at once; fewer where so many would
find more pairs. Of a line drawn 100,000 times, 2,000 find 3 GB of them."""


_OfRows = TypeVar("_OfRows", bound="Rows")


class Rows:
    """A dataclass whose fields are arrays, all with one row for each of some things."""

    def take(self: _OfRows, keep: Shaped[np.ndarray, " k"]) -> _OfRows:
        """Those of a mask or an index."""
        return type(self)(*(getattr(self, name)[keep] for name in _names(type(self))))

    @classmethod
    def together(cls: type[_OfRows], parts: Sequence[_OfRows]) -> _OfRows:
        """All of several, one at least, in their order."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in _names(cls)))


def _names(kind: type[Rows]) -> list[str]:
    return [field.name for field in fields(kind)]  # type: ignore[arg-type] - each is a dataclass


@dataclass(frozen=True)
class Partners(Rows):
    """Pairs of parallel lines with one beside the other; `line` ascends.

    Gaps and places along are in the unit of the lines. A pair is listed once for each of its lines.
    """

    line: Int[np.ndarray, " p"]
    """Index of the line."""
    partner: Int[np.ndarray, " p"]
    """Index of the line beside it."""
    gap: Float[np.ndarray, " p"]
    """Least distance across, > 0 left of `line`, < 0 right of it."""
    low: Float[np.ndarray, " p"]
    """Where along `line` the partner's shadow begins, 0 = its first end."""
    high: Float[np.ndarray, " p"]
    """Where it ends."""


def line_strings(ends: Ends) -> Shaped[np.ndarray, " n"]:
    """Segments as shapely's line strings."""
    return np.asarray(shapely.linestrings(ends), dtype=object)


def find_partners(
    ends: Ends,
    max_gap: float,
    min_gap: float,
    min_overlap: float,
    parallel_sine: float = _PARALLEL_SINE,
) -> Partners:
    """All pairs of lines whose whole length is within `max_gap`, and beyond `min_gap`, of
    the other line, with more than `min_overlap` beside it.

    Raises:
        LineWorkTooDense: they are more than in any plan.
    """
    parts = [
        _those_beside(ends, line, partner, max_gap, min_gap, min_overlap, parallel_sine)
        for line, partner in possible_partners(ends, max_gap, parallel_sine)
    ]
    none = Partners(*(np.zeros(0, kind) for kind in (int, int, float, float, float)))
    found = Partners.together([none, *parts])
    return found.take(np.lexsort((found.partner, found.line)))


def _those_beside(
    ends: Ends,
    line: Int[np.ndarray, " q"],
    partner: Int[np.ndarray, " q"],
    max_gap: float,
    min_gap: float,
    min_overlap: float,
    parallel_sine: float,
) -> Partners:
    """Of possible pairs, those that `find_partners` is to find."""
    sine = np.einsum(
        "pi,pi->p", segments.directions(ends[partner]), segments.left_normals(ends[line])
    )
    is_parallel = np.abs(sine) < parallel_sine
    line, partner = line[is_parallel], partner[is_parallel]
    relative = ends[partner] - ends[line, :1]
    gap = np.einsum("pei,pi->pe", relative, segments.left_normals(ends[line]))
    at = np.einsum("pei,pi->pe", relative, segments.directions(ends[line]))
    length = segments.lengths(ends[line])
    low = np.clip(at.min(axis=1), 0.0, length)
    high = np.clip(at.max(axis=1), 0.0, length)
    is_left = (gap.min(axis=1) > min_gap) & (gap.max(axis=1) < max_gap)
    is_right = (gap.max(axis=1) < -min_gap) & (gap.min(axis=1) > -max_gap)
    keep = (is_left | is_right) & (high - low > min_overlap)
    nearest = np.where(is_left, gap.min(axis=1), gap.max(axis=1))
    return Partners(line, partner, nearest, low, high).take(keep)


def orient_faces(
    ends: Ends,
    max_thickness_m: float = WALL_FACES_APART_M.high,
    min_thickness_m: float = WALL_FACES_APART_M.low,
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    """Normals towards the free side, and whether that side is known.

    Args:
        ends: m.
        max_thickness_m: parallel lines further apart than this are two walls, not one.
        min_thickness_m: lines nearer than this are the same line drawn twice.
    """
    normals = segments.left_normals(ends)
    # A twelfth: 5 cm of 60 cm, and the same in a plan of another unit.
    pairs = find_partners(ends, max_thickness_m, min_thickness_m, max_thickness_m / 12)
    length = segments.lengths(ends)
    gap_left, overlap_left = _nearest_partner(pairs, pairs.gap > 0, length)
    gap_right, overlap_right = _nearest_partner(pairs, pairs.gap < 0, length)
    # The wall is on the side where most of the line has a partner; where both sides have one
    # (a thin cavity between two walls), the nearer partner is the wall.
    wall_is_left = (overlap_left > BESIDE_SHARE) & (
        (overlap_right <= BESIDE_SHARE) | (gap_left < 0.7 * gap_right)
    )
    wall_is_right = (overlap_right > BESIDE_SHARE) & (
        (overlap_left <= BESIDE_SHARE) | (gap_right < 0.7 * gap_left)
    )
    is_oriented = wall_is_left ^ wall_is_right
    return np.where(wall_is_left[:, None], -normals, normals), is_oriented


def _nearest_partner(
    pairs: Partners, is_on_side: Bool[np.ndarray, " p"], length: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Gap to the nearest partner on one side, and the share of each line that has any."""
    gaps = np.full(len(length), np.inf)
    line = pairs.line[is_on_side]
    np.minimum.at(gaps, line, np.abs(pairs.gap[is_on_side]))
    covered = covered_lengths(line, pairs.low[is_on_side], pairs.high[is_on_side], len(length))
    return gaps, covered / length


def covered_lengths(
    line: Int[np.ndarray, " p"], low: Float[np.ndarray, " p"], high: Float[np.ndarray, " p"], n: int
) -> Float[np.ndarray, " n"]:
    """Length of the union of the intervals `low` to `high` of each of `n` lines."""
    # By line and beginning: the compiled loop then meets each line's intervals in order, and adds what of
    # each lies beyond the furthest end reached so far.
    order = np.lexsort((low, line))
    return _covered_lengths(line[order], low[order], high[order], n)


@kernel
def _covered_lengths(line, low, high, n):  # pragma: no cover - compiled; has a twin in the tests
    total = np.zeros(n)
    reached, current = -np.inf, -1
    for i in range(len(line)):
        if line[i] != current:
            current, reached = line[i], -np.inf
        total[current] += max(0.0, high[i] - max(low[i], reached))
        reached = max(reached, high[i])
    return total


def usual_gap(ends: Ends, max_gap: float) -> float:
    """Gap between a line and its nearest parallel neighbour, of the median length of line; infinite
    where most have none within `max_gap`. Says how thick walls are in a plan of unknown scale."""
    length = segments.lengths(ends)
    pairs = find_partners(ends, max_gap, 1e-3 * max_gap, max_gap / 12)
    nearest, _ = _nearest_partner(pairs, np.ones(len(pairs.line), dtype=bool), length)
    return weighted_median(nearest, length)


def weighted_median(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float:
    """The value at which the sum of weights, from the least value on, reaches half of all."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2)])


def first_of_each(ends: Ends) -> Int[np.ndarray, " m"]:
    """Indices, ascending, of segments without those that repeat one before, in either direction."""
    low_first = np.array([sorted(pair) for pair in ends.tolist()]).reshape(-1, 4)
    _, first = np.unique(low_first, axis=0, return_index=True)
    return np.sort(first)


class LineWorkTooDense(FloorplanError):
    """More lines lie side by side, or across one another, than in any plan; names no file."""

    def __init__(self, n_lines: int, found: str) -> None:
        super().__init__(
            f"expected line work of a plan, found {n_lines} lines {found}, "
            "as in no plan; pass the layers that hold walls (--layer), or leave hatches and textures out"
        )


def in_blocks(
    shapes: Shaped[np.ndarray, " q"],
    tree: shapely.STRtree,
    distance: float | Float[np.ndarray, " q"] | None = None,
    predicate: Literal["intersects"] | None = "intersects",
) -> Iterator[tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]]:
    """Pairs of (shape, shape of the tree) within a distance, else that meet (without a predicate, whose boxes
    meet), block by block: where all lie on one another, there are more than fit into memory."""
    start, size = 0, 8
    while start < len(shapes):
        part = slice(start, start + size)
        if distance is None:
            query, found = tree.query(shapes[part], predicate)
        else:
            reach = distance[part] if isinstance(distance, np.ndarray) else distance
            query, found = tree.query(shapes[part], "dwithin", reach)
        yield query + start, found
        start += size
        size = max(1, min(_BLOCK, 2 * size, size * _PAIRS_AT_ONCE // max(len(query), 1)))


def at_most(
    most: int,
    pairs: Iterable[tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]],
    n: int,
    found: str,
) -> Iterator[tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]]:
    """Pairs, in blocks, among `n` lines.

    Raises:
        LineWorkTooDense: they are more than `most`; `found` says what they are.
    """
    count = 0
    for block in pairs:
        count += len(block[0])
        if count > most:
            raise LineWorkTooDense(n, found)
        yield block


def possible_partners(
    ends: Ends, max_gap: float, parallel_sine: float
) -> Iterator[tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]]:
    """Pairs of (line, other), in blocks, among them all that are parallel by `parallel_sine` and come within
    `max_gap` of one another, each once from either line, and lines with themselves.

    Raises:
        LineWorkTooDense: they are more than `MAX_PAIRS`.
    """
    along = segments.directions(ends)
    angle = np.arctan2(along[:, 1], along[:, 0]) % np.pi
    # Classes at least as wide as parallel lines may differ: those of a line are in its own or the next.
    n_classes = int(np.pi / np.arcsin(parallel_sine))
    of_class = np.minimum((angle / np.pi * n_classes).astype(int), n_classes - 1)
    n_pairs = 0
    for c in np.unique(of_class):
        own = np.flatnonzero(of_class == c)
        near = np.flatnonzero(np.isin(of_class, [(c - 1) % n_classes, c, (c + 1) % n_classes]))
        middle = np.pi * (c + 0.5) / n_classes
        axes = np.array([[np.cos(middle), -np.sin(middle)], [np.sin(middle), np.cos(middle)]])
        turned = ends[near] @ axes
        boxes = np.concatenate([turned.min(axis=1), turned.max(axis=1)], axis=1)
        # What rounding moves is far less than this.
        reach = max_gap + 1e-9 * np.abs(turned).max(initial=0.0)
        tree = shapely.STRtree(shapely.box(*boxes.T))
        around = boxes[np.searchsorted(near, own)] + reach * np.array([-1.0, -1.0, 1.0, 1.0])
        for query, found in in_blocks(shapely.box(*around.T), tree, predicate=None):
            n_pairs += len(query)
            if n_pairs > MAX_PAIRS:
                raise LineWorkTooDense(len(ends), f"with over {MAX_PAIRS} pairs side by side")
            yield own[query], near[found]


def check_crossings(ends: Ends) -> None:
    """Refuse line work that no overlay gets through in a reasonable time.

    Raises:
        LineWorkTooDense: more pairs of lines meet than in any plan.
    """
    most = MAX_CROSSINGS + CROSSINGS_A_LINE * len(ends)
    if len(ends) ** 2 <= most:
        return
    lines = np.asarray(shapely.linestrings(ends), dtype=object)
    found = in_blocks(lines, shapely.STRtree(lines))
    for _ in at_most(most, found, len(ends), f"that cross over {most // 2} times"):
        pass


def groups_within(ends: Ends, distance: float) -> Int[np.ndarray, " n"]:
    """Group of each line, from 0: those of one are chained by gaps of at most `distance`."""
    if len(ends) == 0:
        return np.zeros(0, dtype=int)
    # Two lines with places in one cell of this diagonal are near enough: pairs of lines need not be asked.
    cell = 0.999 * distance / np.sqrt(2)
    length = segments.lengths(ends)
    n_samples = np.clip(np.ceil(length / cell), 1, MAX_SAMPLES).astype(int)
    places, line = segments.spread(ends, n_samples)
    _, of_cell = np.unique(np.floor(places / cell), axis=0, return_inverse=True)
    group = connected_groups(line, len(ends) + of_cell.ravel(), len(ends) + of_cell.max() + 1)
    _, group = np.unique(group[: len(ends)], return_inverse=True)
    order = np.argsort(group, kind="stable")
    lines = np.asarray(shapely.linestrings(ends[order]), dtype=object)
    together = np.asarray(shapely.multilinestrings(lines, indices=group[order]), dtype=object)
    a, b = shapely.STRtree(together).query(together, predicate="dwithin", distance=distance)
    return connected_groups(a, b, len(together))[group]


def ends_that_meet(
    ends: Float[np.ndarray, "t 2 2"],
    own: Int[np.ndarray, " t"],
    strings: Shaped[np.ndarray, " n"],
    reach: float | Float[np.ndarray, " t"],
) -> Bool[np.ndarray, "t 2"]:
    """Which ends of some lines have another line within reach.

    Args:
        ends: of these lines.
        own: index of each among all; -1 of one that is not among them.
        strings: all lines, as shapely's.
        reach: of each of these lines, or of all.
    """
    tips = np.asarray(shapely.points(ends.reshape(-1, 2)), dtype=object)
    meets = np.zeros(len(tips), dtype=bool)
    reach = np.repeat(np.broadcast_to(reach, len(ends)), 2)
    for i, j in in_blocks(tips, shapely.STRtree(strings), reach):
        meets[i[j != np.repeat(own, 2)[i]]] = True
    return meets.reshape(-1, 2)


def connected_groups(
    a: Int[np.ndarray, " p"], b: Int[np.ndarray, " p"], n: int
) -> Int[np.ndarray, " n"]:
    """Group of each of `n` things, from 0, of which pairs (`a`, `b`) are of one, and all that these chain."""
    graph = scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
