"""7-Scenes: `frame-NNNNNN.color.png`, `.depth.png`, `.pose.txt` in one folder.

Depth is 16-bit millimetres, 0 and 65535 where nothing was measured; poses are world_from_cam, 4x4, OpenCV
camera axes. `camera-intrinsics.txt` (3x3) gives the intrinsics.

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
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.images.files import ImageFiles
from planfit.scan.images.lens import Lens
from planfit.scan.intrinsics import make_camera, matrix_intrinsics
from planfit.scan.options import ScanOptions
from planfit.scan.poses import read_pose, write_pose
from planfit.scan.recording import Frame, Recording, Size, pinhole_lens
from planfit.scan.source import FileSource
from planfit.scan.tables import read_matrix

EXPECTS = "frame-NNNNNN.color.png, .depth.png and .pose.txt"
CHECKED = (
    "the real red kitchen, every fourth of 1,000 frames",
    "axes and units, and where the colour camera stands (benchmarks)",
)
"""Where the layout is known from, and what was checked with it."""
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

DEPTH_ENDS = (".depth.png", ".depth.pgm")

_COLOR = re.compile(r"frame-(\d+)\.color\.(png|jpg|jpeg)$", re.IGNORECASE)
_OTHER = re.compile(r"frame-(\d+)\.(depth\.(png|pgm)|pose\.txt)$", re.IGNORECASE)
_SEQUENCE = re.compile(r"seq-\d+(\.zip)?$")
"""Folders of 7-Scenes itself, which come without intrinsics."""
_TAKEN = (
    f"no {INTRINSICS}: as frames are named as in 7-Scenes, colour and depth are taken for the Kinect's there "
    f"(fx 525 and 585, 2.5 cm apart); where another camera recorded them, put its matrix into {INTRINSICS}"
)


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return has_frames(source)


def has_frames(source: FileSource, folder: str = "") -> bool:
    """Whether colour images of this layout lie in a folder, which ends with a slash."""
    return any(_COLOR.match(name) for name in source.names(folder))


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    has_own = source.exists(INTRINSICS)
    intrinsics = PUBLISHED
    if has_own:
        matrix = read_matrix(source, INTRINSICS, "a 3x3 matrix of intrinsics")
        intrinsics = matrix_intrinsics(matrix, str(source.path / INTRINSICS))
    is_raw = np.allclose(intrinsics, PUBLISHED, atol=0.5)
    color_from_depth = COLOR_FROM_DEPTH if is_raw else np.eye(4)
    frames, skipped = list_frames(source)
    depth_from_color = se3.inverse(color_from_depth)
    frames = [replace(f, world_from_cam=f.world_from_cam @ depth_from_color) for f in frames]

    lens = pinhole_lens(intrinsics, str(source.path / INTRINSICS))

    def kinect_color(frame: Frame, size: Size) -> Lens:
        if size != KINECT_SIZE:
            raise ScanError(
                f"{source.path / frame.color}: expected 640 x 480 px of 7-Scenes' Kinect, found {size[0]} x "
                f"{size[1]}; add {INTRINSICS} where another camera recorded the scan (of BundleFusion, "
                "12-Scenes and 3RScan their info.txt or _info.txt)"
            )
        return Lens(make_camera(*size, KINECT_COLOR, str(source.path)))

    def write_poses(
        directory: Path, written: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
    ) -> None:
        write_frame_poses(directory, written, poses @ color_from_depth)

    images = ImageFiles(source, options.depth_scale or 1e-3)
    tables = [pose_name(frame.frame_id) for frame in frames]
    tables += [INTRINSICS] if has_own else []
    return Recording(
        format="7-scenes",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=kinect_color if is_raw else lens,
        depth_lens=lens if is_raw else None,
        color_from_depth=color_from_depth if is_raw else None,
        write_poses=write_poses,
        fingerprint=images.fingerprint(tables, frames, options),
        skipped=skipped,
        warnings=[] if has_own or _SEQUENCE.match(source.path.resolve().name) else [_TAKEN],
    )


def pose_name(number: str) -> str:
    """Name of the file of a frame's pose."""
    return f"frame-{number}.pose.txt"


def write_frame_poses(
    directory: Path, frames: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
) -> None:
    """A file for each frame of these."""
    for frame, pose in zip(frames, poses, strict=True):
        write_pose(directory / pose_name(frame.frame_id), pose)


def list_frames(source: FileSource, folder: str = "") -> tuple[list[Frame], list[str]]:
    """Frames of a folder, which ends with a slash, by their numbers, with the recorded poses, and a line for
    each that lacks colour or a pose."""
    frames, skipped = [], []
    names = source.names(folder)
    for name in names:
        match = _COLOR.match(name)
        if match is None:
            continue
        number = match[1]
        if not source.exists(folder + pose_name(number)):
            skipped.append(f"frame {number}: {pose_name(number)} is missing")
            continue
        pose = read_pose(source, folder + pose_name(number))
        ends = [end for end in DEPTH_ENDS if source.exists(f"{folder}frame-{number}{end}")]
        depth = f"{folder}frame-{number}{(ends or DEPTH_ENDS)[0]}"
        frames.append(Frame(number, float(number), pose, folder + name, depth))
    colored = {match[1] for name in names if (match := _COLOR.match(name))}
    others = {match[1] for name in names if (match := _OTHER.match(name))}
    skipped += [f"frame {n}: frame-{n}.color.png is missing" for n in sorted(others - colored)]
    return sorted(frames, key=lambda frame: frame.time), skipped
