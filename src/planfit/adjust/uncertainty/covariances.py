"""Covariances of poses: what residuals say of each term, and of what all frames share, carried to the poses.

The adjustment weighs its terms by the sigmas that it was given; what comes out of it errs by what they
really are. With H the normal equations, cov = H^-1 (sum of f_t H_t + sum of tau_t^2 g g^T) H^-1 + S C S^T:
f_t and tau_t are a term's spreads (`spreads`), g pulls of its clusters, C the covariance of what all frames
share and S how poses follow it (consider covariance analysis: Bierman, Factorization Methods for Discrete
Sequential Estimation, 1977).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammainc, gammaincinv

from planfit.adjust.rigid_motion import rigid_tangents
from planfit.adjust.uncertainty.error_model import ErrorModel
from planfit.runtime import blas_on_one_thread, in_threads


@dataclass(frozen=True)
class SharedError:
    """What all frames share and is not known exactly: the sensor, the scales of odometry and plan."""

    covariance: Float[np.ndarray, "s s"]
    """Of the shared parameters."""
    pose_by_shared: Float[np.ndarray, "u 6 s"]
    """How poses follow them, tangents as in `planfit.geometry.se3`."""

    def of_poses(self, idx: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 6 6"]:
        """Covariances of some poses by it."""
        by = self.pose_by_shared[idx]
        return by @ self.covariance @ np.swapaxes(by, 1, 2)


def pose_covariances(
    model: ErrorModel,
    unknowns: Float[np.ndarray, "u 4 4"],
    idx: Int[np.ndarray, " k"],
    shared: SharedError | None = None,
) -> Float[np.ndarray, "k 6 6"]:
    """Covariances [rad^2, rad m, m^2] of some poses, tangents (rotation, translation), target axes.

    Where nothing fixed holds the whole, what remains once the positions asked for are brought to the true
    ones by one rigid motion (the S-transformation of geodetic networks, Baarda 1973). Where something holds
    it, but for some motions (height, if the floor takes no part), by one of those.

    Args:
        unknowns: of the problem that it is of.
        shared: what all frames share; None where that is known, or nothing.
    """
    if model.free.shape[1] > 0:
        return _aligned(model, unknowns, idx, shared)

    def of_camera(i: int) -> np.ndarray:
        solved = model.factors.columns(6 * i + np.arange(6))
        by_clusters = model.shared.T @ solved
        return solved.T @ (model.noise @ solved) + by_clusters.T @ by_clusters

    with blas_on_one_thread():
        covariances = np.stack(in_threads(of_camera, idx.tolist()))
    if shared is not None:
        covariances += shared.of_poses(idx)
    return 0.5 * (covariances + np.swapaxes(covariances, 1, 2))


def _aligned(
    model: ErrorModel,
    unknowns: Float[np.ndarray, "u 4 4"],
    idx: Int[np.ndarray, " k"],
    shared: SharedError | None,
) -> Float[np.ndarray, "k 6 6"]:
    rows, k = (6 * idx[:, None] + np.arange(6)).ravel(), len(idx)
    solved = model.factors.columns(rows)
    by_clusters = model.shared.T @ solved
    whole = solved.T @ (model.noise @ solved) + by_clusters.T @ by_clusters
    if shared is not None:
        by = shared.pose_by_shared[idx].reshape(6 * k, -1)
        whole += by @ shared.covariance @ by.T
    without = _without_rigid(unknowns[idx, :3, 3], model.free)
    left = (without @ whole @ without.T).reshape(k, 6, k, 6)
    return np.einsum("kikj->kij", left)


def _without_rigid(
    positions: Float[np.ndarray, "k 3"], free: Float[np.ndarray, "6 f"]
) -> Float[np.ndarray, "u u"]:
    """Takes out of the poses' tangents those of free rigid motions that their positions ask for."""
    k, f = len(positions), free.shape[1]
    moved = rigid_tangents(positions) @ free
    fit = np.zeros((f, k, 6))
    fit[:, :, 3:] = np.linalg.pinv(moved[:, 3:].reshape(3 * k, f)).reshape(f, k, 3)
    return np.eye(6 * k) - moved.reshape(6 * k, f) @ fit.reshape(f, 6 * k)


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
