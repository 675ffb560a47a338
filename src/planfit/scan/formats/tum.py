"""The TUM RGB-D benchmark: images named by their time, three lists, poses of a motion capture system; and
OpenLORIS-Scene, a robot's RealSense listed in the same way, with poses of the robot's base."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError, told_as
from planfit.geometry import se3
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.layout import FolderLayout, Listing, Refined, each_frame
from planfit.scan.pose_files import PoseTable, read_poses, read_poses_of
from planfit.scan.poses import check_pose, write_tum
from planfit.scan.recording import Frame, Size
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import first_of, read_matrix, read_rows
from planfit.scan.timed_lists import ImageList, columns_of_list, frames_of_lists, read_list
from planfit.scan.types import ScanOptions

POSES, CALIBRATION = "groundtruth.txt", "calibration.txt"
OTHER_POSES = ("CameraTrajectory.txt", ".gt.freiburg")
"""Ends of the names of ORB-SLAM's and of ICL-NUIM's."""
PAIRS = tuple(f"{name}.txt" for name in ("associations", "association", "associated", "associate"))
"""Lists of colour and depth, or depth and colour, of one moment."""
NO_COLOR = "no rgb.txt: the scan is taken as depth alone; add it where there are colour images"

PUBLISHED: dict[str, tuple[float, ...]] = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "freiburg2": (520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
"""fx fy cx cy k1 k2 p1 p2 k3 of the benchmark's three cameras; the images of the third are undistorted."""
ICL_NUIM = (481.2, 480.0, 319.5, 239.5)
DEFAULT = (525.0, 525.0, 319.5, 239.5)


def _frames(source: FileSource, options: ScanOptions) -> Listing[tuple[float, ...]]:
    """Frames, and intrinsics and distortion of all of them."""
    color, depth, is_paired = _lists(source)
    poses_name, table = _poses(source, options, (color or depth).times)
    name = poses_name or (options.poses.name if options.poses else "")
    gap_s = options.max_time_gap_s
    found = frames_of_lists(source.path, color, depth, table, name, gap_s, is_paired)
    intrinsics, warning = _intrinsics(source)
    files = ("rgb.txt", "depth.txt") if not is_paired else (depth.file,)
    tables = [n for n in (*files, poses_name, CALIBRATION) if source.exists(n)]
    told = [*found.warnings, *warning, *([] if color else [NO_COLOR])]
    return Listing(source, found.frames, intrinsics, tables, found.skipped, told)


def _lens(listing: Listing[tuple[float, ...]], _: Frame, size: Size) -> Lens:
    intrinsics, where = listing.content, str(listing.source.path / CALIBRATION)
    return Lens(make_camera(*size, intrinsics[:4], where), tuple(intrinsics[4:]))


def _lists(source: FileSource) -> tuple[ImageList | None, ImageList, bool]:
    """Colour and depth, and whether they are paired line by line: as a list of pairs has them, unless there
    is none or the two lists of the benchmark are there, rgb.txt and depth.txt, each by its time."""
    name = first_of(source, PAIRS)
    if not source.exists(name) or (source.exists("rgb.txt") and source.exists("depth.txt")):
        color = read_list(source, "rgb.txt") if source.exists("rgb.txt") else None
        return color, read_list(source, "depth.txt"), False
    rows = read_rows(source, name, "lines `time colour time depth`")
    first, second = (columns_of_list(source, name, rows, k, " time filename") for k in (0, 2))
    n_depth = [sum("depth" in image.lower() for image in one.names) for one in (first, second)]
    return (second, first, True) if n_depth[0] > n_depth[1] else (first, second, True)


def _pose_file(source: FileSource) -> str:
    """Poses beside the images, by name; those of the benchmark where there are several."""
    ends = (POSES, *OTHER_POSES)
    return next((name for end in ends for name in source.names() if name.endswith(end)), "")


def _poses(
    source: FileSource, options: ScanOptions, times: Float[np.ndarray, " n"]
) -> tuple[str, PoseTable]:
    """The poses beside the images, and their file; where there are none, those of the tracker that the
    options name, a row each of the images at `times` where they have none."""
    if name := _pose_file(source):
        return name, read_poses_of(source, name)
    if options.poses is None:
        raise ScanError(
            f"{source.path}: expected poses in {POSES}, found none; give those of a tracker with --poses FILE"
        )
    table = read_poses(options.poses)
    if table.kind != "tum" and len(table.keys) == len(times):
        return "", replace(table, kind="tum", keys=times)
    if table.kind != "tum":
        raise ScanError(
            f"{options.poses}: expected poses with times, as {source.path} has no {POSES}, found none with "
            "times; export them as TUM"
        )
    return "", table


def _write(refined: Refined[tuple[float, ...]]) -> None:
    times = np.array([frame.time for frame in refined.frames])
    write_tum(refined.directory / (_pose_file(refined.source) or POSES), times, refined.poses)


def _intrinsics(source: FileSource) -> tuple[tuple[float, ...], list[str]]:
    if source.exists(CALIBRATION):
        values = read_matrix(source, CALIBRATION, "fx fy cx cy [k1 k2 p1 p2 [k3]]").ravel()
        if values.size not in (4, 8, 9):
            raise ScanError(
                f"{source.path / CALIBRATION}: expected fx fy cx cy [k1 k2 p1 p2 [k3]], found "
                f"{values.size} numbers"
            )
        return tuple(values.tolist()), []
    if _pose_file(source).endswith(".freiburg"):
        return ICL_NUIM, [f"no {CALIBRATION}: the intrinsics are those of ICL-NUIM"]
    folder = str(source.path.resolve()).lower()
    for camera, values in PUBLISHED.items():
        if camera in folder or f"fr{camera[-1]}_" in source.path.name.lower():
            return values, []
    return DEFAULT, [
        "no calibration.txt: the intrinsics are the default of the benchmark (fx 525), because no "
        "folder is named freiburg1, 2 or 3"
    ]


TUM = FolderLayout(
    name="tum",
    page="""
The TUM RGB-D benchmark: images named by their time, three lists, poses of a motion capture system.

    SCAN/rgb.txt, depth.txt     `time filename`; without rgb.txt the scan is depth alone
    SCAN/associations.txt       in their place: `time rgb time depth`, or depth first, which names of folders
                                tell (ORB-SLAM, ICL-NUIM; also association, associated, associate.txt)
    SCAN/groundtruth.txt        `time tx ty tz qx qy qz qw`, world_from_cam, OpenCV camera axes; without it,
                                CameraTrajectory.txt (ORB-SLAM), NAME.gt.freiburg (ICL-NUIM), or --poses FILE,
                                a tracker's
    SCAN/calibration.txt        fx fy cx cy [k1 k2 p1 p2 [k3]] (optional; the form of ETH3D SLAM)

Images of one list whose moment the other lacks are frames, too. Between poses at 10 Hz or more those of
images are interpolated. Times are seconds, or milli-, micro- or nanoseconds since 1970; poses without
times are a row an image. Where times are none of a clock (they repeat, or the path is longer in their order
than as listed), lists of equal length are taken line by line.

Depth is registered to colour; 16-bit, 5000 a metre, 0 where nothing was measured. Without a calibration
file the intrinsics are those the benchmark publishes for freiburg1, 2 or 3, where a name in the path says
which, or ICL-NUIM's, else its default of the driver. ICL-NUIM's poses are taken as they are, though others
found them mirrored in y (InfiniTAM's issue 65): the images will contradict them then, which is told.
""",
    expects="rgb.txt, depth.txt (or associations.txt) and groundtruth.txt (depth alone without rgb.txt)",
    checked=(
        "real ground truth of fr2_desk and a trajectory of ORB-SLAM "
        "(github.com/MichaelGrupp/evo, test/data)",
        "columns and comments of trajectories",
    ),
    # Without rgb.txt it is depth alone, and a recording of one's own may have a tracker's poses elsewhere.
    told_by=("|".join(("depth.txt", *PAIRS)), "|".join((POSES, "rgb.txt", *PAIRS))),
    parts=("rgb.txt", "depth.txt", POSES),
    frames=_frames,
    metres_per_unit=1 / 5000,
    lens=each_frame(_lens),
    write=_write,
)


COLORS, DEPTHS = "color.txt", "aligned_depth.txt"
SENSORS, MOUNTS = "sensors.yaml", "trans_matrix.yaml"
CAMERA, BASE = "d400_color_optical_frame", "base_link"


@dataclass(frozen=True)
class _Robot:
    """The camera, and where it is on the robot."""

    lens: Lens
    base_from_cam: Float[np.ndarray, "4 4"]


def _robot_frames(source: FileSource, options: ScanOptions) -> Listing[_Robot]:
    gap_s = options.max_time_gap_s
    color, depth = read_list(source, COLORS), read_list(source, DEPTHS)
    table = read_poses_of(source, POSES)
    # OpenCV raises what it likes where nodes are missing or of another kind.
    with told_as(ScanError, source.path / SENSORS, "YAML of OpenCV"):
        lens = _robot_lens(source)
    with told_as(ScanError, source.path / MOUNTS, "YAML of OpenCV"):
        robot = _Robot(lens, _mount(source))
    table = replace(table, poses=table.poses @ robot.base_from_cam)
    found = frames_of_lists(source.path, color, depth, table, POSES, gap_s)
    tables = [COLORS, DEPTHS, POSES, SENSORS, MOUNTS]
    return Listing(source, found.frames, robot, tables, found.skipped, found.warnings)


def _opened(source: FileSource, name: str) -> cv2.FileStorage:
    return cv2.FileStorage(read_text(source, name), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)


def _matrix(node: cv2.FileNode, count: int, where: str) -> Float[np.ndarray, " count"]:
    # Number by number: OpenCV 5 makes a matrix whose columns are not told in memory that is not its own.
    data = node.getNode("data")
    # None has more than 16; each is counted to from the first.
    values = [data.at(i) for i in range(min(int(data.size()), 16))]
    if len(values) < count or not all(one.isReal() or one.isInt() for one in values):
        raise ScanError(f"{where}: expected a matrix of {count} numbers, found none")
    return np.array([one.real() for one in values])


def _robot_lens(source: FileSource) -> Lens:
    where = f"{source.path / SENSORS}, {CAMERA}"
    storage = _opened(source, SENSORS)  # its nodes live as long as it does
    node = storage.getNode(CAMERA)
    fx, cx, fy, cy = _matrix(node.getNode("intrinsics"), 4, where)[:4]
    distortion = _matrix(node.getNode("distortion_coefficients"), 4, where)[:5]
    width, height = (int(node.getNode(side).real()) for side in ("width", "height"))
    camera = make_camera(width, height, (fx, fy, cx, cy), where)
    return Lens(camera, tuple(distortion.tolist()))


def _mount(source: FileSource) -> Float[np.ndarray, "4 4"]:
    """Along the chain of frames from the base to the camera, either way."""
    where = str(source.path / MOUNTS)
    storage = _opened(source, MOUNTS)
    rows = storage.getNode("trans_matrix")
    edges = []
    for i in range(int(rows.size())):
        row = rows.at(i)
        parent_from_child = _matrix(row.getNode("matrix"), 16, where)[:16].reshape(4, 4)
        check_pose(parent_from_child, where)
        names = (row.getNode("parent_frame").string(), row.getNode("child_frame").string())
        edges += [(*names, parent_from_child), (*names[::-1], se3.inverse(parent_from_child))]
    base_from = {BASE: np.eye(4)}
    for _ in edges:  # a chain is no longer than all of them
        for parent, child, parent_from_child in edges:
            if parent in base_from:
                base_from.setdefault(child, base_from[parent] @ parent_from_child)
    if CAMERA not in base_from:
        raise ScanError(f"{where}: expected frames that lead from {BASE} to {CAMERA}, found none")
    return base_from[CAMERA]


def _write_of_robot(refined: Refined[_Robot]) -> None:
    times = np.array([frame.time for frame in refined.frames])
    base_poses = refined.poses @ se3.inverse(refined.content.base_from_cam)
    write_tum(refined.directory / POSES, times, base_poses)


OPENLORIS = FolderLayout(
    name="openloris",
    page="""OpenLORIS-Scene: packages of a robot with a RealSense D435i.

    SCAN/color.txt, aligned_depth.txt     `time filename`; depth 16-bit millimetres, registered to colour
    SCAN/groundtruth.txt                  `time tx ty tz qx qy qz qw`: poses of base_link
    SCAN/sensors.yaml, trans_matrix.yaml  d400_color_optical_frame: intrinsics (fx cx fy cy) and distortion;
                                          where it is on base_link, along the chain of frames

Refined poses are written as groundtruth.txt, of base_link.
""",
    expects="color.txt, aligned_depth.txt, groundtruth.txt, sensors.yaml and trans_matrix.yaml",
    checked=(
        "the reader that the set's authors gave SLAMBench (OpenLORIS.cpp). No real file",
        "order of intrinsics, chain of frames, unit of depth",
    ),
    # Without one of these it would pass for TUM's, as it has depth.txt and groundtruth.txt.
    told_by=lambda source: (
        sum(source.exists(name) for name in (COLORS, DEPTHS, SENSORS, MOUNTS)) >= 3
    ),
    parts=(COLORS, DEPTHS, POSES, SENSORS, MOUNTS),
    frames=_robot_frames,
    lens=lambda listing: lambda *_: listing.content.lens,
    write=_write_of_robot,
)
