"""Sparse Cholesky of 6x6 blocks: structure once a pattern, numbers at every step.

Left-looking, column of blocks by column of blocks (George and Liu 1981), in the order of
`planfit.adjust.elimination`. A library's sparse LU sees single numbers, orders them anew at every
call and cannot use symmetry: on 250 poses with loops it takes five times as long (ADR 6).
"""

import numba
import numpy as np

from planfit.adjust.elimination import Elimination


class BlockCholesky:
    """Where the blocks of the factor are, and where they come from."""

    def __init__(self, elimination: Elimination, rows: np.ndarray, columns: np.ndarray) -> None:
        """Work out the structure for blocks at (rows, columns) (u,), upper triangle, diagonal included."""
        n = len(elimination.order)
        self._order = elimination.order
        place = np.zeros(n, dtype=np.int64)
        place[self._order] = np.arange(n)
        self._start = elimination.start
        column = np.repeat(np.arange(n), np.diff(self._start))
        below = place[elimination.neighbours]
        by_column = np.lexsort((below, column))
        self._below = below[by_column]
        # The block of the matrix that each block of the factor begins as; -1: fill.
        off = np.flatnonzero(rows != columns)
        first, second = place[rows[off]], place[columns[off]]
        codes = np.minimum(first, second) * n + np.maximum(first, second)
        by_code = np.argsort(codes)
        wanted = column * n + self._below
        at = np.searchsorted(codes[by_code], wanted).clip(0, max(len(codes) - 1, 0))
        is_there = codes[by_code][at] == wanted if len(codes) else np.zeros(len(wanted), bool)
        source = off[by_code[at]] if len(codes) else np.zeros(len(wanted), dtype=np.int64)
        self._source = np.where(is_there, source, -1)
        # An upper block (i, j) is the transpose of the lower block (j, i) that the factor needs,
        # unless the order has swapped the two.
        self._is_swapped = place[rows[source]] > place[columns[source]]
        diagonal = np.flatnonzero(rows == columns)
        self._diagonal = diagonal[np.argsort(rows[diagonal])][self._order]

    def solve(self, upper: np.ndarray, added: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Solve (H + diag(added)) x = right: blocks (u, 6, 6) of H as given, vectors (6 n,).

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        n = len(self._order)
        on_diagonal = upper[self._diagonal]
        axis = np.arange(6)
        on_diagonal[:, axis, axis] += added.reshape(n, 6)[self._order]
        below = np.where(self._source[:, None, None] >= 0, upper[np.maximum(self._source, 0)], 0.0)
        straight = ~self._is_swapped
        below[straight] = np.swapaxes(below[straight], 1, 2)
        below = np.ascontiguousarray(below)
        if not _factorise(self._start, self._below, on_diagonal, below):
            raise np.linalg.LinAlgError("the normal equations are not positive definite")
        x = right.reshape(n, 6)[self._order].copy()
        _substitute(self._start, self._below, on_diagonal, below, x)
        result = np.zeros_like(x)
        result[self._order] = x
        return result.ravel()


@numba.njit(cache=True, nogil=True, fastmath=True)
def _factorise(start, rows, diagonal, below):  # pragma: no cover
    """Turn blocks of the matrix into those of its factor, in place; False where it has none."""
    n = len(start) - 1
    head, link = np.full(n, -1), np.full(n, -1)  # columns whose next block is in a row
    at = start[:-1].copy()
    slot = np.zeros(n, np.int64)
    turned = np.zeros((6, 6))
    for j in range(n):
        for p in range(start[j], start[j + 1]):
            slot[rows[p]] = p
        k = head[j]
        while k >= 0:
            following, p = link[k], at[k]
            for r in range(6):
                for c in range(6):
                    turned[c, r] = below[p, r, c]
            _subtract_product(diagonal[j], below[p], turned)
            for q in range(p + 1, start[k + 1]):
                _subtract_product(below[slot[rows[q]]], below[q], turned)
            at[k] = p + 1
            if p + 1 < start[k + 1]:
                link[k] = head[rows[p + 1]]
                head[rows[p + 1]] = k
            k = following
        if not _factorise_block(diagonal[j]):
            return False
        for p in range(start[j], start[j + 1]):
            _divide(below[p], diagonal[j])
        if start[j] < start[j + 1]:
            link[j] = head[rows[start[j]]]
            head[rows[start[j]]] = j
    return True


@numba.njit(cache=True, nogil=True, fastmath=True)
def _subtract_product(out, a, b):  # pragma: no cover
    """out -= a b, 6x6."""
    for r in range(6):
        for k in range(6):
            factor = a[r, k]
            for c in range(6):
                out[r, c] -= factor * b[k, c]


@numba.njit(cache=True, nogil=True)
def _factorise_block(block):  # pragma: no cover
    """Cholesky factor of a 6x6 block, in its lower triangle."""
    for j in range(6):
        total = block[j, j]
        for k in range(j):
            total -= block[j, k] * block[j, k]
        if not total > 0.0:
            return False
        pivot = np.sqrt(total)
        block[j, j] = pivot
        for i in range(j + 1, 6):
            total = block[i, j]
            for k in range(j):
                total -= block[i, k] * block[j, k]
            block[i, j] = total / pivot
    return True


@numba.njit(cache=True, nogil=True, fastmath=True)
def _divide(block, factor):  # pragma: no cover
    """block := block factor^-T, with the lower triangle of `factor`."""
    for r in range(6):
        for c in range(6):
            total = block[r, c]
            for k in range(c):
                total -= block[r, k] * factor[c, k]
            block[r, c] = total / factor[c, c]


@numba.njit(cache=True, nogil=True)
def _substitute(start, rows, diagonal, below, x):  # pragma: no cover
    """Solve in place: forwards with the factor, backwards with its transpose."""
    n = len(start) - 1
    for j in range(n):
        for r in range(6):
            total = x[j, r]
            for k in range(r):
                total -= diagonal[j, r, k] * x[j, k]
            x[j, r] = total / diagonal[j, r, r]
        for p in range(start[j], start[j + 1]):
            for r in range(6):
                for c in range(6):
                    x[rows[p], r] -= below[p, r, c] * x[j, c]
    for j in range(n - 1, -1, -1):
        for p in range(start[j], start[j + 1]):
            for r in range(6):
                for c in range(6):
                    x[j, c] -= below[p, r, c] * x[rows[p], r]
        for r in range(5, -1, -1):
            total = x[j, r]
            for k in range(r + 1, 6):
                total -= diagonal[j, k, r] * x[j, k]
            x[j, r] = total / diagonal[j, r, r]
