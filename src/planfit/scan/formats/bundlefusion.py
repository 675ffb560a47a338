"""BundleFusion's folders of images, which 12-Scenes and 3RScan share: a `.sens` file unpacked.

    SCAN/info.txt (or _info.txt)    `name = value` a line: m_depthShift (stored units a metre), and by row
                                    m_calibrationColorIntrinsic, m_calibrationDepthIntrinsic (4x4 or 3x4), and
                                    m_calibrationColorExtrinsic, m_calibrationDepthExtrinsic (4x4; optional)
    SCAN/frame-NNNNNN.color.jpg (.png), .depth.png (.pgm), .pose.txt    here, or in data/ (12-Scenes)

Depth is 16 bit; poses are world_from_cam, 4x4, OpenCV camera axes, minus infinity where tracking was lost.
Extrinsics are those of `scannet`: depth of a camera of its own is registered to colour.
"""

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.formats.scannet import check_extrinsics
from planfit.scan.formats.seven_scenes import (
    has_frames,
    list_frames,
    pose_name,
    write_frame_poses,
)
from planfit.scan.images.files import ImageFiles
from planfit.scan.intrinsics import matrix_intrinsics
from planfit.scan.options import ScanOptions
from planfit.scan.poses import check_pose
from planfit.scan.recording import Recording, pinhole_lens
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import shorten

EXPECTS = "info.txt (or _info.txt) with frame-NNNNNN.color.jpg, .depth.png and .pose.txt"
CHECKED = (
    "info.txt as six programs read or write it for BundleFusion, 12-Scenes and 3RScan. No real file",
    "names, matrices, units of depth, PGM, what depth of a camera of its own is registered by",
)
"""Where the layout is known from, and what was checked with it."""
TABLES = ("info.txt", "_info.txt")
FOLDERS = ("", "data/")
PREFIX = "m_calibration"


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return any(has_frames(source, folder) for folder in FOLDERS) and _table(source) != ""


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    table = _table(source)
    where = str(source.path / table)
    values = _values(source, table)
    color = matrix_intrinsics(_matrix(values, "ColorIntrinsic", where), where)
    depth = color
    if f"{PREFIX}DepthIntrinsic" in values:
        depth = matrix_intrinsics(_matrix(values, "DepthIntrinsic", where), where)
    color_from_depth = check_extrinsics(
        _extrinsics(values, "ColorExtrinsic", where),
        _extrinsics(values, "DepthExtrinsic", where),
        f"{where}, {PREFIX}ColorExtrinsic",
    )
    folder = next(folder for folder in FOLDERS if has_frames(source, folder))
    frames, skipped = list_frames(source, folder)

    images = ImageFiles(source, options.depth_scale or 1 / _units_per_metre(values, where))
    tables = [table, *(folder + pose_name(frame.frame_id) for frame in frames)]
    return Recording(
        format="bundlefusion",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=pinhole_lens(color, f"{where}, {PREFIX}ColorIntrinsic"),
        depth_lens=pinhole_lens(depth, f"{where}, {PREFIX}DepthIntrinsic"),
        color_from_depth=color_from_depth,
        write_poses=write_frame_poses,
        fingerprint=images.fingerprint(tables, frames, options),
        skipped=skipped,
    )


def _table(source: FileSource) -> str:
    """The first of `TABLES` that tells a camera; others of that name may lie beside any scan."""
    found = (name for name in TABLES if source.exists(name))
    return next((n for n in found if f"{PREFIX}ColorIntrinsic" in _text(source, n)), "")


def _text(source: FileSource, name: str) -> str:
    try:
        return read_text(source, name)
    except ScanError:
        return ""  # no text: none of this format


def _values(source: FileSource, table: str) -> dict[str, str]:
    pairs = (line.partition("=") for line in read_text(source, table).splitlines())
    return {name.strip(): value.strip() for name, _, value in pairs}


def _extrinsics(values: dict[str, str], name: str, where: str) -> Float[np.ndarray, "4 4"]:
    if PREFIX + name not in values:
        return np.eye(4)
    matrix = _matrix(values, name, where)
    check_pose(matrix, f"{where}, {PREFIX}{name}")
    return matrix


def _matrix(values: dict[str, str], name: str, where: str) -> Float[np.ndarray, "4 4"]:
    text = values.get(PREFIX + name, "")
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    # Twelve numbers are three rows of four, as some programs write them.
    if len(numbers) not in (12, 16) or not np.isfinite(numbers).all():
        raise ScanError(
            f"{where}: expected 16 numbers after {PREFIX}{name} =, found '{shorten(text)}'; export it again"
        )
    matrix = np.eye(4)
    matrix[: len(numbers) // 4] = np.reshape(numbers, (-1, 4))
    return matrix


def _units_per_metre(values: dict[str, str], where: str) -> float:
    text = values.get("m_depthShift", "1000")
    try:
        units = float(text)
    except ValueError:
        units = np.nan
    if not (np.isfinite(units) and units > 0):
        raise ScanError(
            f"{where}: expected stored units a metre after m_depthShift =, found '{shorten(text)}'; say them "
            "with --depth-scale (metres of one stored unit)"
        )
    return units
