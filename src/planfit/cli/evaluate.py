"""`planfit evaluate`: how good poses are, before and after, side by side."""

import dataclasses
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from jaxtyping import Float
from rich.text import Text

from planfit.adjust.calibration import corrected_structure
from planfit.alignment import align, metric_plan
from planfit.cli.arguments import Flat, PlanFlags
from planfit.cli.console import StageBars, note, out, table
from planfit.cli.run_record import RunRecord, cache_of, poses_of, read_present_scan, read_record
from planfit.errors import FloorplanError, ScanError, require
from planfit.evaluation import (
    ComparedPoses,
    EvaluateOptions,
    Evaluation,
    Metric,
    Truth,
    associate_times,
    evaluate,
    read_true_cloud,
)
from planfit.evaluation.evaluate import levelled
from planfit.export.tables import finite
from planfit.floorplan import Floorplan, read_floorplan
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.pipeline.align import claimed_alignment, wall_samples
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime
from planfit.runtime.run_folder import RECORD
from planfit.scan import Scan, ScanOptions, calibrated_scan, read_tum
from planfit.segmentation import Structure
from planfit.units import asked, in_units, quantity, told_in

_FAR_CM = 30.0
"""A map this far from the true scan on average was not registered to it."""
_APART_M, _OTHER_FRAME_M = 0.1, 1.0
"""A whole scan this far from the truth is told to lie elsewhere, or to be in other axes than the truth."""
_SHOWN_UNITS: dict[str, str] = {"1": "", "cm^2": "cm²", "deg": "°"}


@dataclass(frozen=True)
class EvaluateArguments:
    """How good the poses of a scan are, before and after: by the map they make, against the plan, and against
    true poses and a true scan where there are any; `planfit help metrics` defines each. With --poses, these
    are those after: of a scan, which is read by the flags of a scan, or of a run's scan, which is read as the
    run read it and held to the run's plan at the run's scale."""

    folder: tyro.conf.Positional[Path]
    """Output folder of `planfit refine`; or, with --poses, also a scan: folder, zip archive of one, or
    bag."""
    scan_options: Flat[ScanOptions] = field(default_factory=ScanOptions)
    poses_frame: Literal["world", "plan"] = "world"
    """Axes of --poses: `world`, the scan's own, or `plan`."""
    scan: Path | None = None
    """Scan of a run that was moved since."""
    plan: Path | None = None
    """Floorplan; by default that of the run, or the one inside the scan's folder."""
    plan_flags: Flat[PlanFlags] = field(default_factory=PlanFlags)
    truth: Path | None = None
    """True poses in TUM form, `time tx ty tz qx qy qz qw`; times, or frame numbers, as in the scan."""
    truth_frame: Literal["world", "plan"] = "world"
    """`world`: the truth is in the scan's own axes, as OUT/poses is; `plan`: in those of the plan, z up,
    floor at 0, as OUT/trajectory.tum is."""
    true_cloud: Path | None = None
    """True scan (PLY, OBJ: points or mesh, metres) in the axes of --truth-frame, right within a metre."""
    max_difference_s: float = 0.02
    """Poses are compared where their times differ by at most this."""
    json: bool = False
    """Print JSON instead of a table."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    options: Flat[EvaluateOptions] = field(default_factory=EvaluateOptions)


def evaluate_command(arguments: EvaluateArguments) -> int:
    """Print every metric before and after."""
    with told_in("m" if arguments.json else asked()), StageBars() as bars:
        report = _evaluated(arguments, bars)
    if arguments.json:
        out.print_json(json.dumps(report, allow_nan=False))
        return 0
    out.print(_table(report))
    for words in report["notes"]:
        note(words)
    return 0


def _evaluated(arguments: EvaluateArguments, bars: StageBars) -> dict[str, Any]:
    """All metrics as plain values.

    Raises:
        ScanError: the folder is not that of a run or scan, or the truth does not belong to it.
        OptionError: an option has a value that cannot work.
        FloorplanError: the plan cannot be read, or is another than the run's.
    """
    compared, runtime = _compared(arguments, bars)
    poses = ComparedPoses(
        compared.structure, compared.world, compared.plan, floorplan=compared.floorplan
    )
    truth, options = _truth(arguments, compared), arguments.options
    evaluation = evaluate(compared.scan, poses, None, truth, options, runtime)
    return {
        "of": str(arguments.scan_options.poses or arguments.folder),
        "scan": compared.scan.name,
        "plan": compared.floorplan.name if compared.floorplan else None,
        "frames": len(compared.scan),
        "compared": evaluation.n_true_poses if arguments.truth else None,
        "truth_frame": arguments.truth_frame,
        "map": dataclasses.asdict(options.map) if options.depth_maps else None,
        "metrics": {name: _plain(metric) for name, metric in evaluation.metrics.items()},
        "notes": [*compared.notes, *_notes(arguments, evaluation)],
    }


@dataclass(frozen=True)
class _Compared:
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
class _PosesSource:
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
        level, structure = levelled(self.scan, runtime, self.options.segmentation)
        return level, corrected_structure(structure, self.sensor)


def _compared(arguments: EvaluateArguments, bars: StageBars) -> tuple[_Compared, Runtime]:
    """The poses of a run, or of a scan and a file of poses; and the threads and cache for them."""
    folder, scan_options = arguments.folder, arguments.scan_options
    poses = scan_options.poses
    is_run = (folder / RECORD).exists()
    runtime = Runtime(arguments.workers, cache_of(folder), bars.update)
    if poses is None or is_run:
        of_poses = ScanOptions(poses=poses, max_time_gap_s=scan_options.max_time_gap_s)
        require(
            scan_options == (ScanOptions() if poses is None else of_poses),
            f"{folder}: expected no flags of how a scan is read, as that of a run is read as the "
            "run did, found some; leave them out, or give --poses and a scan",
        )
    if poses is not None and arguments.poses_frame == "plan" and arguments.truth_frame == "world":
        require(
            arguments.truth is None and arguments.true_cloud is None,
            "--truth-frame: expected plan, as poses in the plan's frame do not tell where the "
            "scan's own axes are; give the truth in the plan's frame too",
        )
    record = read_record(folder) if poses is None or is_run else None
    source = _source(arguments, record)
    if poses is None:
        assert record is not None
        return _run_compared(record, source, runtime), runtime
    given = poses_of(source.scan, poses, scan_options.max_time_gap_s)
    return _poses_compared(source, given, arguments.poses_frame, runtime), runtime


def _source(arguments: EvaluateArguments, record: RunRecord | None) -> _PosesSource:
    """The scan and the plan of a run, read as the run did, the plan in metres at its scale; without a run, a
    scan and the plan given, or that inside its folder."""
    plan_options, options = arguments.plan_flags.options, RefineOptions()
    if record is not None:
        scan = record.as_read(arguments.scan)
        floorplan = record.floorplan(plan_options, arguments.plan)
        return _PosesSource(scan, floorplan, record.options, record.sensor)
    as_recorded = dataclasses.replace(arguments.scan_options, poses=None)
    scan = read_present_scan(arguments.folder, options.segmentation, as_recorded)
    chosen = arguments.plan or scan.floorplan_path
    return _PosesSource(scan, read_floorplan(chosen, plan_options) if chosen else None, options)


def _run_compared(record: RunRecord, source: _PosesSource, runtime: Runtime) -> _Compared:
    """Poses of a run of `planfit refine`, before and after; the cache of `runtime` is the run's."""
    recorded, (_, after) = source.scan.world_from_cams, record.poses()
    return _Compared(
        calibrated_scan(source.scan, source.sensor),
        source.floorplan,
        source.structure(runtime)[1],
        (recorded, record.world_from_plan @ after),
        (record.plan_from_world_before @ recorded, after),
    )


def _poses_compared(
    source: _PosesSource,
    given: Float[np.ndarray, "n 4 4"],
    poses_frame: Literal["world", "plan"],
    runtime: Runtime,
) -> _Compared:
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
        return _Compared(
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
    return _Compared(seen, floorplan, structure, (recorded, given), on_plan, notes)


def _truth(arguments: EvaluateArguments, compared: _Compared) -> Truth | None:
    """True poses and true scan, where either is given."""
    if arguments.truth is None and arguments.true_cloud is None:
        return None
    mine, true_poses, cloud = np.zeros(0, dtype=int), np.zeros((0, 4, 4)), None
    if arguments.truth is not None:
        times, poses = read_tum(arguments.truth)
        mine, theirs = associate_times(compared.scan.timestamps, times, arguments.max_difference_s)
        true_poses = poses[theirs]
    if arguments.true_cloud is not None and arguments.options.depth_maps:
        cloud = read_true_cloud(arguments.true_cloud, arguments.options.map.voxel_m)
    return Truth(mine, true_poses, arguments.truth_frame, cloud)


def _notes(arguments: EvaluateArguments, evaluation: Evaluation) -> list[str]:
    """Where the poses as a whole lie elsewhere than the truth, or both seem to be in different frames."""
    notes, after = [], {name: metric.after for name, metric in evaluation.metrics.items()}
    ate, frame = after.get("ate_rms", 0.0), arguments.truth_frame
    if ate > _APART_M and after["ate_aligned_rms"] < 0.3 * ate:
        words = f"most of the error of {in_units(ate, '.3f')} is one rigid motion of the whole scan"
        if ate > _OTHER_FRAME_M:
            other = "plan" if frame == "world" else "world"
            words += f": is the truth in the {frame} frame? Try --truth-frame {other}"
        else:
            words += (
                ", to where the plan or the scan's own axes say that it is; its shape is "
                f"{in_units(after['ate_aligned_rms'], '.3f')} from the truth (rigidly aligned)"
            )
        notes.append(words)
    if after.get("nnd", 0.0) > _FAR_CM:
        notes.append(
            f"the true scan lies far from the map: is it in metres and in the "
            f"{arguments.truth_frame} frame (--truth-frame)?"
        )
    return notes


def _plain(metric: Metric) -> dict[str, Any]:
    """A metric as plain values; null where it could not be taken."""
    values = {"before": metric.before, "after": metric.after, "difference": metric.difference}
    return {
        "meaning": metric.meaning,
        "unit": metric.unit,
        **{name: finite(value) for name, value in values.items()},
    }


def _table(report: dict[str, Any]) -> Any:
    rows = []
    for metric in report["metrics"].values():
        unit = _SHOWN_UNITS.get(str(metric["unit"]), str(metric["unit"]))
        texts = [_amount(metric[name], unit) for name in ("before", "after")]
        difference = metric["difference"]
        colour = "" if not difference else "green" if difference < 0 else "red"
        sign = "+" if difference is not None and difference >= 0 else ""
        change = Text(f"{sign}{_amount(difference, unit)}", colour)
        rows.append([metric["meaning"], *texts, change])
    title = f"{report['of']}: {report['frames']} frames"
    if report["compared"] is not None:
        title += f", {report['compared']} with a true pose, {report['truth_frame']} frame"
    if report["map"] is not None:
        title += f"; map of {in_units(report['map']['voxel_m'], 'g', 'cm')} voxels, radius "
        title += f"{in_units(report['map']['radius_m'], 'g')}"
    columns = ["lower is better", "before", "after", "difference"]
    return table(title, columns, rows)


def _amount(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    digits = 3 if unit in ("m", "") else 2
    return quantity(value, unit, f".{digits}f")
