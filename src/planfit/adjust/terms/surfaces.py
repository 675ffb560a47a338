"""Surfaces term: pairs of frames stand to each other as their surfaces say, where these say anything.

Not in the paper. A pair's information matrix is of a rank below 6 where its surfaces leave directions free:
along these it holds nothing (docs/adr/0018-matches-by-geometry.md).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.terms.observation_models import SURFACES, ObservationModel
from planfit.geometry.calibration import PARAMETERS
from planfit.lsq.pose_terms import BetweenTerm
from planfit.lsq.residual_term import WeightedResiduals
from planfit.matching import SurfacePairs


@dataclass(frozen=True)
class SurfaceTerm:
    """Sum over pairs of rho(|departure of the relative pose from the measured one| in sigmas)."""

    measured: SurfacePairs
    model: ObservationModel = SURFACES
    name: str = "surfaces"

    @property
    def pairs(self) -> Int[np.ndarray, "k 2"]:
        """First and second pose of each measurement."""
        return self.measured.pairs

    def reweight(
        self, target_from_cams: Float[np.ndarray, "n 4 4"]
    ) -> tuple[WeightedResiduals, float]:
        """Weights of the pairs at these poses."""
        return self.between.reweight(target_from_cams)

    @cached_property
    def between(self) -> BetweenTerm:
        """The pairs as relative poses that were measured, with their information."""
        return BetweenTerm(
            pairs=self.measured.pairs,
            first_from_second=self.measured.a_from_b,
            information=of_departures(self.measured),
            loss=self.model.loss,
            weight=self.model.weight,
            name=self.name,
        )

    def by_sensor(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "k 6 7"]:
        """Derivatives of the departures by the sensor's parameters (`geometry.calibration.PARAMETERS`).

        A departure is R_m^T (w, v) from the measured motion, which follows the sensor; and the sigma of its
        translation grows with the points, else shrinking them would always pay.
        """
        measured, residuals = self.measured, self.between.rows.residuals(target_from_cams)
        to_second = np.swapaxes(measured.a_from_b[:, :3, :3], 1, 2)
        moved = np.concatenate(
            [to_second @ measured.by_sensor[:, :3], to_second @ measured.by_sensor[:, 3:]], axis=1
        )
        # Of the logarithm of the stretch along rays: depth's scale and quadratic.
        grown = np.zeros((len(measured), len(PARAMETERS)))
        grown[:, PARAMETERS.index("depth_scale")] = 1.0
        grown[:, PARAMETERS.index("depth_quadratic_per_m")] = 2.0 * measured.distance_m
        moved[:, 3:] += residuals[:, 3:, None] * grown[:, None, :]
        return -moved


def of_departures(pairs: SurfacePairs) -> Float[np.ndarray, "p 6 6"]:
    """Information of what `BetweenTerm` calls a departure, from that of the tangent.

    The tangent (w, v) has the axes of the first frame, a departure R^T w, R^T v those of the second.
    """
    axes = np.zeros((len(pairs), 6, 6))
    axes[:, :3, :3] = axes[:, 3:, 3:] = pairs.a_from_b[:, :3, :3]
    turned = np.swapaxes(axes, 1, 2) @ pairs.information @ axes
    return 0.5 * (turned + np.swapaxes(turned, 1, 2))
