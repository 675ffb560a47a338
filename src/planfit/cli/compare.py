"""`planfit compare`: two runs, or a run and other poses: where they differ, and which is better."""

import json
import os
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from jaxtyping import Float

from planfit.cli.arguments import Flat, Out, PlanFlags
from planfit.cli.console import StageBars, note, out, table
from planfit.cli.run_record import MAX_TIME_GAP_S, RunRecord, cache_of, poses_of, read_record
from planfit.errors import OutputError, ScanError, require
from planfit.evaluation import CompareOptions, Comparison, compare
from planfit.evaluation.evaluate import RefinedPoses
from planfit.export.cloud import place_cloud, sample_cloud
from planfit.export.tables import finite
from planfit.floorplan import Floorplan
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.matching import Matches
from planfit.pipeline.calibrate import corrected
from planfit.pipeline.observations import extract_observations
from planfit.report.html.comparison_page import (
    Compared,
    conclusion,
    local_in_words,
    make_comparison,
    whole_in_words,
)
from planfit.report.measures import CloudXY
from planfit.report.plots.scan_view import at_camera_height
from planfit.runtime import Runtime, made_folder, write_whole
from planfit.scan import Scan, calibrated_scan
from planfit.segmentation import Structure
from planfit.units import in_units, quantity, told_in


@dataclass(frozen=True)
class CompareArguments:
    """Compare two runs over one scan, or a run and other poses: where they differ, and which of the two the
    evidence prefers. Without a second run and --poses, a run is compared with the poses as recorded."""

    a: tyro.conf.Positional[Path]
    """Output folder of `planfit refine`: A."""
    b: tyro.conf.Positional[Path | None] = None
    """Another, over the same scan: B."""
    out: Out[Path | None] = None
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
    plan_flags: Flat[PlanFlags] = field(default_factory=PlanFlags)
    json: bool = False
    """Print JSON instead of a table."""
    overwrite: bool = False
    """Replace an earlier comparison in the output folder."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    options: Flat[CompareOptions] = field(default_factory=CompareOptions)


_FAVOUR = (
    "A was solved with the matches, and the plan if it has one, that judge here, which favours A: poses that "
    "were measured otherwise may be right where these speak for A; map and free space took no part"
)


@dataclass(frozen=True)
class _RunPoses:
    """The poses of a run, as far as `planfit.compare` looks at a result."""

    structure: Structure
    floorplan: Floorplan | None
    initial_plan_from_cams: Float[np.ndarray, "n 4 4"]
    plan_from_cams: Float[np.ndarray, "n 4 4"]
    world_from_cams: Float[np.ndarray, "n 4 4"]
    sensor: SensorCalibration = NOMINAL
    """Nothing is left to correct: the scan beside it is corrected as run A did."""


@dataclass(frozen=True)
class _Pair:
    """A and B, and the scan that both are poses of."""

    scan: Scan
    a: _RunPoses
    b: Float[np.ndarray, "n 4 4"] | RefinedPoses
    name_b: str
    matches: Matches
    notes: tuple[str, ...] = ()


def _read_pair(arguments: CompareArguments, runtime: Runtime) -> _Pair:
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
        return _Pair(scan, a, b, name, seen.matches, (_FAVOUR,))
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
    return _Pair(scan, a, b, str(other.folder), seen.matches, _notes(record, other))


def _other_poses(
    arguments: CompareArguments, record: RunRecord, scan: Scan, a: _RunPoses
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
) -> _RunPoses:
    times, plan_from_cams = record.poses()
    if len(times) != len(scan) or not np.allclose(
        times, scan.timestamps, rtol=0, atol=MAX_TIME_GAP_S
    ):
        shared = np.intersect1d(np.round(times, 3), np.round(scan.timestamps, 3))
        raise ScanError(
            f"{record.folder}: expected poses of the {len(scan)} frames of {scan.name}, found "
            f"{len(times)}, {len(shared)} of them of the same time; compare runs over the same frames"
        )
    return _RunPoses(
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


PAGE, RECORD = "comparison.html", "comparison.json"


def compare_command(arguments: CompareArguments) -> int:
    """Read, compare, write, tell. Exit code 0 whichever is better."""
    require(
        arguments.b is None or arguments.poses is None,
        "--poses: expected either a second run or a file of poses, found both; leave out one",
    )
    folder = arguments.out
    if folder is not None:
        _check_free(folder, arguments.overwrite)
    made = nullcontext() if folder is None else made_folder(folder)
    with made, StageBars() as bars:
        runtime = Runtime(arguments.workers, cache_of(arguments.a), bars.update)
        pair = _read_pair(arguments, runtime)
        comparison = compare(pair.scan, pair.a, pair.b, pair.matches, arguments.options, runtime)
        record = _record(str(arguments.a), pair, comparison)
        if folder is not None:
            plan = pair.a.floorplan.name if pair.a.floorplan else ""
            what = Compared(Path(pair.scan.name).name, str(arguments.a), pair.name_b, plan)
            cloud = _cloud(pair, comparison, runtime)
            page = make_comparison(what, comparison, cloud, pair.notes)
            write_whole(folder / PAGE, page)
            write_whole(folder / RECORD, json.dumps(record, indent=1, allow_nan=False) + "\n")
    if arguments.json:
        out.print_json(json.dumps(record, allow_nan=False))
    else:
        _tell(str(arguments.a), pair, comparison, folder)
    return 0


@told_in("m")
def _record(name_a: str, pair: _Pair, comparison: Comparison) -> dict[str, Any]:
    """A comparison as plain values; null where a number could not be taken."""
    differences = comparison.differences
    return {
        "scan": pair.scan.name,
        "a": name_a,
        "b": pair.name_b,
        "frames": len(differences.distance_m),
        "axes": comparison.axes,
        "is_aligned": differences.is_aligned,
        "preferred": comparison.preferred,
        "conclusion": " ".join(conclusion(comparison).split()),
        "witnesses": [
            {
                "name": witness.name,
                "metric": witness.deciding.name,
                "unit": witness.deciding.unit,
                "a": witness.deciding.before,
                "b": witness.deciding.after,
                "prefers": witness.prefers,
            }
            for witness in comparison.witnesses
        ],
        "difference": {
            "rms_m": differences.rms_m,
            "max_m": float(differences.distance_m.max()),
            "max_deg": float(differences.angle_deg.max()),
            "as_a_whole_m": differences.whole[0],
            "as_a_whole_deg": differences.whole[1],
            "aligned_rms_m": differences.aligned_rms_m,
        },
        "stretches": [
            {
                "first_frame": local.stretch.first,
                "last_frame": local.stretch.last,
                "max_m": local.stretch.max_distance_m,
                "max_deg": local.stretch.max_angle_deg,
                "matches_m": {"a": finite(local.match_m[0]), "b": finite(local.match_m[1])},
                "wall_near_plan": {
                    "a": finite(local.near_share[0]),
                    "b": finite(local.near_share[1]),
                },
            }
            for local in comparison.stretches
        ],
        "metrics": {
            name: {
                "meaning": metric.meaning.strip(),
                "unit": metric.unit,
                "a": finite(metric.before),
                "b": finite(metric.after),
            }
            for name, metric in comparison.metrics.items()
        },
        "by_frame": {
            "frame": list(pair.scan.frame_ids),
            "distance_m": [round(v, 6) for v in differences.distance_m.tolist()],
            "angle_deg": [round(v, 5) for v in differences.angle_deg.tolist()],
        },
        "notes": [*pair.notes, *comparison.notes],
    }


def _cloud(pair: _Pair, comparison: Comparison, runtime: Runtime) -> CloudXY | None:
    """Without a plan: what was seen at camera height, at A and at B."""
    if comparison.poses.floorplan is not None:
        return None
    cloud = sample_cloud(pair.scan, runtime)
    at_a, at_b = comparison.poses.plan_from_cams
    a, b = place_cloud(cloud, at_a), place_cloud(cloud, at_b)
    is_shown = at_camera_height(at_a[:, :3, 3], a)
    return a[is_shown, :2], b[is_shown, :2]


def _check_free(folder: Path, overwrite: bool) -> None:
    """Raise `OutputError` where a folder holds something that is not to be replaced."""
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: expected a folder, found a file; choose another with -o")
    if folder.exists():
        names = {item.name for item in folder.iterdir()}
        if names - {PAGE, RECORD}:
            raise OutputError(
                f"{folder}: expected an empty folder or an earlier comparison, found other files; choose "
                "another with -o"
            )
        if names and not overwrite:
            raise OutputError(
                f"{folder}: expected an empty folder, found an earlier comparison; choose another with "
                "-o, or pass --overwrite"
            )


def _tell(name_a: str, pair: _Pair, comparison: Comparison, folder: Path | None) -> None:
    """One screen: the evidence, where they differ, the conclusion."""
    out.print(f"\nA  {name_a}\nB  {pair.name_b}\n", soft_wrap=True)
    rows = [
        [
            f"{w.name}: {w.deciding.meaning}",
            *(quantity(v, w.deciding.unit, ".3g") for v in (w.deciding.before, w.deciding.after)),
            {"a": "A", "b": "B", "neither": "-"}[w.prefers],
        ]
        for w in comparison.witnesses
    ]
    out.print(table("", ["lower is better", "A", "B", "prefers"], rows))
    rows = [
        [
            f"{local.stretch.first}-{local.stretch.last}",
            in_units(local.stretch.max_distance_m, ".3f"),
            f"{local.stretch.max_angle_deg:.1f} deg",
            *local_in_words(local),
        ]
        for local in comparison.stretches
    ]
    if rows:
        heads = [
            "frames that differ most",
            "apart by",
            "turned by",
            "matches, A / B",
            "wall, A / B",
        ]
        out.print()
        out.print(table("", heads, rows))
    axes = "the plan's axes" if comparison.axes == "plan" else "the scan's own axes"
    out.print(f"\ndistances in {axes}. {whole_in_words(comparison)}")
    for words in (*pair.notes, *comparison.notes):
        note(words)
    out.print(f"\n{conclusion(comparison)}")
    if folder is not None:
        out.print(f"\nwritten: {folder / PAGE}", soft_wrap=True)
