"""From a container to a `Recording`: its frames, and their images unpacked."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from planfit.errors import ScanError
from planfit.scan.formats.scannet import check_extrinsics, write_numbered_poses
from planfit.scan.formats.sens.container import (
    RAW_COLOR,
    ZLIB_DEPTH,
    SensFrame,
    SensHeader,
    SensSource,
)
from planfit.scan.images.decode import decode_color, depth_from_raw
from planfit.scan.images.files import ImageFiles
from planfit.scan.intrinsics import matrix_intrinsics
from planfit.scan.options import ScanOptions
from planfit.scan.poses import check_recorded_pose
from planfit.scan.recording import Frame, Recording, Size, pinhole_lens

EXPECTS = "a .sens file of ScanNet or BundleFusion"
USUAL_INTERVAL_S = (0.002, 10.0)
"""Between frames, in the middle: where times in us give another, they are no times."""


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


def recognise(source: object) -> bool:
    """Whether this is such a file."""
    return isinstance(source, SensSource)


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

    images = SensImages(source, options.depth_scale or 1 / header.units_per_metre, header=header)
    return Recording(
        format="sens",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=pinhole_lens(color if has_color else depth, f"{where}, colour"),
        depth_lens=pinhole_lens(depth, f"{where}, depth"),
        color_from_depth=color_from_depth,
        write_poses=write_numbered_poses,
        fingerprint=images.fingerprint([], frames, options),
        warnings=_warnings(source),
    )


def _times_s(frames: Sequence[SensFrame]) -> list[float]:
    """Seconds since the first frame; numbers of frames, where the file's times are none."""
    times = np.array([frame.time_us for frame in frames], dtype=float) * 1e-6
    steps = np.diff(times)
    least, most = USUAL_INTERVAL_S
    if not len(steps) or steps.min() <= 0 or not least <= np.median(steps) <= most:
        return [float(i) for i in range(len(frames))]
    return [float(t) for t in times - times[0]]


def _warnings(source: SensSource) -> list[str]:
    missing = source.header.n_frames - len(source.frames)
    if not missing:
        return []
    return [
        f"the file ends within frame {len(source.frames)} of {source.header.n_frames}: the frames before it "
        "are read; copy it again for the others"
    ]


def _exactly(data: bytes, n_bytes: int, path: Path) -> UInt8[np.ndarray, " n"]:
    if len(data) != n_bytes:
        raise ScanError(
            f"{path}: expected {n_bytes} bytes of image, found {len(data)}; copy the file again"
        )
    return np.frombuffer(data, np.uint8)
