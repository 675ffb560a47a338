"""Numbered images and one file of poses: Replica's renderings, Redwood's and Open3D's folders."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.layout import FolderLayout, Listing, Refined
from planfit.scan.pairing import Poses, RowAFrame
from planfit.scan.poses import UP_Z
from planfit.scan.recording import Frame, LensOfFrame, pinhole_lens
from planfit.scan.source import FileSource, FolderSource, in_order
from planfit.scan.tables import Names, first_of, number_list, read_json, read_rows, shorten
from planfit.scan.types import ScanOptions

CALIBRATION = "cam_params.json"
PUBLISHED = {"fx": 600.0, "fy": 600.0, "cx": 599.5, "cy": 339.5, "scale": 6553.5}
FRAMES = RowAFrame(
    color=Names("results/frame{}.jpg", "results/frame{}.jpeg", "results/frame{}.png"),
    depth=Names("results/depth{}.png"),
    poses="traj.txt",
    tables=(CALIBRATION,),
)


def _replica_frames(source: FileSource, options: ScanOptions) -> Listing[Poses]:
    """Frames; a calibration above the folder is told apart by what it says."""
    return replace(FRAMES(source, options), fingerprinted=(_camera(source),))


def _camera(source: FileSource) -> dict[str, Any]:
    """What cam_params.json says of the camera, here or in the folder above."""
    above = FolderSource(source.path.resolve().parent)
    places = [source, above] if source.path.is_dir() else [source]
    place = next((one for one in places if one.exists(CALIBRATION)), None)
    if place is None:
        return PUBLISHED
    camera = read_json(place, CALIBRATION).get("camera")
    if not isinstance(camera, dict):
        raise ScanError(
            f"{place.path / CALIBRATION}: expected an object `camera` with fx fy cx cy scale, found none"
        )
    return camera


def _lens(listing: Listing[Poses]) -> LensOfFrame:
    camera = _camera(listing.source)
    numbers = [camera.get(key, np.nan) for key in ("fx", "fy", "cx", "cy")]
    return pinhole_lens(numbers, f"{listing.source.path}: {CALIBRATION}")


def _metres_per_unit(listing: Listing[Poses]) -> float:
    path, stored = listing.source.path, _camera(listing.source).get("scale", PUBLISHED["scale"])
    scale = float(number_list(stored, 1, f"{path}: {CALIBRATION}, scale")[0])
    if not 0 < scale < np.inf:
        raise ScanError(f"{path}: expected a scale above 0 in {CALIBRATION}, found {scale}")
    return 1 / scale


REPLICA = FolderLayout(
    name="replica",
    page="""Replica as rendered for iMAP and NICE-SLAM.

    SCAN/results/frameNNNNNN.jpg, depthNNNNNN.png    depth 16-bit
    SCAN/traj.txt                                    a row of 16 numbers a frame: world_from_cam, OpenCV axes
    SCAN/cam_params.json, or in the folder above     {"camera": {w, h, fx, fy, cx, cy, scale}}

`scale` is how many units of depth make a metre (6553.5). The world is z-up and level. Without
cam_params.json, the published values are taken.
""",
    expects="traj.txt with results/frameNNNNNN.jpg and results/depthNNNNNN.png",
    checked=(
        "the camera and png_depth_scale in programs that read NICE-SLAM's renderings. No real file",
        "size, focal length and scale of depth",
    ),
    told_by=(FRAMES.poses, "|".join(FRAMES.color.patterns)),
    parts=(FRAMES.poses, "results/"),
    frames=_replica_frames,
    metres_per_unit=_metres_per_unit,
    lens=_lens,
    write=FRAMES.write,
    up_world=UP_Z,
)


LOGS = ("trajectory.log", "scene/trajectory.log")
COLOR_FOLDERS = ("color", "image", "rgb")
INTRINSICS = ("camera_intrinsic.json", "intrinsic.json", "camera_intrinsics.json")
PRIMESENSE = (525.0, 525.0, 319.5, 239.5)


@dataclass(frozen=True)
class _Counted:
    """Numbers of frames by the names of their colour, and the file of intrinsics, if there is one."""

    number_of: dict[str, int]
    intrinsics_name: str


def _counted_frames(source: FileSource, options: ScanOptions) -> Listing[_Counted]:  # noqa: ARG001
    log = first_of(source, LOGS)
    folder = next(name for name in COLOR_FOLDERS if source.names(name))
    colors, depths = _images(source, folder), _images(source, "depth")
    pair = _pair(colors, depths)
    poses = _read_log(source, log)
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
    return Listing(
        source,
        frames,
        _Counted(index, intrinsics_name),
        [log, *([intrinsics_name] if intrinsics_name else [])],
        skipped,
        []
        if intrinsics_name
        else ["no camera_intrinsic.json: the intrinsics are PrimeSense's defaults (fx 525)"],
    )


def _write(refined: Refined[_Counted]) -> None:
    numbers = [refined.content.number_of[frame.color] for frame in refined.frames]
    write_log(refined.directory / "trajectory.log", numbers, refined.poses)


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
    rows = read_rows(source, name, "blocks of a line of 3 numbers and four of 4")
    try:
        values = [[float(word) for word in row] for row in rows]
        if [len(v) for v in values] != [3, 4, 4, 4, 4] * (len(values) // 5):
            raise ValueError(f"{len(values)} lines that do not make such blocks")
        if not all(math.isfinite(head[0]) for head in values[::5]):
            raise ValueError("a frame's number that is NaN or infinite")
    except ValueError as error:
        raise ScanError(
            f"{source.path / name}: expected blocks of a line of 3 numbers and four of 4, found "
            f"{shorten(error)}"
        ) from error
    # Blocks of five lines: the frame's number first, then the rows of its pose.
    return {int(values[i][0]): np.array(values[i + 1 : i + 5]) for i in range(0, len(values), 5)}


def _intrinsics(source: FileSource, name: str) -> tuple[float, ...]:
    if not name:
        return PRIMESENSE
    where = str(source.path / name)
    matrix = number_list(
        read_json(source, name).get("intrinsic_matrix"), 9, f"{where}, intrinsic_matrix"
    ).reshape(3, 3, order="F")
    return (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])


REDWOOD = FolderLayout(
    name="redwood",
    page="""Redwood and Open3D: folders of images and a trajectory log.

    SCAN/color/, image/ or rgb/    colour, sorted by name
    SCAN/depth/                    16-bit, millimetres
    SCAN/trajectory.log            blocks `i i i+1` and a 4x4 world_from_cam, OpenCV camera axes; also
                                   scene/trajectory.log or SCAN.log beside the folder's images
    SCAN/camera_intrinsic.json     Open3D's (optional; intrinsic.json too); else PrimeSense's defaults

The first number of a block counts the frame among the images, from 0. Where names of colour and
depth hold times (`000123-000004100.png`), depth belongs to colour by number, not by time.
""",
    expects="trajectory.log (or scene/trajectory.log) with folders color/ (image/, rgb/) and depth/",
    checked=(
        "a real trajectory.log of Open3D's tests (211 poses)",
        "blocks and numbers; Open3D reads what `export --to open3d` writes",
    ),
    told_by=("|".join(f"{name}/" for name in COLOR_FOLDERS), "depth/", "|".join(LOGS)),
    parts=(LOGS[0], "color/", "depth/"),
    frames=_counted_frames,
    lens=lambda found: pinhole_lens(
        _intrinsics(found.source, found.content.intrinsics_name),
        str(found.source.path / found.content.intrinsics_name),
    ),
    write=_write,
)
