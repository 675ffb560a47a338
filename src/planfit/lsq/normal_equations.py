"""The normal equations of a least-squares step: 6x6 blocks, one row of blocks a pose.

Where the blocks go is worked out once (`BlockPattern`) and used at every step.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from planfit.lsq.block_cholesky import BlockCholesky, BlockFactor, add_blocks, fill_band
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.linear_solvers import Pardiso, solve_banded_cg
from planfit.lsq.ordering import minimum_degree_ordering

LinearSolver = Literal["auto", "direct", "cg", "pardiso"]
"""How a step is solved for: factorisation, conjugate gradients, or the one that suits the pattern."""
_MAX_BAND_POSES = 12
"""Blocks up to this far from the diagonal go into the band that preconditions: neighbours in time."""
_MAX_DIRECT_WORK = 1e8
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
        self._band = np.flatnonzero(self.columns - self.rows <= _MAX_BAND_POSES)

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
        ordering = minimum_degree_ordering(self.rows, self.columns, self.n_poses, _MAX_DIRECT_WORK)
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
        add_blocks(np.ascontiguousarray(blocks), self._slot[: len(blocks)], upper)
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
        fill_band(upper, near, self.rows, self.columns, band)
        return band


class NormalEquations:
    """Sum of all terms' blocks, and its damped solution."""

    def __init__(
        self, parts: Sequence[NormalBlocks], n_poses: int, earlier: BlockPattern | None = None
    ) -> None:
        """Sum `parts`; the pattern of an `earlier` step is used again where it fits."""
        rows = np.concatenate([p.rows for p in parts])
        columns = np.concatenate([p.columns for p in parts])
        if earlier is None or not earlier.fits(rows, columns, n_poses):
            earlier = BlockPattern(rows, columns, n_poses)
        self.pattern = earlier
        self.gradient = np.sum([p.gradient for p in parts], axis=0)
        self._upper = self.pattern.sum_blocks(np.concatenate([p.blocks for p in parts]))
        self.diagonal = np.diagonal(self._upper[self.pattern.diagonal], axis1=1, axis2=2).ravel()

    @cached_property
    def matrix(self) -> sparse.bsr_array:
        """The whole (6 n, 6 n), sparse in blocks; factorising needs the blocks alone."""
        return self.pattern.symmetric(self._upper)

    def step(self, damping: float, solver: LinearSolver = "auto") -> Float[np.ndarray, "n 6"]:
        """Damped step: (H + damping * D) delta = -gradient, D the diagonal of H (Marquardt).

        Directions that nothing measures have a zero diagonal; a floor on D keeps them still.
        `auto` factorises where the pattern's factor is little work, else iterates.

        Raises:
            numpy.linalg.LinAlgError: rounding has made the matrix indefinite; more damping mends it.
        """
        floor = 1e-9 * max(float(self.diagonal.max()), 1e-12)
        added = damping * np.maximum(self.diagonal, floor) + floor
        right = -self.gradient.ravel()
        if solver == "pardiso":
            return self.pattern.pardiso.solve(self.matrix, added, right).reshape(-1, 6)
        cholesky = None
        if solver == "direct":
            cholesky = self.pattern.any_cholesky
        elif solver == "auto" and not self.pattern.is_banded:
            cholesky = self.pattern.cholesky
        if cholesky is not None:
            return cholesky.factorise(self._upper, added).solve(right[:, None]).reshape(-1, 6)
        band = self.pattern.banded(self._upper)
        return solve_banded_cg(self.matrix, band, added, right).reshape(-1, 6)

    def factor_by(self, scale: Float[np.ndarray, " m"], added: float) -> BlockFactor:
        """Factor of S^-1 H S^-1 + added, with S = diag(scale), whatever the fill.

        Raises:
            numpy.linalg.LinAlgError: rounding has made the matrix indefinite.
        """
        inverse = (1.0 / scale).reshape(-1, 6)
        rows, columns = inverse[self.pattern.rows], inverse[self.pattern.columns]
        scaled = rows[:, :, None] * self._upper * columns[:, None, :]
        return self.pattern.any_cholesky.factorise(scaled, np.full(len(scale), added))

    def predicted_decrease(self, delta: Float[np.ndarray, "n 6"]) -> float:
        """How much half the squared residuals fall by a step, if they are linear."""
        return float(-np.sum(self.gradient * delta) - 0.5 * self.pattern.square(self._upper, delta))
