"""`read_scan`: from a path to a scan, whatever its format.

path -> reader of its format -> Recording -> lens of a file -> Scan -> poses of another tracker -> corrupt
frames tolerated -> calibration
"""

from dataclasses import replace
from pathlib import Path

from planfit.errors import OptionError, ScanError
from planfit.runtime import archive_of, require_content
from planfit.scan.depth_checks import checked_depth
from planfit.scan.formats import LAST, READERS, format_of, layouts, whole_files
from planfit.scan.layout import FolderLayout
from planfit.scan.lens_file import read_lens, take_calibration
from planfit.scan.no_scan import (
    folder_of_scan,
    is_of_known,
    no_scan_in_file,
    no_scan_in_folder,
)
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
    return checked_depth(scan)


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
    # Asked for, it needs no look into the folder above.
    is_free = name == LAST or not (is_of_known(source, known) or folder_of_scan(source, known))
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
