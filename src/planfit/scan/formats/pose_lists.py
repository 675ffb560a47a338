"""Numbered images and one file of poses: Replica's renderings, Redwood's and Open3D's folders."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.layout import FolderLayout, Listing, Refined
from planfit.scan.pairing import Poses, RowAFrame
from planfit.scan.pose_files import read_poses_of
from planfit.scan.poses import UP_Z, check_pose, followed
from planfit.scan.recording import Frame, LensOfFrame, Size, pinhole_lens
from planfit.scan.source import FileSource, FolderSource, in_order
from planfit.scan.tables import Names, first_of, number_list, read_json
from planfit.scan.types import ScanOptions

CALIBRATION = "cam_params.json"
PUBLISHED = {
    "w": 1200,
    "h": 680,
    "fx": 600.0,
    "fy": 600.0,
    "cx": 599.5,
    "cy": 339.5,
    "scale": 6553.5,
}
FRAMES = RowAFrame(
    color=Names("results/frame{}.jpg", "results/frame{}.jpeg", "results/frame{}.png"),
    depth=Names("results/depth{}.png"),
    poses="traj.txt",
    tables=(CALIBRATION,),
)
SEMANTIC = RowAFrame(
    color=Names("rgb/rgb_{}.png", "rgb/rgb_{}.jpg"),
    depth=Names("depth/depth_{}.png"),
    poses="traj_w_c.txt",
)
"""Of Semantic-NeRF: 90 degrees wide, depth in millimetres."""


def _replica(source: FileSource) -> RowAFrame:
    return FRAMES if source.exists(FRAMES.poses) else SEMANTIC


def _replica_frames(source: FileSource, options: ScanOptions) -> Listing[Poses]:
    """Frames; a calibration above the folder is told apart by what it says."""
    listing = _replica(source)(source, options)
    told_apart_by = (_camera(source),) if _replica(source) is FRAMES else ()
    return replace(listing, fingerprinted=told_apart_by)


def _camera(source: FileSource) -> dict[str, Any]:
    """What cam_params.json says of the camera, here or in the folder above (of an archive: around it)."""
    above = FolderSource(source.path.resolve().parent)
    place = next((one for one in (source, above) if one.exists(CALIBRATION)), None)
    if place is None:
        return PUBLISHED
    camera = read_json(place, CALIBRATION).get("camera")
    if not isinstance(camera, dict):
        raise ScanError(
            f"{place.path / CALIBRATION}: expected an object `camera` with fx fy cx cy scale, found none"
        )
    return camera


def _lens(listing: Listing[Poses]) -> LensOfFrame:
    if _replica(listing.source) is SEMANTIC:
        return lambda _, size: Lens(
            make_camera(
                *size,
                (size[0] / 2, size[0] / 2, (size[0] - 1) / 2, (size[1] - 1) / 2),
                str(listing.source.path),
            )
        )
    camera = _camera(listing.source)
    numbers = [camera.get(key, np.nan) for key in ("fx", "fy", "cx", "cy")]
    where = f"{listing.source.path}: {CALIBRATION}"

    def of_size(_: Frame, size: Size) -> Lens:
        own = camera.get("w", size[0]), camera.get("h", size[1])
        if own != size:
            raise ScanError(
                f"{where}: expected the camera of {size[0]} x {size[1]} px, as the images are, found "
                f"{'the published one' if camera is PUBLISHED else 'one'} of {own[0]} x {own[1]}; put w h "
                "fx fy cx cy scale of these images there"
            )
        return Lens(make_camera(*size, numbers, where))

    return of_size


def _metres_per_unit(listing: Listing[Poses]) -> float:
    if _replica(listing.source) is SEMANTIC:
        return 1e-3
    path, stored = listing.source.path, _camera(listing.source).get("scale", PUBLISHED["scale"])
    scale = float(number_list(stored, 1, f"{path}: {CALIBRATION}, scale")[0])
    if not 0 < scale < np.inf:
        raise ScanError(f"{path}: expected a scale above 0 in {CALIBRATION}, found {scale}")
    return 1 / scale


def _states_scale(listing: Listing[Poses]) -> bool:
    camera = _camera(listing.source)
    return camera is not PUBLISHED and "scale" in camera


REPLICA = FolderLayout(
    name="replica",
    page="""Replica as rendered for iMAP and NICE-SLAM, and for Semantic-NeRF.

    SCAN/results/frameNNNNNN.jpg, depthNNNNNN.png    depth 16-bit
    SCAN/traj.txt                                    a row of 16 numbers a frame: world_from_cam, OpenCV axes
    SCAN/cam_params.json, or in the folder above     {"camera": {w, h, fx, fy, cx, cy, scale}}

    SCAN/rgb/rgb_N.png, depth/depth_N.png, traj_w_c.txt     Semantic-NeRF's: images 90 degrees wide, depth in
                                                            millimetres, poses in the same form

`scale` is how many units of depth make a metre (6553.5). The world is z-up and level. Without
cam_params.json, the published values are taken, where images have the published size (1200 x 680).
""",
    expects="traj.txt with results/frameNNNNNN.jpg, depthNNNNNN.png; traj_w_c.txt with rgb/, depth/",
    checked=(
        "the camera and png_depth_scale in programs that read NICE-SLAM's renderings, and those that read "
        "Semantic-NeRF's. No real file",
        "size, focal length and scale of depth",
    ),
    told_by=(
        f"{FRAMES.poses}|{SEMANTIC.poses}",
        "|".join((*FRAMES.color.patterns, *SEMANTIC.color.patterns)),
    ),
    parts=(FRAMES.poses, "results/"),
    frames=_replica_frames,
    metres_per_unit=_metres_per_unit,
    states_depth_unit=_states_scale,
    lens=_lens,
    write=lambda refined: _replica(refined.source).write(refined),
    up_world=UP_Z,
)


LOGS = tuple(f"{where}trajectory.{end}" for end in ("log", "json") for where in ("", "scene/"))
COLOR_FOLDERS = ("color", "image", "rgb")
INTRINSICS = ("camera_intrinsic.json", "intrinsic.json", "camera_intrinsics.json")
PRIMESENSE = (525.0, 525.0, 319.5, 239.5)
TAKEN_FOR_PRIMESENSE = "no camera_intrinsic.json: the intrinsics are PrimeSense's defaults (fx 525)"


@dataclass(frozen=True)
class _Counted:
    """Numbers of frames by the names of their colour, and the file of intrinsics, if there is one."""

    number_of: dict[str, int]
    intrinsics_name: str
    parameters: list[dict[str, Any]]
    """Of a trajectory as JSON: an object a frame."""


def _counted_frames(source: FileSource, options: ScanOptions) -> Listing[_Counted]:  # noqa: ARG001
    log = first_of(source, LOGS)
    folder = next(name for name in COLOR_FOLDERS if source.names(name))
    colors, depths = _images(source, folder), _images(source, "depth")
    pair = _pair(colors, depths)
    parameters = _parameters(source, log) if log.endswith(".json") else []
    poses = _read_json(parameters, str(source.path / log)) if parameters else _read_log(source, log)
    frames, skipped = [], []
    for i, (color, depth) in enumerate(pair):
        number = Path(color).stem
        if i not in poses:
            skipped.append(f"frame {number}: {log} has no pose")
            continue
        frames.append(Frame(number, float(i), poses[i], f"{folder}/{color}", f"depth/{depth}"))
    lone = sorted(set(depths) - {depth for _, depth in pair})
    skipped += [f"frame {Path(name).stem}: it has depth/{name} and no colour" for name in lone]
    index = {f"{folder}/{color}": i for i, (color, _) in enumerate(pair)}
    intrinsics_name = next((name for name in INTRINSICS if source.exists(name)), "")
    counted = _Counted(index, intrinsics_name, parameters)
    tables = [log, intrinsics_name] if intrinsics_name else [log]
    warnings = [] if intrinsics_name or parameters else [TAKEN_FOR_PRIMESENSE]
    return Listing(source, frames, counted, tables, skipped, warnings)


def _write(refined: Refined[_Counted]) -> None:
    numbers = [refined.content.number_of[frame.color] for frame in refined.frames]
    parameters = refined.content.parameters
    if not parameters:
        write_log(refined.directory / "trajectory.log", numbers, refined.poses)
        return
    # They are counted: those of frames that were left out follow their neighbours.
    recorded = _read_json(parameters, str(refined.source.path))
    poses = followed(recorded, dict(zip(numbers, refined.poses, strict=True)))
    extrinsics = [se3.inverse(poses[i]).ravel(order="F").tolist() for i in range(len(parameters))]
    content = {
        "class_name": "PinholeCameraTrajectory",
        "parameters": [
            {**own, "extrinsic": extrinsic}
            for own, extrinsic in zip(parameters, extrinsics, strict=True)
        ],
        "version_major": 1,
        "version_minor": 0,
    }
    (refined.directory / "trajectory.json").write_text(json.dumps(content, indent=1) + "\n")


def write_log(path: Path, numbers: Sequence[int], poses: Float[np.ndarray, "n 4 4"]) -> None:
    """Poses as Open3D's trajectory log."""
    lines = []
    for number, pose in zip(numbers, poses, strict=True):
        lines.append(f"{number} {number} {number + 1}")
        lines += [" ".join(f"{v:.10f}" for v in row) for row in pose]
    path.write_text("\n".join(lines) + "\n")


def _images(source: FileSource, folder: str) -> list[str]:
    names = [n for n in source.names(folder) if n.lower().endswith((".png", ".jpg", ".jpeg"))]
    if not names:
        raise ScanError(f"{source.path / folder}: expected images, found none")
    return sorted(names, key=in_order)  # the log counts them


def _pair(colors: list[str], depths: list[str]) -> list[tuple[str, str]]:
    """Colour and depth of the same number, or in order where names have none."""

    def number(name: str) -> str:
        found = re.search(r"\d+", name)
        return str(int(found[0])) if found else name

    depth_of = {number(name): name for name in depths}
    if len(depth_of) < len(depths):  # names do not tell frames apart
        return list(zip(colors, depths, strict=False))
    return [(name, depth_of.get(number(name), "")) for name in colors]


def _read_log(source: FileSource, name: str) -> dict[int, Float[np.ndarray, "4 4"]]:
    table = read_poses_of(source, name)
    if table.kind != "log" or not np.isfinite(table.keys).all():
        raise ScanError(
            f"{source.path / name}: expected blocks of a frame's number (a line of 3) and its pose (four of "
            "4), found others"
        )
    return {int(number): pose for number, pose in zip(table.keys, table.poses, strict=True)}


def _parameters(source: FileSource, name: str) -> list[dict[str, Any]]:
    parameters = read_json(source, name).get("parameters")
    if not isinstance(parameters, list) or not all(isinstance(one, dict) for one in parameters):
        raise ScanError(
            f"{source.path / name}: expected a list `parameters` of objects, found none"
        )
    return parameters


def _read_json(parameters: list[dict[str, Any]], where: str) -> dict[int, Float[np.ndarray, "4 4"]]:
    """Extrinsics map world to camera, by column."""
    poses = {}
    for i, one in enumerate(parameters):
        numbers = number_list(one.get("extrinsic"), 16, f"{where}, frame {i}, extrinsic")
        cam_from_world = numbers.reshape(4, 4, order="F")
        check_pose(cam_from_world, f"{where}, frame {i}")
        poses[i] = se3.inverse(cam_from_world)
    return poses


def _intrinsics(source: FileSource, content: _Counted) -> tuple[float, ...]:
    """Of the file of intrinsics, else of the first frame of a trajectory as JSON, else the default."""
    name = content.intrinsics_name
    if not name and not content.parameters:
        return PRIMESENSE
    where = str(source.path / name)
    found = read_json(source, name) if name else content.parameters[0].get("intrinsic")
    stored = found.get("intrinsic_matrix") if isinstance(found, dict) else None
    matrix = number_list(stored, 9, f"{where}, intrinsic_matrix").reshape(3, 3, order="F")
    return (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])


REDWOOD = FolderLayout(
    name="redwood",
    page="""Redwood and Open3D: folders of images and a trajectory log.

    SCAN/color/, image/ or rgb/    colour, sorted by name
    SCAN/depth/                    16-bit, millimetres
    SCAN/trajectory.log            blocks `i i i+1` and a 4x4 world_from_cam, OpenCV camera axes; also
                                   scene/trajectory.log; or trajectory.json, Open3D's camera parameters
    SCAN/camera_intrinsic.json     Open3D's (optional; intrinsic.json too); else PrimeSense's defaults

The first number of a block counts the frame among the images, from 0. Where names of colour and
depth hold times (`000123-000004100.png`), depth belongs to colour by number, not by time.
""",
    expects="trajectory.log (.json; in scene/ too) with folders color/ (image/, rgb/) and depth/",
    checked=(
        "a real trajectory.log of Open3D's tests (211 poses)",
        "blocks and numbers; Open3D reads what `export --to open3d` writes",
    ),
    told_by=("|".join(f"{name}/" for name in COLOR_FOLDERS), "depth/", "|".join(LOGS)),
    parts=(LOGS[0], "|".join(f"{name}/" for name in COLOR_FOLDERS), "depth/"),
    frames=_counted_frames,
    lens=lambda found: pinhole_lens(
        _intrinsics(found.source, found.content),
        str(found.source.path / found.content.intrinsics_name),
    ),
    write=_write,
)
