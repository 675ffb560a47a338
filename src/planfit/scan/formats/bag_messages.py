"""ROS messages of images and cameras as arrays and lenses, and which topics of a bag have them."""

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8

from planfit.errors import ScanError
from planfit.scan.images.decode import (
    decode_color,
    decode_image,
    decode_rvl,
    depth_from_inverse,
    depth_from_metres,
    depth_from_raw,
)
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.recording import Size
from planfit.scan.types import ScanOptions

# Bytes a channel, channels, and the conversion to RGB.
_COLORS: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "8uc3": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
    "8uc1": (1, cv2.COLOR_GRAY2RGB),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUYV),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
}
_DEPTHS = {"16uc1": np.uint16, "mono16": np.uint16, "32fc1": np.float32}
_PNG = b"\x89PNG\r\n\x1a\n"
_HEADER, _RVL_SIZE = struct.Struct("<i2f"), struct.Struct("<2I")
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (IMAGE, COMPRESSED)
INFO_TYPE = "sensor_msgs/msg/CameraInfo"
_POSE_TYPES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Path",
)
_REGISTERED = ("aligned", "registered", "depth_to_rgb", "depth_to_color", "rect", "raw")
"""In names of depth: what colour shows comes first."""
_NO_COLOR = ("depth", "infra", "/ir", "confidence", "disparity", "mask")
"""In names of images that are no colour."""
_TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


@dataclass(frozen=True)
class Topics:
    """Names of topics; empty where there is none."""

    color: str
    depth: str
    info: str
    depth_info: str
    pose: str
    """Of poses beside tf, or in its place."""


def color_of_message(message: Any, topic: str) -> UInt8[np.ndarray, "h w 3"]:
    """Colour image, RGB, of an Image or CompressedImage.

    Raises:
        ScanError: it is damaged or of an encoding that is not read.
    """
    if hasattr(message, "format"):
        return decode_color(bytes(message.data), Path(topic))
    encoding = message.encoding.lower()
    if encoding not in _COLORS:
        raise ScanError(
            f"{topic}: expected colour as {', '.join(_COLORS)}, found {message.encoding!r}; "
            "give another --color-topic"
        )
    channels, conversion = _COLORS[encoding]
    image = _rows(message, np.dtype(np.uint8), channels, topic)
    return np.array(image) if conversion is None else cv2.cvtColor(image, conversion)


def depth_of_message(
    message: Any, topic: str, metres_per_unit: float | None = None
) -> Float[np.ndarray, "h w"]:
    """Depth, float32 m, of an Image (16UC1 in millimetres, 32FC1 in metres) or a compressedDepth.

    Raises:
        ScanError: it is damaged or of an encoding that is not read.
    """
    if hasattr(message, "format"):
        return _compressed_depth(message, topic, metres_per_unit)
    kind = _DEPTHS.get(message.encoding.lower())
    if kind is None:
        raise ScanError(
            f"{topic}: expected depth as {', '.join(_DEPTHS)}, found {message.encoding!r}; "
            "give another --depth-topic"
        )
    raw = _rows(message, np.dtype(kind), 1, topic)
    if kind is np.float32:
        return depth_from_metres(raw * np.float32(metres_per_unit or 1.0))
    return depth_from_raw(np.ascontiguousarray(raw), metres_per_unit or 1e-3, Path(topic))


def _compressed_depth(
    message: Any, topic: str, metres_per_unit: float | None
) -> Float[np.ndarray, "h w"]:
    """Depth as compressed_depth_image_transport stores it: a header of a number and two quantities, then a
    PNG or RVL code of 16-bit millimetres, or (32FC1) of inverse depth in steps that the two give."""
    data, words = bytes(message.data), message.format.lower()
    start = data.find(_PNG, 0, 64)
    if start >= 0:
        raw = decode_image(data[start:], Path(topic), cv2.IMREAD_UNCHANGED)
    elif "rvl" in words and len(data) >= _HEADER.size + _RVL_SIZE.size:
        width, height = _RVL_SIZE.unpack_from(data, _HEADER.size)
        raw = decode_rvl(data[_HEADER.size + _RVL_SIZE.size :], width, height, Path(topic))
    else:
        raise ScanError(
            f"{topic}: expected compressed depth as PNG or RVL, found {message.format!r}; give another "
            "--depth-topic"
        )
    if "32fc1" not in words:
        return depth_from_raw(raw, metres_per_unit or 1e-3, Path(topic))
    _, a, b = _HEADER.unpack_from(data)
    return depth_from_inverse(raw, a, b) * np.float32(metres_per_unit or 1.0)


def _rows(
    message: Any, kind: np.dtype, channels: int, topic: str
) -> Shaped[np.ndarray, "h w *channels"]:
    """Pixels without the padding at the end of rows, in this machine's byte order."""
    width, height, step = message.width, message.height, message.step
    used = width * channels * kind.itemsize
    data = np.asarray(message.data, dtype=np.uint8)
    if step < used or data.size < step * height:
        raise ScanError(
            f"{topic}: expected {width} x {height} px in {step * height} bytes, found {data.size}"
        )
    stored = kind.newbyteorder(">" if message.is_bigendian else "<")
    rows = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :used])
    pixels = rows.view(stored).astype(kind.newbyteorder("="), copy=False)
    return pixels.reshape(height, width, channels) if channels > 1 else pixels


def camera_info_lens(message: Any, info: str, topic: str, size: Size) -> Lens:
    """Lens of the images (width, height) px of a topic; rectified images have the projection's intrinsics and
    no distortion.

    Raises:
        ScanError: the message has no usable intrinsics, or a distortion that is not known.
    """
    k, d, p = (getattr(message, n, getattr(message, n.upper(), None)) for n in ("k", "d", "p"))
    is_rectified = "rect" in topic.rsplit("/", 1)[-1] and p is not None and p[0] > 0
    # fx fy cx cy out of the projection (3, 4) or the matrix K (3, 3), both by row.
    values = (p[0], p[5], p[2], p[6]) if is_rectified else (k[0], k[4], k[2], k[5])  # type: ignore[index]
    camera = make_camera(message.width or size[0], message.height or size[1], values, info)
    if (camera.width, camera.height) != size:
        camera = camera.scaled(*size)
    if is_rectified or d is None or not np.any(d):
        return Lens(camera)
    model = message.distortion_model.lower()
    if model in ("plumb_bob", "rational_polynomial", "") and len(d) in (4, 5, 8):
        return Lens(camera, tuple(float(v) for v in d))
    if model in ("equidistant", "fisheye") and len(d) == 4:
        return Lens(camera, tuple(float(v) for v in d), is_fisheye=True)
    raise ScanError(
        f"{info}: expected distortion as plumb_bob, rational_polynomial or equidistant, found {model!r} "
        f"with {len(d)} numbers; give a rectified --color-topic"
    )


def choose_topics(path: Path, connections: Iterable[Any], options: ScanOptions) -> Topics:
    """Topics as the options name them, else the ones whose names fit best.

    Raises:
        ScanError: one that is needed is missing; it lists what the bag has.
    """
    types = {c.topic: _message_type(c.msgtype) for c in connections}
    images = [t for t, kind in types.items() if kind in IMAGE_TYPES]
    infos = [t for t, kind in types.items() if kind == INFO_TYPE]
    chosen = {
        "--color-topic": options.color_topic,
        "--depth-topic": options.depth_topic,
        "--intrinsics": "" if has_lens_file(options) else options.intrinsics,
        "--pose-topic": options.pose_topic,
    }
    for flag, topic in chosen.items():
        if topic and topic not in types:
            raise ScanError(f"{path}: expected the topic {topic} of {flag}, found {_list(types)}")
    depth = options.depth_topic or _best([t for t in images if _is_depth(t)], _REGISTERED)
    color = options.color_topic or _best(
        [
            t
            for t in images
            if not _is_depth(t) and not any(word in t.lower() for word in _NO_COLOR)
        ],
        ("color", "rgb", "rect", "raw"),
        beside=depth,
    )
    if not color or not depth:
        step = "name them with --color-topic and --depth-topic"
        if len(images) < 2:
            step = "record the camera's colour and depth images too"
        raise ScanError(
            f"{path}: expected image topics of colour and depth, found {_list(types)}; {step}"
        )
    info = chosen["--intrinsics"] or _info_beside(color, infos)
    if not info and not has_lens_file(options):
        raise ScanError(
            f"{path}: expected a CameraInfo topic beside {color}, found {_list(types)}; give the lens with "
            "--intrinsics, such a topic or a file (YAML of ROS or OpenCV, or fx fy cx cy)"
        )
    has_tf = any(kind in _TF_TYPES for kind in types.values())
    poses = [t for t, kind in types.items() if kind in _POSE_TYPES]
    pose = options.pose_topic or _best(poses, ("pose", "odom", "path"))
    if not pose and not has_tf and options.poses is None:
        raise ScanError(
            f"{path}: expected poses (tf, PoseStamped, Odometry or Path), found {_list(types)}; "
            "record them, or give another tracker's as TUM with --poses"
        )
    return Topics(color, depth, info, _info_beside(depth, infos), pose)


def has_lens_file(options: ScanOptions) -> bool:
    """Whether the lens comes from a file, and not from a topic."""
    return bool(options.intrinsics) and Path(options.intrinsics).is_file()


def _message_type(name: str) -> str:
    return name if "/msg/" in name else name.replace("/", "/msg/", 1)


def _is_depth(topic: str) -> bool:
    """By its name; DepthAI calls the depth of its cameras `stereo/image_raw`."""
    text = topic.lower()
    if any(word in text for word in ("rgb_to_depth", "color_to_depth")):
        return False  # colour, as the depth camera sees it
    return "depth" in text or re.search(r"/stereo/image_(raw|rect)", text) is not None


def _best(topics: list[str], words: tuple[str, ...], beside: str = "") -> str:
    """The topic that has the most of these words, earlier words first; of several cameras that which shares
    the most of its name with another topic; raw images before compressed ones."""

    def rank(topic: str) -> tuple[object, ...]:
        text = topic.lower()
        shared = len(set(text.split("/")) & set(beside.lower().split("/")))
        lacks = (word not in text for word in words)
        return (*lacks, -shared, "compressed" in text, len(text), text)

    return min(topics, key=rank, default="")


def _info_beside(topic: str, infos: list[str]) -> str:
    """The CameraInfo in the deepest namespace that holds the topic."""
    parts = topic.split("/")
    for length in range(len(parts) - 1, 0, -1):
        # librealsense's recorder has one folder more: Color_0/image/data, Color_0/info/camera_info.
        for end in (["camera_info"], ["info", "camera_info"]):
            if (name := "/".join([*parts[:length], *end])) in infos:
                return name
    return ""


def _list(types: dict[str, str]) -> str:
    return (
        ", ".join(f"{t} ({kind.split('/')[-1]})" for t, kind in sorted(types.items())) or "nothing"
    )
