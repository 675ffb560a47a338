"""Record3D's recordings: numbered images, all else in one JSON, depth packed with LZFSE."""

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.images.decode import depth_from_metres
from planfit.scan.images.files import ImageFiles, drop_unsure, whole_image_size
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.layout import FolderLayout, Listing, Refined, each_frame
from planfit.scan.poses import MAX_ENTRY, ROUNDING, followed, from_opengl
from planfit.scan.recording import Frame, Size
from planfit.scan.source import FileSource
from planfit.scan.tables import number_list, read_json
from planfit.scan.types import ScanOptions
from planfit.scan.usable_frames import check_proportions


@dataclass(frozen=True)
class _Export:
    """Names of what an export consists of; frames are numbered from 0."""

    metadata: str
    color: str
    depth: str
    confidence: str = ""

    def frame_names(self, number: int) -> tuple[str, str, str]:
        """Colour, depth and confidence of a frame."""
        return tuple(name.format(number) for name in (self.color, self.depth, self.confidence))  # type: ignore[return-value]


R3D = _Export("metadata", "rgbd/{}.jpg", "rgbd/{}.depth", "rgbd/{}.conf")
EXR = (
    _Export("metadata.json", "rgb/{}.jpg", "depth/{}.exr"),
    _Export("metadata.json", "rgb/{}.png", "depth/{}.exr"),
)

_END, _PLAIN = b"bvx$", b"bvx-"
"""Marks of an LZFSE stream: its end, and a block stored without compression."""


@dataclass(frozen=True)
class _Metadata:
    """What the JSON says; `where` begins messages."""

    export: _Export
    content: dict[str, Any]
    where: str
    color_size: Size
    depth_size: Size


def _export(source: FileSource) -> _Export | None:
    if source.exists(R3D.metadata) and any(n.endswith(".depth") for n in source.names("rgbd")):
        return R3D
    if not source.exists(EXR[0].metadata) or not any(
        name.endswith(".exr") for name in source.names("depth")
    ):
        return None
    has_png = any(name.endswith(".png") for name in source.names("rgb"))
    return EXR[1] if has_png else EXR[0]


@dataclass(frozen=True, kw_only=True)
class Record3dImages(ImageFiles):
    """Colour out of JPEG files; depth and confidence out of compressed planes, all of one size."""

    color_size: Size
    depth_size: Size

    def sizes(self, frame: Frame) -> tuple[Size, Size]:  # noqa: ARG002
        """As the metadata tell them: planes have no header, and an archive's images would be unpacked."""
        return self.color_size, self.depth_size

    def depth(self, frame: Frame) -> Float[np.ndarray, "h w"]:
        """float32 m, NaN where nothing was measured or the confidence is too low."""
        if frame.depth.endswith(".exr"):
            return super().depth(frame)
        values = self._plane(frame.depth, np.dtype("<f4"))
        depth = depth_from_metres(values * np.float32(self.metres_per_unit))
        if self.uses_confidence(frame):
            confidence = self._plane(frame.confidence, np.dtype("u1"))
            where = str(self.source.path / frame.confidence)
            drop_unsure(depth, confidence, self.min_confidence, where)
        return depth

    def _plane(self, name: str, kind: np.dtype) -> np.ndarray:
        width, height = self.depth_size
        n_bytes = width * height * kind.itemsize
        data = _decompress(self.source.read(name), n_bytes, self.source.path / name)
        return np.frombuffer(data, dtype=kind).reshape(height, width)


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Metadata]:  # noqa: ARG001
    export = _export(source) or R3D
    where = str(source.path / export.metadata)
    content = read_json(source, export.metadata)
    poses = _poses(content, where)
    times = _times(content, len(poses), where)
    width, height = color_size = _size(content, ("w", "h"), (720, 960), where)
    # Files of the first versions do not say the size of the depth; it was 192 x 256 then.
    depth_size = _size(content, ("dw", "dh"), (192, 256) if height > width else (256, 192), where)
    check_proportions(color_size, depth_size, where)
    frames = [
        Frame(str(i), float(time), pose, *export.frame_names(i))
        for i, (time, pose) in enumerate(zip(times, poses, strict=True))
    ]
    first = next((frame.color for frame in frames if source.exists(frame.color)), None)
    if first is not None and (found := whole_image_size(source, first)) != color_size:
        raise ScanError(
            f"{source.path}: expected colour of {width} x {height} px as metadata says, found "
            f"{found[0]} x {found[1]}"
        )
    metadata = _Metadata(export, content, where, color_size, depth_size)
    return Listing(source, frames, metadata, [export.metadata])


def _images(plain: ImageFiles, listing: Listing[_Metadata]) -> ImageFiles:
    metadata = listing.content
    return Record3dImages(
        **vars(plain), color_size=metadata.color_size, depth_size=metadata.depth_size
    )


def _lens(listing: Listing[_Metadata], frame: Frame, size: Size) -> Lens:
    content, where = listing.content.content, listing.content.where
    return Lens(make_camera(*size, _intrinsics(content, int(frame.frame_id), where), where))


def _poses(content: dict[str, Any], where: str) -> Float[np.ndarray, "n 4 4"]:
    listed = content.get("poses")
    if not isinstance(listed, list) or not listed:
        raise ScanError(
            f"{where}: expected a list `poses`, found none; record with camera tracking"
        )
    rows = np.array([number_list(row, 7, f"{where}, pose {i}") for i, row in enumerate(listed)])
    largest = np.abs(rows[:, :4]).max(axis=1)
    lost = ~(np.abs(rows) < MAX_ENTRY).all(axis=1) | (largest < ROUNDING)
    if lost.any():
        raise ScanError(f"{where}: expected finite poses, found none in pose {np.argmax(lost)}")
    rotations = Rotation.from_quat(rows[:, :4]).as_matrix()
    return from_opengl(se3.make_transform(rotations, rows[:, 4:]))


def _size(content: dict[str, Any], keys: tuple[str, str], default: Size, where: str) -> Size:
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
    k = number_list(content.get("K"), 9, f"{where}, K")  # by column
    return (k[0], k[4], k[6], k[7])


def _times(content: dict[str, Any], count: int, where: str) -> Float[np.ndarray, " n"]:
    if content.get("frameTimestamps"):
        return number_list(content["frameTimestamps"], count, f"{where}, frameTimestamps")
    rate = float(number_list(content.get("fps") or 1.0, 1, f"{where}, fps")[0])
    if not rate > 0:
        raise ScanError(f"{where}: expected fps above 0, found {rate}")
    return np.arange(count) / rate


def _write(refined: Refined[_Metadata]) -> None:
    """metadata with refined poses; frames that were left out, which it counts, follow their neighbours."""
    metadata = refined.content
    recorded = dict(enumerate(_poses(metadata.content, metadata.where)))
    numbers = [int(frame.frame_id) for frame in refined.frames]
    poses = followed(recorded, dict(zip(numbers, refined.poses, strict=True)))
    gl_poses = from_opengl(np.stack([poses[number] for number in recorded]))
    quaternions = Rotation.from_matrix(gl_poses[:, :3, :3]).as_quat(canonical=True)
    listed = np.concatenate([quaternions, gl_poses[:, :3, 3]], axis=1).tolist()
    path = refined.directory / metadata.export.metadata
    path.write_text(json.dumps({**metadata.content, "poses": listed}) + "\n")


def _decompress(data: bytes, n_bytes: int, path: Path) -> bytes:
    """A stream of Apple's LZFSE that unpacks to `n_bytes`; without compression, no library is needed.

    Raises:
        ScanError: it unpacks to another size, is damaged, or pyliblzfse is needed and missing.
    """
    if len(data) == n_bytes:
        return data
    if not data.startswith(b"bvx"):
        raise ScanError(
            f"{path}: expected {n_bytes} bytes or an LZFSE stream, found {len(data)} other bytes; "
            "export the recording again"
        )
    found = _plain_blocks(data)
    if found is None:
        found = _by_library(data, path)
    if len(found) != n_bytes:
        raise ScanError(
            f"{path}: expected {n_bytes} bytes after unpacking, found {len(found)}; "
            "export the recording again"
        )
    return found


def _plain_blocks(data: bytes) -> bytes | None:
    """The content of a stream of stored blocks alone; None where a block is compressed."""
    blocks, at = [], 0
    while data[at : at + 4] == _PLAIN and at + 8 <= len(data):
        (size,) = struct.unpack_from("<I", data, at + 4)
        blocks.append(data[at + 8 : at + 8 + size])
        at += 8 + size
    return b"".join(blocks) if data[at : at + 4] == _END else None


def _by_library(data: bytes, path: Path) -> bytes:
    try:
        import liblzfse  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ScanError(
            f"{path}: expected the library pyliblzfse for depth of Record3D, found none; pip "
            "install 'planfit[record3d]'"
        ) from error
    try:
        return liblzfse.decompress(data)
    except Exception as error:  # the library's own error class is not documented
        raise ScanError(
            f"{path}: expected an LZFSE stream, found a damaged one ({error})"
        ) from error


RECORD3D = FolderLayout(
    name="record3d",
    page="""Record3D: its `.r3d`, a zip archive or the folder it unpacks to, and its export as EXR and JPG.

    metadata, metadata.json   JSON: w h, dw dh, K (3x3 by column), perFrameIntrinsicCoeffs [[fx fy cx cy]],
                              poses [[qx qy qz qw tx ty tz]] (world_from_cam, axes of OpenGL as the image is
                              stored, upright too), frameTimestamps or fps
    rgbd/N.jpg, N.depth, N.conf     .r3d: colour; float32 metres and uint8 confidence (0 1 2), LZFSE, dh x dw
    rgb/N.jpg (.png), depth/N.exr   EXR and JPG: colour; one channel of half floats, metres

Intrinsics are those of the colour image. Whether the world is level is not told, so gravity is found from
the depth. Recordings of the front camera have no poses: all of them are the identity.
""",
    expects="metadata and rgbd/N.jpg, N.depth (a .r3d), or metadata.json, rgb/N.jpg and depth/N.exr",
    checked=(
        "nerfstudio's record3d_utils.py; a real export as EXR and JPG (345 poses, 2 frames). "
        "No real .r3d",
        "order of quaternions, K by column, poses of upright images, half floats in metres",
    ),
    told_by=lambda source: _export(source) is not None,
    parts=("metadata", "rgbd/"),
    frames=_frames,
    metres_per_unit=1.0,
    states_depth_unit=lambda _: True,
    images=_images,
    lens=each_frame(_lens),
    write=_write,
)
