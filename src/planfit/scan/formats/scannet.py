"""ScanNet's folders, and what tells a depth camera of its own in ScanNet and its kin."""

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.layout import FolderLayout, Listing
from planfit.scan.pairing import FileAFrame, SharedLens, TextPoses
from planfit.scan.poses import check_pose
from planfit.scan.source import FileSource
from planfit.scan.tables import Names, has_part, read_matrix

COLOR, DEPTH = (
    SharedLens(
        f"intrinsic/intrinsic_{kind}.txt|intrinsics_{kind}.txt|intrinsic_{kind}.txt",
        "a 4x4 matrix of intrinsics",
    )
    for kind in ("color", "depth")
)
"""In the folder of SensReader, as scannet_frames_25k calls them, or beside the folders."""
EXTRINSICS = ("intrinsic/extrinsic_color.txt", "intrinsic/extrinsic_depth.txt")
NUMBERED_POSES = TextPoses("{}.txt")
"""As SensReader writes poses."""


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


def _color_from_depth(listing: Listing[dict[str, None]]) -> Float[np.ndarray, "4 4"] | None:
    """Where depth is a camera of its own, from its axes to those of the colour camera."""
    source = listing.source
    color, depth = (_extrinsics(source, name) for name in EXTRINSICS)
    color_from_depth = check_extrinsics(color, depth, str(source.path / EXTRINSICS[0]))
    if color_from_depth is not None and not has_part(source, DEPTH.name):
        raise ScanError(
            f"{source.path / DEPTH.file(source)}: expected intrinsics of the depth camera, which stands "
            f"beside the colour camera by {EXTRINSICS[1]}, found none"
        )
    return color_from_depth


def _extrinsics(source: FileSource, name: str) -> Float[np.ndarray, "4 4"]:
    if not source.exists(name):
        return np.eye(4)
    matrix = read_matrix(source, name, "a 4x4 matrix")
    check_pose(matrix, str(source.path / name))
    return matrix


SCANNET = FolderLayout(
    name="scannet",
    page="""ScanNet, as its SensReader exports it.

    SCAN/color/N.jpg, depth/N.png, pose/N.txt       depth 16-bit millimetres; poses world_from_cam, OpenCV,
                                                    all minus infinity where tracking was lost
    SCAN/intrinsic/intrinsic_color.txt, intrinsic_depth.txt     4x4, of each camera
    SCAN/intrinsics_color.txt, intrinsics_depth.txt     in their place: scannet_frames_25k, which has every
                                                    hundredth frame; also intrinsic_color.txt
    SCAN/intrinsic/extrinsic_color.txt, extrinsic_depth.txt     4x4, the identity in ScanNet (optional)

Colour (1296 x 968) and depth (640 x 480) have intrinsics of their own. Scans that were not calibrated have an
extrinsic_depth, which maps points of the depth camera to the colour camera's axes, as ScanNet's own
calibrator uses it: depth is then registered to colour, of which the poses are.
""",
    expects="intrinsic/intrinsic_color.txt (or intrinsics_color.txt) with folders color/, depth/, pose/",
    checked=(
        "SensReader's exports as six programs write them, and ScanNet's own calibrator "
        "(calibration of .sens files). No real file",
        "names, lost poses, what extrinsic_depth maps to what",
    ),
    told_by=(COLOR.name, "color/", "depth/", "pose/"),
    parts=(COLOR.name.split("|")[0], "color/", "depth/", "pose/"),
    frames=FileAFrame(
        color=Names("color/{}.jpg", "color/{}.*"),
        depth=Names("depth/{}.png"),
        poses="pose/{}.txt",
        read=TextPoses.read,
        tables=(COLOR.name, DEPTH.name),
    ),
    lens=COLOR,
    depth_lens=lambda found: DEPTH(found) if has_part(found.source, DEPTH.name) else None,
    color_from_depth=_color_from_depth,
    write=NUMBERED_POSES.write,
)
