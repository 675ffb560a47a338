"""ScanNet's container: the file as a place where images lie, its frames, and their images unpacked."""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float, UInt8

from planfit.errors import ScanError
from planfit.scan.formats.scannet import NUMBERED_POSES, check_extrinsics
from planfit.scan.images.decode import decode_color, depth_from_raw
from planfit.scan.images.files import ImageFiles, PackedSource
from planfit.scan.images.lens import MAX_SIZE_PX, matrix_intrinsics
from planfit.scan.layout import WholeFile
from planfit.scan.poses import check_recorded_pose
from planfit.scan.recording import Frame, Recording, Size, pinhole_lens
from planfit.scan.source import MAX_ENTRY_BYTES, fingerprint, fingerprint_of_file
from planfit.scan.types import ScanOptions

VERSION = 4
"""4, the only one that ScanNet published."""
MAX_NAME_BYTES = 4096
FIXED = struct.Struct("<64f2i4If")
"""Four matrices, two codes, sizes of colour and depth, stored units a metre."""
FRAME = struct.Struct("<16f4Q")
"""Pose, times of colour and depth, lengths of colour and depth."""
RAW_COLOR, COLOR_CODES = 0, (0, 1, 2)
RAW_DEPTH, ZLIB_DEPTH = 0, 1
USUAL_INTERVAL_S = (0.002, 10.0)
"""Between frames, in the middle: where times in us give another, they are no times."""


@dataclass(frozen=True)
class SensHeader:
    """What a file says of all its frames."""

    color: Float[np.ndarray, "4 4"]
    """Intrinsics."""
    color_extrinsics: Float[np.ndarray, "4 4"]
    depth: Float[np.ndarray, "4 4"]
    depth_extrinsics: Float[np.ndarray, "4 4"]
    color_code: int
    depth_code: int
    color_size: Size
    depth_size: Size
    units_per_metre: float
    n_frames: int
    n_bytes: int
    """Of the header."""


@dataclass(frozen=True)
class SensFrame:
    """A frame, and where its images lie."""

    world_from_cam: Float[np.ndarray, "4 4"]
    time_us: int
    start: dict[str, int]
    """Of `color` and `depth`, byte of the file."""
    n_bytes: dict[str, int]


class SensSource(PackedSource):
    """A file as a place where files lie: `color/7` and `depth/7` are images of frame 7, counted from 0."""

    kind = "container"

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as file:
                self.header = _read_header(file.read(MAX_NAME_BYTES + FIXED.size + 20), path)
                self.frames = _list_frames(file, self.header, path)
            self._stamp = fingerprint_of_file(path)
        except OSError as error:
            raise ScanError(f"{path}: cannot be read ({error.strerror})") from error

    def exists(self, name: str) -> bool:
        """See `ImageSource`."""
        folder, _, number = name.partition("/")
        if folder not in ("color", "depth") or not number.isdecimal():
            return False
        return int(number) < len(self.frames) and self.frames[int(number)].n_bytes[folder] > 0

    def stamp(self, name: str) -> str:
        """See `ImageSource`: that of the whole file."""
        return f"{self._place(name)} {self._stamp}"

    def n_bytes(self, name: str) -> int:
        """See `PackedSource`."""
        return self._place(name)[1]

    def part(self, name: str, begin: int, count: int) -> bytes:
        """See `PackedSource`."""
        try:
            with self.path.open("rb") as file:  # a handle of its own: threads share none
                file.seek(self._place(name)[0] + begin)
                return file.read(count)
        except OSError as error:
            raise ScanError(f"{self.path}: cannot be read ({error.strerror})") from error

    def _place(self, name: str) -> tuple[int, int]:
        if not self.exists(name):
            raise ScanError(f"{self.path}: expected {name}, found no such image")
        folder, _, number = name.partition("/")
        frame = self.frames[int(number)]
        return frame.start[folder], frame.n_bytes[folder]


def _read_header(data: bytes, path: Path) -> SensHeader:
    """The fields before the first frame.

    Raises:
        ScanError: they are not those of such a file, or of codes that nothing here unpacks.
    """
    try:
        version, n_name = struct.unpack_from("<IQ", data)
        if version != VERSION:
            raise ScanError(
                f"{path}: expected version {VERSION} of ScanNet's container, found {version}; "
                "convert it with the program that wrote it"
            )
        if n_name > MAX_NAME_BYTES:
            raise ValueError(f"a name of {n_name} bytes")
        at = 12 + n_name
        fields = FIXED.unpack_from(data, at)
        (n_frames,) = struct.unpack_from("<Q", data, at + FIXED.size)
        matrices = np.array(fields[:64]).reshape(4, 4, 4)
        color_code, depth_code, *sizes = fields[64:70]
        units = fields[70]
        if not all(0 <= size <= MAX_SIZE_PX for size in sizes) or min(sizes[2:]) == 0:
            raise ValueError(f"images of {sizes[0]} x {sizes[1]} and {sizes[2]} x {sizes[3]} px")
        if 2 * sizes[2] * sizes[3] > MAX_ENTRY_BYTES:
            raise ValueError(f"depth of {sizes[2]} x {sizes[3]} px")
        if not (np.isfinite(units) and units > 0):
            raise ValueError(f"depth in {units} units a metre")
        if color_code not in COLOR_CODES:
            raise ValueError(f"colour of code {color_code}")
    except (struct.error, ValueError) as error:
        raise ScanError(
            f"{path}: expected a container of ScanNet, found a damaged one or another file ({error}); "
            "copy it again"
        ) from error
    if depth_code not in (RAW_DEPTH, ZLIB_DEPTH):
        raise ScanError(
            f"{path}: expected depth of code {RAW_DEPTH} (16 bit) or {ZLIB_DEPTH} (zlib), found "
            f"{depth_code}, which only the sensor maker's library unpacks; export images and poses with the "
            "program that recorded it, and give that folder"
        )
    return SensHeader(
        matrices[0], matrices[1], matrices[2], matrices[3], color_code, depth_code,
        (sizes[0], sizes[1]), (sizes[2], sizes[3]), units, n_frames, at + FIXED.size + 8,
    )  # fmt: skip


def _list_frames(file: BinaryIO, header: SensHeader, path: Path) -> list[SensFrame]:
    """All frames that lie whole in an open file."""
    n_bytes = file.seek(0, 2)
    frames, at = [], header.n_bytes
    while len(frames) < header.n_frames and at + FRAME.size <= n_bytes:
        file.seek(at)
        *numbers, time_us, _, n_color, n_depth = FRAME.unpack(file.read(FRAME.size))
        start = at + FRAME.size
        at = start + n_color + n_depth
        if at > n_bytes:
            break
        if max(n_color, n_depth) > MAX_ENTRY_BYTES:
            raise ScanError(
                f"{path}: expected images below {MAX_ENTRY_BYTES // 1_000_000} MB, found one of "
                f"{max(n_color, n_depth) // 1_000_000} MB at frame {len(frames)}; copy the file again"
            )
        frames.append(
            SensFrame(
                np.array(numbers).reshape(4, 4),
                time_us,
                {"color": start, "depth": start + n_color},
                {"color": n_color, "depth": n_depth},
            )
        )
    if not frames:
        raise ScanError(
            f"{path}: expected {header.n_frames} frames, found none that is whole; copy the file again"
        )
    return frames


@dataclass(frozen=True, kw_only=True)
class SensImages(ImageFiles):
    """Images of a file, whose sizes and codes its header says."""

    header: SensHeader

    def sizes(self, frame: Frame) -> tuple[Size, Size]:
        """Of colour and depth, from the file's header."""
        depth = self.header.depth_size
        return (self.header.color_size if frame.color else depth), depth

    def color(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB."""
        data, path = self.source.read(frame.color), self.source.path / frame.color
        if self.header.color_code != RAW_COLOR:
            return decode_color(data, path)
        width, height = self.header.color_size
        return _exactly(data, 3 * width * height, path).reshape(height, width, 3).copy()

    def depth(self, frame: Frame) -> Float[np.ndarray, "h w"]:
        """float32 m, NaN where nothing was measured."""
        data, path = self.source.read(frame.depth), self.source.path / frame.depth
        width, height = self.header.depth_size
        n_bytes = 2 * width * height
        if self.header.depth_code == ZLIB_DEPTH:
            try:
                data = zlib.decompressobj().decompress(data, n_bytes + 1)
            except zlib.error as error:
                raise ScanError(
                    f"{path}: expected depth packed with zlib, found damaged bytes ({error}); copy the "
                    "file again"
                ) from error
        raw = _exactly(data, n_bytes, path).view("<u2").reshape(height, width)
        return depth_from_raw(raw.astype(np.uint16), self.metres_per_unit, path)


def read(source: SensSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its matrices or poses are damaged, or colour is not what poses are of.
    """
    header, where = source.header, str(source.path)
    color_from_depth = check_extrinsics(
        header.color_extrinsics, header.depth_extrinsics, f"{where}, extrinsics of colour"
    )
    color = matrix_intrinsics(header.color, where)
    depth = matrix_intrinsics(header.depth, where)
    has_color = any(frame.n_bytes["color"] for frame in source.frames)
    frames = []
    for i, (stored, time) in enumerate(zip(source.frames, _times_s(source.frames), strict=True)):
        check_recorded_pose(stored.world_from_cam, f"{where}, pose of frame {i}")
        frames.append(
            Frame(
                str(i), time, stored.world_from_cam, f"color/{i}" if has_color else "", f"depth/{i}"
            )
        )
    cut_off = (
        f"the file ends within frame {len(frames)} of {header.n_frames}: the frames before it are read; copy "
        "it again for the others"
    )
    images = SensImages(source, options.depth_scale or 1 / header.units_per_metre, header=header)
    return Recording(
        format="sens",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=pinhole_lens(color if has_color else depth, f"{where}, colour"),
        depth_lens=pinhole_lens(depth, f"{where}, depth"),
        color_from_depth=color_from_depth,
        write_poses=NUMBERED_POSES.write_into,
        fingerprint=fingerprint(images.source, images.files(frames), options),
        warnings=[cut_off] if len(frames) < header.n_frames else [],
    )


def _times_s(frames: Sequence[SensFrame]) -> list[float]:
    """Seconds since the first frame; numbers of frames, where the file's times are none."""
    times = np.array([frame.time_us for frame in frames], dtype=float) * 1e-6
    steps = np.diff(times)
    least, most = USUAL_INTERVAL_S
    if not len(steps) or steps.min() <= 0 or not least <= np.median(steps) <= most:
        return [float(i) for i in range(len(frames))]
    return [float(t) for t in times - times[0]]


def _exactly(data: bytes, n_bytes: int, path: Path) -> UInt8[np.ndarray, " n"]:
    if len(data) != n_bytes:
        raise ScanError(
            f"{path}: expected {n_bytes} bytes of image, found {len(data)}; copy the file again"
        )
    return np.frombuffer(data, np.uint8)


SENS = WholeFile(
    name="sens",
    page="""ScanNet's container, one file a scan: also what BundleFusion and its apps record into.

    SCAN.sens   little endian. Version 4 (uint32), the sensor's name (uint64 length, bytes), then 4x4 float32
                by row: intrinsics and extrinsics of colour, of depth; codes of colour and depth (int32),
                their sizes (4 uint32), stored units a metre (float32), number of frames (uint64)
                a frame: world_from_cam (4x4 float32, OpenCV axes, all minus infinity where tracking was
                lost), times of colour and depth (uint64 us), lengths of both images (uint64), and the
                images: colour as JPEG, PNG or RGB, depth as 16 bit, by row, packed with zlib or as it is

A file that ends early is read up to its last whole frame. Depth in the code of the Structure sensor's maker
(2) is refused: only his library unpacks it. Refined poses are written as SensReader writes those of a file,
one N.txt a frame.
""",
    expects="a .sens file of ScanNet or BundleFusion",
    checked=(
        "sensorData.h and SensorData.py (github.com/ScanNet/ScanNet). No real file",
        "every field and code but the sensor maker's, by files that the test writes as sensorData.h does",
    ),
    # Its first bytes are a small number, as those of many files are.
    suffixes=(".sens",),
    open=SensSource,
    read=read,
)
