"""`planfit align`: where on the plan a scan is, with a picture of each alignment hypothesis."""

import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.text import Text

from planfit.alignment import (
    Alignment,
    AlignmentHypothesis,
    WallSamples,
    metric_plan,
    other_scale_finding,
)
from planfit.cli.arguments import AlignmentFlags, Flat, Out, PlanFlags
from planfit.cli.console import StageBars, note, out, table, tell_scan
from planfit.compiled.making import compile_what_is_not_ready
from planfit.findings import SCHEMA_VERSION, Finding, finding_record, sentences_of
from planfit.floorplan import Floorplan, read_floorplan
from planfit.geometry import se3
from planfit.pipeline.align import align
from planfit.pipeline.options import RefineOptions
from planfit.report.plots.scan_view import draw_alignment
from planfit.runtime import Runtime, write_whole
from planfit.runtime.run_folder import ALIGNMENT, CANDIDATE, RunFolder, remove_alignment
from planfit.saving import RunInputs
from planfit.scan import ScanOptions, read_scan
from planfit.units import told_in


@dataclass(frozen=True)
class AlignArguments:
    """Align a scan with a floorplan: rotation, translation and, where the plan has no unit, scale."""

    scan: tyro.conf.Positional[Path]
    """Folder of the scan, zip archive of one, or bag."""
    plan: tyro.conf.Positional[Path]
    """Floorplan."""
    out: Out[Path]
    """Folder for alignment.json and a picture of each hypothesis."""
    scan_options: Flat[ScanOptions] = field(default_factory=ScanOptions)
    plan_flags: Flat[PlanFlags] = field(default_factory=PlanFlags)
    alignment_flags: Flat[AlignmentFlags] = field(default_factory=AlignmentFlags)
    preset: str = "default"
    """Options to begin with: `default`, or `paper`, the published method to the letter."""
    config: Path | None = None
    """TOML file of options, on top of the preset and overruled by flags."""
    cache: Path | None = None
    """Folder that keeps finished stages, which runs may share, also at the same time; else OUT/cache."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    options: Flat[RefineOptions] = field(default_factory=RefineOptions)


def align_command(arguments: AlignArguments) -> int:
    """Read, align, draw, report. Exit code 1 where the alignment, or the plan's scale, is not sure."""
    options = arguments.alignment_flags.added_to(arguments.options)
    scan = read_scan(arguments.scan, options.segmentation.reads_masks, arguments.scan_options)
    floorplan = read_floorplan(arguments.plan, arguments.plan_flags.options)
    inputs = RunInputs(scan, floorplan, options, arguments.scan_options)
    with (
        RunFolder.claimed(arguments.out, inputs.names, overwrite=False) as run,
        StageBars() as bars,
    ):
        runtime = Runtime(arguments.workers, arguments.cache or run.cache_dir, bars.update)
        compile_what_is_not_ready(runtime.report)
        found = align(scan, floorplan, options, runtime)
        alignment, walls = found.alignment, found.walls
        pictures = _write(run.path, floorplan, walls, alignment)
    tell_scan(scan)
    _tell(floorplan, alignment, pictures)
    return 0 if alignment.is_sure and alignment.other_scale is None else 1


@told_in("m")
def to_record(floorplan: Floorplan, alignment: Alignment) -> dict[str, Any]:
    """An alignment as plain values; lengths in metres, angles in radians, in degrees where it says so."""
    return {
        "schema_version": SCHEMA_VERSION,
        "plan": floorplan.name,
        "plan_is_metric": floorplan.is_metric,
        "plan_from_level": alignment.plan_from_level.tolist(),
        "metres_per_unit": alignment.metres_per_unit,
        "metres_per_unit_xy": list(alignment.scale_xy),
        "metres_per_unit_sigma_share": alignment.scale_sigma,
        "other_scale": None if alignment.other_scale is None else asdict(alignment.other_scale),
        "score": alignment.score,
        "margin": alignment.margin,
        "covariance_yaw_x_y_log_scale": None
        if alignment.covariance is None
        else alignment.covariance.tolist(),
        "is_sure": alignment.is_sure,
        "is_mirrored": alignment.is_mirrored,
        "is_as_recorded": alignment.is_as_recorded,
        "candidates": [
            {
                "yaw_deg": se3.wrapped_deg(hypothesis.yaw),
                "plan_from_level": hypothesis.plan_from_level.tolist(),
                "metres_per_unit_xy": list(hypothesis.scale_xy),
                "score": hypothesis.score,
                "occluded_share": hypothesis.occluded_share,
            }
            for hypothesis in alignment.candidates
        ],
        "warnings": list(sentences_of(_findings(alignment))),
        "findings": [finding_record(each) for each in _findings(alignment)],
    }


def _findings(alignment: Alignment) -> tuple[Finding, ...]:
    found, other = alignment.all_findings, alignment.other_scale
    return found if other is None else (*found, other_scale_finding(other))


def _write(
    folder: Path, floorplan: Floorplan, walls: WallSamples, alignment: Alignment
) -> list[Path]:
    """alignment.json and the pictures, each whole or not at all."""
    remove_alignment(folder)
    pictures = []
    for i, hypothesis in enumerate(alignment.candidates, start=1):
        path = folder / CANDIDATE.format(i)
        plan = metric_plan(floorplan, hypothesis.scale_xy)
        write_whole(path, draw_alignment(plan, walls, hypothesis, _title(i, hypothesis, floorplan)))
        pictures.append(path)
    text = json.dumps(to_record(floorplan, alignment), indent=1)
    write_whole(folder / ALIGNMENT, text)
    return pictures


def _title(number: int, hypothesis: AlignmentHypothesis, floorplan: Floorplan) -> str:
    is_as_drawn = _is_as_drawn(floorplan, hypothesis.scale_xy)
    scale = "" if is_as_drawn else f", {_scale(hypothesis.scale_xy)}"
    return (
        f"hypothesis {number}: {hypothesis.score:.0%} of the scanned wall explained, yaw "
        f"{se3.wrapped_deg(hypothesis.yaw):.1f}°{scale}"
    )


def _is_as_drawn(floorplan: Floorplan, scale_xy: tuple[float, float]) -> bool:
    return floorplan.is_metric and scale_xy == (1.0, 1.0)


def _scale(scale_xy: tuple[float, float]) -> str:
    if scale_xy[0] == scale_xy[1]:
        return f"{scale_xy[0]:.4g} m a unit"
    return f"{scale_xy[0]:.4g} x {scale_xy[1]:.4g} m a unit"


def _tell(floorplan: Floorplan, alignment: Alignment, pictures: list[Path]) -> None:
    """One screen: the alignment that was taken, the other hypotheses, and the warnings."""
    rows = []
    for i, hypothesis in enumerate(alignment.candidates, start=1):
        is_taken = np.allclose(hypothesis.plan_from_level, alignment.plan_from_level)
        x, y = hypothesis.translation
        rows.append(
            [
                f"{i}{' (taken)' if is_taken else ''}",
                f"{hypothesis.score:.0%}",
                f"{se3.wrapped_deg(hypothesis.yaw):.2f} deg",
                f"{x:.2f}, {y:.2f} m",
                "as given"
                if _is_as_drawn(floorplan, hypothesis.scale_xy)
                else _scale(hypothesis.scale_xy),
            ]
        )
    out.print(table("", ["hypothesis", "wall explained", "yaw", "translation", "scale"], rows))
    if not _is_as_drawn(floorplan, alignment.scale_xy) and alignment.scale_sigma > 0:
        out.print(
            f"scale: {_scale(alignment.scale_xy)}, known within {alignment.scale_sigma:.2%} "
            "(one standard deviation)"
        )
    out.print(f"margin over the next hypothesis: {100 * alignment.margin:.0f} percentage points")
    for finding in _findings(alignment):
        note(finding.sentence)
    is_sure = alignment.is_sure and alignment.other_scale is None
    verdict = Text("aligned") if is_sure else Text("not sure", "red")
    folder = pictures[0].parent if pictures else Path()
    out.print(verdict.append(f": look at {folder / CANDIDATE.format(1)}", "none"), soft_wrap=True)
