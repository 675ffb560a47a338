"""Whether depth is in another unit than it was read in, where recorded motion has another metre than depth.

Two explanations: depth was stored in another of the units that are in use, and the poses are in metres; or
poses have a unit of their own, as those of one camera do. The first has a known factor, the second any.
Which of the two, the factor and the sizes of what depth shows tell. Odds of 100 decide, as elsewhere.
"""

from dataclasses import dataclass

import numpy as np

from planfit.adjust.calibration import PRIORS
from planfit.alignment import is_clearly_likelier
from planfit.errors import ScanError
from planfit.findings import Finding, PoseKind
from planfit.floorplan import Floorplan
from planfit.geometry.calibration import SensorCalibration
from planfit.priors import SURE_SIGMAS, VIEW_DISTANCE_M, VIEW_DISTANCE_SIGMA_SHARE
from planfit.scan import Scan, calibrated_scan, median_depth_m
from planfit.scan.images.decode import USUAL_DEPTH_M
from planfit.tracking import Tracking

MILLIMETRE, TUM, REPLICA, FOOT = 1e-3, 1 / 5000, 1 / 6553.5, 0.3048
"""Metres of a unit: of most recorders; of the TUM benchmark, and lists in its form; of NICE-SLAM's
renderings; of an imperial modeller's."""
UNITS = (MILLIMETRE, TUM, 1 / 4000, REPLICA, 1 / 256, FOOT)
"""All that depth is stored in; 1/256 in KITTI's depth maps."""
READ_IN = {1.0: (MILLIMETRE, FOOT), MILLIMETRE: UNITS[1:5], TUM: (MILLIMETRE, *UNITS[2:5])}
"""Of the units that depth is read in where nothing says otherwise, those that it may be in instead."""
FACTORS = tuple(unit / read for read, units in READ_IN.items() for unit in units)
"""On depth, if it is in another unit."""
POSE_UNITS = 1e3
"""Units of poses' own lie between a thousandth of a metre and so many metres, each factor as likely."""


@dataclass(frozen=True)
class DepthUnit:
    """What depth is multiplied by, as another unit than it was read in asks for."""

    factor: float = 1.0
    """Applied; 1: none."""
    rival: float = 1.0
    """One that may be right as well, and was not applied; 1: none."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What a user should know of it."""
        if self.factor == 1.0:
            return ()
        return (Finding(PoseKind.DEPTH_UNIT_TAKEN, {"depth_factor": self.factor}),)

    def require_decided(self, scan: Scan, floorplan: object) -> None:
        """Raise `ScanError` where the factor is open, and no plan in metres says which metre is right."""
        has_metre = isinstance(floorplan, Floorplan) and floorplan.is_metric
        if self.rival != 1.0 and not has_metre:
            raise ScanError(
                f"{scan.name}: expected poses and depth in metres, found recorded motion {self.rival:.3g} "
                "times as long as depth shows it, and nothing tells which is right: if poses are in metres, "
                f"give --depth-scale (metres of one stored unit) {self.rival:.4g} times what it is; if depth "
                f"is, give --poses-convention unit:{1 / self.rival:.4g}"
            )


AS_READ = DepthUnit()


def in_unit(scan: Scan, unit: DepthUnit) -> Scan:
    """The scan with depth in metres; the very same one where it is."""
    return calibrated_scan(scan, SensorCalibration(depth_scale=unit.factor))


def unit_by_size(scan: Scan) -> DepthUnit:
    """The unit that sizes alone ask for, to be tried: where depth as read is that of no building.

    Raises:
        ScanError: as `median_depth_m`.
    """
    median_m = median_depth_m(scan)
    near_m, far_m = USUAL_DEPTH_M
    if median_m is None or near_m <= median_m <= far_m:
        return AS_READ
    return DepthUnit(min(FACTORS, key=lambda factor: _cost_of_size(factor * median_m)))


def unit_by_motion(scan: Scan, tracking: Tracking) -> DepthUnit:
    """The unit of depth that a tracker in metres and sizes ask for, where depth has another metre."""
    fit, ratio = tracking.convention_fit, 1 / tracking.metres_per_unit
    median_m = None if ratio == 1.0 else median_depth_m(scan)
    if median_m is None or fit is None or not (fit.is_own_unit and fit.is_clear):
        return AS_READ
    off = np.log(ratio) - np.log(FACTORS)
    sigma = float(np.hypot(PRIORS.depth_scale_sigma, PRIORS.odometry_scale_sigma))
    k = int(np.argmin(np.abs(off)))
    if abs(off[k]) > SURE_SIGMAS.value * sigma:
        return AS_READ
    # Twice negative logarithms: of the factor among all that are in use, of any unit that poses may have.
    of_depth = (off[k] / sigma) ** 2 + 2 * np.log(len(FACTORS) * sigma * np.sqrt(2 * np.pi))
    of_poses = 2 * np.log(2 * np.log(POSE_UNITS))
    of_depth += _cost_of_size(FACTORS[k] * median_m)
    of_poses += _cost_of_size(median_m)
    if is_clearly_likelier(of_poses - of_depth):
        return DepthUnit(FACTORS[k])
    return AS_READ if is_clearly_likelier(of_depth - of_poses) else DepthUnit(rival=FACTORS[k])


def _cost_of_size(median_m: float) -> float:
    """Squared sigmas by which depth departs from that of usual rooms."""
    departure = np.log(median_m / VIEW_DISTANCE_M.value)
    return float((departure / VIEW_DISTANCE_SIGMA_SHARE.value) ** 2)
