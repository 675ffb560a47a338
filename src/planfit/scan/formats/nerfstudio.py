"""nerfstudio and Instant-NGP: `transforms.json` with depth.

Each frame has `file_path`, `depth_file_path` and `transform_matrix`: world_from_cam with OpenGL camera
axes. Intrinsics `fl_x fl_y cx cy w h` and distortion `k1 k2 p1 p2 k3 k4` with `camera_model` stand at the
top or in a frame, which wins. There cx and cy count from the corner of the first pixel: half a pixel more
than ours. Depth is 16-bit in millimetres (nerfstudio's default), or `.npy` in metres. The axes of the
world are anyone's.
"""

import json
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from planfit.errors import ScanError
from planfit.scan.axes import from_opengl
from planfit.scan.frames import make_camera
from planfit.scan.images.image_files import Entry
from planfit.scan.images.lens import Lens
from planfit.scan.layout import Layout, scan_of_layout
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source
from planfit.scan.tables import number_list, read_json
from planfit.scan.types import Scan, check_pose

LOOKS_FOR = "transforms.json with frames that have depth_file_path"
NAME = "transforms.json"
KINDS = ("", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV_FISHEYE")


def recognise(source: Source) -> bool:
    """Whether a folder has this layout."""
    return source.exists(NAME)


def read(source: Source, options: ScanOptions) -> Scan:
    """Read a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    path = source.path / NAME
    content = read_json(source, NAME)
    frames = content.get("frames")
    if not isinstance(frames, list) or not frames:
        raise ScanError(f"{path}: expected a list `frames`, found none")
    if not any(isinstance(f, dict) and f.get("depth_file_path") for f in frames):
        raise ScanError(
            f"{path}: expected frames with depth_file_path, found none; planfit needs depth, process "
            "the capture with depth"
        )
    frame_of: dict[str, dict[str, Any]] = {}
    entries = []
    for i, frame in enumerate(frames):
        where = f"{path}, frame {i}"
        name = frame.get("file_path") if isinstance(frame, dict) else None
        if not isinstance(name, str) or not PurePosixPath(name).name:
            raise ScanError(f"{where}: expected an object with file_path, found none")
        if not isinstance(frame.get("depth_file_path") or "", str):
            raise ScanError(f"{where}: expected a name as depth_file_path, found another value")
        matrix = number_list(frame.get("transform_matrix"), 16, f"{where}, transform_matrix")
        pose = from_opengl(matrix.reshape(4, 4))
        check_pose(pose, where)
        color = str(PurePosixPath(name))
        depth = str(PurePosixPath(frame.get("depth_file_path") or ""))
        frame_of[color] = frame
        title = str(PurePosixPath(color).with_suffix("")).replace("../", "").replace("/", "_")
        entries.append(Entry(title, float(i), pose, color, depth if depth != "." else ""))

    def lens(entry: Entry, size: tuple[int, int]) -> Lens:
        return _lens({**content, **frame_of[entry.color]}, size, f"{path}, {entry.color}")

    def write_poses(directory: Path, written: Sequence[Entry], poses: np.ndarray) -> None:
        refined = [
            {**frame_of[entry.color], "transform_matrix": pose.tolist()}
            for entry, pose in zip(written, from_opengl(poses), strict=True)
        ]
        text = json.dumps({**content, "frames": refined}, indent=1)
        (directory / NAME).write_text(text + "\n")

    layout = Layout("nerfstudio", entries, 1e-3, write_poses, lens, other_files=[NAME])
    return scan_of_layout(source, layout, options)


def _lens(values: dict[str, Any], size: tuple[int, int], where: str) -> Lens:
    kind = values.get("camera_model", "")
    if kind not in KINDS:
        raise ScanError(
            f"{where}: expected a camera_model of {', '.join(KINDS[1:])}, found {kind!r}; "
            "undistort the images first"
        )
    if "fl_x" not in values and "camera_angle_x" in values:
        (angle,) = number_list(values["camera_angle_x"], 1, f"{where}, camera_angle_x")
        focal = size[0] / 2 / np.tan(angle / 2)
        values = {**values, "fl_x": focal, "cx": size[0] / 2, "cy": size[1] / 2, "w": size[0]}
    missing = [key for key in ("fl_x", "cx", "cy") if key not in values]
    if missing:
        raise ScanError(f"{where}: expected {missing[0]} at the top or in the frame, found none")
    width, height = values.get("w", size[0]), values.get("h", size[1])
    intrinsics = number_list(
        [values["fl_x"], values.get("fl_y", values["fl_x"]), values["cx"], values["cy"]], 4, where
    )
    intrinsics[2:] -= 0.5
    camera = make_camera(width, height, intrinsics.tolist(), where)
    is_fisheye = kind == "OPENCV_FISHEYE"
    keys = ("k1", "k2", "k3", "k4") if is_fisheye else ("k1", "k2", "p1", "p2", "k3")
    distortion = number_list([values.get(key, 0.0) for key in keys], len(keys), where)
    return Lens(camera, tuple(distortion.tolist()), is_fisheye)
