"""E57 files as clouds: scans of points with times, read and written again with points moved."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError, told_as
from planfit.geometry import se3
from planfit.scan.laser.cloud import CHUNK_POINTS, CloudClock, Move, TimedPoints
from planfit.scan.laser.e57_nodes import (
    COORDINATES,
    SPHERICAL,
    copy_children,
    copy_number,
    from_cartesian,
    load_libe57,
    make_buffers,
    names_of,
    number_in,
    pose_in,
    put_pose,
    text_in,
    to_cartesian,
)
from planfit.scan.laser.recording import KILOMETRE_M, laser_recording
from planfit.scan.layout import WholeFile

EXPECTED = "an E57 file"
BOUNDS = ("cartesianBounds", "sphericalBounds")


def open_e57(path: Path) -> "E57File":
    """The file, whose header has been read.

    Raises:
        ScanError: it is none, has no times, or the library is missing.
    """
    file = E57File(path)
    for k, scan in enumerate(file.scans):
        if "timeStamp" not in scan.names and scan.n_points:
            raise ScanError(
                f"{path}: expected points with times, found scan {k} with {', '.join(scan.names)}; export "
                "the cloud with timeStamp"
            )
    return file


@dataclass(frozen=True)
class _ScanOfFile:
    """What the header says of one scan (Data3D)."""

    n_points: int
    names: tuple[str, ...]
    """Of the fields of points."""
    file_from_scan: Float[np.ndarray, "4 4"]
    start_s: float | None
    """GPS seconds of its beginning, where it is told."""
    shift_s: float
    """From its times to those of the file."""
    guid: str
    has_pose: bool

    @property
    def is_spherical(self) -> bool:
        """Whether it has no cartesian coordinates."""
        return COORDINATES[0] not in self.names

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Fields that tell where a point is."""
        return SPHERICAL if self.is_spherical else COORDINATES

    @property
    def invalid(self) -> str:
        """The field that tells which points are none; empty where there is none."""
        name = "sphericalInvalidState" if self.is_spherical else "cartesianInvalidState"
        return name if name in self.names else ""


@dataclass(frozen=True)
class E57File:
    """An E57 file: all its scans as one cloud."""

    path: Path

    @cached_property
    def scans(self) -> tuple[_ScanOfFile, ...]:
        """Of the header."""
        with self._opened() as image_file, self._told():
            nodes = image_file.root()["data3D"]
            starts = [
                number_in(nodes[i], "acquisitionStart", "dateTimeValue")
                for i in range(nodes.childCount())
            ]
            # Several scans of one walk count from a start each.
            first = min((s for s in starts if s), default=0.0)
            return tuple(
                _scan_of(nodes[i], start, (start - first) if start else 0.0)
                for i, start in enumerate(starts)
            )

    @property
    def n_points(self) -> int:
        """Of all scans."""
        return sum(scan.n_points for scan in self.scans)

    @property
    def clock(self) -> CloudClock:
        """Seconds since the first scan's start, if that is told."""
        first = min((scan.start_s for scan in self.scans if scan.start_s), default=None)
        if first is None:
            return CloudClock("seconds of an E57 file that tells no start")
        return CloudClock("seconds since the start of the first scan, as its header says", first)

    def sample_times(self) -> Float[np.ndarray, " n"]:
        """Times (s) of the first points of each scan, and of as many as can be read quickly."""
        found = []
        for k, n, arrays in self._pieces(("timeStamp",)):
            found.append(self._times(arrays, n, self.scans[k])[::50])
        times = np.concatenate([*found, np.zeros(0)])
        return times[np.isfinite(times)]

    def pieces(self) -> Iterator[TimedPoints]:
        """All points, scan by scan."""
        for k, n, arrays in self._pieces(None):
            scan = self.scans[k]
            xyz = se3.transform(scan.file_from_scan, to_cartesian(arrays, n))
            times = self._times(arrays, n, scan)
            is_valid = np.isfinite(times) & np.isfinite(xyz).all(axis=1)
            if scan.invalid:
                is_valid &= arrays[scan.invalid][:n] == 0
            yield TimedPoints(xyz, times, is_valid)

    def write_moved(self, path: Path, move: Move, to_other_axes: bool = False) -> None:
        """A copy in which points are moved, and every field keeps its form.

        The pose of a scan, and those of its images, go where the scan goes half way through: its points, in
        its own axes, move by the rest alone. In other axes scans have no poses, and the name of the
        coordinate system is left out.
        """
        libe57 = load_libe57()
        left_out = ("coordinateMetadata",) if to_other_axes else ()
        motions = [self._motion(k, move) for k in range(len(self.scans))]
        poses = [
            np.eye(4) if to_other_axes
            else motion @ scan.file_from_scan if scan.has_pose
            else scan.file_from_scan
            for scan, motion in zip(self.scans, motions, strict=True)
        ]  # fmt: skip
        bounds = [self._moved_bounds(k, move, pose) for k, pose in enumerate(poses)]
        with self._opened() as source:
            target = libe57.ImageFile(str(path), "w")
            try:
                for i in range(source.extensionsCount()):
                    target.extensionsAdd(source.extensionsPrefix(i), source.extensionsUri(i))
                apart = ("data3D", "images2D", *left_out)
                copy_children(source.root(), target.root(), target, apart)
                motion_of = {s.guid: m for s, m in zip(self.scans, motions, strict=True) if s.guid}
                for node, made in _made_again(source, target, "images2D"):
                    motion = motion_of.get(text_in(node, "associatedData3DGuid"))
                    is_moved = motion is not None and node.isDefined("pose")
                    copy_children(node, made, target, ("pose",) if is_moved else ())
                    if is_moved:
                        put_pose(made, target, motion @ pose_in(node))
                for k, (node, made) in enumerate(_made_again(source, target, "data3D")):
                    copy_children(node, made, target, ("points", "pose", *BOUNDS, *left_out))
                    if self.scans[k].has_pose and not to_other_axes:
                        put_pose(made, target, poses[k])
                    to_scan = partial(self._moved, self.scans[k], move, poses[k])
                    self._write_points(k, node["points"], made, target, to_scan, bounds[k])
            finally:
                target.close()

    def _motion(self, k: int, move: Move) -> Float[np.ndarray, "4 4"]:
        """How a scan moves in the axes of the file half way through its times, which is rigid."""
        scan = self.scans[k]
        middle_s = self._middle_s(k)
        if middle_s is None:
            return np.eye(4)
        at = scan.file_from_scan[:3, 3]
        ends = move(at + KILOMETRE_M * np.vstack([np.zeros(3), np.eye(3)]), np.full(4, middle_s))
        rotation = se3.project_to_so3((ends[1:] - ends[0]).T / KILOMETRE_M)
        return se3.make_transform(rotation, ends[0] - rotation @ at)

    def _middle_s(self, k: int) -> float | None:
        """Half way through the times of a scan; None where it has none."""
        first, last = np.inf, -np.inf
        for _, n, arrays in self._pieces(("timeStamp",), k):
            times = self._times(arrays, n, self.scans[k])
            known = times[np.isfinite(times)]
            first, last = known.min(initial=first), known.max(initial=last)
        return (first + last) / 2 if first <= last else None

    def _write_points(
        self,
        k: int,
        points: Any,
        made: Any,
        target: Any,
        to_scan: Callable[[dict[str, np.ndarray], int], np.ndarray],
        bounds: np.ndarray,
    ) -> None:
        """Points of one scan with all their fields."""
        libe57 = load_libe57()
        scan, prototype = self.scans[k], libe57.StructureNode(points.prototype())
        fields = libe57.StructureNode(target)
        for name in scan.names:
            limits = None
            if name in scan.coordinates and scan.n_points:
                axis = scan.coordinates.index(name)
                limits = (float(bounds[0, axis]), float(bounds[1, axis]))
            fields.set(name, copy_number(prototype[name], target, limits))
        codecs = libe57.VectorNode(target, True)
        vector = libe57.CompressedVectorNode(target, fields, codecs)
        made.set("points", vector)
        arrays, buffers = make_buffers(target, fields, list(scan.names), CHUNK_POINTS)
        writer = vector.writer(buffers)
        for _, n, found in self._pieces(None, k):
            moved = from_cartesian(to_scan(found, n), scan.is_spherical)
            for name in scan.names:
                arrays[name][:n] = moved[name] if name in moved else found[name][:n]
            writer.write(n)
        writer.close()

    @staticmethod
    def _times(arrays: dict[str, np.ndarray], n: int, scan: _ScanOfFile) -> Float[np.ndarray, " n"]:
        return arrays["timeStamp"][:n] + scan.shift_s

    def _moved(
        self,
        scan: _ScanOfFile,
        move: Move,
        target_from_scan: Float[np.ndarray, "4 4"],
        arrays: dict[str, np.ndarray],
        n: int,
    ) -> Float[np.ndarray, "n 3"]:
        """Points (m) of a scan, in the axes it will have, where they belong; those that are none stay."""
        own = to_cartesian(arrays, n)
        xyz = move(se3.transform(scan.file_from_scan, own), self._times(arrays, n, scan))
        moved = se3.transform(se3.inverse(target_from_scan), xyz)
        is_none = np.zeros(n, dtype=bool) if not scan.invalid else arrays[scan.invalid][:n] != 0
        return np.where(is_none[:, None], own, moved)

    def _moved_bounds(
        self, k: int, move: Move, target_from_scan: Float[np.ndarray, "4 4"]
    ) -> Float[np.ndarray, "2 3"]:
        """Least and most of each coordinate that is written."""
        scan = self.scans[k]
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for _, n, arrays in self._pieces(None, k):
            points = self._moved(scan, move, target_from_scan, arrays, n)
            moved = from_cartesian(points, scan.is_spherical)
            values = np.stack([moved[name] for name in scan.coordinates], axis=1)
            low, high = np.fmin(low, values.min(axis=0)), np.fmax(high, values.max(axis=0))
        return np.stack([low, high])

    def _pieces(
        self, names: tuple[str, ...] | None, only: int | None = None
    ) -> Iterator[tuple[int, int, dict[str, np.ndarray]]]:
        """Number of the scan, how many points, and their fields in arrays that are used again."""
        libe57 = load_libe57()
        with self._opened() as image_file:
            for k, scan in enumerate(self.scans):
                if scan.n_points == 0 or (only is not None and k != only):
                    continue
                wanted = [n for n in scan.names if names is None or n in names]
                with self._told():
                    points = image_file.root()["data3D"][k]["points"]
                    prototype = libe57.StructureNode(points.prototype())
                    arrays, buffers = make_buffers(image_file, prototype, wanted, CHUNK_POINTS)
                    reader = points.reader(buffers)
                n_read = 0
                while True:
                    with self._told():
                        n = int(reader.read())
                    if n == 0:
                        break
                    n_read += n
                    yield k, n, arrays
                reader.close()
                if n_read != scan.n_points:
                    raise ScanError(
                        f"{self.path}: expected {scan.n_points} points in scan {k}, found {n_read}; copy the "
                        "file again"
                    )

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        try:
            libe57 = load_libe57()
        except ImportError as error:
            raise ScanError(
                f"{self.path}: expected the library pye57 for E57, found none; pip install 'planfit[laser]'"
            ) from error
        with self._told():
            image_file = libe57.ImageFile(str(self.path), "r")
        try:
            yield image_file
        finally:
            image_file.close()

    def _told(self) -> AbstractContextManager[None]:
        return told_as(ScanError, self.path, EXPECTED)


def _scan_of(node: Any, start_s: float | None, shift_s: float) -> _ScanOfFile:
    points = node["points"]
    return _ScanOfFile(
        int(points.childCount()),
        tuple(names_of(points.prototype())),
        pose_in(node),
        start_s or None,
        shift_s,
        text_in(node, "guid"),
        node.isDefined("pose"),
    )


def _made_again(source: Any, target: Any, name: str) -> Iterator[tuple[Any, Any]]:
    """Structures of a list of a file, each with an empty one at its place in another file."""
    if not source.root().isDefined(name):
        return
    libe57, nodes = load_libe57(), source.root()[name]
    listed = libe57.VectorNode(target, True)
    target.root().set(name, listed)
    for i in range(nodes.childCount()):
        made = libe57.StructureNode(target)
        listed.append(made)
        yield nodes[i], made


E57 = WholeFile(
    name="e57",
    page="""E57: clouds of mobile laser scanners, with `--poses TRAJECTORY` (planfit[laser]).

    CLOUD.e57     ASTM E2807: scans of points with cartesian or spherical coordinates and timeStamp
    TRAJECTORY    as of [las](#las), in the axes of the file

Read as [las](#las) is: instants of half a second, seen by level cameras. A timeStamp counts seconds from the
start of its scan, which the standard tells in GPS time; how times relate to the trajectory's clock is found
where one usual relation alone fits, told, and refused else. Several scans of a file are one walk. Points
that are marked as invalid are left out. Every point is moved by the correction of its time: the pose in the
header of its scan, and those of the scan's images, by that of half way through the scan, and the point in the
scan's axes by the rest, nothing where a scan moved as a whole. Precision, fields and all else of the file are
kept, but for groups of points (lines).
""",
    expects="an .e57 file with times, and --poses TRAJECTORY",
    checked=(
        "ASTM E2807 as libE57Format implements it; seven real files of its and pye57's tests, none of them "
        "with times. No real file with its trajectory",
        "points, poses, invalid states and every field of the seven read, moved and written back; pye57 "
        "reads what is written",
    ),
    suffixes=(".e57",),
    magic=b"ASTM-E57",
    open=open_e57,
    read=laser_recording,
    takes_poses=True,
)
