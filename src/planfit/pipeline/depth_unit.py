"""Whether depth is in another unit than it was read in, where recorded motion has another metre than depth.

Two explanations: depth was stored in another of the units that are in use, and the poses are in metres; or
poses have a unit of their own, as those of one camera do. The first has a known factor, the second any.
Which of the two, the factor and the sizes of what depth shows tell. Odds of 100 decide, as elsewhere.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from planfit.adjust.calibration import PRIORS
from planfit.alignment import is_clearly_likelier
from planfit.errors import ScanError
from planfit.findings import Finding, PoseKind
from planfit.geometry.calibration import SensorCalibration
from planfit.priors import (
    CAMERA_HEIGHT_M,
    CAMERA_HEIGHT_SIGMA_SHARE,
    OTHER_HEIGHT_SHARE,
    OTHER_UNIT_SHARE,
    ROOM_HEIGHT_SIGMA_SHARE,
    STOREY_HEIGHT_M,
    STRANGE_SIZE_SHARE,
    SURE_SIGMAS,
    SURFACE_TILT_MOST_DEG,
    VIEW_DISTANCE_M,
    VIEW_DISTANCE_SIGMA_SHARE,
    WALL_HEIGHT_M,
    Prior,
)
from planfit.scan import Scan, calibrated_scan, depth_of_nine, median_depth_m
from planfit.segmentation import most_common_upright, oriented_points
from planfit.tracking import Tracking
from planfit.units import FOOT_M

MILLIMETRE, TUM, REPLICA = 1e-3, 1 / 5000, 1 / 6553.5
"""Metres of a unit: of most recorders; of the TUM benchmark, and lists in its form; of NICE-SLAM's
renderings."""
WHOLE_UNITS = (MILLIMETRE, TUM, 1 / 4000, REPLICA, 1 / 256)
"""All that whole numbers of depth are stored in; 1/256 in KITTI's depth maps."""
FLOAT_UNITS = (MILLIMETRE, FOOT_M)
"""All that floating-point numbers of depth are stored in, beside metres; feet by imperial modellers."""
ANY = 1e3
"""Units of poses' own lie between a thousandth of a metre and so many metres, and sizes that are not those of
rooms within such a factor; each is as likely."""
LEVEL = float(np.cos(np.deg2rad(SURFACE_TILT_MOST_DEG.value)))
"""Upward part of the normals of floors and tables, and downward part of ceilings'."""
MIN_LEVEL = 50
"""Pixels of level surfaces that tell of a floor, or of a ceiling."""
FLOOR_SHARE = 0.9
"""The floor is further below the camera than this share of all level surfaces: of tables and seats, too."""


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

    def undecided(self, scan: Scan) -> ScanError:
        """What to say where nothing tells whether the rival is right."""
        return ScanError(
            f"{scan.name}: expected poses and depth in metres, found recorded motion {self.rival:.3g} "
            "times as long as depth shows it, and nothing tells which is right: if poses are in metres, "
            f"give --depth-scale (metres of one stored unit) {self.rival:.4g} times what it is; if depth "
            f"is, give --poses-convention unit:{1 / self.rival:.4g}"
        )


AS_READ = DepthUnit()


def in_unit(scan: Scan, unit: DepthUnit) -> Scan:
    """The scan with depth in metres, as if its unit had been stated; the very same one where it is."""
    if unit.factor == 1.0:
        return scan
    scaled = calibrated_scan(scan, SensorCalibration(depth_scale=unit.factor))
    return replace(scaled, depth_read_in_m=None)


@dataclass(frozen=True)
class Sizes:
    """What depth as read shows of sizes that are known beforehand; None where it shows none."""

    median_m: float | None
    """Median depth."""
    camera_height_m: float | None
    """Of the camera over the floor."""
    room_height_m: float | None = None
    """Of the ceiling over the floor."""

    @staticmethod
    def of(scan: Scan) -> "Sizes":
        """Those of nine frames.

        Raises:
            ScanError: as `median_depth_m`.
        """
        if scan.depth_read_in_m is None:
            return Sizes(None, None)
        return Sizes(median_depth_m(scan), *_heights_m(scan))

    def cost(self, factor: float) -> float:
        """Twice the negative log likelihood of these, if depth is to be multiplied by a factor."""
        of_median = _cost(self.median_m, factor, VIEW_DISTANCE_M, VIEW_DISTANCE_SIGMA_SHARE)
        of_height = _cost(self.camera_height_m, factor, CAMERA_HEIGHT_M, CAMERA_HEIGHT_SIGMA_SHARE)
        of_room = _cost(
            self.room_height_m, factor, WALL_HEIGHT_M, ROOM_HEIGHT_SIGMA_SHARE, STOREY_HEIGHT_M.high
        )
        return of_median + of_height + of_room


@runtime_checkable
class Judged(Protocol):
    """Recorded poses that were judged beside depth in some unit."""

    @property
    def tracking(self) -> Tracking:
        """What they came to."""
        ...


T = TypeVar("T", bound=Judged)


def judged_in_its_unit(scan: Scan, judged_in: Callable[[DepthUnit], T]) -> tuple[T, DepthUnit]:
    """The recorded poses judged beside depth in the unit that sizes and motion ask for, and that unit."""
    sizes = Sizes.of(scan)
    by_size = unit_by_size(scan, sizes)
    if by_size != AS_READ:
        tried = judged_in(by_size)
        if tried.tracking.is_confirmed:
            return tried, by_size
        unit = unit_by_motion(scan, tried.tracking, sizes, by_size)
        if unit != AS_READ:
            return judged_in(unit), unit
    judged = judged_in(AS_READ)
    unit = unit_by_motion(scan, judged.tracking, sizes)
    return (judged if unit.factor == 1.0 else judged_in(unit)), unit


def unit_by_size(scan: Scan, sizes: Sizes) -> DepthUnit:
    """The unit that sizes alone find likelier than the one read in: to be tried, no more."""
    factors = _factors(scan)
    if not factors:
        return AS_READ
    best = min(factors, key=sizes.cost)
    other = OTHER_UNIT_SHARE.value
    as_other = sizes.cost(best) - 2 * np.log(other / len(factors))
    as_read = sizes.cost(1.0) - 2 * np.log(1 - other)
    return DepthUnit(best) if as_other < as_read else AS_READ


def unit_by_motion(
    scan: Scan, tracking: Tracking, sizes: Sizes, tried: DepthUnit = AS_READ
) -> DepthUnit:
    """The unit of depth that a tracker in metres and sizes ask for, where depth has another metre.

    Args:
        scan: as read.
        tracking: judged beside depth in the unit `tried`.
        sizes: of the scan as read.
        tried: a unit.
    """
    fit, factors = tracking.convention_fit, _factors(scan)
    is_off = fit is not None and fit.is_own_unit and fit.is_clear
    if not (is_off and factors):
        return AS_READ
    ratio = tried.factor / tracking.metres_per_unit
    off = np.log(ratio) - np.log(factors)
    sigma = float(np.hypot(PRIORS.depth_scale_sigma, PRIORS.odometry_scale_sigma))
    k = int(np.argmin(np.abs(off)))
    if abs(off[k]) > SURE_SIGMAS.value * sigma:
        return AS_READ
    # Twice negative logarithms: of the factor among all that are in use, of any unit that poses may have.
    of_depth = (off[k] / sigma) ** 2 + 2 * np.log(len(factors) * sigma * np.sqrt(2 * np.pi))
    of_poses = 2 * np.log(2 * np.log(ANY))
    of_depth += sizes.cost(factors[k])
    of_poses += sizes.cost(1.0)
    if is_clearly_likelier(of_poses - of_depth):
        return DepthUnit(factors[k])
    return AS_READ if is_clearly_likelier(of_depth - of_poses) else DepthUnit(rival=factors[k])


def _factors(scan: Scan) -> tuple[float, ...]:
    """On depth, if it is in another unit than it was read in; none where its unit is stated."""
    read_m = scan.depth_read_in_m
    if read_m is None:
        return ()
    units = FLOAT_UNITS if read_m == 1.0 else WHOLE_UNITS
    return tuple(unit / read_m for unit in units if unit != read_m)


def _cost(
    size_m: float | None,
    factor: float,
    usual_m: Prior,
    sigma_share: Prior,
    highest_m: float | None = None,
) -> float:
    """Twice the negative log likelihood of a size: usual, or now and then any. Heights may also be those of
    halls, up to the highest, and of tables under shelves, from half the usual one on."""
    if size_m is None:
        return 0.0
    sigmas = np.log(factor * size_m / usual_m.value) / sigma_share.value
    usual = np.exp(-0.5 * sigmas**2) / (sigma_share.value * np.sqrt(2 * np.pi))
    if highest_m is not None:
        is_within = usual_m.value / 2 <= factor * size_m <= highest_m
        of_others = is_within / np.log(2 * highest_m / usual_m.value)
        usual = (1 - OTHER_HEIGHT_SHARE.value) * usual + OTHER_HEIGHT_SHARE.value * of_others
    strange = STRANGE_SIZE_SHARE.value
    return float(-2 * np.log((1 - strange) * usual + strange / np.log(ANY)))


def _heights_m(scan: Scan) -> tuple[float | None, float | None]:
    """Of cameras and of the ceiling over the floor, as level surfaces show it in nine frames; None where none
    do.

    By each frame's own upright, which needs no poses: their convention is not known yet.
    """
    heights_m: list[np.ndarray] = [np.zeros(0)]
    for i, depth in depth_of_nine(scan):
        points, normals = oriented_points(scan.cameras[i], depth)
        up = most_common_upright(normals, np.array([0.0, -1.0, 0.0])).up_world
        height_m, facing = points @ up, normals @ up
        # Of floors and tables below the camera, which face up, and of what faces down above it.
        heights_m.append(height_m[(np.abs(facing) > LEVEL) & (height_m * facing < 0)])
    height_m = np.concatenate(heights_m)
    below_m, above_m = -height_m[height_m < 0], height_m[height_m > 0]
    if len(below_m) < MIN_LEVEL:
        return None, None
    camera_m = float(np.quantile(below_m, FLOOR_SHARE))
    if len(above_m) < MIN_LEVEL:
        return camera_m, None
    return camera_m, camera_m + float(np.median(above_m))
