"""Images that are files of a folder or archive, and those within one file, a container or a database: what is
there, of what size, and whether it is whole."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8

from planfit.errors import OutputError, ScanError
from planfit.scan.images.decode import (
    decode_color,
    decode_depth,
    decode_image,
    depth_from_metres,
    exr_size,
    header_size,
    is_cut_off,
    read_exr,
)
from planfit.scan.recording import Frame, Size
from planfit.scan.source import HEAD_BYTES, TAIL_BYTES, ImageSource


@dataclass(frozen=True)
class ImageFiles:
    """`StoredImages` where each image is a file, by the names that frames have."""

    source: ImageSource
    metres_per_unit: float
    """Of the stored depth."""
    min_confidence: int = 0
    """In the unit of the stored confidence; depth of less is left out."""
    metres_per_float: float = 1.0
    """Of depth that is stored as floating-point numbers, as `.npy` or EXR, which programs write in metres."""

    def missing(self, frame: Frame) -> tuple[str, ...]:
        """Images that are no files."""
        named = (frame.color, frame.depth)
        return tuple(name for name in named if name and not self.source.exists(name))

    def sizes(self, frame: Frame) -> tuple[Size, Size]:
        """Of colour and depth, from their headers."""
        named = [name for name in (frame.color, frame.depth) if name]
        sizes = [whole_image_size(self.source, name) for name in named]
        return sizes[0], sizes[-1]

    def warnings(self, frames: Sequence[Frame]) -> list[str]:
        """That files of confidence are missing; nothing where the recording has none at all."""
        names = [frame.confidence for frame in frames]
        missing = [name for name in names if name and not self.source.exists(name)]
        if self.min_confidence == 0 or not missing or len(missing) == len(names):
            return []
        return [
            f"{len(missing)} of {len(names)} frames have no confidence ({missing[0]} is missing): all of "
            "their depth is used"
        ]

    def color(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB."""
        return decode_color(self.source.read(frame.color), self.source.path / frame.color)

    def depth(self, frame: Frame) -> Float[np.ndarray, "h w"]:
        """float32 m, NaN where nothing was measured or the confidence is too low."""
        path = self.source.path / frame.depth
        if path.suffix.lower() == ".exr":
            values = read_exr(self.source.on_disk(frame.depth), path)
            depth = depth_from_metres(values * np.float32(self.metres_per_float))
        else:
            data = self.source.read(frame.depth)
            depth = decode_depth(data, self.metres_per_unit, path, self.metres_per_float)
        if self.uses_confidence(frame):
            path = self.source.path / frame.confidence
            confidence = decode_image(self.source.read(frame.confidence), path, -1)
            drop_unsure(depth, confidence, self.min_confidence, str(path))
        return depth

    def uses_confidence(self, frame: Frame) -> bool:
        """Whether depth of low confidence is to be left out of a frame, and can be."""
        return (
            self.min_confidence > 0
            and bool(frame.confidence)
            and self.source.exists(frame.confidence)
        )

    def files(self, frames: Sequence[Frame]) -> list[str]:
        """Images that are there, each once: all frames of a video are in one file."""
        named = (name for f in frames for name in (f.color, f.depth, f.confidence) if name)
        return [name for name in dict.fromkeys(named) if self.source.exists(name)]


def drop_unsure(
    depth: Float[np.ndarray, "h w"], confidence: np.ndarray, least: int, where: str
) -> None:
    """Set depth to NaN, in place, where confidence is below `least`.

    Raises:
        ScanError: the two do not have one size.
    """
    if confidence.shape != depth.shape:
        raise ScanError(
            f"{where}: expected confidence of {depth.shape[1]} x {depth.shape[0]} px as the depth, "
            f"found shape {confidence.shape}"
        )
    depth[confidence < least] = np.nan


def whole_image_size(source: ImageSource, name: str) -> Size:
    """Size of an image file that begins and ends as images do.

    Raises:
        ScanError: it does not.
    """
    path = source.path / name
    if name.lower().endswith((".npy", ".bin")):
        height, width = decode_depth(source.read(name), 1.0, path).shape
        return width, height
    head, tail = source.ends(name)
    if path.suffix.lower() == ".exr":
        return exr_size(head, path)
    if path.suffix.lower() in (".tif", ".tiff"):
        return header_size(source.read(name), path)  # what a header says may stand at the end
    try:
        size = header_size(head, path)
    except ScanError:
        size = header_size(source.read(name), path)  # thumbnails in a JPEG's header can be long
    if is_cut_off(head, tail):
        raise ScanError(
            f"{path}: expected a whole image, found one without an end; "
            "copy it again from the source"
        )
    return size


def write_image(
    path: Path, image: Shaped[np.ndarray, "h w *channels"], parameters: list[int]
) -> None:
    """Write an image, BGR where it is of colour, in the form of the suffix, by OpenCV's `parameters`.

    Raises:
        OutputError: OpenCV cannot encode it.
    """
    is_encoded, data = cv2.imencode(path.suffix, image, parameters)
    if not is_encoded:
        raise OutputError(f"{path}: the image cannot be encoded")
    path.write_bytes(data.tobytes())


class PackedSource(ABC):
    """One file as a place where images lie, `folder/number`, each read alone: a container or a database."""

    path: Path
    kind: str
    """What the file is, for messages."""

    @abstractmethod
    def n_bytes(self, name: str) -> int:
        """Length of an image.

        Raises:
            ScanError: there is none of this name.
        """

    @abstractmethod
    def part(self, name: str, begin: int, count: int) -> bytes:
        """Some bytes of an image.

        Raises:
            ScanError: they cannot be read.
        """

    def read(self, name: str) -> bytes:
        """See `ImageSource`."""
        return self.part(name, 0, self.n_bytes(name))

    def ends(self, name: str) -> tuple[bytes, bytes]:
        """See `ImageSource`; the rest of the image stays on the disk."""
        length = self.n_bytes(name)
        tail = min(length, TAIL_BYTES)
        return self.part(name, 0, min(length, HEAD_BYTES)), self.part(name, length - tail, tail)

    def on_disk(self, name: str) -> Path:
        """See `ImageSource`; no image of these formats needs it."""
        raise ScanError(f"{self.path}: expected {name} as a file, found it in a {self.kind}")
