"""The folder layout of the paper's published code (FACaP).

    SCAN/arcore/frame-NNNN.jpg (or .png)   colour; without any, the scan is depth alone
    SCAN/arcore/depth-NNNN.png             16-bit depth, millimetres
    SCAN/arcore/pose-NNNN.txt              world_from_cam, 4x4, OpenCV camera axes, y up
    SCAN/arcore/cam_params-NNNN.txt        w h fx fy cx cy
    SCAN/segmentation/frame-NNNN_{wall,floor,ceiling,columns}.png   masks, rotated by 90 deg (optional)
    SCAN/floorplan.npy                     (n, 4) segments (u1, v1, u2, v2) m, in world (x, z) (optional)

The plan shares the world's axes. Plan points are (x, -z), so that x, y and up stay right-handed.
"""

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan.images.decode import decode_image, header_size
from planfit.scan.images.files import ImageFiles
from planfit.scan.images.lens import Lens
from planfit.scan.intrinsics import make_camera
from planfit.scan.options import ScanOptions
from planfit.scan.poses import UP_Y, read_pose, write_pose
from planfit.scan.recording import Frame, Recording, Size
from planfit.scan.source import FileSource
from planfit.scan.tables import read_matrix
from planfit.scan.types import Label

EXPECTS = "a folder arcore/ with frame-NNNN.jpg, depth-NNNN.png, pose-NNNN.txt, cam_params-NNNN.txt"
CHECKED = (
    "a real scan of 249 frames in this layout (ConSLAM)",
    "read whole; masks and axes against its depth, poses against its plan",
)
"""Where the layout is known from, and what was checked with it."""
NO_COLOR = (
    "no images frame-NNNN.jpg: the scan is taken as depth alone; add them where there is colour"
)
FRAMES, MASKS_FOLDER, PLAN = "arcore", "segmentation", "floorplan.npy"

PLAN_FROM_WORLD = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""World (x, y up, z) to plan (x, -z, y)."""

UP_WORLD = UP_Y

# Later ones win where masks overlap: a column in front of a wall is marked in both.
MASKS = {
    "ceiling": Label.CEILING,
    "wall": Label.WALL,
    "floor": Label.FLOOR,
    "columns": Label.COLUMN,
}

_FRAME = re.compile(r"frame-(\d+)\.(jpg|jpeg|png)$", re.IGNORECASE)
_DEPTH = re.compile(r"depth-(.+)\.png$")


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return FRAMES in source.folders()


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan. With `use_masks` off, the masks are left unread, as if they were not there.

    Raises:
        ScanError: files are missing, unreadable, or contradict each other.
    """
    if options.depth_scale is not None:
        raise ScanError(
            f"{source.path}: expected depth in millimetres, as this layout has it; "
            "leave out --depth-scale"
        )
    color_names = _color_names(source)
    frame_ids = sorted(color_names or _depth_ids(source), key=int)
    _check_counts(source, frame_ids, bool(color_names))
    cameras = {i: _read_camera(source, f"{FRAMES}/cam_params-{i}.txt") for i in frame_ids}
    frames = [
        Frame(
            frame_id=i,
            time=float(i),
            world_from_cam=read_pose(source, f"{FRAMES}/pose-{i}.txt"),
            color=f"{FRAMES}/{color_names[i]}" if color_names else "",
            depth=f"{FRAMES}/depth-{i}.png",
            size=(cameras[i].width, cameras[i].height),
        )
        for i in frame_ids
    ]
    masks = _list_masks(source, frames) if options.use_masks else []
    images = ImageFiles(source, metres_per_unit=1e-3)
    tables = [f"{FRAMES}/{kind}-{i}.txt" for i in frame_ids for kind in ("pose", "cam_params")]

    def lens(frame: Frame, _: Size) -> Lens:
        return Lens(cameras[frame.frame_id])

    return Recording(
        format="facap",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=lens,
        write_poses=_write_poses,
        fingerprint=images.fingerprint([*tables, *masks], frames),
        labels=partial(_read_labels, source) if masks else None,
        up_world=UP_WORLD,
        plan_from_world_axes=PLAN_FROM_WORLD,
        floorplan_path=source.locate(PLAN) if source.exists(PLAN) else None,
        warnings=[] if color_names else [NO_COLOR],
    )


def _color_names(source: FileSource) -> dict[str, str]:
    """Names of colour images by what stands for the frame's number in them; none where there is no colour."""
    found: dict[int, tuple[str, str]] = {}
    for name in source.names(FRAMES):
        if match := _FRAME.match(name):
            number = int(match[1])
            if number in found:
                raise ScanError(
                    f"{source.path / FRAMES / name}: expected one colour image a frame, found "
                    f"{found[number][1]} of the same number beside it; delete one of them"
                )
            found[number] = (match[1], name)
    return dict(found.values())


def _depth_ids(source: FileSource) -> list[str]:
    """What stands for the frame's number in the names of depth images."""
    found = [match[1] for name in source.names(FRAMES) if (match := _DEPTH.match(name))]
    numbered = [number for number in found if number.isdecimal()]
    if not numbered:
        raise ScanError(
            f"{source.path / FRAMES}: expected colour images named frame-NNNN.jpg, or depth images named "
            "depth-NNNN.png alone, found none"
        )
    return numbered


def _check_counts(source: FileSource, frame_ids: list[str], has_color: bool) -> None:
    names = set(source.names(FRAMES))
    folder = source.path / FRAMES
    what = "colour frames" if has_color else "depth images"
    for kind, name in (("depth", "depth-{}.png"), ("pose", "pose-{}.txt"),
                       ("camera", "cam_params-{}.txt")):  # fmt: skip
        missing = [i for i in frame_ids if name.format(i) not in names]
        if missing:
            raise ScanError(
                f"{folder / name.format(missing[0])}: expected a {kind} file for each of "
                f"{len(frame_ids)} {what}, found {len(frame_ids) - len(missing)}; "
                f"copy the missing files or delete the {what} without them"
            )
    depth_ids = {match[1] for name in names if (match := _DEPTH.match(name))}
    extra = sorted(depth_ids - set(frame_ids))
    if extra:
        raise ScanError(
            f"{folder}: expected as many colour as depth images, found {len(frame_ids)} colour "
            f"and {len(depth_ids)} depth (depth-{extra[0]}.png has no colour); "
            "copy the missing colour frames or delete the depth without them"
        )


def _read_camera(source: FileSource, name: str) -> Camera:
    values = read_matrix(source, name, "six numbers (w h fx fy cx cy)").ravel().tolist()
    where = str(source.path / name)
    if len(values) != 6:
        raise ScanError(f"{where}: expected six numbers (w h fx fy cx cy), found {len(values)}")
    return make_camera(values[0], values[1], values[2:], where)


def _stem(frame: Frame) -> str:
    return PurePosixPath(frame.color).stem or f"frame-{frame.frame_id}"


def _mask_name(frame: Frame, kind: str) -> str:
    return f"{MASKS_FOLDER}/{_stem(frame)}_{kind}.png"


def _list_masks(source: FileSource, frames: list[Frame]) -> list[str]:
    """Names of the masks that are there.

    Raises:
        ScanError: one is no image or of another size than its frame, or some frames have none.
    """
    found: list[str] = []
    without: list[str] = []
    for frame in frames:
        names = [name for kind in MASKS if source.exists(name := _mask_name(frame, kind))]
        for name in names:
            # Stored a quarter turn off.
            height, width = header_size(source.ends(name)[0], source.path / name)
            if (width, height) != frame.size:
                raise _wrong_mask_size(source.path / name, (width, height), frame.size)
        found += names
        without += [] if names else [_stem(frame)]
    if found and without:
        raise ScanError(
            f"{source.path / MASKS_FOLDER}: expected masks for each of {len(frames)} frames, found "
            f"{len(frames) - len(without)} ({without[0]} has none); add them, or leave masks out with "
            "--segmentation.back-end geometry"
        )
    return found


def _read_labels(source: FileSource, frame: Frame) -> UInt8[np.ndarray, "h w"]:
    width, height = frame.size or (0, 0)
    labels = np.full((height, width), Label.NONE, dtype=np.uint8)
    for kind, label in MASKS.items():
        name = _mask_name(frame, kind)
        if source.exists(name):
            path = source.path / name
            mask = np.rot90(decode_image(source.read(name), path, cv2.IMREAD_GRAYSCALE))
            if mask.shape != labels.shape:
                raise _wrong_mask_size(path, mask.shape[::-1], frame.size)
            labels[mask > mask.max() // 2] = label  # stored as 0/255, or as 0/1
    return labels


def _wrong_mask_size(path: Path, found: tuple[int, ...], expected: Size | None) -> ScanError:
    width, height = expected or (0, 0)
    return ScanError(
        f"{path}: expected {width} x {height} px after the quarter turn of this layout, "
        f"found {found[0]} x {found[1]}; store masks turned a quarter against the image, full size"
    )


def _write_poses(
    directory: Path, frames: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
) -> None:
    for frame, pose in zip(frames, poses, strict=True):
        write_pose(directory / f"pose-{frame.frame_id}.txt", pose)
