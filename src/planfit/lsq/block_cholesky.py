"""Sparse Cholesky of 6x6 blocks: structure once a pattern, numbers at every step.

Multifrontal (Duff and Reid 1983; Liu 1992): each supernode is a dense matrix that takes up the blocks
of its poses and what its children leave, eliminates its poses, and leaves the rest to its parent. Nearly
all work is products of dense matrices, which BLAS does at a processor's full speed (ADR 6).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.compiled import kernel
from planfit.lsq.ordering import FillReducingOrdering, Supernodes, find_supernodes

_PANEL = 48
"""Columns eliminated at once, 8 poses."""
_TILE = 96
"""Rows of a front updated at once; what lies above the diagonal of a tile is computed for nothing."""


@dataclass(frozen=True)
class BlockFactor:
    """Numbers of a factor; safe to solve with from several threads."""

    nodes: Supernodes
    panels: Float[np.ndarray, " p"]
    """Panel after panel, each as the inverse of its triangle and what is below it."""

    def solve(self, right: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """Solve for several right sides at once, m = 6 n."""
        nodes, k = self.nodes, right.shape[1]
        n = len(nodes.order)
        x = np.ascontiguousarray(right.reshape(n, 6, k)[nodes.order]).reshape(6 * n, k)
        _substitute(nodes.first, nodes.start, nodes.below, self.panels, x)
        result = np.zeros((n, 6, k))
        result[nodes.order] = x.reshape(n, 6, k)
        return result.reshape(6 * n, k)


class BlockCholesky:
    """Where the blocks of the factor are, and where they come from."""

    def __init__(
        self,
        ordering: FillReducingOrdering,
        rows: Int[np.ndarray, " u"],
        columns: Int[np.ndarray, " u"],
    ) -> None:
        """Work out the structure for blocks at (rows, columns), upper triangle, diagonal included."""
        self._nodes = nodes = find_supernodes(ordering)
        n = len(nodes.order)
        place = np.zeros(n, dtype=np.int64)
        place[nodes.order] = np.arange(n)
        first, second = place[rows], place[columns]
        column = np.minimum(first, second)
        node = nodes.of_place[column]
        self._by_node = np.argsort(node, kind="stable")
        self._block_start = np.searchsorted(node[self._by_node], np.arange(len(nodes.first)))
        # An upper block (i, j) is the transpose of the lower block (j, i) that the factor needs,
        # unless the order has swapped the two.
        self._is_transposed = (first < second)[self._by_node]
        self._column = (column - nodes.first[node])[self._by_node]
        row = np.maximum(first, second)[self._by_node]
        self._row = _rows_in_front(nodes.first, nodes.start, nodes.below, self._block_start, row)

    def factorise(
        self, upper: Float[np.ndarray, "u 6 6"], added: Float[np.ndarray, " m"]
    ) -> BlockFactor:
        """Factor of H + diag(added): the blocks of H as given, m = 6 n.

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        nodes = self._nodes
        n = len(nodes.order)
        panels, is_definite = _factorise(
            nodes.first,
            nodes.start,
            nodes.in_parent,
            nodes.n_children,
            self._block_start,
            self._by_node,
            self._is_transposed,
            self._row,
            self._column,
            np.ascontiguousarray(upper),
            added.reshape(n, 6)[nodes.order].ravel(),
        )
        if not is_definite:
            raise np.linalg.LinAlgError("the normal equations are not positive definite")
        return BlockFactor(nodes, panels)


@kernel
def add_blocks(blocks, slot, upper):  # pragma: no cover
    """Add blocks (b, 6, 6) to those of `upper` that they belong to, in place."""
    for b in range(len(blocks)):
        out = upper[slot[b]]
        for r in range(6):
            for c in range(6):
                out[r, c] += blocks[b, r, c]


@kernel
def fill_band(upper, near, rows, columns, band):  # pragma: no cover
    """Enter the blocks `near` the diagonal into a band in LAPACK's lower form, in place."""
    for k in near:
        # An upper block (i, j) is the transpose of the lower block (j, i).
        top, left = 6 * columns[k], 6 * rows[k]
        for r in range(6):
            for c in range(6):
                row, column = top + r, left + c
                if row >= column:
                    band[row - column, column] = upper[k, c, r]


@kernel
def _rows_in_front(first, start, below, block_start, places):  # pragma: no cover
    """The row of blocks that each place has in the front it goes to."""
    rows = np.zeros(len(places), np.int64)
    for s in range(len(first) - 1):
        width = first[s + 1] - first[s]
        for b in range(block_start[s], block_start[s + 1]):
            if places[b] < first[s + 1]:
                rows[b] = places[b] - first[s]
            else:
                within = np.searchsorted(below[start[s] : start[s + 1]], places[b])
                rows[b] = width + within
    return rows


@kernel
def _factorise(
    first,
    start,
    in_parent,
    n_children,
    block_start,
    block,
    is_transposed,
    row,
    column,
    upper,
    added,
):  # pragma: no cover
    """See `BlockFactor`; False where the matrix is not positive definite."""
    size, stack_size = _sizes(first, start, n_children)
    factor, stack = np.zeros(size), np.zeros(stack_size)
    at, top = 0, 0
    child_size = np.zeros(len(first), np.int64)  # of what is on the stack
    n_waiting = 0
    for s in range(len(first) - 1):
        own, rest = 6 * (first[s + 1] - first[s]), 6 * (start[s + 1] - start[s])
        front = np.zeros((own + rest, own + rest))
        for b in range(block_start[s], block_start[s + 1]):
            r, c, source = 6 * row[b], 6 * column[b], upper[block[b]]
            for i in range(6):
                for j in range(6):
                    front[r + i, c + j] = source[j, i] if is_transposed[b] else source[i, j]
        for i in range(own):
            front[i, i] += added[6 * first[s] + i]
        for _ in range(n_children[s]):
            n_waiting -= 1
            child = child_size[n_waiting]
            m = 6 * (start[child + 1] - start[child])
            top -= m * m
            left = stack[top : top + m * m].reshape(m, m)
            _add_child(front, left, in_parent[start[child] : start[child + 1]])
        at = _eliminate_panels(front, own, factor, at)
        if at < 0:
            return factor, False
        if rest:
            left = stack[top : top + rest * rest].reshape(rest, rest)
            for i in range(rest):
                left[i, : i + 1] = front[own + i, own : own + i + 1]
            top += rest * rest
            child_size[n_waiting] = s
            n_waiting += 1
    return factor, True


@kernel
def _sizes(first, start, n_children):  # pragma: no cover
    """Numbers in the factor, and at most on the stack of what children leave."""
    factor, stack, most = 0, 0, 0
    waiting, n_waiting = np.zeros(len(first), np.int64), 0
    for s in range(len(first) - 1):
        own, rest = 6 * (first[s + 1] - first[s]), 6 * (start[s + 1] - start[s])
        for a in range(0, own, _PANEL):
            width = min(_PANEL, own - a)
            factor += width * (own + rest - a)
        for _ in range(n_children[s]):
            n_waiting -= 1
            stack -= waiting[n_waiting]
        if rest:
            waiting[n_waiting] = rest * rest
            n_waiting += 1
            stack += rest * rest
            most = max(most, stack)
    return factor, most


@kernel
def _add_child(front, left, rows):  # pragma: no cover
    """Add what a child leaves, lower triangle, at its rows of blocks in the front."""
    for i in range(len(rows)):
        for j in range(i + 1):
            c = 6 * rows[j]
            for a in range(6):
                into = front[6 * rows[i] + a, c : c + 6]
                added = left[6 * i + a, 6 * j : 6 * j + 6]
                for b in range(6):
                    into[b] += added[b]


@kernel
def _eliminate_panels(front, own, factor, at):  # pragma: no cover
    """Eliminate the first `own` columns in place; where the factor goes on, or -1 if it does not exist."""
    n = len(front)
    for a in range(0, own, _PANEL):
        b = min(a + _PANEL, own)
        width = b - a
        inverse = factor[at : at + width * width].reshape(width, width)
        if not _inverse_of_factor(front[a:b, a:b].copy(), inverse):
            return -1
        at += width * width
        if b == n:
            continue
        below = factor[at : at + width * (n - b)].reshape(n - b, width)
        np.dot(front[b:, a:b].copy(), inverse.T, below)
        at += width * (n - b)
        for tile in range(b, n, _TILE):
            end = min(tile + _TILE, n)
            product = np.dot(below[tile - b : end - b], below[: end - b].T)
            for i in range(end - tile):
                row, subtracted = front[tile + i, b:], product[i]
                for j in range(tile + i + 1 - b):
                    row[j] -= subtracted[j]
    return at


@kernel(fastmath=True)
def _inverse_of_factor(block, inverse):  # pragma: no cover
    """Inverse of the Cholesky factor of a block (its lower triangle is read); False if it has none."""
    n = len(block)
    for j in range(n):
        total = block[j, j]
        for k in range(j):
            total -= block[j, k] * block[j, k]
        if not total > 0.0:
            return False
        pivot = np.sqrt(total)
        block[j, j] = pivot
        for i in range(j + 1, n):
            total = block[i, j]
            for k in range(j):
                total -= block[i, k] * block[j, k]
            block[i, j] = total / pivot
    for i in range(n):
        for j in range(n):
            inverse[i, j] = 0.0
        inverse[i, i] = 1.0
        for k in range(i):
            for j in range(k + 1):
                inverse[i, j] -= block[i, k] * inverse[k, j]
        for j in range(i + 1):
            inverse[i, j] /= block[i, i]
    return True


@kernel
def _substitute(first, start, below, factor, x):  # pragma: no cover
    """Solve in place for the columns of x: forwards with the factor, backwards with its transpose."""
    at = 0
    ends = np.zeros(len(first), np.int64)
    for s in range(len(first) - 1):
        at = _forwards(first, start, below, factor, at, x, s)
        ends[s] = at
    for s in range(len(first) - 2, -1, -1):
        _backwards(first, start, below, factor, ends[s], x, s)


@kernel
def _gathered(first, start, below, x, s):  # pragma: no cover
    """The values of x at the rows of a front."""
    own = 6 * (first[s + 1] - first[s])
    values = np.zeros((own + 6 * (start[s + 1] - start[s]), x.shape[1]))
    values[:own] = x[6 * first[s] : 6 * first[s + 1]]
    for k in range(start[s], start[s + 1]):
        to = own + 6 * (k - start[s])
        values[to : to + 6] = x[6 * below[k] : 6 * below[k] + 6]
    return values


@kernel
def _forwards(first, start, below, factor, at, x, s):  # pragma: no cover
    own = 6 * (first[s + 1] - first[s])
    values = _gathered(first, start, below, x, s)
    n = len(values)
    for a in range(0, own, _PANEL):
        b = min(a + _PANEL, own)
        width = b - a
        inverse = factor[at : at + width * width].reshape(width, width)
        at += width * width
        values[a:b] = np.dot(inverse, values[a:b])
        if b < n:
            panel = factor[at : at + width * (n - b)].reshape(n - b, width)
            values[b:] -= np.dot(panel, values[a:b])
            at += width * (n - b)
    x[6 * first[s] : 6 * first[s + 1]] = values[:own]
    for k in range(start[s], start[s + 1]):
        to = own + 6 * (k - start[s])
        x[6 * below[k] : 6 * below[k] + 6] = values[to : to + 6]
    return at


@kernel
def _backwards(first, start, below, factor, at, x, s):  # pragma: no cover
    """`at` is where the supernode's panels end."""
    own = 6 * (first[s + 1] - first[s])
    values = _gathered(first, start, below, x, s)
    n = len(values)
    for a in range((own - 1) // _PANEL * _PANEL, -1, -_PANEL):
        b = min(a + _PANEL, own)
        width = b - a
        if b < n:
            at -= width * (n - b)
            panel = factor[at : at + width * (n - b)].reshape(n - b, width)
            values[a:b] -= np.dot(panel.T, values[b:])
        at -= width * width
        inverse = factor[at : at + width * width].reshape(width, width)
        values[a:b] = np.dot(inverse.T, values[a:b])
    x[6 * first[s] : 6 * first[s + 1]] = values[:own]
