"""Apps of LiDAR phones that write a JSON file a frame, ARKit's pose in it: 3D Scanner App and Polycam."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.layout import FolderLayout, Listing, Refined, each_frame
from planfit.scan.pairing import FileAFrame, Posed
from planfit.scan.poses import UP_Y, check_recorded_pose, from_opengl
from planfit.scan.recording import Frame, Size
from planfit.scan.source import FileSource
from planfit.scan.tables import Names, number_list, read_json
from planfit.scan.types import ScanOptions


@dataclass(frozen=True)
class CameraFile:
    """What the JSON of a frame says."""

    values: dict[str, Any]
    intrinsics: Sequence[object]
    """fx fy cx cy."""
    where: str
    """Of the file, for messages."""
    size: dict[str, Any] = field(default_factory=dict)
    """`width` and `height`, where the format has them; else those of the image."""


Cameras = dict[str, CameraFile]
"""By the ids of frames."""


def _posed(
    camera: CameraFile, rows: Float[np.ndarray, "r 4"], time: float | None
) -> Posed[CameraFile]:
    """By the rows of a pose in ARKit's axes, of which the last may be left out."""
    pose = from_opengl(np.vstack([rows, np.eye(4)[len(rows) :]]))
    check_recorded_pose(pose, camera.where)
    return Posed(pose, camera, time)


def _lens(listing: Listing[Cameras], frame: Frame, size: Size) -> Lens:
    camera = listing.content[frame.frame_id]
    width, height = camera.size.get("width", size[0]), camera.size.get("height", size[1])
    return Lens(make_camera(width, height, camera.intrinsics, camera.where))


def _writing(
    pattern: str, pose_values: Callable[[list[float]], dict[str, object]]
) -> Callable[[Refined[Cameras]], None]:
    """A file a frame with the values of its pose (16 numbers, by row) in place of their own."""

    def write(refined: Refined[Cameras]) -> None:
        for frame, pose in zip(refined.frames, from_opengl(refined.poses), strict=True):
            values = refined.content[frame.frame_id].values
            content = {**values, **pose_values(pose.ravel().tolist())}
            path = refined.directory / pattern.format(frame.frame_id)
            path.write_text(json.dumps(content, indent=1) + "\n")

    return write


def _read_scanner_app(source: FileSource, name: str) -> Posed[CameraFile]:
    where = str(source.path / name)
    content = read_json(source, name)
    rows = number_list(content.get("cameraPoseARFrame"), 16, f"{where}, cameraPoseARFrame")
    k = number_list(content.get("intrinsics"), 9, f"{where}, intrinsics")
    number = int(Path(name).stem.removeprefix("frame_"))
    time = float(number_list(content.get("time", number), 1, f"{where}, time")[0])
    return _posed(CameraFile(content, (k[0], k[4], k[2], k[5]), where), rows.reshape(4, 4), time)


SCANNER_APP = FolderLayout(
    name="scanner-app",
    page="""3D Scanner App (Laan Labs), "All data" export of a LiDAR scan.

    SCAN/frame_NNNNN.jpg, depth_NNNNN.png, conf_NNNNN.png    depth 16-bit millimetres, confidence 0 1 2
    SCAN/depth_NNNNN.exr       newer versions have depth as this, in metres (needs OpenEXR)
    SCAN/frame_NNNNN.json      intrinsics (9 numbers, by row, of the colour image), cameraPoseARFrame (16, by
                               row, world_from_cam, ARKit axes), time

ARKit's world is y-up and level. Depth (256 x 192) shows what colour shows. The app keeps colour of only
some frames.
""",
    expects="frame_NNNNN.json with cameraPoseARFrame, frame_NNNNN.jpg and depth_NNNNN.png (or .exr)",
    checked=(
        "the maker's own sample and a corridor scanned by others "
        "(github.com/laanlabs/3dScannerApp_samples and a fork), 3 frames with depth; a converter that reads "
        "depth as EXR",
        "axes, intrinsics by row, units, confidence, frames without a picture",
    ),
    told_by=("frame_{}.json",),
    frames=FileAFrame(
        color=Names("frame_{}.jpg"),
        depth=Names("depth_{}.png", "depth_{}.exr"),
        confidence="conf_{}.png",
        poses="frame_{}.json",
        read=_read_scanner_app,
    ),
    lens=each_frame(_lens),
    write=_writing("frame_{}.json", lambda pose: {"cameraPoseARFrame": pose}),
    up_world=UP_Y,
)

TOP = "keyframes/"
KEYS = tuple(f"t_{row}{column}" for row in range(3) for column in range(4))


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


def _read_polycam(source: FileSource, name: str) -> Posed[CameraFile]:
    where, stem = str(source.path / name), Path(name).stem
    content = read_json(source, name)
    rows = number_list([content.get(key) for key in KEYS], 12, f"{where}, t_00 to t_23")
    intrinsics = [content.get(key, np.nan) for key in ("fx", "fy", "cx", "cy")]
    time = int(stem) / 1e6 if stem.isdecimal() else None
    size = {key: content[key] for key in ("width", "height") if key in content}
    return _posed(CameraFile(content, intrinsics, where, size), rows.reshape(3, 4), time)


def _polycam_frames(source: FileSource, options: ScanOptions) -> Listing[Cameras]:
    top = _top(source) or ""
    prefix = f"{top}corrected_" if source.names(f"{top}corrected_cameras") else top
    colors, depths = (
        f"{prefix}{name}" if source.names(f"{prefix}{name}") else f"{top}{name}"
        for name in ("images", "depth")
    )
    frames = FileAFrame(
        color=Names(f"{colors}/{{}}.jpg", f"{top}images/{{}}.jpg", key="[^.]+"),
        depth=Names(f"{depths}/{{}}.png", key="[^.]+"),
        confidence=f"{top}confidence/{{}}.png",
        poses=f"{prefix}cameras/{{}}.json",
        read=_read_polycam,
        key="[^.]+",
    )
    listing = frames(source, options)
    return replace(listing, frames=sorted(listing.frames, key=lambda frame: frame.time))


POLYCAM = FolderLayout(
    name="polycam",
    page="""Polycam's raw data export (developer mode).

    SCAN/keyframes/images/TIME.jpg, cameras/TIME.json         TIME in microseconds; not undistorted
    SCAN/keyframes/corrected_images/, corrected_cameras/   after Polycam's optimisation: used where present;
                                                           newer exports have corrected_depth/ too
    SCAN/keyframes/depth/TIME.png, confidence/TIME.png        16-bit millimetres; confidence 0, 127, 255

A camera has fx fy cx cy width height and t_00 to t_23: world_from_cam, ARKit axes, y up. Frames that Polycam
did not correct, where it corrected others, are left out. Files named TIME.Clean.png are not used. SCAN may be
`keyframes` itself.
""",
    expects="keyframes/cameras/ (or corrected_cameras/) with keyframes/images/ and keyframes/depth/",
    checked=(
        "Polycam's own description (github.com/PolyCam/polyform), nerfstudio's "
        "polycam_utils.py, and names of a newer export as an audit of one lists them. No real file",
        "folders, corrected cameras, rows of the pose, world y-up, units, confidence",
    ),
    told_by=lambda source: _top(source) is not None,
    parts=(f"{TOP}cameras/", f"{TOP}images/", f"{TOP}depth/"),
    frames=_polycam_frames,
    # Polycam documents 0, 127, 255; where a program took these for sRGB and made them linear, medium is 54.
    least_confidence=(0, 27, 192),
    lens=each_frame(_lens),
    write=_writing("{}.json", lambda pose: dict(zip(KEYS, pose[:12], strict=True))),
    up_world=UP_Y,
)
