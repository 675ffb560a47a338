"""How sure poses and wall offsets are: blocks of the inverse of the normal equations."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from planfit.errors import OptionError
from planfit.lsq.linear.normal_equations import NormalEquations
from planfit.lsq.term import Term

MAX_SPREAD = 100.0
"""A spread beyond this many metres or radians means that nothing holds the pose."""


def covariances(terms: Sequence[Term], unknowns: np.ndarray, idx: np.ndarray) -> np.ndarray:
    """Covariances (k, 6, 6) [rad^2, rad m, m^2] of some unknowns, in the axes of their tangents.

    At the minimum of the terms, with their robust weights there. They are as true as the spreads and
    readings that the terms were given: nothing is scaled by the residuals found. One sparse
    factorisation, then six solves an unknown.

    Args:
        terms: those of the solve.
        unknowns: (n, 4, 4) where it ended; poses, and faces behind them if they have offsets.
        idx: (k,) which of them.

    Raises:
        OptionError: nothing holds one of them; add an anchor, a plan or a prior.
    """
    quadratics = [term.reweight(unknowns)[0] for term in terms]
    equations = NormalEquations([q.normal_blocks(unknowns) for q in quadratics], len(unknowns))
    scale = np.sqrt(np.maximum(equations.diagonal, 1e-12 * max(equations.diagonal.max(), 1e-300)))
    # To unit diagonal: radians and metres, near and far, then share one floor.
    inverse_scale = sparse.diags_array(1.0 / scale)
    unit = inverse_scale @ equations.matrix.tocsc() @ inverse_scale
    size = len(scale)
    factors = splu(
        (unit + 1e-12 * sparse.eye_array(size)).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    result = np.zeros((len(idx), 6, 6))
    for k, i in enumerate(idx):
        columns = np.zeros((size, 6))
        rows = 6 * int(i) + np.arange(6)
        columns[rows, np.arange(6)] = 1.0 / scale[rows]
        block = factors.solve(columns)[rows] / scale[rows, None]
        result[k] = 0.5 * (block + block.T)
        spread = np.sqrt(np.abs(np.diagonal(result[k])).max())
        if not spread < MAX_SPREAD:
            raise OptionError(
                f"covariances: expected every unknown to be held by some term, found unknown {i} "
                f"free (spread {spread:.2g}); add an anchor, a plan or the trajectory prior"
            )
    return result


def offset_sigmas(
    terms: Sequence[Term], unknowns: np.ndarray, idx: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Standard deviations (k,) m of the offsets of the faces that are unknowns `idx` (k,), normals (k, 2)."""
    shift = covariances(terms, unknowns, idx)[:, 3:5, 3:5]
    return np.sqrt(np.einsum("fi,fij,fj->f", normals, shift, normals))
