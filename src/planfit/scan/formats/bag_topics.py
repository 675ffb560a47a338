"""Which topics of a bag hold colour, depth, intrinsics and poses."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planfit.errors import ScanError
from planfit.scan.types import ScanOptions

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (IMAGE, COMPRESSED)
INFO_TYPE = "sensor_msgs/msg/CameraInfo"
POSE_TYPES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Path",
)
REGISTERED = ("aligned", "registered", "depth_to_rgb", "depth_to_color", "rect", "raw")
"""In names of depth: what colour shows comes first."""
NO_COLOR = ("depth", "infra", "/ir", "confidence", "disparity", "mask")
"""In names of images that are no colour."""
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


@dataclass(frozen=True)
class Topics:
    """Names of topics; empty where there is none."""

    color: str
    depth: str
    info: str
    depth_info: str
    pose: str
    """Of poses beside tf, or in its place."""


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
    depth = options.depth_topic or _best([t for t in images if _is_depth(t)], REGISTERED)
    color = options.color_topic or _best(
        [t for t in images if not _is_depth(t) and not any(word in t.lower() for word in NO_COLOR)],
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
    has_tf = any(kind in TF_TYPES for kind in types.values())
    poses = [t for t, kind in types.items() if kind in POSE_TYPES]
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
