"""Record3D's `.r3d`: a zip archive, or the folder it unpacks to.

    metadata                  JSON: w h, dw dh, K (3x3 by column), perFrameIntrinsicCoeffs [[fx fy cx cy]],
                              poses [[qx qy qz qw tx ty tz]] (world_from_cam, ARKit), frameTimestamps or fps
    rgbd/N.jpg, N.depth, N.conf     colour; float32 metres and uint8 confidence (0 1 2), LZFSE, dh x dw

Intrinsics are those of the colour image. Whether the world is level is not told, so gravity is found from
the depth. The app's export as EXR and JPG is not read: share the `.r3d`.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.axes import from_opengl
from planfit.scan.frames import Recording, make_camera, scan_from
from planfit.scan.images.image_files import drop_unsure, whole_image_size
from planfit.scan.images.images import decode_color, depth_from_metres
from planfit.scan.images.lens import Lens
from planfit.scan.images.lzfse import decompress
from planfit.scan.layout import check_proportions
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source, fingerprint
from planfit.scan.tables import number_list, read_json
from planfit.scan.types import MAX_ENTRY, Scan

LOOKS_FOR = "metadata and rgbd/N.jpg, N.depth (a .r3d)"
METADATA = "metadata"
PARTS = (METADATA, "rgbd/")


def recognise(source: Source) -> bool:
    """Whether an archive or folder has this layout."""
    return source.exists(METADATA) and any(n.endswith(".depth") for n in source.names("rgbd"))


@dataclass(frozen=True)
class Record3dImages:
    """Images inside the archive."""

    source: Source
    numbers: tuple[int, ...]
    depth_width: int
    depth_height: int
    metres_per_unit: float
    min_confidence: int

    def color(self, frame_idx: int) -> np.ndarray:
        """(h, w, 3) uint8, RGB."""
        name = f"rgbd/{self.numbers[frame_idx]}.jpg"
        return decode_color(self.source.read(name), self.source.path / name)

    def depth(self, frame_idx: int) -> np.ndarray:
        """(h, w) float32 m."""
        name = f"rgbd/{self.numbers[frame_idx]}"
        values = self._plane(f"{name}.depth", np.dtype("<f4"))
        depth = depth_from_metres(values * np.float32(self.metres_per_unit))
        if self.min_confidence > 0 and self.source.exists(f"{name}.conf"):
            confidence = self._plane(f"{name}.conf", np.dtype("u1"))
            drop_unsure(depth, confidence, self.min_confidence, f"{self.source.path / name}.conf")
        return depth

    def _plane(self, name: str, kind: np.dtype) -> np.ndarray:
        n_bytes = self.depth_width * self.depth_height * kind.itemsize
        data = decompress(self.source.read(name), n_bytes, self.source.path / name)
        return np.frombuffer(data, dtype=kind).reshape(self.depth_height, self.depth_width)


def read(source: Source, options: ScanOptions) -> Scan:
    """Read a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    where = str(source.path / METADATA)
    content = read_json(source, METADATA)
    poses = _poses(content, where)
    width, height = _size(content, ("w", "h"), (720, 960), where)
    # Files of the first versions do not say the size of the depth; it was 192 x 256 then.
    depth_size = _size(content, ("dw", "dh"), (192, 256) if height > width else (256, 192), where)
    check_proportions((width, height), depth_size, where)
    numbers, skipped = [], []
    for i in range(len(poses)):
        missing = [name for name in (f"rgbd/{i}.jpg", f"rgbd/{i}.depth") if not source.exists(name)]
        if missing:
            skipped.append(f"frame {i}: {missing[0]} is missing")
        else:
            numbers.append(i)
    if numbers:
        found = whole_image_size(source, f"rgbd/{numbers[0]}.jpg")
        if found != (width, height):
            raise ScanError(
                f"{source.path}: expected colour of {width} x {height} px as metadata says, found "
                f"{found[0]} x {found[1]}"
            )
    lenses = [
        Lens(make_camera(width, height, _intrinsics(content, i, where), where)) for i in numbers
    ]

    def write_poses(directory: Path, frame_idx: np.ndarray, refined: np.ndarray) -> None:
        _write(directory / METADATA, content, [numbers[i] for i in frame_idx], refined)

    names = [f"rgbd/{i}.{end}" for i in numbers for end in ("jpg", "depth")]
    recording = Recording(
        frame_ids=[str(i) for i in numbers],
        times=_times(content, len(poses), where)[numbers],
        world_from_cams=poses[numbers],
        images=Record3dImages(
            source,
            tuple(numbers),
            *depth_size,
            options.depth_scale or 1.0,
            options.min_confidence,
        ),
        color_lenses=lenses,
        depth_lenses=[lens.scaled(*depth_size) for lens in lenses],
        write_poses=write_poses,
        fingerprint=fingerprint(source, [METADATA, *names], options),
        skipped=skipped,
    )
    return scan_from(source.path, "record3d", recording, options)


def _poses(content: dict[str, Any], where: str) -> np.ndarray:
    listed = content.get("poses")
    if not isinstance(listed, list) or not listed:
        raise ScanError(
            f"{where}: expected a list `poses`, found none; record with camera tracking"
        )
    rows = np.array([number_list(row, 7, f"{where}, pose {i}") for i, row in enumerate(listed)])
    largest = np.abs(rows[:, :4]).max(axis=1)
    lost = ~(np.abs(rows) < MAX_ENTRY).all(axis=1) | (largest < 1e-6)
    if lost.any():
        raise ScanError(f"{where}: expected finite poses, found none in pose {np.argmax(lost)}")
    turns = Rotation.from_quat(rows[:, :4]).as_matrix()
    return from_opengl(se3.make_transform(turns, rows[:, 4:]))


def _size(
    content: dict[str, Any], keys: tuple[str, str], default: tuple[int, int], where: str
) -> tuple[int, int]:
    try:
        width, height = (int(content.get(k, v)) for k, v in zip(keys, default, strict=True))
    except (TypeError, ValueError) as error:
        raise ScanError(f"{where}: expected sizes {keys}, found {error}") from error
    if not (0 < width < 20_000 and 0 < height < 20_000):
        raise ScanError(f"{where}: expected sizes above 0, found {keys} {width}, {height}")
    return width, height


def _intrinsics(content: dict[str, Any], number: int, where: str) -> tuple[float, ...]:
    each = content.get("perFrameIntrinsicCoeffs")
    if isinstance(each, list) and number < len(each):
        own = each[number][:4] if isinstance(each[number], list) else each[number]
        return tuple(number_list(own, 4, f"{where}, perFrameIntrinsicCoeffs"))
    k = number_list(content.get("K"), 9, f"{where}, K")
    return (k[0], k[4], k[6], k[7])


def _times(content: dict[str, Any], count: int, where: str) -> np.ndarray:
    if content.get("frameTimestamps"):
        return number_list(content["frameTimestamps"], count, f"{where}, frameTimestamps")
    rate = float(number_list(content.get("fps") or 1.0, 1, f"{where}, fps")[0])
    if not rate > 0:
        raise ScanError(f"{where}: expected fps above 0, found {rate}")
    return np.arange(count) / rate


def _write(
    path: Path, content: dict[str, Any], numbers: Sequence[int], refined: np.ndarray
) -> None:
    """metadata with refined poses; those of frames that were left out stay as recorded."""
    listed = [list(row) for row in content["poses"]]
    turned = from_opengl(refined)
    quaternions = Rotation.from_matrix(turned[:, :3, :3]).as_quat(canonical=True)
    for number, pose, xyzw in zip(numbers, turned, quaternions, strict=True):
        listed[number] = [*xyzw.tolist(), *pose[:3, 3].tolist()]
    path.write_text(json.dumps({**content, "poses": listed}) + "\n")
