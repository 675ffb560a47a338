"""What layouts are put together from: names as patterns, pairings of images and poses, lenses by files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan.images.lens import make_camera, matrix_intrinsics
from planfit.scan.layout import Listing, Refined
from planfit.scan.poses import check_recorded_pose, read_pose, write_pose
from planfit.scan.recording import Frame, LensOfFrame, pinhole_lens
from planfit.scan.source import FileSource, in_order
from planfit.scan.tables import Names, first_of, read_matrix
from planfit.scan.types import ScanOptions

T = TypeVar("T")
Poses = Float[np.ndarray, "n 4 4"]


@dataclass(frozen=True)
class Posed(Generic[T]):
    """What a file says of one frame."""

    world_from_cam: Float[np.ndarray, "4 4"]
    content: T
    """For the lens, and for the writing of poses."""
    time: float | None = None
    """s; None: frames are counted."""


@dataclass(frozen=True)
class TextPoses:
    """Poses as files of text, a 4x4 matrix each: world_from_cam, OpenCV camera axes."""

    pattern: str
    """Of the names of files that are written."""

    @staticmethod
    def read(source: FileSource, name: str) -> Posed[None]:
        """See `FileAFrame.read`."""
        return Posed(read_pose(source, name), None)

    def write(self, refined: Refined[Any]) -> None:
        """A file for each frame of these."""
        self.write_into(refined.directory, refined.frames, refined.poses)

    def write_into(
        self, directory: Path, frames: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
    ) -> None:
        """As `write`, for formats that are no folders."""
        for frame, pose in zip(frames, poses, strict=True):
            write_pose(directory / self.pattern.format(frame.frame_id), pose)


@dataclass(frozen=True)
class FileAFrame(Generic[T]):
    """Frames whose images and poses are a file each: a pairing by name.

    The content of the listing is what the files of poses say, by the frames' ids.
    """

    color: Names
    """One pattern for each way to name colour; the first is the one that messages name."""
    depth: Names
    poses: str
    """Pattern of the files of poses."""
    read: Callable[[FileSource, str], Posed[T]]
    """Parser of a file of poses, by its name."""
    confidence: str = ""
    tables: tuple[str, ...] = ()
    """Files for all frames; those that are there, one of several as `a|b`."""
    key: str = r"\d+"
    """What stands for `{}` in the names of poses, as a regular expression."""

    def __call__(self, source: FileSource, options: ScanOptions, folder: str = "") -> Listing:  # noqa: ARG002
        """Frames in the order of their keys; names are relative to `folder`, which ends with a slash."""
        colors, depths = (one.by_key(source, folder) for one in (self.color, self.depth))
        posed_keys = Names(self.poses, key=self.key).by_key(source, folder)
        frames, skipped, content = [], [], {}
        for i, key in enumerate(sorted({**colors, **depths, **posed_keys}, key=in_order)):
            poses = self.poses.format(key)
            if not source.exists(folder + poses):
                skipped.append(f"frame {key}: {poses} is missing")
                continue
            posed = self.read(source, folder + poses)
            content[key] = posed.content
            counted = float(key) if key.isdecimal() else float(i)
            frames.append(
                Frame(
                    key,
                    counted if posed.time is None else posed.time,
                    posed.world_from_cam,
                    folder + colors.get(key, self.color.of(key)[0]),
                    folder + depths.get(key, self.depth.of(key)[0]),
                    folder + self.confidence.format(key) if self.confidence else "",
                )
            )
        tables = [folder + self.poses.format(frame.frame_id) for frame in frames]
        return Listing(
            source,
            frames,
            content,
            [*(n for part in self.tables for n in part.split("|") if source.exists(n)), *tables],
            skipped,
        )


@dataclass(frozen=True)
class RowAFrame:
    """Frames whose images are numbered and whose poses are the rows of one table: a pairing by number.

    The content of the listing is the table: world_from_cam, OpenCV camera axes, 16 numbers a row.
    """

    color: Names
    depth: Names
    poses: str
    """Name of the table."""
    tables: tuple[str, ...] = ()
    """Other files for all frames; those that are there."""

    def __call__(self, source: FileSource, options: ScanOptions) -> Listing[Poses]:  # noqa: ARG002
        """Frames in the order of their numbers, from 0."""
        table = read_matrix(source, self.poses, "16 numbers a line")
        if table.shape[1] != 16:
            raise ScanError(
                f"{source.path / self.poses}: expected 16 numbers a line, found {table.shape[1]}"
            )
        poses = table.reshape(-1, 4, 4)
        frames, skipped = [], []
        colors, depths = self.color.by_key(source), self.depth.by_key(source)
        for key in sorted({**colors, **depths}, key=in_order):
            number = int(key)
            if number >= len(poses):
                skipped.append(f"frame {key}: {self.poses} has only {len(poses)} rows")
                continue
            check_recorded_pose(poses[number], f"{source.path / self.poses}, row {number}")
            color, depth = colors.get(key, self.color.of(key)[0]), depths.get(key, "")
            frames.append(Frame(key, float(number), poses[number], color, depth))
        tables = [self.poses, *(name for name in self.tables if source.exists(name))]
        return Listing(source, frames, poses, tables, skipped)

    def write(self, refined: Refined[Poses]) -> None:
        """The table again; rows of frames that are left out stay as recorded."""
        rows = refined.content.copy()
        rows[[int(frame.frame_id) for frame in refined.frames]] = refined.poses
        lines = [" ".join(f"{v:.10g}" for v in row.ravel()) for row in rows]
        (refined.directory / self.poses).write_text("\n".join(lines) + "\n")


@dataclass(frozen=True)
class SharedLens:
    """A pinhole lens of all frames, by a file that holds a matrix or fx fy cx cy."""

    name: str
    """Of the file; one of several, as `a|b`."""
    expected: str = "a 3x3 matrix of intrinsics"
    """In words, for messages."""
    separator: str | None = None
    """Between numbers; None: blanks."""

    def __call__(self, listing: Listing[Any]) -> LensOfFrame:
        """Of the frames of a listing."""
        source = listing.source
        return pinhole_lens(self.numbers(source), str(source.path / self.file(source)))

    def file(self, source: FileSource) -> str:
        """Name of the file that is there, or what it should be."""
        return first_of(source, self.name.split("|"))

    def numbers(self, source: FileSource) -> tuple[float, ...]:
        """fx fy cx cy.

        Raises:
            ScanError: the file holds neither.
        """
        name = self.file(source)
        matrix = read_matrix(source, name, self.expected, self.separator)
        if matrix.size == 4:
            return tuple(matrix.ravel().tolist())
        return matrix_intrinsics(matrix, str(source.path / name))


def read_camera(source: FileSource, name: str) -> Camera:
    """The camera of a file that holds w h fx fy cx cy.

    Raises:
        ScanError: it holds other numbers.
    """
    values = read_matrix(source, name, "six numbers (w h fx fy cx cy)").ravel().tolist()
    where = str(source.path / name)
    if len(values) != 6:
        raise ScanError(f"{where}: expected six numbers (w h fx fy cx cy), found {len(values)}")
    return make_camera(values[0], values[1], values[2:], where)
