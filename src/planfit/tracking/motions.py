"""Measured motions between neighbouring frames, how sure they are, and how far recorded ones depart."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching import SurfacePairs
from planfit.matching.relative_motions import VerifiedPairs
from planfit.matching.types import PairRows
from planfit.matching.verify import match_sigma
from planfit.priors import SAME_MOTION_SIGMAS
from planfit.scan.odometry import Odometry

EFFECTIVE_MATCHES = 20.0
"""Matches of a pair are worth at most so many independent ones: neighbours in the image share the error of
depth and of the clock. With it, motions of ConSLAM depart from true ones by 1.2 sigmas in the median of six
numbers and 2.5 in the ninth decile, where 2.3 and 3.3 would be exact."""
FLOOR_DEG, FLOOR_M = 0.1, 0.01
"""No measured motion is surer than this, each axis: exposure takes its time, and clocks differ."""
FREE = 1e-2
"""Information (1 / m^2, 1 / rad^2) in directions that surfaces leave free."""
MAX_SIGMAS = SAME_MOTION_SIGMAS.value
"""Measured motions that depart by more (norm of six numbers) contradict the recorded ones."""
MIN_MATCHES_ALONE = 50
"""A measured motion that no other one confirms needs as many matches to correct a step."""
FREEDOM = 6.0
"""Degrees of freedom of the t-distribution of departures: broken steps and false motions are far out in
its tails, and hardly count."""
_MIN_MOTIONS = 30
"""Fewer motions do not tell a tracker's noise."""
_FACTORS = np.geomspace(1.0, 16.0, 17)
"""Factors tried, a fifth apart."""


@dataclass(frozen=True)
class MeasuredMotions(PairRows):
    """Motions between frames near each other in time, from images and depth alone."""

    pairs: Int[np.ndarray, "p 2"]
    """Frame indices, first < second."""
    a_from_b: Float[np.ndarray, "p 4 4"]
    """m, camera frames."""
    covariance: Float[np.ndarray, "p 6 6"]
    """Of the tangent (rotation, translation; rad, m) in the axes of the first frame."""
    n_inliers: Int[np.ndarray, " p"]
    """Matches that agree with each."""


def measured_motions(verified: VerifiedPairs) -> MeasuredMotions:
    """Motions of verified pairs, with the covariance that their matched points give them."""
    relative = verified.relative_poses
    covariance = np.zeros((len(relative), 6, 6))
    floor = np.repeat([np.deg2rad(FLOOR_DEG) ** 2, FLOOR_M**2], 3)
    for k, (a, b) in enumerate(zip(verified.points_a, verified.points_b, strict=True)):
        sigma = match_sigma(a, b)
        worth = min(1.0, EFFECTIVE_MATCHES / len(a))
        information = _information(relative.a_from_b[k], b, sigma) * worth
        # A little of the identity: points on one spot leave rotations open, which must stay invertible.
        covariance[k] = np.linalg.inv(information + np.eye(6)) + np.diag(floor)
    return MeasuredMotions(relative.pairs, relative.a_from_b, covariance, relative.n_inliers)


def surface_motions(surfaces: SurfacePairs) -> MeasuredMotions:
    """Motions of pairs matched by their surfaces; of ten radians and metres in directions left free."""
    floor = np.repeat([np.deg2rad(FLOOR_DEG) ** 2, FLOOR_M**2], 3)
    covariance = np.linalg.inv(surfaces.information + FREE * np.eye(6)) + np.diag(floor)
    n_inliers = np.full(len(surfaces), int(EFFECTIVE_MATCHES))
    return MeasuredMotions(surfaces.pairs, surfaces.a_from_b, covariance, n_inliers)


def over_told_steps(motions: MeasuredMotions, is_told: Bool[np.ndarray, " s"]) -> MeasuredMotions:
    """Motions that lead over recorded steps which say something; all, where these are less than half."""
    n_void = np.concatenate([[0], np.cumsum(~is_told)])
    over = n_void[motions.pairs[:, 1]] == n_void[motions.pairs[:, 0]]
    return motions[np.flatnonzero(over)] if 2 * over.sum() >= len(over) else motions


def departures(motions: MeasuredMotions, world_from_cams: Poses) -> Float[np.ndarray, "p 6"]:
    """Tangents from the motions that poses give to the measured ones, in the axes of the first frame."""
    i, j = motions.pairs.T
    recorded = se3.inverse(world_from_cams[i]) @ world_from_cams[j]
    return se3.difference(motions.a_from_b, recorded)


def expected_covariance(
    motions: MeasuredMotions, odometry: Odometry, factors: tuple[float, float] = (1.0, 1.0)
) -> Float[np.ndarray, "p 6 6"]:
    """Covariance of `departures`, of measurement and tracker together.

    `factors` on the tracker's sigmas, of rotation and translation; a rotation's error also swings what
    follows, so its factor goes into both.
    """
    first, last = motions.pairs.T
    rotation, translation = odometry.sigma_between(first, last)
    steps = np.concatenate([[0.0], np.cumsum(odometry.sigma_translation**2)])
    of_steps = steps[last] - steps[first]
    of_swing = np.maximum(translation**2 - of_steps, 0.0)
    result = motions.covariance.copy()
    axes = np.arange(3)
    result[:, axes, axes] += (factors[0] * rotation)[:, None] ** 2
    result[:, axes + 3, axes + 3] += (factors[1] ** 2 * of_steps + factors[0] ** 2 * of_swing)[
        :, None
    ]
    return result


def squared_sigmas(
    residual: Float[np.ndarray, "p d"], covariance: Float[np.ndarray, "p d d"]
) -> Float[np.ndarray, " p"]:
    """Squared Mahalanobis norm of each residual."""
    return np.einsum(
        "pi,pi->p", residual, np.linalg.solve(covariance, residual[:, :, None])[..., 0]
    )


def _information(a_from_b: np.ndarray, points_b: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Normal equations (6, 6) of a motion, of matched points (m, 3) with sigma (m,) each axis.

    A tangent (w, v) moves R p + t by w x (R p) + v: its derivative is [-skew(R p), I].
    """
    weight = 1.0 / sigma**2
    rotated = points_b @ a_from_b[:3, :3].T
    lever = se3.skew(weight @ rotated)
    result = np.zeros((6, 6))
    # sum w skew(q)^T skew(q) = (sum w |q|^2) I - sum w q q^T
    scatter = (rotated * weight[:, None]).T @ rotated
    result[:3, :3] = np.trace(scatter) * np.eye(3) - scatter
    result[:3, 3:], result[3:, :3] = lever, lever.T
    result[3:, 3:] = weight.sum() * np.eye(3)
    return result


def noise_factors(
    world_from_cams: Poses, odometry: Odometry, motions: MeasuredMotions
) -> tuple[float, float]:
    """Factors on the sigmas of rotation and translation of all steps, 1 or more.

    The most likely ones under a multivariate t-distribution of the departures (Lange, Little and Taylor
    1989). Measured motions are taken as little sure rather than too sure, so the factor of rotations, which
    images of a few points tell badly, comes out low: at six times the drift on ConSLAM 2.4 of 3.3.
    """
    if len(motions) < _MIN_MOTIONS:
        return 1.0, 1.0
    residual = departures(motions, world_from_cams)

    def cost(factors: tuple[float, float]) -> float:
        covariance = expected_covariance(motions, odometry, factors)
        squared = squared_sigmas(residual, covariance)
        log_volume = np.linalg.slogdet(covariance)[1]
        tail = (FREEDOM + 6.0) * np.log1p(squared / FREEDOM)
        return float(np.sum(log_volume + tail))

    rotation, translation = 1.0, 1.0
    for _ in range(2):  # each in turn: the two hardly depend on each other
        translation = float(_FACTORS[np.argmin([cost((rotation, f)) for f in _FACTORS])])
        rotation = float(_FACTORS[np.argmin([cost((f, translation)) for f in _FACTORS])])
    return rotation, translation
