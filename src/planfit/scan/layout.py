"""Formats as data: a `FolderLayout` says where images, poses and lenses are, and one reader executes it.

told_by -> recognised    frames -> Listing    lens, depth_lens -> lenses    write -> refined poses
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from jaxtyping import Float, UInt8

from planfit.errors import ScanError
from planfit.scan.images.files import ImageFiles
from planfit.scan.images.lens import Lens
from planfit.scan.images.video import Video, VideoImages
from planfit.scan.recording import Frame, LensOfFrame, Recording, Size
from planfit.scan.source import FileSource, FolderSource, ImageSource, fingerprint
from planfit.scan.tables import has_part
from planfit.scan.types import ScanOptions

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class ScanFormat:
    """What every format has."""

    name: str
    """As `--format` and `Scan.format` have it."""
    page: str
    """Its section of docs/scan-formats.md."""
    expects: str
    """What it is told by, in words."""
    checked: tuple[str, str]
    """Where it is known from, and what was checked with it."""


@dataclass(frozen=True, kw_only=True)
class WholeFile(ScanFormat):
    """A format of one file, or of a folder that a library opens, such as clouds, containers and databases.

    A file is told by its suffix or its first bytes; `claims_folder` tells folders.
    """

    suffixes: tuple[str, ...] = ()
    magic: bytes = b""
    open: Callable[[Path], Any]
    """What `read` takes; raises `ScanError` where the file is none, or its library is missing."""
    read: Callable[[Any, ScanOptions], Recording]
    """Lists a scan; raises `ScanError` where the file is damaged."""
    claims_folder: Callable[[Path], bool] | None = None
    takes_poses: bool = False
    """Whether `ScanOptions.poses` is part of the scan, and takes no place of other poses."""

    def claims(self, path: Path) -> bool:
        """Whether a path is of this format."""
        if path.is_dir():
            return self.claims_folder is not None and self.claims_folder(path)
        if not path.is_file():
            return False
        if path.suffix.lower() in self.suffixes:
            return True
        if not self.magic:
            return False
        with path.open("rb") as file:
            return file.read(len(self.magic)) == self.magic


@dataclass(frozen=True)
class Listing(Generic[T]):
    """What lies in a folder: its frames, and what lenses and the writing of poses need to know."""

    source: FileSource
    frames: Sequence[Frame]
    """In the order they were recorded."""
    content: T
    """Of the layout's own tables."""
    tables: Sequence[str] = ()
    """Files beside the images; the fingerprint changes with them."""
    skipped: Sequence[str] = ()
    """Frames that lack something, one line each."""
    warnings: Sequence[str] = ()
    """What to look at before trusting the scan."""
    video: Video | None = None
    """Where colour comes from a video: frames by the number at the end of their ids."""
    fingerprinted: tuple[object, ...] = ()
    """What beside files and options makes another scan."""


@dataclass(frozen=True)
class Refined(Generic[T]):
    """Refined poses of some frames, to be written into an existing folder."""

    content: T
    """Of the listing that the frames are of."""
    source: FileSource
    directory: Path
    frames: Sequence[Frame]
    poses: Float[np.ndarray, "k 4 4"]
    """world_from_cam, OpenCV camera axes."""


@dataclass(frozen=True, kw_only=True)
class FolderLayout(ScanFormat, Generic[T]):
    """A format of folders and archives: what a reader of all of them needs to know of this one.

    In patterns of names, `{}` stands for what tells frames apart.
    """

    told_by: tuple[str, ...] | Callable[[FileSource], bool]
    """Files, patterns and folders (with a slash) that all are there, one of several as `a|b`; or whatever
    tells the format."""
    frames: Callable[[FileSource, ScanOptions], Listing[T]]
    """Lists frames: `FileAFrame`, or a function. It raises `ScanError` where files are missing or damaged."""
    lens: Callable[[Listing[T]], LensOfFrame]
    """Of the colour camera: `SharedLens`, or a function of each frame (`each_frame`)."""
    write: Callable[[Refined[T]], None]
    """Writes refined poses in the format's own way."""
    parts: tuple[str, ...] = ()
    """What makes the format, as in `told_by`: where most is there, what is missing is named."""
    metres_per_unit: float | Callable[[Listing[T]], float] = 1e-3
    """Of depth that is stored as whole numbers."""
    metres_per_float: float | Callable[[Listing[T]], float] = 1.0
    """Of depth that is stored as floating-point numbers."""
    states_depth_unit: Callable[[Listing[T]], bool] = lambda _: False
    """Whether files of the scan say the unit of depth."""
    can_scale_depth: bool = True
    """Whether `--depth-scale` may say otherwise."""
    least_confidence: tuple[int, int, int] = (0, 1, 2)
    """Stored confidence that is at least low, medium and high."""
    depth_lens: Callable[[Listing[T]], LensOfFrame | None] | None = None
    """Of a depth camera of its own; without, depth shows what colour shows."""
    color_from_depth: Callable[[Listing[T]], Float[np.ndarray, "4 4"] | None] | None = None
    """Between the axes of two cameras that stand apart."""
    images: Callable[[ImageFiles, Listing[T]], ImageFiles] | None = None
    """Images that no plain reader of files decodes."""
    labels: Callable[[Listing[T]], Callable[[Frame], UInt8[np.ndarray, "h w"]] | None] | None = None
    """What pixels show, where the format knows it."""
    up_world: Float[np.ndarray, "3"] | None = None
    """Unit vector against gravity, where the format guarantees it."""
    plan_from_world_axes: Float[np.ndarray, "4 4"] | None = None
    """Where poses are recorded in the plan's axes."""
    floorplan: str = ""
    """Name of the plan beside the frames."""
    has_options_in_fingerprint: bool = True
    """Whether options of reading make another scan."""

    def recognise(self, source: FileSource) -> bool:
        """Whether a folder has this layout."""
        if callable(self.told_by):
            return self.told_by(source)
        return all(has_part(source, part) for part in self.told_by)

    def read(self, source: FileSource, options: ScanOptions) -> Recording:
        """List a scan.

        Raises:
            ScanError: its files are missing, unreadable, or contradict each other.
        """
        if options.depth_scale is not None and not self.can_scale_depth:
            raise ScanError(
                f"{source.path}: expected depth in millimetres, as this layout has it; "
                "leave out --depth-scale"
            )
        listing = self.frames(source, options)
        images = self._images(listing, options)
        read_options = (options,) if self.has_options_in_fingerprint else ()
        has_plan = self.floorplan and source.exists(self.floorplan)
        is_stated = options.depth_scale is not None or not self.can_scale_depth
        is_stated |= self.states_depth_unit(listing)
        files = list(dict.fromkeys((*listing.tables, *images.files(listing.frames))))

        def write_poses(
            directory: Path, written: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
        ) -> None:
            self.write(Refined(listing.content, source, directory, written, poses))

        return Recording(
            format=self.name,
            path=source.path,
            frames=listing.frames,
            images=images,
            color_lens=self.lens(listing),
            depth_lens=self.depth_lens(listing) if self.depth_lens else None,
            color_from_depth=self.color_from_depth(listing) if self.color_from_depth else None,
            write_poses=write_poses,
            fingerprint=fingerprint(images.source, files, *read_options, *listing.fingerprinted),
            labels=self.labels(listing) if self.labels else None,
            up_world=self.up_world,
            plan_from_world_axes=self.plan_from_world_axes,
            floorplan_path=source.locate(self.floorplan) if has_plan else None,
            depth_read_in_m=None if is_stated else images.metres_per_unit,
            skipped=listing.skipped,
            warnings=[*listing.warnings, *_linked(images.source, files)],
        )

    def _images(self, listing: Listing[T], options: ScanOptions) -> ImageFiles:
        unit, of_float = (
            options.depth_scale or (one(listing) if callable(one) else one)
            for one in (self.metres_per_unit, self.metres_per_float)
        )
        stored = {
            "source": listing.source,
            "metres_per_unit": unit,
            "min_confidence": self.least_confidence[options.min_confidence],
            "metres_per_float": of_float,
        }
        if listing.video is not None:
            return VideoImages(**stored, video=listing.video)
        plain = ImageFiles(**stored)
        return self.images(plain, listing) if self.images else plain


def _linked(source: ImageSource, files: Sequence[str]) -> list[str]:
    """That links lead out of the scan's folder, which its owner may have wanted, and nobody else."""
    if not isinstance(source, FolderSource) or not (out := source.linked_out(files)):
        return []
    return [
        f"{len(out)} of {len(files)} files are read outside of the scan's folder, where links lead ({out[0]} "
        f"is {source.locate(out[0]).resolve()}): look whether they are of this scan"
    ]


def each_frame(
    lens: Callable[[Listing[T], Frame, Size], Lens],
) -> Callable[[Listing[T]], LensOfFrame]:
    """`FolderLayout.lens` by what gives the lens of one frame for images of a size."""
    return lambda listing: partial(lens, listing)
