"""Frames as 7-Scenes names them, `frame-NNNNNN.color.png` and so on: its own folders, and BundleFusion's."""

import re
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.formats.scannet import check_extrinsics
from planfit.scan.images.lens import Lens, make_camera, matrix_intrinsics
from planfit.scan.layout import FolderLayout, Listing
from planfit.scan.pairing import FileAFrame, SharedLens, TextPoses
from planfit.scan.poses import check_pose
from planfit.scan.recording import Frame, LensOfFrame, Size, pinhole_lens
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import Names, shorten
from planfit.scan.types import ScanOptions

PUBLISHED = (585.0, 585.0, 320.0, 240.0)
KINECT_SIZE = (640, 480)
KINECT_COLOR = (525.0, 525.0, 320.0, 240.0)
COLOR_FROM_DEPTH = np.array(
    [
        [0.99996518012567637, 0.0026765126468950343, -0.0079041012313000904, -0.025558943178152542],
        [-0.0027409311281316700, 0.99996302803027592, -0.0081504520778013286, 0.00010109636268061706],
        [0.0078819942130445332, 0.0081718328771890631, 0.99993554558014031, 0.0020318321729487039],
        [0.0, 0.0, 0.0, 1.0],
    ]
)  # fmt: skip
"""Of a Kinect: LIRIS's calibration."""
OWN_LENS = SharedLens("camera-intrinsics.txt")
INTRINSICS = OWN_LENS.name
POSES = TextPoses("frame-{}.pose.txt")
FRAMES = FileAFrame(
    color=Names("frame-{}.color.png", "frame-{}.color.jpg", "frame-{}.color.jpeg"),
    depth=Names("frame-{}.depth.png", "frame-{}.depth.pgm"),
    poses=POSES.pattern,
    read=POSES.read,
)
_SEQUENCE = re.compile(r"seq-\d+(\.zip)?$")
"""Folders of 7-Scenes itself, which come without intrinsics."""
_TAKEN = (
    f"no {INTRINSICS}: as frames are named as in 7-Scenes, colour and depth are taken for the Kinect's there "
    f"(fx 525 and 585, 2.5 cm apart); where another camera recorded them, put its matrix into {INTRINSICS}"
)


@dataclass(frozen=True)
class _Cameras:
    """Intrinsics of a folder, and whether they are a Kinect's that stands beside its colour camera."""

    intrinsics: tuple[float, ...]
    is_raw: bool

    @property
    def color_from_depth(self) -> Float[np.ndarray, "4 4"]:
        """Between the two."""
        return COLOR_FROM_DEPTH if self.is_raw else np.eye(4)


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Cameras]:
    """Frames with the poses of the colour camera."""
    has_own = source.exists(INTRINSICS)
    intrinsics = OWN_LENS.numbers(source) if has_own else PUBLISHED
    cameras = _Cameras(intrinsics, bool(np.allclose(intrinsics, PUBLISHED, atol=0.5)))
    listing = FRAMES(source, options)
    depth_from_color = se3.inverse(cameras.color_from_depth)
    return replace(
        listing,
        frames=[
            replace(frame, world_from_cam=frame.world_from_cam @ depth_from_color)
            for frame in listing.frames
        ],
        content=cameras,
        tables=[*listing.tables, *([INTRINSICS] if has_own else [])],
        warnings=[] if has_own or _SEQUENCE.match(source.path.resolve().name) else [_TAKEN],
    )


def _own_lens(listing: Listing[_Cameras]) -> LensOfFrame:
    return pinhole_lens(listing.content.intrinsics, str(listing.source.path / INTRINSICS))


def _color_lens(listing: Listing[_Cameras]) -> LensOfFrame:
    source = listing.source

    def kinect_color(frame: Frame, size: Size) -> Lens:
        if size != KINECT_SIZE:
            raise ScanError(
                f"{source.path / frame.color}: expected 640 x 480 px of 7-Scenes' Kinect, found {size[0]} x "
                f"{size[1]}; add {INTRINSICS} where another camera recorded the scan (of BundleFusion, "
                "12-Scenes and 3RScan their info.txt or _info.txt)"
            )
        return Lens(make_camera(*size, KINECT_COLOR, str(source.path)))

    return kinect_color if listing.content.is_raw else _own_lens(listing)


SEVEN_SCENES = FolderLayout(
    name="7-scenes",
    page="""7-Scenes: `frame-NNNNNN.color.png`, `.depth.png`, `.pose.txt` in one folder.

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
""",
    expects="frame-NNNNNN.color.png, .depth.png and .pose.txt",
    checked=(
        "the real red kitchen, every fourth of 1,000 frames",
        "axes and units, and where the colour camera stands (benchmarks)",
    ),
    told_by=("|".join(FRAMES.color.patterns),),
    frames=_frames,
    lens=_color_lens,
    depth_lens=lambda found: _own_lens(found) if found.content.is_raw else None,
    color_from_depth=lambda found: COLOR_FROM_DEPTH if found.content.is_raw else None,
    write=lambda refined: POSES.write(
        replace(refined, poses=refined.poses @ refined.content.color_from_depth)
    ),
)

TABLES = ("info.txt", "_info.txt")
FOLDERS = ("", "data/")
PREFIX = "m_calibration"


@dataclass(frozen=True)
class _Info:
    """What `info.txt` says, by names; `where` begins messages."""

    values: dict[str, str]
    where: str


def _folder(source: FileSource) -> str | None:
    """Where frames lie; None where none do."""
    return next((one for one in FOLDERS if FRAMES.color.listed(source, one)), None)


def _table(source: FileSource) -> str:
    """The first of `TABLES` that tells a camera; others of that name may lie beside any scan."""
    found = (name for name in TABLES if source.exists(name))
    return next((n for n in found if f"{PREFIX}ColorIntrinsic" in _text(source, n)), "")


def _info_frames(source: FileSource, options: ScanOptions) -> Listing[_Info]:
    table = _table(source)
    pairs = (line.partition("=") for line in read_text(source, table).splitlines())
    values = {name.strip(): value.strip() for name, _, value in pairs}
    info = _Info(values, str(source.path / table))
    listing = FRAMES(source, options, _folder(source) or "")
    return replace(listing, content=info, tables=[table, *listing.tables])


def _lens_of(listing: Listing[_Info], *kinds: str) -> LensOfFrame:
    """By the first of some matrices that the table has."""
    info = listing.content
    kind = next((one for one in kinds if PREFIX + one in info.values), kinds[-1])
    matrix = matrix_intrinsics(_matrix(info, kind), info.where)
    return pinhole_lens(matrix, f"{info.where}, {PREFIX}{kinds[0]}")


def _color_from_depth(listing: Listing[_Info]) -> Float[np.ndarray, "4 4"] | None:
    info = listing.content
    color, depth = (_extrinsics(info, kind) for kind in ("ColorExtrinsic", "DepthExtrinsic"))
    return check_extrinsics(color, depth, f"{info.where}, {PREFIX}ColorExtrinsic")


def _text(source: FileSource, name: str) -> str:
    try:
        return read_text(source, name)
    except ScanError:
        return ""  # no text: none of this format


def _extrinsics(info: _Info, name: str) -> Float[np.ndarray, "4 4"]:
    if PREFIX + name not in info.values:
        return np.eye(4)
    matrix = _matrix(info, name)
    check_pose(matrix, f"{info.where}, {PREFIX}{name}")
    return matrix


def _matrix(info: _Info, name: str) -> Float[np.ndarray, "4 4"]:
    text = info.values.get(PREFIX + name, "")
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    # Twelve numbers are three rows of four, as some programs write them.
    if len(numbers) not in (12, 16) or not np.isfinite(numbers).all():
        raise ScanError(
            f"{info.where}: expected 16 numbers after {PREFIX}{name} =, found '{shorten(text)}'; "
            "export it again"
        )
    matrix = np.eye(4)
    matrix[: len(numbers) // 4] = np.reshape(numbers, (-1, 4))
    return matrix


def _metres_per_unit(listing: Listing[_Info]) -> float:
    info = listing.content
    text = info.values.get("m_depthShift", "1000")
    try:
        units = float(text)
    except ValueError:
        units = np.nan
    if not (np.isfinite(units) and units > 0):
        raise ScanError(
            f"{info.where}: expected stored units a metre after m_depthShift =, found '{shorten(text)}'; "
            "say them with --depth-scale (metres of one stored unit)"
        )
    return 1 / units


BUNDLEFUSION = FolderLayout(
    name="bundlefusion",
    page="""BundleFusion's folders of images, which 12-Scenes and 3RScan share: a `.sens` file unpacked.

    SCAN/info.txt (or _info.txt)    `name = value` a line: m_depthShift (stored units a metre), and by row
                                    m_calibrationColorIntrinsic, m_calibrationDepthIntrinsic (4x4 or 3x4), and
                                    m_calibrationColorExtrinsic, m_calibrationDepthExtrinsic (4x4; optional)
    SCAN/frame-NNNNNN.color.jpg (.png), .depth.png (.pgm), .pose.txt    here, or in data/ (12-Scenes)

Depth is 16 bit; poses are world_from_cam, 4x4, OpenCV camera axes, minus infinity where tracking was lost.
Extrinsics are those of `scannet`: depth of a camera of its own is registered to colour.
""",
    expects="info.txt (or _info.txt) with frame-NNNNNN.color.jpg, .depth.png and .pose.txt",
    checked=(
        "info.txt as six programs read or write it for BundleFusion, 12-Scenes and 3RScan. No real file",
        "names, matrices, units of depth, PGM, what depth of a camera of its own is registered by",
    ),
    told_by=lambda source: _folder(source) is not None and _table(source) != "",
    frames=_info_frames,
    metres_per_unit=_metres_per_unit,
    states_depth_unit=lambda listing: "m_depthShift" in listing.content.values,
    lens=lambda found: _lens_of(found, "ColorIntrinsic"),
    depth_lens=lambda found: _lens_of(found, "DepthIntrinsic", "ColorIntrinsic"),
    color_from_depth=_color_from_depth,
    write=POSES.write,
)
