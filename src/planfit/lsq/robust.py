"""Robust losses, as functions of the squared residual in sigmas: s = (residual / sigma)^2.

Each is a cost rho(s) that begins as s (the unsquared norm apart), and the weight rho'(s) that
iterated least squares gives to a residual. rho is concave in s for all of them, so the weighted
squares lie above the robust cost and touch it where the weights were taken: lowering the one lowers
the other.
"""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Float

from planfit.errors import require_positive
from planfit.lsq import moment_kernels as kernels


class LossKind(IntEnum):
    """Shape of a loss beyond its scale."""

    SQUARED = kernels.SQUARED
    """The parabola: no outlier is expected."""
    HUBER = kernels.HUBER
    """Grows linearly: outliers count, but no more than inliers at the scale."""
    CAUCHY = kernels.CAUCHY
    """Grows like the logarithm: outliers count less the further off they are."""
    GEMAN_MCCLURE = kernels.GEMAN_MCCLURE
    """Levels off: outliers stop counting."""
    NORM = kernels.NORM
    """The unsquared norm, as the paper has it: half the cost is the distance in sigmas, rounded off
    below `scale`, which should be tiny: weights grow as one over it."""


@dataclass(frozen=True)
class Loss:
    """A loss and the residual, in sigmas, at which it leaves the parabola."""

    kind: LossKind = LossKind.CAUCHY
    """Shape beyond the scale."""
    scale: float = 2.0
    """Residual, in sigmas, at which it leaves the parabola."""

    def __post_init__(self) -> None:
        require_positive(self, "scale")

    def widened(self, factor: float) -> "Loss":
        """The same shape at `factor` times the scale: nearer to the parabola, with fewer minima (GNC)."""
        return replace(self, scale=factor * self.scale)


SQUARES = Loss(LossKind.SQUARED)
"""Plain least squares."""


def loss_value(
    s: Float[np.ndarray, " n"], loss: Loss
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Costs and weights of squared residuals in sigmas."""
    return kernels.weigh_all(np.asarray(s, dtype=float), int(loss.kind), float(loss.scale))


def loss_curvature(s: Float[np.ndarray, " n"], loss: Loss, dims: int) -> Float[np.ndarray, " n"]:
    """How fast the pull of residuals of `dims` numbers grows with them, mean over directions: w + 2 s w' /
    dims.

    The pull is w(s) r. The weighted squares that a step is solved with take its growth to be w, which is
    more: a minimum of the robust cost is as sharp as this curvature, not as the weights (Huber, Robust
    Statistics, 1981, Sec. 7.6). Below 0 where the pull falls with the residual.

    Args:
        s: squared norms of the residuals, in sigmas.
        loss: robust loss.
        dims: numbers of a residual.
    """
    s = np.asarray(s, dtype=float)
    weight, c2 = loss_value(s, loss)[1], loss.scale**2
    match loss.kind:
        case LossKind.SQUARED:
            slope = np.zeros_like(s)
        case LossKind.HUBER:
            slope = np.where(s > c2, -weight / (2 * np.maximum(s, c2)), 0.0)
        case LossKind.CAUCHY:
            slope = -weight / (c2 + s)
        case LossKind.GEMAN_MCCLURE:
            slope = -2 * weight / (c2 + s)
        case LossKind.NORM:
            slope = -weight / (2 * (c2 + s))
    return weight + 2 * s * slope / dims
