"""How far off a point may lie that a covariance is known of."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammainc, gammaincinv


def radius_95(covariances: Float[np.ndarray, "k d d"]) -> Float[np.ndarray, " k"]:
    """Radius about the expected point that holds 95 % of a normal distribution, by its covariance; infinite
    where that is.

    The squared distance is taken for a multiple of chi square of the same mean and variance (Satterthwaite
    1946); it is exact where all axes, or all but one of none, are alike, and within 2 % elsewhere.
    """
    scale, dof, is_known = _chi_square_alike(covariances)
    # Quantile of chi square; scipy.stats, which has it by name, takes half a second to import.
    return np.where(is_known, np.sqrt(scale * 2 * gammaincinv(dof / 2, 0.95)), np.inf)


def probability_within(
    covariances: Float[np.ndarray, "k d d"], radius: float
) -> Float[np.ndarray, " k"]:
    """Probability that the point lies within a radius about the expected one, as `radius_95` has it; zero
    where a covariance is infinite.
    """
    scale, dof, is_known = _chi_square_alike(covariances)
    within = gammainc(dof / 2, radius**2 / np.maximum(2 * scale, np.finfo(float).tiny))
    return np.where(is_known, within, 0.0)


def _chi_square_alike(
    covariances: Float[np.ndarray, "k d d"],
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
    """Factor and degrees of freedom of the chi square that squared distances are like, and whether they are
    known at all."""
    mean = np.trace(covariances, axis1=1, axis2=2)
    is_known = np.isfinite(mean)
    known = np.where(is_known[:, None, None], covariances, 0.0)
    mean = np.where(is_known, mean, 0.0)
    square = np.einsum("kij,kij->k", known, known)
    safe = np.where(mean > 0, mean, 1.0)
    scale = np.where(mean > 0, square / safe, 0.0)
    dof = np.where(mean > 0, safe**2 / np.where(square > 0, square, 1.0), 1.0)
    return scale, dof, is_known
