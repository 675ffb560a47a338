"""Readers whose frames are image files share this: from entries and lenses to a recording."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planfit.errors import ScanError
from planfit.scan.frames import Recording, scan_from
from planfit.scan.images.image_files import Entry, ImageFiles, find_usable
from planfit.scan.images.lens import Lens
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source, fingerprint
from planfit.scan.types import Scan

EntryWriter = Callable[[Path, Sequence[Entry], np.ndarray], None]
"""Writes poses (k, 4, 4) of entries (k) into an existing folder, in the format's own way."""

MAX_ASPECT_DEFECT = 0.02
"""Colour and depth whose proportions differ by more do not show the same view."""


@dataclass(frozen=True)
class Layout:
    """What a reader knows of its format and found in a folder."""

    kind: str
    entries: Sequence[Entry]
    metres_per_unit: float
    write_poses: EntryWriter
    color_lens: Callable[[Entry, tuple[int, int]], Lens]
    """Lens of a frame's colour image of a size (width, height) px."""
    depth_lens: Callable[[Entry, tuple[int, int]], Lens] | None = None
    """The same of its depth; without, depth shows what the colour shows, in another size."""
    other_files: Sequence[str] = ()
    """Tables and calibrations that were read, for the fingerprint."""
    up_world: np.ndarray | None = None
    skipped: Sequence[str] = ()
    least_confidence: int = 0
    """Depth of less confidence, in stored units, is left out."""
    warnings: Sequence[str] = ()
    color_from_depth: np.ndarray | None = None
    """(4, 4) between the axes of two cameras that stand apart; needs `depth_lens`."""

    def __post_init__(self) -> None:
        if self.color_from_depth is not None and self.depth_lens is None:
            raise ValueError("a depth camera of its own needs a lens of its own")


def scan_of_layout(source: Source, layout: Layout, options: ScanOptions) -> Scan:
    """The scan of a layout; frames without pose, colour or depth are left out and named.

    Raises:
        ScanError: no frames are left, or their files contradict each other.
    """
    lost = [e for e in layout.entries if not np.isfinite(e.world_from_cam).all()]
    posed = [e for e in layout.entries if np.isfinite(e.world_from_cam).all()]
    usable = find_usable(source, posed)
    skipped = [
        *layout.skipped,
        *(f"frame {entry.frame_id}: the tracker had no pose" for entry in lost),
        *usable.skipped,
    ]
    entries = usable.entries
    color_lenses = [layout.color_lens(entry, usable.color_size) for entry in entries]
    if layout.depth_lens is not None:
        depth_lenses = [layout.depth_lens(entry, usable.depth_size) for entry in entries]
    else:
        if entries:
            check_proportions(usable.color_size, usable.depth_size, str(source.path))
        depth_lenses = [lens.scaled(*usable.depth_size) for lens in color_lenses]
    for entry, color, depth in zip(entries, color_lenses, depth_lenses, strict=True):
        _check_lens(source, entry.color, usable.color_size, color)
        _check_lens(source, entry.depth, usable.depth_size, depth)
    warnings = [*layout.warnings]
    if layout.least_confidence > 0:
        warnings += missing_confidence(source, [e.confidence for e in entries])
    images = ImageFiles(
        source,
        tuple(entry.color for entry in entries),
        tuple(entry.depth for entry in entries),
        options.depth_scale or layout.metres_per_unit,
        tuple(
            e.confidence if e.confidence and source.exists(e.confidence) else "" for e in entries
        ),
        layout.least_confidence,
    )

    def write_poses(directory: Path, frame_idx: np.ndarray, poses: np.ndarray) -> None:
        layout.write_poses(directory, [entries[i] for i in frame_idx], poses)

    files = [*layout.other_files, *(n for n in usable.names if source.exists(n))]
    recording = Recording(
        frame_ids=[entry.frame_id for entry in entries],
        times=np.array([entry.time for entry in entries], dtype=float),
        world_from_cams=np.array([entry.world_from_cam for entry in entries]).reshape(-1, 4, 4),
        images=images,
        color_lenses=color_lenses,
        depth_lenses=depth_lenses,
        write_poses=write_poses,
        fingerprint=fingerprint(source, files, layout.kind, options),
        up_world=layout.up_world,
        skipped=skipped,
        warnings=warnings,
        color_from_depth=layout.color_from_depth,
    )
    return scan_from(source.path, layout.kind, recording, options)


def missing_confidence(source: Source, names: Sequence[str]) -> list[str]:
    """A warning where files of confidence are missing; none where the recording has none at all."""
    missing = [name for name in names if name and not source.exists(name)]
    if not missing or len(missing) == len(names):
        return []
    return [
        f"{len(missing)} of {len(names)} frames have no confidence ({missing[0]} is missing): all of their "
        "depth is used"
    ]


def check_proportions(color_size: tuple[int, int], depth_size: tuple[int, int], name: str) -> None:
    """Raise `ScanError` unless colour and depth (width, height) have the same proportions."""
    defect = color_size[0] * depth_size[1] / (color_size[1] * depth_size[0]) - 1
    if abs(defect) > MAX_ASPECT_DEFECT:
        raise ScanError(
            f"{name}: expected depth that shows what the colour shows, found colour of "
            f"{color_size[0]} x {color_size[1]} px and depth of {depth_size[0]} x {depth_size[1]}; "
            "register depth to colour, or give the depth camera's intrinsics where the format has them"
        )


MAX_DISTORTION = 1e3
"""Coefficients of real lenses are below 100."""


def _check_lens(source: Source, name: str, size: tuple[int, int], lens: Lens) -> None:
    if not all(abs(v) < MAX_DISTORTION for v in lens.distortion):
        raise ScanError(
            f"{source.path / name}: expected finite distortion of its lens, found "
            f"{', '.join(f'{v:g}' for v in lens.distortion)}; export the calibration again"
        )
    if (lens.camera.width, lens.camera.height) != size:
        raise ScanError(
            f"{source.path / name}: expected {lens.camera.width} x {lens.camera.height} px as the "
            f"intrinsics say, found {size[0]} x {size[1]}; resample it or correct the intrinsics"
        )
