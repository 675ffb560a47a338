"""Each scan by itself: all that its images and its tracker say, before it meets the others.

Convention and clock of the poses, gravity, keyframes and sensor are each scan's own: scans may come from
other devices, other worlds and other days.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.calibration import Calibration
from planfit.errors import OptionError, ScanError
from planfit.geometry.calibration import SensorCalibration
from planfit.matching.tentative import ScanKeypoints
from planfit.pipeline.calibrate import calibrate_alone, with_priors_of_poses
from planfit.pipeline.depth_unit import in_unit
from planfit.pipeline.observations import Observations, observe
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan
from planfit.pipeline.recorded_motion import with_poses
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan, calibrated_scan
from planfit.tracking import Tracking


@dataclass(frozen=True)
class ObservedScan:
    """A scan as it is known alone."""

    name: str
    """Short, and no other's."""
    scan: Scan
    """As recorded."""
    observations: Observations
    """As its own sensor should have measured it."""
    prepared: PreparedScan
    """The same, loops closed."""
    keypoints: ScanKeypoints
    """Of the keyframes, likewise corrected."""
    calibration: Calibration
    """Of its sensor, by what needs no plan."""

    @property
    def tracking(self) -> Tracking:
        """How far its recorded poses are believed."""
        found = self.observations.tracking
        assert found is not None  # `observe` always gives one
        return found

    @property
    def corrected_scan(self) -> Scan:
        """The scan in our convention, as its sensor should have measured it."""
        own = in_unit(self.scan, self.observations.depth_unit)
        own = with_poses(own, self.tracking.recorded_world_from_cams)
        return calibrated_scan(own, self.calibration.sensor)

    @property
    def level_from_world(self) -> Float[np.ndarray, "4 4"]:
        """To its own axes turned upright, floor at 0."""
        return self.prepared.level_from_world

    @property
    def keyframe_idx(self) -> Int[np.ndarray, " k"]:
        """Frames that were looked at."""
        return self.prepared.keyframes.frame_idx


def observe_scan(
    name: str, scan: Scan, options: RefineOptions, runtime: Runtime, timer: StageTimer
) -> ObservedScan:
    """Look at a scan alone.

    Raises:
        ScanError: a file of it cannot be used, or it walks through several storeys.
        OptionError: options name matches of one scan.
    """
    if options.matching.colmap:
        raise OptionError(
            "matching.colmap: expected one scan, found several; leave it out, or refine each scan alone"
        )
    seen, known = observe(scan, options, runtime, timer)
    assert known is not None
    heights_m = seen.structure.floor_heights_m
    if not np.all(heights_m == 0.0):
        raise ScanError(
            f"{scan.name}: expected scans of one storey, found one that walks through several; refine it "
            "alone, with a plan for each storey (--plan 0=FILE --plan 1=FILE)"
        )
    if seen.depth_unit.rival != 1.0:
        raise seen.depth_unit.undecided(scan)
    in_metres = in_unit(scan, seen.depth_unit)
    calibrated = calibrate_alone(in_metres, with_priors_of_poses(seen), options, timer)
    keypoints = _corrected(known.keypoints, calibrated.calibration.sensor)
    return ObservedScan(
        name,
        scan,
        calibrated.observations,
        calibrated.prepared,
        keypoints,
        calibrated.calibration,
    )


def _corrected(seen: ScanKeypoints, sensor: SensorCalibration) -> ScanKeypoints:
    """Keypoints and views as a calibrated sensor would have measured them."""
    if sensor.is_nominal:
        return seen
    keypoints = [replace(k, points_cam=sensor.points(k.points_cam)) for k in seen.keypoints]
    depth_m = sensor.depths(seen.grids.depth_m).astype(np.float32)
    key = f"{seen.key}-{sensor.vector.tolist()}" if seen.key else ""
    return replace(seen, keypoints=keypoints, grids=replace(seen.grids, depth_m=depth_m), key=key)
