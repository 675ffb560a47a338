"""How much more a tracker errs than `OdometryOptions` say, by the motions that were measured."""

import numpy as np
from jaxtyping import Float

from planfit.scan.odometry import Odometry
from planfit.tracking.motions import (
    MeasuredMotions,
    departures,
    expected_covariance,
    squared_sigmas,
)

FREEDOM = 6.0
"""Degrees of freedom of the t-distribution of departures: broken steps and false motions are far out in
its tails, and hardly count."""
MIN_MOTIONS = 30
"""Fewer motions do not tell a tracker's noise."""
FACTORS = np.geomspace(1.0, 16.0, 17)
"""Factors tried, a fifth apart."""


def noise_factors(
    world_from_cams: Float[np.ndarray, "n 4 4"], odometry: Odometry, motions: MeasuredMotions
) -> tuple[float, float]:
    """Factors on the sigmas of rotation and translation of all steps, 1 or more.

    The most likely ones under a multivariate t-distribution of the departures (Lange, Little and Taylor
    1989). Measured motions are taken as little sure rather than too sure, so the factor of rotations, which
    images of a few points tell badly, comes out low: at six times the drift on ConSLAM 2.4 of 3.3.
    """
    if len(motions) < MIN_MOTIONS:
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
        translation = float(FACTORS[np.argmin([cost((rotation, f)) for f in FACTORS])])
        rotation = float(FACTORS[np.argmin([cost((f, translation)) for f in FACTORS])])
    return rotation, translation
