"""Any folder of colour and depth images with poses and a lens beside them, whatever these are called."""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.formats import layouts
from planfit.scan.image_series import (
    COLORS,
    Paired,
    all_files,
    find_pair,
    last_number,
    partners,
    series_of,
    time_of,
    words_of,
)
from planfit.scan.images.lens import Lens
from planfit.scan.layout import FolderLayout, Listing, Refined
from planfit.scan.lens_file import lens_of_text
from planfit.scan.no_scan import nearest
from planfit.scan.pose_files import PoseTable, parse_poses, poses_of_images, read_poses
from planfit.scan.poses import MAX_ROTATION_DEFECT, is_lost, write_pose
from planfit.scan.recording import Frame, LensOfFrame, Size, write_trajectory
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import numbers_of
from planfit.scan.types import ScanOptions

T = TypeVar("T")
Beside = list[tuple[str, dict[str, str]]]
"""Names of files that are of no series, and patterns of series with the frames' numbers, files by these."""
POSE_WORDS = words_of(
    "pose poses traj trajectory trajectories groundtruth ground truth gt extrinsic extrinsics odometry odom "
    "camera cameras cam transform transforms transformations matrices w c world to frames"
)
LENS_WORDS = words_of(
    "intrinsic intrinsics intrin camera cameras cam calib calibration k focal config dataconfig params info "
    "metadata meta sensor transforms transformations parameters"
)
_OTHERS = words_of("depth infra infrared right ir points imu")
"""Words of files that are not the colour camera's."""
POSE_SUFFIXES = (".txt", ".csv", ".json", ".log", ".tum", ".pose", ".npy", ".freiburg")
CAMERA_SUFFIXES = (".yaml", ".yml", ".json")
"""Of files that name what they hold."""
_UNIT = re.compile(
    r"""(?<!\w)(?:\w*depth_?(?:map_?)?(?:scale|factor)|scale)["']?\s*[:=]\s*(\d+\.?\d*(?:e[-+]?\d+)?)""",
    re.IGNORECASE,
)
"""How many units of depth make a metre, or how many metres one has, as files of lenses say it."""
MAX_UNIT_M = 0.01
"""No whole numbers of depth are coarser: in 256 of these is the range of a room."""
MAX_OFF_CENTRE = 0.2
"""Share of the image by which a principal point may be off its centre: of cameras it is a twentieth, of
lenses of images of half the size a quarter, and of twice the size a half."""


@dataclass(frozen=True)
class Poses:
    """Recorded poses, of one file or of a file each."""

    name: str
    """Of the file, or pattern of the files."""
    table: PoseTable
    """Of a file each: that of the first."""
    keys: Sequence[str] = ()
    """Numbers in names of images or of these files, by rows; without, the table tells frames apart."""
    files: Sequence[str] = ()


@dataclass(frozen=True)
class Content:
    """What the files beside the images are."""

    lens: LensOfFrame
    text: str
    """Of the file of the lens."""
    pose_files: dict[str, str]
    """Names of the text files that hold the pose of one frame each, by the frames' ids."""


def _frames(source: FileSource, options: ScanOptions) -> Listing[Content]:
    pair, beside = _sorted_out(source, options)
    if pair is None:
        raise ScanError(
            f"{source.path}: expected images of colour and of depth (16-bit, .npy or .exr) whose names share "
            "numbers, found none; name their folders with --color-topic and --depth-topic"
        )
    why: list[str] = []
    if options.poses is not None:
        poses = Poses(str(options.poses), read_poses(options.poses))
    else:
        found = [one for one in _poses(source, beside, why) if options.pose_topic in one.name]
        line = f"{source.path}: expected poses of the frames, found {(*why, 'none')[0]}; or give --poses FILE"
        words = POSE_WORDS | pair.color.words
        poses = _plainest(source, found, lambda one: one.name, words, line, "--pose-topic")
    ids = pair.keys
    times = np.array([time_of(key) for key in ids])
    matrices, told, files = _of_frames(source, poses, pair, times, options.max_time_gap_s)
    frames = [
        Frame(
            frame_id, time, pose, pair.color.names.get(a, ""), pair.depth.names.get(b, ""),
            lacks="" if a and b else "depth" if a else "colour",
        )
        for frame_id, time, pose, (a, b) in zip(ids, times, matrices, pair.frames, strict=True)
    ]  # fmt: skip
    lens, lens_files, text = _lens(source, beside)
    used = poses.files or (() if options.poses else (poses.name,))
    content, warnings = Content(lens, text, files), [*pair.told, *told]
    return Listing(source, frames, content, [*lens_files, *used], warnings=warnings)


def _is_any(source: FileSource) -> bool:
    """Whether images of colour and depth are there with poses, or without in no folder of a known format."""
    try:
        pair, beside = _sorted_out(source, ScanOptions())
    except ScanError:
        return True  # of several cameras, which is told when it is read
    if pair is None:
        return False
    has_poses = next(_poses(source, beside, []), None) is not None
    return has_poses or nearest(source, layouts()) is None


def _sorted_out(source: FileSource, options: ScanOptions) -> tuple[Paired | None, Beside]:
    """Colour and depth, None where there are none, and what may tell of their frames."""
    names = all_files(source)
    series = series_of(names)
    wanted = options.color_topic, options.depth_topic
    pair = find_pair(source, series, wanted, options.max_time_gap_s)
    if pair is None:
        return None, []
    held = {name for one in series for name in one.names.values()}
    own = [one for one in series if partners([*one.names], pair.keys, 0.0)]
    tables: Beside = [(name, {}) for name in names if name not in held]
    return pair, [*tables, *((one.pattern, one.names) for one in own)]


def _poses(source: FileSource, beside: Beside, why: list[str]) -> Iterator[Poses]:
    """All that can be read as poses of several frames; `why` grows by what cannot."""
    for pattern, names in beside:
        words, files = words_of(pattern), list(names.values())
        if not pattern.lower().endswith(POSE_SUFFIXES) or _OTHERS & words:
            continue
        if not files and not words & POSE_WORDS:
            continue
        try:
            found = _read_poses(source, files[0] if files else pattern)
        except ScanError as error:
            why += [str(error)] if words & POSE_WORDS else []
            continue
        if files and len(found.table.poses) == 1:
            yield Poses(pattern, found.table, list(names), files)
        if not files and len(found.table.poses) > 1:
            yield found


def _read_poses(source: FileSource, name: str) -> Poses:
    """Of one file.

    Raises:
        ScanError: it holds none.
    """
    path = source.path / name
    if name.lower().endswith(".npy"):
        try:
            rows = np.load(BytesIO(source.read(name)), allow_pickle=False).astype(float)
            if rows.shape[-2:] not in ((4, 4), (3, 4)):
                raise ValueError(f"shape {rows.shape}")
        except (ValueError, OSError, EOFError, TypeError) as error:
            raise ScanError(f"{path}: expected matrices of 4x4 or 3x4, found {error}") from error
        return Poses(name, parse_poses(_text(rows.reshape(-1, 4)), path))
    text = read_text(source, name)
    if text.lstrip()[:1] not in ("{", "["):
        return Poses(name, parse_poses(text, path))
    try:
        found = list(_matrices(json.loads(text)))
    except (ValueError, RecursionError) as error:
        raise ScanError(f"{path}: expected JSON, found text that is not ({error})") from error
    if not found:
        raise ScanError(f"{path}: expected matrices of 4x4 or 3x4 in JSON, found none")
    table = parse_poses("\n".join(_text(one) for _, one in found), path)
    keys = [last_number(key) for key, _ in found]
    return Poses(name, table, keys if all(keys) and len(set(keys)) == len(keys) else ())


def _text(rows: Float[np.ndarray, "r 4"]) -> str:
    return "\n".join(" ".join(map(repr, row)) for row in rows.tolist())


def _matrices(value: Any, name: str = "") -> Iterator[tuple[str, Float[np.ndarray, "4 4"]]]:
    """Rigid transforms in JSON, in order, each with the image or the key that it stands under."""
    if isinstance(value, dict):
        if {"rotation", "position"} <= value.keys():  # cameras.json of 3D Gaussian splatting
            columns = [numbers_of(value[key]).ravel() for key in ("rotation", "position")]
            if [len(one) for one in columns] == [9, 3]:
                value = value | {"rotation": np.c_[columns[0].reshape(3, 3), columns[1]].tolist()}
        image = next((v for v in value.values() if isinstance(v, str) and last_number(v)), "")
        for key, one in value.items():
            yield from _matrices(one, image or (key if last_number(key) else name))
    if not isinstance(value, list):
        return
    row = numbers_of(value)
    if row.shape not in ((4, 4), (3, 4), (16,), (12,)):
        for one in value:
            yield from _matrices(one, name)
        return
    pose = np.vstack([row.reshape(-1, 4), np.eye(4)[row.size // 4 :]])
    if is_lost(pose) or np.allclose(
        pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=MAX_ROTATION_DEFECT
    ):
        yield name, pose


def _of_frames(
    source: FileSource,
    recorded: Poses,
    pair: Paired,
    times: Float[np.ndarray, " n"],
    max_gap_s: float,
) -> tuple[Float[np.ndarray, "n 4 4"], list[str], dict[str, str]]:
    """Poses of the frames, NaN where there is none; what to say of it; files of text that hold one each."""
    ids, poses = pair.keys, np.full((len(times), 4, 4), np.nan)
    where, table = f"{source.path / recorded.name}: expected", recorded.table
    if not recorded.keys:
        path = source.path / recorded.name
        own, known, told = poses_of_images(ids, times, table, path, max_gap_s)
        if not known.any() and len(table.keys) == len(ids):
            own, known = table.poses, ~is_lost(table.poses)
            told = [f"times of {recorded.name} are none of the images': rows are taken in order"]
        poses[known] = own[known]
        return poses, told, {}
    matched = partners(ids, list(recorded.keys), max_gap_s)
    if matched is None:
        found = f"{recorded.keys[0]} to {recorded.keys[-1]}"
        raise ScanError(f"{where} poses of the frames {ids[0]} to {ids[-1]}, found {found}")
    row_of = {key: row for row, key in enumerate(recorded.keys)}
    rows = {frame: row_of[key] for frame, key in matched[0] if frame and key}
    for i, frame in enumerate(ids):
        if frame in rows and recorded.files:
            poses[i] = _read_poses(source, recorded.files[rows[frame]]).table.poses[0]
        elif frame in rows:
            poses[i] = table.poses[rows[frame]]
    is_text = recorded.files and not recorded.name.lower().endswith((".npy", ".json"))
    files = {frame: recorded.files[row] for frame, row in rows.items()} if is_text else {}
    told = [f"{recorded.name} counts from another number than the images: paired in order"]
    return poses, told if matched[1] else [], files


def _plainest(
    source: FileSource,
    found: Sequence[T],
    name: Callable[[T], str],
    words: frozenset[str],
    none: str,
    option: str,
) -> T:
    """Of several files the one whose name has the fewest words beside those for what it holds.

    Raises:
        ScanError: there is `none`, or several have as few.
    """
    if not found:
        raise ScanError(none)
    oddity = [len(words_of(name(one)) - words) for one in found]
    best = [one for one, n in zip(found, oddity, strict=True) if n == min(oddity)]
    if len(best) > 1:
        named = ", ".join(sorted(map(name, best)))
        raise ScanError(
            f"{source.path}: expected one file for all frames, found {named}; name one with {option}"
        )
    return best[0]


def _lens(source: FileSource, beside: Beside) -> tuple[LensOfFrame, list[str], str]:
    """The lens of each frame, the files that tell it, and the text of the first."""
    why, usable = "none", []
    for name, names in beside:
        words, suffix = words_of(name), PurePosixPath(name).suffix.lower()
        is_named = words & LENS_WORDS and not words & (POSE_WORDS - LENS_WORDS)
        is_told = suffix in CAMERA_SUFFIXES or (is_named and suffix in (".txt", ".csv"))
        if not is_told or words & _OTHERS:
            continue
        first = next(iter(names.values()), name)
        try:
            text = read_text(source, first)
            usable.append((name, names, text, lens_of_text(text, str(source.path / first))))
        except ScanError as error:
            why = str(error) if words & (LENS_WORDS - POSE_WORDS) else why
    step = "give it with --intrinsics FILE (fx fy cx cy, or YAML or JSON)"
    none = f"{source.path}: expected a file with the lens, found {why}; {step}"
    try:
        name, names, text, lens = _plainest(
            source, usable, lambda one: one[0], LENS_WORDS | COLORS, none, "--intrinsics"
        )
    except ScanError as error:
        return _refusing(str(error)), [], ""

    def of_frame(frame: Frame, size: Size) -> Lens:
        own = lens
        if names and frame.frame_id in names:
            file = names[frame.frame_id]
            own = lens_of_text(read_text(source, file), str(source.path / file))
        found = own(frame, size)
        camera = found.camera
        off = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
        if off > MAX_OFF_CENTRE:
            raise ScanError(
                f"{source.path / name}: expected the lens of images of {size[0]} x {size[1]} px, found a "
                f"principal point at {camera.cx:g}, {camera.cy:g}, as of another size; {step}"
            )
        return found

    return of_frame, list(names.values()) or [name], text


def _refusing(line: str) -> LensOfFrame:
    def lens(_: Frame, __: Size) -> Lens:
        raise ScanError(line)

    return lens


def _stated_unit(listing: Listing[Content]) -> float | None:
    """Metres of a unit of depth as the file of the lens states it; None where it does not, or states no unit
    of whole numbers, as factors to millimetres (BOP's 0.1 or 1)."""
    found = _UNIT.search(listing.content.text)
    value = float(found[1]) if found else 1.0
    return 1 / value if value >= 1 / MAX_UNIT_M else value if 0 < value <= MAX_UNIT_M else None


def _write(refined: Refined[Content]) -> None:
    """Files of poses by their own names where each frame has one, else one trajectory."""
    files = refined.content.pose_files
    if not all(frame.frame_id in files for frame in refined.frames):
        write_trajectory(refined.directory, refined.frames, refined.poses)
        return
    for frame, pose in zip(refined.frames, refined.poses, strict=True):
        write_pose(refined.directory / Path(files[frame.frame_id]).with_suffix(".txt").name, pose)


ANY_FOLDER = FolderLayout(
    name="any-folder",
    page="""Any folder of colour and depth images with poses and a lens beside them, of no other format.

    FOLDER/NAME_N.jpg    colour: rgb, color, image, img, frame, photo, left or cam in the name or folder
    FOLDER/NAME_N.png    depth: `depth` in them; 16-bit whole numbers, or metres as .npy, EXR or TIFF
    poses                a file a frame (4x4, 3x4, or x y z qx qy qz qw; .npy or JSON, too), or a table of
                         all: TUM; 7, 12 or 16 numbers a row; matrices below each other; JSON, also the
                         cameras.json of 3D Gaussian splatting
    lens                 YAML, JSON or text (fx fy cx cy or a matrix), of all frames or a file a frame; else
                         `--intrinsics FILE`: none is guessed

Files belong together by the number or time in their names; where names count from other numbers, by order,
which is told. Where images are numbered one by one and poses have times, there must be a row for each
image, in order. Folders of masks, confidence, normals and labels are left aside. Of several cameras none is
chosen: name the folder of one, or its images with `--color-topic` and `--depth-topic`, and poses with
`--pose-topic`. Depth is in millimetres unless a file of the lens states a scale. Depth must show what colour
shows. A copy of another format that lacks files is refused, and what it lacks is named. Refined poses are
written as files of 4x4 text where they came as files of text, else as `trajectory.tum`.
""",
    expects="images of colour and of depth whose names share numbers, with poses beside them",
    checked=(
        "layouts of public data sets and tools (tests/scan/test_any_folders.py says whose). No real file",
        "pairing, poses, lenses and units of depth",
    ),
    told_by=_is_any,
    frames=_frames,
    metres_per_unit=lambda listing: _stated_unit(listing) or 1e-3,
    states_depth_unit=lambda listing: _stated_unit(listing) is not None,
    lens=lambda listing: listing.content.lens,
    write=_write,
)
