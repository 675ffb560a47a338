"""Robust losses, as functions of the squared residual in spreads: s = (residual / sigma)^2.

Each is a cost rho(s) that begins as s, and the weight rho'(s) that iterated least squares gives to a
residual. rho is concave in s for all of them, so the weighted squares lie above the robust cost and
touch it where the weights were taken: lowering the one lowers the other.
"""

from dataclasses import dataclass
from enum import IntEnum

import numba
import numpy as np

from planfit.errors import require_positive


class LossKind(IntEnum):
    """Shape of a loss beyond its scale."""

    SQUARED = 0
    HUBER = 1
    """Grows linearly: outliers pull, but no harder than inliers at the scale."""
    CAUCHY = 2
    """Grows like the logarithm: outliers pull less the further off they are."""
    GEMAN_MCCLURE = 3
    """Levels off: outliers stop pulling."""


@dataclass(frozen=True)
class Loss:
    """A loss and the residual, in spreads, at which it leaves the parabola."""

    kind: LossKind = LossKind.CAUCHY
    scale: float = 2.0

    def __post_init__(self) -> None:
        require_positive(self, "scale")


@numba.njit(cache=True, inline="always")
def rho_and_weight(s, kind, scale):  # pragma: no cover - compiled; tested through `loss_value`
    """Cost and weight of one squared residual `s`, in spreads."""
    c2 = scale * scale
    if kind == 0:
        return s, 1.0
    if kind == 1:
        if s <= c2:
            return s, 1.0
        root = np.sqrt(s)
        return 2.0 * scale * root - c2, scale / root
    if kind == 2:
        return c2 * np.log1p(s / c2), 1.0 / (1.0 + s / c2)
    share = c2 / (c2 + s)
    return s * share, share * share


@numba.njit(cache=True)
def _loss_values(s, kind, scale):  # pragma: no cover - compiled
    rho, weight = np.zeros_like(s), np.zeros_like(s)
    for i in range(len(s)):
        rho[i], weight[i] = rho_and_weight(s[i], kind, scale)
    return rho, weight


def loss_value(s: np.ndarray, loss: Loss) -> tuple[np.ndarray, np.ndarray]:
    """Costs (n,) and weights (n,) of squared residuals (n,) in spreads."""
    return _loss_values(np.asarray(s, dtype=float), int(loss.kind), float(loss.scale))
