"""Where the 6x6 blocks of the normal equations go: worked out once, used at every step."""

from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from planfit.compiled import kernel
from planfit.lsq.linear.block_cholesky import BlockCholesky
from planfit.lsq.linear.ordering import minimum_degree_ordering
from planfit.lsq.linear.solvers import Pardiso

MAX_BAND_POSES = 12
"""Blocks up to this far from the diagonal go into the band that preconditions: neighbours in time."""
MAX_DIRECT_WORK = 1e8
"""Products of 6x6 blocks, 3.5 s to factorise. Walks in laps stay below it at 25,000 poses, where conjugate
gradients take 1.5 to 8 s; scattered loops exceed it at 8,000, where they take 0.5 s
(docs/adr/0006-linear-solvers.md)."""


class BlockPattern:
    """Places of the sums of blocks (row, column) of poses, row <= column, and of their transposes."""

    def __init__(
        self, rows: Int[np.ndarray, " b"], columns: Int[np.ndarray, " b"], n_poses: int
    ) -> None:
        """Work out the pattern of the blocks that a sum is made of; every diagonal block is in it."""
        self.n_poses = n_poses
        self._rows, self._columns = rows, columns
        poses = np.arange(n_poses)
        # One number a place, so that a sort of numbers finds blocks at the same place.
        codes = np.concatenate([rows, poses]) * n_poses + np.concatenate([columns, poses])
        unique, self._slot = np.unique(codes, return_inverse=True)
        self.rows, self.columns = unique // n_poses, unique % n_poses
        self.diagonal = np.flatnonzero(self.rows == self.columns)
        off = np.flatnonzero(self.rows != self.columns)
        # Blocks off the diagonal come a second time as their transposes; SciPy wants rows in order.
        every_row = np.concatenate([self.rows, self.columns[off]])
        every_column = np.concatenate([self.columns, self.rows[off]])
        order = np.lexsort((every_column, every_row))
        self._source = np.concatenate([np.arange(len(unique)), off])[order]
        self._is_transposed = (np.arange(len(order)) >= len(unique))[order]
        # As SciPy's own indices, where they fit: half the memory of each matrix made of them.
        kind = np.int32 if 36 * len(order) < np.iinfo(np.int32).max else np.int64
        self._indices = every_column[order].astype(kind)
        self._indptr = np.searchsorted(every_row[order], np.arange(n_poses + 1)).astype(kind)
        self._band = np.flatnonzero(self.columns - self.rows <= MAX_BAND_POSES)

    def fits(
        self, rows: Int[np.ndarray, " b"], columns: Int[np.ndarray, " b"], n_poses: int
    ) -> bool:
        """Whether blocks at these places have this pattern."""
        return (
            n_poses == self.n_poses
            and np.array_equal(rows, self._rows)
            and np.array_equal(columns, self._columns)
        )

    @cached_property
    def is_banded(self) -> bool:
        """Whether the band is all there is: conjugate gradients then factorise it and end at once."""
        return len(self._band) == len(self.rows)

    @cached_property
    def cholesky(self) -> BlockCholesky | None:
        """The factor's structure; None where loops would fill it."""
        ordering = minimum_degree_ordering(self.rows, self.columns, self.n_poses, MAX_DIRECT_WORK)
        if ordering is None:
            return None
        return BlockCholesky(ordering, self.rows, self.columns)

    @cached_property
    def any_cholesky(self) -> BlockCholesky:
        """The same, whatever the fill."""
        if self.cholesky is not None:
            return self.cholesky
        ordering = minimum_degree_ordering(self.rows, self.columns, self.n_poses, np.inf)
        assert ordering is not None  # nothing is beyond infinity
        return BlockCholesky(ordering, self.rows, self.columns)

    @cached_property
    def pardiso(self) -> Pardiso:
        """MKL's solver, its analysis of this pattern kept."""
        return Pardiso()

    def sum_blocks(self, blocks: Float[np.ndarray, "b 6 6"]) -> Float[np.ndarray, "u 6 6"]:
        """Sums of blocks at the same place, in the order of `rows`, `columns`."""
        upper = np.zeros((len(self.rows), 6, 6))
        _add_blocks(np.ascontiguousarray(blocks), self._slot[: len(blocks)], upper)
        return upper

    def square(self, upper: Float[np.ndarray, "u 6 6"], delta: Float[np.ndarray, "n 6"]) -> float:
        """delta^T H delta, of the whole matrix H that `upper` are the blocks of."""
        by_block = np.einsum(
            "ui,uij,uj->u", delta[self.rows], upper, delta[self.columns], optimize=False
        )
        return float(2.0 * by_block.sum() - by_block[self.diagonal].sum())

    def symmetric(self, upper: Float[np.ndarray, "u 6 6"]) -> sparse.bsr_array:
        """The whole matrix (6 n, 6 n), sparse in blocks."""
        data = upper[self._source]
        data[self._is_transposed] = np.swapaxes(data[self._is_transposed], 1, 2)
        size = 6 * self.n_poses
        return sparse.bsr_array((data, self._indices, self._indptr), shape=(size, size))

    def banded(self, upper: Float[np.ndarray, "u 6 6"]) -> Float[np.ndarray, "w m"]:
        """The band near the diagonal in LAPACK's lower form: `band[i - j, j]` is entry (i, j)."""
        near = self._band
        width = int((self.columns[near] - self.rows[near]).max(initial=0))
        band = np.zeros((6 * (width + 1), 6 * self.n_poses))
        _fill_band(upper, near, self.rows, self.columns, band)
        return band


@kernel
def _add_blocks(blocks, slot, upper):  # pragma: no cover
    for b in range(len(blocks)):
        out = upper[slot[b]]
        for r in range(6):
            for c in range(6):
                out[r, c] += blocks[b, r, c]


@kernel
def _fill_band(upper, near, rows, columns, band):  # pragma: no cover
    for k in near:
        # An upper block (i, j) is the transpose of the lower block (j, i).
        top, left = 6 * columns[k], 6 * rows[k]
        for r in range(6):
            for c in range(6):
                row, column = top + r, left + c
                if row >= column:
                    band[row - column, column] = upper[k, c, r]
