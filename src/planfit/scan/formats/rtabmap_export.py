"""What RTAB-Map exports of its databases: images, a calibration for each, and a list of poses."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.layout import FolderLayout, Listing, Refined
from planfit.scan.lens_file import lens_of_yaml, yaml_values
from planfit.scan.pose_files import PoseTable, read_poses_of
from planfit.scan.poses import check_pose, write_tum
from planfit.scan.recording import Frame, LensOfFrame
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import Names, first_of
from planfit.scan.types import ScanOptions

KEY = r"\d+(?:\.\d+)?"
"""Images are called by their node, or by their time."""
_EXPORTED = (
    "export poses of the camera beside the images (format 11), or give the database, the .db file"
)


@dataclass(frozen=True)
class _Export:
    """What lenses and the writing of poses need."""

    poses_name: str
    has_nodes: bool
    """Whether each pose has the number of its node."""
    lens_of: dict[str, LensOfFrame]
    """By frame, as are the next two."""
    pose_from_cam: dict[str, Float[np.ndarray, "4 4"]]
    """From axes of the camera to those of what the list has poses of: the camera or the robot's base."""
    node_of: dict[str, int]


def _prefix(source: FileSource) -> str | None:
    """What stands before the names of the folders: `rtabmap_`, or nothing; None where they are others."""
    folders = source.folders()
    for prefix in (name.removesuffix("calib") for name in folders if name.endswith("calib")):
        if {f"{prefix}rgb", f"{prefix}depth"} <= set(folders):
            return prefix
    return None


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Export]:  # noqa: ARG001
    prefix = _prefix(source) or ""
    colors = Names(f"{prefix}rgb/{{}}.jpg", f"{prefix}rgb/{{}}.png", key=KEY).by_key(source)
    depth = Names(f"{prefix}depth/{{}}.png", key=KEY)
    name = _pose_file(source)
    table = read_poses_of(source, name)
    row_of = _rows(table, list(colors), f"{source.path / name}")
    is_of_camera = "camera" in name
    export = _Export(name, table.numbers is not None, {}, {}, {})
    frames, skipped, tables = [], [], [name]
    for i, (key, color) in enumerate(colors.items()):
        calibration = f"{prefix}calib/{key}.yaml"
        if key not in row_of or not source.exists(calibration):
            skipped.append(f"frame {key}: {calibration if key in row_of else name} has none of it")
            continue
        row = row_of[key]
        text, where = read_text(source, calibration), str(source.path / calibration)
        export.lens_of[key] = lens_of_yaml(text, where)
        export.pose_from_cam[key] = np.eye(4) if is_of_camera else _base_from_cam(text, where)
        export.node_of[key] = row if table.numbers is None else int(table.numbers[row])
        pose = table.poses[row] @ export.pose_from_cam[key]
        time = float(table.keys[row]) if table.kind == "tum" else float(i)
        frames.append(Frame(key, time, pose, color, first_of(source, depth.of(key))))
        tables.append(calibration)
    lone = [key for key, _ in depth.listed(source) if key not in colors]
    skipped += [f"frame {key}: {prefix}rgb/{key}.jpg is missing" for key in lone]
    told = f"poses of {name} are taken for those of the robot's base, as its name lacks `camera`"
    return Listing(source, frames, export, tables, skipped, [] if is_of_camera else [told])


def _pose_file(source: FileSource) -> str:
    """Of the camera, where there are several."""
    names = [n for n in source.names() if "poses" in n and n.endswith(".txt") and "scan" not in n]
    if not names:
        raise ScanError(
            f"{source.path}: expected a list of poses ({_prefix(source)}camera_poses.txt), found none; "
            f"{_EXPORTED}"
        )
    return min(names, key=lambda name: ("camera" not in name, name))


def _rows(table: PoseTable, keys: list[str], where: str) -> dict[str, int]:
    """Rows of frames: by node, by time, or in order."""
    has_nodes = all(key.isdecimal() for key in keys)
    numbers = table.numbers if has_nodes else table.keys if table.kind == "tum" else None
    if numbers is not None:
        row_of = {float(number): row for row, number in enumerate(numbers)}
        return {key: row_of[float(key)] for key in keys if float(key) in row_of}
    if len(keys) != len(table.keys):
        raise ScanError(
            f"{where}: expected poses that tell their images, found {len(table.keys)} for {len(keys)} "
            f"images; {_EXPORTED}"
        )
    return {key: row for row, key in enumerate(keys)}


def _base_from_cam(text: str, where: str) -> Float[np.ndarray, "4 4"]:
    numbers = yaml_values(text, where)[0].get("local_transform", [])
    if len(numbers) != 12:
        raise ScanError(
            f"{where}: expected local_transform, 12 numbers, found {len(numbers)}; {_EXPORTED}"
        )
    base_from_cam = np.vstack([np.reshape(numbers, (3, 4)), [0.0, 0.0, 0.0, 1.0]])
    check_pose(base_from_cam, where)
    return base_from_cam


def _write(refined: Refined[_Export]) -> None:
    export, path = refined.content, refined.directory / refined.content.poses_name
    ids = [frame.frame_id for frame in refined.frames]
    poses = refined.poses @ se3.inverse(np.stack([export.pose_from_cam[one] for one in ids]))
    write_tum(path, np.array([frame.time for frame in refined.frames]), poses)
    if export.has_nodes:
        lines = zip(path.read_text().splitlines(), ids, strict=True)
        rows = [f"{line} {export.node_of[one]}" for line, one in lines]
        path.write_text("\n".join(["#timestamp x y z qx qy qz qw id", *rows]) + "\n")


RTABMAP_EXPORT = FolderLayout(
    name="rtabmap-export",
    page="""RTAB-Map's images and poses, as `rtabmap-export` and the database viewer write them.

    SCAN/rgb/ID.jpg, depth/ID.png     16-bit millimetres; folders may have the database's name before theirs
                                      (rtabmap_rgb/); ID is the node, or the time
    SCAN/calib/ID.yaml                camera_matrix, local_transform (3x4: base_from_camera)
    SCAN/camera_poses.txt             `time x y z qx qy qz qw [id]` (formats 10 and 11) or 12 numbers a row:
                                      world_from_cam, OpenCV axes; any name with `poses`

Poses of a file without `camera` in its name are those of the robot's base, which is told; local_transform
says where the camera is on it. Images are taken as rectified, as in the [database](#rtabmap), which has all
of this too. Refined poses are written as such a list.
""",
    expects="folders rgb/, depth/ and calib/ (rtabmap_rgb/ ...) with camera_poses.txt",
    checked=(
        "rtabmap-export's source (github.com/introlab/rtabmap, tools/Export/main.cpp). No real file",
        "names of folders and files, columns of poses, where the camera is on the robot",
    ),
    told_by=lambda source: _prefix(source) is not None,
    parts=("rgb/", "depth/", "calib/", "camera_poses.txt"),
    frames=_frames,
    lens=lambda listing: lambda frame, size: listing.content.lens_of[frame.frame_id](frame, size),
    write=_write,
)
