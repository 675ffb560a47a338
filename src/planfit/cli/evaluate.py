"""`planfit evaluate`: refined poses against true ones."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from planfit.cli.console import out, table
from planfit.errors import ScanError
from planfit.evaluate import associate_times, position_errors, step_errors
from planfit.scan import read_tum


@dataclass(frozen=True)
class EvaluateArguments:
    """Compare the poses of a run with true poses."""

    out: tyro.conf.Positional[Path]
    """Output folder of `planfit refine`."""
    truth: Path
    """True poses in TUM form, `time tx ty tz qx qy qz qw`; times, or frame numbers, as in the scan."""
    truth_frame: Literal["world", "plan"] = "world"
    """`world`: the truth is in the scan's own axes, as OUT/poses is; `plan`: in those of the plan, z up,
    floor at 0, as OUT/trajectory.tum is."""
    max_difference_s: float = 0.02
    """Poses are compared where their times differ by at most this."""
    delta_m: float = 5.0
    """Path length over which relative errors are taken."""
    json: bool = False
    """Print JSON instead of a table."""


def evaluate_command(arguments: EvaluateArguments) -> int:
    """Print absolute and relative errors, and how well walls and floor agree with the plan."""
    report = evaluate_run(arguments)
    if arguments.json:
        out.print_json(json.dumps(report))
        return 0
    out.print(_table(arguments, report))
    ate = report["ate"]
    if ate["rms_m"] > 1.0 and ate["aligned_rms_m"] < 0.3 * ate["rms_m"]:
        other = "plan" if arguments.truth_frame == "world" else "world"
        out.print(
            f"[yellow]note:[/] most of the error is one rigid motion: is the truth in the "
            f"{arguments.truth_frame} frame? Try --truth-frame {other}"
        )
    return 0


def evaluate_run(arguments: EvaluateArguments) -> dict[str, Any]:
    """All figures as plain values.

    Raises:
        ScanError: the folder is not that of a run, or the truth does not belong to it.
    """
    record_path = arguments.out / "run.json"
    if not record_path.exists():
        raise ScanError(
            f"{record_path}: expected the record of a run, found nothing; "
            "give the output folder of 'planfit refine'"
        )
    try:
        record = json.loads(record_path.read_text())
        world_from_plan, metrics = np.array(record["world_from_plan"]), record["metrics"]
    except (ValueError, KeyError, TypeError) as error:
        raise ScanError(
            f"{record_path}: expected the record of a run, found a damaged file; "
            "run 'planfit refine' again"
        ) from error
    times, poses = read_tum(arguments.out / "trajectory.tum")
    if arguments.truth_frame == "world":
        poses = world_from_plan @ poses
    true_times, true_poses = read_tum(arguments.truth)
    mine, theirs = associate_times(times, true_times, arguments.max_difference_s)
    poses, true_poses = poses[mine], true_poses[theirs]
    steps = {
        "rpe_next": step_errors(poses, true_poses),
        "rpe": step_errors(poses, true_poses, arguments.delta_m),
    }
    return {
        "frames": len(times),
        "compared": len(mine),
        "truth_frame": arguments.truth_frame,
        "ate": dataclasses.asdict(position_errors(poses, true_poses)),
        **{name: dataclasses.asdict(found) if found else None for name, found in steps.items()},
        **metrics,
    }


def _table(arguments: EvaluateArguments, report: dict[str, Any]) -> Any:
    ate = report["ate"]
    rows = [
        ["position error (ATE), RMS, not aligned", f"{ate['rms_m']:.3f} m"],
        ["   mean offset x, y, z", ", ".join(f"{v:+.3f}" for v in ate["mean_offset_m"]) + " m"],
        ["   largest", f"{ate['max_m']:.3f} m"],
        ["position error (ATE), RMS, rigidly aligned", f"{ate['aligned_rms_m']:.3f} m"],
        ["orientation error, mean, not aligned", f"{ate['turn_mean_deg']:.2f} deg"],
    ]
    for name, words in (("rpe_next", "next frame"), ("rpe", f"{arguments.delta_m:g} m of path")):
        if report[name]:
            rows.append(
                [
                    f"relative error (RPE), RMS, to the {words}"
                    if name == "rpe_next"
                    else f"relative error (RPE), RMS, over {words}",
                    f"{report[name]['shift_rms_m']:.3f} m, {report[name]['turn_rms_deg']:.2f} deg",
                ]
            )
    for name, words in (
        ("nsd_m", "wall points to the plan (NSD), mean"),
        ("floor_median_m", "floor points off the plane, median"),
        ("floor_rms_m", "floor points about their height, RMS"),
    ):
        if name in report:
            values = report[name]
            rows.append([words, f"{values['after']:.3f} m (before: {values['before']:.3f} m)"])
    title = f"{arguments.out}: {report['compared']} of {report['frames']} frames compared"
    return table(f"{title}, {report['truth_frame']} frame", ["", ""], rows)
