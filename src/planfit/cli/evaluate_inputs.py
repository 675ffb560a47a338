"""What `planfit evaluate` compares: the poses of a scan before and after, in its own axes and on the plan."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from planfit.adjust.calibration import corrected_structure
from planfit.alignment import align, metric_plan
from planfit.cli.run_record import RunRecord, read_present_scan
from planfit.errors import FloorplanError, ScanError
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.pipeline.align import claimed_alignment, wall_samples
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime
from planfit.scan import Scan, ScanOptions, calibrated_scan
from planfit.scan.pose_files import take_poses
from planfit.segmentation import Structure, find_gravity, level_from_world, segment_scan


@dataclass(frozen=True)
class Compared:
    """A scan with its poses before and after."""

    scan: Scan
    floorplan: Floorplan | None
    """In metres."""
    structure: Structure
    world: tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4 4"]]
    """Before and after, in the scan's own axes."""
    plan: tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4 4"]]
    """Before and after, in the plan frame; without a plan, in the level frame."""
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class PosesSource:
    """What poses are of: a scan, and the plan to hold them to."""

    scan: Scan
    """As it was read, before its sensor is corrected."""
    floorplan: Floorplan | None
    """As drawn, or in metres at the scale of a run."""
    options: RefineOptions
    sensor: SensorCalibration = NOMINAL
    """How the run corrected the sensor."""

    def structure(self, runtime: Runtime) -> tuple[Float[np.ndarray, "4 4"], Structure]:
        """level_from_world, and floor and walls: found once, by the recorded poses, for before and after.

        As in a run they are found in the scan as it was read, and then corrected.
        """
        options = self.options.segmentation
        gravity = find_gravity(self.scan, options.gravity, runtime)
        structure = segment_scan(self.scan, gravity, options, runtime)
        level = level_from_world(gravity, structure.floor_height_m)
        return level, corrected_structure(structure, self.sensor)


def scan_source(
    scan_path: Path, scan_options: ScanOptions, plan_path: Path | None, plan: PlanOptions
) -> PosesSource:
    """A scan and its plan; without one given, that inside the scan's folder, if there is one.

    Raises:
        ScanError: a file cannot be used.
        FloorplanError: the plan cannot be read.
    """
    options = RefineOptions()
    scan = read_present_scan(scan_path, options.segmentation, scan_options)
    chosen = plan_path or scan.floorplan_path
    return PosesSource(scan, read_floorplan(chosen, plan) if chosen else None, options)


def run_source(
    record: RunRecord, scan_path: Path | None, plan_path: Path | None, plan: PlanOptions
) -> PosesSource:
    """The scan and the plan of a run, read as the run did: the plan in metres, at the run's scale.

    Args:
        record: of the run.
        scan_path: where the scan is now, if it was moved.
        plan_path: where the plan is now, if it was moved.
        plan: how to read it; as in the run.

    Raises:
        ScanError: the scan is another.
        FloorplanError: the plan is another.
    """
    scan = record.as_read(scan_path)
    return PosesSource(scan, record.floorplan(plan, plan_path), record.options, record.sensor)


def compare_run(record: RunRecord, source: PosesSource, runtime: Runtime) -> Compared:
    """Poses of a run of `planfit refine`, before and after; the cache of `runtime` is the run's."""
    recorded, (_, after) = source.scan.world_from_cams, record.poses()
    _, structure = source.structure(runtime)
    return Compared(
        calibrated_scan(source.scan, source.sensor),
        source.floorplan,
        structure,
        (recorded, record.world_from_plan @ after),
        (record.plan_from_world_before @ recorded, after),
    )


def compare_poses(
    source: PosesSource,
    given: Float[np.ndarray, "n 4 4"],
    poses_frame: Literal["world", "plan"],
    runtime: Runtime,
) -> Compared:
    """Poses from elsewhere, after, against those that the scan was recorded with, before.

    Poses in the scan's own axes are aligned with the plan as `planfit refine` would do it, by the walls they
    make, and the recorded ones with them by the same motion. Poses in the plan frame stay; the recorded ones
    are moved onto them by the rigid motion that fits best.

    Raises:
        ScanError: there are no walls to align the scan by.
        FloorplanError: the plan cannot be read, or its unit cannot be found.
    """
    options, scan, floorplan = source.options, source.scan, source.floorplan
    recorded = scan.world_from_cams
    if poses_frame == "plan" and floorplan is not None and not floorplan.is_metric:
        raise FloorplanError(
            f"{floorplan.name}: expected a plan in metres, as the poses are in its frame; give its "
            "unit with --unit or --scale, or the run's folder in place of the scan"
        )
    seen = calibrated_scan(scan, source.sensor)
    level, structure = source.structure(runtime)
    if poses_frame == "plan":
        plan_from_world = se3.fit_rigid(recorded[:, :3, 3], given[:, :3, 3])
        on_plan = (plan_from_world @ recorded, given)
        return Compared(
            seen, floorplan, structure, (recorded, se3.inverse(plan_from_world) @ given), on_plan
        )
    notes: tuple[str, ...] = ()
    if floorplan is not None:
        walls = wall_samples(structure, level @ given)
        if len(walls.xy) == 0:
            raise ScanError(
                f"{scan.name}: expected walls to align the scan by, found none; give poses in the "
                "plan's frame with --poses-frame plan"
            )
        claimed = claimed_alignment(scan, floorplan, level)
        alignment = align(walls, floorplan, options.align, claimed)
        notes = alignment.warnings
        level = alignment.plan_from_level @ level
        floorplan = metric_plan(floorplan, alignment.scale_xy)
    on_plan = (level @ recorded, level @ given)
    return Compared(seen, floorplan, structure, (recorded, given), on_plan, notes)


def poses_of(scan: Scan, path: Path, max_gap_s: float) -> Float[np.ndarray, "n 4 4"]:
    """Poses of all frames of a scan from a file."""
    posed = take_poses(scan, path, max_gap_s)
    if len(posed) < len(scan):
        raise ScanError(
            f"{path}: expected a pose for each of {len(scan)} frames, found {len(posed)}; times, or "
            "frame numbers, must be those of the scan"
        )
    return posed.world_from_cams
