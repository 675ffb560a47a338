"""In which order poses are eliminated, and how much work that is: counted on the graph of blocks alone.

Minimum degree: the pose with the fewest neighbours goes next, and its neighbours become neighbours of
each other. The graph of blocks has a sixth of the matrix's rows and a thirty-sixth of its entries,
and the count ends where the work exceeds what a caller would pay.
"""

import heapq
from dataclasses import dataclass

import numba
import numpy as np


@dataclass(frozen=True)
class FillReducingOrdering:
    """An order of poses for a Cholesky factorisation, and what it costs."""

    order: np.ndarray  # (n,) poses, first eliminated first
    start: (
        np.ndarray
    )  # (n + 1,): neighbours of the k-th pose when it goes are start[k]:start[k + 1]
    neighbours: np.ndarray  # (l,) poses; with their pose, the blocks of a column of the factor
    runtime: float
    """Multiplications of 6x6 blocks, about."""


def eliminate(
    rows: np.ndarray, columns: np.ndarray, n_poses: int, max_work: float
) -> FillReducingOrdering | None:
    """Minimum-degree order of the graph with edges `rows`, `columns` (b,); None beyond `max_work`."""
    off = rows != columns
    first = np.concatenate([rows[off], columns[off]])
    second = np.concatenate([columns[off], rows[off]])
    by_first = np.argsort(first, kind="stable")
    start = np.searchsorted(first[by_first], np.arange(n_poses + 1))
    order, counts, neighbours, runtime = _minimum_degree(start, second[by_first], float(max_work))
    if runtime > max_work:
        return None
    starts = np.concatenate([[0], np.cumsum(counts)])
    return FillReducingOrdering(order, starts, neighbours[: starts[-1]], runtime)


@numba.njit(cache=True, nogil=True)
def _minimum_degree(start, neighbours, max_work):  # pragma: no cover
    """Order, neighbours at each elimination, and work; edges are (start, neighbours), both ways."""
    n = len(start) - 1
    begin, count = start[:-1].copy(), np.diff(start)
    pool = np.zeros(4 * len(neighbours) + 1024, np.int64)
    pool[: len(neighbours)] = neighbours
    end = len(neighbours)
    is_done, mark, stamp = np.zeros(n, np.bool_), np.zeros(n, np.int64), 0
    order = np.zeros(n, np.int64)
    heap = [(count[v], v) for v in range(n)]
    heapq.heapify(heap)
    runtime, n_done = 0.0, 0
    counts, columns, n_columns = np.zeros(n, np.int64), np.zeros(len(neighbours) + 16, np.int64), 0
    while n_done < n:
        degree, v = heapq.heappop(heap)
        if is_done[v] or degree != count[v]:
            continue  # its degree has changed since
        left = n - n_done
        if degree == left - 1:  # everything is a neighbour of everything: no order is better
            runtime += left**3 / 6.0
        else:
            runtime += 0.5 * (degree + 1) ** 2
        if runtime > max_work:
            return order, counts, columns, runtime
        needed = left * (left - 1) // 2 if degree == left - 1 else degree
        if n_columns + needed > len(columns):
            grown = np.zeros(2 * len(columns) + needed, np.int64)
            grown[:n_columns] = columns[:n_columns]
            columns = grown
        if degree == left - 1:
            rest = n_done
            for u in range(n):
                if not is_done[u]:
                    order[n_done] = u
                    n_done += 1
            for k in range(rest, n):
                counts[k] = n - 1 - k
                columns[n_columns : n_columns + counts[k]] = order[k + 1 :]
                n_columns += counts[k]
            return order, counts, columns, runtime
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
        clique = pool[begin[v] : begin[v] + degree]
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
    return order, counts, columns, runtime


@numba.njit(cache=True, nogil=True)
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
