"""What `planfit compare` reads: two runs of one scan, or a run and other poses of its frames."""

import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from jaxtyping import Float

from planfit.cli.arguments import PlanFlags
from planfit.cli.evaluate_inputs import poses_of
from planfit.cli.run_record import MAX_TIME_GAP_S, RunRecord, read_record
from planfit.errors import ScanError
from planfit.evaluation import CompareOptions
from planfit.evaluation.evaluate import RefinedPoses
from planfit.floorplan import Floorplan
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.matching import Matches
from planfit.pipeline.calibrate import corrected
from planfit.pipeline.observations import extract_observations
from planfit.runtime import Runtime
from planfit.scan import Scan, calibrated_scan
from planfit.segmentation import Structure


@dataclass(frozen=True)
class CompareArguments:
    """Compare two runs over one scan, or a run and other poses: where they differ, and which of the two the
    evidence prefers. Without a second run and --poses, a run is compared with the poses as recorded."""

    a: tyro.conf.Positional[Path]
    """Output folder of `planfit refine`: A."""
    b: tyro.conf.Positional[Path | None] = None
    """Another, over the same scan: B."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Folder for comparison.html, with pictures, and comparison.json."""
    poses: Path | None = None
    """Poses for B: TUM, KITTI, Open3D log."""
    poses_frame: Literal["world", "plan"] = "world"
    """Axes of --poses: `world`, the scan's own, or `plan`."""
    max_time_gap_s: float = 0.02
    """A frame takes the poses of --poses around it in time if both are within this of it."""
    scan: Path | None = None
    """Scan of the runs, where it was moved since."""
    plan: Path | None = None
    """Floorplan of A, where it was moved since."""
    plan_flags: Annotated[PlanFlags, tyro.conf.arg(name="")] = field(default_factory=PlanFlags)
    json: bool = False
    """Print JSON instead of a table."""
    overwrite: bool = False
    """Replace an earlier comparison in the output folder."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    options: Annotated[CompareOptions, tyro.conf.arg(name="")] = field(
        default_factory=CompareOptions
    )


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


def read_pair(arguments: CompareArguments, runtime: Runtime) -> Pair:
    """A, and beside it another run, poses of a file, or the poses as recorded.

    Floor, walls and matches are those of run A, by its cache, and judge both.

    Raises:
        ScanError: a folder is not that of a run, or the two are of different scans or frames.
        FloorplanError: a plan cannot be read, or is another than the run's.
    """
    record, plan_options = read_record(arguments.a), arguments.plan_flags.options
    other = None if arguments.b is None else read_record(arguments.b)
    if other is not None:
        _require_one_scan(record, other)
    as_read = record.as_read(arguments.scan)
    seen = corrected(extract_observations(as_read, record.options, runtime), record.sensor)
    scan = calibrated_scan(as_read, record.sensor)
    floorplan = record.floorplan(plan_options, arguments.plan)
    a = _run_poses(record, scan, floorplan, seen.structure)
    if other is None:
        b, name = _other_poses(arguments, record, scan, a)
        return Pair(scan, a, b, name, seen.matches, (_FAVOUR,))
    scan_b, reading = scan, (record.scan_options, record.convention)
    if (other.scan_options, other.convention) != reading:  # poses of another tracker, say
        scan_b = other.scan(arguments.scan)
        if scan.frame_ids != scan_b.frame_ids:
            raise ScanError(
                f"{other.folder}: expected the frames {scan.frame_ids[0]} to {scan.frame_ids[-1]}, found "
                f"others: {scan_b.frame_ids[0]} to {scan_b.frame_ids[-1]}; compare runs over the same frames"
            )
    moved = arguments.plan if other.plan_path == record.plan_path else None
    b = _run_poses(other, scan_b, other.floorplan(plan_options, moved), seen.structure)
    return Pair(scan, a, b, str(other.folder), seen.matches, _notes(record, other))


def _other_poses(
    arguments: CompareArguments, record: RunRecord, scan: Scan, a: RunPoses
) -> tuple[Float[np.ndarray, "n 4 4"] | RefinedPoses, str]:
    """Poses of a file, or as recorded, and what they are called."""
    if arguments.poses is None:
        before, world = a.initial_plan_from_cams, scan.world_from_cams
        return replace(a, plan_from_cams=before, world_from_cams=world), "the poses as recorded"
    poses = poses_of(scan, arguments.poses, arguments.max_time_gap_s)
    if arguments.poses_frame == "world":
        return poses, str(arguments.poses)
    world = record.world_from_plan @ poses
    return replace(a, plan_from_cams=poses, world_from_cams=world), str(arguments.poses)


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
