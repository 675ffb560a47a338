"""LAS and LAZ files as clouds, read and written again with points moved."""

from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError, each_told_as, told_as
from planfit.scan.laser.cloud import CHUNK_POINTS, CloudClock, Move, TimedPoints
from planfit.scan.laser.recording import laser_recording
from planfit.scan.layout import WholeFile

EXPECTED = "a LAS or LAZ file"
_HEADER_BYTES = 375
"""Of the longest header, that of version 1.4."""
_HEADER_SIZE_AT = 94
"""Offset of the size of the header, bytes (ASPRS LAS 1.4, public header block)."""
_RECORDS = (("records of variable length", 100, 54), ("extended records", 243, 60))
"""What a header counts, at which byte, and how many bytes one takes at least."""
NOISE = (7, 18)
"""Classes of points that ASPRS calls low and high noise."""
MAX_TIME = 1e25
"""What clocks count in the smallest of units is below (`CLOCK_UNITS`); a damaged file has any number."""
CRS_RECORDS = "LASF_Projection"
N_SEEKS, PER_SEEK = 12, 2000


def open_las(path: Path) -> "LasFile":
    """The file, whose header has been read.

    Raises:
        ScanError: it is none, has no times, or the library is missing.
    """
    file = LasFile(path)
    point_format = file.header.point_format
    if "gps_time" not in point_format.dimension_names:
        raise ScanError(
            f"{path}: expected points with GPS times, found point format {point_format.id}, which has none; "
            "export the cloud with times (LAS point format 1, 3 or 6)"
        )
    return file


@dataclass(frozen=True)
class LasFile:
    """A LAS or LAZ file."""

    path: Path

    @cached_property
    def header(self) -> Any:
        """As laspy has it."""
        with self._opened() as reader:
            return reader.header

    @property
    def n_points(self) -> int:
        """As the header says."""
        return int(self.header.point_count)

    @property
    def clock(self) -> CloudClock:
        """What the header says of times."""
        if int(self.header.global_encoding.gps_time_type) == 1:
            return CloudClock("GPS seconds less a billion, as its header says", 1e9)
        return CloudClock("seconds of the GPS week, as its header says", is_gps_week=True)

    def sample_times(self) -> Float[np.ndarray, " n"]:
        """Some times (s) out of all parts of the file."""
        with told_as(ScanError, self.path, EXPECTED), self._opened() as reader:
            found = []
            for start in np.linspace(0, max(self.n_points - PER_SEEK, 0), N_SEEKS).astype(int):
                reader.seek(int(start))
                found.append(np.array(reader.read_points(PER_SEEK).gps_time, dtype=float))
        times = np.concatenate(found)
        with np.errstate(invalid="ignore"):
            return times[np.abs(times) < MAX_TIME]

    def pieces(self) -> Iterator[TimedPoints]:
        """All points, in the order of the file."""
        with self._opened() as reader:
            for points in self._chunks(reader):
                yield _timed(points)

    def write_moved(self, path: Path, move: Move, to_other_axes: bool = False) -> None:
        """A copy in which points are moved; scale and offset stay, so that nothing else is rounded.

        In other axes the offset is zero, and records of the coordinate system are left out.
        """
        import laspy
        from laspy.vlrs.vlrlist import VLRList

        with self._opened() as reader:
            header = deepcopy(reader.header)
            if to_other_axes:
                header.offsets = np.zeros(3)
                header.vlrs = VLRList([v for v in header.vlrs if v.user_id != CRS_RECORDS])
            is_compressed = bool(header.are_points_compressed)
            with laspy.open(path, "w", header=header, do_compress=is_compressed) as writer:
                for points in self._chunks(reader):
                    xyz = np.stack([points.x, points.y, points.z], axis=1).astype(float)
                    moved = move(xyz, np.array(points.gps_time, dtype=float))
                    self._put(points, moved, header)
                    writer.write_points(points)
                if reader.evlrs is not None and len(reader.evlrs):
                    writer.write_evlrs(reader.evlrs)

    def _chunks(self, reader: Any) -> Iterator[Any]:
        n_read = 0
        chunks = reader.chunk_iterator(CHUNK_POINTS)
        for points in each_told_as(ScanError, self.path, EXPECTED, chunks):
            n_read += len(points)
            yield points
        if n_read != self.n_points:
            raise ScanError(
                f"{self.path}: expected {self.n_points} points, found {n_read}; the file was cut off, copy "
                "it again"
            )

    def _put(self, points: Any, moved: Float[np.ndarray, "n 3"], header: Any) -> None:
        """Moved coordinates in the file's own units."""
        units = np.rint((moved - header.offsets) / header.scales)
        limit = np.iinfo(np.int32)
        if len(units) and not (units.min() >= limit.min and units.max() <= limit.max):
            raise ScanError(
                f"{self.path}: expected points within what scale {header.scales} and offset {header.offsets} "
                "of the file can tell, found some moved beyond; write it with a coarser scale first"
            )
        points.offsets = header.offsets  # or laspy converts what is in the new units already
        for axis, name in enumerate("XYZ"):
            points[name] = units[:, axis].astype(np.int32)

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        try:
            import laspy
        except ImportError as error:
            raise ScanError(
                f"{self.path}: expected the libraries laspy and lazrs for LAS and LAZ, found none; "
                "pip install 'planfit[laser]'"
            ) from error
        with self.path.open("rb") as stream:
            self._check_records(stream.read(_HEADER_BYTES))
            stream.seek(0)
            with told_as(ScanError, self.path, EXPECTED):
                # The sequential decompressor takes memory for one point at a time, not for what a damaged
                # table of chunks may claim; lazrs ends the whole process where memory cannot be had.
                reader = laspy.open(stream, laz_backend=laspy.LazBackend.Lazrs, closefd=False)
            if reader.header.are_points_compressed:
                self._check_chunks(int(reader.header.offset_to_point_data))
            yield reader

    def _check_records(self, head: bytes) -> None:
        """Raise `ScanError` where more records are told of than fit into the file: laspy reads as many as the
        header says, behind the end too, for minutes."""
        n_bytes = self.path.stat().st_size
        for name, at, least_bytes in _RECORDS:
            n_records = int.from_bytes(head[at : at + 4], "little")
            # Files before version 1.4 end their header before the second number.
            is_there = at + 4 <= int.from_bytes(head[_HEADER_SIZE_AT:][:2], "little")
            if is_there and n_records * least_bytes > n_bytes:
                raise ScanError(
                    f"{self.path}: expected {EXPECTED}, found {n_records:,} {name} in {n_bytes:,} bytes; the "
                    "file is damaged, copy it again"
                )

    def _check_chunks(self, offset: int) -> None:
        """Raise `ScanError` unless the table of chunks lies in the file and has no more chunks than bytes."""
        n_bytes = self.path.stat().st_size
        with self.path.open("rb") as file:
            file.seek(offset)
            at = int.from_bytes(file.read(8), "little", signed=True)
            if at == -1:  # written by a stream: at the end of the file
                file.seek(max(n_bytes - 8, 0))
                at = int.from_bytes(file.read(8), "little", signed=True)
            if not offset < at <= n_bytes - 8:
                raise ScanError(
                    f"{self.path}: expected {EXPECTED}, found one that ends before its table of chunks; the "
                    "file was cut off, copy it again"
                )
            file.seek(at + 4)
            n_chunks = int.from_bytes(file.read(4), "little")
        if n_chunks > n_bytes:
            raise ScanError(
                f"{self.path}: expected {EXPECTED}, found {n_chunks} chunks in {n_bytes} bytes; the file is "
                "damaged, copy it again"
            )


def _timed(points: Any) -> TimedPoints:
    xyz = np.stack([points.x, points.y, points.z], axis=1).astype(float)
    times = np.array(points.gps_time, dtype=float)
    classes = np.array(points.classification)
    is_valid = np.isfinite(times) & ~np.isin(classes, NOISE)
    if "withheld" in points.point_format.dimension_names:
        is_valid &= ~np.array(points.withheld).astype(bool)
    return TimedPoints(xyz, times, is_valid)


LAS = WholeFile(
    name="las",
    page="""LAS and LAZ: clouds of mobile laser scanners, with `--poses TRAJECTORY` (planfit[laser]).

    CLOUD.las, .laz    LAS 1.2 to 1.4, a point format with gps_time (1, 3 to 10)
    TRAJECTORY         text, in the axes of the cloud: `time x y z [qx qy qz qw]`, or columns that a header
                       names: `%time x y z qw qx qy qz`, `Time[s],Easting[m],...`, HDMapping's pose00 to 23;
                       or a cloud, LAS or E57, whose points are places of the scanner

The cloud's z is up, unless the scanner's path says that another axis is, which is told (`--cloud-up`).
The cloud is cut into instants of half a second. Each is seen from where the scanner was, as depth images of
level pinhole cameras, which are the frames: one that follows the scanner where it sees to one side, else
four. Points that are withheld or classified as noise (7, 18) are left out. Colour is not read. Times count
from the start of the GPS week, or are GPS seconds less a billion (bit 0 of the header's encoding); how they
relate to the trajectory's clock is found where one usual relation alone fits, told, and refused else; either
may count milli-, micro- or nanoseconds, which is told too.
Coordinates are double precision; frames are near the origin, by an offset of whole kilometres. The refined
trajectory is written in the form it came in, and the cloud with every point moved by the correction of its
time: scale, offset, attributes, extra dimensions and records of the header as they were.
""",
    expects="a .las or .laz file with GPS times, and --poses TRAJECTORY",
    checked=(
        "ASPRS LAS 1.4 R15; five real files of laspy's tests (1.2 and 1.4, point formats 3 and 6); columns "
        "of trajectories as raycloudtools, HDMapping and OHM write and read them. No real file with its "
        "trajectory",
        "points, times and attributes of all five files read, moved and written back; laspy reads what "
        "is written",
    ),
    suffixes=(".las", ".laz"),
    magic=b"LASF",
    open=open_las,
    read=laser_recording,
    takes_poses=True,
)
