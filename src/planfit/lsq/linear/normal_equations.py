"""The normal equations of a least-squares step: 6x6 blocks, one row of blocks a pose."""

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy import sparse

from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.linear.block_cholesky import BlockFactor
from planfit.lsq.linear.block_pattern import BlockPattern
from planfit.lsq.linear.solvers import solve_banded_cg

LinearSolver = Literal["auto", "direct", "cg", "pardiso"]
"""How a step is solved for: factorisation, conjugate gradients, or the one that suits the pattern."""


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
