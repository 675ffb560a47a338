"""How many independent observations a bundle of points counts as: ADR 3, Effective observations."""

from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import require_positive

Options = TypeVar("Options")


def as_mean(options: Options, n_points: int) -> Options:
    """The same options of a term, for the mean over its `n_points` instead of a sum over observations."""
    given: Any = options  # any of the terms' options
    changes = {"weight": given.weight / max(n_points, 1), "max_observations": np.inf}
    if hasattr(options, "points_per_observation"):
        changes["points_per_observation"] = 1.0
    return replace(given, **changes)


@dataclass(frozen=True)
class Weighting:
    """How many independent observations a bundle of points counts as.

    The points of one frame on one surface share most of their error: the depth calibration, the frame's
    pose, how the wall was drawn and built. Counting each point as an observation of its own would make a
    wall seen by a thousand points outvote everything else.
    """

    max_observations: float
    """Observations that a bundle of points counts as at most, however many points it has."""
    points_per_observation: float = 1.0
    """Points that make one observation while there are few of them."""

    def __post_init__(self) -> None:
        require_positive(self, "max_observations", "points_per_observation")

    def weight_per_point(self, n_points: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Effective observations per point, of k bundles of n_points each."""
        observations = np.minimum(n_points / self.points_per_observation, self.max_observations)
        return observations / np.maximum(n_points, 1)
