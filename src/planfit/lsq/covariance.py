"""How well poses are determined: blocks of the inverse of the normal equations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.geometry.se3 import Poses
from planfit.lsq.block_cholesky import BlockFactor
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.term import Term
from planfit.runtime.threads import blas_on_one_thread, in_threads

_COLUMNS_AT_A_TIME = 6
"""Right sides that one thread solves for; more at a time take no less."""
FLOORS = (1e-12, 1e-11, 1e-10, 1e-9)
"""On the diagonal of equations at unit diagonal, the first that leaves them definite."""
_MAX_SIGMA = 100.0
"""A standard deviation beyond this many metres or radians means that nothing holds the pose."""


def covariances(
    terms: Sequence[Term], target_from_cams: Poses, idx: Int[np.ndarray, " k"]
) -> Float[np.ndarray, "k 6 6"]:
    """Covariances [rad^2, rad m, m^2] of some poses, by tangents (rotation, translation), target axes.

    At the minimum of the terms, with their robust weights there. They are as true as the sigmas and
    weights that the terms were given: nothing is scaled by the residuals found. One sparse
    factorisation, then six solves a pose.

    Args:
        terms: those of the solve.
        target_from_cams: where it ended.
        idx: which poses are asked for.

    Raises:
        OptionError: nothing holds one of them.
    """
    result = blocks_of_inverse(terms, target_from_cams, idx)
    for k, i in enumerate(idx):
        sigma = np.sqrt(np.abs(np.diagonal(result[k])).max())
        if not sigma < _MAX_SIGMA:
            raise OptionError(
                f"covariances: expected every pose to be held by some term, found pose {i} "
                f"free (sigma {sigma:.2g}); add a pose prior, a plan or the odometry term"
            )
    return result


def blocks_of_inverse(
    terms: Sequence[Term], target_from_cams: Poses, idx: Int[np.ndarray, " k"]
) -> Float[np.ndarray, "k 6 6"]:
    """As `covariances`, huge where nothing holds a pose."""
    blocks = [term.reweight(target_from_cams)[0].normal_blocks(target_from_cams) for term in terms]
    factors = factorised(NormalEquations(blocks, len(target_from_cams)))
    return np.stack([factors.inverse(6 * int(i) + np.arange(6)) for i in idx])


@dataclass(frozen=True)
class Factors:
    """Normal equations, factorised once for many right sides."""

    factor: BlockFactor
    """Of the equations at unit diagonal."""
    scale: Float[np.ndarray, " u"]
    """Root of the diagonal."""

    def solve(self, right: Float[np.ndarray, "u k"]) -> Float[np.ndarray, "u k"]:
        """Columns of H^-1 right; huge where nothing holds a direction."""
        scale = self.scale[:, None]

        def of(first: int) -> np.ndarray:
            return self.factor.solve(right[:, first : first + _COLUMNS_AT_A_TIME] / scale) / scale

        if right.shape[1] <= _COLUMNS_AT_A_TIME:
            return of(0)
        with blas_on_one_thread():
            return np.concatenate(
                in_threads(of, range(0, right.shape[1], _COLUMNS_AT_A_TIME)), axis=1
            )

    def columns(self, rows: Int[np.ndarray, " r"]) -> Float[np.ndarray, "u r"]:
        """Some columns of H^-1."""
        ones = np.zeros((len(self.scale), len(rows)))
        ones[rows, np.arange(len(rows))] = 1.0
        return self.solve(ones)

    def inverse(self, rows: Int[np.ndarray, " r"]) -> Float[np.ndarray, "r r"]:
        """Some rows and columns of H^-1."""
        block = self.columns(rows)[rows]
        return 0.5 * (block + block.T)


def factorised(equations: NormalEquations) -> Factors:
    """Factorise undamped normal equations."""
    scale = np.sqrt(np.maximum(equations.diagonal, 1e-12 * max(equations.diagonal.max(), 1e-300)))
    # To unit diagonal: radians and metres, near and far, then share one floor. Where rounding is larger than
    # that (directions that nothing holds), a higher one: their columns are huge with any of these.
    with blas_on_one_thread():  # as in `solve`: its threads spin between the many small products
        for floor in FLOORS[:-1]:
            try:
                return Factors(equations.factor_by(scale, floor), scale)
            except np.linalg.LinAlgError:
                continue
        return Factors(equations.factor_by(scale, FLOORS[-1]), scale)
