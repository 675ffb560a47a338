"""Refined poses in the forms and the axes of other programs: what `planfit export` and `planfit.save_poses`
write; the axes of a plan's own file, and those of the map it lies on, with heights."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError, OutputError, did_you_mean
from planfit.export.cloud import Cloud, sample_cloud
from planfit.export.datasets import write_colmap, write_nerfstudio, write_rerun, write_rosbag
from planfit.export.write import write_kitti, write_pose_graph
from planfit.floorplan.formats.georeference import SAME_SCALE
from planfit.floorplan.types import PlanSource
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.pipeline.depth_unit import in_unit
from planfit.pipeline.result import RefineResult
from planfit.runtime import Runtime, whole_file, whole_folder
from planfit.scan import Scan, calibrated_scan, write_tum
from planfit.scan.formats.pose_lists import write_log
from planfit.scan.odometry import Odometry, OdometryOptions, make_odometry

PoseFrame = Literal["world", "plan", "file", "map"]
"""Axes of what is exported: the scan's own, the plan's (m, z up, floor at 0), those of the plan's file in its
unit, or eastings, northings and heights (m)."""
METRES_ALONE = ("g2o", "cloud", "colmap", "nerfstudio", "rosbag")
"""Forms that hold other lengths beside poses, or are in metres by convention (REP 103 of ROS)."""
_LONGEST_UNIT_M = 1000.0
"""Coordinates that count more are degrees."""


@dataclass(frozen=True)
class PlanAxes:
    """Other axes than those of the plan frame: uneven scales stretch positions, and turn nothing."""

    target_from_plan: Float[np.ndarray, "4 4"]
    """Affine, of lengths in m; it keeps the sense of rotations: where y runs down, z does."""

    @property
    def metres_per_unit(self) -> float:
        """Of the target's coordinates."""
        return float(abs(np.linalg.det(self.target_from_plan[:3, :3])) ** (-1 / 3))

    @property
    def words(self) -> str:
        """What is not as usual, for people."""
        unit = self.metres_per_unit
        told = [] if abs(unit - 1) < SAME_SCALE else [f"lengths in {unit:.6g} m"]
        return ", ".join([*told, *(["z down"] if self.target_from_plan[2, 2] < 0 else [])])

    def points(self, points_plan: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Points of the plan frame (m) in these axes."""
        return se3.transform(self.target_from_plan, points_plan)

    def poses(self, plan_from_cams: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n 4 4"]:
        """Poses of cameras in these axes, positions in their unit."""
        turn = se3.project_to_so3(self.target_from_plan[:3, :3] * self.metres_per_unit)
        places = self.points(plan_from_cams[:, :3, 3])
        return se3.make_transform(turn @ plan_from_cams[:, :3, :3], places)


def file_axes(source: PlanSource) -> PlanAxes | None:
    """Of the plan's own file, heights from its own zero; None where it has none, or they are degrees."""
    if source.file_from_plan is None:
        return None
    up = np.eye(4)
    up[2, 3] = source.elevation_m
    return _checked(_raised(source.file_from_plan) @ up)


def map_axes(source: PlanSource) -> PlanAxes | None:
    """Of the map, m; None where the file does not tell where on one it lies, or that is in degrees."""
    own = file_axes(source)
    if own is None or source.map_from_file is None:
        return None
    target_from_plan = _raised(source.map_from_file) @ own.target_from_plan
    target_from_plan[2, 3] += source.map_height_m
    return _checked(target_from_plan)


AXES = {"file": file_axes, "map": map_axes}
"""By the name of the frame."""


def axes_record(source: PlanSource | None) -> dict[str, list[list[float]] | None]:
    """Both as plain values, for `run.json`."""
    found = {name: None if source is None else of(source) for name, of in AXES.items()}
    return {
        f"{name}_from_plan": None if axes is None else axes.target_from_plan.tolist()
        for name, axes in found.items()
    }


def require_axes(frame: str, axes: PlanAxes | None, to: str, where: str) -> PlanAxes:
    """The axes, if a form (`to`) can be written in them.

    Raises:
        OutputError: there are none, or the form needs metres; it begins with `where`.
    """
    if axes is None:
        needed = "coordinates of its own" if frame == "file" else "a map conversion or a world file"
        others = ", ".join(name for name in get_args(PoseFrame) if name != frame)
        raise OutputError(
            f"{where}: expected a run on a plan with {needed}, in lengths, not degrees, for frame {frame}, "
            f"found none; take one of {others}, or refine again if the run is of an older version"
        )
    if to in METRES_ALONE and abs(axes.metres_per_unit - 1) > SAME_SCALE:
        raise OutputError(
            f"{where}: expected axes in metres for {to}, found lengths in {axes.metres_per_unit:.6g} m of "
            f"frame {frame}; take frame map or plan, or another form"
        )
    return axes


def _raised(affine: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4 4"]:
    """An affine map of the plane with heights at its mean scale, downwards where it mirrors."""
    found = np.eye(4)
    found[np.ix_([0, 1], [0, 1, 3])] = affine[:2]
    determinant = float(np.linalg.det(affine[:2, :2]))
    found[2, 2] = np.sign(determinant) * np.sqrt(abs(determinant))
    return found


def _checked(target_from_plan: Float[np.ndarray, "4 4"]) -> PlanAxes | None:
    """None where a metre is not as long to all sides, or too short, as in degrees."""
    least, *_, most = np.sort(np.linalg.svd(target_from_plan[:3, :3], compute_uv=False))
    if most > least * (1 + SAME_SCALE) or most * _LONGEST_UNIT_M < 1 - SAME_SCALE:
        return None
    return PlanAxes(target_from_plan)


PoseForm = Literal["tum", "kitti", "open3d", "g2o", "rerun", "rosbag", "colmap", "nerfstudio"]
"""Files, and of the last three folders."""
WITH_MATCHES = ("g2o", "colmap")
_FOLDERS = ("rosbag", "colmap", "nerfstudio")
_SUFFIXES = {"open3d": ".log", "rerun": ".rrd"}
"""By which alone their programs tell a file."""


@dataclass(frozen=True)
class _Posed:
    """What a form is written of."""

    scan: Scan
    poses: Float[np.ndarray, "n 4 4"]
    """target_from_cam"""
    matches: Matches | None
    runtime: Runtime
    frame: str
    """Name of the target."""

    @property
    def cloud(self) -> Cloud:
        """Points that go with the poses."""
        return sample_cloud(self.scan, self.runtime, 100_000)

    @property
    def odometry(self) -> Odometry:
        """Recorded steps."""
        scan = self.scan
        return make_odometry(scan.world_from_cams, OdometryOptions(), scan.timestamps)


_WRITERS: dict[str, Callable[[Path, _Posed], None]] = {
    "tum": lambda path, of: write_tum(path, of.scan.timestamps, of.poses),
    "kitti": lambda path, of: write_kitti(path, of.poses),
    "open3d": lambda path, of: write_log(path, range(len(of.scan)), of.poses),
    "g2o": lambda path, of: write_pose_graph(path, of.poses, of.odometry, of.matches),
    "rerun": lambda path, of: write_rerun(path, of.scan, of.poses, of.cloud, of.frame),
    "rosbag": lambda path, of: write_rosbag(path, of.scan, of.poses, of.frame),
    "colmap": lambda path, of: write_colmap(
        path, of.scan, of.poses, of.cloud, of.runtime, of.matches
    ),
    "nerfstudio": lambda path, of: write_nerfstudio(path, of.scan, of.poses, of.cloud, of.runtime),
}


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
        path: file to write, a folder for `rosbag`, `colmap` and `nerfstudio`; it must not be there yet.
        to: `tum`, `kitti`, an `open3d` log, a `g2o` pose graph, a recording of `rerun`, a `rosbag` of ROS 2,
            or folders with images and depth.
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
    write_poses(target, to, scan, poses, result.matches, runtime or Runtime(), frame)
    return target


def free_target(target: Path, to: str) -> Path:
    """The name to write; where programs tell the form by its suffix alone, a name without one gets it.

    Raises:
        OutputError: it has another suffix, or something of that name is there.
    """
    suffix = _SUFFIXES.get(to, target.suffix)
    if target.suffix.lower() != suffix.lower():
        if target.suffix:
            raise OutputError(
                f"{target}: expected a file of {suffix}, by which {to} is told, found {target.suffix}; "
                "choose another name"
            )
        target = target.with_name(f"{target.name}{suffix}")
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
    frame: str = "world",
) -> None:
    """Write poses (target_from_cam) of all frames in a `PoseForm`, whole or not at all.

    Matches are written by forms `WITH_MATCHES`, the target's name (`frame`) by `rerun` and `rosbag`.

    Raises:
        OutputError: it cannot be written, a library is missing, or a frame has no colour where the form
            needs it.
        ScanError: an image cannot be read.
    """
    posed = _Posed(scan, poses, matches, runtime, frame)
    with (whole_folder if to in _FOLDERS else whole_file)(target) as part:
        _WRITERS[to](part, posed)
