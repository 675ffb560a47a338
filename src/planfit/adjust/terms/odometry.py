"""Odometry term: steps between frames are as the tracker recorded them, within its sigma.

Not in the paper. Without it, a frame that has no match and sees no wall floats, and a bundle of wrong
matches deforms the path where nothing else holds it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.terms.observation_models import ObservationModel
from planfit.lsq.pose_terms import BetweenTerm
from planfit.lsq.residual_term import WeightedResiduals
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class OdometryTerm:
    """Sum over steps of rho(|departure of the step from the recorded one| in sigmas).

    Other unknowns may stand behind the cameras.
    """

    odometry: Odometry
    model: ObservationModel
    name: str = "odometry"
    frame_idx: Int[np.ndarray, " n"] | None = None
    """Of the poses given, those between which the recorded steps are; None: the first n."""

    def reweight(
        self, target_from_cams: Float[np.ndarray, "n 4 4"]
    ) -> tuple[WeightedResiduals, float]:
        """Weights of the steps at these poses."""
        return self.between.reweight(target_from_cams)

    @cached_property
    def between(self) -> BetweenTerm:
        """The steps as relative poses that were measured."""
        recorded = self.odometry
        frames = np.arange(len(recorded.cam_from_next) + 1)
        if self.frame_idx is not None:
            frames = self.frame_idx
        sigma = np.stack([recorded.sigma_rotation, recorded.sigma_translation], axis=1)
        return BetweenTerm(
            pairs=np.stack([frames[:-1], frames[1:]], axis=1),
            first_from_second=recorded.cam_from_next,
            sigma=np.repeat(sigma, 3, axis=1),
            loss=self.model.loss,
            weight=self.model.weight,
            name=self.name,
        )
