"""Linear solvers beside our own factorisation: conjugate gradients, and MKL's sparse Cholesky.

Conjugate gradients serve where loops would fill a factor. MKL comes through pypardiso, an extra
(`pip install planfit[fast]`), and threads over cores. pypardiso's own `factorize` and `solve` are for
matrices that are not symmetric, and analyse the pattern at every call; so its phases are called here one by
one, the analysis once a pattern.
"""

import importlib
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from planfit.errors import OptionError

_SYMMETRIC_POSITIVE_DEFINITE = 2
"""Type of matrix `mtype` 2 of MKL PARDISO: real, symmetric, positive definite."""
_ANALYSE, _FACTORISE_AND_SOLVE = 11, 23


def solve_banded_cg(
    matrix: sparse.bsr_array,
    band: Float[np.ndarray, "b m"],
    added: Float[np.ndarray, " m"],
    right: Float[np.ndarray, " m"],
    tolerance: float = 1e-6,
    max_iterations: int = 500,
) -> Float[np.ndarray, " m"]:
    """Solve (matrix + diag(added)) x = right by conjugate gradients.

    Preconditioned with the Cholesky factor of the band near the diagonal, which is the whole of the
    matrix for a path without loops: iterations are spent on loops alone.

    Args:
        matrix: (m, m).
        band: its band, LAPACK's lower form.
        added: what is added to its diagonal.
        right: the right side.
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


class Pardiso:
    """A solver for matrices of one pattern."""

    def __init__(self) -> None:
        """Load the library.

        Raises:
            OptionError: pypardiso or MKL is absent.
        """
        try:
            module = importlib.import_module("pypardiso")
            self._solver: Any = module.PyPardisoSolver(mtype=_SYMMETRIC_POSITIVE_DEFINITE)
        except (ImportError, OSError) as error:
            raise OptionError(
                "solver.linear_solver: expected pypardiso with MKL for 'pardiso', found none "
                f"({error}); run `pip install 'planfit[fast]'`, or use auto"
            ) from error
        self._analysed: sparse.csr_matrix | None = None

    def solve(
        self,
        matrix: sparse.bsr_array,
        added: Float[np.ndarray, " m"],
        right: Float[np.ndarray, " m"],
    ) -> Float[np.ndarray, " m"]:
        """Solve (matrix + diag(added)) x = right.

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        whole = matrix.tocsr() + sparse.diags_array(added, format="csr")
        upper = sparse.csr_matrix(sparse.triu(whole, format="csr"))
        upper.sort_indices()
        try:
            if not _has_pattern_of(upper, self._analysed):  # SciPy drops entries that are zero
                self._phase(_ANALYSE, upper, right)
                self._analysed = upper
            return self._phase(_FACTORISE_AND_SOLVE, upper, right)
        except Exception as error:
            if type(error).__name__ != "PyPardisoError":
                raise
            raise np.linalg.LinAlgError(str(error)) from error

    def _phase(self, phase: int, upper: sparse.csr_matrix, right: np.ndarray) -> np.ndarray:
        self._solver.set_phase(phase)
        return self._solver._call_pardiso(upper, np.asfortranarray(right[:, None])).ravel()

    def __del__(self) -> None:
        """MKL keeps its factors until it is told."""
        if getattr(self, "_analysed", None) is not None:
            self._solver.free_memory(everything=True)


def _has_pattern_of(one: sparse.csr_matrix, other: sparse.csr_matrix | None) -> bool:
    return (
        other is not None
        and np.array_equal(one.indptr, other.indptr)
        and np.array_equal(one.indices, other.indices)
    )
