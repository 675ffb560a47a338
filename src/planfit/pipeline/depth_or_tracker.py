"""Where recorded motion and images disagree: whether a sensor explains it that is other than its files say.

Depth that is wrong by its square or scale bends every motion that matches measure, and looks like a tracker
that errs three times more than usual, with jumps. Believed less, its steps no longer tell the metre, and
what depth gets wrong is not found any more: on ConSLAM with 0.01 z^2, 0.21 m instead of 0.11. A lens whose
centre is 15 px off looks like a camera that is carried 2 degrees askew and 0.12 m beside the body.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import Measurements, build_problem
from planfit.adjust.calibration import NOT_CALIBRATED, PRIORS, Calibration, estimate_without_plan
from planfit.geometry import se3
from planfit.geometry.calibration import SensorCalibration
from planfit.geometry.camera import Camera
from planfit.matching.relative_motions import VerifiedPairs, matches_of
from planfit.matching.verify import match_sigma
from planfit.pipeline.options import RefineOptions
from planfit.scan.odometry import Odometry
from planfit.segmentation import no_structure
from planfit.tracking import Tracking, in_metres
from planfit.tracking.conventions import MIN_MORE
from planfit.tracking.numbered import mount_of

CLEARLY = 0.8
"""A tracker that errs by so much less once depth is corrected was not what erred."""


def errs(tracking: Tracking) -> bool:
    """Whether the recorded motion is believed less, was corrected, taken in a unit of its own, or for that of
    a body which carries the camera a little askew."""
    is_corrected = max(tracking.sigma_factors) > 1.0 or len(tracking.breaks) > 0
    return is_corrected or not _is_as_asked(tracking)


def _is_as_asked(tracking: Tracking) -> bool:
    return tracking.metres_per_unit == 1.0 and not tracking.is_mount_doubtful


def as_if_asked(
    world_from_keys: Float[np.ndarray, "k 4 4"], tracking: Tracking
) -> Float[np.ndarray, "k 4 4"]:
    """Recorded poses in the convention found, as if they had no unit and no mount of their own."""
    fit = tracking.convention_fit
    mount = mount_of(fit.name) if fit is not None and fit.is_doubtful_mount else None
    poses = world_from_keys if mount is None else world_from_keys @ se3.inverse(mount)
    return in_metres(poses, 1 / tracking.metres_per_unit)


def errs_clearly_less(corrected: Tracking, as_lifted: Tracking) -> bool:
    """Whether a tracker errs less, and jumps no more, beside motions of corrected depth.

    Or whether it is in metres, and of the camera, beside these, and they are explained about as well as in a
    unit or by a mount of its own without correction: of sensors that are off and units of any size, or
    cameras carried a little askew, the former is more usual.
    """
    fit, of_its_own = corrected.convention_fit, as_lifted.convention_fit
    if not _is_as_asked(as_lifted) and fit is not None and of_its_own is not None:
        is_explained = fit.share >= of_its_own.share - MIN_MORE
        return corrected.metres_per_unit == 1.0 and not fit.is_mount and is_explained
    now, before = (float(np.prod(t.sigma_factors)) for t in (corrected, as_lifted))
    n_now, n_before = len(corrected.breaks), len(as_lifted.breaks)
    return (now <= CLEARLY * before and n_now <= n_before) or (now <= before and n_now < n_before)


def sensor_by_neighbours(
    verified: VerifiedPairs,
    world_from_keys: Float[np.ndarray, "k 4 4"],
    odometry: Odometry,
    cameras: tuple[Camera, ...],
    options: RefineOptions,
) -> Calibration:
    """What matches of neighbouring keyframes and recorded steps, as sure as is usual, ask of a sensor."""
    if options.adjust.geometric != "points" or len(verified) == 0:
        return NOT_CALIBRATED
    matches = matches_of(verified, len(verified), 0)
    measured = Measurements(matches, no_structure(len(world_from_keys)), odometry, cameras)

    solved = build_problem(measured, options.adjust, world_from_keys).solve().target_from_cams
    return estimate_without_plan(measured, solved, options.adjust, PRIORS)


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
