"""Scans whose images are files, one a frame: what is there, of what size, and whether it is whole."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planfit.errors import ScanError
from planfit.scan.corrupt_frames import MAX_DAMAGED_SHARE
from planfit.scan.images.images import (
    decode_color,
    decode_depth,
    decode_image,
    header_size,
    is_cut_off,
)
from planfit.scan.source import Source


@dataclass(frozen=True)
class Entry:
    """One frame as a reader lists it, before anyone has looked whether its files are there."""

    frame_id: str
    time: float
    world_from_cam: np.ndarray
    color: str
    depth: str
    confidence: str = ""


@dataclass(frozen=True)
class ImageFiles:
    """Stored images that are files of a source."""

    source: Source
    color_names: tuple[str, ...]
    depth_names: tuple[str, ...]
    metres_per_unit: float
    confidence_names: tuple[str, ...] = ()
    min_confidence: int = 0
    """In the unit of the stored confidence."""

    def color(self, frame_idx: int) -> np.ndarray:
        """(h, w, 3) uint8, RGB."""
        name = self.color_names[frame_idx]
        return decode_color(self.source.read(name), self.source.path / name)

    def depth(self, frame_idx: int) -> np.ndarray:
        """(h, w) float32 m."""
        name = self.depth_names[frame_idx]
        depth = decode_depth(self.source.read(name), self.metres_per_unit, self.source.path / name)
        if self.confidence_names and self.min_confidence > 0:
            name = self.confidence_names[frame_idx]
            if name:
                confidence = decode_image(self.source.read(name), self.source.path / name, -1)
                drop_unsure(depth, confidence, self.min_confidence, str(self.source.path / name))
        return depth


def drop_unsure(depth: np.ndarray, confidence: np.ndarray, least: int, where: str) -> None:
    """Set depth (h, w) to NaN, in place, where confidence (h, w) is below `least`.

    Raises:
        ScanError: the two do not have one size.
    """
    if confidence.shape != depth.shape:
        raise ScanError(
            f"{where}: expected confidence of {depth.shape[1]} x {depth.shape[0]} px as the depth, "
            f"found shape {confidence.shape}"
        )
    depth[confidence < least] = np.nan


@dataclass(frozen=True)
class Usable:
    """Entries whose files are there and begin and end as images do."""

    entries: tuple[Entry, ...]
    color_size: tuple[int, int]  # width, height
    depth_size: tuple[int, int]
    skipped: tuple[str, ...]
    """The others, one line each."""

    @property
    def names(self) -> list[str]:
        """All files, for the fingerprint."""
        return [
            name
            for entry in self.entries
            for name in (entry.color, entry.depth, entry.confidence)
            if name
        ]


def find_usable(source: Source, entries: Sequence[Entry]) -> Usable:
    """Entries that have colour and depth; all colour must be of one size, and all depth.

    Only headers and ends of files are looked at, so that long scans are listed in seconds.

    Raises:
        ScanError: sizes are mixed, or more than one file in a hundred is damaged.
    """
    kept: list[Entry] = []
    skipped: list[str] = []
    sizes: dict[str, tuple[int, int]] = {}
    first: dict[str, str] = {}
    damaged: list[ScanError] = []
    for entry in entries:
        missing = [
            name for name in (entry.color, entry.depth) if not name or not source.exists(name)
        ]
        if missing:
            skipped.append(f"frame {entry.frame_id}: {missing[0] or 'an image'} is missing")
            continue
        try:
            found = {
                kind: whole_image_size(source, name)
                for kind, name in (("colour", entry.color), ("depth", entry.depth))
            }
        except ScanError as error:
            damaged.append(error)
            skipped.append(f"frame {entry.frame_id}: {error}")
            continue
        for kind, size in found.items():
            name = entry.color if kind == "colour" else entry.depth
            if sizes.setdefault(kind, size) != size:
                raise ScanError(
                    f"{source.path / name}: expected {kind} of {sizes[kind][0]} x {sizes[kind][1]} px "
                    f"as {first[kind]}, found {size[0]} x {size[1]}; "
                    "all images of one camera must have one size"
                )
            first.setdefault(kind, name)
        kept.append(entry)
    if len(damaged) > MAX_DAMAGED_SHARE * len(entries):
        raise damaged[0]
    return Usable(
        tuple(kept),
        sizes.get("colour", (0, 0)),
        sizes.get("depth", (0, 0)),
        tuple(skipped),
    )


def whole_image_size(source: Source, name: str) -> tuple[int, int]:
    """(width, height) of an image file that begins and ends as images do.

    Raises:
        ScanError: it does not.
    """
    path = source.path / name
    if name.lower().endswith(".npy"):
        height, width = decode_depth(source.read(name), 1.0, path).shape
        return width, height
    head, tail = source.ends(name)
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
