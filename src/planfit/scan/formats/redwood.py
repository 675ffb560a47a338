"""Redwood's and Open3D's folders: a trajectory log that counts the images."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.layout import FolderLayout, Listing, Refined
from planfit.scan.recording import Frame, pinhole_lens
from planfit.scan.source import FileSource, in_order
from planfit.scan.tables import first_of, number_list, read_json, read_rows, shorten
from planfit.scan.types import ScanOptions

LOGS = ("trajectory.log", "scene/trajectory.log")
COLOR_FOLDERS = ("color", "image", "rgb")
INTRINSICS = ("camera_intrinsic.json", "intrinsic.json", "camera_intrinsics.json")
PRIMESENSE = (525.0, 525.0, 319.5, 239.5)


@dataclass(frozen=True)
class _Counted:
    """Numbers of frames by the names of their colour, and the file of intrinsics, if there is one."""

    number_of: dict[str, int]
    intrinsics_name: str


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Counted]:  # noqa: ARG001
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
    frames=_frames,
    lens=lambda found: pinhole_lens(
        _intrinsics(found.source, found.content.intrinsics_name),
        str(found.source.path / found.content.intrinsics_name),
    ),
    write=_write,
)
