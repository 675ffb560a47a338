"""The normal equations of a least-squares step: 6x6 blocks, one row of blocks a pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu


@dataclass(frozen=True)
class NormalBlocks:
    """A term's share of J^T J and J^T r; tangent vectors as in `planfit.geometry.se3`."""

    rows: np.ndarray  # (b,) pose of each block's rows
    columns: np.ndarray  # (b,) pose of each block's columns; rows <= columns
    blocks: (
        np.ndarray
    )  # (b, 6, 6); blocks off the diagonal stand for themselves and their transpose
    gradient: np.ndarray  # (n, 6)


def sum_by_pose(idx: np.ndarray, values: np.ndarray, n_poses: int) -> np.ndarray:
    """Sum values (k, ...) into their poses: (n_poses, ...)."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    pick = sparse.csr_array(
        (np.ones(len(idx)), (idx, np.arange(len(idx)))), shape=(n_poses, len(idx))
    )
    return (pick @ flat).reshape(n_poses, *values.shape[1:])


class NormalEquations:
    """Sum of all terms' blocks, solved by sparse Cholesky-like LU with a fixed minimum-degree order."""

    def __init__(self, parts: Sequence[NormalBlocks], n_poses: int) -> None:
        """Sum `parts`; poses without any block get a zero row."""
        rows = np.concatenate([p.rows for p in parts])
        columns = np.concatenate([p.columns for p in parts])
        blocks = np.concatenate([p.blocks for p in parts])
        self.gradient = np.sum([p.gradient for p in parts], axis=0)
        off = rows != columns
        every_row = np.concatenate([rows, columns[off]])
        every_column = np.concatenate([columns, rows[off]])
        every_block = np.concatenate([blocks, np.swapaxes(blocks[off], 1, 2)])
        inner = np.arange(6)
        r = np.repeat(every_row[:, None] * 6 + inner, 6, axis=1).ravel()
        c = np.tile(every_column[:, None] * 6 + inner, 6).ravel()
        size = 6 * n_poses
        self.matrix = sparse.coo_array((every_block.ravel(), (r, c)), shape=(size, size)).tocsc()
        self.diagonal = self.matrix.diagonal()

    def step(self, damping: float) -> np.ndarray:
        """Damped step (n, 6): (H + damping * D) delta = -gradient, D the diagonal of H (Marquardt).

        Directions that nothing measures have a zero diagonal; a floor on D keeps them still.
        """
        floor = 1e-9 * max(float(self.diagonal.max()), 1e-12)
        damped = self.matrix + sparse.diags_array(
            damping * np.maximum(self.diagonal, floor) + floor, format="csc"
        )
        # Symmetric mode: the matrix is positive definite, so pivots stay on the diagonal.
        factors = splu(
            damped.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        return factors.solve(-self.gradient.ravel()).reshape(-1, 6)

    def predicted_decrease(self, delta: np.ndarray) -> float:
        """How much half the squared residuals fall by a step, if they are linear."""
        flat = delta.ravel()
        return float(-(self.gradient.ravel() @ flat) - 0.5 * flat @ (self.matrix @ flat))
