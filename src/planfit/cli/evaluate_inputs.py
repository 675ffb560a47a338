"""What `planfit evaluate` compares: the poses of a scan before and after, in its own axes and on the plan."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from planfit.alignment import align, metric_plan
from planfit.cli.config import options_of, scan_options_of
from planfit.errors import FloorplanError, OptionError, ScanError
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.geometry import se3
from planfit.pipeline.align import claimed_alignment, wall_samples
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime
from planfit.scan import Scan, ScanOptions, read_scan, read_tum
from planfit.scan.pose_files import take_poses
from planfit.segmentation import (
    SegmentationOptions,
    Structure,
    find_gravity,
    level_from_world,
    segment_scan,
)


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
class RunRecord:
    """What `run.json` says of a run, as far as its poses can be judged again."""

    folder: Path
    scan_path: Path
    scan_fingerprint: str
    plan_path: Path | None
    """None where it was made without a plan."""
    n_frames: int
    n_faces: int | None
    scale_xy: tuple[float, float]
    """Metres of one unit of the plan."""
    world_from_plan: Float[np.ndarray, "4 4"]
    plan_from_world_before: Float[np.ndarray, "4 4"]
    options: RefineOptions
    scan_options: ScanOptions

    def poses(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 4 4"]]:
        """Times, and refined plan_from_cams."""
        return read_tum(self.folder / "trajectory.tum")

    def scan(self, moved_to: Path | None = None) -> Scan:
        """The scan, read as the run read it.

        Raises:
            ScanError: it is not there, or has other frames.
        """
        path = moved_to or self.scan_path
        scan = _read_scan(path, self.options.segmentation, self.scan_options)
        n_poses = len(self.poses()[0])
        if len(scan) != self.n_frames or n_poses != self.n_frames:
            raise ScanError(
                f"{path}: expected the {self.n_frames} frames of the run, found {len(scan)}, and "
                f"{n_poses} refined poses; give the run's scan with --scan"
            )
        return scan

    def floorplan(self, options: PlanOptions, moved_to: Path | None = None) -> Floorplan | None:
        """The plan, in metres at the run's scale; None where the run had none.

        Raises:
            FloorplanError: it cannot be read, or is another.
        """
        path = moved_to or self.plan_path
        return None if path is None else _read_plan(path, options, self.n_faces, self.scale_xy)


def read_record(folder: Path) -> RunRecord:
    """The record of a run of `planfit refine`.

    Raises:
        ScanError: the folder is not that of a run, or of one of another version.
    """
    record, where = _read_record(folder), f"{folder / 'run.json'}: "
    if record.get("storeys"):
        raise ScanError(
            f"{where}expected a run on one plan, found one on plans by storey; its metrics are in that file, "
            "each wall against its storey's plan; or give SCAN --poses trajectory.tum --poses-frame plan"
        )
    try:
        inputs, alignment = record["inputs"], record["alignment"]
        return RunRecord(
            folder=folder,
            scan_path=Path(inputs["scan"]),
            scan_fingerprint=str(inputs["scan_fingerprint"]),
            plan_path=Path(inputs["plan"]) if "plan" in inputs else None,
            n_frames=int(record["frames"]),
            n_faces=record["plan_faces"],
            scale_xy=tuple(alignment["metres_per_unit_xy"]) if alignment else (1.0, 1.0),
            world_from_plan=np.array(record["world_from_plan"], dtype=float).reshape(4, 4),
            plan_from_world_before=np.array(record["plan_from_world_before"], dtype=float).reshape(
                4, 4
            ),
            options=options_of(record["options"], RefineOptions(), where),
            scan_options=scan_options_of(record, where),
        )
    except (ValueError, KeyError, TypeError, OptionError) as error:
        raise ScanError(
            f"{where}expected the record of a run of this version, found a damaged or an older one; "
            "run 'planfit refine' again"
        ) from error


def read_run(
    folder: Path,
    scan_path: Path | None,
    plan_path: Path | None,
    plan: PlanOptions,
    runtime: Runtime,
) -> Compared:
    """Poses of a run of `planfit refine`, before and after.

    Args:
        folder: the output folder of the run.
        scan_path: where the scan is now, if it was moved.
        plan_path: where the plan is now, if it was moved.
        plan: how to read it; as in the run.
        runtime: its cache is the run's.

    Raises:
        ScanError: the folder is not that of a run, or the scan is another.
        FloorplanError: the plan is another.
    """
    record = read_record(folder)
    scan = record.scan(scan_path)
    floorplan = record.floorplan(plan, plan_path)
    _, after = record.poses()
    _, structure = _structure(scan, record.options.segmentation, runtime)
    return Compared(
        scan,
        floorplan,
        structure,
        (scan.world_from_cams, record.world_from_plan @ after),
        (record.plan_from_world_before @ scan.world_from_cams, after),
    )


def _read_plan(
    path: Path, options: PlanOptions, n_faces: int | None, scale_xy: tuple[float, float]
) -> Floorplan:
    """The plan of a run, in metres."""
    if n_faces is None:
        raise FloorplanError(
            f"{path}: expected no plan, as the run was made without one, found one; leave out --plan, or "
            "run 'planfit refine' with it"
        )
    floorplan = read_floorplan(path, options)
    if len(floorplan) != n_faces:
        raise FloorplanError(
            f"{path}: expected the {n_faces} wall faces that the run read, found "
            f"{len(floorplan)}; give the same plan, unit and storey as to 'planfit refine'"
        )
    if floorplan.is_metric and scale_xy == (1.0, 1.0):
        return floorplan
    return metric_plan(floorplan, scale_xy)


def read_poses(
    scan_path: Path,
    scan_options: ScanOptions,
    plan_path: Path | None,
    poses_path: Path,
    poses_frame: Literal["world", "plan"],
    plan: PlanOptions,
    runtime: Runtime,
) -> Compared:
    """Poses from a file, after, against those that the scan was recorded with, before.

    The scan is read by `scan_options`. Poses in its own axes are aligned with the plan as `planfit refine`
    would do it, by the walls they make, and the recorded ones with them by the same motion. Poses in the
    plan frame stay; the recorded ones are moved onto them by the rigid motion that fits best.

    Raises:
        ScanError: a file cannot be used, or frames have no pose.
        FloorplanError: the plan cannot be read, or its unit cannot be found.
    """
    options = RefineOptions()
    scan = _read_scan(scan_path, options.segmentation, scan_options)
    given = poses_of(scan, poses_path, scan_options.max_time_gap_s)
    plan_path = plan_path or scan.floorplan_path
    floorplan = read_floorplan(plan_path, plan) if plan_path else None
    recorded = scan.world_from_cams
    if poses_frame == "plan":
        plan_from_world = se3.fit_rigid(recorded[:, :3, 3], given[:, :3, 3])
        if floorplan is not None and not floorplan.is_metric:
            raise FloorplanError(
                f"{plan_path}: expected a plan in metres, as the poses are in its frame; give its "
                "unit with --unit or --scale"
            )
        _, structure = _structure(scan, options.segmentation, runtime)
        on_plan = (plan_from_world @ recorded, given)
        return Compared(
            scan, floorplan, structure, (recorded, se3.inverse(plan_from_world) @ given), on_plan
        )
    level, structure = _structure(scan, options.segmentation, runtime)
    notes: list[str] = []
    if floorplan is not None:
        walls = wall_samples(structure, level @ given)
        claimed = claimed_alignment(scan, floorplan, level)
        if len(walls.xy) == 0:
            raise ScanError(
                f"{scan_path}: expected walls to align the scan by, found none; give poses in the "
                "plan's frame with --poses-frame plan"
            )
        alignment = align(walls, floorplan, options.align, claimed)
        notes += alignment.warnings
        level = alignment.plan_from_level @ level
        if not floorplan.is_metric:
            floorplan = metric_plan(floorplan, alignment.scale_xy)
    on_plan = (level @ recorded, level @ given)
    return Compared(scan, floorplan, structure, (recorded, given), on_plan, tuple(notes))


def _structure(
    scan: Scan, options: SegmentationOptions, runtime: Runtime
) -> tuple[Float[np.ndarray, "4 4"], Structure]:
    """level_from_world, and floor and walls: found once, by the recorded poses, for both."""
    gravity = find_gravity(scan, options.gravity, runtime)
    structure = segment_scan(scan, gravity, options, runtime)
    return level_from_world(gravity, structure.floor_height_m), structure


def _read_scan(path: Path, segmentation: SegmentationOptions, options: ScanOptions) -> Scan:
    if not path.exists():
        raise ScanError(f"{path}: expected the scan, found nothing; say where it is with --scan")
    return read_scan(path, segmentation.reads_masks, options)


def _read_record(folder: Path) -> dict[str, Any]:
    path = folder / "run.json"
    if not path.exists():
        raise ScanError(
            f"{path}: expected the record of a run, found nothing; give the output folder of "
            "'planfit refine', or a scan with --poses"
        )
    try:
        record = json.loads(path.read_text())
    except (ValueError, OSError) as error:
        raise ScanError(
            f"{path}: expected the record of a run, found a damaged file; run 'planfit refine' again"
        ) from error
    return record if isinstance(record, dict) else {}


def poses_of(scan: Scan, path: Path, max_gap_s: float) -> Float[np.ndarray, "n 4 4"]:
    """Poses of all frames of a scan from a file."""
    posed = take_poses(scan, path, max_gap_s)
    if len(posed) < len(scan):
        raise ScanError(
            f"{path}: expected a pose for each of {len(scan)} frames, found {len(posed)}; times, or "
            "frame numbers, must be those of the scan"
        )
    return posed.world_from_cams
