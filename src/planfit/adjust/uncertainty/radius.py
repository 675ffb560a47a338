"""The radius within which a point lies that a covariance is known of."""

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincinv


def radius_95(covariances: Float[np.ndarray, "k d d"]) -> Float[np.ndarray, " k"]:
    """Radius about the expected point that holds 95 % of a normal distribution, by its covariance; infinite
    where that is.

    The squared distance is taken for a multiple of chi square of the same mean and variance (Satterthwaite
    1946); it is exact where all axes, or all but one of none, are alike, and within 2 % elsewhere.
    """
    mean = np.trace(covariances, axis1=1, axis2=2)
    is_known = np.isfinite(mean)
    if not is_known.all():
        known = np.where(is_known[:, None, None], covariances, 0.0)
        return np.where(is_known, radius_95(known), np.inf)
    square = np.einsum("kij,kij->k", covariances, covariances)
    safe = np.where(mean > 0, mean, 1.0)
    scale = np.where(mean > 0, square / safe, 0.0)
    dof = np.where(mean > 0, safe**2 / np.where(square > 0, square, 1.0), 1.0)
    # Quantile of chi square; scipy.stats, which has it by name, takes half a second to import.
    return np.sqrt(scale * 2 * gammaincinv(dof / 2, 0.95))
