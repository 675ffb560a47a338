"""Refined poses in the forms of other programs: what `planfit export` and `planfit.save_poses` write."""

from pathlib import Path
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError, OutputError, did_you_mean
from planfit.export.axes import AXES, PoseFrame, require_axes
from planfit.export.cloud import sample_cloud
from planfit.export.datasets import write_colmap, write_nerfstudio
from planfit.export.write import write_kitti, write_pose_graph
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.pipeline.depth_unit import in_unit
from planfit.pipeline.result import RefineResult
from planfit.runtime import Runtime, whole_file, whole_folder
from planfit.scan import Scan, calibrated_scan, write_tum
from planfit.scan.formats.pose_lists import write_log
from planfit.scan.odometry import OdometryOptions, make_odometry

PoseForm = Literal["tum", "kitti", "open3d", "g2o", "colmap", "nerfstudio"]
"""Files, and of the last two folders with images and depth."""
WITH_MATCHES = ("g2o", "colmap")


def save_poses(
    result: RefineResult,
    path: str | Path,
    to: str = "tum",
    frame: PoseFrame = "world",
    runtime: Runtime | None = None,
) -> Path:
    """Write refined poses in the form of another program, as `planfit export` does.

    Args:
        result: of `planfit.refine`.
        path: file to write, a folder for `colmap` and `nerfstudio`; it must not be there yet.
        to: `tum`, `kitti`, an `open3d` log, a `g2o` pose graph, or folders with images and depth.
        frame: axes of the poses, the scan's own, those of the plan (z up, floor at 0), those of the plan's
            `file` in its unit, or of the `map` that it lies on.
        runtime: threads and progress, where images are written.

    Returns:
        What was written: a log without a suffix gets `.log`.

    Raises:
        OptionError: there is no such form, or the result does not know its scan.
        OutputError: the plan has no such axes, or the form needs metres.
        OutputError: something of that name is there, or it cannot be written.
        ScanError: an image of the scan can no longer be read.
    """
    if to not in get_args(PoseForm):
        known = ", ".join(get_args(PoseForm))
        raise OptionError(
            f"to: expected one of {known}, found {to!r}; {did_you_mean(to, get_args(PoseForm))}"
        )
    if result.made_of is None:
        raise OptionError(
            "save_poses: expected a result of planfit.refine, found one that was put together otherwise; "
            "write its world_from_cams with planfit.scan.write_tum"
        )
    target = free_target(Path(path), to)
    scan = calibrated_scan(in_unit(result.made_of.scan, result.depth_unit), result.sensor)
    poses = result.plan_from_cams if frame != "world" else result.world_from_cams.copy()
    if frame == "world":
        poses[:, :3, :3] = se3.project_to_so3(poses[:, :3, :3])
    elif frame != "plan":
        source = None if result.floorplan is None else result.floorplan.source
        found = None if source is None else AXES[frame](source)
        poses = require_axes(frame, found, to, scan.name).poses(poses)
    write_poses(target, to, scan, poses, result.matches, runtime or Runtime())
    return target


def free_target(target: Path, to: str) -> Path:
    """The name to write; Open3D tells a trajectory by `.log` alone, so a name without a suffix gets it.

    Raises:
        OutputError: it has another suffix, or something of that name is there.
    """
    if to == "open3d" and target.suffix.lower() != ".log":
        if target.suffix:
            raise OutputError(
                f"{target}: expected a file of .log, by which Open3D tells a trajectory, found "
                f"{target.suffix}; choose another name"
            )
        target = target.with_name(f"{target.name}.log")
    if target.exists() or target.is_symlink():
        raise OutputError(f"{target}: expected no such file or folder; choose another")
    return target


def write_poses(
    target: Path,
    to: str,
    scan: Scan,
    poses: Float[np.ndarray, "n 4 4"],
    matches: Matches | None,
    runtime: Runtime,
) -> None:
    """Write poses (target_from_cam) of all frames in a `PoseForm`, whole or not at all.

    Matches are written by forms `WITH_MATCHES`.

    Raises:
        OutputError: it cannot be written, or a frame has no colour where the form needs it.
        ScanError: an image cannot be read.
    """
    if to in ("colmap", "nerfstudio"):
        with whole_folder(target) as folder:
            cloud = sample_cloud(scan, runtime, 100_000)
            if to == "colmap":
                write_colmap(folder, scan, poses, cloud, runtime, matches)
            else:
                write_nerfstudio(folder, scan, poses, cloud, runtime)
        return
    with whole_file(target) as part:
        if to == "tum":
            write_tum(part, scan.timestamps, poses)
        elif to == "kitti":
            write_kitti(part, poses)
        elif to == "open3d":
            write_log(part, range(len(scan)), poses)
        else:
            odometry = make_odometry(scan.world_from_cams, OdometryOptions(), scan.timestamps)
            write_pose_graph(part, poses, odometry, matches)
