"""What `planfit compare` reads: two runs of one scan, or a run and other poses of its frames."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from planfit.cli.evaluate_inputs import poses_of
from planfit.cli.run_record import MAX_TIME_GAP_S, RunRecord, read_record
from planfit.errors import ScanError
from planfit.evaluation.evaluate import RefinedPoses
from planfit.floorplan import Floorplan, PlanOptions
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.matching import Matches
from planfit.pipeline.calibrate import corrected
from planfit.pipeline.observations import extract_observations
from planfit.runtime import Runtime
from planfit.scan import Scan, calibrated_scan
from planfit.segmentation import Structure

_FAVOUR = (
    "A was solved with the matches, and the plan if it has one, that judge here, which favours A: poses that "
    "were measured otherwise may be right where these speak for A; map and free space took no part"
)


@dataclass(frozen=True)
class RunPoses:
    """The poses of a run, as far as `planfit.compare` looks at a result."""

    structure: Structure
    floorplan: Floorplan | None
    initial_plan_from_cams: Float[np.ndarray, "n 4 4"]
    plan_from_cams: Float[np.ndarray, "n 4 4"]
    world_from_cams: Float[np.ndarray, "n 4 4"]
    sensor: SensorCalibration = NOMINAL
    """Nothing is left to correct: the scan beside it is corrected as run A did."""


@dataclass(frozen=True)
class Pair:
    """A and B, and the scan that both are poses of."""

    scan: Scan
    a: RunPoses
    b: Float[np.ndarray, "n 4 4"] | RefinedPoses
    name_b: str
    matches: Matches
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Given:
    """What the command line names beside A."""

    b: Path | None
    poses: Path | None
    poses_frame: Literal["world", "plan"]
    max_time_gap_s: float
    scan: Path | None
    plan: Path | None
    plan_options: PlanOptions


def read_pair(folder: Path, given: Given, runtime: Runtime) -> Pair:
    """A, and beside it another run, poses of a file, or the poses as recorded.

    Floor, walls and matches are those of run A, by its cache, and judge both.

    Raises:
        ScanError: a folder is not that of a run, or the two are of different scans or frames.
        FloorplanError: a plan cannot be read, or is another than the run's.
    """
    record = read_record(folder)
    other = None if given.b is None else read_record(given.b)
    if other is not None:
        _require_one_scan(record, other)
    as_read = record.as_read(given.scan)
    seen = corrected(extract_observations(as_read, record.options, runtime), record.sensor)
    scan = calibrated_scan(as_read, record.sensor)
    a = _run_poses(record, scan, record.floorplan(given.plan_options, given.plan), seen.structure)
    if other is not None:
        notes = _notes(record, other)
        scan_b = scan
        same_reading = (other.scan_options, other.convention) == (
            record.scan_options,
            record.convention,
        )
        if not same_reading:  # poses of another tracker, say
            scan_b = other.scan(given.scan)
            _require_same_frames(scan, scan_b, other)
        moved = given.plan if other.plan_path == record.plan_path else None
        plan_b = other.floorplan(given.plan_options, moved)
        b = _run_poses(other, scan_b, plan_b, seen.structure)
        return Pair(scan, a, b, str(other.folder), seen.matches, notes)
    if given.poses is None:
        recorded = RunPoses(
            seen.structure,
            a.floorplan,
            a.initial_plan_from_cams,
            a.initial_plan_from_cams,
            scan.world_from_cams,
        )
        return Pair(scan, a, recorded, "the poses as recorded", seen.matches, (_FAVOUR,))
    poses = poses_of(scan, given.poses, given.max_time_gap_s)
    if given.poses_frame == "world":
        return Pair(scan, a, poses, str(given.poses), seen.matches, (_FAVOUR,))
    on_plan = RunPoses(
        seen.structure, a.floorplan, a.initial_plan_from_cams, poses, record.world_from_plan @ poses
    )
    return Pair(scan, a, on_plan, str(given.poses), seen.matches, (_FAVOUR,))


def _run_poses(
    record: RunRecord, scan: Scan, floorplan: Floorplan | None, structure: Structure
) -> RunPoses:
    times, plan_from_cams = record.poses()
    if len(times) != len(scan) or not np.allclose(
        times, scan.timestamps, rtol=0, atol=MAX_TIME_GAP_S
    ):
        shared = np.intersect1d(np.round(times, 3), np.round(scan.timestamps, 3))
        raise ScanError(
            f"{record.folder}: expected poses of the {len(scan)} frames of {scan.name}, found "
            f"{len(times)}, {len(shared)} of them of the same time; compare runs over the same frames"
        )
    return RunPoses(
        structure,
        floorplan,
        record.plan_from_world_before @ scan.world_from_cams,
        plan_from_cams,
        record.world_from_plan @ plan_from_cams,
    )


def _require_one_scan(a: RunRecord, b: RunRecord) -> None:
    # Behind the dash stands what tells other poses of the same scan.
    same = a.scan_fingerprint.split("-")[0] == b.scan_fingerprint.split("-")[0]
    if not same and a.scan_path != b.scan_path:
        raise ScanError(
            f"{b.folder}: expected a run over the scan of {a.folder}, {a.scan_path}, found one over "
            f"{b.scan_path}; compare two runs over one scan"
        )
    if not same:
        raise ScanError(
            f"{b.folder}: expected a run over the same scan as {a.folder}, found that {a.scan_path} has "
            "changed between the two; run 'planfit refine' again"
        )
    if a.n_frames != b.n_frames:
        raise ScanError(
            f"{b.folder}: expected the {a.n_frames} frames of {a.folder}, found {b.n_frames}; compare runs "
            "over the same frames"
        )


def _require_same_frames(scan: Scan, scan_b: Scan, other: RunRecord) -> None:
    if scan.frame_ids != scan_b.frame_ids:
        raise ScanError(
            f"{other.folder}: expected the frames {scan.frame_ids[0]} to {scan.frame_ids[-1]}, found others: "
            f"{scan_b.frame_ids[0]} to {scan_b.frame_ids[-1]}; compare runs over the same frames"
        )


def _notes(a: RunRecord, b: RunRecord) -> tuple[str, ...]:
    notes = []
    if a.options.matching != b.options.matching or a.options.segmentation != b.options.segmentation:
        notes.append(
            "A and B looked for matches, floor or walls by other options; those of A judge both here"
        )
    if a.sensor != b.sensor:
        notes.append(
            "A and B corrected depth or camera otherwise; as A corrected them, they judge both here, which "
            "favours A"
        )
    return tuple(notes)
