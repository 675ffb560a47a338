"""How far a sensor, an odometry and a plan may be off, and what it takes to believe that they are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.errors import require_positive, require_share


@dataclass(frozen=True)
class CalibrationOptions:
    """Prior standard deviations of what all frames share; 0 holds a parameter at its nominal value.

    Which of depth, odometry and plan is wrong where their scales disagree is a matter of these alone.
    """

    is_on: bool = True
    """Whether anything is estimated."""
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
    odometry_scale_sigma: float = 0.003
    """Of the factor on recorded steps: visual-inertial and LiDAR trackers know the metre."""
    plan_scale_sigma: float = 0.006
    """Of the factor on a metric plan that `align` finds a little off."""
    half_thickness_sigma_m: float = 0.02
    """Of half the thickness of walls, as found, where a plan draws them by their centre lines: it looks like
    an offset of depth."""
    min_sigmas: float = 3.0
    """A parameter is kept where it departs by so many of its standard deviations, the others free."""
    min_gain_share: float = 0.004
    """The cost has to fall by this share of itself for each parameter kept (but for the depth's scale).
    Without fault, a parameter alone is worth up to 0.003 on a synthetic flat; 2 % of the focal length 0.005
    (ConSLAM) to 0.1, 5 cm of depth 0.1, 0.01 z^2 0.2."""
    max_prior_sigmas: float = 3.0
    """A departure by more of its prior standard deviations is no calibration: nothing is corrected, and it is
    said. In 7-Scenes' kitchen the principal point would be 17 px off in every part of the walk: colour and
    depth are not registered well there, and correcting both for it takes the error from 0.023 to 0.040 m."""
    min_scale: float = 0.01
    """Scales of depth and focal lengths are left alone below this departure: what calibrations and
    interpolated depth do anyway."""
    min_offset_m: float = 0.015
    """Likewise the depth's offset."""
    min_quadratic_per_m: float = 0.002
    """Likewise the depth's quadratic part."""
    min_principal: float = 0.005
    """Likewise the principal point."""
    max_rounds: int = 4
    """Solves of all poses at most, a step of the parameters after each."""

    def __post_init__(self) -> None:
        require_positive(self, "min_sigmas", "max_prior_sigmas", "max_rounds")
        require_share(self, "min_gain_share")

    @property
    def smallest(self) -> Float[np.ndarray, " s"]:
        """Departures that are kept, at least, in the order of `SHARED`."""
        depth = (self.min_scale, self.min_offset_m, self.min_quadratic_per_m)
        return np.array(
            [
                *depth,
                self.min_scale,
                self.min_scale,
                self.min_principal,
                self.min_principal,
                0.0,
                0.0,
                0.0,
            ]
        )

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
