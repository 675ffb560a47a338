"""The record of a run, and the scan and plan that it names, as the run took them."""

import json
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.alignment import metric_plan
from planfit.as_built.record import DAMAGES
from planfit.corrections import NO_CORRECTIONS, Corrections
from planfit.corrections.file import corrections_of
from planfit.errors import FloorplanError, OptionError, ScanError
from planfit.export.poses import AXES, PlanAxes
from planfit.export.tables import FILES_OF_SCAN
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.geometry.calibration import SensorCalibration
from planfit.pipeline.corrected import corrected_plan
from planfit.pipeline.depth_unit import DepthUnit, in_unit
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.recorded_motion import with_poses
from planfit.runtime import archive_of, options_of
from planfit.scan import Scan, ScanOptions, calibrated_scan, read_scan, read_tum
from planfit.scan.pose_files import take_poses
from planfit.segmentation import SegmentationOptions
from planfit.tracking.conventions import RECORDED, apply_convention

MAX_TIME_GAP_S = 1e-4
"""Times that differ by more are those of other frames; `trajectory.tum` keeps microseconds."""


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
    convention: str
    """That the scan's poses are in: what the run was told, or found."""
    options: RefineOptions
    """As given to the run, but for `poses_convention`: `scan` gives poses in our own."""
    scan_options: ScanOptions
    depth_unit: DepthUnit
    """Of the scan's depth, as the run found it."""
    sensor: SensorCalibration
    """As the run corrected it."""
    axes: dict[str, PlanAxes]
    """Of the plan's `file` and of the `map`, those that it has."""
    corrections: Corrections = NO_CORRECTIONS
    """By hand, that the run was made with."""

    def poses(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 4 4"]]:
        """Times, and refined plan_from_cams."""
        return read_tum(self.folder / "trajectory.tum")

    def scan(self, moved_to: Path | None = None, options: ScanOptions | None = None) -> Scan:
        """The scan as the run left it: read as `as_read` does it, its sensor corrected as the run did."""
        return calibrated_scan(self.as_read(moved_to, options), self.sensor)

    def as_read(self, moved_to: Path | None = None, options: ScanOptions | None = None) -> Scan:
        """The scan, read as the run read it, its poses in our convention as the run took them.

        What is extracted from it is in the run's cache, by a sensor that is not corrected yet.

        Raises:
            ScanError: it is not there, or has other frames.
            OptionError: the run's convention has no such name here.
        """
        path = moved_to or self.scan_path
        scan = read_present_scan(path, self.options.segmentation, options or self.scan_options)
        scan = in_unit(scan, self.depth_unit)
        scan = with_poses(scan, apply_convention(scan.world_from_cams, self.convention))
        times, n = self.poses()[0], self.n_frames
        if (len(scan), len(times)) != (n, n) or not np.allclose(
            times, scan.timestamps, rtol=0, atol=MAX_TIME_GAP_S
        ):
            raise ScanError(
                f"{path}: expected the {n} frames of the run, found {len(scan)}, and {len(times)} refined "
                "poses, or other times; give the run's own scan, read by the flags that the run was given"
            )
        return scan

    def floorplan(self, options: PlanOptions, moved_to: Path | None = None) -> Floorplan | None:
        """The plan, in metres at the run's scale; None where the run had none.

        Raises:
            FloorplanError: it cannot be read, or is another.
        """
        path = moved_to or self.plan_path
        if path is None:
            return None
        if self.n_faces is None:
            raise FloorplanError(
                f"{path}: expected no plan, as the run was made without one, found one; leave out --plan, or "
                "run 'planfit refine' with it"
            )
        floorplan = corrected_plan(read_floorplan(path, options), self.corrections)
        if len(floorplan) != self.n_faces:
            raise FloorplanError(
                f"{path}: expected the {self.n_faces} wall faces that the run read, found "
                f"{len(floorplan)}; give the same plan, unit and storey as to 'planfit refine'"
            )
        return metric_plan(floorplan, self.scale_xy)


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
    scans = record.get("scans")
    if isinstance(scans, list) and scans:
        named = [one["folder"] for one in scans if isinstance(one, dict) and one.get("folder")]
        own = ", ".join(f"{folder / str(name)}" for name in named)
        raise ScanError(
            f"{where}expected a run of one scan, found one of several; give that of one of them: {own}"
        )
    try:
        inputs, alignment = record["inputs"], record["alignment"]
        options = options_of(record["options"], RefineOptions(), where)
        return RunRecord(
            folder=folder,
            scan_path=Path(inputs["scan"]),
            scan_fingerprint=str(inputs["scan_fingerprint"]),
            plan_path=Path(inputs["plan"]) if "plan" in inputs else None,
            n_frames=int(record["frames"]),
            n_faces=record["plan_faces"],
            scale_xy=tuple(_finite(alignment["metres_per_unit_xy"], 2))
            if alignment
            else (1.0, 1.0),
            world_from_plan=_finite(record["world_from_plan"], 4, 4),
            plan_from_world_before=_finite(record["plan_from_world_before"], 4, 4),
            convention=record["tracking"]["convention"] if record["tracking"] else RECORDED,
            options=replace(options, poses_convention=RECORDED),
            scan_options=_scan_options(record, where),
            depth_unit=DepthUnit(float(record.get("depth_factor", 1.0))),
            sensor=SensorCalibration(**record["sensor"]["correction"]),
            axes={
                name: PlanAxes(_finite(record[f"{name}_from_plan"], 4, 4))
                for name in AXES
                if record.get(f"{name}_from_plan") is not None
            },
            corrections=_corrections(record, where),
        )
    except (*DAMAGES, OptionError) as error:
        raise ScanError(
            f"{where}expected the record of a run of this version, found a damaged or an older one; "
            "run 'planfit refine' again"
        ) from error


def _scan_options(record: dict[str, Any], where: str) -> ScanOptions:
    """How the run read its scan.

    Raises:
        ScanError: the record is of another version; the message begins with `where`.
    """
    values = dict(record.get("scan_options") or {})
    for name in FILES_OF_SCAN:
        if values.get(name):
            values[name] = Path(values[name])
    try:
        return ScanOptions(**values)
    except TypeError as error:
        raise ScanError(
            f"{where}expected scan_options of this version of planfit, found others ({error}); "
            "run planfit refine again"
        ) from error


def _finite(values: Any, *shape: int) -> np.ndarray:
    """Finite numbers of a record."""
    array = np.array(values, dtype=float).reshape(shape)
    if not np.isfinite(array).all():
        raise ValueError("expected finite numbers")
    return array


def cache_of(folder: Path) -> Path | None:
    """The cache of a run; None where the folder is none of `planfit refine`."""
    if not (folder / "run.json").exists():
        return None
    shared = _read_record(folder).get("cache")
    return Path(shared) if isinstance(shared, str) else folder / "cache"


def _corrections(record: dict[str, Any], where: str) -> Corrections:
    """Those that the run was made with; none where it is older than corrections."""
    told = record.get("corrections")
    if not told:
        return NO_CORRECTIONS
    return corrections_of(tomllib.loads(told["toml"]), f"{where}corrections")


def read_present_scan(path: Path, segmentation: SegmentationOptions, options: ScanOptions) -> Scan:
    """A scan, with masks only where the segmentation reads them.

    Raises:
        ScanError: it is not there, or cannot be read.
    """
    if not path.exists() and archive_of(path) is None:
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
    except (*DAMAGES, OSError) as error:
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
