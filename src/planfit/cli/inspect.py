"""`planfit inspect`: what is found in a scan, before anything is done to it."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Integer

from planfit.cli.arguments import Flat, Out
from planfit.cli.console import StageBars, check_suffix, listing, out, tell_scan
from planfit.findings.finding import MAX_NAMED
from planfit.report.plots.scan_view import draw_scan_view
from planfit.runtime import Runtime, write_whole
from planfit.scan import Scan, ScanOptions, read_scan
from planfit.scan.statistics import (
    DepthStatistics,
    PathStatistics,
    depth_statistics,
    path_statistics,
)
from planfit.segmentation.gravity import Gravity, find_gravity
from planfit.units import in_units


@dataclass(frozen=True)
class InspectArguments:
    """Read a scan, tell what was found, and draw it from above."""

    scan: tyro.conf.Positional[Path]
    """Folder of the scan, zip archive of one, or bag."""
    out: Out[Path | None] = None
    """PNG to write: the scan from above."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    scan_options: Flat[ScanOptions] = field(default_factory=ScanOptions)


def inspect_command(arguments: InspectArguments) -> int:
    """Read, measure, print, draw."""
    if arguments.out is not None:
        check_suffix(arguments.out, (".png",))
    scan = read_scan(arguments.scan, options=arguments.scan_options)
    with StageBars() as bars:
        runtime = Runtime(arguments.workers, None, bars.update)
        depth = depth_statistics(scan, runtime)
        path = path_statistics(scan)
        gravity = find_gravity(scan, runtime)
    out.print(f"scan {scan.name}\n", soft_wrap=True)
    out.print(listing(_rows(scan, depth, path, gravity)))
    tell_scan(scan)
    if arguments.out is not None:
        title = (
            f"{Path(scan.name).name}: {len(scan)} frames, {in_units(path.length_m, '.1f')} of path"
        )
        picture = draw_scan_view(
            title, scan.world_from_cams, depth.points_world, gravity.up_world, path.gaps, path.jumps
        )
        write_whole(arguments.out, picture)
        out.print(f"written: {arguments.out}", soft_wrap=True)
    return 0


def _rows(
    scan: Scan, depth: DepthStatistics, path: PathStatistics, gravity: Gravity
) -> list[list[str]]:
    sizes = sorted({(camera.width, camera.height) for camera in scan.cameras})
    focal = sorted(camera.fx for camera in scan.cameras)
    lenses = " to ".join(dict.fromkeys(f"{fx:.1f}" for fx in (focal[0], focal[-1])))
    up = ", ".join(f"{v + 0.0:.3f}" for v in gravity.up_world)
    *sides, height = path.extent_m
    size = " x ".join([*(in_units(v, ".1f", "") for v in sides), in_units(height, ".1f")])
    rows = [
        ["format", scan.format],
        ["frames", f"{len(scan)}, {scan.frame_ids[0]} to {scan.frame_ids[-1]}"],
        ["times", _times(scan, path)],
        ["images", f"{', '.join(f'{w} x {h}' for w, h in sizes)} px, fx {lenses} px"],
        ["colour", "yes" if scan.has_color else "none: the scan is depth alone"],
        [
            "depth",
            f"{in_units(depth.near_m, unit='')} to {in_units(depth.far_m)}, median "
            f"{in_units(depth.median_m)}; {depth.coverage:.0%} of pixels, in "
            f"{len(depth.frame_idx)} frames looked at",
        ],
        ["poses", "as recorded: axes, a mount and units are judged by `planfit refine`"],
        [
            "path",
            f"{in_units(path.length_m, '.1f')}, in a box of {size}; usual step "
            f"{in_units(path.step_m, '.3f')}",
        ],
        ["up axis", f"({up}) in the scan's world; {gravity.source}"],
        ["gaps", _places(scan, path.gaps)],
        ["jumps", _places(scan, path.jumps)],
        ["masks", "floor and walls" if scan.has_labels else "none"],
    ]
    if depth.n_empty:
        rows.insert(6, ["", f"{depth.n_empty} of these frames have no depth at all"])
    return rows


def _times(scan: Scan, path: PathStatistics) -> str:
    first, last = float(scan.timestamps.min()), float(scan.timestamps.max())
    if len(scan) == 1:
        return f"{first:.6g}, of a single frame"
    if np.all(scan.timestamps == np.round(scan.timestamps)):
        return f"none; numbers {first:.0f} to {last:.0f}, usually {path.interval_s:.3g} apart"
    return f"{last - first:.1f} s, usually {path.interval_s:.3g} s apart"


def _places(scan: Scan, frames: Integer[np.ndarray, " k"]) -> str:
    if len(frames) == 0:
        return "none"
    named = ", ".join(scan.frame_ids[i] for i in frames[:MAX_NAMED])
    return f"{len(frames)}, after {named}{' and others' if len(frames) > MAX_NAMED else ''}"
