"""Floor term (paper, Eq. L_floor): floor points lie on one level plane, fitted once and then fixed."""

from dataclasses import dataclass, field

import numpy as np

from planfit.adjust.moments import PlaneMoments, plane_moments
from planfit.adjust.robust import Loss, LossKind
from planfit.adjust.terms.base import Weighting
from planfit.errors import require_positive
from planfit.structure import Structure

FLOOR_PLANE = np.array([0.0, 0.0, 1.0, 0.0])
"""z = 0 of the level and the plan frame."""


@dataclass(frozen=True)
class FloorOptions:
    """Weight, spread and loss of the floor term."""

    weight: float = 1.0
    """Factor on the term; 0 switches it off."""
    sigma_m: float = 0.03
    """Spread of floor points about the plane: depth noise and an uneven floor."""
    loss: Loss = field(default_factory=lambda: Loss(LossKind.CAUCHY, 2.0))
    """Robust loss of the distance in spreads."""
    max_readings: float = 6.0
    """Independent readings that a frame's floor points are worth at most."""
    points_per_reading: float = 30.0
    """Floor points that make one reading."""

    def __post_init__(self) -> None:
        require_positive(self, "sigma_m", "max_readings", "points_per_reading")


@dataclass(frozen=True)
class FloorTerm:
    """Sum over floor points of rho(dist(T_i p, floor) / sigma)."""

    structure: Structure
    options: FloorOptions
    name: str = "floor"

    def reweight(self, target_from_cams: np.ndarray) -> tuple[PlaneMoments, float]:
        """One pass over the floor points; see `planfit.adjust.moments`."""
        start = self.structure.floor_start
        n = len(start) - 1
        weighting = Weighting(self.options.max_readings, self.options.points_per_reading)
        return plane_moments(
            self.structure.floor_points_cam,
            start,
            np.arange(n),
            np.tile(FLOOR_PLANE, (n, 1)),
            self.options.weight * weighting.information(np.diff(start)),
            target_from_cams,
            self.options.sigma_m,
            self.options.loss,
        )
