"""7-Scenes: `frame-NNNNNN.color.png`, `.depth.png`, `.pose.txt` in one folder.

Depth is 16-bit millimetres, 0 and 65535 no reading; poses are world_from_cam, 4x4, OpenCV camera axes.
`camera-intrinsics.txt` (3x3) gives the intrinsics.

Without that file, or where it has the numbers that 7-Scenes publishes (fx = fy = 585, cx = 320, cy = 240),
the images are a Kinect's as they came from it: 585 is the depth camera, the poses are its own, and the colour
camera stood 2.5 cm beside it. Its calibration was never published; those who work with 7-Scenes (DSAC*, ACE,
the pseudo ground truth of Brachmann et al. 2021) take fx = 525 and the mount that LIRIS measured on another
Kinect (https://projet.liris.cnrs.fr/voir/activities-dataset/kinect-calibration.html), and so does this
reader. The scan's poses are then the colour camera's, and so must those of `--poses` be; the files read and
written are the depth camera's. With other intrinsics, as 3DMatch exports of other datasets have them, depth
is registered to colour, and there is one camera.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.frames import make_camera, matrix_intrinsics
from planfit.scan.images.image_files import Entry
from planfit.scan.images.lens import Lens
from planfit.scan.layout import Layout, scan_of_layout
from planfit.scan.matrices import read_pose, write_pose
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source
from planfit.scan.tables import read_matrix
from planfit.scan.types import Scan

LOOKS_FOR = "frame-NNNNNN.color.png, .depth.png and .pose.txt"
PUBLISHED = (585.0, 585.0, 320.0, 240.0)
KINECT_SIZE = (640, 480)
KINECT_COLOR = (525.0, 525.0, 320.0, 240.0)
COLOR_FROM_DEPTH = np.array(
    [
        [0.99996518012567637, 0.0026765126468950343, -0.0079041012313000904, -0.025558943178152542],
        [
            -0.0027409311281316700,
            0.99996302803027592,
            -0.0081504520778013286,
            0.00010109636268061706,
        ],
        [0.0078819942130445332, 0.0081718328771890631, 0.99993554558014031, 0.0020318321729487039],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""Of a Kinect: LIRIS's calibration."""
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

    is_raw = np.allclose(intrinsics, PUBLISHED, atol=0.5)
    color_from_depth = COLOR_FROM_DEPTH if is_raw else np.eye(4)
    entries = [
        replace(e, world_from_cam=e.world_from_cam @ se3.inverse(color_from_depth)) for e in entries
    ]

    def lens(_: Entry, size: tuple[int, int]) -> Lens:
        return Lens(make_camera(*size, intrinsics, str(source.path / INTRINSICS)))

    def kinect_color(entry: Entry, size: tuple[int, int]) -> Lens:
        if size != KINECT_SIZE:
            raise ScanError(
                f"{source.path / entry.color}: expected 640 x 480 px of 7-Scenes' Kinect, found {size[0]} x "
                f"{size[1]}; add {INTRINSICS} where another camera recorded the scan"
            )
        return Lens(make_camera(*size, KINECT_COLOR, str(source.path)))

    def write_poses(directory: Path, entries: Sequence[Entry], poses: np.ndarray) -> None:
        for entry, world_from_depth in zip(entries, poses @ color_from_depth, strict=True):
            write_pose(directory / f"frame-{entry.frame_id}.pose.txt", world_from_depth)

    layout = Layout(
        "7-scenes",
        sorted(entries, key=lambda entry: entry.time),
        1e-3,
        write_poses,
        kinect_color if is_raw else lens,
        lens if is_raw else None,
        other_files=[
            *(f"frame-{entry.frame_id}.pose.txt" for entry in entries),
            *([INTRINSICS] if has_own else []),
        ],
        skipped=skipped,
        color_from_depth=color_from_depth if is_raw else None,
    )
    return scan_of_layout(source, layout, options)
