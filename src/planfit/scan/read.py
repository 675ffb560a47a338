"""`read_scan`: from a path to a scan, whatever its format.

path -> reader of its format -> Recording -> lens of a file -> Scan -> poses of another tracker -> corrupt
frames tolerated -> calibration
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError, ScanError
from planfit.runtime import archive_of, require_content
from planfit.scan.formats import LAST, READERS, format_of, layouts, whole_files
from planfit.scan.images.decode import N_DEPTH_FRAMES, USUAL_DEPTH_M
from planfit.scan.layout import FolderLayout
from planfit.scan.lens_file import read_lens, take_calibration
from planfit.scan.no_scan import is_of_known, no_scan_in_file, no_scan_in_folder
from planfit.scan.pose_files import take_poses
from planfit.scan.recording import Recording
from planfit.scan.source import FileSource, ZipSource, open_source
from planfit.scan.types import Scan, ScanOptions
from planfit.scan.usable_frames import scan_from_recording
from planfit.scan.views import tolerate_corrupt_frames


def read_scan(path: str | Path, use_masks: bool = True, options: ScanOptions | None = None) -> Scan:
    """Read a posed RGB-D scan; the format is recognised by what lies in the folder (docs/formats.md).

    Args:
        path: folder of the scan, zip archive of one, or bag.
        use_masks: whether floor and wall masks that lie beside the images are used.
        options: how to read it.

    Raises:
        ScanError: the scan is missing, of an unknown layout, or its files cannot be used.
        OptionError: there is no format of the name that `options` ask for.
    """
    path, options = Path(path), options or ScanOptions()
    options = replace(options, use_masks=use_masks and options.use_masks)
    _check_path(path)
    recording, has_taken_poses = _read(path, options)
    if options.intrinsics and recording.format != "bag":  # which may name a topic
        recording = replace(recording, color_lens=read_lens(Path(options.intrinsics)))
    scan = scan_from_recording(recording, options)
    if options.poses is not None and not has_taken_poses:
        scan = take_poses(scan, options.poses, options.max_time_gap_s)
    scan = tolerate_corrupt_frames(scan)
    if options.calibration is not None:
        scan = take_calibration(scan, options.calibration)
    return replace(scan, warnings=(*scan.warnings, *check_depth_unit(scan)))


def median_depth_m(scan: Scan) -> float | None:
    """Depth in the middle of the frames, by nine of them; None where none of these can be read.

    Raises:
        ScanError: nothing was measured in any of these frames.
    """
    medians, n_read = [], 0
    for _, depth in depth_of_nine(scan):
        n_read += 1
        known = depth[np.isfinite(depth)]
        if len(known):
            medians.append(float(np.median(known)))
    if not medians and n_read:
        raise ScanError(
            f"{scan.name}: expected depth, found no measurement in any of the {n_read} frames looked at; "
            "export the scan again with depth"
        )
    return float(np.median(medians)) if medians else None


def depth_of_nine(scan: Scan) -> Iterator[tuple[int, Float[np.ndarray, "h w"]]]:
    """Nine frames from all over the scan, and their depth in m; without those that cannot be read."""
    having = np.flatnonzero(np.array(scan.lacking) != "depth")
    for i in having[np.unique(np.linspace(0, len(having) - 1, N_DEPTH_FRAMES).astype(int))]:
        try:
            depth = scan.files.depth(int(i))
        except ScanError:
            continue  # told when a stage asks for the frame
        yield int(i), depth


def check_depth_unit(scan: Scan) -> list[str]:
    """Warnings about the depth of a scan, from nine of its frames: nothing, or a unit that cannot be right.

    Raises:
        ScanError: nothing was measured in any of these frames.
    """
    middle = median_depth_m(scan)
    near_m, far_m = USUAL_DEPTH_M
    if middle is None or near_m <= middle <= far_m:
        return []
    return [
        f"half of the depth is below {middle:.3g} m, where {near_m:g} to {far_m:g} m are usual in a "
        "building: is it in another unit? `planfit refine` takes a usual one where recorded motion agrees; "
        "else say which with --depth-scale (metres of one stored unit)"
    ]


def _check_path(path: Path) -> None:
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        if archive_of(path) is None:
            raise ScanError(
                f"{path}: expected the folder of a scan, found nothing; check the path"
            ) from None
    except OSError as error:  # links that lead in a circle, rights
        raise ScanError(
            f"{path}: expected the folder of a scan, cannot be opened ({error.strerror})"
        ) from error
    require_content(path, ScanError, "the folder of a scan, or a file of one")


def _read(path: Path, options: ScanOptions) -> tuple[Recording, bool]:
    """By the reader of its format, and whether poses of another tracker are part of it."""
    name = options.format
    if name not in ("auto", *READERS):
        raise OptionError(f"format: expected auto, {', '.join(READERS)}, found {name!r}")
    for kind, whole in whole_files().items():
        if name == kind or (name == "auto" and whole.claims(path)):
            return whole.read(whole.open(path), options), whole.takes_poses
    known = {kind: one for kind, one in layouts().items() if name in ("auto", kind)}
    last = known.pop(LAST, None)
    if not path.is_dir() and archive_of(path) is None:
        raise no_scan_in_file(path, known)
    source = open_source(path)
    for layout in known.values():
        if layout.recognise(source):
            return layout.read(source, options), False
    inside = _inside(source, list(known.values()))
    if len(inside) == 1:
        layout, one = inside[0]
        return layout.read(one, options), False
    if inside:
        named = ", ".join(str(one.path) for _, one in inside)
        raise ScanError(
            f"{path}: expected one scan in the archive, found {len(inside)}; name one of them: {named}"
        )
    is_free = last is not None and (name == LAST or not is_of_known(source, known))
    is_asked = name == LAST or options.poses is not None
    if last is not None and is_free and (is_asked or last.recognise(source)):
        return last.read(source, options), False
    if name != "auto":
        raise ScanError(
            f"{path}: expected a scan of the format {name}: {format_of(name).expects}; found none"
        )
    raise no_scan_in_folder(source, known)


def _inside(source: FileSource, known: list[FolderLayout]) -> list[tuple[FolderLayout, ZipSource]]:
    """Scans in the folders of an archive, which nobody can name otherwise; those in others are left out."""
    if not isinstance(source, ZipSource):
        return []
    found: list[tuple[FolderLayout, ZipSource]] = []
    for folder in source.all_folders():
        one = source.inside(folder)
        if any(one.path.is_relative_to(other.path) for _, other in found):
            continue
        layout = next((layout for layout in known if layout.recognise(one)), None)
        if layout is not None:
            found.append((layout, one))
    return found
