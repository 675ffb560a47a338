"""Camera poses out of a bag: from tf, or from a topic of poses."""

from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.poses import ROUNDING, poses_at


@dataclass
class Edge:
    """Transforms from a frame to its parent over time."""

    parent: str
    is_static: bool
    times: list[float] = field(default_factory=list)
    parent_from_child: list[np.ndarray] = field(default_factory=list)

    def at(
        self, times: Float[np.ndarray, " k"], max_gap_s: float
    ) -> tuple[Float[np.ndarray, "k 4 4"], Bool[np.ndarray, " k"]]:
        """Transforms at times, and which are known."""
        if self.is_static:
            poses = np.repeat(self.parent_from_child[-1][None], len(times), axis=0)
            return poses, np.ones(len(times), dtype=bool)
        return poses_at(np.array(self.times), np.array(self.parent_from_child), times, max_gap_s)


Transforms = dict[str, Edge]
"""Edges by child frame."""


def poses_of_bag(
    path: Path,
    reader: Any,
    tree: Transforms,
    topic: str,
    is_topic_asked_for: bool,
    camera_frame: str,
    times: Float[np.ndarray, " k"],
    max_gap_s: float,
) -> tuple[Float[np.ndarray, "k 4 4"], Bool[np.ndarray, " k"], list[str]]:
    """world_from_cams at times, which are known, and warnings: by tf where that moves and no topic is asked
    for, else by the topic.

    Raises:
        ScanError: nothing is known at any of the times.
    """
    camera = camera_frame.lstrip("/")
    edges = _chain(tree, camera, None) or []
    warnings: list[str] = []
    if not is_topic_asked_for and not all(edge.is_static for edge in edges):
        poses, known = _along(edges, times, max_gap_s)
    elif topic:
        if tree and not is_topic_asked_for:
            why = "is static" if edges else f"does not lead to {camera or 'the camera'}"
            warnings.append(
                f"poses are those of {topic}, as tf {why}{_lacking(tree)}; --pose-topic says otherwise"
            )
        poses, known, more = _of_topic(path, reader, tree, topic, camera, times, max_gap_s)
        warnings += more
    else:
        raise ScanError(
            f"{path}: expected tf from {camera or 'the camera'} to a world that it moves in, found "
            f"{', '.join(sorted(tree)) or 'no transforms'}{_lacking(tree)}; record /tf_static or poses of "
            "the camera too, name a topic with --pose-topic, or give another tracker's poses with --poses"
        )
    if not known.any():
        raise ScanError(
            f"{path}: expected poses within {max_gap_s:g} s of colour images ({times.min():.3f} to "
            f"{times.max():.3f} s), found none; give --max-time-gap-s or another --pose-topic"
        )
    return poses, known, warnings


def _lacking(tree: Transforms) -> str:
    """What was not recorded of tf, in words."""
    return "" if any(edge.is_static for edge in tree.values()) else " (no /tf_static was recorded)"


def _of_topic(
    path: Path,
    reader: Any,
    tree: Transforms,
    topic: str,
    camera: str,
    times: Float[np.ndarray, " k"],
    max_gap_s: float,
) -> tuple[Float[np.ndarray, "k 4 4"], Bool[np.ndarray, " k"], list[str]]:
    edge, child = _read_topic(reader, topic)
    if not edge.times:
        raise ScanError(f"{path}: expected poses on {topic}, found none")
    poses, known = edge.at(times, max_gap_s)
    warnings = []
    found = _chain(tree, camera, child or None)
    if not child and found and all(edge.is_static for edge in found):
        # Poses in ROS are those of a body, of which the camera is a part.
        child = found[-1].parent
        warnings.append(
            f"poses of {topic}, which do not say of what they are, are taken for those of {child}"
        )
    elif not child:
        found = None
    if child and child != camera and found is not None:
        steps, ok = _along(found, times, max_gap_s)
        poses, known = poses @ steps, known & ok
    elif child != camera:
        warnings.append(f"poses of {topic} ({child or 'no frame'}) are taken for those of {camera}")
    return poses, known, warnings


def read_tf(reader: Any) -> Transforms:
    """All transforms of a bag."""
    tree: Transforms = {}
    connections = [
        c for c in reader.connections if c.msgtype.endswith(("/TFMessage", "/tfMessage"))
    ]
    if not connections:
        return tree
    for connection, _, data in reader.messages(connections):
        message = reader.deserialize(data, connection.msgtype)
        for item in message.transforms:
            child = item.child_frame_id.lstrip("/")
            parent = item.header.frame_id.lstrip("/")
            edge = tree.setdefault(child, Edge(parent, connection.topic.endswith("tf_static")))
            if edge.parent != parent:
                continue  # two nodes quarrel over a frame; the first one's word stands
            edge.times.append(seconds(item.header.stamp))
            edge.parent_from_child.append(
                _transform(item.transform.translation, item.transform.rotation)
            )
    return tree


def fixed_transform(
    tree: Transforms, to_frame: str, from_frame: str
) -> Float[np.ndarray, "4 4"] | None:
    """From the axes of one frame to those of another on the same body; None where no static tf joins them."""
    # Climb from each frame as far as edges are static: both must end at the same part of the body.
    roots, root_from_frames = [], []
    for frame in (to_frame.lstrip("/"), from_frame.lstrip("/")):
        edges = list(takewhile(lambda edge: edge.is_static, _chain(tree, frame, None) or []))
        roots.append(edges[-1].parent if edges else frame)
        root_from_frame, _ = _along(edges, np.zeros(1), 0.0)  # at any time
        root_from_frames.append(root_from_frame[0])
    if roots[0] != roots[1]:
        return None
    return se3.inverse(root_from_frames[0]) @ root_from_frames[1]


def _chain(tree: Transforms, start: str, end: str | None) -> list[Edge] | None:
    """Edges from a frame up to `end`, or to the root; None where they do not lead there."""
    edges, at, seen = [], start, {start}
    while at != end and at in tree:
        edges.append(tree[at])
        at = tree[at].parent
        if at in seen:
            return None
        seen.add(at)
    return edges if end is None or at == end else None


def _along(
    edges: list[Edge], times: Float[np.ndarray, " k"], max_gap_s: float
) -> tuple[Float[np.ndarray, "k 4 4"], Bool[np.ndarray, " k"]]:
    """Product of the edges from a frame up, at each time, and where all of them are known."""
    poses = np.repeat(np.eye(4)[None], len(times), axis=0)
    known = np.ones(len(times), dtype=bool)
    for edge in edges:
        step, ok = edge.at(times, max_gap_s)
        poses, known = step @ poses, known & ok
    return poses, known


def _read_topic(reader: Any, topic: str) -> tuple[Edge, str]:
    """Poses of a topic, and the frame that they are of ("" where the messages do not say)."""
    edge, child = Edge("", False), ""
    for connection, _, data in reader.messages([c for c in reader.connections if c.topic == topic]):
        message = reader.deserialize(data, connection.msgtype)
        child = getattr(message, "child_frame_id", child).lstrip("/")
        if connection.msgtype.endswith("/Path"):
            items = [(p.header.stamp, p.pose) for p in message.poses]
            edge = Edge("", False)  # each message repeats the path so far
        else:
            pose = getattr(message, "pose", None) or message.transform
            items = [(message.header.stamp, getattr(pose, "pose", pose))]
        for stamp, pose in items:
            edge.times.append(seconds(stamp))
            translation = pose.position if hasattr(pose, "position") else pose.translation
            rotation = pose.orientation if hasattr(pose, "orientation") else pose.rotation
            edge.parent_from_child.append(_transform(translation, rotation))
    return edge, child


def seconds(stamp: Any) -> float:
    """Of a time of ROS."""
    return stamp.sec + stamp.nanosec * 1e-9


def _transform(translation: Any, rotation: Any) -> Float[np.ndarray, "4 4"]:
    quaternion = np.array([rotation.x, rotation.y, rotation.z, rotation.w])
    if np.linalg.norm(quaternion) < ROUNDING:
        quaternion = np.array([0.0, 0.0, 0.0, 1.0])  # never set by its sender
    return se3.make_transform(
        Rotation.from_quat(quaternion).as_matrix(),
        np.array([translation.x, translation.y, translation.z]),
    )
