"""nerfstudio, Instant-NGP and NeRFCapture: one JSON that lists frames with poses and lenses."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from planfit.errors import ScanError
from planfit.scan.images.decode import N_DEPTH_FRAMES, USUAL_DEPTH_M, decode_depth
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.layout import FolderLayout, Listing, Refined, each_frame
from planfit.scan.poses import are_of_a_clock, check_recorded_pose, from_opengl
from planfit.scan.recording import Frame, Size, id_of_name
from planfit.scan.source import FileSource, in_order
from planfit.scan.tables import first_of, number_list, numbers_of, read_json
from planfit.scan.types import ScanOptions

NAME = "transforms.json"
FLOATS = (".npy", ".tif", ".tiff")
"""Ends of the names of depth that may be floating-point numbers; whole ones have a unit of their own."""
DEPTH_KEYS = ("depth_file_path", "depth_path")
KINDS = (
    "", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV_FISHEYE"
)  # fmt: skip
"""Those of one formula; what a kind leaves out is 0."""


@dataclass(frozen=True)
class _Transforms:
    """The JSON, and what it lists of frames, by the names of their colour."""

    content: dict[str, Any]
    item_of: dict[str, dict[str, Any]]
    where: str
    metres_per_float: float


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Transforms]:
    path = source.path / NAME
    content = read_json(source, NAME)
    listed = content.get("frames")
    if not isinstance(listed, list) or not listed:
        raise ScanError(f"{path}: expected a list `frames`, found none")
    if not any(isinstance(f, dict) and any(f.get(key) for key in DEPTH_KEYS) for f in listed):
        raise ScanError(
            f"{path}: expected frames with depth_file_path, found none; planfit needs depth, process "
            "the capture with depth"
        )
    times, told_of_times = _times(listed)
    frames = [
        _frame(source, item, time, f"{path}, frame {i}")
        for i, (item, time) in enumerate(zip(listed, times, strict=True))
    ]
    item_of = {frame.color: item for frame, item in zip(frames, listed, strict=True)}
    metres_per_float, told = _unit_of_floats(source, frames)
    transforms = _Transforms(content, item_of, str(path), metres_per_float)
    warnings = [*told_of_times, *(told if options.depth_scale is None else [])]
    listing = sorted(frames, key=lambda frame: frame.time)
    return Listing(source, listing, transforms, [NAME], warnings=warnings)


def _unit_of_floats(source: FileSource, frames: Sequence[Frame]) -> tuple[float, list[str]]:
    """Metres of a unit of floating-point depth, and what to say of it: nerfstudio multiplies all depth by one
    factor, a thousandth; apps and other programs write metres."""
    names = [f.depth for f in frames if f.depth.endswith(FLOATS) and source.exists(f.depth)]
    looked_at = names[:: max(1, len(names) // N_DEPTH_FRAMES)]
    depths = [decode_depth(source.read(name), 1.0, source.path / name) for name in looked_at]
    known = [float(np.nanmedian(one)) for one in depths if np.isfinite(one).any()]
    if not known or not USUAL_DEPTH_M[0] <= 1e-3 * np.median(known) <= USUAL_DEPTH_M[1]:
        return 1.0, []
    return 1e-3, [
        f"depth of {Path(looked_at[0]).suffix} is taken as millimetres, as nerfstudio does: half of it is "
        f"beyond {np.median(known):.0f}; if not so, say which unit with --depth-scale"
    ]


def _metres_per_unit(listing: Listing[_Transforms]) -> float:
    content, where = listing.content.content, listing.content.where
    stored = content.get("integer_depth_scale", 1e-3)
    scale = float(number_list(stored, 1, f"{where}, integer_depth_scale")[0])
    if not 0 < scale < np.inf:
        raise ScanError(f"{where}: expected an integer_depth_scale above 0, found {scale:g}")
    return scale


def _image_name(source: FileSource, name: str) -> str:
    """A file of this name, with the suffix that it leaves out; programs on Windows write backslashes."""
    path = PurePosixPath(name if source.exists(name) else name.replace("\\", "/"))
    return first_of(source, [f"{path}{suffix}" for suffix in ("", ".png", ".jpg", ".jpeg")])


def _times(listed: Sequence[object]) -> tuple[list[float], list[str]]:
    """`timestamp` of each frame where all have one, and what to say of them: NeRFCapture lists frames as they
    were written, which is not as they were taken. Else the places of their names in order, as nerfstudio has
    them, or in the list; each where the path is no longer for it: times may be of several clocks, or
    durations, names of several cameras."""
    places = [float(i) for i in range(len(listed))]
    items = [item for item in listed if isinstance(item, dict)]
    matrices = numbers_of([item.get("transform_matrix") for item in items])
    if matrices.size != 16 * len(listed):
        return places, []  # what is none is named when it is read
    positions = matrices.reshape(-1, 4, 4)[:, :3, 3]
    names = [in_order(str(item.get("file_path"))) for item in items]
    in_turn = sorted(range(len(names)), key=names.__getitem__)
    found = [item.get("timestamp") for item in items]
    times = [float(t) for t in found if isinstance(t, int | float) and np.isfinite(t)]
    if len(times) < len(listed):
        by_name = np.argsort(in_turn).astype(float)
        if in_turn == list(range(len(listed))) or not are_of_a_clock(by_name, positions):
            return places, []
        return by_name.tolist(), [
            f"frames are in the order of their names, not in that of the list in {NAME}"
        ]
    if are_of_a_clock(np.array(times), positions):
        return times, []
    return places, [
        f"timestamps of {NAME} repeat or contradict the path, as of several clocks: frames are in the order "
        "of the list, without times"
    ]


def _frame(source: FileSource, item: object, time: float, where: str) -> Frame:
    name = item.get("file_path") if isinstance(item, dict) else None
    if not isinstance(item, dict) or not isinstance(name, str) or not PurePosixPath(name).name:
        raise ScanError(f"{where}: expected an object with file_path, found none")
    depth_name = next((item[key] for key in DEPTH_KEYS if item.get(key)), "")
    if not isinstance(depth_name, str):
        raise ScanError(f"{where}: expected a name as depth_file_path, found another value")
    matrix = number_list(item.get("transform_matrix"), 16, f"{where}, transform_matrix")
    pose = from_opengl(matrix.reshape(4, 4))
    check_recorded_pose(pose, where)
    color = _image_name(source, name)
    depth = _image_name(source, depth_name) if depth_name else ""
    return Frame(id_of_name(color), time, pose, color, depth)


def _lens(listing: Listing[_Transforms], frame: Frame, size: Size) -> Lens:
    transforms = listing.content
    values = {**transforms.content, **transforms.item_of[frame.color]}
    where = f"{transforms.where}, {frame.color}"
    kind = values.get("camera_model", "")
    if kind not in KINDS:
        raise ScanError(
            f"{where}: expected a camera_model of {', '.join(KINDS[1:])}, found {kind!r}; "
            "undistort the images first"
        )
    if "fl_x" not in values and "camera_angle_x" in values:
        (angle,) = number_list(values["camera_angle_x"], 1, f"{where}, camera_angle_x")
        focal = size[0] / 2 / np.tan(angle / 2)
        values = {**values, "fl_x": focal, "cx": size[0] / 2, "cy": size[1] / 2, "w": size[0]}
    missing = [key for key in ("fl_x", "cx", "cy") if key not in values]
    if missing:
        raise ScanError(f"{where}: expected {missing[0]} at the top or in the frame, found none")
    width, height = values.get("w", size[0]), values.get("h", size[1])
    intrinsics = number_list(
        [values["fl_x"], values.get("fl_y", values["fl_x"]), values["cx"], values["cy"]], 4, where
    )
    intrinsics[2:] -= 0.5
    camera = make_camera(width, height, intrinsics.tolist(), where)
    is_fisheye = kind == "OPENCV_FISHEYE"
    keys = ("k1", "k2", "k3", "k4") if is_fisheye else ("k1", "k2", "p1", "p2", "k3")
    distortion = number_list([values.get(key, 0.0) for key in keys], len(keys), where)
    return Lens(camera, tuple(distortion.tolist()), is_fisheye)


def _write(refined: Refined[_Transforms]) -> None:
    transforms = refined.content
    listed = [
        {**transforms.item_of[frame.color], "transform_matrix": pose.tolist()}
        for frame, pose in zip(refined.frames, from_opengl(refined.poses), strict=True)
    ]
    text = json.dumps({**transforms.content, "frames": listed}, indent=1)
    (refined.directory / NAME).write_text(text + "\n")


NERFSTUDIO = FolderLayout(
    name="nerfstudio",
    page="""nerfstudio, Instant-NGP and NeRFCapture: `transforms.json` with depth.

Each frame has `file_path`, `depth_file_path` (Instant-NGP: `depth_path`) and `transform_matrix`:
world_from_cam with OpenGL camera axes. Intrinsics `fl_x fl_y cx cy w h` and distortion `k1 k2 p1 p2 k3 k4`
with `camera_model` stand at the top or in a frame, which wins. There cx and cy count from the corner of the
first pixel: half a pixel more than ours. Depth is 16-bit in millimetres (nerfstudio's default), or in units
of `integer_depth_scale` metres where the file has that (Instant-NGP, NeRFCapture, SplaTAM's captures).
Floating-point numbers (`.npy`, TIFF, EXR) are metres; in `.npy` and TIFF millimetres, as nerfstudio has it,
where half of them are beyond 200, which is told. A `file_path` without suffix is a .png or .jpg, as in
Instant-NGP. Frames are taken in the order of their `timestamp` where all have one, else of their names, where
the path is no longer for it; else in that of the list. Another order than that of the list by names, or in
place of that of times, is told. The axes of the world are anyone's.
""",
    expects="transforms.json with frames that have depth_file_path (or depth_path)",
    checked=(
        "nerfstudio_dataparser.py, three exporters that write integer_depth_scale (NeRFCapture, SplaTAM, "
        "Instant-NGP), and NeRFCapture's DatasetWriter.swift. No real file",
        "keys, half pixels, units of depth, the order of frames",
    ),
    told_by=(NAME,),
    parts=(NAME, "images/", "depth/"),
    frames=_frames,
    metres_per_unit=_metres_per_unit,
    states_depth_unit=lambda listing: "integer_depth_scale" in listing.content.content,
    metres_per_float=lambda listing: listing.content.metres_per_float,
    lens=each_frame(_lens),
    write=_write,
)
