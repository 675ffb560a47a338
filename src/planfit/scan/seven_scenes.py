"""7-Scenes: `frame-NNNNNN.color.png`, `.depth.png`, `.pose.txt` in one folder.

Depth is 16-bit millimetres, 0 and 65535 no reading; poses are world_from_cam, 4x4, OpenCV camera axes.
The published intrinsics are fx = fy = 585, cx = 320, cy = 240 for both; `camera-intrinsics.txt` (3x3)
overrules them. The colour camera stood beside the depth camera and the images are not registered: edges
are off by some pixels.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from planfit.scan.frames import make_camera, matrix_intrinsics
from planfit.scan.image_files import Entry
from planfit.scan.layout import Layout, scan_of_layout
from planfit.scan.lens import Lens
from planfit.scan.matrices import read_pose, write_pose
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source
from planfit.scan.tables import read_matrix
from planfit.scan.types import Scan

LOOKS_FOR = "frame-NNNNNN.color.png, .depth.png and .pose.txt"
PUBLISHED = (585.0, 585.0, 320.0, 240.0)
INTRINSICS = "camera-intrinsics.txt"

_COLOR = re.compile(r"frame-(\d+)\.color\.(png|jpg|jpeg)$", re.IGNORECASE)
_OTHER = re.compile(r"frame-(\d+)\.(depth\.png|pose\.txt)$", re.IGNORECASE)


def recognise(source: Source) -> bool:
    """Whether a folder has this layout."""
    return any(_COLOR.match(name) for name in source.names())


def read(source: Source, options: ScanOptions) -> Scan:
    """Read a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    entries, skipped = [], []
    for name in source.names():
        match = _COLOR.match(name)
        if match is None:
            continue
        number = match[1]
        pose_name = f"frame-{number}.pose.txt"
        if not source.exists(pose_name):
            skipped.append(f"frame {number}: {pose_name} is missing")
            continue
        pose = read_pose(source, pose_name)
        entries.append(Entry(number, float(number), pose, name, f"frame-{number}.depth.png"))
    colored = {match[1] for name in source.names() if (match := _COLOR.match(name))}
    others = {match[1] for name in source.names() if (match := _OTHER.match(name))}
    skipped += [f"frame {n}: frame-{n}.color.png is missing" for n in sorted(others - colored)]
    has_own = source.exists(INTRINSICS)
    intrinsics = PUBLISHED
    if has_own:
        matrix = read_matrix(source, INTRINSICS, "a 3x3 matrix of intrinsics")
        intrinsics = matrix_intrinsics(matrix, str(source.path / INTRINSICS))

    def lens(_: Entry, size: tuple[int, int]) -> Lens:
        return Lens(make_camera(*size, intrinsics, str(source.path / INTRINSICS)))

    layout = Layout(
        "7-scenes",
        sorted(entries, key=lambda entry: entry.time),
        1e-3,
        _write_poses,
        lens,
        other_files=[
            *(f"frame-{entry.frame_id}.pose.txt" for entry in entries),
            *([INTRINSICS] if has_own else []),
        ],
        skipped=skipped,
    )
    return scan_of_layout(source, layout, options)


def _write_poses(directory: Path, entries: Sequence[Entry], poses: np.ndarray) -> None:
    for entry, pose in zip(entries, poses, strict=True):
        write_pose(directory / f"frame-{entry.frame_id}.pose.txt", pose)
