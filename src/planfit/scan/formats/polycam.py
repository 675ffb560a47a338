"""Polycam's raw data export (developer mode).

    SCAN/keyframes/images/TIME.jpg, cameras/TIME.json         TIME in microseconds; not undistorted
    SCAN/keyframes/corrected_images/, corrected_cameras/   after Polycam's optimisation: used where present;
                                                           newer exports have corrected_depth/ too
    SCAN/keyframes/depth/TIME.png, confidence/TIME.png        16-bit millimetres; confidence 0, 127, 255

A camera has fx fy cx cy width height and t_00 to t_23: world_from_cam, ARKit axes, y up. Frames that Polycam
did not correct, where it corrected others, are left out. Files named TIME.Clean.png are not used. SCAN may be
`keyframes` itself.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.scan.images.files import ImageFiles
from planfit.scan.images.lens import Lens
from planfit.scan.intrinsics import make_camera
from planfit.scan.options import ScanOptions
from planfit.scan.poses import UP_Y, check_recorded_pose, from_opengl
from planfit.scan.recording import Frame, Recording, Size
from planfit.scan.source import FileSource
from planfit.scan.tables import number_list, read_json

EXPECTS = "keyframes/cameras/ (or corrected_cameras/) with keyframes/images/ and keyframes/depth/"
CHECKED = (
    "Polycam's own description (github.com/PolyCam/polyform), nerfstudio's "
    "polycam_utils.py, and names of a newer export as an audit of one lists them. No real file",
    "folders, corrected cameras, rows of the pose, world y-up, units, confidence",
)
"""Where the layout is known from, and what was checked with it."""
TOP = "keyframes/"
KEYS = tuple(f"t_{row}{column}" for row in range(3) for column in range(4))
LEAST_STORED = (0, 27, 192)
"""Stored confidence that is at least low, medium, high. Polycam documents 0, 127, 255; where a program took
these for sRGB and made them linear, medium is 54."""
PARTS = (f"{TOP}cameras/", f"{TOP}images/", f"{TOP}depth/")


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return _top(source) is not None


def _top(source: FileSource) -> str | None:
    """What stands before the names of the folders; None where they are not there."""
    if source.names(f"{TOP}cameras") or source.names(f"{TOP}corrected_cameras"):
        return TOP
    folders = set(source.folders())
    is_inside = "depth" in folders and not folders.isdisjoint(("cameras", "corrected_cameras"))
    names = source.names("cameras") or source.names("corrected_cameras") if is_inside else []
    # Other layouts have a folder of this name, too; the names of Polycam's are times.
    is_polycam = any(name.endswith(".json") and Path(name).stem.isdecimal() for name in names)
    return "" if is_polycam else None


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    top = _top(source)
    assert top is not None
    is_corrected = bool(source.names(f"{top}corrected_cameras"))
    prefix = f"{top}corrected_" if is_corrected else top
    cameras = f"{prefix}cameras"
    colors, depths = (
        f"{prefix}{name}" if source.names(f"{prefix}{name}") else f"{top}{name}"
        for name in ("images", "depth")
    )
    contents = {
        Path(name).stem: read_json(source, f"{cameras}/{name}")
        for name in source.names(cameras)
        if name.endswith(".json")
    }
    frames = [
        _frame(
            content,
            number,
            (f"{colors}/{stem}.jpg", f"{depths}/{stem}.png", f"{top}confidence/{stem}.png"),
            f"{source.path / cameras / stem}.json",
        )
        for number, (stem, content) in enumerate(contents.items())
    ]
    pictures = {*source.names(colors), *source.names(f"{top}images")}
    stems = {Path(name).stem for name in pictures if name.endswith(".jpg")}
    lone = sorted(stems - contents.keys())

    def lens(frame: Frame, size: Size) -> Lens:
        content, where = contents[frame.frame_id], f"{source.path / cameras / frame.frame_id}.json"
        width, height = content.get("width", size[0]), content.get("height", size[1])
        numbers = [content.get(key, np.nan) for key in ("fx", "fy", "cx", "cy")]
        return Lens(make_camera(width, height, numbers, where))

    def write_poses(
        directory: Path, written: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
    ) -> None:
        for frame, pose in zip(written, from_opengl(poses), strict=True):
            numbers = dict(zip(KEYS, pose[:3].ravel().tolist(), strict=True))
            text = json.dumps({**contents[frame.frame_id], **numbers}, indent=1)
            (directory / f"{frame.frame_id}.json").write_text(text + "\n")

    least = LEAST_STORED[options.min_confidence]
    images = ImageFiles(source, options.depth_scale or 1e-3, least)
    tables = [f"{cameras}/{frame.frame_id}.json" for frame in frames]
    return Recording(
        format="polycam",
        path=source.path,
        frames=sorted(frames, key=lambda frame: frame.time),
        images=images,
        color_lens=lens,
        write_poses=write_poses,
        fingerprint=images.fingerprint(tables, frames, options),
        up_world=UP_Y,
        skipped=[f"frame {stem}: {cameras}/{stem}.json is missing" for stem in lone],
    )


def _frame(content: dict[str, Any], number: int, files: tuple[str, str, str], where: str) -> Frame:
    top = number_list([content.get(key) for key in KEYS], 12, f"{where}, t_00 to t_23")
    pose = from_opengl(np.vstack([top.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]))
    check_recorded_pose(pose, where)
    stem = Path(files[0]).stem
    time = int(stem) / 1e6 if stem.isdecimal() else float(number)
    return Frame(stem, time, pose, *files)
