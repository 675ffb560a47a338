"""Which lines of a drawing lie near one another: side by side, or in one group.

A tree of boxes alone looks at every line that crosses another. Sorted by direction first, and boxed along it,
lines meet only those that may be parallel to them: pairs of 30,000 random lines take a thirtieth of the time.
"""

from collections.abc import Iterable, Iterator
from typing import Literal

import numpy as np
import scipy.sparse
import shapely
from jaxtyping import Bool, Float, Int, Shaped

from planfit.errors import FloorplanError
from planfit.geometry import segments

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
    ends: Float[np.ndarray, "n 2 2"], max_gap: float, parallel_sine: float
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


def check_crossings(ends: Float[np.ndarray, "n 2 2"]) -> None:
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


def groups_within(ends: Float[np.ndarray, "n 2 2"], distance: float) -> Int[np.ndarray, " n"]:
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
