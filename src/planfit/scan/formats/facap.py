"""The folder layout of the paper's published code (FACaP): four files a frame, masks, and the plan."""

from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from jaxtyping import UInt8

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan.images.decode import decode_image, header_size
from planfit.scan.images.lens import Lens
from planfit.scan.layout import FolderLayout, Listing
from planfit.scan.pairing import TextPoses, read_camera
from planfit.scan.poses import UP_Y, read_pose
from planfit.scan.recording import Frame, Size
from planfit.scan.source import FileSource
from planfit.scan.tables import Names
from planfit.scan.types import Label, ScanOptions

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

COLOR = Names(*(f"{FRAMES}/frame-{{}}.{suffix}" for suffix in ("jpg", "jpeg", "png")))
DEPTH = Names(f"{FRAMES}/depth-{{}}.png", key=".+")
POSES = TextPoses("pose-{}.txt")


def _frames(source: FileSource, options: ScanOptions) -> Listing[dict[str, Camera]]:
    """Frames, and the camera of each. With `use_masks` off, masks are as if they were not there."""
    color_names = _color_names(source)
    frame_ids = sorted(color_names or _depth_ids(source), key=int)
    _check_counts(source, frame_ids, bool(color_names))
    cameras = {i: read_camera(source, f"{FRAMES}/cam_params-{i}.txt") for i in frame_ids}
    frames = [
        Frame(
            frame_id=i,
            time=float(i),
            world_from_cam=read_pose(source, f"{FRAMES}/pose-{i}.txt"),
            color=color_names.get(i, ""),
            depth=DEPTH.of(i)[0],
            size=(cameras[i].width, cameras[i].height),
        )
        for i in frame_ids
    ]
    masks = _list_masks(source, frames) if options.use_masks else []
    tables = [f"{FRAMES}/{kind}-{i}.txt" for i in frame_ids for kind in ("pose", "cam_params")]
    warnings = [] if color_names else [NO_COLOR]
    return Listing(source, frames, cameras, [*tables, *masks], warnings=warnings)


def _color_names(source: FileSource) -> dict[str, str]:
    """Names of colour images by what stands for the frame's number in them; none where there is no colour."""
    found: dict[int, tuple[str, str]] = {}
    for key, name in sorted(COLOR.listed(source), key=lambda one: one[1]):
        if int(key) in found:
            raise ScanError(
                f"{source.path / name}: expected one colour image a frame, found "
                f"{PurePosixPath(found[int(key)][1]).name} of the same number beside it; delete one of them"
            )
        found[int(key)] = (key, name)
    return dict(found.values())


def _depth_ids(source: FileSource) -> list[str]:
    """What stands for the frame's number in the names of depth images."""
    numbered = [key for key in DEPTH.by_key(source) if key.isdecimal()]
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
    depth_ids = set(DEPTH.by_key(source))
    extra = sorted(depth_ids - set(frame_ids))
    if extra:
        raise ScanError(
            f"{folder}: expected as many colour as depth images, found {len(frame_ids)} colour "
            f"and {len(depth_ids)} depth (depth-{extra[0]}.png has no colour); "
            "copy the missing colour frames or delete the depth without them"
        )


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


def _labels(
    listing: Listing[dict[str, Camera]],
) -> Callable[[Frame], UInt8[np.ndarray, "h w"]] | None:
    """Where masks are read."""
    has_masks = any(name.startswith(f"{MASKS_FOLDER}/") for name in listing.tables)
    return partial(_read_labels, listing.source) if has_masks else None


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


FACAP = FolderLayout(
    name="facap",
    page="""The folder layout of the paper's published code (FACaP).

    SCAN/arcore/frame-NNNN.jpg (or .png)   colour; without any, the scan is depth alone
    SCAN/arcore/depth-NNNN.png             16-bit depth, millimetres
    SCAN/arcore/pose-NNNN.txt              world_from_cam, 4x4, OpenCV camera axes, y up
    SCAN/arcore/cam_params-NNNN.txt        w h fx fy cx cy
    SCAN/segmentation/frame-NNNN_{wall,floor,ceiling,columns}.png   masks, rotated by 90 deg (optional)
    SCAN/floorplan.npy                     (n, 4) segments (u1, v1, u2, v2) m, in world (x, z) (optional)

The plan shares the world's axes. Plan points are (x, -z), so that x, y and up stay right-handed.
""",
    expects="a folder arcore/ with frame-NNNN.jpg, depth-NNNN.png, pose-NNNN.txt, cam_params-NNNN.txt",
    checked=(
        "a real scan of 249 frames in this layout (ConSLAM)",
        "read whole; masks and axes against its depth, poses against its plan",
    ),
    told_by=lambda source: FRAMES in source.folders(),
    frames=_frames,
    can_scale_depth=False,
    lens=lambda listing: lambda frame, _: Lens(listing.content[frame.frame_id]),
    write=POSES.write,
    labels=_labels,
    up_world=UP_WORLD,
    plan_from_world_axes=PLAN_FROM_WORLD,
    floorplan=PLAN,
    has_options_in_fingerprint=False,
)
