"""Conjugate gradients for the normal equations, where loops would fill a factor."""

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded


def solve_banded_cg(
    matrix: sparse.bsr_array,
    band: np.ndarray,
    added: np.ndarray,
    right: np.ndarray,
    tolerance: float = 1e-6,
    max_iterations: int = 500,
) -> np.ndarray:
    """Solve (matrix + diag(added)) x = right by conjugate gradients.

    Preconditioned with the Cholesky factor of the band near the diagonal, which is the whole of the
    matrix for a path without loops: iterations are spent on loops alone.

    Args:
        matrix: (m, m).
        band: its band, LAPACK's lower form.
        added: (m,) what is added to its diagonal.
        right: (m,).
        tolerance: residual, as a share of the right side, in the norm of the preconditioner.
        max_iterations: the best so far is returned when they run out; damped least squares copes with
            inexact steps.
    """
    factor = _factor_band(band, added)
    x = np.zeros_like(right)
    residual = right.copy()
    preconditioned = cho_solve_banded((factor, True), residual, check_finite=False)
    direction = preconditioned.copy()
    size = first = float(residual @ preconditioned)
    for _ in range(max_iterations):
        if size <= tolerance**2 * first or size == 0.0:
            break
        image = matrix @ direction + added * direction
        length = size / float(direction @ image)
        x += length * direction
        residual -= length * image
        preconditioned = cho_solve_banded((factor, True), residual, check_finite=False)
        previous, size = size, float(residual @ preconditioned)
        direction = preconditioned + (size / previous) * direction
    return x


def _factor_band(band: np.ndarray, added: np.ndarray) -> np.ndarray:
    """Cholesky factor of a band with `added` on its diagonal.

    A band cut out of a positive definite matrix need not be positive definite: the diagonal is raised
    until it is.
    """
    raised = 0.0
    for _ in range(20):
        shifted = band.copy()
        shifted[0] += added + raised * np.maximum(band[0], 0.0)
        try:
            return cholesky_banded(shifted, lower=True, overwrite_ab=True, check_finite=False)
        except LinAlgError:
            raised = max(1e-3, 4.0 * raised)
    shifted = np.zeros((1, band.shape[1]))
    shifted[0] = np.sqrt(band[0] + added)
    return shifted
