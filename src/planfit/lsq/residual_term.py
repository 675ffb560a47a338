"""A term out of a residual function: what a term of one's own takes.

    ResidualTerm(pose_idx, residual, sigma=0.01, loss=Loss(LossKind.CAUCHY, 2.0))

`residual` is given the poses that each row names and returns all rows at once. Without a Jacobian it is
differenced. Robust weights go by the norm of each row in sigmas (iteratively reweighted least squares).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError, require
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks, blocks_of_rows
from planfit.lsq.robust import SQUARES, Loss, loss_value
from planfit.lsq.term import check_pose_idx, check_weight

Residual = Callable[[Float[np.ndarray, "k a 4 4"]], Float[np.ndarray, "k d"]]
"""Residuals of all k rows, d numbers each, from the `a` poses of each row; leaves its argument as it is."""
Jacobian = Callable[[Float[np.ndarray, "k a 4 4"]], Float[np.ndarray, "k d c"]]
"""Derivatives of the residuals of all rows by the tangents of their poses, c = 6 a."""

STEP = 6e-6
"""Step of central differences, rad and m: the cube root of the rounding unit 2.2e-16, where rounding and the
neglected third derivative are alike."""


@dataclass(frozen=True)
class ResidualTerm:
    """Sum over rows of weight * rho(|residual|^2 in sigmas) / 2.

    Raises:
        OptionError: indices that are no array of integers (k, a) or below 0, a sigma that is not above 0,
            both sigma and information given, a weight below 0; and, when it is first asked for a cost,
            residuals or a Jacobian of another shape than is expected.
    """

    pose_idx: Int[np.ndarray, "k a"]
    """The `a` poses that each row names."""
    residual: Residual
    """From those poses (k, a, 4, 4) to residuals (k, d). Data is closed over."""
    sigma: Float[np.ndarray, "..."] | float | None = None
    """Standard deviations of the residuals: one, or (d,), or (k, d); infinity frees a direction. Taken as 1
    where neither this nor the information is given."""
    information: Float[np.ndarray, "*k d d"] | None = None
    """Inverse covariance of the residuals instead, (d, d) or (k, d, d)."""
    loss: Loss = SQUARES
    """Robust loss of the norm of a row in sigmas."""
    jacobian: Jacobian | None = None
    """Analytic (k, d, 6 a), columns (rotation, translation) pose after pose; differences where None."""
    weight: float = 1.0
    """Factor on the robust cost."""
    name: str = "residuals"

    def __post_init__(self) -> None:
        """Check what can be checked before the residuals are known."""
        check_pose_idx(self.name, self.pose_idx, ("k", "a"))
        check_weight(self.name, self.weight)
        require(
            self.sigma is None or self.information is None,
            f"term {self.name!r}: expected sigma or information, found both",
        )
        require(
            self.sigma is None or bool(np.all(np.asarray(self.sigma) > 0)),
            f"term {self.name!r}: expected sigmas above 0, found {self.sigma}",
        )

        if self.information is not None:
            check_information(self.name, np.asarray(self.information))

    def with_wider_loss(self, factor: float) -> "ResidualTerm":
        """The same term with the scale of its loss times `factor`."""
        return replace(self, loss=self.loss.widened(factor))

    def reweight(self, target_from_cams: Poses) -> tuple["WeightedResiduals", float]:
        """Weights of the rows at these poses."""
        residuals = self.residuals(target_from_cams)
        information = self._information(*residuals.shape)
        squared = np.sum(residuals * _times(information, residuals), axis=1)
        rho, weight = loss_value(squared, self.loss)
        row_weights = (self.weight * weight).reshape(-1, *[1] * (information.ndim - 1))
        return WeightedResiduals(self, row_weights * information), 0.5 * self.weight * float(
            rho.sum()
        )

    def residuals(self, target_from_cams: Poses) -> Float[np.ndarray, "k d"]:
        """The residuals of all rows, checked."""
        found = self.residual(target_from_cams[self.pose_idx])
        if found.ndim != 2 or len(found) != len(self.pose_idx):
            raise OptionError(
                f"term {self.name!r}: expected residuals of shape ({len(self.pose_idx)}, d), one row "
                f"for each row of pose_idx, found {found.shape}"
            )
        return found

    def jacobians(self, target_from_cams: Poses) -> Float[np.ndarray, "k d c"]:
        """Derivatives of all rows by the tangents of their poses, analytic or by differences."""
        poses = target_from_cams[self.pose_idx]
        if self.jacobian is None:
            return jacobian_by_differences(self.residual, poses)
        found, columns = self.jacobian(poses), 6 * poses.shape[1]
        if found.ndim != 3 or (len(found), found.shape[2]) != (len(poses), columns):
            raise OptionError(
                f"term {self.name!r}: expected a Jacobian of shape ({len(poses)}, d, {columns}), "
                f"found {found.shape}"
            )
        return found

    def _information(self, k: int, d: int) -> np.ndarray:
        """Information of all rows: its diagonals (k, d), or matrices (k, d, d)."""
        given = self.information
        shape = (k, d) if given is None else (k, d, d)
        if given is None:
            given = 1.0 / np.square(1.0 if self.sigma is None else self.sigma)
        try:
            return np.broadcast_to(given, shape)
        except ValueError:
            name, dims = ("sigma", "d") if self.information is None else ("information", "d, d")
            raise OptionError(
                f"term {self.name!r}: expected {name} of shape ({dims}) or (k, {dims}) for k = {k} "
                f"residuals of d = {d} numbers, found {np.shape(given)}"
            ) from None


def check_information(name: str, information: np.ndarray) -> None:
    """A matrix that is not symmetric has another gradient than its cost; a negative one has no minimum."""
    if information.ndim not in (2, 3) or information.shape[-1] != information.shape[-2]:
        raise OptionError(
            f"term {name!r}: expected information of shape (d, d) or (k, d, d), found "
            f"{information.shape}; give standard deviations as sigma"
        )
    if not np.isfinite(information).all():
        raise OptionError(f"term {name!r}: expected finite information, found NaN or infinity")
    size = np.abs(information).max(initial=0.0)
    is_symmetric = np.allclose(
        information, np.swapaxes(information, -1, -2), rtol=0, atol=1e-9 * size
    )
    if not is_symmetric:  # its eigenvalues would say nothing
        raise OptionError(f"term {name!r}: expected symmetric information, found other")
    if information.size and np.linalg.eigvalsh(information).min() < -1e-9 * size:
        raise OptionError(
            f"term {name!r}: expected information without negative eigenvalues (an inverse "
            "covariance), found one that has some"
        )


@dataclass(frozen=True)
class WeightedResiduals:
    """The squares of a `ResidualTerm` with its robust weights frozen."""

    term: ResidualTerm
    information: Float[np.ndarray, "k d ..."]
    """Information of each row times its weight: diagonals (k, d), or matrices (k, d, d)."""

    def cost(self, target_from_cams: Poses) -> float:
        """Half the weighted sum of squares."""
        residuals = self.term.residuals(target_from_cams)
        return 0.5 * float(np.sum(residuals * _times(self.information, residuals)))

    def normal_blocks(self, target_from_cams: Poses) -> NormalBlocks:
        """Gauss-Newton blocks of the poses that the rows name."""
        residuals = self.term.residuals(target_from_cams)
        jacobians = self.term.jacobians(target_from_cams)
        transposed = np.swapaxes(jacobians, 1, 2)
        gradients = (transposed @ _times(self.information, residuals)[:, :, None])[:, :, 0]
        if self.information.ndim == 2:
            weighted = jacobians * self.information[:, :, None]
        else:
            weighted = self.information @ jacobians
        hessians = transposed @ weighted
        return blocks_of_rows(self.term.pose_idx, hessians, gradients, len(target_from_cams))


def jacobian_by_differences(
    residual: Residual, poses: Float[np.ndarray, "k a 4 4"]
) -> Float[np.ndarray, "k d c"]:
    """Central differences by the tangents of the poses, c = 6 a: 12 a evaluations for all rows at once."""
    moved = poses.copy()  # one axis of one argument is moved at a time, and put back
    columns = []
    for slot in range(poses.shape[1]):
        rotations = poses[:, slot, :3, :3]
        for axis in range(6):
            ends = []
            for step in (STEP, -STEP):
                if axis < 3:  # every row is moved alike, so one small rotation does for all
                    by = se3.exp_so3(step * np.eye(3)[axis])
                    moved[:, slot, :3, :3] = by @ rotations
                else:
                    moved[:, slot, axis - 3, 3] = poses[:, slot, axis - 3, 3] + step
                ends.append(residual(moved))
            moved[:, slot] = poses[:, slot]
            columns.append((ends[0] - ends[1]) / (2 * STEP))
    return np.stack(columns, axis=2)


def _times(information: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Information (k, d) or (k, d, d) times residuals (k, d)."""
    if information.ndim == 2:
        return information * residuals
    return (information @ residuals[:, :, None])[:, :, 0]
