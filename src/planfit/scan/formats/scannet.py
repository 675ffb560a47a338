"""ScanNet, as its SensReader exports it.

    SCAN/color/N.jpg, depth/N.png, pose/N.txt       depth 16-bit millimetres; poses world_from_cam, OpenCV,
                                                    all minus infinity where tracking was lost
    SCAN/intrinsic/intrinsic_color.txt, intrinsic_depth.txt     4x4, of each camera
    SCAN/intrinsic/extrinsic_color.txt, extrinsic_depth.txt     4x4, the identity in ScanNet (optional)

Colour (1296 x 968) and depth (640 x 480) have intrinsics of their own. Scans that were not calibrated have an
extrinsic_depth, which maps points of the depth camera to the colour camera's axes, as ScanNet's own
calibrator uses it: depth is then registered to colour, of which the poses are.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.images.files import ImageFiles
from planfit.scan.intrinsics import matrix_intrinsics
from planfit.scan.options import ScanOptions
from planfit.scan.poses import check_pose, read_pose, write_pose
from planfit.scan.recording import Frame, Recording, pinhole_lens
from planfit.scan.source import FileSource
from planfit.scan.tables import read_matrix

EXPECTS = "intrinsic/intrinsic_color.txt with folders color/, depth/, pose/"
CHECKED = (
    "SensReader's exports as six programs write them, and ScanNet's own calibrator "
    "(calibration of .sens files). No real file",
    "names, lost poses, what extrinsic_depth maps to what",
)
"""Where the layout is known from, and what was checked with it."""
COLOR, DEPTH = "intrinsic/intrinsic_color.txt", "intrinsic/intrinsic_depth.txt"
EXTRINSICS = ("intrinsic/extrinsic_color.txt", "intrinsic/extrinsic_depth.txt")
PARTS = (COLOR, "color/", "depth/", "pose/")


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return source.exists(COLOR) and {"color", "depth", "pose"} <= set(source.folders())


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    color_from_depth = _color_from_depth(source)
    frames, skipped = [], []
    names = [n for n in source.names("color") if Path(n).stem.isdecimal()]
    for name in sorted(names, key=lambda n: int(Path(n).stem)):
        number = Path(name).stem
        pose_name = f"pose/{number}.txt"
        if not source.exists(pose_name):
            skipped.append(f"frame {number}: {pose_name} is missing")
            continue
        pose = read_pose(source, pose_name)
        frames.append(Frame(number, float(number), pose, f"color/{name}", f"depth/{number}.png"))
    colored = {Path(name).stem for name in names}
    others = {Path(n).stem for folder in ("depth", "pose") for n in source.names(folder)}
    lone = sorted((n for n in others - colored if n.isdecimal()), key=int)
    skipped += [f"frame {number}: color/{number}.jpg is missing" for number in lone]

    color = _intrinsics(source, COLOR)
    depth = _intrinsics(source, DEPTH) if source.exists(DEPTH) else None

    images = ImageFiles(source, options.depth_scale or 1e-3)
    tables = [COLOR, *([DEPTH] if depth else []), *(f"pose/{f.frame_id}.txt" for f in frames)]
    return Recording(
        format="scannet",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=pinhole_lens(color, str(source.path / COLOR)),
        depth_lens=pinhole_lens(depth, str(source.path / DEPTH)) if depth else None,
        color_from_depth=color_from_depth,
        write_poses=write_numbered_poses,
        fingerprint=images.fingerprint(tables, frames, options),
        skipped=skipped,
    )


def check_extrinsics(
    color: Float[np.ndarray, "4 4"], depth: Float[np.ndarray, "4 4"], where_color: str
) -> Float[np.ndarray, "4 4"] | None:
    """Where depth is a camera of its own, from its axes to those of the colour camera.

    Args:
        color: extrinsics of the colour camera, which poses are of: the identity.
        depth: from depth camera axes to those of the colour camera.
        where_color: of the first, for messages.

    Raises:
        ScanError: poses are of neither camera.
    """
    if not np.allclose(color, np.eye(4), atol=1e-4):
        raise ScanError(
            f"{where_color}: expected the identity (poses of the colour camera), found another matrix; "
            "register depth to colour first"
        )
    return None if np.allclose(depth, np.eye(4), atol=1e-4) else depth


def _color_from_depth(source: FileSource) -> Float[np.ndarray, "4 4"] | None:
    """Where depth is a camera of its own, from its axes to those of the colour camera."""
    color, depth = (_extrinsics(source, name) for name in EXTRINSICS)
    color_from_depth = check_extrinsics(color, depth, str(source.path / EXTRINSICS[0]))
    if color_from_depth is not None and not source.exists(DEPTH):
        raise ScanError(
            f"{source.path / DEPTH}: expected intrinsics of the depth camera, which stands beside the colour "
            f"camera by {EXTRINSICS[1]}, found none"
        )
    return color_from_depth


def _extrinsics(source: FileSource, name: str) -> Float[np.ndarray, "4 4"]:
    if not source.exists(name):
        return np.eye(4)
    matrix = read_matrix(source, name, "a 4x4 matrix")
    check_pose(matrix, str(source.path / name))
    return matrix


def _intrinsics(source: FileSource, name: str) -> tuple[float, float, float, float]:
    matrix = read_matrix(source, name, "a 4x4 matrix of intrinsics")
    return matrix_intrinsics(matrix, str(source.path / name))


def write_numbered_poses(
    directory: Path, frames: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
) -> None:
    """As SensReader writes poses (k): a file N.txt for each frame of these."""
    for frame, pose in zip(frames, poses, strict=True):
        write_pose(directory / f"{frame.frame_id}.txt", pose)
