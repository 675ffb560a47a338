"""Refined poses as messages in time: a ROS 2 bag (planfit[bag]), a recording of Rerun (planfit[rerun])."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from planfit.errors import OutputError
from planfit.export.cloud import Cloud, near_origin, place_cloud
from planfit.scan import Scan

CAMERA_FRAME = "camera_optical_frame"
"""Of ROS: x right, y down, z ahead, as REP 103 has the suffix."""


def write_rosbag(
    folder: Path, scan: Scan, target_from_cams: Float[np.ndarray, "n 4 4"], frame: str
) -> None:
    """Poses on `/tf` at the times of the frames, and all of them on `/path` at the first, in an empty folder.

    Raises:
        OutputError: the library rosbags is missing.
    """
    rosbag2, typesys = (_library(f"rosbags.{name}", "bag") for name in ("rosbag2", "typesys"))
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)

    def make(name: str, *values: Any) -> Any:
        return store.types[name](*values)

    stamps_ns = [round(float(time) * 1e9) for time in scan.timestamps]
    headers = [
        make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", *divmod(ns, 10**9)), frame)
        for ns in stamps_ns
    ]
    turns = [
        make("geometry_msgs/msg/Quaternion", *xyzw)
        for xyzw in Rotation.from_matrix(target_from_cams[:, :3, :3]).as_quat(canonical=True)
    ]
    moved, posed = [], []
    for header, turn, at in zip(headers, turns, target_from_cams[:, :3, 3], strict=True):
        motion = make("geometry_msgs/msg/Transform", make("geometry_msgs/msg/Vector3", *at), turn)
        moved.append(make("geometry_msgs/msg/TransformStamped", header, CAMERA_FRAME, motion))
        pose = make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", *at), turn)
        posed.append(make("geometry_msgs/msg/PoseStamped", header, pose))
    tf, path = "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Path"
    inside = folder / "poses"  # the library makes the folder, and calls the file by its name
    with rosbag2.Writer(inside, version=9) as writer:
        on_path = writer.add_connection("/path", path, typestore=store)
        message = make(path, headers[0], posed)
        writer.write(on_path, stamps_ns[0], store.serialize_cdr(message, path))
        on_tf = writer.add_connection("/tf", tf, typestore=store)
        for ns, one in zip(stamps_ns, moved, strict=True):
            writer.write(on_tf, ns, store.serialize_cdr(make(tf, [one]), tf))
    for file in inside.iterdir():
        file.rename(folder / file.name)
    inside.rmdir()


def write_rerun(
    file: Path,
    scan: Scan,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    cloud: Cloud,
    frame: str,
) -> None:
    """Cameras by time and by number of their frame, their path, and the cloud, below an entity of the frame's
    name.

    Raises:
        OutputError: the library is missing, or positions need more than its single precision.
    """
    rerun = _library("rerun", "rerun")
    points = place_cloud(cloud, target_from_cams)
    if near_origin(target_from_cams[:, :3, 3]).any():
        raise OutputError(
            f"{scan.name}: expected places near the origin, as Rerun keeps them in single precision, found "
            f"coordinates up to {np.abs(target_from_cams[:, :3, 3]).max():.0f}; take frame plan"
        )
    stream = rerun.RecordingStream("planfit")
    stream.save(str(file))
    if frame != "world":  # whose up anyone may choose
        stream.log(frame, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log(f"{frame}/points", rerun.Points3D(points, colors=cloud.colors), static=True)
    stream.log(f"{frame}/path", rerun.LineStrips3D([target_from_cams[:, :3, 3]]), static=True)
    quaternions = Rotation.from_matrix(target_from_cams[:, :3, :3]).as_quat(canonical=True)
    for i, (camera, pose) in enumerate(zip(scan.cameras, target_from_cams, strict=True)):
        stream.set_time("frame", sequence=i)
        stream.set_time("time", timestamp=float(scan.timestamps[i]))
        placed = rerun.Transform3D(translation=pose[:3, 3], quaternion=quaternions[i])
        stream.log(f"{frame}/camera", placed)
        if i == 0 or camera != scan.cameras[i - 1]:
            lens = rerun.Pinhole(
                focal_length=[camera.fx, camera.fy],
                principal_point=[camera.cx + 0.5, camera.cy + 0.5],  # corners at 0
                resolution=[camera.width, camera.height],
            )
            stream.log(f"{frame}/camera", lens)
    stream.disconnect()


def _library(name: str, extra: str) -> Any:
    """A library of an extra.

    Raises:
        OutputError: it is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise OutputError(
            f"export: expected the library {name.split('.')[0]}, found none ({error}); pip install "
            f"'planfit[{extra}]'"
        ) from error
