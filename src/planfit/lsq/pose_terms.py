"""Terms of measured poses: between any two (odometry, loop closures, edges of a pose graph), and priors."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import require, require_choice
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks, blocks_of_rows, relative_pose_jacobians
from planfit.lsq.residual_term import ResidualTerm, WeightedResiduals
from planfit.lsq.robust import SQUARES, Loss
from planfit.lsq.term import check_pose_idx, check_poses, check_weight

Chart = Literal["so3xr3", "se3"]
"""What of E = measured^-1 (first_from_second) is a residual, both (rotation, translation) in rad and m:
`so3xr3` the logarithm of its rotation and its translation as it stands; `se3` the logarithm of the rigid
transform, as GTSAM has it. They differ in second order; the first is the cheaper."""


@dataclass(frozen=True)
class BetweenTerm:
    """Sum over pairs of weight * rho(|departure of the relative pose from the measured one|^2 in sigmas) / 2.

    A departure is in the axes of the second pose as measured. Errors as of `ResidualTerm`.
    """

    pairs: Int[np.ndarray, "k 2"]
    """First and second pose of each measurement."""
    first_from_second: Float[np.ndarray, "k 4 4"]
    """What was measured."""
    sigma: Float[np.ndarray, "..."] | float | None = None
    """Standard deviations (6,) or (k, 6), rad and m; infinity frees a direction."""
    information: Float[np.ndarray, "*k 6 6"] | None = None
    """Inverse covariances instead, (6, 6) or (k, 6, 6), in the order (rotation, translation)."""
    loss: Loss = SQUARES
    """Robust loss of the norm of a departure in sigmas (six numbers, so 2.4 is usual)."""
    chart: Chart = "so3xr3"
    weight: float = 1.0
    """Factor on the robust cost."""
    name: str = "between"

    def __post_init__(self) -> None:
        """Check what the rows are made of; they check the rest."""
        require_choice(self, "chart", "so3xr3", "se3")
        check_pose_idx(self.name, self.pairs, ("k", "2"))
        check_poses(
            f"term {self.name!r}: expected finite first_from_second",
            self.first_from_second,
            len(self.pairs),
        )
        check_weight(self.name, self.weight)

    @property
    def pose_idx(self) -> Int[np.ndarray, "k 2"]:
        """The poses that each measurement names."""
        return self.pairs

    def with_wider_loss(self, factor: float) -> "BetweenTerm":
        """The same term with the scale of its loss times `factor`."""
        return replace(self, loss=self.loss.widened(factor))

    def reweight(self, target_from_cams: Poses) -> tuple[WeightedResiduals, float]:
        """Weights of the measurements at these poses."""
        return self.rows.reweight(target_from_cams)

    @cached_property
    def rows(self) -> ResidualTerm:
        """The same term as rows of residuals."""
        return ResidualTerm(
            self.pairs,
            self.residual,
            self.sigma,
            self.information,
            self.loss,
            self.jacobian,
            self.weight,
            self.name,
        )

    def residual(self, poses: Float[np.ndarray, "k 2 4 4"]) -> Float[np.ndarray, "k 6"]:
        """Departures (rotation, translation) of pairs of poses from what was measured."""
        rotation, translation = self._departures(poses)
        if self.chart == "se3":
            inverse_left = np.swapaxes(_inverse_right_jacobian(rotation), 1, 2)
            translation = (inverse_left @ translation[:, :, None])[:, :, 0]
        return np.concatenate([rotation, translation], axis=1)

    def jacobian(self, poses: Float[np.ndarray, "k 2 4 4"]) -> Float[np.ndarray, "k 6 12"]:
        """Derivatives of the departures by both tangents.

        By the tangent (w, v) of first_from_second = (R, t), first's axes: E's rotation goes to
        R_E exp(R^T w), so its logarithm moves by J_r^-1 R^T w; its translation moves by R_m^T v.
        """
        rotation, translation = self._departures(poses)
        current = np.swapaxes(poses[:, 0, :3, :3], 1, 2) @ poses[:, 1, :3, :3]
        by_relative = np.zeros((len(poses), 6, 6))
        inverse_right = _inverse_right_jacobian(rotation)
        by_relative[:, :3, :3] = inverse_right @ np.swapaxes(current, 1, 2)
        by_relative[:, 3:, 3:] = np.swapaxes(self.first_from_second[:, :3, :3], 1, 2)
        if self.chart == "se3":
            by_relative[:, 3:, 3:] = np.swapaxes(inverse_right, 1, 2) @ by_relative[:, 3:, 3:]
            bending = _inverse_left_jacobian_derivative(rotation, translation)
            by_relative[:, 3:, :3] = bending @ by_relative[:, :3, :3]
        return by_relative @ relative_pose_jacobians(poses)

    def _departures(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logarithm of the rotation (k, 3) and translation (k, 3) of E."""
        second_from_first = np.swapaxes(self.first_from_second[:, :3, :3], 1, 2)
        first_t = np.swapaxes(poses[:, 0, :3, :3], 1, 2)
        rotation = se3.log_so3(second_from_first @ (first_t @ poses[:, 1, :3, :3]))
        apart = (first_t @ (poses[:, 1, :3, 3:] - poses[:, 0, :3, 3:]))[:, :, 0]
        off = apart - self.first_from_second[:, :3, 3]
        return rotation, (second_from_first @ off[:, :, None])[:, :, 0]


def _inverse_right_jacobian(rotation: np.ndarray) -> np.ndarray:
    """J_r^-1 (k, 3, 3) of SO(3) at rotation vectors (k, 3); J_l^-1 is its transpose (Sola 2018, eq. 144)."""
    k = se3.skew(rotation)
    return np.eye(3) + 0.5 * k + _second_order(rotation)[0][:, None, None] * (k @ k)


def _inverse_left_jacobian_derivative(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """d (J_l^-1(w) t) / dw (k, 3, 3) at rotation vectors w (k, 3), of vectors t (k, 3) held.

    With J_l^-1 t = t - w x t / 2 + c w x (w x t), and w x (w x t) = w (w . t) - t (w . w).
    """
    c, slope = _second_order(rotation)
    w, t = rotation[:, :, None], vectors[:, :, None]
    w_t, t_t = np.swapaxes(w, 1, 2), np.swapaxes(t, 1, 2)
    along = w_t @ t  # (k, 1, 1)
    twice = w * along - t * (w_t @ w)
    by_twice = along * np.eye(3) + w @ t_t - 2.0 * t @ w_t
    return (
        0.5 * se3.skew(vectors) + c[:, None, None] * by_twice + slope[:, None, None] * twice @ w_t
    )


def _second_order(rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """c = 1 / a^2 - cot(a / 2) / (2 a) of angles a = |w|, and dc/da / a, each (k,).

    Below 0.1 rad by their series, since the closed forms are differences of large numbers there.
    """
    squared = np.sum(rotation**2, axis=1)
    is_small = squared < 1e-2
    a = np.sqrt(np.where(is_small, 1.0, squared))
    cot = np.cos(a / 2) / np.sin(a / 2)
    c = 1.0 / a**2 - cot / (2.0 * a)
    slope = (-2.0 / a**3 + cot / (2.0 * a**2) + 1.0 / (4.0 * a * np.sin(a / 2) ** 2)) / a
    s = squared
    small_c = 1 / 12 + s / 720 + s**2 / 30240 + s**3 / 1209600
    small_slope = 1 / 360 + s / 7560 + s**2 / 201600
    return np.where(is_small, small_c, c), np.where(is_small, small_slope, slope)


@dataclass(frozen=True)
class PosePriorTerm:
    """Some poses stay near where they are given; holds the gauge where nothing else does.

    Half the sum of squares of a pose's departure from its prior in sigmas, target axes.

    Raises:
        OptionError: indices that are no array of integers (k,) or below 0, priors of another number, sigmas
            that are not six numbers above 0.
    """

    pose_idx: Int[np.ndarray, " k"]
    """Poses that have a prior; one pose may have several."""
    target_from_priors: Float[np.ndarray, "k 4 4"]
    sigma: Float[np.ndarray, " 6"]
    """Standard deviations, rad and m; infinity leaves a direction free. To hold a gauge 0.01 will do: steps
    are damped by at least 1e-9 of the largest information of all, so far smaller ones slow all poses down."""
    name: str = "pose prior"

    def __post_init__(self) -> None:
        """Check indices, priors and sigmas."""
        check_pose_idx(self.name, self.pose_idx, ("k",))
        what = f"term {self.name!r}: expected finite target_from_priors"
        check_poses(what, self.target_from_priors, len(self.pose_idx))
        require(
            np.shape(self.sigma) == (6,),
            f"term {self.name!r}: expected six sigmas, of rotation (rad) and translation (m), found an array "
            f"of shape {np.shape(self.sigma)}; np.full(6, sigma) takes one for all",
        )
        require(
            bool(np.all(self.sigma > 0)),
            f"term {self.name!r}: expected sigmas above 0, found {self.sigma}; infinity frees a direction",
        )

    def reweight(self, target_from_cams: Poses) -> tuple["PosePriorTerm", float]:
        """Not robust: the term is its own quadratic."""
        return self, self.cost(target_from_cams)

    def cost(self, target_from_cams: Poses) -> float:
        """Half the weighted sum of squares."""
        departure = se3.difference(target_from_cams[self.pose_idx], self.target_from_priors)
        return 0.5 * float(np.sum((departure / self.sigma) ** 2))

    def normal_blocks(self, target_from_cams: Poses) -> NormalBlocks:
        """Gauss-Newton blocks; the derivative of log is taken as one, exact at the prior."""
        departure = se3.difference(target_from_cams[self.pose_idx], self.target_from_priors)
        information = 1.0 / self.sigma**2
        hessians = np.tile(np.diag(information), (len(self.pose_idx), 1, 1))
        gradients = departure * information
        return blocks_of_rows(self.pose_idx[:, None], hessians, gradients, len(target_from_cams))
