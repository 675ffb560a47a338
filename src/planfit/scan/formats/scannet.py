"""ScanNet's folders, and what tells a depth camera of its own there and in its kin; ScanNet++, a JSON with
pose and intrinsics of each frame, colour as images or as a video."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.images.lens import Lens, make_camera, matrix_intrinsics
from planfit.scan.images.video import Video
from planfit.scan.layout import FolderLayout, Listing, Refined, each_frame
from planfit.scan.pairing import FileAFrame, SharedLens, TextPoses
from planfit.scan.poses import check_pose, check_recorded_pose
from planfit.scan.recording import Frame, Size
from planfit.scan.source import FileSource
from planfit.scan.tables import Names, has_part, number_list, read_json, read_matrix
from planfit.scan.types import ScanOptions

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


NAME = "pose_intrinsic_imu.json"
VIDEOS = ("rgb.mkv", "rgb.mp4")
_FRAME = re.compile(r"frame_(\d{1,9})")


@dataclass(frozen=True)
class _PoseFile:
    """The JSON, and its entries for frames by their ids."""

    content: dict[str, Any]
    entries: dict[str, Any]
    where: str


def _folder(source: FileSource) -> str | None:
    return next((folder for folder in ("", "iphone/") if source.exists(folder + NAME)), None)


def _frames(source: FileSource, options: ScanOptions) -> Listing[_PoseFile]:  # noqa: ARG001
    folder = _folder(source) or ""
    where = str(source.path / folder / NAME)
    content = read_json(source, folder + NAME)
    entries = {name: entry for name, entry in content.items() if _FRAME.fullmatch(name)}
    if not entries:
        raise ScanError(f"{where}: expected objects frame_NNNNNN, found none")
    if not source.names(f"{folder}depth") and source.exists(f"{folder}depth.bin"):
        raise ScanError(
            f"{source.path / folder / 'depth'}: expected depth/frame_NNNNNN.png, found depth.bin alone; "
            "unpack it with the toolkit's prepare_iphone_data.py (extract_depth: true)"
        )
    video_name, video = _video(source, folder)
    frames, skipped = [], []
    for name in _unpacked(source, folder, sorted(entries)):
        if video is not None and _number(name) >= len(video):
            skipped.append(f"frame {name}: the video ends after {len(video)} frames")
            continue
        color = folder + (f"rgb/{name}.jpg" if video is None else video_name)
        frames.append(_frame(name, entries[name], color, f"{folder}depth/{name}.png", where))
    pose_file = _PoseFile(content, entries, where)
    return Listing(source, frames, pose_file, [folder + NAME], skipped, video=video)


def _lens(listing: Listing[_PoseFile], frame: Frame, size: Size) -> Lens:
    at = f"{listing.content.where}, {frame.frame_id}"
    stored = listing.content.entries[frame.frame_id].get("intrinsic")
    numbers = number_list(stored, 9, f"{at}, intrinsic")
    return Lens(make_camera(*size, matrix_intrinsics(numbers.reshape(3, 3), at), at))


def _write(refined: Refined[_PoseFile]) -> None:
    """The JSON without the frames that were left out, which have no refined pose."""
    entries = refined.content.entries
    rest = {name: one for name, one in refined.content.content.items() if name not in entries}
    posed = {
        frame.frame_id: {**entries[frame.frame_id], "aligned_pose": pose.tolist()}
        for frame, pose in zip(refined.frames, refined.poses, strict=True)
    }
    text = json.dumps({**rest, **posed})
    (refined.directory / NAME).write_text(text + "\n")


def _number(frame_id: str) -> int:
    return int(frame_id.removeprefix("frame_"))


def _video(source: FileSource, folder: str) -> tuple[str, Video | None]:
    """The video, where colour was not unpacked of it."""
    name = next((n for n in VIDEOS if source.exists(folder + n)), "")
    if source.names(f"{folder}rgb") or not name:
        return "", None
    return name, Video.open(source.path / folder / name, source.on_disk(folder + name))


def _unpacked(source: FileSource, folder: str, names: list[str]) -> list[str]:
    """Frames of which the toolkit unpacked anything: the others, which it was not asked for, lack nothing."""
    stems = {Path(name).stem for kind in ("depth", "rgb") for name in source.names(folder + kind)}
    return [name for name in names if name in stems] or names


def _frame(name: str, entry: object, color: str, depth: str, where: str) -> Frame:
    at = f"{where}, {name}"
    if not isinstance(entry, dict):
        raise ScanError(
            f"{at}: expected an object with aligned_pose and intrinsic, found another value"
        )
    pose = number_list(entry.get("aligned_pose"), 16, f"{at}, aligned_pose").reshape(4, 4)
    check_recorded_pose(pose, at)
    time = number_list(entry.get("timestamp", _number(name) / 60), 1, f"{at}, timestamp")
    return Frame(name, float(time[0]), pose, color, depth)


SCANNETPP = FolderLayout(
    name="scannetpp",
    page="""ScanNet++: the iPhone's recording of a scene, depth as the set's toolkit unpacks it.

    SCENE/iphone/pose_intrinsic_imu.json    by frame: timestamp, aligned_pose (world_from_cam, 4x4, OpenCV
                                            axes, m), intrinsic (3x3, of the colour)
    SCENE/iphone/rgb/frame_NNNNNN.jpg       colour, 1920 x 1440; else the video rgb.mkv or rgb.mp4
    SCENE/iphone/depth/frame_NNNNNN.png     256 x 192, 16-bit millimetres

SCENE or its folder iphone/ may be named. `depth.bin` is unpacked by the toolkit's prepare_iphone_data.py
(extract_depth). `aligned_pose` is ARKit's in the axes and scale of the laser scan; whether those are level is
not told. Refined poses take its place in `pose_intrinsic_imu.json`.
""",
    expects="pose_intrinsic_imu.json (in iphone/) with rgb/ or rgb.mkv, and depth/",
    checked=(
        "the set's toolkit (github.com/scannetpp/scannetpp, prepare_iphone_data.py) and two"
        " loaders by others. No real file",
        "names, axes of aligned_pose, units, what is unpacked",
    ),
    told_by=(f"{NAME}|iphone/{NAME}",),
    parts=(f"iphone/{NAME}", "iphone/rgb/", "iphone/depth/"),
    frames=_frames,
    lens=each_frame(_lens),
    write=_write,
)
