"""Which poses are eliminated together: columns of a factor with the same blocks below them, as one front.

A column of a sparse factor is a handful of 6x6 blocks, too little work for a processor. Columns that
share what lies below them are joined into supernodes (Liu, Ng and Peyton 1993), and small ones also
where that stores some zeros (Ashcraft and Grimes 1989); each is then one dense matrix, its front.
"""

from dataclasses import dataclass

import numba
import numpy as np

from planfit.lsq.linear.ordering import FillReducingOrdering

MAX_ZEROS = 0.25
"""Share of zeros that joining may leave in a supernode."""
MAX_SMALL = 4
"""Supernodes up to this many poses wide are joined whatever zeros that leaves: calls cost more."""


@dataclass(frozen=True)
class Supernodes:
    """Supernodes in the order of their elimination: children before parents, a subtree in one piece.

    A `place` is a pose's row in the factor. The front of supernode s has the rows of its own places
    `first[s]:first[s + 1]`, then those of `below[start[s]:start[s + 1]]`.
    """

    order: np.ndarray  # (n,) pose at each place
    first: np.ndarray  # (s + 1,)
    start: np.ndarray  # (s + 1,)
    below: np.ndarray  # (l,) places, ascending in each supernode
    in_parent: np.ndarray  # (l,) the row of each of `below` in the front of the supernode's parent
    n_children: np.ndarray  # (s,)
    of_place: np.ndarray  # (n,) supernode of each place


def find_supernodes(elimination: FillReducingOrdering) -> Supernodes:
    """Join the columns of an elimination into supernodes."""
    n = len(elimination.order)
    rank = np.zeros(n, dtype=np.int64)
    rank[elimination.order] = np.arange(n)
    start, near = elimination.start, rank[elimination.neighbours]
    parent = np.full(n, n)
    has_below = np.diff(start) > 0
    if len(near):
        parent[has_below] = np.minimum.reduceat(near, start[:-1][has_below])
    top = _joined(parent, np.diff(start), MAX_ZEROS, MAX_SMALL)
    tops = np.flatnonzero(top == np.arange(n))
    above = parent[tops]
    super_of = np.searchsorted(tops, top)
    super_parent = np.where(above < n, super_of[np.minimum(above, n - 1)], len(tops))
    sequence = _postorder(super_parent)
    turn = np.zeros(len(tops), dtype=np.int64)
    turn[sequence] = np.arange(len(tops))
    of_rank = turn[super_of]
    by_place = np.argsort(of_rank, kind="stable")  # rank at each place
    place = np.zeros(n, dtype=np.int64)
    place[by_place] = np.arange(n)
    first = np.searchsorted(of_rank[by_place], np.arange(len(tops) + 1))
    ends = tops[sequence]
    counts = np.diff(start)[ends]
    super_start = np.concatenate([[0], np.cumsum(counts)])
    taken = np.repeat(start[ends] - super_start[:-1], counts) + np.arange(super_start[-1])
    below = place[near[taken]]
    owner = np.repeat(np.arange(len(tops)), counts)
    below = below[np.lexsort((below, owner))]
    parents = np.append(turn, len(tops))[super_parent[sequence]]
    return Supernodes(
        order=elimination.order[by_place],
        first=first,
        start=super_start,
        below=below,
        in_parent=_rows_in_parent(first, super_start, below, parents),
        n_children=np.bincount(parents, minlength=len(tops) + 1)[:-1],
        of_place=of_rank[by_place],
    )


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
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
