"""Odometry term: steps between frames are as the tracker recorded them, within its sigma.

Not in the paper. Without it, a frame that has no match and sees no wall floats, and a bundle of wrong
matches deforms the path where nothing else holds it.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.lsq.pose_terms import BetweenTerm
from planfit.lsq.residual_term import WeightedResiduals
from planfit.lsq.robust import Loss, LossKind
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class OdometryTermOptions:
    """Weight and loss of the odometry term."""

    weight: float = 1.0
    """Factor on the term; 0 switches it off."""
    loss: Loss = field(default_factory=lambda: Loss(LossKind.CAUCHY, 5.0))
    """Robust loss of a step's departure in sigmas (six numbers a step, so 2.4 is usual); trackers
    jump now and then, and a jump must not be smeared over the path. Nor must a false revisit be: with
    Cauchy's it tears a step, which is found, and the revisit dropped; with Huber's or squares it bends the
    walk unseen (0.14 m instead of 0.03 on a walk of two laps with three false visits)."""


@dataclass(frozen=True)
class OdometryTerm:
    """Sum over steps of rho(|departure of the step from the recorded one| in sigmas).

    Other unknowns may stand behind the cameras.
    """

    odometry: Odometry
    options: OdometryTermOptions
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
            loss=self.options.loss,
            weight=self.options.weight,
            name=self.name,
        )
