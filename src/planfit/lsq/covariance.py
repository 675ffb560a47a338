"""How well poses are determined: blocks of the inverse of the normal equations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.lsq.block_cholesky import BlockFactor
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.term import Term
from planfit.runtime.threads import blas_on_one_thread, in_threads

COLUMNS_AT_A_TIME = 6
"""Right sides that one thread solves for; more at a time take no less."""
FLOORS = (1e-12, 1e-11, 1e-10, 1e-9)
"""On the diagonal of equations at unit diagonal, the first that leaves them definite."""
MAX_SIGMA = 100.0
"""A standard deviation beyond this many metres or radians means that nothing holds the pose."""


def covariances(
    terms: Sequence[Term],
    target_from_cams: Float[np.ndarray, "n 4 4"],
    idx: Int[np.ndarray, " k"],
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
    result = _inverse_blocks(terms, target_from_cams, idx, np.arange(6))
    for k, i in enumerate(idx):
        sigma = np.sqrt(np.abs(np.diagonal(result[k])).max())
        if not sigma < MAX_SIGMA:
            raise OptionError(
                f"covariances: expected every pose to be held by some term, found pose {i} "
                f"free (sigma {sigma:.2g}); add a pose prior, a plan or the odometry term"
            )
    return result


def position_covariances(
    terms: Sequence[Term],
    target_from_cams: Float[np.ndarray, "n 4 4"],
    idx: Int[np.ndarray, " k"],
) -> Float[np.ndarray, "k 3 3"]:
    """Covariances (m^2, target axes) of some poses' positions alone: three solves a pose instead of six.

    As `covariances`, but what nothing holds is no error: its covariance is large.
    """
    return _inverse_blocks(terms, target_from_cams, idx, np.arange(3, 6))


def aligned_position_covariances(
    terms: Sequence[Term],
    target_from_cams: Float[np.ndarray, "n 4 4"],
    idx: Int[np.ndarray, " k"],
) -> Float[np.ndarray, "k 3 3"]:
    """Covariances (m^2, target axes) of positions after the rigid motion that brings those asked for closest
    to the true ones.

    What remains where nothing fixed holds the whole: which pose the gauge holds has no say in it (the
    S-transformation of geodetic networks, Baarda 1973).

    Args: as for `covariances`; what nothing holds is no error.
    """
    rows = (6 * idx[:, None] + np.arange(3, 6)).ravel()
    whole = _factors(terms, target_from_cams).inverse(rows)
    positions = target_from_cams[idx, :3, 3]
    lever = positions - positions.mean(axis=0)
    # Positions move by v + w x lever; what lies in the span of that is taken out.
    rigid = np.concatenate([np.broadcast_to(np.eye(3), (len(idx), 3, 3)), -se3.skew(lever)], axis=2)
    rigid = rigid.reshape(-1, 6)
    taken_out = np.eye(len(rows)) - rigid @ np.linalg.pinv(rigid)
    left = (taken_out @ whole @ taken_out.T).reshape(len(idx), 3, len(idx), 3)
    return np.einsum("kikj->kij", left)


def _inverse_blocks(
    terms: Sequence[Term],
    target_from_cams: Float[np.ndarray, "n 4 4"],
    idx: Int[np.ndarray, " k"],
    entries: Int[np.ndarray, " e"],
) -> Float[np.ndarray, "k e e"]:
    """Some entries of the tangents' own blocks of the inverse normal equations."""
    factors = _factors(terms, target_from_cams)
    return np.stack([factors.inverse(6 * int(i) + entries) for i in idx])


def _factors(terms: Sequence[Term], target_from_cams: Float[np.ndarray, "n 4 4"]) -> "Factors":
    quadratics = [term.reweight(target_from_cams)[0] for term in terms]
    n_poses = len(target_from_cams)
    blocks = [q.normal_blocks(target_from_cams) for q in quadratics]
    return factorised(NormalEquations(blocks, n_poses))


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
            return self.factor.solve(right[:, first : first + COLUMNS_AT_A_TIME] / scale) / scale

        if right.shape[1] <= COLUMNS_AT_A_TIME:
            return of(0)
        with blas_on_one_thread():
            return np.concatenate(
                in_threads(of, range(0, right.shape[1], COLUMNS_AT_A_TIME)), axis=1
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
