"""What a term of the cost function is to the solver."""

from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from planfit.errors import require_positive
from planfit.lsq.linear.normal_equations import NormalBlocks


@runtime_checkable
class Quadratic(Protocol):
    """A term with its robust weights frozen: weighted squares of residuals."""

    def cost(self, target_from_cams: np.ndarray, /) -> float:
        """Half the weighted sum of squares at poses (n, 4, 4)."""
        ...

    def normal_blocks(self, target_from_cams: np.ndarray, /) -> NormalBlocks:
        """Gauss-Newton blocks at poses (n, 4, 4)."""
        ...


@runtime_checkable
class Term(Protocol):
    """One sum of robust residuals over poses."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def reweight(self, target_from_cams: np.ndarray, /) -> tuple[Quadratic, float]:
        """Freeze the weights at poses (n, 4, 4); also the robust cost there."""
        ...


Options = TypeVar("Options")


def as_mean(options: Options, n_points: int) -> Options:
    """The same options of a term, for the mean over its `n_points` instead of a sum over readings."""
    given: Any = options  # any of the terms' options
    changes = {"weight": given.weight / max(n_points, 1), "max_observations": np.inf}
    if hasattr(options, "points_per_observation"):
        changes["points_per_observation"] = 1.0
    return replace(given, **changes)


@dataclass(frozen=True)
class Weighting:
    """How many independent readings a bundle of points is worth.

    The points of one frame on one surface share most of their error: the depth calibration, the frame's
    pose, how the wall was drawn and built. Counting each point as a reading of its own would make a
    wall seen by a thousand points outvote everything else.
    """

    max_observations: float
    """Readings that a bundle of points is worth at most, however many points it has."""
    points_per_observation: float = 1.0
    """Points that make one reading while there are few of them."""

    def __post_init__(self) -> None:
        require_positive(self, "max_observations", "points_per_observation")

    def information(self, n_points: np.ndarray) -> np.ndarray:
        """Readings per point (k,) of bundles of n_points (k,)."""
        readings = np.minimum(n_points / self.points_per_observation, self.max_observations)
        return readings / np.maximum(n_points, 1)
