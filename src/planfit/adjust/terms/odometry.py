"""Odometry term: steps between frames are as the tracker recorded them, within its sigma.

Not in the paper. Without it, a frame that has no match and sees no wall floats, and a bundle of wrong
matches bends the path where nothing else holds it.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.lsq.linear.normal_equations import NormalBlocks, sum_by_pose
from planfit.lsq.robust import Loss, LossKind, loss_value
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class OdometryTermOptions:
    """Weight and loss of the odometry term."""

    weight: float = 1.0
    """Factor on the term; 0 switches it off."""
    loss: Loss = field(default_factory=lambda: Loss(LossKind.CAUCHY, 5.0))
    """Robust loss of a step's departure in sigmas (six numbers a step, so 2.4 is usual); trackers
    jump now and then, and a jump must not be smeared over the path."""


@dataclass(frozen=True)
class OdometryTerm:
    """Sum over steps of rho(|departure of the step from the recorded one| in sigmas)."""

    odometry: Odometry
    options: OdometryTermOptions
    name: str = "odometry"

    def reweight(
        self, target_from_cams: Float[np.ndarray, "n 4 4"]
    ) -> tuple["OdometryQuadratic", float]:
        """Weights of the steps at these poses."""
        departure = step_departure(self.odometry, target_from_cams)
        sigma = _sigma(self.odometry)
        rho, weight = loss_value(np.sum((departure / sigma) ** 2, axis=1), self.options.loss)
        information = self.options.weight * weight[:, None] / sigma**2
        quadratic = OdometryQuadratic(self.odometry, information)
        return quadratic, 0.5 * self.options.weight * float(rho.sum())


@dataclass(frozen=True)
class OdometryQuadratic:
    """Odometry term with frozen weights."""

    odometry: Odometry
    information: Float[np.ndarray, "steps 6"]
    """1/rad^2 and 1/m^2."""

    def cost(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> float:
        """Half the weighted sum of squares."""
        departure = step_departure(self.odometry, target_from_cams)
        return 0.5 * float(np.sum(self.information * departure**2))

    def normal_blocks(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> NormalBlocks:
        """Gauss-Newton blocks of the steps."""
        departure = step_departure(self.odometry, target_from_cams)
        first, second = step_jacobians(target_from_cams, departure)
        first_t = np.swapaxes(first * self.information[:, :, None], 1, 2)
        second_t = np.swapaxes(second * self.information[:, :, None], 1, 2)
        n = len(target_from_cams)
        i = np.arange(len(departure))
        gradient = sum_by_pose(i, np.einsum("kab,kb->ka", first_t, departure), n)
        gradient += sum_by_pose(i + 1, np.einsum("kab,kb->ka", second_t, departure), n)
        diagonal = sum_by_pose(i, first_t @ first, n) + sum_by_pose(i + 1, second_t @ second, n)
        every = np.arange(n)
        return NormalBlocks(
            np.concatenate([every, i]),
            np.concatenate([every, i + 1]),
            np.concatenate([diagonal, first_t @ second]),
            gradient,
        )


def step_departure(
    odometry: Odometry, target_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "steps 6"]:
    """Departure [rad, m] of each step from the recorded one, of the first n poses given.

    Rotation: log of recorded^T current, in the axes of the second frame. Translation: in those of the first.
    """
    recorded = odometry.cam_from_next
    cams = target_from_cams[: len(recorded) + 1]  # other unknowns may stand behind the cameras
    now = se3.inverse(cams[:-1]) @ cams[1:]
    rotation = np.swapaxes(recorded[:, :3, :3], 1, 2) @ now[:, :3, :3]
    return np.concatenate([se3.log_so3(rotation), now[:, :3, 3] - recorded[:, :3, 3]], axis=1)


def step_jacobians(
    target_from_cams: Float[np.ndarray, "n 4 4"], departure: Float[np.ndarray, "steps 6"]
) -> tuple[Float[np.ndarray, "steps 6 6"], Float[np.ndarray, "steps 6 6"]]:
    """Jacobians of the departures by the first and by the second pose's tangent."""
    cams = target_from_cams[: len(departure) + 1]
    first_t = np.swapaxes(cams[:-1, :3, :3], 1, 2)
    second_t = np.swapaxes(cams[1:, :3, :3], 1, 2)
    between = cams[1:, :3, 3] - cams[:-1, :3, 3]
    k = se3.skew(departure[:, :3])
    # Inverse right Jacobian of SO(3) to second order: departures are small (below 0.3 rad the next
    # term is under 1e-4).
    by_rotation = (np.eye(3) + 0.5 * k + k @ k / 12.0) @ second_t
    first, second = np.zeros((len(k), 6, 6)), np.zeros((len(k), 6, 6))
    first[:, :3, :3], second[:, :3, :3] = -by_rotation, by_rotation
    first[:, 3:, :3] = first_t @ se3.skew(between)
    first[:, 3:, 3:], second[:, 3:, 3:] = -first_t, first_t
    return first, second


def _sigma(odometry: Odometry) -> Float[np.ndarray, "steps 6"]:
    """Sigmas [rad, m] of the steps."""
    return np.repeat(
        np.stack([odometry.sigma_rotation, odometry.sigma_translation], axis=1), 3, axis=1
    )
