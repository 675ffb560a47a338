"""Polycam's raw data export (developer mode).

    SCAN/keyframes/images/TIME.jpg, cameras/TIME.json         TIME in microseconds
    SCAN/keyframes/corrected_images/, corrected_cameras/   after Polycam's optimisation: used where present
    SCAN/keyframes/depth/TIME.png, confidence/TIME.png        16-bit millimetres; confidence 0, 127, 255

A camera has fx fy cx cy width height and t_00 to t_23: world_from_cam, ARKit axes, y up.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from planfit.scan.axes import UP_Y, from_opengl
from planfit.scan.frames import make_camera
from planfit.scan.images.image_files import Entry
from planfit.scan.images.lens import Lens
from planfit.scan.layout import Layout, scan_of_layout
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source
from planfit.scan.tables import number_list, read_json
from planfit.scan.types import Scan, check_pose

LOOKS_FOR = "keyframes/cameras/ (or corrected_cameras/) with keyframes/images/ and keyframes/depth/"
TOP = "keyframes"
KEYS = tuple(f"t_{row}{column}" for row in range(3) for column in range(4))
LEAST_STORED = (0, 64, 192)
"""Stored confidence that is at least low, medium, high."""
PARTS = (f"{TOP}/cameras/", f"{TOP}/images/", f"{TOP}/depth/")


def recognise(source: Source) -> bool:
    """Whether a folder has this layout."""
    return bool(source.names(f"{TOP}/cameras") or source.names(f"{TOP}/corrected_cameras"))


def read(source: Source, options: ScanOptions) -> Scan:
    """Read a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    is_corrected = bool(source.names(f"{TOP}/corrected_cameras"))
    prefix = "corrected_" if is_corrected else ""
    cameras, images = f"{TOP}/{prefix}cameras", f"{TOP}/{prefix}images"
    if not source.names(images):
        images = f"{TOP}/images"
    entries, contents = [], {}
    for name in source.names(cameras):
        if not name.endswith(".json"):
            continue
        stem, where = Path(name).stem, str(source.path / cameras / name)
        content = read_json(source, f"{cameras}/{name}")
        top = number_list([content.get(key) for key in KEYS], 12, f"{where}, t_00 to t_23")
        pose = from_opengl(np.vstack([top.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]))
        if np.isfinite(pose).all():
            check_pose(pose, where)
        contents[stem] = content
        time = int(stem) / 1e6 if stem.isdigit() else float(len(entries))
        entries.append(
            Entry(
                stem,
                time,
                pose,
                f"{images}/{stem}.jpg",
                f"{TOP}/depth/{stem}.png",
                f"{TOP}/confidence/{stem}.png",
            )
        )

    stems = {Path(name).stem for name in source.names(images) if name.endswith(".jpg")}
    lone = sorted(stems - contents.keys())
    skipped = [f"frame {stem}: {cameras}/{stem}.json is missing" for stem in lone]

    def lens(entry: Entry, size: tuple[int, int]) -> Lens:
        content, where = contents[entry.frame_id], f"{source.path / cameras / entry.frame_id}.json"
        width, height = content.get("width", size[0]), content.get("height", size[1])
        numbers = [content.get(key, np.nan) for key in ("fx", "fy", "cx", "cy")]
        return Lens(make_camera(width, height, numbers, where))

    def write_poses(directory: Path, written: Sequence[Entry], poses: np.ndarray) -> None:
        for entry, pose in zip(written, from_opengl(poses), strict=True):
            numbers = dict(zip(KEYS, pose[:3].ravel().tolist(), strict=True))
            text = json.dumps({**contents[entry.frame_id], **numbers}, indent=1)
            (directory / f"{entry.frame_id}.json").write_text(text + "\n")

    layout = Layout(
        "polycam",
        sorted(entries, key=lambda entry: entry.time),
        1e-3,
        write_poses,
        lens,
        other_files=[f"{cameras}/{entry.frame_id}.json" for entry in entries],
        up_world=UP_Y,
        skipped=skipped,
        least_confidence=LEAST_STORED[options.min_confidence],
    )
    return scan_of_layout(source, layout, options)
