"""MKL's sparse Cholesky through pypardiso, an extra (`pip install planfit[fast]`); threads over cores.

pypardiso's own `factorize` and `solve` are for matrices that are not symmetric, and analyse the pattern at
every call; so its phases are called here one by one, the analysis once a pattern.
"""

import importlib
from typing import Any

import numpy as np
from scipy import sparse

from planfit.errors import OptionError

_SYMMETRIC_POSITIVE_DEFINITE = 2
_ANALYSE, _FACTORISE_AND_SOLVE = 11, 23


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

    def solve(self, matrix: sparse.bsr_array, added: np.ndarray, right: np.ndarray) -> np.ndarray:
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
