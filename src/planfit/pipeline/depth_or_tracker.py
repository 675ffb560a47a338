"""Where recorded motion and images disagree: whether depth explains it that a sensor got wrong.

Depth that is wrong by its square or scale bends every motion that matches measure, and looks like a tracker
that errs three times more than usual, with jumps. Believed less, its steps no longer tell the metre, and
what depth gets wrong is not found any more: on ConSLAM with 0.01 z^2, 0.21 m instead of 0.11.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import Measurements, build_problem
from planfit.adjust.calibration import PRIORS, estimate_without_plan
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.geometry.camera import Camera
from planfit.matching.relative_motions import VerifiedPairs, matches_of
from planfit.matching.verify import match_sigma
from planfit.pipeline.options import RefineOptions
from planfit.scan.odometry import Odometry
from planfit.segmentation import no_structure
from planfit.tracking import Tracking

CLEARLY = 0.8
"""A tracker that errs by so much less once depth is corrected was not what erred."""
AS_WELL = 0.1
"""Share of the motions that one explanation may explain less than another, and still as well."""


def errs(tracking: Tracking) -> bool:
    """Whether the recorded motion is believed less, was corrected, or taken in a unit of its own."""
    is_in_metres = tracking.metres_per_unit == 1.0
    return max(tracking.sigma_factors) > 1.0 or len(tracking.breaks) > 0 or not is_in_metres


def errs_clearly_less(corrected: Tracking, as_lifted: Tracking) -> bool:
    """Whether a tracker errs less, and jumps no more, beside motions of corrected depth.

    Or whether it is in metres beside these, and they are explained about as well as in a unit of its own
    without correction: of sensors that are off by little and units of any size, the former is more usual.
    """
    fit, in_own_unit = corrected.convention_fit, as_lifted.convention_fit
    if as_lifted.metres_per_unit != 1.0 and fit is not None and in_own_unit is not None:
        is_explained = fit.share >= in_own_unit.share - AS_WELL
        return corrected.metres_per_unit == 1.0 and is_explained
    now, before = (float(np.prod(t.sigma_factors)) for t in (corrected, as_lifted))
    n_now, n_before = len(corrected.breaks), len(as_lifted.breaks)
    return (now <= CLEARLY * before and n_now <= n_before) or (now <= before and n_now < n_before)


def sensor_by_neighbours(
    verified: VerifiedPairs,
    world_from_keys: Float[np.ndarray, "k 4 4"],
    odometry: Odometry,
    cameras: tuple[Camera, ...],
    options: RefineOptions,
) -> SensorCalibration:
    """What matches of neighbouring keyframes and recorded steps, as sure as is usual, ask of a sensor.

    Args:
        verified: pairs of keyframes.
        world_from_keys: as recorded.
        odometry: steps between them.
        cameras: of the keyframes.
        options: of the adjustment.
    """
    if options.adjust.geometric != "points" or len(verified) == 0:
        return NOMINAL
    matches = matches_of(verified, len(verified), 0)
    measured = Measurements(matches, no_structure(len(world_from_keys)), odometry, cameras)

    solved = build_problem(measured, options.adjust, world_from_keys).solve().target_from_cams
    return estimate_without_plan(measured, solved, options.adjust, PRIORS).sensor


def corrected_pairs(verified: VerifiedPairs, sensor: SensorCalibration) -> VerifiedPairs:
    """Pairs with their points corrected, and the motions that these give."""
    if sensor.is_nominal:
        return verified
    points_a = [sensor.points(points) for points in verified.points_a]
    points_b = [sensor.points(points) for points in verified.points_b]
    motions = [
        se3.fit_rigid(b, a, 1.0 / match_sigma(a, b) ** 2)
        for a, b in zip(points_a, points_b, strict=True)
    ]
    relative = replace(verified.relative_poses, a_from_b=np.array(motions).reshape(-1, 4, 4))
    return VerifiedPairs(relative, points_a, points_b)
