"""`planfit export`: poses of a run, or of a scan as recorded, walls as built, and the report, in the forms of
other programs."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import tyro
from jaxtyping import Float

from planfit.as_built import counted, counted_openings, read_as_built
from planfit.cli.arguments import Flat, Out
from planfit.cli.console import StageBars, check_suffix, out, tell_scan
from planfit.cli.run_record import read_record
from planfit.errors import OutputError, ScanError, require, require_positive
from planfit.export.cloud import place_cloud, sample_cloud, write_ply
from planfit.export.mesh import check_suffix as check_mesh_suffix
from planfit.export.mesh import fuse_mesh, load_open3d, write_mesh
from planfit.export.pdf import find_browser, print_page
from planfit.export.plan_files import AS_BUILT_WRITERS
from planfit.export.poses import (
    WITH_MATCHES,
    PlanAxes,
    PoseForm,
    PoseFrame,
    free_target,
    require_axes,
    write_poses,
)
from planfit.export.write import read_matches
from planfit.geometry import se3
from planfit.runtime import Runtime, whole_file
from planfit.runtime.run_folder import RECORD
from planfit.scan import Scan, ScanOptions, read_scan
from planfit.scan.views import write_cloud
from planfit.units import told_in


@dataclass(frozen=True)
class ExportArguments:
    """Write the poses of a run, those of a scan as recorded, the walls of a run as built, or its report, in
    the form of another program."""

    source: tyro.conf.Positional[Path]
    """Output folder of `planfit refine` (refined poses), or a scan (poses as recorded)."""
    to: Literal[
        "tum",
        "kitti",
        "open3d",
        "g2o",
        "rerun",
        "rosbag",
        "ply",
        "mesh",
        "cloud",
        "colmap",
        "nerfstudio",
        "as-built",
        "pdf",
    ]
    """Form: trajectory files (`tum`, `kitti`, `open3d` log, `g2o` pose graph), a recording of `rerun` (needs
    `planfit[rerun]`), a `rosbag` of ROS 2 with tf and path (needs `planfit[bag]`), coloured points (`ply`), a
    coloured `mesh` (.ply, .obj or .glb; needs `planfit[map]`), the whole `cloud` of a laser scan in its own
    format (.las, .laz, .e57), folders with images and depth (`colmap`
    model, `nerfstudio`), the verdicts on the walls of the plan, `as-built` (.csv, .geojson, .dxf with a
    layer a verdict, .bcf), or the report as `pdf`, printed by Chromium, which must be installed."""
    out: Out[Path]
    """File to write; a folder for `rosbag`, `colmap` and `nerfstudio`. It must not be there yet."""
    frame: PoseFrame = "world"
    """Axes of poses and points: the scan's own; of a run also those of the plan (z up, floor at 0), of the
    plan's `file` (its unit and origin), or of the `map` that it lies on (eastings, northings, heights, m)."""
    voxel_m: float = 0.02
    """Edge of a voxel of the mesh; half of it takes four times the memory."""
    max_depth_m: float = 6.0
    """Depth beyond this takes no part in the mesh."""
    tolerance_m: float | None = None
    """Of `as-built`: walls that stand off by no more agree; by default what the run was told."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    scan_options: Flat[ScanOptions] = field(default_factory=ScanOptions)


@told_in("m")
def export_command(arguments: ExportArguments) -> int:
    """Read, write, tell."""
    target = free_target(arguments.out, arguments.to)
    if arguments.to == "as-built":
        return _export_as_built(arguments.source, target, arguments.tolerance_m)
    if arguments.to == "pdf":
        return _export_report(arguments.source, target)
    if arguments.to == "mesh":
        check_mesh_suffix(target)
        require_positive(arguments, "voxel_m", "max_depth_m")
        load_open3d()  # before the scan is read, which can take long
    scan, poses, axes = _load(arguments)
    with StageBars() as bars:
        runtime = Runtime(arguments.workers, None, bars.update)
        if arguments.to in get_args(PoseForm):
            matches = read_matches(arguments.source) if arguments.to in WITH_MATCHES else None
            posed = poses if axes is None else axes.poses(poses)
            write_poses(target, arguments.to, scan, posed, matches, runtime, arguments.frame)
        else:
            with whole_file(target) as part:
                _write_points(arguments, part, scan, poses, axes, runtime)
    tell_scan(scan)
    words = f" ({axes.words})" if axes is not None and axes.words else ""
    out.print(
        f"written: {target}, {len(scan)} frames, {arguments.frame} axes{words}", soft_wrap=True
    )
    return 0


def _export_as_built(folder: Path, target: Path, tolerance_m: float | None) -> int:
    """Write the walls of a run as built, as a table, drawing or issues; tell."""
    check_suffix(target, AS_BUILT_WRITERS)
    require(
        tolerance_m is None or tolerance_m >= 0,
        f"tolerance-m: expected 0 or more, found {tolerance_m}",
    )
    as_built = read_as_built(folder)
    AS_BUILT_WRITERS[target.suffix.lower()](target, as_built, tolerance_m)
    words = _listed(counted(as_built.verdicts(tolerance_m)))
    if as_built.openings:
        counts = counted_openings(as_built.openings)
        words += f"; openings: {_listed(counts)}"
    out.print(f"written: {target}, {words}", soft_wrap=True)
    return 0


def _listed(counts: Mapping[Any, int]) -> str:
    """Verdicts that there are, with their numbers."""
    return ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)


def _export_report(folder: Path, target: Path) -> int:
    """Print the report of a run on paper; tell."""
    check_suffix(target, (".pdf",))
    page = folder / "report.html"
    if not page.is_file():
        raise ScanError(
            f"{folder}: expected the output folder of planfit refine with its report.html, found none; "
            "refine the scan first"
        )
    find_browser()  # before anything is written
    with whole_file(target) as part:
        print_page(page, part)
    out.print(f"written: {target}", soft_wrap=True)
    return 0


def _check_cloud_suffix(target: Path, scan: Scan) -> None:
    """Raise `OutputError` where a cloud would be named as one of another format."""
    own = Path(scan.name).suffix.lower()
    if own in (".las", ".laz", ".e57") and target.suffix.lower() != own:
        raise OutputError(
            f"{target}: expected a file of {own}, as the scan's cloud, found {target.suffix or 'no suffix'}; "
            "choose another name with -o"
        )


def _write_points(
    arguments: ExportArguments,
    path: Path,
    scan: Scan,
    poses: Float[np.ndarray, "n 4 4"],
    axes: PlanAxes | None,
    runtime: Runtime,
) -> None:
    kind = arguments.to
    if kind == "cloud":
        _check_cloud_suffix(arguments.out, scan)
        posed = poses if axes is None else axes.poses(poses)
        write_cloud(scan, path, posed, arguments.frame == "world")
    elif kind == "mesh":
        mesh = fuse_mesh(scan, poses, arguments.voxel_m, arguments.max_depth_m, runtime)
        if axes is not None:
            mesh.apply_transform(axes.target_from_plan)
        write_mesh(path, mesh, arguments.out.suffix)
    else:
        cloud = sample_cloud(scan, runtime)
        points = place_cloud(cloud, poses)
        write_ply(path, points if axes is None else axes.points(points), cloud.colors)


def _load(
    arguments: ExportArguments,
) -> tuple[Scan, Float[np.ndarray, "n 4 4"], PlanAxes | None]:
    """The scan, and poses in the world, or in the plan frame with the axes that these go to, if others."""
    frame = arguments.frame
    if not (arguments.source / RECORD).is_file():
        if frame != "world":
            raise ScanError(
                f"{arguments.source}: expected the output folder of planfit refine for --frame {frame}, "
                "found a scan; refine it first"
            )
        scan = read_scan(arguments.source, options=arguments.scan_options)
        return scan, scan.world_from_cams, None
    record = read_record(arguments.source)
    axes = None
    if frame not in ("world", "plan"):
        axes = require_axes(frame, record.axes.get(frame), arguments.to, str(arguments.source))
    as_told = None if arguments.scan_options == ScanOptions() else arguments.scan_options
    scan = record.scan(options=as_told)
    _, plan_from_cams = record.poses()
    if frame != "world":
        return scan, plan_from_cams, axes
    world_from_cams = record.world_from_plan @ plan_from_cams
    world_from_cams[:, :3, :3] = se3.project_to_so3(world_from_cams[:, :3, :3])
    return scan, world_from_cams, None
