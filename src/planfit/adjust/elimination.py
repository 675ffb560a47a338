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
class Elimination:
    """An order of poses for a Cholesky factorisation, and what it costs."""

    order: (
        np.ndarray
    )  # (n,) poses, first eliminated first; those left when the count ended come last
    work: float
    """Multiplications of 6x6 blocks, about; infinite where the count ended at its limit."""


def eliminate(rows: np.ndarray, columns: np.ndarray, n_poses: int, max_work: float) -> Elimination:
    """Minimum-degree order of the graph with edges `rows`, `columns` (b,), and its work up to `max_work`."""
    off = rows != columns
    first = np.concatenate([rows[off], columns[off]])
    second = np.concatenate([columns[off], rows[off]])
    by_first = np.argsort(first, kind="stable")
    start = np.searchsorted(first[by_first], np.arange(n_poses + 1))
    order, work = _minimum_degree(start, second[by_first], float(max_work))
    return Elimination(order, work)


@numba.njit(cache=True, nogil=True)
def _minimum_degree(start, neighbours, max_work):  # pragma: no cover
    """Order, and its work; edges are (start, neighbours), each in both directions and once."""
    n = len(start) - 1
    begin, count = start[:-1].copy(), np.diff(start)
    pool = np.zeros(4 * len(neighbours) + 1024, np.int64)
    pool[: len(neighbours)] = neighbours
    end = len(neighbours)
    is_done, mark, stamp = np.zeros(n, np.bool_), np.zeros(n, np.int64), 0
    order = np.zeros(n, np.int64)
    heap = [(count[v], v) for v in range(n)]
    heapq.heapify(heap)
    work, n_done = 0.0, 0
    while n_done < n:
        degree, v = heapq.heappop(heap)
        if is_done[v] or degree != count[v]:
            continue  # its degree has changed since
        left = n - n_done
        if degree == left - 1:  # everything is a neighbour of everything: no order is better
            work += left**3 / 6.0
        else:
            work += 0.5 * (degree + 1) ** 2
        if work > max_work or degree == left - 1:
            for u in range(n):
                if not is_done[u]:
                    order[n_done] = u
                    n_done += 1
            return order, work if work <= max_work else np.inf
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
    return order, work


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
