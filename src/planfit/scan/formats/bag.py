"""ROS 1 and 2 bags and MCAP files, by the library rosbags (planfit[bag]).

Topics are named by the options, or guessed: colour and depth images (raw, compressed or compressedDepth),
the colour camera's CameraInfo, and poses from tf (the chain from the camera's frame up), else from
PoseStamped, Odometry, TransformStamped or the last Path. Times are those of the messages' headers. Depth
that is not registered to colour is, by the static tf between the two cameras. Refined poses are written as
`trajectory.tum`, world_from_cam: a bag is not rewritten.
"""

import weakref
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from planfit.errors import ScanError
from planfit.scan.association import pair_times
from planfit.scan.formats.bag_messages import camera_info_lens, color_of_message, depth_of_message
from planfit.scan.formats.bag_poses import fixed_transform, poses_of_bag, read_tf
from planfit.scan.formats.bag_topics import IMAGE_TYPES, choose_topics
from planfit.scan.frames import Recording, scan_from
from planfit.scan.images.lens import Lens
from planfit.scan.options import ScanOptions
from planfit.scan.source import FolderSource, fingerprint
from planfit.scan.trajectory import write_tum
from planfit.scan.types import Scan

LOOKS_FOR = "a .bag, .mcap or .db3 file, or a ROS 2 bag's folder with metadata.yaml"
SUFFIXES = (".bag", ".mcap", ".db3")


@dataclass(frozen=True)
class BagSource:
    """A bag, which its own library reads."""

    path: Path


def is_bag(path: Path) -> bool:
    """Whether this is a bag, by its name or by what lies in the folder."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() and any(
            item.suffix in (".db3", ".mcap", ".zstd") for item in path.iterdir()
        )
    return path.suffix.lower() in SUFFIXES


def recognise(source: BagSource) -> bool:
    """Whether this is a bag."""
    return is_bag(source.path)


@dataclass(frozen=True)
class Stamp:
    """A message: when it was made, and where in the bag it lies."""

    time: float  # s, of its header
    log_ns: int
    connection: Any


class BagImages:
    """Images of a bag, looked up by the time they were logged; safe to use from several threads."""

    def __init__(
        self, reader: Any, colors: list[Stamp], depths: list[Stamp], metres_per_unit: float | None
    ) -> None:
        self._reader, self._colors, self._depths = reader, colors, depths
        self._metres_per_unit = metres_per_unit
        self._lock = Lock()
        weakref.finalize(self, reader.close)

    def color(self, frame_idx: int) -> np.ndarray:
        """(h, w, 3) uint8, RGB."""
        stamp = self._colors[frame_idx]
        return color_of_message(self._message(stamp), stamp.connection.topic)

    def depth(self, frame_idx: int) -> np.ndarray:
        """(h, w) float32 m."""
        stamp = self._depths[frame_idx]
        return depth_of_message(self._message(stamp), stamp.connection.topic, self._metres_per_unit)

    def _message(self, stamp: Stamp) -> Any:
        with self._lock:
            found = self._reader.messages([stamp.connection], stamp.log_ns, stamp.log_ns + 1)
            for connection, _, data in found:
                message = self._reader.deserialize(data, connection.msgtype)
                if header_time(message) == stamp.time:
                    return message
        raise ScanError(
            f"{stamp.connection.topic}: expected a message at {stamp.time:.6f} s, found none; "
            "is the bag being written?"
        )


def header_time(message: Any) -> float:
    """Seconds of a message's header."""
    stamp = message.header.stamp
    return stamp.sec + stamp.nanosec * 1e-9


def read(source: BagSource, options: ScanOptions) -> Scan:
    """Read a scan.

    Raises:
        ScanError: topics are missing, or their times never match.
    """
    path = source.path
    reader = _open(path)
    try:
        return _read(path, reader, options)
    except BaseException:
        reader.close()
        raise


def _read(path: Path, reader: Any, options: ScanOptions) -> Scan:
    topics = choose_topics(path, reader.connections, options)
    stamps: dict[str, list[Stamp]] = {topics.color: [], topics.depth: []}
    first: dict[str, Any] = {}
    wanted = {topics.color, topics.depth, topics.info, topics.depth_info} - {""}
    for connection, log_ns, data in reader.messages(
        [c for c in reader.connections if c.topic in wanted]
    ):
        if connection.topic not in stamps and connection.topic in first:
            continue
        message = reader.deserialize(data, connection.msgtype)
        first.setdefault(connection.topic, message)
        if connection.msgtype in IMAGE_TYPES:
            stamps[connection.topic].append(Stamp(header_time(message), log_ns, connection))
    for topic in wanted:
        if topic not in first:
            raise ScanError(f"{path}: expected messages on {topic}, found none; record it, or choose "
                            "another topic")  # fmt: skip
    colors, depths = (sorted(stamps[t], key=lambda s: s.time) for t in (topics.color, topics.depth))
    color_times, depth_times = (np.array([s.time for s in group]) for group in (colors, depths))
    mine, other = pair_times(color_times, depth_times, options.max_time_gap_s)
    if not len(mine):
        raise ScanError(
            f"{path}: expected depth within {options.max_time_gap_s:g} s of colour ({color_times.min():.3f} "
            f"to {color_times.max():.3f} s), found {depth_times.min():.3f} to {depth_times.max():.3f}; "
            "give another topic or --max-time-gap-s"
        )
    camera_frame = first[topics.color].header.frame_id
    tree = read_tf(reader)
    poses, known, warnings = poses_of_bag(
        path, reader, tree, topics.pose, camera_frame, color_times[mine], options.max_time_gap_s
    )
    skipped = [
        f"frame at {color_times[i]:.6f} s: no depth within {options.max_time_gap_s:g} s"
        for i in np.setdiff1d(np.arange(len(colors)), mine)
    ] + [f"frame at {t:.6f} s: no pose" for t in color_times[mine[~known]]]
    depth_frame = first[topics.depth].header.frame_id
    is_registered = any(word in topics.depth for word in ("aligned", "registered"))
    color_from_depth = None
    if depth_frame != camera_frame and not is_registered:
        has_own_info = topics.depth_info not in ("", topics.info)
        if has_own_info:
            color_from_depth = fixed_transform(tree, camera_frame, depth_frame)
        if color_from_depth is None:
            lack = (
                "no static tf joins them" if has_own_info else "depth has no CameraInfo of its own"
            )
            warnings.append(
                f"depth is in the frame {depth_frame}, colour in {camera_frame}, and {lack}: it is taken as "
                "registered to colour; give --depth-topic where the bag has registered depth"
            )
    mine, other, poses = mine[known], other[known], poses[known]
    times = color_times[mine]
    images = BagImages(
        reader, [colors[i] for i in mine], [depths[i] for i in other], options.depth_scale
    )
    color_size, depth_size = (
        read_image(first[topic], topic).shape[1::-1]
        for read_image, topic in (
            (color_of_message, topics.color),
            (depth_of_message, topics.depth),
        )
    )
    lens = camera_info_lens(first[topics.info], topics.info, topics.color, color_size)
    depth_lens = _depth_lens(
        first, topics.depth_info, topics.depth, lens, depth_size, is_registered
    )

    def write_poses(directory: Path, frame_idx: np.ndarray, refined: np.ndarray) -> None:
        write_tum(directory / "trajectory.tum", times[frame_idx], refined)

    n = len(mine)
    recording = Recording(
        frame_ids=[f"{time:.6f}" for time in times],
        times=times,
        world_from_cams=poses,
        images=images,
        color_lenses=(lens,) * n,
        depth_lenses=(depth_lens,) * n,
        write_poses=write_poses,
        fingerprint=_fingerprint(path, options),
        skipped=skipped,
        warnings=warnings,
        color_from_depth=color_from_depth,
    )
    return scan_from(path, "bag", recording, options)


def _depth_lens(
    first: dict[str, Any],
    info: str,
    topic: str,
    color: Lens,
    size: tuple[int, int],
    is_registered: bool,
) -> Lens:
    if info and not is_registered:
        return camera_info_lens(first[info], info, topic, size)
    return color.scaled(*size)


def _open(path: Path) -> Any:
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ScanError(
            f"{path}: expected the library rosbags for bags, found none; install planfit[bag]"
        ) from error
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except (AnyReaderError, OSError, ValueError) as error:
        raise ScanError(
            f"{path}: expected a bag, found one that cannot be read ({error}); "
            "was the recording cut off? Try rosbag reindex or ros2 bag reindex"
        ) from error
    return reader


def _fingerprint(path: Path, options: ScanOptions) -> str:
    if path.is_dir():
        folder = FolderSource(path)
        return fingerprint(folder, folder.names(), options)
    return fingerprint(FolderSource(path.parent), [path.name], options)
