"""A scan with poses, and the points seen, in the forms of other programs: COLMAP model, nerfstudio, a ROS 2
bag (planfit[bag]), a recording of Rerun (planfit[rerun])."""

import json
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.spatial.transform import Rotation

from planfit.errors import OutputError
from planfit.export.cloud import Cloud, near_origin, place_cloud, write_ply
from planfit.floorplan.faces import connected_groups
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.matching.verify import MAX_REPROJECTION_PX
from planfit.runtime import Runtime
from planfit.scan import Scan
from planfit.scan.formats.colmap_model import ColmapCamera, ColmapImage, write_model
from planfit.scan.images.files import write_image
from planfit.scan.poses import from_opengl

COLOR_FOLDER, DEPTH_FOLDER = "images", "depth"
_SAME_KEYPOINT_M = 1e-4
"""Matches of one keypoint in several pairs hold the same point, up to how it is stored."""
_MAX_ERROR_PX = MAX_REPROJECTION_PX
"""Observations further off are left out, as COLMAP's filter does."""


@dataclass(frozen=True)
class _Observations:
    """Points in the target frame, and where each was seen."""

    points: Float[np.ndarray, "p 3"]
    error_px: Float[np.ndarray, " p"]
    """Mean distance between where a point was seen and where it projects to."""
    point_idx: Int[np.ndarray, " o"]
    """Of each observation, sorted by frame."""
    frame_idx: Int[np.ndarray, " o"]
    uv: Float[np.ndarray, "o 2"]
    """px; an integer is a pixel's centre."""


def write_colmap(
    folder: Path,
    scan: Scan,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    cloud: Cloud,
    runtime: Runtime,
    matches: Matches | None = None,
) -> None:
    """`sparse/0` (text), `images/`, and `depth/` in millimetres, in an empty folder.

    Images are undistorted and of the size that planfit works on, so cameras are PINHOLE. Points are those
    that `matches` make, with tracks, then `cloud`, which no image observes.

    Raises:
        OutputError: a frame has no colour.
        OSError: a file cannot be written.
    """
    id_of = {camera: i for i, camera in enumerate(dict.fromkeys(scan.cameras), start=1)}
    cameras = [
        ColmapCamera(
            number,
            "PINHOLE",
            camera.width,
            camera.height,
            (camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5),  # corners at 0
        )
        for camera, number in id_of.items()
    ]
    none = Matches.from_arrays(np.zeros((0, 2), int), np.zeros((0, 3)), np.zeros((0, 3)), 0.01)
    seen = observe(scan, target_from_cams, matches or none)
    span = np.searchsorted(seen.frame_idx, np.arange(len(scan) + 1))
    images = []
    for i, (camera, frame_id, pose) in enumerate(
        zip(scan.cameras, scan.frame_ids, target_from_cams, strict=True)
    ):
        if scan.lacking[i] == "colour":
            continue
        mine = slice(span[i], span[i + 1])
        uv, points = seen.uv[mine] + 0.5, seen.point_idx[mine] + 1
        images.append(ColmapImage(i + 1, id_of[camera], f"{frame_id}.jpg", pose, uv, points))
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    write_model(
        model,
        cameras,
        images,
        np.concatenate([seen.points, place_cloud(cloud, target_from_cams)]),
        np.concatenate([_colors(scan, seen), cloud.colors]),
        np.concatenate([seen.error_px, np.zeros(len(cloud.colors))]),
    )
    _write_images(folder, scan, runtime)


def _colors(scan: Scan, seen: _Observations) -> UInt8[np.ndarray, "p 3"]:
    """Of each point, in the last image that sees it."""
    colors = np.zeros((len(seen.points), 3), dtype=np.uint8)
    for i in np.unique(seen.frame_idx):
        mine = seen.frame_idx == i
        camera = scan.cameras[i]
        u, v = np.rint(seen.uv[mine]).astype(int).T
        image = _color(scan, int(i))
        colors[seen.point_idx[mine]] = image[
            v.clip(0, camera.height - 1), u.clip(0, camera.width - 1)
        ]
    return colors


def write_nerfstudio(
    folder: Path,
    scan: Scan,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    cloud: Cloud,
    runtime: Runtime,
) -> None:
    """`transforms.json`, `images/`, `depth/` in millimetres, and `sparse_pc.ply`, in an empty folder.

    Raises:
        OutputError: a frame has no colour.
        OSError: a file cannot be written.
    """
    frames = [
        {
            "file_path": f"{COLOR_FOLDER}/{frame_id}.jpg",
            "depth_file_path": f"{DEPTH_FOLDER}/{frame_id}.png",
            "w": camera.width,
            "h": camera.height,
            "fl_x": camera.fx,
            "fl_y": camera.fy,
            "cx": camera.cx + 0.5,
            "cy": camera.cy + 0.5,
            "transform_matrix": pose.tolist(),
        }
        for frame_id, camera, pose, lacks in zip(
            scan.frame_ids, scan.cameras, from_opengl(target_from_cams), scan.lacking, strict=True
        )
        if lacks != "colour"
    ]
    content = {"camera_model": "PINHOLE", "ply_file_path": "sparse_pc.ply", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content, indent=1) + "\n")
    write_ply(folder / "sparse_pc.ply", place_cloud(cloud, target_from_cams), cloud.colors)
    _write_images(folder, scan, runtime)


def _write_images(folder: Path, scan: Scan, runtime: Runtime) -> None:
    for name in (COLOR_FOLDER, DEPTH_FOLDER):
        (folder / name).mkdir()

    def one_frame(i: int) -> dict[str, np.ndarray]:
        name = scan.frame_ids[i]
        if scan.lacking[i] == "colour":
            return {}
        color = cv2.cvtColor(_color(scan, i), cv2.COLOR_RGB2BGR)
        quality = [cv2.IMWRITE_JPEG_QUALITY, 95]
        write_image(folder / COLOR_FOLDER / f"{name}.jpg", color, quality)
        millimetres = np.rint(np.nan_to_num(scan.files.depth(i), nan=0.0) * 1e3)
        # 65535 means no measurement in some programs.
        stored = np.where(millimetres < 65535, millimetres, 0).astype(np.uint16)
        write_image(folder / DEPTH_FOLDER / f"{name}.png", stored, [])
        return {}

    Runtime(runtime.workers, None, runtime.on_progress).map("images", "", len(scan), one_frame)


def _color(scan: Scan, frame_idx: int) -> UInt8[np.ndarray, "h w 3"]:
    image = scan.files.color(frame_idx)
    if image is None:
        raise OutputError(
            f"{scan.name}: frame {scan.frame_ids[frame_idx]}: expected a colour image, which "
            "COLMAP and nerfstudio need of each frame, found depth alone; export --to mesh or open3d"
        )
    return image


def observe(
    scan: Scan, target_from_cams: Float[np.ndarray, "n 4 4"], matches: Matches
) -> _Observations:
    """Keypoints that matches join are one point, at the mean of where depth puts it.

    A point that one image would see twice is none: a wrong match joined two. At least two images see each.
    """
    frames, points_cam, track = _tracks(matches)
    placed = np.zeros((len(frames), 3))
    uv = np.zeros((len(frames), 2))
    for i in np.unique(frames):
        mine = frames == i
        placed[mine] = se3.transform(target_from_cams[i], points_cam[mine])
        uv[mine] = scan.cameras[i].project(points_cam[mine])
    keep = _seen_once(frames, track)
    # Once more without what is too far off, whose points move.
    for _ in range(2):
        points, track_of_kept = _means(placed[keep], track[keep])
        error = _errors(scan, target_from_cams, frames[keep], uv[keep], points[track_of_kept])
        keep[np.flatnonzero(keep)[error > _MAX_ERROR_PX]] = False
        counts = np.bincount(track[keep], minlength=track.max(initial=0) + 1)
        keep &= counts[track] >= 2
    points, point_idx = _means(placed[keep], track[keep])
    error = _errors(scan, target_from_cams, frames[keep], uv[keep], points[point_idx])
    order = np.argsort(frames[keep], kind="stable")
    n_seen = np.bincount(point_idx, minlength=len(points))
    return _Observations(
        points,
        np.bincount(point_idx, error, len(points)) / np.maximum(n_seen, 1),
        point_idx[order],
        frames[keep][order],
        uv[keep][order],
    )


def _tracks(
    matches: Matches,
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k 3"], Int[np.ndarray, " k"]]:
    """Frame, point in its camera, and number of the track of each keypoint."""
    pair_of = np.repeat(np.arange(len(matches.pairs)), np.diff(matches.start))
    frames = matches.pairs[pair_of].T.ravel()  # all first frames, then all second ones
    points = np.concatenate([matches.points_a, matches.points_b]).astype(float)
    keys = np.column_stack([frames, np.rint(points / _SAME_KEYPOINT_M)]).astype(np.int64)
    _, first, keypoint = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    of_a, of_b = keypoint.reshape(2, -1)
    track = connected_groups(of_a, of_b, len(first))
    return frames[first].astype(int), points[first], track.astype(int)


def _seen_once(frames: Int[np.ndarray, " k"], track: Int[np.ndarray, " k"]) -> np.ndarray:
    """Whether the track of each keypoint has no two in one image."""
    _, inverse, counts = np.unique(
        np.column_stack([track, frames]), axis=0, return_inverse=True, return_counts=True
    )
    is_twice = np.zeros(track.max(initial=0) + 1, dtype=bool)
    is_twice[track[counts[inverse.ravel()] > 1]] = True
    return ~is_twice[track]


def _means(
    placed: Float[np.ndarray, "k 3"], track: Int[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, "p 3"], Int[np.ndarray, " k"]]:
    """Mean of each track's points, and which is whose."""
    names, point_idx = np.unique(track, return_inverse=True)
    point_idx = point_idx.ravel()
    counts = np.bincount(point_idx, minlength=len(names))[:, None]
    sums = [np.bincount(point_idx, placed[:, axis], len(names)) for axis in range(3)]
    return np.column_stack(sums) / counts, point_idx


def _errors(
    scan: Scan,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    frames: Int[np.ndarray, " k"],
    uv: Float[np.ndarray, "k 2"],
    points: Float[np.ndarray, "k 3"],
) -> Float[np.ndarray, " k"]:
    """px between where points were seen and where they project to; infinite behind the camera."""
    error = np.full(len(frames), np.inf)
    for i in np.unique(frames):
        mine = np.flatnonzero(frames == i)
        inside = se3.transform(se3.inverse(target_from_cams[i]), points[mine])
        ahead = inside[:, 2] > 0
        projected = scan.cameras[i].project(inside[ahead])
        error[mine[ahead]] = np.linalg.norm(projected - uv[mine[ahead]], axis=1)
    return error


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
