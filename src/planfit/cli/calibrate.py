"""`planfit calibrate`: what a device's depth camera gets wrong, as a file for other scans of it."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from planfit.adjust.calibration import SHARED
from planfit.cli.arguments import Flat, Out, PlanFlags
from planfit.cli.console import StageBars, note, out, table, tell_scan
from planfit.compiled.making import compile_what_is_not_ready
from planfit.errors import OutputError, require
from planfit.floorplan import read_floorplan
from planfit.geometry.calibration import PARAMETERS
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.refine import calibrate
from planfit.pipeline.sensor import SensorParameter, sensor_findings, sensor_parameters
from planfit.runtime import Runtime
from planfit.scan import ScanOptions, read_scan
from planfit.scan.lens_file import write_calibration


@dataclass(frozen=True)
class CalibrateArguments:
    """Find what a device's depth camera gets wrong, from a scan of it, and write it to a file that
    --calibration takes."""

    scan: tyro.conf.Positional[Path]
    """Folder of the scan, zip archive of one, or bag."""
    out: Out[Path]
    """File to write (JSON). It must not be there yet."""
    plan: Path | None = None
    """Floorplan, whose walls take part; without one, matches, floor and recorded motion alone."""
    scan_options: Flat[ScanOptions] = field(default_factory=ScanOptions)
    plan_flags: Flat[PlanFlags] = field(default_factory=PlanFlags)
    preset: str = "default"
    """Options to begin with: `default`, or `paper`, the published method to the letter."""
    config: Path | None = None
    """TOML file of options, on top of the preset and overruled by flags."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    options: Flat[RefineOptions] = field(default_factory=RefineOptions)


def calibrate_command(arguments: CalibrateArguments) -> int:
    """Read, calibrate, write, tell. Exit code 1 where the scan asks for more than a camera can be off."""
    target, options = arguments.out, arguments.options
    if target.exists() or target.is_symlink():
        raise OutputError(f"{target}: expected no such file; choose another with -o")
    require(
        arguments.scan_options.calibration is None,
        "--calibration: expected none beside 'planfit calibrate', which makes one; leave it out",
    )
    scan = read_scan(arguments.scan, options.segmentation.reads_masks, arguments.scan_options)
    floorplan = None
    if arguments.plan is not None:
        floorplan = read_floorplan(arguments.plan, arguments.plan_flags.options)
    with StageBars() as bars:
        compile_what_is_not_ready(bars.update)
        found = calibrate(scan, floorplan, options, Runtime(arguments.workers, None, bars.update))
    sigmas = {name: float(found.sigmas[SHARED.index(name)]) for name in PARAMETERS}
    write_calibration(target, found.sensor, sigmas, scan.cameras[0])
    rows = sensor_parameters(found, scan.cameras[0])
    tell_scan(scan)
    out.print(table("the sensor", ["parameter", "found", "sigma", ""], [_cells(r) for r in rows]))
    for finding in sensor_findings(rows):
        note(finding.sentence)
    if found.sensor.is_nominal:
        out.print("nothing was corrected: the file leaves scans as they are")
    out.print(f"written: {target}; use it with --calibration", soft_wrap=True)
    return 1 if found.implausible else 0


def _cells(row: SensorParameter) -> list[str]:
    sigma = "held" if row.sigma is None else f"{row.sigma:.2g} {row.unit}".rstrip()
    state = "corrected" if row.is_kept else "not believed" if row.is_implausible else "left alone"
    return [row.name, f"{row.found:.4g} {row.unit}".rstrip(), sigma, state]
