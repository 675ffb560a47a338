"""From a bag to a `Recording`: colour messages, the depth and the pose that belong to each by time."""

import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import ScanError, each_told_as, told_as
from planfit.scan.formats.bag_messages import (
    IMAGE_TYPES,
    Topics,
    camera_info_lens,
    choose_topics,
    color_of_message,
    depth_of_message,
    has_lens_file,
)
from planfit.scan.formats.bag_poses import (
    Transforms,
    fixed_transform,
    poses_of_bag,
    read_tf,
    seconds,
)
from planfit.scan.images.lens import Lens
from planfit.scan.layout import WholeFile
from planfit.scan.lens_file import read_lens
from planfit.scan.poses import join_times
from planfit.scan.recording import (
    Frame,
    LensOfFrame,
    Recording,
    Size,
    StoredImages,
    write_trajectory,
)
from planfit.scan.source import FolderSource, fingerprint
from planfit.scan.timed_lists import image_lacked
from planfit.scan.types import ScanOptions

EXPECTED = "a bag"


def _is_bag_folder(path: Path) -> bool:
    """Whether ROS 2 recorded into a folder."""
    return (path / "metadata.yaml").is_file() and any(
        item.suffix in (".db3", ".mcap", ".zstd") for item in path.iterdir()
    )


@dataclass(frozen=True)
class Stamp:
    """A message: when it was made, and where in the bag it lies."""

    time: float
    """s, of its header."""
    log_ns: int
    connection: Any


@dataclass(frozen=True)
class TopicMessages:
    """What one pass over the messages of the chosen topics finds."""

    first: dict[str, Any]
    """The first message of each topic."""
    colors: list[Stamp]
    """In the order of their times."""
    depths: list[Stamp]


class BagImages(StoredImages):
    """`StoredImages` of a bag, looked up by the time they were logged; safe to use from several threads.

    A frame's colour and depth are named by the numbers of their messages in the listing.
    """

    def __init__(
        self,
        reader: Any,
        listing: TopicMessages,
        sizes: tuple[Size, Size],
        metres_per_unit: float | None,
    ) -> None:
        self._reader, self._listing, self._sizes = reader, listing, sizes
        self._metres_per_unit = metres_per_unit
        self._lock = Lock()
        weakref.finalize(self, reader.close)

    def sizes(self, frame: Frame) -> tuple[Size, Size]:  # noqa: ARG002
        """Of the first images: the sizes of the others are checked when they are decoded."""
        return self._sizes

    def color(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB."""
        stamp = self._listing.colors[int(frame.color)]
        return color_of_message(self._message(stamp), stamp.connection.topic)

    def depth(self, frame: Frame) -> Float[np.ndarray, "h w"]:
        """float32 m, NaN where nothing was measured."""
        stamp = self._listing.depths[int(frame.depth)]
        return depth_of_message(self._message(stamp), stamp.connection.topic, self._metres_per_unit)

    def _message(self, stamp: Stamp) -> Any:
        with self._lock:
            found = self._reader.messages([stamp.connection], stamp.log_ns, stamp.log_ns + 1)
            for connection, _, data in found:
                message = self._reader.deserialize(data, connection.msgtype)
                if seconds(message.header.stamp) == stamp.time:
                    return message
        raise ScanError(
            f"{stamp.connection.topic}: expected a message at {stamp.time:.6f} s, found none; "
            "is the bag being written?"
        )


def read(path: Path, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: topics are missing, or their times never match.
    """
    reader = open_bag(path)
    try:
        return _read(path, reader, options)
    except BaseException:
        reader.close()
        raise


def _read(path: Path, reader: Any, options: ScanOptions) -> Recording:
    topics = choose_topics(path, reader.connections, options)
    listing = _list_messages(path, reader, topics)
    mine, depth, times = _pair(path, listing, options.max_time_gap_s)
    camera_frame = listing.first[topics.color].header.frame_id
    tree = read_tf(reader)
    if options.poses is None:
        poses, known, warnings = poses_of_bag(
            path, reader, tree, topics.pose, bool(options.pose_topic), camera_frame, times,
            options.max_time_gap_s,
        )  # fmt: skip
    else:  # others take their place: a bag of a camera alone (RealSense, Azure Kinect) has none
        poses, known = np.tile(np.eye(4), (len(times), 1, 1)), np.ones(len(times), dtype=bool)
        warnings = []
    color_from_depth, mount_warnings = _mount_of_depth(listing.first, topics, tree)
    sizes = (
        _size(color_of_message(listing.first[topics.color], topics.color)),
        _size(depth_of_message(listing.first[topics.depth], topics.depth)),
    )
    color_lens, depth_lens = _lenses(listing.first, topics, sizes, options)
    return Recording(
        format="bag",
        path=path,
        frames=[
            Frame(
                f"{time:.6f}",
                float(time),
                pose,
                str(i) if i >= 0 else "",
                str(j) if j >= 0 else "",
                lacks=image_lacked(i, j),
            )
            for time, pose, i, j in zip(
                times[known], poses[known], mine[known], depth[known], strict=True
            )
        ],
        images=BagImages(reader, listing, sizes, options.depth_scale),
        color_lens=color_lens,
        depth_lens=depth_lens,
        color_from_depth=color_from_depth,
        write_poses=write_trajectory,
        fingerprint=_fingerprint(path, options),
        skipped=[f"frame at {time:.6f} s: no pose" for time in times[~known]],
        warnings=[*warnings, *mount_warnings],
    )


def _list_messages(path: Path, reader: Any, topics: Topics) -> TopicMessages:
    stamps: dict[str, list[Stamp]] = {topics.color: [], topics.depth: []}
    first: dict[str, Any] = {}
    wanted = {topics.color, topics.depth, topics.info, topics.depth_info} - {""}
    for connection, log_ns, data in reader.messages(
        [c for c in reader.connections if c.topic in wanted]
    ):
        if connection.topic not in stamps and connection.topic in first:
            continue  # of CameraInfo, the first is enough
        message = reader.deserialize(data, connection.msgtype)
        first.setdefault(connection.topic, message)
        if connection.msgtype in IMAGE_TYPES:
            stamps[connection.topic].append(
                Stamp(seconds(message.header.stamp), log_ns, connection)
            )
    for topic in wanted:
        if topic not in first:
            raise ScanError(
                f"{path}: expected messages on {topic}, found none; record it, or choose another topic"
            )
    colors, depths = (sorted(stamps[t], key=lambda s: s.time) for t in (topics.color, topics.depth))
    return TopicMessages(first, colors, depths)


def _pair(
    path: Path, listing: TopicMessages, max_gap_s: float
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Numbers of colour and of depth messages of each frame, -1 where it has none, and its time (s)."""
    color_times, depth_times = (
        np.array([stamp.time for stamp in stamps]) for stamps in (listing.colors, listing.depths)
    )
    mine, depth, times = join_times(color_times, depth_times, max_gap_s)
    if not ((mine >= 0) & (depth >= 0)).any():
        raise ScanError(
            f"{path}: expected depth within {max_gap_s:g} s of colour ({color_times.min():.3f} "
            f"to {color_times.max():.3f} s), found {depth_times.min():.3f} to {depth_times.max():.3f}; "
            "give another topic or --max-time-gap-s"
        )
    return mine, depth, times


def _is_registered(topics: Topics) -> bool:
    return any(word in topics.depth for word in ("aligned", "registered"))


def _mount_of_depth(
    first: dict[str, Any], topics: Topics, tree: Transforms
) -> tuple[Float[np.ndarray, "4 4"] | None, list[str]]:
    """From the depth camera to the colour camera, where depth is a camera of its own, and warnings."""
    color_frame = first[topics.color].header.frame_id
    depth_frame = first[topics.depth].header.frame_id
    if depth_frame == color_frame or _is_registered(topics):
        return None, []
    has_own_info = topics.depth_info not in ("", topics.info)
    if has_own_info:
        color_from_depth = fixed_transform(tree, color_frame, depth_frame)
        if color_from_depth is not None:
            return color_from_depth, []
    lack = "no static tf joins them" if has_own_info else "depth has no CameraInfo of its own"
    return None, [
        f"depth is in the frame {depth_frame}, colour in {color_frame}, and {lack}: it is taken as "
        "registered to colour; give --depth-topic where the bag has registered depth"
    ]


def _size(image: np.ndarray) -> Size:
    return image.shape[1], image.shape[0]


def _lenses(
    first: dict[str, Any], topics: Topics, sizes: tuple[Size, Size], options: ScanOptions
) -> tuple[LensOfFrame, LensOfFrame]:
    """Of colour and depth; registered depth, or depth without a CameraInfo, shows what the colour shows."""
    if has_lens_file(options):
        color = read_lens(Path(options.intrinsics))
    else:
        lens = camera_info_lens(first[topics.info], topics.info, topics.color, sizes[0])
        color = _always(lens)
    if not topics.depth_info or _is_registered(topics):
        return color, lambda frame, _: color(frame, sizes[0]).scaled(*sizes[1])
    info = first[topics.depth_info]
    return color, _always(camera_info_lens(info, topics.depth_info, topics.depth, sizes[1]))


def _always(lens: Lens) -> LensOfFrame:
    return lambda *_: lens


class BagReader:
    """The library's reader, open: whatever it raises over a damaged bag is told as an error of the file."""

    def __init__(self, path: Path, reader: Any) -> None:
        self._path, self._reader = path, reader

    @property
    def connections(self) -> list[Any]:
        """Topics and their types."""
        return self._reader.connections

    def messages(
        self, connections: Sequence[Any], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Any]:
        """Connection, time of logging (ns) and data of each message."""
        found = self._reader.messages(connections, start_ns, stop_ns)
        return each_told_as(ScanError, self._path, EXPECTED, found)

    def deserialize(self, data: Any, msgtype: str) -> Any:
        """The message."""
        with told_as(ScanError, self._path, EXPECTED):
            return self._reader.deserialize(data, msgtype)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def open_bag(path: Path) -> BagReader:
    """The reader of a bag, open.

    Raises:
        ScanError: it cannot be read, or the library is missing.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ScanError(
            f"{path}: expected the library rosbags for bags, found none; pip install 'planfit[bag]'"
        ) from error
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except Exception as error:  # each kind of bag has errors of its own
        raise ScanError(
            f"{path}: expected a bag, found one that cannot be read ({error}); "
            "was the recording cut off? Try rosbag reindex or ros2 bag reindex"
        ) from error
    return BagReader(path, reader)


def _fingerprint(path: Path, options: ScanOptions) -> str:
    if path.is_dir():
        folder = FolderSource(path)
        return fingerprint(folder, folder.names(), options)
    return fingerprint(FolderSource(path.parent), [path.name], options)


BAG = WholeFile(
    name="bag",
    page="""ROS 1 and 2 bags and MCAP files, by the library rosbags (planfit[bag]).

Topics are named by the options, or guessed: colour and depth images (raw, compressed or compressedDepth),
the colour camera's CameraInfo (or a file, `--intrinsics`), and poses from tf (the chain from the camera's
frame up); where that has no motion, from PoseStamped, Odometry, TransformStamped or the last Path. Times
are those of the messages' headers; colour without depth of its time, and depth without colour, are frames.
Depth that is not registered to colour is, by the static tf between the
two cameras. Refined poses are written as `trajectory.tum`, world_from_cam: a bag is not rewritten.
""",
    expects="a .bag, .mcap or .db3 file, or a ROS 2 bag's folder with metadata.yaml",
    checked=(
        "ROS 1, ROS 2 and MCAP files of evo's tests, without images; names of librealsense's "
        "recorder; compressed_depth_image_transport's codes",
        "tf of the real files; images of all codes by bags that rosbags writes",
    ),
    suffixes=(".bag", ".mcap", ".db3"),
    claims_folder=_is_bag_folder,
    open=lambda path: path,
    read=read,
)
