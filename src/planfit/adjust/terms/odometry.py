"""Trajectory prior: steps between frames are as the tracker recorded them, within its spread.

Not in the paper. Without it, a frame that has no match and sees no wall floats, and a bundle of wrong
matches bends the path where nothing else holds it.
"""

from dataclasses import dataclass, field

import numpy as np

from planfit.geometry import se3
from planfit.lsq.linear.normal_equations import NormalBlocks, sum_by_pose
from planfit.lsq.robust import Loss, LossKind, loss_value
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class OdometryTermOptions:
    """Weight and loss of the trajectory prior."""

    weight: float = 1.0
    """Factor on the term; 0 switches it off."""
    loss: Loss = field(default_factory=lambda: Loss(LossKind.CAUCHY, 5.0))
    """Robust loss of a step's departure in spreads (six numbers a step, so 2.4 is usual); trackers
    jump now and then, and a jump must not be spread over the path."""


@dataclass(frozen=True)
class OdometryTerm:
    """Sum over steps of rho(|departure of the step from the recorded one| in spreads)."""

    odometry: Odometry
    options: OdometryTermOptions
    name: str = "odometry"

    def reweight(self, target_from_cams: np.ndarray) -> tuple["OdometryQuadratic", float]:
        """Weights of the steps at these poses."""
        departure = step_departure(self.odometry, target_from_cams)
        sigma = _sigma(self.odometry)
        rho, weight = loss_value(np.sum((departure / sigma) ** 2, axis=1), self.options.loss)
        information = self.options.weight * weight[:, None] / sigma**2
        quadratic = OdometryQuadratic(self.odometry, information)
        return quadratic, 0.5 * self.options.weight * float(rho.sum())


@dataclass(frozen=True)
class OdometryQuadratic:
    """Trajectory prior with frozen weights."""

    odometry: Odometry
    information: np.ndarray  # (n - 1, 6) 1/rad^2 and 1/m^2

    def cost(self, target_from_cams: np.ndarray) -> float:
        """Half the weighted sum of squares."""
        departure = step_departure(self.odometry, target_from_cams)
        return 0.5 * float(np.sum(self.information * departure**2))

    def normal_blocks(self, target_from_cams: np.ndarray) -> NormalBlocks:
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


def step_departure(odometry: Odometry, target_from_cams: np.ndarray) -> np.ndarray:
    """Departure (n - 1, 6) [rad, m] of each step from the recorded one, of the first n poses given.

    Turn: log of recorded^T current, in the axes of the second frame. Shift: in those of the first.
    """
    recorded = odometry.cam_from_next
    cams = target_from_cams[: len(recorded) + 1]  # other unknowns may stand behind the cameras
    now = se3.inverse(cams[:-1]) @ cams[1:]
    turn = np.swapaxes(recorded[:, :3, :3], 1, 2) @ now[:, :3, :3]
    return np.concatenate([se3.log_so3(turn), now[:, :3, 3] - recorded[:, :3, 3]], axis=1)


def step_jacobians(
    target_from_cams: np.ndarray, departure: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Jacobians (n - 1, 6, 6) of the departures by the first and by the second pose's tangent."""
    cams = target_from_cams[: len(departure) + 1]
    first_t = np.swapaxes(cams[:-1, :3, :3], 1, 2)
    second_t = np.swapaxes(cams[1:, :3, :3], 1, 2)
    between = cams[1:, :3, 3] - cams[:-1, :3, 3]
    k = se3.skew(departure[:, :3])
    # Inverse right Jacobian of SO(3) to second order: departures are small (below 0.3 rad the next
    # term is under 1e-4).
    by_turn = (np.eye(3) + 0.5 * k + k @ k / 12.0) @ second_t
    first, second = np.zeros((len(k), 6, 6)), np.zeros((len(k), 6, 6))
    first[:, :3, :3], second[:, :3, :3] = -by_turn, by_turn
    first[:, 3:, :3] = first_t @ se3.skew(between)
    first[:, 3:, 3:], second[:, 3:, 3:] = -first_t, first_t
    return first, second


def _sigma(odometry: Odometry) -> np.ndarray:
    """Spreads (n - 1, 6) [rad, m] of the steps."""
    return np.repeat(
        np.stack([odometry.sigma_rotation, odometry.sigma_translation], axis=1), 3, axis=1
    )
