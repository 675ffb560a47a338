"""Surfaces term: pairs of frames stand to each other as their surfaces say, where these say anything.

Not in the paper. A pair's information matrix is of a rank below 6 where its surfaces leave directions free:
along these it holds nothing (docs/adr/0018-matches-by-geometry.md).
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.terms.between import BetweenTerm
from planfit.matching import SurfacePairs


@dataclass(frozen=True)
class SurfaceTermOptions:
    """Weight and loss of the surfaces term."""

    weight: float = 1.0
    """Factor on the term; 0 switches it off."""
    loss: Loss = field(default_factory=lambda: Loss(LossKind.CAUCHY, 3.0))
    """Robust loss of a pair's departure in sigmas (six numbers a pair, so 2.4 is usual): a pair is right or
    false as a whole."""


def surface_term(pairs: SurfacePairs, options: SurfaceTermOptions) -> BetweenTerm:
    """The pairs as relative poses that were measured, with their information."""
    return BetweenTerm(
        pairs=pairs.pairs,
        first_from_second=pairs.a_from_b,
        information=of_departures(pairs),
        loss=options.loss,
        weight=options.weight,
        name="surfaces",
    )


def of_departures(pairs: SurfacePairs) -> Float[np.ndarray, "p 6 6"]:
    """Information of what `BetweenTerm` calls a departure, from that of the tangent.

    The tangent (w, v) has the axes of the first frame, a departure R^T w, R^T v those of the second.
    """
    axes = np.zeros((len(pairs), 6, 6))
    axes[:, :3, :3] = axes[:, 3:, 3:] = pairs.a_from_b[:, :3, :3]
    turned = np.swapaxes(axes, 1, 2) @ pairs.information @ axes
    return 0.5 * (turned + np.swapaxes(turned, 1, 2))
