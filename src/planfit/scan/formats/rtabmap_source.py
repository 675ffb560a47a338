"""A database of RTAB-Map as files, `image/7` and `depth/7` blobs of node 7, and what is in its blobs.

Layouts: CameraModel::serialize, compressData and compressImage of github.com/introlab/rtabmap (0.18 to 0.23).
"""

import sqlite3
import struct
import time
import weakref
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from threading import Lock

import numpy as np
from jaxtyping import Float, Shaped

from planfit.errors import ScanError
from planfit.scan.images.decode import (
    decode_image,
    decode_rvl,
    depth_from_inverse,
    depth_from_metres,
    depth_from_raw,
    header_size,
)
from planfit.scan.images.files import PackedSource
from planfit.scan.images.lens import MAX_SIZE_PX
from planfit.scan.source import MAX_ENTRY_BYTES, fingerprint_of_file
from planfit.scan.tables import shorten

FOLDERS = ("image", "depth", "calibration")
"""Columns of the table Data that are read."""
MAX_QUERY_S = 10.0
"""Of computing, not of waiting for the disk: lengths of all blobs of a map of 411 nodes take 1 ms."""
_STEPS = 100_000
"""Of SQLite's between two looks at the clock, about 2 ms."""


class _QueryTime:
    """How long SQLite has been at work: a damaged or a hostile database has it so without end."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """A query begins, in this thread."""
        self._began_s = time.thread_time()

    def is_up(self) -> bool:
        """Whether it is to be given up."""
        return time.thread_time() - self._began_s > MAX_QUERY_S


class DatabaseSource(PackedSource):
    """Blobs of the table Data, by name; safe to use from several threads."""

    kind = "database"

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = Lock()
        try:
            self._connection = sqlite3.connect(
                f"{path.resolve().as_uri()}?mode=ro", uri=True, check_same_thread=False
            )
        except sqlite3.Error as error:
            raise ScanError(f"{path}: expected a database, cannot be opened ({error})") from error
        weakref.finalize(self, self._connection.close)
        self._stamp = fingerprint_of_file(path)
        self._time = _QueryTime()
        self._connection.set_progress_handler(self._time.is_up, _STEPS)
        views = self.rows("SELECT name FROM sqlite_master WHERE type = 'view'")
        if views:
            raise ScanError(
                f"{path}: expected tables of RTAB-Map, found a view ({shorten(views[0][0])}), which is a "
                "query that may have no end; do not trust this database, or save the map again"
            )

    def rows(self, query: str) -> list[tuple]:
        """What a query finds.

        Raises:
            ScanError: a table or column is missing, or the file is damaged.
        """
        with self._reading():
            return self._connection.execute(query).fetchall()

    def columns(self, table: str) -> list[str]:
        """Names of a table's columns; none where it is not there."""
        return [str(row[1]) for row in self.rows(f"PRAGMA table_info({table})")]

    @contextmanager
    def copied_to(self, path: Path) -> Iterator[sqlite3.Connection]:
        """A copy to be changed while the context lasts.

        Raises:
            ScanError: the database is damaged.
        """
        path.unlink(missing_ok=True)
        with self._reading(), closing(sqlite3.connect(path)) as copy:
            self._connection.backup(copy)
            self._time.begin()
            copy.set_progress_handler(self._time.is_up, _STEPS)
            yield copy
            copy.commit()

    def exists(self, name: str) -> bool:
        """See `ImageSource`."""
        folder, _, number = name.partition("/")
        return number in self._lengths.get(folder, {})

    def stamp(self, name: str) -> str:
        """See `ImageSource`: that of the whole file."""
        return f"{self.n_bytes(name)} {self._stamp}"

    @cached_property
    def _lengths(self) -> dict[str, dict[str, int]]:
        found = {}
        for folder in FOLDERS:
            query = f"SELECT id, length({folder}) FROM Data WHERE length({folder}) > 0"
            found[folder] = {str(number): int(length) for number, length in self.rows(query)}
        return found

    def n_bytes(self, name: str) -> int:
        """See `PackedSource`."""
        folder, _, number = name.partition("/")
        length = self._lengths.get(folder, {}).get(number)
        if length is None or length > MAX_ENTRY_BYTES:
            raise ScanError(f"{self.path}: expected {name}, found {length or 'no'} bytes")
        return length

    def part(self, name: str, begin: int, count: int) -> bytes:
        """See `PackedSource`."""
        folder, _, number = name.partition("/")
        with (
            self._reading(),
            self._connection.blobopen("Data", folder, int(number), readonly=True) as blob,
        ):
            blob.seek(begin)
            return blob.read(count)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            with self._lock:
                self._time.begin()
                yield
        except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
            raise ScanError(
                f"{self.path}: expected a database of RTAB-Map, found one that cannot be read "
                f"({shorten(error)}); copy it again, or run rtabmap-recovery"
            ) from error


N_POSE = 12
"""Numbers of a pose, 3x4 by row."""
HEADER = struct.Struct("<11i")
"""Version (3), kind, width, height, and how many numbers K, D, R, P and base_from_camera have."""
LEGACY_BYTES = {72: True, 64: False}
"""Before 0.18: float32 fx fy cx cy [width height] base_from_camera; whether the size is there."""
TYPES = {
    0: np.dtype("u1"),
    1: np.dtype("i1"),
    4: np.dtype("<i4"),
    5: np.dtype("<f4"),
    6: np.dtype("<f8"),
}
"""Of matrices, by OpenCV's numbers."""
RVL, INVERSE = b"DEPTHRVL", b"DEPTHINV"


@dataclass(frozen=True)
class StoredCamera:
    """The first camera of a node."""

    intrinsics: tuple[float, float, float, float]
    """fx fy cx cy."""
    size: tuple[int, int]
    """(width, height) px; zeros where it is not stored."""
    base_from_cam: Float[np.ndarray, "4 4"]
    count: int
    """Cameras of the node; their images stand side by side."""


def parse_camera(data: bytes, where: str) -> StoredCamera:
    """The camera of a node's calibration.

    Raises:
        ScanError: it is a stereo camera's, or damaged.
    """
    if len(data) < HEADER.size:
        raise _damaged(where, len(data))
    header = HEADER.unpack_from(data)
    # A version; else a focal length as float.
    if not (0 <= header[0] < 100 and 0 <= header[1] < 10_000):
        return _parse_legacy(data, where)
    if header[3] != 0:
        raise ScanError(
            f"{where}: expected the calibration of an RGB-D camera, found one of a stereo camera; planfit "
            "needs depth"
        )
    counts = header[6:]
    n_bytes = HEADER.size + 8 * sum(counts[:4]) + 4 * counts[4]
    is_known = counts[0] in (0, 9) and counts[3] in (0, 12) and counts[4] in (0, N_POSE)
    if not is_known or min(counts) < 0 or n_bytes > len(data):
        raise _damaged(where, len(data))
    matrices = np.frombuffer(data, "<f8", sum(counts[:4]), HEADER.size)
    k, _, _, p = np.split(matrices, np.cumsum(counts[:3]))
    matrix = p.reshape(3, 4) if len(p) else k.reshape(3, 3) if len(k) else np.zeros((3, 3))
    local = np.frombuffer(data, "<f4", counts[4], HEADER.size + 8 * sum(counts[:4]))
    pose = parse_pose(local.tobytes()) if len(local) else np.eye(4)
    intrinsics = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    return StoredCamera(
        tuple(float(v) for v in intrinsics),  # type: ignore[arg-type]
        (header[4], header[5]),
        pose,
        len(data) // n_bytes,
    )


def _parse_legacy(data: bytes, where: str) -> StoredCamera:
    for n_bytes, has_size in LEGACY_BYTES.items():
        if len(data) % n_bytes == 0:
            values = np.frombuffer(data, "<f4", n_bytes // 4)
            if not np.isfinite(values).all():
                break
            fx, fy, cx, cy = (float(v) for v in values[:4])
            size = (int(values[4]), int(values[5])) if has_size else (0, 0)
            pose = parse_pose(values[-N_POSE:].tobytes())
            return StoredCamera((fx, fy, cx, cy), size, pose, len(data) // n_bytes)
    raise _damaged(where, len(data))


def _damaged(where: str, n_bytes: int) -> ScanError:
    return ScanError(
        f"{where}: expected the calibration of an RGB-D camera, found {n_bytes} bytes that are none; open "
        "the database in RTAB-Map once, which updates and checks it"
    )


def parse_pose(data: bytes | None) -> Float[np.ndarray, "4 4"]:
    """A pose; NaN where there is none."""
    pose = np.full((4, 4), np.nan)
    if data is not None and len(data) == 4 * N_POSE:
        pose = np.eye(4)
        pose[:3] = np.frombuffer(data, "<f4").reshape(3, 4)
    return pose


def parse_matrix(data: bytes, where: str) -> Shaped[np.ndarray, "rows columns"]:
    """A matrix of one channel: zlib, then rows, columns and OpenCV's type.

    Raises:
        ScanError: it is damaged.
    """
    try:
        rows, columns, number = struct.unpack("<3i", data[-12:])
        kind = TYPES[number]
        n_bytes = rows * columns * kind.itemsize
        if min(rows, columns) < 0 or n_bytes > MAX_ENTRY_BYTES:
            raise ValueError(f"{rows} x {columns}")
        found = zlib.decompressobj().decompress(data[:-12], n_bytes + 1)
        return np.frombuffer(found, kind, rows * columns).reshape(rows, columns)
    except (struct.error, KeyError, ValueError, zlib.error) as error:
        raise ScanError(
            f"{where}: expected a compressed matrix, found a damaged one ({error}); run rtabmap-recovery"
        ) from error


def pack_matrix(matrix: Shaped[np.ndarray, "rows columns"]) -> bytes:
    """As `parse_matrix` reads it."""
    number = next(n for n, kind in TYPES.items() if kind == matrix.dtype)
    return zlib.compress(matrix.tobytes()) + struct.pack("<3i", *matrix.shape, number)


def depth_size(data: bytes, path: Path) -> tuple[int, int]:
    """(width, height) of stored depth, from its first bytes.

    Raises:
        ScanError: they begin no depth.
    """
    if data.startswith(INVERSE):
        return depth_size(data[16:], path)
    if data.startswith(RVL) and len(data) >= 16:
        width, height = struct.unpack_from("<2I", data, 8)
        if not (0 < width <= MAX_SIZE_PX and 0 < height <= MAX_SIZE_PX):
            raise ScanError(f"{path}: expected depth of a size, found {width} x {height} px")
        return int(width), int(height)
    return header_size(data, path)


def decode_stored_depth(
    data: bytes, metres_per_unit: float, path: Path
) -> Float[np.ndarray, "h w"]:
    """float32 m, NaN where nothing was measured.

    Raises:
        ScanError: it is none, or a stereo camera's right image.
    """
    if data.startswith(INVERSE) and len(data) > 16:
        a, b = struct.unpack_from("<2f", data, 8)
        return depth_from_inverse(_raw(data[16:], path), a, b)
    raw = _raw(data, path)
    if raw.dtype == np.uint8 and raw.ndim == 3 and raw.shape[2] == 4:
        metres = np.ascontiguousarray(raw).view("<f4")[..., 0]
        return depth_from_metres(metres * np.float32(1000 * metres_per_unit))
    return depth_from_raw(raw, metres_per_unit, path)


def _raw(data: bytes, path: Path) -> np.ndarray:
    if data.startswith(RVL):
        return decode_rvl(data[16:], *depth_size(data, path), path)
    return decode_image(data, path, -1)
