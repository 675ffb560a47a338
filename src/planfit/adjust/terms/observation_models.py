"""What the observations of each term are like: their sigmas, robust losses, and how many there are of them.

The one table of these numbers. They are priors, not options: a wall stands off its drawing by centimetres
whoever scans it, and a loss was chosen because others let wrong evidence act. A user chooses the weights.
Two costs are known: planfit's own and the paper's (`AdjustOptions.cost`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import require_positive
from planfit.lsq.robust import Loss, LossKind


@dataclass(frozen=True)
class ObservationModel:
    """What the observations of a term are like, and how many its points count as.

    The points of one frame on one surface share most of their error: the depth calibration, the frame's
    pose, how the wall was drawn and built. Counting each point as an observation of its own would make a
    wall seen by a thousand points outvote everything else (ADR 3, Effective observations).
    """

    loss: Loss
    """Robust loss of the residual in sigmas."""
    sigma: float = 1.0
    """Standard deviation of a point's residual, in metres (of a reprojected keypoint in pixels, each axis);
    unused where each observation brings its own."""
    max_observations: float = np.inf
    """Independent observations that a bundle of points, those of one frame or pair on one surface, counts as
    at most, however many points it has."""
    points_per_observation: float = 1.0
    """Points that make one observation while there are few of them."""
    weight: float = 1.0
    """Factor on the cost: the user's choice, or 1 over the number of points in a mean."""

    def __post_init__(self) -> None:
        require_positive(self, "sigma", "max_observations", "points_per_observation")

    def weight_per_point(self, n_points: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Effective observations per point, of k bundles of n_points each."""
        observations = np.minimum(n_points / self.points_per_observation, self.max_observations)
        return observations / np.maximum(n_points, 1)

    def as_mean(self, n_points: int) -> "ObservationModel":
        """The same, for the mean over a term's `n_points` instead of a sum over observations."""
        return replace(
            self,
            weight=self.weight / max(n_points, 1),
            max_observations=np.inf,
            points_per_observation=1.0,
        )

    def widened(self, factor: float) -> "ObservationModel":
        """The same with the scale of its loss times `factor`, for graduated non-convexity."""
        return replace(self, loss=self.loss.widened(factor))


TermName = Literal[
    "points",
    "reprojection",
    "rays",
    "floor",
    "ceiling",
    "walls",
    "columns",
    "odometry",
    "surfaces",
    "control",
]
"""Of the terms, as in `AdjustOptions`."""

POINTS = ObservationModel(Loss(LossKind.CAUCHY, 2.0), max_observations=40.0)
"""3D points; matches bring their sigmas, and those of a pair share depth calibration and the interpolation of
the depth image. With a loss of scale 1, ConSLAM errs by 0.098 m instead of 0.100, but a plan with 30 % of its
walls moved by 0.09 m instead of 0.04 at worst (benchmarks/robustness.py). With 20 observations, an 80-frame
synthetic scan errs by 0.020 m instead of 0.019 and a plan with 30 % of its walls moved by 0.09 m instead of
0.04 at worst; 80 changes little."""
REPROJECTION = ObservationModel(Loss(LossKind.CAUCHY, 2.0), sigma=2.0, max_observations=20.0)
"""Reprojected keypoints, of each way on its own; the two ways share one observation. The sigma is that of
detection, and of depth seen from the side."""
RAYS = ObservationModel(Loss(LossKind.CAUCHY, 2.0), max_observations=20.0)
"""Distances of viewing rays, whose sigmas are those of the lifted matches."""
FLOOR = ObservationModel(
    Loss(LossKind.CAUCHY, 2.0), sigma=0.03, max_observations=1.0, points_per_observation=30.0
)
"""Points of a frame about its floor: depth noise and an uneven surface. All that a frame sees of a floor is
off together, as the screed under it is, so it is one observation. With 6, heights on ConSLAM err by 0.054 m
instead of 0.041, and poses by 0.098 m instead of 0.088; floors that are flat lose at most 0.5 mm (kitchen,
lounge, acapulco, belgioioso)."""
CEILING = FLOOR
"""As the floor: what a frame sees of one is one observation."""
WALLS = ObservationModel(
    Loss(LossKind.GEMAN_MCCLURE, 0.8), sigma=0.05, max_observations=4.0, points_per_observation=60.0
)
"""Points of a wall patch about the drawn wall: as drawn, as built, as measured. The loss levels off, because
a wall that is drawn decimetres off is seen by many frames, which must not act together: with 30 % of walls
drawn 0.1 to 0.5 m off, 20 runs err by 0.0084 m in the median, 0.04 m at worst (benchmarks/robustness.py);
with a Cauchy loss of scale 2 by several times that. A scale of 0.7 lets go of right walls where no loop is
closed and costs 4 % of accuracy on an 80-frame scan with a right plan."""
COLUMNS = replace(WALLS, max_observations=2.0)
"""Sides of columns: a narrow patch says less."""
ODOMETRY = ObservationModel(Loss(LossKind.CAUCHY, 5.0))
"""Departures of steps, six numbers a step, so 2.4 sigmas are usual; trackers jump now and then, and a jump
must not be smeared over the path. Nor must a false revisit be: with Cauchy's it tears a step, which is found,
and the revisit dropped; with Huber's or squares it bends the walk unseen (0.14 m instead of 0.03 on a walk of
two laps with three false visits)."""
SURFACES = ObservationModel(Loss(LossKind.CAUCHY, 3.0))
"""Departures of pairs that were matched by their surfaces (six numbers a pair, so 2.4 sigmas are usual): a
pair is right or false as a whole."""
CONTROL = ObservationModel(Loss(LossKind.CAUCHY, 3.0), max_observations=5.0)
"""Marks of a control point: one may be on the wrong corner, a point written wrongly. All marks of a point
share its survey and the depth's errors."""

ROBUST: Mapping[TermName, ObservationModel] = {
    "points": POINTS,
    "reprojection": REPROJECTION,
    "rays": RAYS,
    "floor": FLOOR,
    "ceiling": CEILING,
    "walls": WALLS,
    "columns": COLUMNS,
    "odometry": ODOMETRY,
    "surfaces": SURFACES,
    "control": CONTROL,
}
"""planfit's own cost: effective observations in sigmas, under losses that let go."""

PAPER_ROUNDING_M = 1e-6
"""The paper's unsquared norms are rounded off below this, prior to any noise: sqrt(d^2 + r^2) - r has a slope
everywhere."""
PAPER_ROUNDING_PX = 1e-3
"""The same of its reprojection error."""
_PAPER_NORM = ObservationModel(Loss(LossKind.NORM, PAPER_ROUNDING_M))

PAPER: Mapping[TermName, ObservationModel] = {
    **ROBUST,
    "points": _PAPER_NORM,
    # The paper gives these two no weight of their own; pixels and metres count as one.
    "reprojection": ObservationModel(Loss(LossKind.NORM, PAPER_ROUNDING_PX)),
    "rays": _PAPER_NORM,
    "floor": _PAPER_NORM,
    "ceiling": _PAPER_NORM,
    "walls": _PAPER_NORM,
    "columns": _PAPER_NORM,
}
"""The paper's cost: means of unsquared norms, a sigma being 1 m (or px). Ceilings and columns, which it has
not, count as its floor and walls do; the rest as in planfit's own."""
