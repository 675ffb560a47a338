"""From a database to a `Recording`, and refined poses into a copy of it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.formats.rtabmap_source import (
    N_POSE,
    DatabaseSource,
    StoredCamera,
    decode_stored_depth,
    depth_size,
    pack_matrix,
    parse_camera,
    parse_matrix,
    parse_pose,
)
from planfit.scan.images.files import ImageFiles, whole_image_size
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.layout import WholeFile
from planfit.scan.poses import check_recorded_pose, followed, is_lost
from planfit.scan.recording import Frame, Recording, Size
from planfit.scan.source import fingerprint
from planfit.scan.types import ScanOptions

STALE = (
    "opt_cloud", "opt_polygons_size", "opt_polygons", "opt_tex_coords", "opt_tex_materials", "opt_map",
    "opt_last_localization",
)  # fmt: skip
"""What a database keeps of the map as it was with the old poses."""


@dataclass(frozen=True)
class Node:
    """A node of the map."""

    number: int
    map_id: int
    time: float
    odom_from_base: Float[np.ndarray, "4 4"]
    """NaN where odometry was lost."""


@dataclass(frozen=True, kw_only=True)
class NodeImages(ImageFiles):
    """Images of nodes; of several cameras side by side, the first."""

    n_cameras: int

    def sizes(self, frame: Frame) -> tuple[Size, Size]:
        """Of colour and depth, from their headers."""
        sizes = []
        if frame.color:
            sizes.append(whole_image_size(self.source, frame.color))
        if frame.depth:
            head = self.source.ends(frame.depth)[0]
            sizes.append(depth_size(head, self.source.path / frame.depth))
        (width, height), depth = sizes[0], sizes[-1]
        return (width // self.n_cameras, height), (depth[0] // self.n_cameras, depth[1])

    def color(self, frame: Frame) -> np.ndarray:
        """Colour image, RGB."""
        image = super().color(frame)
        return np.ascontiguousarray(image[:, : image.shape[1] // self.n_cameras])

    def depth(self, frame: Frame) -> Float[np.ndarray, "h w"]:
        """float32 m, NaN where nothing was measured."""
        path = self.source.path / frame.depth
        depth = decode_stored_depth(self.source.read(frame.depth), self.metres_per_unit, path)
        return np.ascontiguousarray(depth[:, : depth.shape[1] // self.n_cameras])


def read(source: DatabaseSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: tables are missing or damaged, or the map has no RGB-D nodes.
    """
    nodes = _nodes(source)
    cameras = _cameras(source, nodes)
    poses, skipped, warnings = _world_from_bases(source, nodes, cameras)
    frames = [
        Frame(
            str(node.number),
            node.time,
            poses[node.number] @ cameras[node.number].base_from_cam,
            f"image/{node.number}",
            f"depth/{node.number}",
        )
        for node in nodes
        if node.number in poses and node.number in cameras
    ]
    for frame in frames:
        check_recorded_pose(frame.world_from_cam, f"{source.path}, pose of node {frame.frame_id}")
    n_cameras = _count_cameras(source, list(cameras.values()))
    if n_cameras > 1:
        warnings.append(f"nodes have {n_cameras} cameras: the first of them is read")

    def lens(frame: Frame, size: Size) -> Lens:
        camera = cameras[int(frame.frame_id)]
        where = f"{source.path}, calibration of node {frame.frame_id}"
        stored = camera.size if min(camera.size) > 0 else size
        return Lens(make_camera(*stored, camera.intrinsics, where))

    def write_poses(
        directory: Path, written: Sequence[Frame], refined: Float[np.ndarray, "k 4 4"]
    ) -> None:
        numbers = [int(frame.frame_id) for frame in written]
        mounts = np.stack([cameras[number].base_from_cam for number in numbers])
        moved = dict(zip(numbers, refined @ se3.inverse(mounts), strict=True))
        _write(source, directory / source.path.name, followed(poses, moved))

    images = NodeImages(source, options.depth_scale or 1e-3, n_cameras=n_cameras)
    return Recording(
        format="rtabmap",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=lens,
        write_poses=write_poses,
        fingerprint=fingerprint(images.source, images.files(frames), options),
        skipped=skipped,
        warnings=warnings,
    )


def _nodes(source: DatabaseSource) -> list[Node]:
    """In the order in which they were made."""
    nodes = []
    for number, map_id, stamp, pose in source.rows(
        "SELECT id, map_id, stamp, pose FROM Node ORDER BY id"
    ):
        if not isinstance(stamp, int | float) or not isinstance(map_id, int):
            raise ScanError(
                f"{source.path}, node {number}: expected a time and a map, found {stamp!r}, {map_id!r}; run "
                "rtabmap-recovery"
            )
        odom_from_base = parse_pose(pose if isinstance(pose, bytes) else None)
        check_recorded_pose(odom_from_base, f"{source.path}, pose of node {number}")
        nodes.append(Node(number, map_id, float(stamp), odom_from_base))
    return nodes


def _cameras(source: DatabaseSource, nodes: Sequence[Node]) -> dict[int, StoredCamera]:
    """Of the nodes that have an image with depth.

    Raises:
        ScanError: none has, or a calibration is damaged.
    """
    cameras: dict[int, StoredCamera] = {}
    known: dict[bytes, StoredCamera] = {}
    for node in nodes:
        names = [f"{kind}/{node.number}" for kind in ("image", "depth", "calibration")]
        if all(source.exists(name) for name in names):
            data = source.read(names[2])
            where = f"{source.path}, calibration of node {node.number}"
            cameras[node.number] = known.setdefault(data, parse_camera(data, where))
    if not cameras:
        raise ScanError(
            f"{source.path}: expected nodes with image, depth and calibration, found none among "
            f"{len(nodes)}; record with Mem/BinDataKept true and an RGB-D camera"
        )
    return cameras


def _count_cameras(source: DatabaseSource, cameras: Sequence[StoredCamera]) -> int:
    counts = {camera.count for camera in cameras}
    if len(counts) > 1:
        raise ScanError(
            f"{source.path}: expected as many cameras in each node, found {min(counts)} to {max(counts)}"
        )
    return counts.pop()


def _world_from_bases(
    source: DatabaseSource, nodes: Sequence[Node], cameras: dict[int, StoredCamera]
) -> tuple[dict[int, Float[np.ndarray, "4 4"]], list[str], list[str]]:
    """Poses in one world by the node's number, a line for each frame that has none, and warnings."""
    optimised = _optimised(source)
    of_map: dict[int, list[Node]] = {}
    for node in nodes:
        of_map.setdefault(node.map_id, []).append(node)
    poses: dict[int, np.ndarray] = {}
    warnings = []
    if optimised:
        for members in of_map.values():
            poses |= followed(
                {node.number: node.odom_from_base for node in members},
                {n.number: optimised[n.number] for n in members if n.number in optimised},
            )
    else:
        counts = Counter(node.map_id for node in nodes if node.number in cameras)
        chosen, n_frames = counts.most_common(1)[0]
        poses = {node.number: node.odom_from_base for node in of_map[chosen]}
        if len(counts) > 1:
            warnings.append(
                f"{len(counts)} sessions that no optimised poses join: the {n_frames} frames of session "
                f"{chosen} are read; join the sessions with rtabmap-reprocess"
            )
    skipped = [
        f"frame {node.number}: its session {node.map_id} is not joined with the others"
        for node in nodes
        if node.number in cameras and node.number not in poses
    ]
    return poses, skipped, warnings


def _optimised(source: DatabaseSource) -> dict[int, Float[np.ndarray, "4 4"]]:
    if not {"opt_ids", "opt_poses"} <= set(source.columns("Admin")):
        return {}
    rows = source.rows("SELECT opt_ids, opt_poses FROM Admin")
    if not rows or not all(isinstance(data, bytes) and len(data) > N_POSE for data in rows[0]):
        return {}
    where = f"{source.path}, optimised poses"
    ids, values = (parse_matrix(data, where).ravel() for data in rows[0])
    if len(values) != N_POSE * len(ids):
        raise ScanError(
            f"{where}: expected 12 numbers for each of {len(ids)} nodes, found {len(values)}"
        )
    stored = values.astype("<f4").reshape(-1, N_POSE)
    poses = {int(i): parse_pose(row.tobytes()) for i, row in zip(ids, stored, strict=True)}
    for number, pose in poses.items():
        check_recorded_pose(pose, f"{where}, node {number}")
    return {number: pose for number, pose in poses.items() if not is_lost(pose)}


def _write(source: DatabaseSource, path: Path, poses: dict[int, Float[np.ndarray, "4 4"]]) -> None:
    """A copy of the database with these as its optimised poses; as odometry where it knows no others."""
    known = {number: pose for number, pose in sorted(poses.items()) if not is_lost(pose)}
    rows = np.array([pose[:3].ravel() for pose in known.values()], dtype="<f4")
    columns = source.columns("Admin")
    is_empty = "opt_poses" in columns and not source.rows("SELECT 1 FROM Admin")
    with source.copied_to(path) as copy:
        if is_empty:
            copy.execute("INSERT INTO Admin (opt_ids) VALUES (NULL)")
        if "opt_poses" in columns:
            ids = pack_matrix(np.array([list(known)], dtype="<i4"))
            stale = "".join(f", {name} = NULL" for name in STALE if name in columns)
            copy.execute(
                f"UPDATE Admin SET opt_ids = ?, opt_poses = ?{stale}",
                (ids, pack_matrix(rows.reshape(1, -1))),
            )
        else:
            copy.executemany(
                "UPDATE Node SET pose = ? WHERE id = ?",
                [(row.tobytes(), number) for row, number in zip(rows, known, strict=True)],
            )


RTABMAP = WholeFile(
    name="rtabmap",
    page="""RTAB-Map's database: RGB-D nodes of a map, from its apps, from ROS, or from `rtabmap-reprocess`.

    MAP.db     sqlite. Node: id, map_id, stamp (s), pose (3x4 float32, by row: odom_from_base)
               Data: image (JPEG or PNG), depth (PNG of 16-bit millimetres, PNG of float32 metres in four
               channels, DEPTHRVL, DEPTHINV), calibration (size, K, P, base_from_camera with OpenCV axes)
               Admin: opt_ids, opt_poses (zlib): poses after loops were closed

Optimised poses are taken where the database has them; nodes between them, which are not optimised, follow
the last optimised one as odometry says. Without, odometry is taken, of the session with most nodes: sessions
that no loop joins have a world each. As in RTAB-Map, images are taken as rectified, and as P shows them where
there is one. Of several cameras the first is read; stereo is refused, for it has no depth. Whether the world
is level is not told. Refined poses are written as the optimised ones of a copy, in which clouds, meshes and
grids of the old poses are dropped.
""",
    expects="a .db file of RTAB-Map with images and depth",
    checked=(
        "RTAB-Map's CameraModel.cpp, Compression.cpp, DBDriverSqlite3.cpp (saveOptimizedPosesQuery) and "
        "schema (github.com/introlab/rtabmap); a real database of 411 nodes, without images",
        "pose and calibration blobs, every code of depth, times, tables; its images were put "
        "in by the test",
    ),
    magic=b"SQLite format 3\0",
    open=DatabaseSource,
    read=read,
)
