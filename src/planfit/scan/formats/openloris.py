"""OpenLORIS-Scene: a robot's RealSense, images listed as TUM lists them, and poses of the robot's base."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError, told_as
from planfit.geometry import se3
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.layout import FolderLayout, Listing, Refined
from planfit.scan.pose_files import read_poses_of
from planfit.scan.poses import check_pose, write_tum
from planfit.scan.source import FileSource, read_text
from planfit.scan.timed_lists import frames_of_lists, read_list
from planfit.scan.types import ScanOptions

COLORS, DEPTHS, POSES = "color.txt", "aligned_depth.txt", "groundtruth.txt"
SENSORS, MOUNTS = "sensors.yaml", "trans_matrix.yaml"
CAMERA, BASE = "d400_color_optical_frame", "base_link"


@dataclass(frozen=True)
class _Robot:
    """The camera, and where it is on the robot."""

    lens: Lens
    base_from_cam: Float[np.ndarray, "4 4"]


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Robot]:
    gap_s = options.max_time_gap_s
    color, depth = read_list(source, COLORS), read_list(source, DEPTHS)
    table = read_poses_of(source, POSES)
    # OpenCV raises what it likes where nodes are missing or of another kind.
    with told_as(ScanError, source.path / SENSORS, "YAML of OpenCV"):
        lens = _lens(source)
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


def _lens(source: FileSource) -> Lens:
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


def _write(refined: Refined[_Robot]) -> None:
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
    frames=_frames,
    lens=lambda listing: lambda *_: listing.content.lens,
    write=_write,
)
