"""How far a sensor, an odometry and a plan may be off, and what it takes to believe that they are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.errors import require_positive


@dataclass(frozen=True)
class CalibrationOptions:
    """Whether the sensor is looked at."""

    is_on: bool = True
    """Whether anything is estimated."""


@dataclass(frozen=True)
class CalibrationPriors:
    """Prior standard deviations of what all frames share; 0 holds a parameter at its nominal value.

    Which of depth, odometry and plan is wrong where their scales disagree is a matter of these alone. They
    are what devices and drawings are like, so no user sets them; what poses and plan of a run are known for
    does (`planfit.pipeline.calibrate`).
    """

    depth_scale_sigma: float = 0.03
    """Of the factor on depth: phones and time-of-flight cameras are off by 1 to 2 %, some by 5 %."""
    depth_offset_sigma_m: float = 0.02
    """Of what is added to every depth."""
    depth_quadratic_sigma_per_m: float = 0.004
    """Of the part that grows with the square of the depth: structured light and stereo."""
    focal_scale_sigma: float = 0.03
    """Of the factor on both focal lengths."""
    focal_aspect_sigma: float = 0.0
    """Of the focal length in y by that in x. Held by default: pixels are square, and on ConSLAM, whose are,
    the cost asks for 12 %."""
    principal_sigma: float = 0.008
    """Of the principal point in x and y, as a share of the focal length: 4 px of 500."""
    odometry_scale_sigma: float = 0.01
    """Of the factor on recorded steps: of the 0.5 to 2 % of their way that trackers err by (KITTI odometry
    benchmark), a part is of the metre."""
    plan_scale_sigma: float = 0.006
    """Of the factor on a metric plan that `align` finds a little off."""
    half_thickness_sigma_m: float = 0.02
    """Of half the thickness of walls, as found, where a plan draws them by their centre lines: it looks like
    an offset of depth."""
    min_sigmas: float = 3.0
    """A parameter is kept where it departs by so many of its standard deviations, the others free."""
    max_rounds: int = 4
    """Solves of all poses at most, a step of the parameters after each."""

    def __post_init__(self) -> None:
        require_positive(self, "min_sigmas", "max_rounds")

    @property
    def sigmas(self) -> Float[np.ndarray, " s"]:
        """In the order of `planfit.adjust.calibration.blocks.SHARED`."""
        return np.array(
            [
                self.depth_scale_sigma,
                self.depth_offset_sigma_m,
                self.depth_quadratic_sigma_per_m,
                self.focal_scale_sigma,
                self.focal_aspect_sigma,
                self.principal_sigma,
                self.principal_sigma,
                self.odometry_scale_sigma,
                self.plan_scale_sigma,
                self.half_thickness_sigma_m,
            ]
        )


PRIORS = CalibrationPriors()
"""Of an unknown sensor, a tracker that knows the metre and a plan in metres."""
