"""The order in which poses are eliminated, what it costs, and its supernodes: on the graph of blocks alone.

Minimum degree: the pose with the fewest neighbours goes next, and its neighbours become neighbours of
each other. The graph of blocks has a sixth of the matrix's rows and a thirty-sixth of its entries,
and the count ends where the work exceeds what a caller would pay.

A column of the factor is then a handful of 6x6 blocks, too little work for a processor. Columns with the
same blocks below them are joined into supernodes (Liu, Ng and Peyton 1993), and small ones also where that
stores some zeros (Ashcraft and Grimes 1989); each is eliminated as one dense matrix, its front.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from planfit.compiled import kernel

MAX_ZEROS = 0.25
"""Share of zeros that joining may leave in a supernode."""
MAX_SMALL = 4
"""Supernodes up to this many poses wide are joined whatever zeros that leaves: calls cost more."""


@dataclass(frozen=True)
class FillReducingOrdering:
    """An order of poses for a Cholesky factorisation, and what it costs."""

    order: Int[np.ndarray, " n"]
    """Poses, first eliminated first."""
    start: Int[np.ndarray, " m"]
    """(n + 1,): neighbours of the k-th pose when it goes are start[k]:start[k + 1]."""
    neighbours: Int[np.ndarray, " l"]
    """Poses; with their pose, the blocks of a column of the factor."""
    work: float
    """Multiplications of 6x6 blocks, about."""


def minimum_degree_ordering(
    rows: Int[np.ndarray, " b"], columns: Int[np.ndarray, " b"], n_poses: int, max_work: float
) -> FillReducingOrdering | None:
    """Minimum-degree order of the graph with edges (rows, columns); None beyond `max_work`."""
    off = rows != columns
    first = np.concatenate([rows[off], columns[off]])
    second = np.concatenate([columns[off], rows[off]])
    by_first = np.argsort(first, kind="stable")
    start = np.searchsorted(first[by_first], np.arange(n_poses + 1))
    order, counts, neighbours, work = _minimum_degree(start, second[by_first], float(max_work))
    if work > max_work:
        return None
    starts = np.concatenate([[0], np.cumsum(counts)])
    return FillReducingOrdering(order, starts, neighbours[: starts[-1]], work)


@kernel
def _minimum_degree(start, neighbours, max_work):  # pragma: no cover
    """Order, neighbours at each elimination, and work; edges are (start, neighbours), both ways.

    Lists of neighbours live in one pool, pose v's at begin[v], count[v] long. A new list goes to the end of
    the pool; the heap keeps outdated degrees, which are passed over when they come up.
    """
    n = len(start) - 1
    begin, count = start[:-1].copy(), start[1:] - start[:-1]  # np.diff takes a second to compile
    pool = np.zeros(4 * len(neighbours) + 1024, np.int64)
    pool[: len(neighbours)] = neighbours
    end = len(neighbours)
    is_done, mark, stamp = np.zeros(n, np.bool_), np.zeros(n, np.int64), 0
    order = np.zeros(n, np.int64)
    heap = [(count[v], v) for v in range(n)]
    heapq.heapify(heap)
    work, n_done = 0.0, 0
    counts, columns, n_columns = np.zeros(n, np.int64), np.zeros(len(neighbours) + 16, np.int64), 0
    while n_done < n:
        degree, v = heapq.heappop(heap)
        if is_done[v] or degree != count[v]:
            continue  # its degree has changed since
        left = n - n_done
        is_clique = (
            degree == left - 1
        )  # everything is a neighbour of everything: no order is better
        work += left**3 / 6.0 if is_clique else 0.5 * (degree + 1) ** 2
        if work > max_work:
            return order, counts, columns, work
        needed = left * (left - 1) // 2 if is_clique else degree
        columns = _with_room(columns, n_columns, needed)
        if is_clique:
            _eliminate_clique(is_done, order, n_done, counts, columns, n_columns)
            return order, counts, columns, work
        counts[n_done] = degree
        columns[n_columns : n_columns + degree] = pool[begin[v] : begin[v] + degree]
        n_columns += degree
        order[n_done] = v
        n_done += 1
        need = degree * degree
        for u in pool[begin[v] : begin[v] + degree]:
            need += count[u]
        if end + need > len(pool):
            pool, end = _compacted(pool, begin, count, is_done, need)
        is_done[v] = True
        end, stamp = _join_neighbours(pool, begin, count, v, mark, stamp, end, heap)
    return order, counts, columns, work


@kernel
def _with_room(values, used, needed):  # pragma: no cover
    """The values, copied to a larger array where there is no room behind the first `used`."""
    if used + needed <= len(values):
        return values
    grown = np.zeros(2 * len(values) + needed, np.int64)
    grown[:used] = values[:used]
    return grown


@kernel
def _eliminate_clique(is_done, order, n_done, counts, columns, n_columns):  # pragma: no cover
    """Eliminate the rest, all neighbours of each other: each has those behind it as neighbours."""
    n, rest = len(order), n_done
    for u in range(n):
        if not is_done[u]:
            order[n_done] = u
            n_done += 1
    for k in range(rest, n):
        counts[k] = n - 1 - k
        columns[n_columns : n_columns + counts[k]] = order[k + 1 :]
        n_columns += counts[k]


@kernel
def _join_neighbours(pool, begin, count, v, mark, stamp, end, heap):  # pragma: no cover
    """Make v's neighbours neighbours of each other, without v; where the pool and the stamps go on.

    A pose is in a new list if its mark is the list's stamp, so that none is listed twice.
    """
    clique = pool[begin[v] : begin[v] + count[v]]
    for u in clique:
        fresh, stamp = end, stamp + 1
        mark[u] = mark[v] = stamp
        for old in (pool[begin[u] : begin[u] + count[u]], clique):
            for w in old:
                if mark[w] != stamp:
                    mark[w] = stamp
                    pool[end] = w
                    end += 1
        begin[u], count[u] = fresh, end - fresh
        heapq.heappush(heap, (count[u], u))
    return end, stamp


@kernel
def _compacted(pool, begin, count, is_done, need):  # pragma: no cover
    """The lists of poses that are left, one after the other in a new pool with room to grow."""
    size = need
    for u in range(len(begin)):
        if not is_done[u]:
            size += 2 * count[u]
    fresh, end = np.zeros(size, np.int64), 0
    for u in range(len(begin)):
        if not is_done[u]:
            fresh[end : end + count[u]] = pool[begin[u] : begin[u] + count[u]]
            begin[u] = end
            end += count[u]
    return fresh, end


@dataclass(frozen=True)
class Supernodes:
    """Supernodes in the order of their elimination: children before parents, a subtree in one piece.

    A `place` is a pose's row in the factor. The front of supernode s has the rows of its own places
    `first[s]:first[s + 1]`, then those of `below[start[s]:start[s + 1]]`; n poses, s supernodes.
    """

    order: Int[np.ndarray, " n"]
    """Pose at each place."""
    first: Int[np.ndarray, " t"]
    """(s + 1,)."""
    start: Int[np.ndarray, " t"]
    """(s + 1,)."""
    below: Int[np.ndarray, " l"]
    """Places, ascending in each supernode."""
    in_parent: Int[np.ndarray, " l"]
    """The row of each of `below` in the front of the supernode's parent."""
    n_children: Int[np.ndarray, " s"]
    of_place: Int[np.ndarray, " n"]
    """Supernode of each place."""


def find_supernodes(ordering: FillReducingOrdering) -> Supernodes:
    """Join the columns of the factor in an order into supernodes."""
    n = len(ordering.order)
    rank = _inverse_permutation(ordering.order)
    start, near = ordering.start, rank[ordering.neighbours]
    # The parent of a column is the first of those below it; a root's is n (elimination tree, Liu 1990).
    parent = np.full(n, n)
    has_below = np.diff(start) > 0
    if len(near):
        parent[has_below] = np.minimum.reduceat(near, start[:-1][has_below])
    # A supernode goes by its last column, its top: what is below that is below all of it.
    top = _joined(parent, np.diff(start), MAX_ZEROS, MAX_SMALL)
    tops = np.flatnonzero(top == np.arange(n))
    above = parent[tops]
    super_of = np.searchsorted(tops, top)
    super_parent = np.where(above < n, super_of[np.minimum(above, n - 1)], len(tops))
    # Postorder of supernodes, the columns of each in their old order: a stable sort keeps that.
    sequence = _postorder(super_parent)
    rank_of_super = _inverse_permutation(sequence)
    of_rank = rank_of_super[super_of]
    by_place = np.argsort(of_rank, kind="stable")  # rank at each place
    place = _inverse_permutation(by_place)
    first = np.searchsorted(of_rank[by_place], np.arange(len(tops) + 1))
    # Copy the lists below the tops, one after the other, as places: `taken` counts on from each list's start.
    ends = tops[sequence]
    counts = np.diff(start)[ends]
    super_start = np.concatenate([[0], np.cumsum(counts)])
    taken = np.repeat(start[ends] - super_start[:-1], counts) + np.arange(super_start[-1])
    below = place[near[taken]]
    owner = np.repeat(np.arange(len(tops)), counts)
    below = below[np.lexsort((below, owner))]
    parents = np.append(rank_of_super, len(tops))[super_parent[sequence]]
    return Supernodes(
        order=ordering.order[by_place],
        first=first,
        start=super_start,
        below=below,
        in_parent=_rows_in_parent(first, super_start, below, parents),
        n_children=np.bincount(parents, minlength=len(tops) + 1)[:-1],
        of_place=of_rank[by_place],
    )


def _inverse_permutation(order: np.ndarray) -> np.ndarray:
    """Where each of n things stands in an order (n,) of them."""
    result = np.zeros(len(order), dtype=np.int64)
    result[order] = np.arange(len(order))
    return result


@kernel
def _joined(parent, n_below, max_zeros, max_small):  # pragma: no cover
    """The last column of the supernode that each column is in."""
    n = len(parent)
    into = np.arange(n)
    width = np.ones(n, np.int64)
    filled = (n_below + 1).astype(np.float64)  # blocks that are not zero
    for k in range(n):
        p = parent[k]
        if p == n:
            continue
        joined = width[k] + width[p]
        stored = joined * (joined + 1) / 2 + joined * n_below[p]
        if joined <= max_small or stored - filled[k] - filled[p] <= max_zeros * stored:
            into[k] = p
            width[p] = joined
            filled[p] += filled[k]
    for k in range(n - 1, -1, -1):
        into[k] = into[into[k]]
    return into


@kernel
def _postorder(parent):  # pragma: no cover
    """Nodes of a forest, children before parents and subtrees in one piece; roots have parent n."""
    n = len(parent)
    child, sibling = np.full(n + 1, -1), np.full(n, -1)
    for v in range(n - 1, -1, -1):
        sibling[v] = child[parent[v]]
        child[parent[v]] = v
    sequence, n_done = np.zeros(n, np.int64), 0
    v = child[n]
    while v >= 0:
        while child[v] >= 0:
            below = child[v]
            child[v] = -1  # entered
            v = below
        sequence[n_done] = v
        n_done += 1
        if sibling[v] >= 0:
            v = sibling[v]
        elif parent[v] < n:
            v = parent[v]
        else:
            v = -1
    return sequence


@kernel
def _rows_in_parent(first, start, below, parents):  # pragma: no cover
    rows = np.zeros(len(below), np.int64)
    for s in range(len(parents)):
        p = parents[s]
        if p == len(parents):
            continue
        width, at = first[p + 1] - first[p], start[p]
        for k in range(start[s], start[s + 1]):
            if below[k] < first[p + 1]:
                rows[k] = below[k] - first[p]
            else:
                while below[at] != below[k]:
                    at += 1
                rows[k] = width + at - start[p]
    return rows
